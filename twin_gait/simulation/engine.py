"""What the engines share: a run in chunks, and how it stands: switches, ending, trip, traffic of the bus."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from twin_gait.control.safety import Trip, TripCause
from twin_gait.exceptions import ParameterError
from twin_gait.gait.machine import POSTURE, PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.network.bus import MEASUREMENT_SUFFIX, SETPOINT_SUFFIX
from twin_gait.parameters.network import NODES
from twin_gait.simulation.episode import COMPLETED, CRUTCH_LOST, DIVERGED, FELL, TIPPED, Switch
from twin_gait.simulation.log import LogArrays, log_layout
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulation_setup import SimulationSetup

SWITCHES = dtype_of(Switch(0, 0, 0, 0, 0))
_BUS_UNIT = 1e-12  # what a bus counts in, in [s]


class EpisodeEngine(ABC):
    """Runs one problem from start to end.

    Attributes:
        chunk_ticks: Between two looks at progress and interruption.
        problem: The experiment as an engine needs it.
        episode: The record.
        state: The record of the episode, its fields as attributes, to be read.
        layout: Names and positions of the log's columns.
        switches: Room for the switches of the phases.
    """

    chunk_ticks: ClassVar[int]
    scripted: ClassVar[bool] = False  # whether it executes the events of an experiment
    episode: Any
    state: Any
    switches: np.ndarray

    def __init__(self, setup: SimulationSetup) -> None:
        """Find the columns of the log; ParameterError for events that the engine does not execute."""
        if setup.experiment.events and not self.scripted:
            way_out = "leave engine and controller as they are, or leave the events out with --set events=[]"
            raise ParameterError(f"events: only simulate executes them, in the compiled engine; {way_out}")
        self.setup = setup
        self.layout = log_layout(setup)

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
    ) -> Run:
        """Run to the end of the experiment, or to a fall, divergence or a request to stop.

        ``progress`` is called with ticks done and in all, ``should_stop`` asked now and then. ``columns``:
        positions of the columns of the log that are kept; all by default. ``run_tick``: runs a single tick in
        place of :meth:`run_ticks`.
        """
        began = time.perf_counter()
        run_ticks, chunk = (self.run_ticks, self.chunk_ticks) if run_tick is None else (run_tick, 1)
        width, record = len(self.layout.names), bool(self.number("recording", "on"))
        kept = range(width) if columns is None else columns
        total, done, stopped = self.setup.experiment.n_ticks, 0, False
        # Everybody reads columns: each chunk is turned round while the cache still holds it.
        table, rows = np.empty((len(kept), total if record else 0)), np.zeros((chunk if record else 1, width))
        while done < total and self.status_after(done)[0] is RunStatus.COMPLETED:
            if progress is not None:
                progress(done, total)
            stopped = should_stop is not None and should_stop()
            if stopped:
                break
            first, done = done, run_ticks(done, min(done + chunk, total), rows, done)
            if record:
                for place, column in enumerate(kept):
                    table[place, first:done] = rows[: done - first, column]
        if progress is not None:
            progress(done, total)
        run = self.build_run(done, table, columns, time.perf_counter() - began)
        if stopped:
            return replace(run, status=RunStatus.INTERRUPTED, reason=f"stopped at {done * TICK:.3f} s")
        return run

    def build_run(self, done: int, log: np.ndarray, columns: Sequence[int] | None, wall_s: float) -> Run:
        """The run of some ticks, whose log has shape ``(n_columns, n)``; ``columns`` as in :meth:`run`."""
        problem, (status, reason), names = self.setup, self.status_after(done), self.layout.names
        kept = names if columns is None else [names[place] for place in columns]
        return Run(
            experiment=problem.experiment,
            table=problem.table,
            log=LogArrays(log[:, :done], kept, problem.table.phase_names),
            switches=self.phase_switches(),
            status=status,
            reason=reason,
            wall_s=wall_s,
            body_weight=problem.world.body_weight,
            trip=self.trip(),
            traffic=self._traffic(max(1, done)),
        )

    def number(self, *path: str) -> int:
        """Return a whole number of the record by the fields on the way to it.

        A field of a NumPy record is found ten times as fast by its name as by an attribute.
        """
        found = self.episode
        for name in path:
            found = found[name] if isinstance(found, np.void) else getattr(found, name)
        return int(found)

    def status_after(self, done: int) -> tuple[RunStatus, str]:
        """How the run stands after some ticks, and why; completed as long as nothing has ended it."""
        status = self.number("status")
        if status == COMPLETED:
            return RunStatus.COMPLETED, ""
        world, when = self.setup.world, f"at {done * TICK:.3f} s"
        lean, reach = math.degrees(world.fall_pitch), world.max_reach
        reasons = {
            DIVERGED: f"the state diverged {when}; try a smaller integration step",
            FELL: f"the pelvis fell below {world.fall_height:.2f} m {when}",
            TIPPED: f"the trunk leaned by more than {lean:.0f} deg {when}",
            CRUTCH_LOST: f"a hand let go of its crutch, more than {reach:.2f} m from the shoulder {when}",
        }
        return RunStatus.DIVERGED if status == DIVERGED else RunStatus.FELL, reasons[status]

    def phase_switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Switches of the phases so far, from one of them on."""
        names, sides = self.setup.table.phase_names, self.setup.sides
        happened = self.number("recording", "n_switches")
        causes = [*(item.cause for item in self.setup.table.transitions), POSTURE]  # that of transition -1
        found = [
            PhaseSwitch(tick, sides[leg], names[source], names[target], causes[chosen], chosen)
            for tick, leg, source, target, chosen in self.switches[first:happened].tolist()
        ]
        return tuple(found)

    def trip(self) -> Trip | None:
        """What the safety monitor has tripped on, or None."""
        tick = self.number("controller", "trip", "tick")
        if tick < 0:
            return None
        trip, joints, sides = self.state.controller.trip, self.setup.joints, self.setup.sides
        place, side, joint = int(trip.part), None, None
        if place >= len(joints):  # behind the joints are the legs
            side = sides[place - len(joints)]
        elif place >= 0:  # below is the supply
            side, joint = joints[place].side, joints[place].joint
        return Trip(tick, list(TripCause)[int(trip.cause)], side, joint)

    def _traffic(self, ticks: int) -> dict[str, Any] | None:
        """What the bus has carried in a run of at least 1 tick, as a summary has it; None without one."""
        if self.setup.experiment.network is None:
            return None
        network, bus, frames = self.state.network, self.state.network.bus, {}
        # As the sender believes; by newer ones before they were sent; ended in error frames.
        counts = "sent", "lost", "replaced", "destroyed"
        for kind, wires in ((SETPOINT_SUFFIX, network.setpoints), (MEASUREMENT_SUFFIX, network.measurements)):
            for joint, wire in zip(self.setup.joints, wires, strict=True):
                frame = bus.frames[int(wire.frame)]
                frames[f"{joint.side}_{joint.joint}_{kind}"] = {
                    # Since its sender wrote what its receiver goes by, over all ticks.
                    "mean_age_s": TICK * int(wire.ages) / ticks,
                    "oldest_s": TICK * int(wire.oldest),
                    **{name: int(getattr(frame, name)) for name in counts},
                    # From the instant at which one was due to its arrival.
                    "max_response_s": _BUS_UNIT * int(frame.worst_response),
                }
        totals = {key: sum(frame[key] for frame in frames.values()) for key in ("sent", "lost", "destroyed")}
        bus_offs = {name: int(node.bus_offs) for name, node in zip(NODES, bus.nodes, strict=True)}
        load = float(bus.busy) / (ticks * float(bus.tick))  # share of the time
        return {"bus_load": load, **totals, "bus_offs": bus_offs, "frames": frames}
