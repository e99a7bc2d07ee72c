"""The leg and its world as YAML: URDF and joint names, treadmill, bench leg."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from twin_gait.configuration.validation import DEGREE, Number, Strict, one_of
from twin_gait.exceptions import ParameterError
from twin_gait.leg_model import LegJoints
from twin_gait.leg_model.urdf import find_urdf
from twin_gait.parameters import BeltProfile, ContactParameters, SupportParameters
from twin_gait.scenario import BenchLegScenario, HandParameters, LegSource, TreadmillScenario
from twin_gait.vocabulary import JointName, Side


class LegJointsEntry(Strict):
    """Joint and frame names of one leg."""

    hip: str
    knee: str
    ankle: str | None = None
    contact_frames: tuple[str, ...] = ()

    def convert(self) -> LegJoints:
        """Convert."""
        return LegJoints(hip=self.hip, knee=self.knee, ankle=self.ankle, contact_frames=self.contact_frames)


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


class ContactEntry(Strict):
    """Foot contact."""

    stiffness_N_per_m1p5: Number = ContactParameters.stiffness
    dissipation_s_per_m: Number = ContactParameters.dissipation
    friction_coefficient: Number = ContactParameters.friction_coefficient
    transition_velocity_m_per_s: Number = ContactParameters.transition_velocity

    def convert(self) -> ContactParameters:
        """Convert."""
        return ContactParameters(
            stiffness=self.stiffness_N_per_m1p5,
            dissipation=self.dissipation_s_per_m,
            friction_coefficient=self.friction_coefficient,
            transition_velocity=self.transition_velocity_m_per_s,
        )


class SupportEntry(Strict):
    """Body-weight support."""

    share: Number = SupportParameters.share
    damping_Ns_per_m: Number = SupportParameters.damping
    catch_stiffness_N_per_m: Number = SupportParameters.catch_stiffness
    catch_dissipation_s_per_m: Number = SupportParameters.catch_dissipation

    def convert(self) -> SupportParameters:
        """Convert."""
        return SupportParameters(
            share=self.share,
            damping=self.damping_Ns_per_m,
            catch_stiffness=self.catch_stiffness_N_per_m,
            catch_dissipation=self.catch_dissipation_s_per_m,
        )


class BeltEntry(Strict):
    """A belt that starts and stops."""

    start_s: Number
    stop_s: Number | None = None
    ramp_s: Number
    delay_s: Number = BeltProfile.delay

    def convert(self) -> BeltProfile:
        """Convert."""
        stop = math.inf if self.stop_s is None else self.stop_s
        return BeltProfile(start=self.start_s, stop=stop, ramp=self.ramp_s, delay=self.delay_s)


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


class TreadmillEntry(Strict):
    """The treadmill."""

    kind: Literal["treadmill"]
    belt_speed_m_per_s: Number | None = None
    belt_speed_km_per_h: Number | None = None
    belt: BeltEntry | None = None
    stop_ramp_s: Number | None = TreadmillScenario.stop_ramp
    support: SupportEntry = SupportEntry()
    contact: ContactEntry = ContactEntry()
    leading: Side = Side.LEFT
    leading_start: AnglesEntry | None = None
    trailing_start: AnglesEntry | None = None
    leading_phase: str = "early_stance"
    trailing_phase: str = "late_stance"

    def convert(self) -> TreadmillScenario:
        """Convert to SI."""
        standard = TreadmillScenario()
        leading, trailing = self.leading_start, self.trailing_start
        return TreadmillScenario(
            belt_speed=one_of(self, {"belt_speed_m_per_s": 1.0, "belt_speed_km_per_h": 1.0 / 3.6}),
            belt=None if self.belt is None else self.belt.convert(),
            stop_ramp=math.inf if self.stop_ramp_s is None else self.stop_ramp_s,
            support=self.support.convert(),
            contact=self.contact.convert(),
            leading=self.leading,
            leading_angles=standard.leading_angles if leading is None else leading.convert(),
            trailing_angles=standard.trailing_angles if trailing is None else trailing.convert(),
            initial_phases=(self.leading_phase, self.trailing_phase),
        )


class HandEntry(Strict):
    """A hand on the bench leg."""

    joint: JointName = JointName.KNEE
    amplitude_deg: Number | None = None
    amplitude_rad: Number | None = None
    frequency_Hz: Number = HandParameters.frequency
    stiffness_Nm_per_rad: Number = HandParameters.stiffness
    damping_Nms_per_rad: Number = HandParameters.damping
    release_s: Number | None = None

    def convert(self) -> HandParameters:
        """Convert to SI."""
        return HandParameters(
            joint=self.joint,
            amplitude=one_of(self, {"amplitude_deg": DEGREE, "amplitude_rad": 1.0}),
            frequency=self.frequency_Hz,
            stiffness=self.stiffness_Nm_per_rad,
            damping=self.damping_Nms_per_rad,
            release_time=math.inf if self.release_s is None else self.release_s,
        )


class BenchLegEntry(Strict):
    """The bench leg."""

    kind: Literal["bench_leg"]
    start: AnglesEntry | None = None
    start_phase: str | None = None
    hand: HandEntry | None = None

    def convert(self) -> BenchLegScenario:
        """Convert to SI."""
        return BenchLegScenario(
            start_angles=BenchLegScenario.start_angles if self.start is None else self.start.convert(),
            initial_phase=self.start_phase,
            hand=None if self.hand is None else self.hand.convert(),
        )
