"""Columns of the log: their names, the expressions that read them from the episode, and their meanings.

The function that writes a row in every tick is generated from these expressions (:attr:`LogLayout.writer`).
"""

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain, count

import numpy as np
import pandas as pd

from twin_gait.gait.table import TICK
from twin_gait.labels import label_of
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.vocabulary import JointName

LOG_SCHEMA_VERSION = 4
# Columns of codes, without a unit.
CODE_COLUMNS = "safety_state", "trip_cause", "mode", "request", "rejected"


class ColumnGroup:
    """Columns of one object, or of each of several objects of a kind.

    Attributes:
        preamble: Statement that assigns the names used in ``columns``, from the episode ``e`` and the number
            ``n`` of the object among its kind.
        columns: Expression and meaning of each column, by its name without the prefix of the object.
    """

    def __init__(self, preamble: str = "", /, **columns: tuple[str, str]) -> None:
        """Declare columns; see the attributes."""
        self.preamble, self.columns = preamble, columns


PHASE = ColumnGroup(phase=("e.controller.legs[n].phase", ""))

# Columns of a controlled joint; torques act on the joint and are positive in flexion.
JOINT = ColumnGroup(
    "joint, command, setpoint, index = "
    "e.joints[n], e.joints[n].board.command, e.joints[n].board.setpoint, e.joints[n].index",
    angle_rad=("e.q[index]", "true angle; with braces, the angle of the device"),
    velocity_rad_per_s=("e.v[index]", "true velocity"),
    measured_angle_rad=("joint.board.encoder.angle", "encoder angle"),
    velocity_fast_rad_per_s=("joint.board.encoder.velocity_fast", "fast velocity, for damper and guards"),
    velocity_slow_rad_per_s=("joint.board.encoder.velocity_slow", "slow velocity, for friction compensation"),
    impedance_torque_Nm=("command.impedance", "spring, damper and runaway torque; brake torque in the hold"),
    friction_compensation_torque_Nm=("command.friction", "G times the friction of the model"),
    gravity_compensation_torque_Nm=("setpoint.gravity", "compensated share of the gravity torque"),
    inertia_compensation_torque_Nm=("setpoint.inertia", "compensated share of the inertia torque"),
    target_torque_Nm=("setpoint.target", "constant torque that is added to the command"),
    motor_command_torque_Nm=("command.torque", "command torque: sum of these five torques, before limits"),
    motor_torque_Nm=("e.motor[index]", "torque constant times gear ratio times current, before gear losses"),
    friction_torque_Nm=("e.plant[index].friction_torque", "torque of friction and of the gear's losses"),
    stop_torque_Nm=("e.plant[index].stop_torque", "torque of the mechanical stops"),
    external_torque_Nm=(
        "joint.external_torque",
        "external torque: sum of the next three torques",
    ),
    voluntary_torque_Nm=("e.voluntary[index + WEARER_OFFSET]", "torque of the wearer's voluntary effort"),
    passive_torque_Nm=(
        "e.passive_moment[index + WEARER_OFFSET]",
        "torque of the wearer's tissue and stretch reflex",
    ),
    disturbance_torque_Nm=("joint.disturbance_torque", "torque of a push or an imposed motion"),
    target_current_A=("command.target_current", "current setpoint of the drive"),
    measured_current_A=("joint.current", "motor current"),
    stiffness_Nm_per_rad=("setpoint.stiffness", "k of the impedance, blended"),
    damping_Nms_per_rad=("setpoint.damping", "b of the impedance, blended"),
    equilibrium_rad=("setpoint.equilibrium", "θ0 of the impedance, blended"),
    friction_compensation_gain=("setpoint.gain", "G of the friction compensation, blended"),
)
# Columns of an ankle that is not controlled, of another such joint, and the additional column of a controlled
# ankle.
PASSIVE = ColumnGroup(
    "index = e.passive[n]",
    angle_rad=JOINT.columns["angle_rad"],
    velocity_rad_per_s=JOINT.columns["velocity_rad_per_s"],
    orthosis_torque_Nm=("e.plant[index].spring_torque", "torque of the orthosis on the ankle"),
)
UNDRIVEN = ColumnGroup(
    "index = e.passive[n]",
    angle_rad=JOINT.columns["angle_rad"],
    velocity_rad_per_s=JOINT.columns["velocity_rad_per_s"],
    stop_torque_Nm=JOINT.columns["stop_torque_Nm"],
    passive_torque_Nm=JOINT.columns["passive_torque_Nm"],
)
ANKLE = ColumnGroup("index = e.ankles[n]", orthosis_torque_Nm=PASSIVE.columns["orthosis_torque_Nm"])

# Columns of a leg and of a joint in the wearer's own gait, and the work of its muscles.
OWN_PHASE = ColumnGroup(own_phase=("e.own_gait.legs[n].phase", "phase of the wearer's own gait"))
OWN_JOINT = ColumnGroup(
    "own = e.own_gait.joints[n]",
    own_torque_Nm=(
        "e.own_gait.torque[own.index + WEARER_OFFSET]",
        "torque of the wearer's muscles in the wearer's own gait",
    ),
    own_stiffness_Nm_per_rad=("own.blended.stiffness", "stiffness of the muscles, blended"),
    own_damping_Nms_per_rad=("own.blended.damping", "damping of the muscles, blended"),
    own_equilibrium_rad=("own.blended.equilibrium", "equilibrium angle of the muscles, blended"),
)
OWN_WORK = ColumnGroup(own_gait_work_J=("e.work.own_gait", "work of the muscles in the wearer's own gait"))

# Columns of a foot.
FOOT = ColumnGroup(
    "foot = e.feet[n]",
    normal_force_N=("foot.normal", "ground reaction force normal to the ground"),
    friction_force_N=("foot.friction", "ground reaction force along the ground, positive forwards"),
    clearance_m=("foot.clearance", "height of the lowest point of the sole above the ground"),
    cop_ratio=("foot.cop_ratio", "centre of pressure, 0 at heel to 1 at toe; 0 without contact"),
)

GROUND = ColumnGroup(
    belt_speed_m_per_s=("e.ground.belt_speed", "belt speed, positive backwards; 0 without a belt")
)

PELVIS = ColumnGroup(
    "support = e.plant[PELVIS_INDEX + WEARER_OFFSET]",
    pelvis_height_m=("e.q[PELVIS_INDEX]", "height of the pelvis above the ground"),
    pelvis_velocity_m_per_s=("e.v[PELVIS_INDEX]", "vertical velocity, positive upwards"),
    support_force_N=("support.spring_torque + support.stop_torque", "upward force of support and harness"),
    guide_force_N=("e.guide_force", "forward force of the guide; without it, of harness, arms and seat"),
    guide_moment_Nm=("e.guide_moment", "pitch moment of the guide; without it, of harness, arms and seat"),
)
# Columns of a pelvis that moves fore-aft, and of a trunk whose pitch is free.
FORWARD = ColumnGroup(
    pelvis_forward_m=("e.q[FORWARD_INDEX]", "distance in front of the rest position of the harness"),
    pelvis_forward_velocity_m_per_s=("e.v[FORWARD_INDEX]", "velocity of the pelvis, positive forwards"),
)
TRUNK = ColumnGroup(
    trunk_pitch_rad=("e.q[PITCH_INDEX]", "angle of pelvis and trunk from upright, positive forwards"),
    trunk_pitch_velocity_rad_per_s=("e.v[PITCH_INDEX]", "angular velocity of the trunk, positive forwards"),
    measured_trunk_pitch_rad=(
        "e.controller.device_signals.trunk_pitch",
        "pitch that the gait controller receives",
    ),
)

# Columns of an arm and its crutch, and of a seat.
CRUTCH = ColumnGroup(
    "arm, tip = e.arms[n], e.arms[n].tip",
    crutch_forward_m=("e.q[arm.index]", "forward position of the tip of the crutch"),
    crutch_height_m=("e.q[arm.index + 1]", "height of the tip above the ground"),
    crutch_normal_force_N=("tip.upward", "upward force of the ground on the tip"),
    crutch_friction_force_N=("tip.forward", "friction of the ground on the tip, positive forwards"),
    arm_axial_force_N=(
        "arm.axial_force",
        "axial force of the arm from shoulder to tip, positive away from the shoulder",
    ),
    shoulder_moment_Nm=("arm.moment", "moment of the shoulder, positive if it turns the crutch forwards"),
    arm_power_W=("arm.power", "power that the arm delivers to trunk and crutch"),
)
SEAT = ColumnGroup(
    seat_force_N=("e.seat.normal", "upward force of the seat on buttocks and thighs"),
    seat_friction_force_N=("e.seat.friction", "friction of the seat on the wearer, positive forwards"),
    seat_forward_m=("e.seat.front_edge", "position of the front edge of the seat"),
)

ENERGY = ColumnGroup(
    bus_voltage_V=("e.supply.bus_voltage", "voltage of the supply of the drives"),
    battery_power_W=("e.supply.power", "power that the battery delivers; negative if motors charge it"),
    kinetic_energy_J=("e.kinetic_energy", "kinetic energy of bodies and rotors"),
    potential_energy_J=("e.potential_energy", "potential energy of gravity"),
)
# Work done on the legs since the start, by source. The sum equals the change of kinetic and potential energy.
WORK = ColumnGroup(
    motor_work_J=("e.work.motor", "work of the motors"),
    friction_work_J=("e.work.friction", "work of friction in motors and gears"),
    stop_work_J=("e.work.stop", "work of the mechanical stops"),
    spring_work_J=("e.work.spring", "work of orthosis, support and harness"),
    contact_work_J=("e.work.contact", "work of ground and seat"),
    external_work_J=("e.work.external", "work of the wearer, of pushes and of an imposed motion"),
)
BRACE_WORK = ColumnGroup(brace_work_J=("e.work.brace", "work of the braces"))
MONITOR = ColumnGroup(
    safety_state=("1.0 if e.controller.trip.tick >= 0 else 0.0", "0 before a trip, 1 in the hold"),
    trip_cause=("e.controller.trip.cause", "code of twin_gait.control.TripCause, 0 without a trip"),
)

# Columns of a joint with a brace, of the pelvis with a brace, and of a pelvis that moves fore-aft.
BRACE = ColumnGroup(
    "index = e.braced[n]",
    wearer_angle_rad=("e.q[index + WEARER_OFFSET]", "angle of the wearer's joint"),
    wearer_velocity_rad_per_s=("e.v[index + WEARER_OFFSET]", "velocity of the wearer's joint"),
    brace_torque_Nm=("e.braces[index].torque", "torque of the device on the wearer"),
)
PELVIS_BRACE = ColumnGroup(
    wearer_pelvis_height_m=("e.q[PELVIS_INDEX + WEARER_OFFSET]", "height of the wearer's pelvis"),
    wearer_pelvis_velocity_m_per_s=(
        "e.v[PELVIS_INDEX + WEARER_OFFSET]",
        "vertical velocity of the wearer's pelvis",
    ),
    pelvis_brace_force_N=("e.braces[PELVIS_INDEX].torque", "upward force of the device on the wearer"),
)
FORWARD_BRACE = ColumnGroup(
    wearer_pelvis_forward_m=("e.q[FORWARD_INDEX + WEARER_OFFSET]", "forward position of the wearer's pelvis"),
    wearer_pelvis_forward_velocity_m_per_s=(
        "e.v[FORWARD_INDEX + WEARER_OFFSET]",
        "velocity of the wearer's pelvis",
    ),
    pelvis_forward_brace_force_N=(
        "e.braces[FORWARD_INDEX].torque",
        "forward force of the device on the wearer",
    ),
)
# Columns of the operating modes; the codes are indices in the table of modes.
SUPERVISOR = ColumnGroup(
    "supervisor = e.controller.supervisor",
    mode=("supervisor.mode", "operating mode, counted from 0"),
    request=("supervisor.request", "request in this tick, counted from 1; 0 without a request"),
    rejected=("supervisor.rejected", "request in this tick if the supervisor rejected it, otherwise 0"),
)


class LogArrays:
    """Columns of a log by name, with phases as indices in the gait table; the length is that of the run."""

    def __init__(
        self,
        rows: np.ndarray,
        names: Sequence[str],
        phases: Sequence[str],
        own_phases: Sequence[str] = (),
    ) -> None:
        """Store references to the columns.

        ``rows``: shape ``(n_columns, n_ticks)``. ``names``: names of the columns. ``phases``: names of the
        phases of the gait table. ``own_phases``: those of the wearer's own gait.
        """
        self._rows, self._names, self._phases, self._own_phases = rows, names, phases, own_phases
        self._places = dict(zip(names, range(len(names)), strict=True))

    def __len__(self) -> int:
        """Return the number of ticks."""
        return int(self._rows.shape[1])

    def __contains__(self, name: object) -> bool:
        """Return whether there is a column of this name."""
        return name in self._places or name == "time_s"

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column, shape ``(n_ticks,)``."""
        if name == "time_s":
            return np.arange(len(self)) * TICK
        return np.asarray(self._rows[self._places[name]])

    def table(self) -> pd.DataFrame:
        """Build the table with ``time_s`` as the first column and phases by name."""
        rows = self._rows.T
        log = pd.DataFrame(np.asfortranarray(rows), columns=list(self._names), copy=False)
        log.insert(0, "time_s", self["time_s"])
        phases = pd.CategoricalDtype(pd.Index(self._phases))
        for name in (name for name in self._names if name.endswith("_phase")):
            kind = pd.CategoricalDtype(pd.Index(self._own_phases)) if name.endswith("_own_phase") else phases
            log[name] = pd.Categorical.from_codes(self[name].astype(np.int64), dtype=kind)
        return log


WORK_SOURCES = tuple(name.removesuffix("_work_J") for name in WORK.columns)


def work_sources(columns: Container[str]) -> tuple[str, ...]:
    """Return the sources of work in a log, with braces and own gait if the log has a column for them."""
    return (*WORK_SOURCES, *(source for source in ("brace", "own_gait") if f"{source}_work_J" in columns))


def state_columns(model: LegModel, *, wearer: bool = False) -> tuple[list[str], list[str]]:
    """Return the names of the columns of coordinates and of velocities, in the order of a model.

    ``wearer``: whether the state is the wearer's own, if braces connect wearer and device.
    """
    prefix = "wearer_" * wearer
    names = {
        model.pelvis_index: (f"{prefix}pelvis_height_m", f"{prefix}pelvis_velocity_m_per_s"),
        model.forward_index: (f"{prefix}pelvis_forward_m", f"{prefix}pelvis_forward_velocity_m_per_s"),
        model.pitch_index: ("trunk_pitch_rad", "trunk_pitch_velocity_rad_per_s"),
    }
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            name = f"{side}_{joint}_{prefix}"
            names[model.index(side, joint)] = (f"{name}angle_rad", f"{name}velocity_rad_per_s")
    return [names[index][0] for index in range(model.nv)], [names[index][1] for index in range(model.nv)]


def unit_of(name: str) -> str:
    """Return the unit of a column from the end of its name; ``name`` for a phase, ``code`` for a state."""
    if name.endswith("_phase"):
        return "name"
    return "code" if name in CODE_COLUMNS else label_of(name).unit


def meaning_of(name: str) -> str:
    """Return the declared meaning of a column of a log; empty if the column is not declared."""
    kinds = (kind for kind in globals().values() if isinstance(kind, ColumnGroup))
    columns = chain.from_iterable(kind.columns.items() for kind in kinds)
    known = {ending: meaning for ending, (_, meaning) in columns if name.endswith(ending)}
    return known[max(known, key=len)] if known else ""


@dataclass(frozen=True)
class LogLayout:
    """Order of the columns in a row of the log, by the objects to which they belong.

    ``time_s`` and the names of the phases are added when the table is built.
    """

    # Objects in order, each with the prefix of its column names, its number among its kind, and its columns.
    groups: tuple[tuple[str, int, ColumnGroup], ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in the order of the numbers of a row."""
        return tuple(prefix + name for prefix, _, kind in self.groups for name in kind.columns)

    @cached_property
    def writer(self) -> str:
        """Source code of ``write_row``, which writes all columns into a row of the log."""
        lines, index = ["def write_row(e, row):"], count()
        for _, number, kind in self.groups:
            lines += [f"n = {number}", kind.preamble]
            lines += [f"row[{next(index)}] = {found}" for found, _ in kind.columns.values()]
        return "\n    ".join(lines) + "\n"


def log_layout(setup: SimulationSetup) -> LogLayout:
    """Return the layout of the log of a simulation setup."""
    world, model, own = setup.world, setup.world.model, setup.own_gait
    joints = [f"{item.side}_{item.joint}_" for item in setup.joints]
    passive = {f"{side}_{joint}_": joint for side, joint in setup.passive}
    driven_ankles = [f"{side}_{JointName.ANKLE}_" for side in model.legs]
    feet = [f"{side}_foot_" for side in model.legs if world.contact_frames.get(side)]
    guides = model.pelvis_index, model.forward_index, model.pitch_index
    pelvis, forward, pitch = (guide is not None for guide in guides)
    braced, single = world.braces is not None, [""]  # one object, whose columns have no prefix
    moved = [] if own is None else own.moved
    # Objects of each kind, by their prefix or, where some of a kind have other columns, by number and prefix.
    kinds: tuple[tuple[Iterable[str | tuple[int, str]], ColumnGroup], ...] = (
        ([f"{side}_" for side in setup.sides], PHASE),
        (joints, JOINT),
        ([item for item in enumerate(passive) if passive[item[1]] is JointName.ANKLE], PASSIVE),
        ([item for item in enumerate(passive) if passive[item[1]] is not JointName.ANKLE], UNDRIVEN),
        ([item for item in enumerate(driven_ankles) if item[1] in joints], ANKLE),
        ([f"{side}_" for side in model.legs if own is not None], OWN_PHASE),
        ([(number, f"{side}_{joint}_") for number, side, joint in moved], OWN_JOINT),
        (feet, FOOT),
        (single * bool(feet), GROUND),
        (single * pelvis, PELVIS),
        (single * forward, FORWARD),
        (single * pitch, TRUNK),
        ([f"{side}_" for side in model.sides[: len(world.arms)]], CRUTCH),
        (single * (world.seat is not None), SEAT),
        (single, ENERGY),
        (single, WORK),
        (single * braced, BRACE_WORK),
        (single * (own is not None), OWN_WORK),
        (single, MONITOR),
        ([*joints, *passive] * braced, BRACE),
        (single * (braced and pelvis), PELVIS_BRACE),
        (single * (braced and forward), FORWARD_BRACE),
        (single * (setup.experiment.modes is not None), SUPERVISOR),
    )
    groups = []
    for objects, kind in kinds:
        for place, item in enumerate(objects):
            number, prefix = (place, item) if isinstance(item, str) else item
            groups.append((prefix, number, kind))
    return _layout_of(tuple(groups))


_layout_of = lru_cache(maxsize=32)(LogLayout)  # episodes of a batch have one layout
