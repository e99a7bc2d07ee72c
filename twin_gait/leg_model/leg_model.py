"""The one physics room that knows Pinocchio.

Conventions: joint angles in [rad] with hip flexion, knee flexion and ankle dorsiflexion positive (a
URDF given by the user must follow them or be adapted); all joints have one degree of freedom, so
``q`` and ``v`` have the same length; torques act on the joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ModelError, ParameterError
from twin_gait.leg_model.urdf import build_model, find_urdf, urdf_hash
from twin_gait.leg_model.wearer import (
    FOOT_HEIGHT,
    FOOT_LENGTH,
    SEGMENTS,
    SHANK_LENGTH,
    TRUNK_CENTRE_OF_MASS,
    TRUNK_LENGTH,
    TRUNK_RADIUS_OF_GYRATION,
    DeviceSizes,
    device_sizes,
    segment_inertia,
    trunk_mass,
)
from twin_gait.parameters import Patient
from twin_gait.vocabulary import JointName, Side

PELVIS_JOINT = "pelvis_vertical"


class PelvisGuide(StrEnum):
    """How the pelvis is held."""

    FIXED = "fixed"
    VERTICAL = "vertical"


class Bodies(StrEnum):
    """Whose bodies a model has."""

    BOTH = "both"
    DEVICE = "device"
    WEARER = "wearer"


@dataclass(frozen=True, kw_only=True)
class LegJoints:
    """Names of the joints and contact frames of one leg in the URDF.

    Attributes:
        hip: Name of the hip flexion joint.
        knee: Name of the knee joint.
        ankle: Name of the ankle joint, or None.
        contact_frames: Names of the frames that touch the ground (heel, toe), maybe none.
    """

    hip: str
    knee: str
    ankle: str | None = None
    contact_frames: tuple[str, ...] = ()

    @classmethod
    def of_twin(cls, side: Side, *, foot: bool = True) -> LegJoints:
        """Names in the URDFs of this project.

        Args:
            side: Which leg.
            foot: Whether the URDF has an ankle and a foot.
        """
        return cls(
            hip=f"{side}_hip",
            knee=f"{side}_knee",
            ankle=f"{side}_ankle" if foot else None,
            contact_frames=(f"{side}_heel", f"{side}_toe") if foot else (),
        )

    def items(self) -> list[tuple[JointName, str]]:
        """Joints that exist, from proximal to distal."""
        pairs = [(JointName.HIP, self.hip), (JointName.KNEE, self.knee)]
        if self.ankle is not None:
            pairs.append((JointName.ANKLE, self.ankle))
        return pairs


class LegModel:
    """Rigid-body model of one or two legs with device and wearer.

    Attributes:
        model: The Pinocchio model.
        legs: Joint names per side.
        sizes: Device sizes after fitting to the wearer, or None if the URDF was left as it is.
        urdf_path: The file.
        urdf_hash: SHA-256 of the file's content.
    """

    def __init__(
        self,
        urdf: str | Path,
        legs: Mapping[Side, LegJoints],
        *,
        patient: Patient | None = None,
        fit_device: bool = True,
        pelvis: PelvisGuide = PelvisGuide.FIXED,
        armature: Mapping[JointName, float] | None = None,
        gravity: float = 9.81,
        up_axis: str = "z",
        bodies: Bodies = Bodies.BOTH,
    ) -> None:
        """Build the model.

        Args:
            urdf: Path of a URDF, or the name of a packaged one.
            legs: Joint names of each leg; every other joint of the URDF is locked at zero.
            patient: Wearer whose segments are added to the links; None adds nothing.
            fit_device: Whether to set femur, tibia and waist to the wearer's size.
            pelvis: Fixed in the world, or free to move vertically.
            armature: Rotor and gear inertia at the joint per joint name in [kg m²]; 0 if absent.
            gravity: Magnitude in [m] / [s²].
            up_axis: ``"z"`` or ``"y"``: the vertical of the URDF.
            bodies: Those of device and wearer, or of one of them alone on the same joints, which are those
                of the device fitted to the wearer; the wearer alone has no rotors.

        Raises:
            ModelError: If the URDF cannot be read or lacks a joint or frame.
            ParameterError: If a parameter is out of range.
        """
        if not math.isfinite(gravity):
            raise ParameterError(f"gravity: expected a finite number, got {gravity}")
        if up_axis not in ("y", "z"):
            raise ParameterError(f"up_axis: expected 'y' or 'z', got {up_axis!r}")
        if not legs:
            raise ParameterError("legs: expected at least one leg, got none")
        self.urdf_path = find_urdf(urdf)
        self.urdf_hash = urdf_hash(self.urdf_path)
        self.legs = dict(legs)
        self.pelvis = pelvis
        self.up_axis = up_axis
        model = self._build(pelvis)
        self._check_names(model)
        self.model = self._lock_other_joints(model)
        self._check_degrees_of_freedom()
        self.sizes: DeviceSizes | None = None
        if patient is not None:
            if fit_device:
                self.sizes = device_sizes(patient)
                self._resize(self.sizes)
            if bodies is Bodies.WEARER:
                self._take_device_away()
            if bodies is not Bodies.DEVICE:
                self._add_wearer(patient)
        vertical = {"z": [0.0, 0.0, 1.0], "y": [0.0, 1.0, 0.0]}[up_axis]
        self.model.gravity.linear = -gravity * np.array(vertical)
        self._set_armature({} if bodies is Bodies.WEARER else armature or {})
        self.data = self.model.createData()

    # ------------------------------------------------------------------ construction

    def _build(self, pelvis: PelvisGuide) -> pin.Model:
        if pelvis is PelvisGuide.FIXED:
            return build_model(self.urdf_path)
        joint = pin.JointModelPZ() if self.up_axis == "z" else pin.JointModelPY()
        return build_model(self.urdf_path, (joint, PELVIS_JOINT))

    def _check_names(self, model: pin.Model) -> None:
        joints = [name for name in model.names if name != "universe"]
        frames = {frame.name for frame in model.frames}
        for side, leg in self.legs.items():
            for joint, name in leg.items():
                if name not in joints:
                    raise ModelError(
                        f"{self.urdf_path}: no joint {name!r} for the {side} {joint}; "
                        f"it has {', '.join(joints) or 'no joints'}"
                    )
            for name in leg.contact_frames:
                if name not in frames:
                    raise ModelError(
                        f"{self.urdf_path}: no frame {name!r} for the {side} foot; "
                        f"it has {', '.join(sorted(frames))}"
                    )

    def _lock_other_joints(self, model: pin.Model) -> pin.Model:
        wanted = {name for leg in self.legs.values() for _, name in leg.items()} | {PELVIS_JOINT}
        locked = [model.getJointId(name) for name in model.names if name not in wanted | {"universe"}]
        if not locked:
            return model
        return pin.buildReducedModel(model, locked, pin.neutral(model))

    def _check_degrees_of_freedom(self) -> None:
        for leg in self.legs.values():
            for _, name in leg.items():
                joint = self.model.joints[self.model.getJointId(name)]
                if joint.nv == 1 and not joint.shortname().startswith("JointModelR"):
                    raise ModelError(f"{self.urdf_path}: joint {name!r} slides; expected a revolute joint")
                if joint.nq != 1 or joint.nv != 1:
                    raise ModelError(
                        f"{self.urdf_path}: joint {name!r} has {joint.nv} degrees of freedom; "
                        "expected a revolute joint with one"
                    )

    def _joint_id(self, name: str) -> int:
        return int(self.model.getJointId(name))

    def _resize(self, sizes: DeviceSizes) -> None:
        """Set femur, tibia and waist: joint placements and the device's own inertia.

        The mass of a link stays; its centre of mass along the tube moves with the length and its
        transverse inertia with the square of it.
        """
        for leg in self.legs.values():
            placements = self.model.jointPlacements
            hip, knee = self._joint_id(leg.hip), self._joint_id(leg.knee)
            side_offset = placements[hip].translation.copy()
            lateral = 1 if self.up_axis == "z" else 2
            if side_offset[lateral] != 0.0:
                side_offset[lateral] = np.copysign(sizes.waist / 2.0, side_offset[lateral])
                placements[hip].translation = side_offset
            self._stretch(hip, knee, sizes.femur)
            if leg.ankle is not None:
                self._stretch(knee, self._joint_id(leg.ankle), sizes.tibia)

    def _stretch(self, proximal: int, distal: int, length: float) -> None:
        placement = self.model.jointPlacements[distal]
        old = float(np.linalg.norm(placement.translation))
        if old == 0.0:
            raise ModelError(
                f"{self.urdf_path}: joints {self.model.names[proximal]!r} and "
                f"{self.model.names[distal]!r} coincide, so the segment cannot be fitted; "
                "use fit_device: false"
            )
        ratio = length / old
        placement.translation = placement.translation * ratio
        body = self.model.inertias[proximal]
        self.model.inertias[proximal] = pin.Inertia(
            body.mass, body.lever * ratio, body.inertia * (ratio * ratio)
        )

    def _take_device_away(self) -> None:
        for joint in range(self.model.njoints):
            self.model.inertias[joint] = pin.Inertia.Zero()

    def _add_wearer(self, patient: Patient) -> None:
        segments = SEGMENTS[patient.sex]
        for leg in self.legs.values():
            hip, knee = self._joint_id(leg.hip), self._joint_id(leg.knee)
            thigh = self.model.jointPlacements[knee].translation.copy()
            if not thigh.any():
                raise ModelError(
                    f"{self.urdf_path}: joints {leg.hip!r} and {leg.knee!r} coincide; no thigh fits between"
                )
            self._append(hip, *segment_inertia(segments["thigh"], patient.mass, thigh))
            if leg.ankle is None:
                down = thigh / np.linalg.norm(thigh)
                shank = SHANK_LENGTH * patient.height * down
                self._append(knee, *segment_inertia(segments["shank"], patient.mass, shank))
                continue
            ankle = self._joint_id(leg.ankle)
            shank = self.model.jointPlacements[ankle].translation.copy()
            self._append(knee, *segment_inertia(segments["shank"], patient.mass, shank))
            self._append_foot(ankle, patient)
        if self.pelvis is PelvisGuide.VERTICAL:
            self._append_trunk(patient)

    def _append_foot(self, ankle: int, patient: Patient) -> None:
        # The heel lies a quarter of the foot length behind the ankle (gait2d: 0.06 of 0.21 m).
        length = FOOT_LENGTH * patient.height
        forward, up = np.array([1.0, 0.0, 0.0]), self._up()
        segment = SEGMENTS[patient.sex]["foot"]
        mass, from_heel, inertia = segment_inertia(segment, patient.mass, length * forward)
        heel = -0.25 * length * forward - 0.5 * FOOT_HEIGHT * patient.height * up
        self._append(ankle, mass, heel + from_heel, inertia)

    def _append_trunk(self, patient: Patient) -> None:
        mass = trunk_mass(patient)
        length = TRUNK_LENGTH * patient.height
        radius = TRUNK_RADIUS_OF_GYRATION * length
        along = np.outer(self._up(), self._up())
        inertia = mass * radius * radius * (np.eye(3) - 0.9 * along)
        self._append(self._joint_id(PELVIS_JOINT), mass, TRUNK_CENTRE_OF_MASS * length * self._up(), inertia)

    def _append(self, joint: int, mass: float, lever: np.ndarray, inertia: np.ndarray) -> None:
        self.model.appendBodyToJoint(joint, pin.Inertia(mass, lever, inertia), pin.SE3.Identity())

    def _up(self) -> np.ndarray:
        return np.array([0.0, 0.0, 1.0]) if self.up_axis == "z" else np.array([0.0, 1.0, 0.0])

    def _set_armature(self, armature: Mapping[JointName, float]) -> None:
        values = np.zeros(self.model.nv)
        for leg in self.legs.values():
            for joint, name in leg.items():
                values[self.model.joints[self._joint_id(name)].idx_v] = armature.get(joint, 0.0)
        self.model.armature = values

    # ------------------------------------------------------------------ indices

    @property
    def nv(self) -> int:
        """Number of coordinates (and velocities)."""
        return int(self.model.nv)

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs of the model, in the order of the log."""
        return tuple(self.legs)

    def index(self, side: Side, joint: JointName) -> int:
        """Position of a joint in ``q``, ``v`` and ``tau``.

        Args:
            side: Which leg.
            joint: Which joint.

        Returns:
            Index.

        Raises:
            ModelError: If the leg has no such joint.
        """
        if side not in self.legs:
            raise ModelError(f"{self.urdf_path}: the model has no {side} leg; it has {', '.join(self.legs)}")
        for name, urdf_name in self.legs[side].items():
            if name is joint:
                return int(self.model.joints[self._joint_id(urdf_name)].idx_v)
        raise ModelError(f"{self.urdf_path}: the {side} leg has no {joint}")

    @property
    def pelvis_index(self) -> int | None:
        """Position of the vertical pelvis coordinate, or None if the pelvis is fixed."""
        if self.pelvis is PelvisGuide.FIXED:
            return None
        return int(self.model.joints[self._joint_id(PELVIS_JOINT)].idx_v)

    def position_limits(self, side: Side, joint: JointName) -> tuple[float, float]:
        """Lower and upper limit of a joint from the URDF in [rad]."""
        index = self.index(side, joint)
        return float(self.model.lowerPositionLimit[index]), float(self.model.upperPositionLimit[index])

    @property
    def total_mass(self) -> float:
        """Mass of all links, wearer included, in [kg]."""
        return float(sum(body.mass for body in self.model.inertias))

    # ------------------------------------------------------------------ physics

    def gravity_torque(self, q: np.ndarray) -> np.ndarray:
        """Torques that hold the posture against gravity, in [N m] ([N] at the pelvis).

        Args:
            q: Joint angles, shape ``(nv,)``.

        Returns:
            :math:`g(q)`, shape ``(nv,)``; add it to compensate gravity.
        """
        return np.array(pin.computeGeneralizedGravity(self.model, self.data, q))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Joint-space inertia with armature, in [kg m²].

        Args:
            q: Joint angles, shape ``(nv,)``.

        Returns:
            :math:`M(q)`, shape ``(nv, nv)``, symmetric.
        """
        return np.array(pin.crba(self.model, self.data, q))

    def inertia_torque(self, q: np.ndarray, a: np.ndarray) -> np.ndarray:
        r"""Torques that accelerate the joints: :math:`M(q)\,\ddot q`, armature included.

        Args:
            q: Joint angles, shape ``(nv,)``.
            a: Joint accelerations in [rad] / [s²], shape ``(nv,)``.

        Returns:
            Torques in [N m], shape ``(nv,)``.
        """
        return np.asarray(self.mass_matrix(q) @ a)

    def effective_inertia(self, q: np.ndarray, index: int) -> float:
        """Effective inertia :math:`M_{jj}` of one joint, all others held, in [kg m²]."""
        return float(self.mass_matrix(q)[index, index])

    def nonlinear_effects(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        r"""Coriolis, centrifugal and gravity torques :math:`h(q, \dot q)` in [N m].

        Args:
            q: Joint angles, shape ``(nv,)``.
            v: Joint velocities in [rad] / [s], shape ``(nv,)``.

        Returns:
            Shape ``(nv,)``.
        """
        return np.array(pin.nonLinearEffects(self.model, self.data, q, v))

    def inverse_dynamics(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Torques that give an acceleration, armature included (recursive Newton-Euler).

        Args:
            q: Joint angles, shape ``(nv,)``.
            v: Joint velocities, shape ``(nv,)``.
            a: Joint accelerations, shape ``(nv,)``.

        Returns:
            Torques in [N m], shape ``(nv,)``.
        """
        return np.array(pin.rnea(self.model, self.data, q, v, a))

    def forward_dynamics(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Joint accelerations under torques (articulated-body algorithm).

        Args:
            q: Joint angles, shape ``(nv,)``.
            v: Joint velocities, shape ``(nv,)``.
            tau: Joint torques in [N m], shape ``(nv,)``.

        Returns:
            Accelerations in [rad] / [s²], shape ``(nv,)``.
        """
        return np.asarray(pin.aba(self.model, self.data, q, v, tau))

    def kinetic_energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Kinetic energy with that of the rotors, in [J]."""
        return float(0.5 * v @ self.mass_matrix(q) @ v)

    def potential_energy(self, q: np.ndarray) -> float:
        """Potential energy in the field of gravity, in [J]."""
        return float(pin.computePotentialEnergy(self.model, self.data, q))

    def frame_position(self, q: np.ndarray, frame: str) -> np.ndarray:
        """Position of a frame in the world in [m].

        Args:
            q: Joint angles, shape ``(nv,)``.
            frame: Name of a frame of the URDF.

        Returns:
            Shape ``(3,)``.

        Raises:
            ModelError: If there is no such frame.
        """
        if not self.model.existFrame(frame):
            known = ", ".join(item.name for item in self.model.frames)
            raise ModelError(f"{self.urdf_path}: no frame {frame!r}; it has {known}")
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.model.getFrameId(frame)].translation)
