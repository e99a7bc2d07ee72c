"""The signals that guards read, each declared once.

A further one is declared here; the gait controller keeps and writes it
(:mod:`twin_gait.control.gait_controller`), and a room of the tick measures it. Grammar, check, test kit,
diagram, replay and firmware go by the declaration.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import NamedTuple

from twin_gait.parameters.quantities import DEGREE

OTHER = "other."  # in front of a signal of the other leg
LEFT, RIGHT = "left.", "right."  # in front of a signal of a leg, for the supervisor

HIGHEST_LOAD = 2.0  # [body weight]: walking loads a foot with 1.2 at most, running with 2 to 3
LONGEST_STAY = 3600.0  # [s], for a phase without a time-out
# [rad] / [s]: an assumption; the knee reaches 400 deg/s in the swing of a normal walk.
HIGHEST_VELOCITY = 500.0 * DEGREE


class Scope(Enum):
    """What has a signal of its own: each joint, each leg, or the device as a whole."""

    JOINT = "joint"
    LEG = "leg"
    DEVICE = "device"


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


class Known(NamedTuple):
    """What a check knows of the device."""

    # lowest and highest angle of each joint, and of what else turns, in [rad]
    limits: Mapping[str, tuple[float, float]]
    speeds: Mapping[str, float]  # highest ones in [rad] / [s], where they are known


# Lowest and highest value in SI, by what is known and what it belongs to: a joint, or a part of the device.
Range = Callable[[Known, str], tuple[float, float]]


@dataclass(frozen=True)
class Signal:
    """A signal of guards."""

    name: str  # in a table; of a joint what follows its name and a point
    scope: Scope  # what has one of its own
    unit: Unit  # of its values in a table; what is measured is in SI
    words: str  # in a diagram, behind what it belongs to
    range: Range  # what it can be at all
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


def _limits(known: Known, part: str) -> tuple[float, float]:
    return known.limits[part]


def _speeds(known: Known, joint: str) -> tuple[float, float]:
    highest = known.speeds.get(joint, HIGHEST_VELOCITY)
    return -highest, highest


def _between(low: float, high: float) -> Range:
    return lambda known, part: (low, high)


ANGLE = Signal("angle_deg", Scope.JOINT, DEGREES, "", _limits, noise=0.5, room=1.0)
VELOCITY = Signal("velocity_deg_per_s", Scope.JOINT, DEGREES_PER_SECOND, " velocity", _speeds, 5.0, 5.0)
LOAD = Signal("foot.load_bw", Scope.LEG, BODY_WEIGHTS, " load", _between(0.0, HIGHEST_LOAD), 0.02, 0.05)
TIME_IN_PHASE = Signal(
    "time_in_phase_s", Scope.LEG, SECONDS, "time in phase", _between(0.0, LONGEST_STAY), room=0.01
)
TRUNK_PITCH = Signal(
    "trunk.pitch_deg",
    Scope.DEVICE,
    DEGREES,
    " pitch",
    _limits,
    noise=0.5,
    room=1.0,
    first=0.0,
    field="trunk_pitch",
    column="measured_trunk_pitch_rad",
)
WALK = Signal(  # what the legs are told: 1 to walk, 0 to stand
    "walk", Scope.DEVICE, NO_UNIT, "told to walk", _between(0.0, 1.0), room=0.25, first=1.0, field="walk"
)
STEP = Signal(  # likewise: 1 to take a step, 0 to wait for one
    "step", Scope.DEVICE, NO_UNIT, "told to step", _between(0.0, 1.0), room=0.25, first=1.0, field="step"
)
LEGS_IN_SWING = Signal(  # of the supervisor alone
    "legs_in_swing", Scope.DEVICE, NO_UNIT, "legs in swing", _between(0.0, 2.0), room=0.25, first=0.0
)

# In the order of the list of signals: joint by joint, then of the leg; all of the other leg; of the device.
SIGNALS = (ANGLE, VELOCITY, LOAD, TIME_IN_PHASE, TRUNK_PITCH, WALK, STEP)
JOINT_SIGNALS, LEG_SIGNALS, DEVICE_SIGNALS = (
    tuple(signal for signal in SIGNALS if signal.scope is scope) for scope in Scope
)
DEVICE_NAMES = tuple(signal.name for signal in DEVICE_SIGNALS)  # both legs read the same
TIME, OTHER_TIME = TIME_IN_PHASE.name, OTHER + TIME_IN_PHASE.name
MODE_SIGNALS = (TIME_IN_PHASE, TRUNK_PITCH, LEGS_IN_SWING)  # of the supervisor, behind those of both legs


def signal_names(joints: Sequence[str]) -> list[str]:
    """Signals of one leg in the order of the list of signals."""
    names = [signal.of(joint) for joint in joints for signal in JOINT_SIGNALS]
    return names + [signal.name for signal in LEG_SIGNALS]


def all_signal_names(joints: Sequence[str]) -> list[str]:
    """Signals of this leg, the other, then the device: their positions index the guard program."""
    own = signal_names(joints)
    return [*own, *(OTHER + name for name in own), *DEVICE_NAMES]


def mode_signal_names(joints: Sequence[str]) -> list[str]:
    """Signals of the left leg, of the right one, then of the supervisor, in the order of its list."""
    own = signal_names(joints)
    legs = [side + name for side in (LEFT, RIGHT) for name in own]
    return [*legs, *(signal.name for signal in MODE_SIGNALS)]


@cache
def signal_of(name: str) -> Signal:
    """Declaration of a signal by its name in a table, which may have further words in front."""
    known = (signal for signal in (*SIGNALS, LEGS_IN_SWING) if f".{name}".endswith(f".{signal.name}"))
    return max(known, key=lambda signal: len(signal.name))  # a leg's name may end in a joint's


def part_of(name: str) -> str:
    """What a signal belongs to by its name: a joint, the foot, a part of the device; empty for none."""
    return f"..{name}".rsplit(".", 2)[1]


def device_parts() -> list[str]:
    """Parts of the device that have signals."""
    return [part for part in dict.fromkeys(map(part_of, DEVICE_NAMES)) if part]


def is_device(name: str) -> bool:
    """Whether both legs read the same signal."""
    return signal_of(name).scope is Scope.DEVICE


def signal_scale(name: str) -> float:
    """Factor from the unit in a signal's name to SI."""
    return signal_of(name).unit.factor
