"""Events of a run, and its outcome in one word and one line.

Events are faults, the trip of the safety monitor, a fall, a divergence. The outcome is the first of the
following that applies:

- *diverged*: the state was no longer finite.
- *fell*: the pelvis sank below the height of a fall, before a trip or after it.
- *held*: the safety monitor or the operator stopped the legs, and the wearer did not fall.
- *too short to judge*: a leg made no whole stride in the time in which it was to walk, and this time is too
  short for *stalled*.
- *hung*: the harness carried the wearer: both feet were off the ground for more than
  ``HIGHEST_FLIGHT_SHARE`` of the time. Walking has no time without a foot on the ground (D. A. Winter: The
  biomechanics and motor control of human gait, 2nd edition, 1991); the allowance is for feet that bounce
  on a hard belt.
- *stalled*: a leg made no stride for ``LONGEST_STRIDE``, or its settled strides differ by more than
  ``HIGHEST_STRIDE_VARIATION``. Stride times of healthy people vary by 1 to 3 %, those of people with
  Huntington's disease by some 10 % (J. M. Hausdorff: J. NeuroEng. Rehabil. 2:19, 2005; recalled); the
  limit is an assumption well beyond both. The time in which the legs wait for a step request, or in which
  the belt is at rest, does not count.
- *walked*: none of these.
"""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from twin_gait.measures.effort import share_of_ticks
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.strides import coefficient_of_variation, stride_times
from twin_gait.vocabulary import Outcome

LONGEST_STRIDE = 4.0  # [s]
HIGHEST_STRIDE_VARIATION = 0.25
HIGHEST_FLIGHT_SHARE = 0.25


class Verdict(NamedTuple):
    """Outcome of a run and the reason."""

    outcome: Outcome | None  # outcome in one word; None where no walk was requested and nothing ended the run
    reason: str = ""  # reason in one line; empty for a walk


def judge_gait(legs: Sequence[LegRecord]) -> Verdict:
    """Judge whether legs that neither fell nor were held walked.

    Only the times in which the legs are to walk evenly count, and each of them is judged separately. Returns
    a verdict with ``WALKED``, ``STALLED``, ``HUNG`` or ``TOO_SHORT``.
    """
    gaps = [_longest_without_stride(leg) for leg in legs]
    for leg, (_, longest) in zip(legs, gaps, strict=True):
        if leg.steady and longest <= LONGEST_STRIDE and not len(leg.strides(skip=0)):
            ticks = sum(
                int(leg.walking_ticks[span.stop] - leg.walking_ticks[span.start]) for span in leg.steady_ticks
            )
            text = f"the {leg.side} leg made no whole stride in {ticks * leg.tick:g} s"
            return Verdict(Outcome.TOO_SHORT, f"{text}; simulate a longer run")
    flight = flight_share(legs)
    if flight > HIGHEST_FLIGHT_SHARE:
        text = f"both feet were off the ground {100.0 * flight:.0f} % of the time"
        return Verdict(Outcome.HUNG, f"the harness carried the wearer: {text}")
    for leg, (start, longest) in zip(legs, gaps, strict=True):
        if longest > LONGEST_STRIDE:
            text = f"the {leg.side} leg began no stride for {longest:.1f} s from {start:.1f} s on"
            return Verdict(Outcome.STALLED, text)
    for leg in legs:
        variation = coefficient_of_variation(stride_times(leg.walking_ticks[leg.strides()], leg.tick))
        if variation > HIGHEST_STRIDE_VARIATION:
            text = f"no regular walk: stride times of the {leg.side} leg vary by {100.0 * variation:.0f} %"
            return Verdict(Outcome.STALLED, text)
    return Verdict(Outcome.WALKED)


def flight_share(legs: Sequence[LegRecord]) -> float:
    """Compute the share of the time in which no foot is on the ground.

    Returns the share in [0, 1] of the time in which the legs are to walk evenly; 0 without ground.
    """
    loaded = [
        np.concatenate([leg.loaded[:0], *(leg.loaded[span] for span in leg.steady_ticks)])
        for leg in legs
        if leg.loaded is not None
    ]
    if not loaded or len(loaded[0]) == 0:
        return 0.0
    return share_of_ticks(~np.any(loaded, axis=0))


def _longest_without_stride(leg: LegRecord) -> tuple[float, float]:
    """Return beginning and length in [s] of the longest interval of steady walk in which no stride begins."""
    found, events = [(0.0, 0.0)], leg.stride_events
    for span in leg.steady_ticks:
        inside = events[(events >= span.start) & (events < span.stop)]
        edges = np.concatenate(([span.start], inside, [span.stop]))
        gaps = np.diff(leg.walking_ticks[edges])
        longest = int(np.argmax(gaps))
        found.append((float(edges[longest] * leg.tick), float(gaps[longest] * leg.tick)))
    return max(found, key=itemgetter(1))


class EventKind(StrEnum):
    """Kind of an event."""

    FAULT = "fault"
    TRIP = "trip"
    FALL = "fall"
    DIVERGENCE = "divergence"


class RunEvent(NamedTuple):
    """One event of a run."""

    kind: EventKind  # kind of the event
    time: float  # time of the event in [s]; for a fall or a divergence the last instant of the log
    cause: str = ""  # kind of the fault or cause of the trip in words; empty for the other two
    location: str = ""  # affected part in words, such as ``left knee``; empty where there is none

    @property
    def text(self) -> str:
        """Text of the event, such as ``trip: encoder frozen, left knee``."""
        details = ", ".join(part for part in dict.fromkeys((self.cause, self.location)) if part)
        return f"{self.kind}: {details}" if details else str(self.kind)


def trip_time(events: Iterable[RunEvent]) -> float | None:
    """Return the time in [s] from which on the phases of a run no longer describe the motion of the legs.

    This is the time of the trip; None without one.
    """
    return next((event.time for event in events if event.kind is EventKind.TRIP), None)
