"""Events of a run: changes of its parameters, pushes, steps by hand and the emergency stop, with their times.

Faults and requests of the operating modes also have times; in an experiment they are its ``faults`` and its
``requests``, regardless of the place in its file. :mod:`twin_gait.simulation.scripted_engine` executes
events.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import GaitPhase

FADE_TICKS = 300  # Default length of the fade of a change, in ticks.
HELD_PHASE = GaitPhase.LATE_STANCE  # Phase at whose end a leg waits for a step by hand.


@dataclass(frozen=True, kw_only=True)
class Event:
    """Action on a run at the beginning of a tick."""

    tick: int  # First tick on which the event acts.
    by: str = ""  # Name of the person who caused it in a live session; empty in a script.

    def __post_init__(self) -> None:
        """Check the time."""
        require(self.tick >= 0, "time of an event", "a time of 0 s or more", self.tick)


@dataclass(frozen=True, kw_only=True)
class Change(Event):
    """New values of parameters, which fade in by the minimum-jerk law."""

    # New values in SI by their paths in :class:`twin_gait.simulation.settings.Settings`.
    changes: Mapping[str, float | str | bool] = field(default_factory=dict)
    fade_ticks: int = FADE_TICKS  # Length of the fade in ticks; 0 for a step.


@dataclass(frozen=True, kw_only=True)
class Push(Event):
    """Torque on a joint from outside. A later push of the same joint replaces an earlier one."""

    joint: str  # Joint with its leg, for example ``left_knee``.
    torque: float  # Torque in [N·m], positive towards flexion.
    duration_ticks: int  # Length of the push in ticks.


@dataclass(frozen=True, kw_only=True)
class Step(Event):
    """Release of the leg that waits for a step by hand, or of the next one that will wait."""


@dataclass(frozen=True, kw_only=True)
class Stop(Event):
    """Emergency stop: the legs are held and lowered, and the belt comes to rest."""
