"""The leg and its world as YAML: URDF and joint names, and the section of each kind of world."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from twin_gait.configuration.sections import Endless, Section
from twin_gait.configuration.validation import DEGREE, Number, Strict, one_of
from twin_gait.exceptions import ParameterError
from twin_gait.leg_model import LegJoints
from twin_gait.leg_model.urdf import find_urdf
from twin_gait.parameters import BeltProfile, ContactParameters, SupportParameters
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds import BenchLeg, ImposedMotionParameters, LegSource, Treadmill, world_kinds, world_of


class LegJointsEntry(Section):
    """Joint and frame names of one leg."""

    parameters: ClassVar = LegJoints
    hip: str
    knee: str
    ankle: str | None = None
    contact_frames: tuple[str, ...] = ()


class LegEntry(Strict):
    """URDF and joint names."""

    urdf: str = "twin.urdf"
    left: LegJointsEntry | None = None
    right: LegJointsEntry | None = None
    fit_device: bool = True
    up_axis: Literal["y", "z"] = "z"

    def convert(self, folder: Path) -> LegSource:
        """Convert; a relative path is taken from the folder of the file."""
        legs = {
            side: entry.convert()
            for side, entry in ((Side.LEFT, self.left), (Side.RIGHT, self.right))
            if entry is not None
        }
        if not legs:
            raise ParameterError("expected the joint names of left, right or both legs")
        beside = folder / self.urdf
        path = str(beside.resolve()) if beside.is_file() else self.urdf
        find_urdf(path)
        return LegSource(urdf=path, legs=legs, fit_device=self.fit_device, up_axis=self.up_axis)

    @staticmethod
    def document(source: LegSource) -> dict[str, Any]:
        """As the mapping of a file."""
        legs = {str(side): LegJointsEntry.document(leg) for side, leg in source.legs.items()}
        return {"urdf": source.urdf, **legs, "fit_device": source.fit_device, "up_axis": source.up_axis}


class ContactEntry(Section):
    """Foot contact."""

    parameters: ClassVar = ContactParameters
    stiffness_N_per_m1p5: Number = ContactParameters.stiffness
    dissipation_s_per_m: Number = ContactParameters.dissipation
    friction_coefficient: Number = ContactParameters.friction_coefficient
    transition_velocity_m_per_s: Number = ContactParameters.transition_velocity


class SupportEntry(Section):
    """Body-weight support."""

    parameters: ClassVar = SupportParameters
    share: Number = SupportParameters.share
    damping_Ns_per_m: Number = SupportParameters.damping
    guide: PelvisGuide = SupportParameters.guide
    forward_stiffness_N_per_m: Number = SupportParameters.forward_stiffness
    forward_damping_Ns_per_m: Number = SupportParameters.forward_damping
    catch_stiffness_N_per_m: Number = SupportParameters.catch_stiffness
    catch_dissipation_s_per_m: Number = SupportParameters.catch_dissipation


class BeltEntry(Section):
    """A belt that starts and stops."""

    parameters: ClassVar = BeltProfile
    start_s: Number
    stop_s: Endless = math.inf
    ramp_s: Number
    delay_s: Number = BeltProfile.delay


class AnglesEntry(Strict):
    """Hip and knee angle."""

    hip_deg: Number | None = None
    hip_rad: Number | None = None
    knee_deg: Number | None = None
    knee_rad: Number | None = None

    def convert(self) -> tuple[float, float]:
        """Convert to SI."""
        return (
            one_of(self, {"hip_deg": DEGREE, "hip_rad": 1.0}),
            one_of(self, {"knee_deg": DEGREE, "knee_rad": 1.0}),
        )

    @staticmethod
    def document(angles: tuple[float, float]) -> dict[str, float]:
        """As the mapping of a file, in SI."""
        return {"hip_rad": angles[0], "knee_rad": angles[1]}


class TreadmillEntry(Section):
    """The treadmill."""

    parameters: ClassVar = Treadmill
    renamed: ClassVar[Mapping[str, str | None]] = {
        "leading_start": "leading_angles",
        "trailing_start": "trailing_angles",
        "leading_phase": None,
    }
    kind: Literal["treadmill"]
    belt_speed_m_per_s: Number | None = None
    belt_speed_km_per_h: Number | None = None
    belt: BeltEntry | None = None
    stop_ramp_s: Endless = Treadmill.stop_ramp
    slope_deg: Number | None = None
    slope_rad: Number | None = None
    support: SupportEntry = SupportEntry()
    contact: ContactEntry = ContactEntry()
    leading: Side = Side.LEFT
    leading_start: AnglesEntry | None = None
    trailing_start: AnglesEntry | None = None
    leading_phase: str = "early_stance"
    trailing_phase: str = "late_stance"

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        return {**super().values(), "initial_phases": (self.leading_phase, self.trailing_phase)}

    @classmethod
    def document(cls, parameters: Treadmill) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        values = super().document(parameters)
        if parameters.belt is None:
            del values["belt"]
        leading, trailing = parameters.initial_phases
        return {"kind": "treadmill", **values, "leading_phase": leading, "trailing_phase": trailing}


class ImposedMotionEntry(Section):
    """An imposed motion of one joint of the bench leg, as by a hand that lets go in the end."""

    parameters: ClassVar = ImposedMotionParameters
    renamed: ClassVar[Mapping[str, str | None]] = {"release_s": "release_time"}
    joint: JointName = JointName.KNEE
    amplitude_deg: Number | None = None
    amplitude_rad: Number | None = None
    frequency_Hz: Number = ImposedMotionParameters.frequency
    stiffness_Nm_per_rad: Number = ImposedMotionParameters.stiffness
    damping_Nms_per_rad: Number = ImposedMotionParameters.damping
    release_s: Endless = math.inf


class BenchLegEntry(Section):
    """The bench leg."""

    parameters: ClassVar = BenchLeg
    renamed: ClassVar[Mapping[str, str | None]] = {"start": "start_angles", "start_phase": "initial_phase"}
    kind: Literal["bench_leg"]
    start: AnglesEntry | None = None
    start_phase: str | None = None
    imposed_motion: ImposedMotionEntry | None = None

    @classmethod
    def document(cls, parameters: BenchLeg) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        values = {"kind": "bench_leg", **super().document(parameters)}
        if parameters.imposed_motion is None:
            del values["imposed_motion"]
        return values


_SECTIONS: Mapping[str, type[Section]] = {"treadmill": TreadmillEntry, "bench_leg": BenchLegEntry}


def section_of_world(kind: Any) -> type[Section]:
    """Schema by which files have a kind of world.

    Raises:
        ParameterError: If there is no such world, or the package that brings it is broken.
    """
    if not isinstance(kind, str):
        raise ParameterError(f"expected a kind of world, one of {', '.join(world_kinds())}, got {kind!r}")
    return world_of(kind).section or _SECTIONS[kind]
