"""Columns of the log: what they are called, where in the episode they are read, and what they mean.

From them is written the function that fills a row in every tick (:attr:`LogLayout.writer`).
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import count

import numpy as np
import pandas as pd

from twin_gait.gait.table import TICK
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.vocabulary import JointName

LOG_SCHEMA_VERSION = 3
UNITS = "rad", "rad/s", "rad/s²", "N m", "A", "N m/rad", "N m s/rad", "N", "m", "m/s", "s", "V", "W", "J"
# How a unit is written at the end of a name.
SUFFIXES = {unit: unit.replace(" ", "").replace("/", "_per_").replace("²", "2") for unit in UNITS}
CODE_COLUMNS = ("safety_state", "trip_cause", "mode", "request", "rejected")  # columns without a unit


class ColumnGroup:
    """Columns of a thing, or of each of several things of a kind.

    Attributes:
        thing: Statement that gives names to what is read, from the episode ``e`` and the number ``n`` of the
            thing among its kind.
        columns: Where each is read, and what it means, by its name behind that of the thing.
    """

    def __init__(self, preamble: str = "", /, **columns: tuple[str, str]) -> None:
        """Declare them."""
        self.preamble, self.columns = preamble, columns


PHASE = ColumnGroup(phase=("e.controller.legs[n].phase", ""))

# Of a controlled joint; torques act on the joint, positive in flexion.
JOINT = ColumnGroup(
    "joint, command, setpoint, index = "
    "e.joints[n], e.joints[n].board.command, e.joints[n].board.setpoint, e.joints[n].index",
    angle_rad=("e.q[index]", "true angle; of the device, if braces bind the wearer to it"),
    velocity_rad_per_s=("e.v[index]", "true velocity"),
    measured_angle_rad=("joint.board.encoder.angle", "encoder angle"),
    velocity_fast_rad_per_s=("joint.board.encoder.velocity_fast", "first-order, for damper and guards"),
    velocity_slow_rad_per_s=("joint.board.encoder.velocity_slow", "averaged, for friction compensation"),
    impedance_torque_Nm=(
        "command.impedance",
        "of spring and damper, with a runaway; in the hold of the brake",
    ),
    friction_compensation_torque_Nm=("command.friction", "G times the friction of the model"),
    gravity_compensation_torque_Nm=("setpoint.gravity", "share of the gravity torque that is given"),
    inertia_compensation_torque_Nm=("setpoint.inertia", "share of the inertia torque that is given"),
    target_torque_Nm=("setpoint.target", "added to the command"),
    motor_command_torque_Nm=("command.torque", "sum of the five, before limits"),
    motor_torque_Nm=("e.motor[index]", "of the motor times the gear ratio, before the losses of the gear"),
    friction_torque_Nm=("e.plant[index].friction_torque", "of motor and gear, with its losses under load"),
    stop_torque_Nm=("e.plant[index].stop_torque", "of the mechanical stops"),
    external_torque_Nm=(
        "joint.external_torque",
        "of the wearer, a push or an imposed motion: sum of the next three",
    ),
    voluntary_torque_Nm=("e.voluntary[index + WEARER_OFFSET]", "of the wearer's voluntary effort"),
    passive_torque_Nm=(
        "e.passive_moment[index + WEARER_OFFSET]",
        "of the wearer's tissue and stretch reflex",
    ),
    disturbance_torque_Nm=("joint.disturbance_torque", "of a push or an imposed motion"),
    target_current_A=("command.target_current", "that the drive is asked for"),
    measured_current_A=("joint.current", "that flows"),
    stiffness_Nm_per_rad=("setpoint.stiffness", "k of the impedance, blended"),
    damping_Nms_per_rad=("setpoint.damping", "b of the impedance, blended"),
    equilibrium_rad=("setpoint.equilibrium", "θ0 of the impedance, blended"),
    friction_compensation_gain=("setpoint.gain", "G of the friction compensation, blended"),
)
# Of a joint that is not controlled, and one more of an ankle that is.
PASSIVE = ColumnGroup(
    "index = e.passive[n]",
    angle_rad=JOINT.columns["angle_rad"],
    velocity_rad_per_s=JOINT.columns["velocity_rad_per_s"],
    orthosis_torque_Nm=("e.plant[index].spring_torque", "of the orthosis on the ankle"),
)
ANKLE = ColumnGroup("index = e.ankles[n]", orthosis_torque_Nm=PASSIVE.columns["orthosis_torque_Nm"])

# Of a foot on the ground.
FOOT = ColumnGroup(
    "foot = e.feet[n]",
    normal_force_N=("foot.normal", "of the ground, at right angles to it"),
    friction_force_N=("foot.friction", "of the ground, along it, forwards positive"),
    clearance_m=("foot.clearance", "height of the lowest point of the sole over the ground"),
    cop_ratio=("foot.cop_ratio", "centre of pressure, 0 at first to 1 at last point; 0 in the air"),
)

GROUND = ColumnGroup(
    belt_speed_m_per_s=("e.ground.belt_speed", "of the belt, backwards positive; 0 without one")
)

PELVIS = ColumnGroup(
    "support = e.plant[PELVIS_INDEX + WEARER_OFFSET]",
    pelvis_height_m=("e.q[PELVIS_INDEX]", "above the belt"),
    pelvis_velocity_m_per_s=("e.v[PELVIS_INDEX]", "upwards"),
    support_force_N=(
        "support.spring_torque + support.stop_torque",
        "of body-weight support and harness, upwards",
    ),
    guide_force_N=("e.guide_force", "forward force of the guide; of harness, arms, seat on a free pelvis"),
    guide_moment_Nm=("e.guide_moment", "pitching moment of the guide; of harness, arms, seat"),
)
# Of a pelvis that moves fore-aft, and of a trunk that is free.
FORWARD = ColumnGroup(
    pelvis_forward_m=("e.q[FORWARD_INDEX]", "in front of where the harness lets it rest"),
    pelvis_forward_velocity_m_per_s=("e.v[FORWARD_INDEX]", "of it"),
)
TRUNK = ColumnGroup(
    trunk_pitch_rad=("e.q[PITCH_INDEX]", "of pelvis and trunk from upright, forwards positive"),
    trunk_pitch_velocity_rad_per_s=("e.v[PITCH_INDEX]", "of it"),
    measured_trunk_pitch_rad=("e.controller.device_signals.trunk_pitch", "as the gait controller has it"),
)

# Of an arm and its crutch, and of a seat.
CRUTCH = ColumnGroup(
    "arm, tip = e.arms[n], e.arms[n].tip",
    crutch_forward_m=("e.q[arm.index]", "place of the tip"),
    crutch_height_m=("e.q[arm.index + 1]", "of the tip over the ground"),
    crutch_normal_force_N=("tip.upward", "of the ground on the tip, upwards"),
    crutch_friction_force_N=("tip.forward", "of the ground on the tip, forwards positive"),
    arm_axial_force_N=(
        "arm.axial_force",
        "of the arm along the line from shoulder to tip, away from the shoulder",
    ),
    shoulder_moment_Nm=("arm.moment", "of the shoulder, which turns the crutch forwards"),
    arm_power_W=("arm.power", "that the arm gives to trunk and crutch"),
)
SEAT = ColumnGroup(
    seat_force_N=("e.seat.normal", "of the seat on buttocks and thighs, upwards"),
    seat_friction_force_N=("e.seat.friction", "of the seat on them, forwards positive"),
    seat_forward_m=("e.seat.front_edge", "place of its front edge"),
)

ENERGY = ColumnGroup(
    bus_voltage_V=("e.supply.bus_voltage", "of the drives"),
    battery_power_W=("e.supply.power", "that the battery gives; below 0 motors charge it"),
    kinetic_energy_J=("e.kinetic_energy", "of bodies and rotors"),
    potential_energy_J=("e.potential_energy", "of gravity"),
)
# Done on the leg since the start, by source; kinetic plus potential energy changes by their sum.
WORK = ColumnGroup(
    motor_work_J=("e.work.motor", "of the motors"),
    friction_work_J=("e.work.friction", "of friction in motors and gears"),
    stop_work_J=("e.work.stop", "of the mechanical stops"),
    spring_work_J=("e.work.spring", "of orthosis, support and harness"),
    contact_work_J=("e.work.contact", "of ground and seat"),
    external_work_J=("e.work.external", "of the wearer, a push or an imposed motion"),
)
BRACE_WORK = ColumnGroup(brace_work_J=("e.work.brace", "of the braces"))
MONITOR = ColumnGroup(
    safety_state=("1.0 if e.controller.trip.tick >= 0 else 0.0", "0 watching, 1 hold"),
    trip_cause=("e.controller.trip.cause", "of twin_gait.control.safety.TripCause, 0 without a trip"),
)

# Of a joint between device and wearer, of the pelvis between them, and of one that moves fore-aft.
BRACE = ColumnGroup(
    "index = e.braced[n]",
    wearer_angle_rad=("e.q[index + WEARER_OFFSET]", "the wearer's own angle"),
    wearer_velocity_rad_per_s=("e.v[index + WEARER_OFFSET]", "of it"),
    brace_torque_Nm=("e.braces[index].torque", "of the device on the wearer"),
)
PELVIS_BRACE = ColumnGroup(
    wearer_pelvis_height_m=("e.q[PELVIS_INDEX + WEARER_OFFSET]", "of the wearer's own pelvis"),
    wearer_pelvis_velocity_m_per_s=("e.v[PELVIS_INDEX + WEARER_OFFSET]", "of it"),
    pelvis_brace_force_N=("e.braces[PELVIS_INDEX].torque", "of the device on the wearer, upwards"),
)
FORWARD_BRACE = ColumnGroup(
    wearer_pelvis_forward_m=("e.q[FORWARD_INDEX + WEARER_OFFSET]", "of the wearer's own pelvis"),
    wearer_pelvis_forward_velocity_m_per_s=("e.v[FORWARD_INDEX + WEARER_OFFSET]", "of it"),
    pelvis_forward_brace_force_N=("e.braces[FORWARD_INDEX].torque", "of the device on the wearer, forwards"),
)
# Of the operating modes; codes are places in their table.
SUPERVISOR = ColumnGroup(
    "supervisor = e.controller.supervisor",
    mode=("supervisor.mode", "operating mode, counted from 0"),
    request=("supervisor.request", "made in this tick, counted from 1; 0 for none"),
    rejected=("supervisor.rejected", "the same where nothing has answered it"),
)


class LogArrays:
    """Columns of a log as an engine wrote them, by name; a phase is its index in the table.

    The length is the number of ticks.
    """

    def __init__(self, rows: np.ndarray, names: Sequence[str], phases: Sequence[str]) -> None:
        """Keep the columns.

        ``rows``: shape ``(n_columns, n_ticks)``; ``names`` of the columns; ``phases`` of the gait table.
        """
        self._rows, self._names, self._phases = rows, names, phases
        self._places = dict(zip(names, range(len(names)), strict=True))

    def __len__(self) -> int:
        """Return the number of ticks."""
        return int(self._rows.shape[1])

    def __contains__(self, name: object) -> bool:
        """Return whether there is a column."""
        return name in self._places or name == "time_s"

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column, shape ``(n_ticks,)``."""
        if name == "time_s":
            return np.arange(len(self)) * TICK
        return np.asarray(self._rows[self._places[name]])

    def table(self) -> pd.DataFrame:
        """Build the table, with ``time_s`` in front and phases by name."""
        rows = self._rows.T
        log = pd.DataFrame(np.asfortranarray(rows), columns=list(self._names), copy=False)
        log.insert(0, "time_s", self["time_s"])
        phases = pd.CategoricalDtype(pd.Index(self._phases))
        for name in (name for name in self._names if name.endswith("_phase")):
            log[name] = pd.Categorical.from_codes(self[name].astype(np.int64), dtype=phases)
        return log


WORK_SOURCES = tuple(name.removesuffix("_work_J") for name in WORK.columns)


def work_sources(columns: Container[str]) -> tuple[str, ...]:
    """Sources of work that a log has columns for; the braces are one of them if there are any."""
    return (*WORK_SOURCES, "brace") if "brace_work_J" in columns else WORK_SOURCES


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
    units = {f"_{suffix}": unit for unit, suffix in SUFFIXES.items()}
    found = units.get(max((end for end in units if name.endswith(end)), key=len, default=""), "1")
    return "code" if name in CODE_COLUMNS else found


def meaning_of(name: str) -> str:
    """What a column of a log means, as it is declared; empty for one that is not."""
    kinds = (kind for kind in globals().values() if isinstance(kind, ColumnGroup))
    known = {own: said for kind in kinds for own, (_, said) in kind.columns.items() if name.endswith(own)}
    return known[max(known, key=len)] if known else ""


@dataclass(frozen=True)
class LogLayout:
    """What a log has columns of.

    ``time_s`` and the names of the phases are added when the table is made.
    """

    # In order: name of a thing in front of those of its columns, its number among its kind, and its columns.
    groups: tuple[tuple[str, int, ColumnGroup], ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in the order of the numbers of a row."""
        return tuple(thing + name for thing, _, kind in self.groups for name in kind.columns)

    @cached_property
    def writer(self) -> str:
        """Source of ``write_row``, which writes all columns into a row of the log."""
        lines, place = ["def write_row(e, row):"], count()
        for _, number, kind in self.groups:
            lines += [f"n = {number}", kind.preamble]
            lines += [f"row[{next(place)}] = {found}" for found, _ in kind.columns.values()]
        return "\n    ".join(lines) + "\n"


def log_layout(setup: SimulationSetup) -> LogLayout:
    """Columns that a problem's log has."""
    world, model = setup.world, setup.world.model
    joints = [f"{item.side}_{item.joint}_" for item in setup.joints]
    passive = [f"{side}_{joint}_" for side, joint in setup.passive]
    feet = [f"{side}_foot_" for side in model.legs if world.contact_frames.get(side)]
    places = model.pelvis_index, model.forward_index, model.pitch_index
    pelvis, forward, pitch = (place is not None for place in places)
    braced, one = world.braces is not None, [""]
    kinds = (
        ([f"{side}_" for side in model.legs], PHASE),
        (joints, JOINT),
        (passive, PASSIVE),
        ([name for name in joints if name.endswith(f"{JointName.ANKLE}_")], ANKLE),
        (feet, FOOT),
        (one * bool(feet), GROUND),
        (one * pelvis, PELVIS),
        (one * forward, FORWARD),
        (one * pitch, TRUNK),
        ([f"{side}_" for side in setup.sides[: len(world.arms)]], CRUTCH),
        (one * (world.seat is not None), SEAT),
        (one, ENERGY),
        (one, WORK),
        (one * braced, BRACE_WORK),
        (one, MONITOR),
        ((joints + passive) * braced, BRACE),
        (one * (braced and pelvis), PELVIS_BRACE),
        (one * (braced and forward), FORWARD_BRACE),
        (one * (setup.experiment.modes is not None), SUPERVISOR),
    )
    return _layout_of(
        tuple((name, number, kind) for names, kind in kinds for number, name in enumerate(names))
    )


_layout_of = lru_cache(maxsize=32)(LogLayout)  # episodes of a batch have one layout
