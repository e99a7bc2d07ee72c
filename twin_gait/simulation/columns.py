"""Columns of a log, in order: engines fill numbers, the run makes a table of them."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from twin_gait.leg_model import LegModel
from twin_gait.vocabulary import JointName, Side

LOG_SCHEMA_VERSION = 1

JOINT_COLUMNS = (
    "angle_rad",
    "velocity_rad_per_s",
    "measured_angle_rad",
    "velocity_fast_rad_per_s",
    "velocity_slow_rad_per_s",
    "impedance_torque_Nm",
    "friction_compensation_torque_Nm",
    "gravity_compensation_torque_Nm",
    "inertia_compensation_torque_Nm",
    "target_torque_Nm",
    "motor_command_torque_Nm",
    "motor_torque_Nm",
    "friction_torque_Nm",
    "stop_torque_Nm",
    "patient_torque_Nm",
    "target_current_A",
    "measured_current_A",
    "stiffness_Nm_per_rad",
    "damping_Nms_per_rad",
    "equilibrium_rad",
    "friction_compensation_gain",
)
ANKLE_COLUMNS = ("angle_rad", "velocity_rad_per_s", "orthosis_torque_Nm")
FOOT_COLUMNS = ("normal_force_N", "friction_force_N", "clearance_m")
PELVIS_COLUMNS = (
    "pelvis_height_m",
    "pelvis_velocity_m_per_s",
    "support_force_N",
    "guide_force_N",
    "guide_moment_Nm",
)
POWER_COLUMNS = ("bus_voltage_V", "battery_power_W")
# Work done on the leg since the start, by source; kinetic plus potential energy changes by their sum.
WORK_SOURCES = ("motor", "friction", "stop", "spring", "contact", "patient")
# One more where braces bind the wearer to the device.
BRACED_WORK_SOURCES = (*WORK_SOURCES, "brace")
# Where there are braces, of every joint: the wearer's motion, and the torque of the device on them.
BRACE_COLUMNS = ("wearer_angle_rad", "wearer_velocity_rad_per_s", "brace_torque_Nm")
PELVIS_BRACE_COLUMNS = ("wearer_pelvis_height_m", "wearer_pelvis_velocity_m_per_s", "pelvis_brace_force_N")
# Of the monitor: 0 watching, 1 hold; the code of :class:`twin_gait.control.TripCause`, 0 without a trip.
SAFETY_COLUMNS = ("safety_state", "trip_cause")
ENERGY_COLUMNS = ("kinetic_energy_J", "potential_energy_J")

_UNITS = {
    "_rad": "rad",
    "_rad_per_s": "rad/s",
    "_Nm": "N m",
    "_A": "A",
    "_Nm_per_rad": "N m/rad",
    "_Nms_per_rad": "N m s/rad",
    "_N": "N",
    "_m": "m",
    "_m_per_s": "m/s",
    "_s": "s",
    "_V": "V",
    "_W": "W",
    "_J": "J",
    "_phase": "name",
    "_gain": "1",
    "_state": "code",
    "_cause": "code",
}


def work_sources(columns: Container[str]) -> tuple[str, ...]:
    """Sources of work that a log has columns for.

    Returns:
        Their names; the braces are one of them if there are any.
    """
    return BRACED_WORK_SOURCES if f"{BRACED_WORK_SOURCES[-1]}_work_J" in columns else WORK_SOURCES


def state_columns(model: LegModel, *, wearer: bool = False) -> tuple[list[str], list[str]]:
    """Columns that hold the state of a model.

    Args:
        wearer: Whether the state is the wearer's own, where braces bind them to the device.

    Returns:
        Columns of its coordinates and of its velocities, in the order of the model.
    """
    own = "wearer_" * wearer
    names = {
        model.index(side, joint): (
            f"{side}_{joint}_{own}angle_rad",
            f"{side}_{joint}_{own}velocity_rad_per_s",
        )
        for side, leg in model.legs.items()
        for joint, _ in leg.items()
    }
    if model.pelvis_index is not None:
        names[model.pelvis_index] = (f"{own}pelvis_height_m", f"{own}pelvis_velocity_m_per_s")
    return [names[index][0] for index in range(model.nv)], [names[index][1] for index in range(model.nv)]


def unit_of(column: str) -> str:
    """Unit of a log column, from the suffix of its name.

    Returns:
        The unit, for example ``N m/rad``.
    """
    suffix = max((item for item in _UNITS if column.endswith(item)), key=len, default="")
    return _UNITS.get(suffix, "1")


@dataclass(frozen=True)
class LogLayout:
    """Names and positions of the numeric columns of a log.

    The first columns are the phase indices of the legs; ``time_s`` and the phase names are added
    when the table is made.

    Attributes:
        legs: Actuated joints per leg, in order.
        ankles: Legs with an ankle.
        feet: Legs with foot contact.
        pelvis: Whether the pelvis moves.
        braced: Whether braces bind the wearer to the device.
    """

    legs: Mapping[Side, Sequence[JointName]]
    ankles: tuple[Side, ...]
    feet: tuple[Side, ...]
    pelvis: bool
    braced: bool = False

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the numeric columns."""
        names = [f"{side}_phase" for side in self.legs]
        for side, joints in self.legs.items():
            for joint in joints:
                names += [f"{side}_{joint}_{column}" for column in JOINT_COLUMNS]
        for side in self.ankles:
            names += [f"{side}_{JointName.ANKLE}_{column}" for column in ANKLE_COLUMNS]
        for side in self.feet:
            names += [f"{side}_foot_{column}" for column in FOOT_COLUMNS]
        if self.pelvis:
            names += PELVIS_COLUMNS
        works = [f"{source}_work_J" for source in self.work_sources]
        return (*names, *POWER_COLUMNS, *ENERGY_COLUMNS, *works, *SAFETY_COLUMNS, *self._brace_names())

    @property
    def work_sources(self) -> tuple[str, ...]:
        """Sources of work on the leg."""
        return BRACED_WORK_SOURCES if self.braced else WORK_SOURCES

    def _brace_names(self) -> list[str]:
        if not self.braced:
            return []
        joints = [f"{side}_{joint}" for side, items in self.legs.items() for joint in items]
        joints += [f"{side}_{JointName.ANKLE}" for side in self.ankles]
        names = [f"{joint}_{column}" for joint in joints for column in BRACE_COLUMNS]
        return names + list(PELVIS_BRACE_COLUMNS) * self.pelvis

    @cached_property
    def positions(self) -> dict[str, int]:
        """Position of each column."""
        return {name: index for index, name in enumerate(self.names)}

    def first(self, name: str) -> int:
        """Position of a column, where a block of columns begins."""
        return self.positions[name]
