"""The signals that guards read, each declared once.

A new signal is declared here; the gait controller stores and writes it
(:mod:`twin_gait.control.gait_controller`), and a step of the tick measures it. Grammar, check, test kit,
diagram, replay and firmware read the declaration.
"""

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

from twin_gait.parameters.quantities import DEGREE

OTHER = "other."  # Prefix of a signal of the other leg.
LEFT, RIGHT = "left.", "right."  # Prefix of a signal of a leg, for the supervisor.

HIGHEST_LOAD = 2.0  # Load in body weights: walking loads a foot with 1.2 at most, running with 2 to 3.
LONGEST_STAY = 3600.0  # Longest time in [s] in a phase without a timeout.
# Velocity in [rad/s], an assumption; the knee reaches 400 deg/s in the swing of a normal walk.
HIGHEST_VELOCITY = 500.0 * DEGREE


class SignalUnit(NamedTuple):
    """Unit of values in a table."""

    name: str  # Name in messages.
    symbol: str  # Symbol after a number in a diagram.
    factor: float = 1.0  # Factor to SI.


DEGREES = SignalUnit("deg", "°", DEGREE)
DEGREES_PER_SECOND = SignalUnit("deg/s", "°/s", DEGREE)
BODY_WEIGHTS = SignalUnit("body weights", " BW")
SECONDS = SignalUnit("s", " s")
NO_UNIT = SignalUnit("no unit", "")


@dataclass(frozen=True)
class Signal:
    """Declaration of a signal of guards."""

    name: str  # Name in a table; for a joint the part after the joint's name and a point.
    unit: SignalUnit  # Unit of its values in a table; measured values are in SI.
    label: str  # Label in a diagram, after the name of its part.
    # Lowest and highest possible value in SI; None if stops and motors determine them.
    range: tuple[float, float] | None
    # Change from tick to tick due to noise, in the unit of the table: an assumption. The encoder's resolution
    # is far finer (0.0004° of the joint); vibrations of cuffs, gears and the foot on the belt are larger.
    noise: float = 0.0
    # Distance from a threshold, in the unit of the table, that the test kit keeps if possible.
    margin: float = 0.0
    initial_value: float = math.nan  # Value before the first measurement, in SI; a guard with NaN is false.
    field: str = ""  # Field of the gait controller's record of a signal of the device.
    # Column of a log, in SI, from which a replay reads a signal of the device; without one the signal keeps
    # its initial value. The mapping of angles and loads to columns is defined in the replay's reader.
    column: str = ""

    def joint_signal_name(self, joint: str) -> str:
        """Return its name in a table for a joint."""
        return f"{joint}.{self.name}"


ANGLE = Signal("angle_deg", DEGREES, "", None, noise=0.5, margin=1.0)
VELOCITY = Signal("velocity_deg_per_s", DEGREES_PER_SECOND, " velocity", None, noise=5.0, margin=5.0)
LOAD = Signal("foot.load_bw", BODY_WEIGHTS, " load", (0.0, HIGHEST_LOAD), noise=0.02, margin=0.05)
TIME_IN_PHASE = Signal("time_in_phase_s", SECONDS, "time in phase", (0.0, LONGEST_STAY), margin=0.01)
TRUNK_PITCH = Signal(
    "trunk.pitch_deg",
    DEGREES,
    " pitch",
    None,
    noise=0.5,
    margin=1.0,
    initial_value=0.0,
    field="trunk_pitch",
    column="measured_trunk_pitch_rad",
)
# Commands for the legs: 1 to walk, 0 to stand; 1 to take a step, 0 to wait for one.
WALK = Signal("walk", NO_UNIT, "walk command", (0.0, 1.0), margin=0.25, initial_value=1.0, field="walk")
STEP = Signal("step", NO_UNIT, "step command", (0.0, 1.0), margin=0.25, initial_value=1.0, field="step")
LEGS_IN_SWING = Signal("legs_in_swing", NO_UNIT, "legs in swing", (0.0, 2.0), margin=0.25, initial_value=0.0)

JOINT_SIGNALS = (ANGLE, VELOCITY)  # Signals of each joint.
LEG_SIGNALS = (LOAD, TIME_IN_PHASE)  # Signals of each leg.
DEVICE_SIGNALS = (TRUNK_PITCH, WALK, STEP)  # Signals of the device, which both legs read.
DEVICE_NAMES = tuple(signal.name for signal in DEVICE_SIGNALS)
SIGNALS = (*JOINT_SIGNALS, *LEG_SIGNALS, *DEVICE_SIGNALS)
TIME, OTHER_TIME = TIME_IN_PHASE.name, OTHER + TIME_IN_PHASE.name
MODE_SIGNALS = (TIME_IN_PHASE, TRUNK_PITCH, LEGS_IN_SWING)  # Signals of the supervisor, after both legs.


def signal_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the signals of one leg in the order of the list of signals: joint by joint, then of the leg."""
    names = (signal.joint_signal_name(joint) for joint in joints for signal in JOINT_SIGNALS)
    return (*names, *(signal.name for signal in LEG_SIGNALS))


@lru_cache(maxsize=32)  # Each guard of a table is checked against them.
def all_signal_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the signals of this leg, the other, then the device: their positions index the guard program."""
    names = signal_names(joints)
    return (*names, *(OTHER + name for name in names), *DEVICE_NAMES)


@lru_cache(maxsize=32)
def mode_signal_names(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the signals of the left leg, of the right one, then of the supervisor, as in its list."""
    names = signal_names(joints)
    legs = (side + name for side in (LEFT, RIGHT) for name in names)
    return (*legs, *(signal.name for signal in MODE_SIGNALS))


@cache
def find_signal(name: str) -> Signal:
    """Return the declaration of a signal by its name in a table, which may have a prefix."""
    known = (signal for signal in (*SIGNALS, LEGS_IN_SWING) if f".{name}".endswith(f".{signal.name}"))
    return max(known, key=lambda signal: len(signal.name))  # A leg signal's name may end in a joint signal's.


def signal_part(name: str) -> str:
    """Return the part of a signal from its name: a joint, the foot, a part of the device; empty for none."""
    return f"..{name}".rsplit(".", 2)[1]


def signal_scale(name: str) -> float:
    """Return the factor from the unit of a signal in a table to SI."""
    return find_signal(name).unit.factor
