"""Assembly of a rigid-body model from a URDF: choose the legs, fit the device, add the wearer."""

import copy
import math
import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ModelError
from twin_gait.leg_model import anthropometry
from twin_gait.leg_model.attachments import AddedMass, Attachment, BodySegment, segments_of
from twin_gait.leg_model.joints import ALL_GUIDES, FORWARD, GUIDES, LegJoints, reversed_joints
from twin_gait.leg_model.plausibility import check_couplings, check_segments
from twin_gait.leg_model.urdf import build_model
from twin_gait.leg_model.urdf_document import urdf_text
from twin_gait.parameters.wearer import SHANK_LENGTH, Patient
from twin_gait.vocabulary import JointName, PelvisGuide, Side

# Joints of robots turn by up to ten radians, or by thousands where they have no stops. A limit between two
# turns in [rad] and two turns in degrees means that degrees were taken for radians.
LARGEST_LIMIT = 4.0 * math.pi  # [rad]


# Arguments of :class:`Assembly`, with the text of the file, so that an edited file is read again.
Source = tuple[Path, str, tuple[tuple[Side, LegJoints], ...], PelvisGuide, str]


class Fitting(NamedTuple):
    """All that turns the device of a URDF into a model of device and wearer."""

    sizes: anthropometry.DeviceSizes | None  # Sizes of the device; None leaves the URDF as it is.
    patient: Patient | None  # Wearer whose segments are added; None adds nothing.
    carrier: Patient | None  # Wearer on whose segments the attached masses are; None adds none.
    wearer_only: bool  # Whether the links of the device have no mass.
    gravity: float  # Magnitude in [m/s²].
    armature: tuple[tuple[JointName, float], ...]  # Inertia of rotor and gear per joint in [kg·m²].
    driven_sides: tuple[Side, ...]  # Legs with rotors.
    attachment: Attachment  # Parts of the device on the wearer's segments, and missing segments.


def complete_assembly(
    path: Path, legs: Mapping[Side, LegJoints], pelvis: PelvisGuide, up_axis: str, fitting: Fitting
) -> "Assembly":
    """Return the device of a URDF with a fitting; equal arguments share one assembly, which nobody changes.

    The other arguments and the errors are those of :class:`Assembly`.
    """
    assembly = _complete((path, urdf_text(path), tuple(legs.items()), pelvis, up_axis), fitting)
    for warning in assembly.warnings:
        warnings.warn(warning, stacklevel=3)
    return assembly


@lru_cache(maxsize=16)  # the episodes of a batch often have one wearer
def _complete(source: Source, fitting: Fitting) -> "Assembly":
    sizes, worn = fitting.sizes, fitting.patient
    assembly = (_device(source) if sizes is None else _fitted(source, sizes)).copy()
    if worn is not None:
        assembly.add_wearer(worn, fitting.attachment.replaced, wearer_only=fitting.wearer_only)
    if fitting.carrier is not None:
        assembly.add_masses(fitting.carrier, fitting.attachment.masses)
    assembly.set_gravity_and_armature(fitting.gravity, dict(fitting.armature), fitting.driven_sides)
    return assembly


@lru_cache(maxsize=16)  # a batch builds thousands of models of one device
def _device(source: Source) -> "Assembly":
    path, _, legs, pelvis, up_axis = source
    return Assembly(path, dict(legs), pelvis, up_axis)


@lru_cache(maxsize=16)
def _fitted(source: Source, sizes: anthropometry.DeviceSizes) -> "Assembly":
    device = _device(source).copy()
    device.fit(sizes)
    return device


class Assembly:
    """Rigid-body model under construction.

    Attributes:
        model: The Pinocchio model in its current state.
        legs: Joint names of each leg in the URDF, without signs.
        warnings: Warnings about the file, which are issued for each copy.
    """

    def __init__(self, path: Path, legs: Mapping[Side, LegJoints], pelvis: PelvisGuide, up_axis: str) -> None:
        """Read a URDF and lock the joints that do not belong to ``legs``.

        ``legs``: joint names of each leg; a minus in front reverses a joint. ``pelvis``: guide of the pelvis.
        ``up_axis``: ``"z"`` or ``"y"``. Raises ModelError if the URDF cannot be read or lacks a joint or
        frame.
        """
        self._path, self._pelvis = path, pelvis
        self._up = np.array([0.0, 0.0, 1.0] if up_axis == "z" else [0.0, 1.0, 0.0])
        (self._lateral,) = np.flatnonzero(np.cross(self._up, FORWARD)).tolist()
        self._frames: dict[int, list[int]] = {}  # cache of the frames of a joint
        model = self._read()
        self.legs = {side: leg.plain for side, leg in legs.items()}
        self._check_names(model)
        self.model = self._lock_other_joints(model)
        for leg in self.legs.values():
            for _, name in leg.items():
                self._check_joint(name, first=name == leg.hip)
        check_segments(path, self.model, self.legs)
        couplings = check_couplings(path, self.legs)
        turned, doubts = reversed_joints(path, self.model, legs, self._up)
        self.warnings = [*couplings, *doubts]
        if turned:
            self.model = self._lock_other_joints(self._read(turned))

    def copy(self) -> "Assembly":
        """Return an assembly with a model of its own."""
        found = copy.copy(self)
        found.model = self.model.copy()
        return found

    def fit(self, sizes: anthropometry.DeviceSizes) -> None:
        """Set femur, tibia, waist and foot: positions of joints and soles, and the device's own inertia.

        The mass of a link stays; its centre of mass along the tube moves with the length and its
        transverse inertia with the square of it. All frames of a foot, heel and toe among them, move away
        from the ankle in the same proportion. Then the points of the sole move along the line from the heel,
        if their distance is a part of the sizes.
        """
        lateral = self._lateral
        for leg in self.legs.values():
            hip, knee = self._id(leg.hip), self._id(leg.knee)
            placement = self.model.jointPlacements[hip]
            side_offset = placement.translation.copy()
            if side_offset[lateral] != 0.0:
                side_offset[lateral] = np.copysign(sizes.waist / 2.0, side_offset[lateral])
                placement.translation = side_offset
            self._stretch(hip, knee, sizes.femur)
            if leg.ankle is not None:
                ankle, ratio = self._id(leg.ankle), sizes.foot / anthropometry.DRAWN_FOOT
                self._stretch(knee, ankle, sizes.tibia)
                self._grow(ankle, ratio)
                for index in self._frames_of(ankle):
                    placement = self.model.frames[index].placement
                    placement.translation = placement.translation * ratio
                if sizes.heel_to_forefoot is not None and len(leg.contact_frames) > 1:
                    self._spread(leg.contact_frames, sizes.heel_to_forefoot)

    def _spread(self, names: Sequence[str], distance: float) -> None:
        """Set the distance in [m] from the first to the last frame of a body; the first one stays."""
        heel, *others = (self.model.frames[self.model.getFrameId(name)].placement for name in names)
        start = heel.translation.copy()
        ratio = distance / float(np.linalg.norm(others[-1].translation - start))
        for placement in others:
            placement.translation = start + (placement.translation - start) * ratio

    def add_wearer(
        self, patient: Patient, replaced: Mapping[BodySegment, float], *, wearer_only: bool = False
    ) -> None:
        """Add the segments of a wearer to the links, and the trunk to a pelvis that moves.

        ``replaced``: share of the mass of a segment that is missing; 0 for a segment without an entry.
        ``wearer_only``: keep the joints in place, but remove the mass of the links of the device.
        """
        for joint in range(self.model.njoints) if wearer_only else ():
            self.model.inertias[joint] = pin.Inertia.Zero()
        segments = anthropometry.wearer_segments(patient)
        for side, leg in self.legs.items():
            left = [1.0 - replaced.get(name, 0.0) for name in segments_of(side)]
            hip, knee = self._id(leg.hip), self._id(leg.knee)
            thigh = self.model.jointPlacements[knee].translation.copy()
            if leg.ankle is None:
                shank = SHANK_LENGTH * patient.height * (thigh / np.linalg.norm(thigh))
            else:
                shank = self.model.jointPlacements[self._id(leg.ankle)].translation.copy()
                self._append_foot(self._id(leg.ankle), patient, left[2])
            self._append(
                hip, *anthropometry.segment_inertia(segments["thigh"], left[0] * patient.mass, thigh)
            )
            self._append(
                knee, *anthropometry.segment_inertia(segments["shank"], left[1] * patient.mass, shank)
            )
        if self._pelvis is not PelvisGuide.FIXED:
            self._append_trunk(patient)

    def add_masses(self, patient: Patient, masses: Mapping[BodySegment, AddedMass]) -> None:
        """Add masses of the device to the segments of a wearer.

        Raises ModelError if the leg of a segment or its distal joint is missing.
        """
        for segment, added in masses.items():
            joint, start, axis = self._segment_line(patient, segment)
            inertia = added.mass * added.radius_of_gyration**2 * np.eye(3)
            if joint is not None:
                self._append(joint, added.mass, start + added.along * axis + added.forward * FORWARD, inertia)

    def _segment_line(
        self, patient: Patient, segment: BodySegment
    ) -> tuple[int | None, np.ndarray, np.ndarray]:
        """Return the joint that carries a segment, and the start and the direction of its line in [m].

        The joint of a pelvis that is fixed is None.
        """
        if segment is BodySegment.PELVIS:
            guides = GUIDES[self._pelvis]
            trunk = anthropometry.TRUNK_LENGTH * patient.height * self._up
            return (self._id(guides[-1]) if guides else None), np.zeros(3), trunk
        side = next(item for item in Side if segment in segments_of(item))
        leg, number = self.legs.get(side), segments_of(side).index(segment)
        names = () if leg is None else (leg.hip, leg.knee, leg.ankle)
        ends = names[number : number + 2]
        if len(names) == 0 or None in ends:
            raise ModelError(f"{self._path}: leg.attachment.masses.{segment}: the legs have no such segment")
        joint = self._id(str(ends[0]))
        if len(ends) == 1:
            start, axis = self._foot_line(patient)
            return joint, start, axis
        return joint, np.zeros(3), self.model.jointPlacements[self._id(str(ends[1]))].translation.copy()

    def set_gravity_and_armature(
        self, gravity: float, armature: Mapping[JointName, float], driven_sides: Sequence[Side]
    ) -> None:
        """Set gravity in [m/s²], downwards, and the inertia of rotors and gears.

        ``armature``: inertia per joint name in [kg·m²], of the legs in ``driven_sides``; 0 if absent.
        """
        values = np.zeros(self.model.nv)
        for side in driven_sides:
            for joint, name in self.legs[side].items():
                values[self.model.joints[self._id(name)].idx_v] = armature.get(joint, 0.0)
        self.model.armature, self.model.gravity.linear = values, -gravity * self._up

    def _read(self, turned: frozenset[str] = frozenset()) -> pin.Model:
        upward = pin.JointModelPZ() if self._up[2] else pin.JointModelPY()
        leaning = pin.JointModelRevoluteUnaligned(np.cross(self._up, FORWARD))
        joints = dict(zip(ALL_GUIDES, (pin.JointModelPX(), upward, leaning), strict=True))
        return build_model(self._path, [(joints[name], name) for name in GUIDES[self._pelvis]], turned)

    def _check_names(self, model: pin.Model) -> None:
        """Check that every part exists, is used once, and is connected to the previous one of its leg."""
        known = {
            "joint": [name for name in model.names if name not in ("universe", *GUIDES[self._pelvis])],
            "frame": sorted(frame.name for frame in model.frames),
        }
        taken: dict[tuple[str, str], str] = {}
        for side, leg in self.legs.items():
            above = ""
            parts = [("joint", name, f"{side} {joint}") for joint, name in leg.items()]
            parts += [("frame", name, f"{side} foot") for name in leg.contact_frames]
            for kind, name, part in parts:
                if name not in known[kind]:
                    has = ", ".join(known[kind]) or f"no {kind}s"
                    problem = f"there is no {kind} {name!r} for the {part}; the file has {has}"
                    raise ModelError(f"{self._path}: {problem}")
                if (kind, name) in taken:
                    both = f"both {taken[kind, name]} and {part}"
                    raise ModelError(f"{self._path}: {kind} {name!r} is {both}")
                frame = model.frames[model.getFrameId(name)] if kind == "frame" else None
                joint_id = model.getJointId(name) if frame is None else frame.parentJoint
                on = [model.names[index] for index in model.supports[joint_id]][1:]
                if above and above not in on:
                    has = ", ".join(on) or "no joint"
                    raise ModelError(
                        f"{self._path}: {kind} {name!r} of the {part} is not below {above!r}; the joints "
                        f"above it are {has}"
                    )
                taken[kind, name], above = part, name if kind == "joint" else above

    def _lock_other_joints(self, model: pin.Model) -> pin.Model:
        kept = {name for leg in self.legs.values() for _, name in leg.items()}
        kept |= {*ALL_GUIDES, "universe"}
        locked = [model.getJointId(name) for name in model.names if name not in kept]
        return pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model

    def _check_joint(self, name: str, *, first: bool) -> None:
        """Check that a joint is revolute, apart from the joint above it (if any), and limited in radians."""
        joint = self.model.joints[self._id(name)]
        kind = joint.shortname().removeprefix("JointModel")
        limits = self.model.lowerPositionLimit, self.model.upperPositionLimit
        low, high = (float(limit[joint.idx_q]) for limit in limits)
        if joint.nv != 1 or not kind.startswith("R"):
            problem = f"is {kind} with {joint.nv} degrees of freedom; expected a revolute one"
        elif not np.any(joint.createData().S):
            problem = "has an axis of zeros; expected a direction"
        elif not first and not self.model.jointPlacements[self._id(name)].translation.any():
            problem = "and the one above it coincide; expected a segment between them"
        elif not low < high:
            problem = f"can turn from {low:g} to {high:g} rad; expected lower below upper in its <limit>"
        elif LARGEST_LIMIT < max(-low, high) <= math.degrees(LARGEST_LIMIT):
            problem = (
                f"can turn by {max(-low, high):g} rad; expected radians in its <limit>, and the type "
                "continuous for a joint without stops"
            )
        else:
            return
        raise ModelError(f"{self._path}: joint {name!r} {problem}")

    def _stretch(self, proximal: int, distal: int, length: float) -> None:
        placement = self.model.jointPlacements[distal]
        ratio = length / float(np.linalg.norm(placement.translation))
        placement.translation = placement.translation * ratio
        self._grow(proximal, ratio)

    def _frames_of(self, joint: int) -> list[int]:
        """Return the indices of the frames of a joint, which are the same in every copy."""
        if joint not in self._frames:
            parents = [frame.parentJoint for frame in self.model.frames]
            self._frames[joint] = [index for index, parent in enumerate(parents) if parent == joint]
        return self._frames[joint]

    def _grow(self, joint: int, ratio: float) -> None:
        body = self.model.inertias[joint]
        self.model.inertias[joint] = pin.Inertia(
            body.mass, body.lever * ratio, body.inertia * (ratio * ratio)
        )

    def _foot_line(self, patient: Patient) -> tuple[np.ndarray, np.ndarray]:
        """Return start and direction of the line on which a table measures the foot, in [m]."""
        forward_and_up = np.array([FORWARD, self._up])
        start, axis = (vector @ forward_and_up for vector in anthropometry.foot_line(patient))
        return start, axis

    def _append_foot(self, ankle: int, patient: Patient, left: float) -> None:
        """Add the share ``left`` of the mass of the wearer's foot."""
        start, axis = self._foot_line(patient)
        foot = anthropometry.wearer_segments(patient)["foot"]
        mass, from_start, inertia = anthropometry.segment_inertia(foot, left * patient.mass, axis)
        self._append(ankle, mass, start + from_start, inertia)

    def _append_trunk(self, patient: Patient) -> None:
        mass = anthropometry.trunk_mass(patient)
        length = anthropometry.TRUNK_LENGTH * patient.height
        radius = anthropometry.TRUNK_RADIUS_OF_GYRATION * length
        inertia = mass * radius * radius * (np.eye(3) - 0.9 * np.outer(self._up, self._up))
        centre = anthropometry.TRUNK_CENTRE_OF_MASS * length * self._up
        self._append(self._id(GUIDES[self._pelvis][-1]), mass, centre, inertia)

    def _append(self, joint: int, mass: float, lever: np.ndarray, inertia: np.ndarray) -> None:
        self.model.appendBodyToJoint(joint, pin.Inertia(mass, lever, inertia), pin.SE3.Identity())

    def _id(self, name: str) -> int:
        return int(self.model.getJointId(name))
