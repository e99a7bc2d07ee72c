"""What a bus has carried in a run, and how old what its receivers went by was."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from twin_gait.gait.table import TICK
from twin_gait.network.bus import MEASUREMENT, SETPOINT
from twin_gait.parameters import NODES
from twin_gait.simulation.problem import Problem

_SECOND = 1e-12  # what the bus counts in, in [s]


class FrameTraffic(NamedTuple):
    """What became of a frame that is sent in every cycle."""

    name: str  # For example ``left_hip_setpoint``.
    mean_age: float  # Mean time in [s] since its sender wrote what its receiver goes by, over all ticks.
    oldest: float  # Longest of them in [s].
    sent: int  # How many its sender believes to have sent.
    lost: int  # Of these, those that did not arrive.
    replaced: int  # Those that a newer one took the place of before they were sent.
    destroyed: int  # Transmissions that ended in an error frame.
    worst_response: float  # Longest time from the instant at which one was due to its arrival in [s].


class BusTraffic(NamedTuple):
    """What a bus has carried."""

    load: float  # Share of the time in which it was in use.
    bus_offs: Mapping[str, int]  # How often each node went bus-off.
    frames: tuple[FrameTraffic, ...]  # Set points, then measurements.


def bus_traffic(problem: Problem, episode: Any, ticks: int) -> BusTraffic | None:
    """Read the counts of a run of at least 1 tick from its record, plain or NumPy's; None without a bus."""
    if problem.experiment.network is None:
        return None
    network = episode.network
    bus, boards = network.bus, [f"{joint.side}_{joint.joint}" for joint in problem.joints]
    frames = tuple(
        _frame(f"{board}_{kind}", wire, bus.frames[int(wire.frame)], ticks)
        for kind, wires in ((SETPOINT, network.setpoints), (MEASUREMENT, network.measurements))
        for board, wire in zip(boards, wires, strict=True)
    )
    bus_offs = {name: int(node.bus_offs) for name, node in zip(NODES, bus.nodes, strict=True)}
    return BusTraffic(float(bus.busy) / (ticks * float(bus.tick)), bus_offs, frames)


def _frame(name: str, wire: Any, frame: Any, ticks: int) -> FrameTraffic:
    return FrameTraffic(
        name,
        mean_age=TICK * int(wire.ages) / ticks,
        oldest=TICK * int(wire.oldest),
        sent=int(frame.sent),
        lost=int(frame.lost),
        replaced=int(frame.replaced),
        destroyed=int(frame.destroyed),
        worst_response=_SECOND * int(frame.worst_response),
    )
