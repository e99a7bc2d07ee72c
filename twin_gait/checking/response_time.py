"""Worst-case response times on a CAN bus: the exact analysis of Davis, Burns, Bril and Lukkien (2007).

Controller Area Network (CAN) schedulability analysis: refuted, revisited and revised, Real-Time Systems
35:239. Frames are sent in the order of their identifiers and not interrupted; each node offers the lowest of
its waiting ones. All times are whole numbers of one unit, here [ps], so that nothing is rounded.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple


class CyclicFrame(NamedTuple):
    """A frame as the analysis sees it."""

    transmission: int  # longest time on the wire C, interframe space included
    period: int  # shortest time T between two of its events
    jitter: int = 0  # longest time J from an event until the frame is queued


def bus_load(frames: Sequence[CyclicFrame]) -> Fraction:
    r"""Share of its time in which the bus is in use at most, :math:`\sum C_m / T_m`."""
    return sum((Fraction(frame.transmission, frame.period) for frame in frames), Fraction(0))


def response_times(frames: Sequence[CyclicFrame], bit: int) -> list[int | None]:
    r"""Longest times from an event to the end of its frame.

    With :math:`B_m` the longest transmission of a lower priority, over the instances
    :math:`q = 0 \dots Q_m - 1` of the busy period :math:`t_m`:

    .. math::

        t_m &= B_m + \sum_{k \le m} \left\lceil \frac{t_m + J_k}{T_k} \right\rceil C_k, \qquad
        Q_m = \left\lceil \frac{t_m + J_m}{T_m} \right\rceil

        w_m(q) &= B_m + q\,C_m + \sum_{k < m} \left\lceil \frac{w_m + J_k + \tau_{bit}}{T_k} \right\rceil C_k

        R_m &= \max_q\; J_m + w_m(q) - q\,T_m + C_m

    ``frames``: the highest priority first. ``bit``: length :math:`\tau_{bit}` of a bit, within which nodes
    begin at the same time. Returns :math:`R_m` of each frame; None where frames of its priority and above
    fill the bus.
    """
    return [_response_time(frames, number, bit) for number in range(len(frames))]


def _response_time(frames: Sequence[CyclicFrame], number: int, bit: int) -> int | None:
    frame, higher = frames[number], frames[:number]
    blocking = max((other.transmission for other in frames[number + 1 :]), default=0)
    if bus_load(frames[: number + 1]) >= 1:
        return None
    busy = _settled(frame.transmission, blocking, [*higher, frame], 0)
    instances = -(-(busy + frame.jitter) // frame.period)
    longest, waiting = 0, 0
    for instance in range(instances):
        waiting = _settled(waiting, blocking + instance * frame.transmission, higher, bit)
        longest = max(longest, frame.jitter + waiting - instance * frame.period + frame.transmission)
    return longest


def _settled(start: int, constant: int, frames: Sequence[CyclicFrame], bit: int) -> int:
    """The least fixed point above a start of what frames with a constant take."""
    time, longer = start, -1
    while time != longer:
        longer = time
        time = constant + sum(
            -(-(longer + item.jitter + bit) // item.period) * item.transmission for item in frames
        )
    return time
