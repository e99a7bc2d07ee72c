"""Rigid-body dynamics of legs, device and wearer: torques, inertias, energies, positions.

Conventions: joint angles in [rad] with hip flexion, knee flexion and ankle dorsiflexion positive (joints
that a user's URDF counts the other way are reversed, see :mod:`twin_gait.leg_model.joints`); all joints
have one degree of freedom, so ``q``, ``v`` and all results have shape ``(nv,)`` unless stated otherwise;
torques act on the joints.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ModelError
from twin_gait.leg_model import joints
from twin_gait.leg_model.anthropometry import ManufacturedSizes, device_sizes
from twin_gait.leg_model.assembly import Fitting, complete_assembly
from twin_gait.leg_model.attachments import Attachment
from twin_gait.leg_model.urdf import find_urdf
from twin_gait.parameters.quantities import FINITE, require
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import JointName, PelvisGuide, Side


class LegModel:
    """Rigid-body model of one or two legs with device and wearer.

    Attributes:
        model: The Pinocchio model, which models of equal arguments share; it must not be changed.
        legs: Joint names per side, as in the URDF.
        nv: Number of coordinates (and velocities).
        sides: Legs of the model, in the order of the log.
        sizes: Device sizes after fitting to the wearer, or None if the URDF was left as it is.
        urdf_path: Path of the URDF.
        patient: The wearer, or None.
        total_mass: Mass of all links, wearer included, in [kg].
        pelvis_index: Position of the vertical pelvis coordinate, or None if the pelvis is fixed.
        forward_index: Position of the fore-aft pelvis coordinate, or None if the pelvis cannot move forwards.
        pitch_index: Position of the pitch of pelvis and trunk, forwards positive, or None if the pelvis is
            guided.
        trunk_joint: Name of the joint that carries pelvis and trunk, or None if the pelvis is fixed.
    """

    def __init__(
        self,
        urdf: str | Path,
        legs: Mapping[Side, joints.LegJoints],
        *,
        patient: Patient | None = None,
        fit_device: bool = True,
        manufactured: ManufacturedSizes | None = None,
        heel_to_forefoot: float | None = None,
        driven_sides: Sequence[Side] = (),
        attachment: Attachment | None = None,
        pelvis: PelvisGuide = PelvisGuide.FIXED,
        armature: Mapping[JointName, float] | None = None,
        gravity: float = 9.81,
        up_axis: str = "z",
        bodies: joints.BodySelection = joints.BodySelection.BOTH,
    ) -> None:
        """Build the model.

        Args:
            urdf: Path of a URDF, or the name of a packaged one.
            legs: Joint names of each leg, with a minus in front of a joint that is reversed; every other
                joint of the URDF is locked at zero.
            patient: Wearer whose segments are added to the links; None adds nothing.
            fit_device: Whether to set femur, tibia, waist and foot to the wearer's size.
            manufactured: Sizes in which the device is made; None for a device that is made to measure.
            heel_to_forefoot: Distance from heel to forefoot of a fitted foot as a share of its length; None
                leaves them as they are drawn.
            driven_sides: Legs with drives, and so with ``armature``; empty for all legs.
            attachment: Parts of the device on the segments of the wearer; None for none.
            pelvis: Guide of the pelvis.
            armature: Rotor and gear inertia at the joint per joint name in [kg·m²]; 0 if absent.
            gravity: Magnitude in [m/s²].
            up_axis: Vertical axis of the URDF, ``"z"`` or ``"y"``.
            bodies: Whether the model contains device and wearer or only one of them. In each case its joints
                are those of the device fitted to the wearer; a model of the wearer alone has no rotors.

        Raises:
            ModelError: If the URDF cannot be read or lacks a joint or frame.
            ParameterError: If a parameter is out of range.
        """
        FINITE.require("gravity", gravity)
        require(up_axis in ("y", "z"), "up_axis", "'y' or 'z'", up_axis)
        require(bool(legs), "legs", "at least one leg", legs)
        self.urdf_path = find_urdf(urdf)
        self.pelvis, self.patient = PelvisGuide(pelvis), patient
        self.up_axis = up_axis
        self.sizes = None
        if patient is not None and fit_device:
            self.sizes = device_sizes(patient, manufactured, heel_to_forefoot)
        alone = joints.BodySelection(bodies) is joints.BodySelection.WEARER
        fitting = Fitting(
            sizes=self.sizes,
            patient=None if bodies == joints.BodySelection.DEVICE else patient,
            carrier=None if alone else patient,
            wearer_only=alone,
            gravity=gravity,
            armature=() if alone or armature is None else tuple(armature.items()),
            driven_sides=tuple(driven_sides or legs),
            attachment=attachment or Attachment(),
        )
        assembly = complete_assembly(self.urdf_path, legs, self.pelvis, up_axis, fitting)
        self.legs, self.model = assembly.legs, assembly.model
        self.data = self.model.createData()
        self.nv, self.sides = int(self.model.nv), tuple(self.legs)
        self.total_mass = float(sum(body.mass for body in self.model.inertias))
        guides = joints.GUIDES[self.pelvis]
        self.forward_index, self.pelvis_index, self.pitch_index = (
            self._coordinate_index(name) if name in guides else None for name in joints.ALL_GUIDES
        )
        self.trunk_joint = guides[-1] if guides else None
        self._frames: dict[str, int] = {}  # indices of frames by name, found when first used
        self._indices = {
            (side, joint): self._coordinate_index(name)
            for side, leg in self.legs.items()
            for joint, name in leg.items()
        }

    def _coordinate_index(self, name: str) -> int:
        """Return the position of a joint in ``q`` by its name in the URDF."""
        return int(self.model.joints[self.model.getJointId(name)].idx_v)

    def index(self, side: Side, joint: JointName) -> int:
        """Return the position of a joint in ``q``, ``v`` and ``tau``.

        Raises ModelError if the leg has no such joint.
        """
        index = self._indices.get((side, joint))
        if index is None:
            raise ModelError(f"{self.urdf_path}: the {side} leg has no {joint}; legs: {', '.join(self.legs)}")
        return index

    def position_limits(self, side: Side, joint: JointName) -> tuple[float, float]:
        """Return the lower and upper limit of a joint from the URDF in [rad]."""
        index = self.index(side, joint)
        return float(self.model.lowerPositionLimit[index]), float(self.model.upperPositionLimit[index])

    def velocity_limit(self, side: Side, joint: JointName) -> float:
        """Return the velocity limit of a joint from the URDF in [rad/s], infinite if the file states none."""
        return float(self.model.velocityLimit[self.index(side, joint)]) or math.inf

    def effort_limit(self, side: Side, joint: JointName) -> float:
        """Return the effort limit of a joint from the URDF in [N·m], infinite if the file states none."""
        return float(self.model.effortLimit[self.index(side, joint)]) or math.inf

    def gravity_torque(self, q: np.ndarray) -> np.ndarray:
        """Compute the torques :math:`g(q)` that balance gravity, in [N·m] ([N] at the pelvis)."""
        return np.array(pin.computeGeneralizedGravity(self.model, self.data, q))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Compute the inertia :math:`M(q)` with armature, in [kg·m²], shape ``(nv, nv)``, symmetric."""
        return np.array(pin.crba(self.model, self.data, q))

    def inertia_torque(self, q: np.ndarray, a: np.ndarray) -> np.ndarray:
        r"""Compute the torques of inertia in [N·m]: :math:`M(q)\,\ddot q`, armature included."""
        return np.asarray(self.mass_matrix(q) @ a)

    def effective_inertia(self, q: np.ndarray, index: int) -> float:
        """Compute the effective inertia :math:`M_{jj}` of one joint, all others held, in [kg·m²]."""
        return float(self.mass_matrix(q)[index, index])

    def nonlinear_effects(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        r"""Compute Coriolis, centrifugal and gravity torques :math:`h(q, \dot q)` in [N·m]."""
        return np.array(pin.nonLinearEffects(self.model, self.data, q, v))

    def inverse_dynamics(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Compute torques in [N·m] for an acceleration, armature included (recursive Newton-Euler)."""
        return np.array(pin.rnea(self.model, self.data, q, v, a))

    def forward_dynamics(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Compute joint accelerations in [rad/s²] under torques (articulated-body algorithm)."""
        return np.asarray(pin.aba(self.model, self.data, q, v, tau))

    def kinetic_energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Compute the kinetic energy, rotors included, in [J]."""
        return float(0.5 * v @ self.mass_matrix(q) @ v)

    def potential_energy(self, q: np.ndarray) -> float:
        """Compute the potential energy in the field of gravity, in [J]."""
        return float(pin.computePotentialEnergy(self.model, self.data, q))

    def frame_position(self, q: np.ndarray, frame: str) -> np.ndarray:
        """Return the position of a frame in the world in [m], shape ``(3,)``; ModelError if it is missing."""
        return self.frame_positions(q, (frame,))[0]

    def frame_positions(self, q: np.ndarray, frames: Sequence[str]) -> list[np.ndarray]:
        """Return the positions of several frames, each like :meth:`frame_position`."""
        pin.forwardKinematics(self.model, self.data, q)
        found = []
        for frame in frames:
            if frame not in self._frames and not self.model.existFrame(frame):
                known = ", ".join(item.name for item in self.model.frames)
                raise ModelError(f"{self.urdf_path}: there is no frame {frame!r}; expected one of {known}")
            index = self._frames.setdefault(frame, self.model.getFrameId(frame))
            found.append(np.array(pin.updateFramePlacement(self.model, self.data, index).translation))
        return found
