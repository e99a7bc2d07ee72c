"""The signals that guards read, each declared once.

A further one is declared here; the gait controller keeps and writes it
(:mod:`twin_gait.control.gait_controller`), and a step of the tick measures it. Grammar, check, test kit,
diagram, replay and firmware go by the declaration.
"""

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

from twin_gait.parameters.quantities import DEGREE

OTHER = "other."  # in front of a signal of the other leg
LEFT, RIGHT = "left.", "right."  # in front of a signal of a leg, for the supervisor

HIGHEST_LOAD = 2.0  # [body weight]: walking loads a foot with 1.2 at most, running with 2 to 3
LONGEST_STAY = 3600.0  # [s], for a phase without a time-out
# [rad] / [s]: an assumption; the knee reaches 400 deg/s in the swing of a normal walk.
HIGHEST_VELOCITY = 500.0 * DEGREE


class Unit(NamedTuple):
    """Unit of a table."""

    words: str  # in messages
    symbol: str  # behind a number in a diagram
    factor: float = 1.0  # to SI


DEGREES = Unit("deg", "°", DEGREE)
DEGREES_PER_SECOND = Unit("deg/s", "°/s", DEGREE)
BODY_WEIGHTS = Unit("body weights", " BW")
SECONDS = Unit("s", " s")
NO_UNIT = Unit("no unit", "")


@dataclass(frozen=True)
class Signal:
    """A signal of guards."""

    name: str  # in a table; of a joint what follows its name and a point
    unit: Unit  # of its values in a table; what is measured is in SI
    words: str  # in a diagram, behind what it belongs to
    # lowest and highest value at all in SI; None where stops and motors say, which a check knows
    range: tuple[float, float] | None
    # from tick to tick, in the unit of the table: an assumption. The encoder's own step is far below (0.0004°
    # of the joint); cuffs, gears and the foot on the belt shake more
    noise: float = 0.0
    # comfortable distance from a threshold, in the unit of the table, that the test kit keeps
    room: float = 0.0
    first: float = math.nan  # before anything is measured, in SI; NaN opens no guard
    field: str = ""  # of a signal of the device, in the gait controller's record of it
    # of a log, in SI, from which a replay reads a signal of the device; without one it stays as at first. How
    # angles and loads are read, reading says
    column: str = ""

    def of(self, joint: str) -> str:
        """Name that it has in a table for a joint."""
        return f"{joint}.{self.name}"


ANGLE = Signal("angle_deg", DEGREES, "", None, noise=0.5, room=1.0)
VELOCITY = Signal("velocity_deg_per_s", DEGREES_PER_SECOND, " velocity", None, noise=5.0, room=5.0)
LOAD = Signal("foot.load_bw", BODY_WEIGHTS, " load", (0.0, HIGHEST_LOAD), noise=0.02, room=0.05)
TIME_IN_PHASE = Signal("time_in_phase_s", SECONDS, "time in phase", (0.0, LONGEST_STAY), room=0.01)
TRUNK_PITCH = Signal(
    "trunk.pitch_deg",
    DEGREES,
    " pitch",
    None,
    noise=0.5,
    room=1.0,
    first=0.0,
    field="trunk_pitch",
    column="measured_trunk_pitch_rad",
)
# What the legs are told: 1 to walk, 0 to stand; 1 to take a step, 0 to wait for one.
WALK = Signal("walk", NO_UNIT, "told to walk", (0.0, 1.0), room=0.25, first=1.0, field="walk")
STEP = Signal("step", NO_UNIT, "told to step", (0.0, 1.0), room=0.25, first=1.0, field="step")
LEGS_IN_SWING = Signal("legs_in_swing", NO_UNIT, "legs in swing", (0.0, 2.0), room=0.25, first=0.0)

JOINT_SIGNALS = (ANGLE, VELOCITY)  # each joint has its own
LEG_SIGNALS = (LOAD, TIME_IN_PHASE)  # each leg has its own
DEVICE_SIGNALS = (TRUNK_PITCH, WALK, STEP)  # both legs read the same
DEVICE_NAMES = tuple(signal.name for signal in DEVICE_SIGNALS)
SIGNALS = (*JOINT_SIGNALS, *LEG_SIGNALS, *DEVICE_SIGNALS)
TIME, OTHER_TIME = TIME_IN_PHASE.name, OTHER + TIME_IN_PHASE.name
MODE_SIGNALS = (TIME_IN_PHASE, TRUNK_PITCH, LEGS_IN_SWING)  # of the supervisor, behind those of both legs


def signal_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the signals of one leg in the order of the list of signals: joint by joint, then of the leg."""
    names = (signal.of(joint) for joint in joints for signal in JOINT_SIGNALS)
    return (*names, *(signal.name for signal in LEG_SIGNALS))


@lru_cache(maxsize=32)  # each guard of a table is checked against them
def all_signal_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the signals of this leg, the other, then the device: their positions index the guard program."""
    own = signal_names(joints)
    return (*own, *(OTHER + name for name in own), *DEVICE_NAMES)


@lru_cache(maxsize=32)
def mode_signal_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the signals of the left leg, of the right one, then of the supervisor, as in its list."""
    own = signal_names(joints)
    legs = (side + name for side in (LEFT, RIGHT) for name in own)
    return (*legs, *(signal.name for signal in MODE_SIGNALS))


@cache
def signal_of(name: str) -> Signal:
    """Declaration of a signal by its name in a table, which may have further words in front."""
    known = (signal for signal in (*SIGNALS, LEGS_IN_SWING) if f".{name}".endswith(f".{signal.name}"))
    return max(known, key=lambda signal: len(signal.name))  # a leg's name may end in a joint's


def part_of(name: str) -> str:
    """What a signal belongs to by its name: a joint, the foot, a part of the device; empty for none."""
    return f"..{name}".rsplit(".", 2)[1]


def signal_scale(name: str) -> float:
    """Factor from the unit in a signal's name to SI."""
    return signal_of(name).unit.factor
