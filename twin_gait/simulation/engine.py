"""What the engines share: a run in chunks, the shape of its result, and the columns of its log."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from twin_gait.control import Trip, TripCause
from twin_gait.gait.machine import POSTURE, PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.network.bus import MEASUREMENT, SETPOINT
from twin_gait.parameters import NODES
from twin_gait.simulation.episode import DIVERGED, FELL, LET_GO, TIPPED, Switch
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import RunStatus

SWITCHES = dtype_of(Switch(0, 0, 0, 0, 0))
_BUS_UNIT = 1e-12  # what a bus counts in, in [s]


class FrameTraffic(NamedTuple):
    """What became of a frame that is sent in every cycle."""

    name: str  # For example ``left_hip_setpoint``.
    mean_age_s: float  # Mean time in [s] since its sender wrote what its receiver goes by, over all ticks.
    oldest_s: float  # Longest of them in [s].
    sent: int  # How many its sender believes to have sent.
    lost: int  # Of these, those that did not arrive.
    replaced: int  # Those that a newer one took the place of before they were sent.
    destroyed: int  # Transmissions that ended in an error frame.
    worst_response_s: float  # Longest time from the instant at which one was due to its arrival in [s].


class BusTraffic(NamedTuple):
    """What a bus has carried in a run, and how old what its receivers went by was."""

    load: float  # Share of the time in which it was in use.
    bus_offs: Mapping[str, int]  # How often each node went bus-off.
    frames: tuple[FrameTraffic, ...]  # Set points, then measurements.


class EngineResult(NamedTuple):
    """Result of an engine."""

    rows: np.ndarray  # Log numbers, shape ``(n_ticks, n_columns)``.
    switches: tuple[PhaseSwitch, ...]  # Phase switches.
    status: RunStatus  # How the run ended.
    reason: str  # Why, if it did not complete.
    trip: Trip | None = None  # What the safety monitor tripped on, or None.
    traffic: BusTraffic | None = None  # Of the bus, or None without one.


class EpisodeEngine(ABC):
    """Runs one problem from start to end.

    Attributes:
        chunk_ticks: Between two looks at progress and interruption.
        problem: The experiment as an engine needs it.
        state: The record of the episode, its fields as attributes, to be read.
        layout: Names and positions of the log's columns.
        switches: Room for the switches of the phases.
    """

    chunk_ticks: ClassVar[int]
    state: Any
    switches: np.ndarray

    def __init__(self, problem: Problem) -> None:
        """Find the columns of the log."""
        self.problem = problem
        self.layout = log_layout(problem)

    @abstractmethod
    def run_ticks(self, first: int, end: int, rows: np.ndarray, first_row: int = 0) -> int:
        """Run ticks ``first`` to ``end`` - 1, fewer if the wearer falls or the state diverges on the way.

        ``rows``: log, shape ``(n, n_columns)``, whose first row is that of tick ``first_row``; changed in
        place. Returns the ticks run since the start.
        """

    def run(
        self,
        progress: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
        columns: Sequence[int] | None = None,
        run_tick: Callable[[int, int, np.ndarray, int], int] | None = None,
    ) -> EngineResult:
        """Run to the end of the experiment, or to a fall, divergence or a request to stop.

        ``progress`` is called with ticks done and in all, ``should_stop`` asked now and then. ``columns``:
        positions of the columns of the log that are kept; all by default. ``run_tick``: runs a single tick in
        place of :meth:`run_ticks`.
        """
        run_ticks, chunk = (self.run_ticks, self.chunk_ticks) if run_tick is None else (run_tick, 1)
        width, record = len(self.layout.names), bool(self.state.recording.on)
        kept = range(width) if columns is None else columns
        total, done, ended = self.problem.experiment.n_ticks, 0, (RunStatus.COMPLETED, "")
        # Everybody reads columns: each chunk is turned round while the cache still holds it.
        table, rows = np.empty((len(kept), total if record else 0)), np.zeros((chunk if record else 1, width))
        while done < total and ended[0] is RunStatus.COMPLETED:
            if progress is not None:
                progress(done, total)
            if should_stop is not None and should_stop():
                ended = RunStatus.INTERRUPTED, f"stopped at {done * TICK:.3f} s"
                break
            first, done = done, run_ticks(done, min(done + chunk, total), rows, done)
            ended = self.ending(done)
            if record:
                for place, column in enumerate(kept):
                    table[place, first:done] = rows[: done - first, column]
        if progress is not None:
            progress(done, total)
        return self.result(done, table[:, :done].T, ended)

    def result(self, done: int, rows: np.ndarray, ended: tuple[RunStatus, str] | None = None) -> EngineResult:
        """The result of a run of some ticks; ``ended``: how, where it has not ended by itself."""
        switches, ended = self.phase_switches(), ended or self.ending(done)
        return EngineResult(rows, switches, *ended, self.trip(), self._traffic(done))

    def ending(self, done: int) -> tuple[RunStatus, str]:
        """How the run stands after some ticks, and why; completed as long as nothing has ended it."""
        world, status, when = self.problem.world, int(self.state.status), f"at {done * TICK:.3f} s"
        lean, reach = math.degrees(world.fall_pitch), world.longest_reach
        reasons = {
            DIVERGED: f"the state diverged {when}; try a smaller integration step",
            FELL: f"the pelvis fell below {world.fall_height:.2f} m {when}",
            TIPPED: f"the trunk leaned by more than {lean:.0f} deg {when}",
            LET_GO: f"a hand let go of its crutch, more than {reach:.2f} m from the shoulder {when}",
        }
        if status not in reasons:
            return RunStatus.COMPLETED, ""
        return RunStatus.DIVERGED if status == DIVERGED else RunStatus.FELL, reasons[status]

    def phase_switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Switches of the phases so far, from one of them on."""
        names, sides = self.problem.table.phase_names, self.problem.sides
        happened = int(self.state.recording.n_switches)
        causes = [*(item.cause for item in self.problem.table.transitions), POSTURE]  # that of transition -1
        return tuple(
            PhaseSwitch(tick, sides[leg], names[source], names[target], causes[chosen], chosen)
            for tick, leg, source, target, chosen in self.switches[first:happened].tolist()
        )

    def trip(self) -> Trip | None:
        """What the safety monitor has tripped on, or None."""
        trip, joints, sides = self.state.controller.trip, self.problem.joints, self.problem.sides
        tick, place, side, joint = int(trip.tick), int(trip.part), None, None
        if tick < 0:
            return None
        if place >= len(joints):  # behind the joints are the legs
            side = sides[place - len(joints)]
        elif place >= 0:  # below is the supply
            side, joint = joints[place].side, joints[place].joint
        return Trip(tick, list(TripCause)[int(trip.cause)], side, joint)

    def _traffic(self, ticks: int) -> BusTraffic | None:
        """Counts of the bus in a run of at least 1 tick; None without one."""
        if self.problem.experiment.network is None:
            return None
        network, bus = self.state.network, self.state.network.bus
        frames = tuple(
            _frame_traffic(f"{joint.side}_{joint.joint}_{kind}", wire, bus.frames[int(wire.frame)], ticks)
            for kind, wires in ((SETPOINT, network.setpoints), (MEASUREMENT, network.measurements))
            for joint, wire in zip(self.problem.joints, wires, strict=True)
        )
        bus_offs = {name: int(node.bus_offs) for name, node in zip(NODES, bus.nodes, strict=True)}
        return BusTraffic(float(bus.busy) / (ticks * float(bus.tick)), bus_offs, frames)


def _frame_traffic(name: str, wire: Any, frame: Any, ticks: int) -> FrameTraffic:
    return FrameTraffic(
        name,
        mean_age_s=TICK * int(wire.ages) / ticks,
        oldest_s=TICK * int(wire.oldest),
        sent=int(frame.sent),
        lost=int(frame.lost),
        replaced=int(frame.replaced),
        destroyed=int(frame.destroyed),
        worst_response_s=_BUS_UNIT * int(frame.worst_response),
    )
