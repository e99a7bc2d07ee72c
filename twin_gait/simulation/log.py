"""The row of the log that every tick writes: each column's name, unit and meaning, once.

A column's name is that of its field with the unit behind it, and side and joint in front of it where it
belongs to one.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, is_dataclass
from functools import cached_property
from typing import Any

from twin_gait.leg_model import LegModel
from twin_gait.simulation.record import ABSENT, kinds_of
from twin_gait.vocabulary import JointName, Side

LOG_SCHEMA_VERSION = 1
# How a unit is written in a name.
SUFFIXES = {
    "rad": "rad",
    "rad/s": "rad_per_s",
    "rad/s²": "rad_per_s2",
    "N m": "Nm",
    "A": "A",
    "N m/rad": "Nm_per_rad",
    "N m s/rad": "Nms_per_rad",
    "N": "N",
    "m": "m",
    "m/s": "m_per_s",
    "s": "s",
    "V": "V",
    "W": "W",
    "J": "J",
}


def column(unit: str, meaning: str) -> Any:
    """A field of the log; ``1`` and ``code`` are units that a name does not show."""
    return field(default=0.0, metadata={"unit": unit, "meaning": meaning})


@dataclass(slots=True)
class JointRow:
    """Columns of a controlled joint; torques act on the joint, positive in flexion."""

    angle: float = column("rad", "true angle; of the device, if braces bind the wearer to it")
    velocity: float = column("rad/s", "true velocity")
    measured_angle: float = column("rad", "encoder angle")
    velocity_fast: float = column("rad/s", "first-order estimate, for damper and guards")
    velocity_slow: float = column("rad/s", "decimated and averaged estimate, for the friction compensation")
    impedance_torque: float = column("N m", "of virtual spring and damper; in the hold, of the brake")
    friction_compensation_torque: float = column("N m", "G times the friction of the model")
    gravity_compensation_torque: float = column(
        "N m", "share of the gravity torque that the controller gives"
    )
    inertia_compensation_torque: float = column("N m", "share of the inertia torque that it gives")
    target_torque: float = column("N m", "added to the command")
    motor_command_torque: float = column("N m", "sum of the five, before limits")
    motor_torque: float = column("N m", "of the motor times the gear ratio, before the losses of the gear")
    friction_torque: float = column(
        "N m", "of motor and gear on the joint, with what the gear loses under load"
    )
    stop_torque: float = column("N m", "of the mechanical stops")
    patient_torque: float = column("N m", "of the wearer, a push or an imposed motion")
    target_current: float = column("A", "that the drive is asked for")
    measured_current: float = column("A", "that flows")
    stiffness: float = column("N m/rad", "k of the impedance, blended")
    damping: float = column("N m s/rad", "b of the impedance, blended")
    equilibrium: float = column("rad", "θ0 of the impedance, blended")
    friction_compensation_gain: float = column("1", "G of the friction compensation, blended")


@dataclass(slots=True)
class OrthosisRow:
    """One more column of an ankle that is controlled."""

    orthosis_torque: float = column("N m", "of the orthosis on the ankle")


@dataclass(slots=True)
class PassiveRow:
    """Columns of a joint that is not controlled."""

    angle: float = column("rad", "true angle; of the device, if braces bind the wearer to it")
    velocity: float = column("rad/s", "true velocity")
    orthosis_torque: float = column("N m", "of the orthosis on the ankle")


@dataclass(slots=True)
class FootRow:
    """Columns of a foot on the ground."""

    normal_force: float = column("N", "of the ground, at right angles to it")
    friction_force: float = column("N", "of the ground, along it, forwards positive")
    clearance: float = column("m", "height of the lowest point of the sole over the ground")
    pressure_place: float = column(
        "1", "centre of pressure: 0 at the first point of the sole, 1 at the last; 0 in the air"
    )


@dataclass(slots=True)
class PelvisRow:
    """Columns of the pelvis."""

    pelvis_height: float = column("m", "above the belt")
    pelvis_velocity: float = column("m/s", "upwards")
    support_force: float = column("N", "of body-weight support and harness, upwards")
    guide_force: float = column("N", "forward force of the guide; of harness, arms, seat on a free pelvis")
    guide_moment: float = column("N m", "pitching moment of the guide; of harness, arms, seat")


@dataclass(slots=True)
class ForwardRow:
    """Columns of a pelvis that moves fore-aft."""

    pelvis_forward: float = column("m", "in front of where the harness lets it rest")
    pelvis_forward_velocity: float = column("m/s", "of it")


@dataclass(slots=True)
class TrunkRow:
    """Columns of a trunk that is free."""

    trunk_pitch: float = column("rad", "of pelvis and trunk from upright, forwards positive")
    trunk_pitch_velocity: float = column("rad/s", "of it")
    measured_trunk_pitch: float = column("rad", "as the gait controller has it")


@dataclass(slots=True)
class CrutchRow:
    """Columns of an arm and its crutch."""

    crutch_forward: float = column("m", "place of the tip")
    crutch_height: float = column("m", "of the tip over the ground")
    crutch_normal_force: float = column("N", "of the ground on the tip, upwards")
    crutch_friction_force: float = column("N", "of the ground on the tip, forwards positive")
    arm_push: float = column("N", "of the arm along the line from shoulder to tip, away from the shoulder")
    shoulder_moment: float = column("N m", "of the shoulder, which turns the crutch forwards")
    arm_power: float = column("W", "that the arm gives to trunk and crutch")


@dataclass(slots=True)
class SeatRow:
    """Columns of a seat."""

    seat_force: float = column("N", "of the seat on buttocks and thighs, upwards")
    seat_friction_force: float = column("N", "of the seat on them, forwards positive")
    seat_forward: float = column("m", "place of its front edge")


@dataclass(slots=True)
class WorkRow:
    """Columns of the work done on the leg since the start, by source."""

    motor_work: float = column("J", "of the motors")
    friction_work: float = column("J", "of friction in motors and gears")
    stop_work: float = column("J", "of the mechanical stops")
    spring_work: float = column("J", "of orthosis, support and harness")
    contact_work: float = column("J", "of ground and seat")
    patient_work: float = column("J", "of the wearer, a push or an imposed motion")


@dataclass(slots=True)
class BraceWorkRow:
    """One more source of work where braces bind the wearer to the device."""

    brace_work: float = column("J", "of the braces")


@dataclass(slots=True)
class BraceRow:
    """Columns of a joint between device and wearer."""

    wearer_angle: float = column("rad", "the wearer's own angle")
    wearer_velocity: float = column("rad/s", "of it")
    brace_torque: float = column("N m", "of the device on the wearer")


@dataclass(slots=True)
class PelvisBraceRow:
    """Columns of the pelvis between device and wearer."""

    wearer_pelvis_height: float = column("m", "of the wearer's own pelvis")
    wearer_pelvis_velocity: float = column("m/s", "of it")
    pelvis_brace_force: float = column("N", "of the device on the wearer, upwards")


@dataclass(slots=True)
class ForwardBraceRow:
    """Columns of a pelvis that moves fore-aft between device and wearer."""

    wearer_pelvis_forward: float = column("m", "of the wearer's own pelvis")
    wearer_pelvis_forward_velocity: float = column("m/s", "of it")
    pelvis_forward_brace_force: float = column("N", "of the device on the wearer, forwards")


@dataclass(slots=True)
class SupervisorRow:
    """Columns of the operating modes; codes are places in their table."""

    mode: float = column("code", "operating mode, counted from 0")
    request: float = column("code", "made in this tick, counted from 1; 0 for none")
    refused: float = column("code", "the same where nothing has answered it")


@dataclass(slots=True, kw_only=True)
class LogRow:
    """A row of the log: numbers only, so that the rows are a table."""

    phases: list[float]
    joints: list[JointRow]
    passive: list[PassiveRow]
    orthoses: list[OrthosisRow]
    feet: list[FootRow]
    pelvis: PelvisRow
    forward: ForwardRow
    trunk: TrunkRow
    crutches: list[CrutchRow]
    seat: SeatRow
    bus_voltage: float = column("V", "of the drives")
    battery_power: float = column("W", "that the battery gives; below 0 motors charge it")
    kinetic_energy: float = column("J", "of bodies and rotors")
    potential_energy: float = column("J", "of gravity")
    works: WorkRow = field(default_factory=WorkRow)
    brace_work: BraceWorkRow
    safety_state: float = column("code", "0 watching, 1 hold")
    trip_cause: float = column("code", "of twin_gait.control.TripCause, 0 without a trip")
    braces: list[BraceRow]
    pelvis_brace: PelvisBraceRow
    forward_brace: ForwardBraceRow
    supervisor: SupervisorRow


def columns_of(row: type) -> dict[str, tuple[str, str]]:
    """Columns that a class of rows declares: unit and meaning by name, in order."""
    return {
        _name_of(item): (item.metadata["unit"], item.metadata["meaning"])
        for item in fields(row)
        if "unit" in item.metadata
    }


def _name_of(item: Field[Any]) -> str:
    unit = item.metadata["unit"]
    return f"{item.name}_{SUFFIXES[unit]}" if unit in SUFFIXES else item.name


JOINT_COLUMNS, BRACE_COLUMNS, PELVIS_BRACE_COLUMNS = (
    tuple(columns_of(row)) for row in (JointRow, BraceRow, PelvisBraceRow)
)
# Work done on the leg since the start, by source; kinetic plus potential energy changes by their sum.
WORK_SOURCES, BRACED_WORK_SOURCES = (
    tuple(name.removesuffix("_work_J") for row in rows for name in columns_of(row))
    for rows in ((WorkRow,), (WorkRow, BraceWorkRow))
)


def work_sources(columns: Container[str]) -> tuple[str, ...]:
    """Sources of work that a log has columns for; the braces are one of them if there are any."""
    return BRACED_WORK_SOURCES if f"{BRACED_WORK_SOURCES[-1]}_work_J" in columns else WORK_SOURCES


def state_columns(model: LegModel, *, wearer: bool = False) -> tuple[list[str], list[str]]:
    """Columns of the coordinates of a model and of its velocities, in its order.

    ``wearer``: whether the state is the wearer's own, where braces bind them to the device.
    """
    own = "wearer_" * wearer
    names = {
        model.pelvis_index: (f"{own}pelvis_height_m", f"{own}pelvis_velocity_m_per_s"),
        model.forward_index: (f"{own}pelvis_forward_m", f"{own}pelvis_forward_velocity_m_per_s"),
        model.pitch_index: ("trunk_pitch_rad", "trunk_pitch_velocity_rad_per_s"),
    }
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            name = f"{side}_{joint}_{own}"
            names[model.index(side, joint)] = (f"{name}angle_rad", f"{name}velocity_rad_per_s")
    return [names[index][0] for index in range(model.nv)], [names[index][1] for index in range(model.nv)]


def unit_of(name: str) -> str:
    """Unit of a column from the end of its name; ``name`` of a phase and ``code`` of a state."""
    if name.endswith("_phase"):
        return "name"
    known = columns_of(LogRow) | columns_of(SupervisorRow)
    if name in (item for item, (unit, _) in known.items() if unit == "code"):
        return "code"
    units = {f"_{suffix}": unit for unit, suffix in SUFFIXES.items()}
    return units.get(max((end for end in units if name.endswith(end)), key=len, default=""), "1")


def meaning_of(name: str) -> str:
    """What a column of a log means, as it is declared; empty for one that is not."""
    rows: list[type] = [LogRow, *(kind for _, kind in kinds_of(LogRow) if is_dataclass(kind))]
    known = {own: said for row in rows for own, (_, said) in columns_of(row).items() if name.endswith(own)}
    return known[max(known, key=len)] if known else ""


@dataclass(frozen=True)
class LogLayout:
    """What a log has columns of.

    ``time_s`` and the names of the phases are added when the table is made.
    """

    legs: Mapping[Side, Sequence[JointName]]  # Controlled joints per leg, in order.
    passive: tuple[tuple[Side, JointName], ...]  # Side and joint of those that are not.
    feet: tuple[Side, ...]  # Legs with foot contact.
    pelvis: bool  # Whether the pelvis moves.
    forward: bool = False  # Whether it moves fore-aft too.
    free: bool = False  # Whether it pitches too.
    crutches: tuple[Side, ...] = ()  # Sides with one.
    seat: bool = False  # Whether there is one.
    braced: bool = False  # Whether braces bind the wearer to the device.
    supervised: bool = False  # Whether it has operating modes.

    def row(self) -> LogRow:
        """An empty row."""
        return LogRow(
            phases=[0.0] * len(self.legs),
            joints=[JointRow() for _ in self._joints],
            passive=[PassiveRow() for _ in self.passive],
            orthoses=[OrthosisRow() for name in self._joints if name.endswith(JointName.ANKLE)],
            feet=[FootRow() for _ in self.feet],
            pelvis=PelvisRow() if self.pelvis else ABSENT,
            forward=ForwardRow() if self.forward else ABSENT,
            trunk=TrunkRow() if self.free else ABSENT,
            crutches=[CrutchRow() for _ in self.crutches],
            seat=SeatRow() if self.seat else ABSENT,
            brace_work=BraceWorkRow() if self.braced else ABSENT,
            braces=[BraceRow() for _ in (*self._joints, *self._passive) if self.braced],
            pelvis_brace=PelvisBraceRow() if self.braced and self.pelvis else ABSENT,
            forward_brace=ForwardBraceRow() if self.braced and self.forward else ABSENT,
            supervisor=SupervisorRow() if self.supervised else ABSENT,
        )

    @property
    def _joints(self) -> list[str]:
        return [f"{side}_{joint}" for side, joints in self.legs.items() for joint in joints]

    @property
    def _passive(self) -> list[str]:
        return [f"{side}_{joint}" for side, joint in self.passive]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in the order of the numbers of a row."""
        prefixes = {
            "joints": self._joints,
            "passive": self._passive,
            "orthoses": [name for name in self._joints if name.endswith(JointName.ANKLE)],
            "feet": [f"{side}_foot" for side in self.feet],
            "crutches": [str(side) for side in self.crutches],
            "braces": [*self._joints, *self._passive],
        }
        row, names = self.row(), [f"{side}_phase" for side in self.legs]
        for item in fields(row):
            value = getattr(row, item.name)
            if item.name in prefixes:
                places = zip(prefixes[item.name], value, strict=False)
                names += [f"{place}_{name}" for place, entry in places for name in columns_of(type(entry))]
            elif "unit" in item.metadata:
                names.append(_name_of(item))
            elif value is not ABSENT:
                names += columns_of(type(value)) if item.name != "phases" else []
        return tuple(names)

    @cached_property
    def positions(self) -> dict[str, int]:
        """Position of each column."""
        return {name: index for index, name in enumerate(self.names)}
