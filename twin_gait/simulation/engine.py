"""Base class of the engines: a run in chunks, and its switches, status, trip and bus traffic."""

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
from twin_gait.network.bus import nodes_of
from twin_gait.network.messages import MEASUREMENT_SUFFIX, SETPOINT_SUFFIX
from twin_gait.simulation.episode import COMPLETED, CRUTCH_LOST, DIVERGED, FELL, TIPPED, Switch
from twin_gait.simulation.log import LogArrays, log_layout
from twin_gait.simulation.record import dtype_of
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulation_setup import SimulationSetup

SWITCHES = dtype_of(Switch(0, 0, 0, 0, 0))
_BUS_UNIT = 1e-12  # Unit of time of the bus in [s].


class EpisodeEngine(ABC):
    """Engine that runs one simulation setup from start to end.

    Attributes:
        chunk_ticks: Ticks between two checks for progress and interruption.
        setup: Simulation setup.
        episode: Record of the episode.
        state: Record of the episode with its fields as attributes, for reading.
        layout: Names and positions of the log's columns.
        switches: Buffer for the switches of the phases.
    """

    chunk_ticks: ClassVar[int]
    scripted: ClassVar[bool] = False  # Whether the engine executes the events of an experiment.
    episode: Any
    state: Any
    switches: np.ndarray

    def __init__(self, setup: SimulationSetup) -> None:
        """Determine the columns of the log; raises ParameterError for events that it does not execute."""
        if setup.experiment.events and not self.scripted:
            way_out = "keep engine and controller, or leave the events out with --set events=[]"
            raise ParameterError(f"events: only simulate executes them, in the compiled engine; {way_out}")
        self.setup = setup
        self.layout = log_layout(setup)

    @abstractmethod
    def run_ticks(self, first: int, end: int, rows: np.ndarray, first_row: int = 0) -> int:
        """Run ticks ``first`` to ``end`` - 1, fewer if the wearer falls or the state diverges earlier.

        ``rows``: log of shape ``(n, n_columns)`` whose first row belongs to tick ``first_row``; changed in
        place. Returns the number of ticks since the start.
        """

    def run(
        self,
        progress: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
        columns: Sequence[int] | None = None,
        run_tick: Callable[[int, int, np.ndarray, int], int] | None = None,
    ) -> Run:
        """Run to the end of the experiment, or to a fall, a divergence or a request to stop.

        ``progress`` is called with the ticks done and the total number of ticks, ``should_stop`` before each
        chunk. ``columns``: positions of the columns of the log that are kept; all by default. ``run_tick``:
        runs a single tick in place of :meth:`run_ticks`.
        """
        began = time.perf_counter()
        run_ticks, chunk = (self.run_ticks, self.chunk_ticks) if run_tick is None else (run_tick, 1)
        width, record = len(self.layout.names), bool(self.number("recording", "on"))
        kept = range(width) if columns is None else columns
        total, done, stopped = self.setup.experiment.n_ticks, 0, False
        # The log is read by columns: each chunk is transposed while it is still in the cache.
        table, rows = np.empty((len(kept), total if record else 0)), np.zeros((chunk if record else 1, width))
        while done < total and self.status_after(done)[0] is RunStatus.COMPLETED:
            if progress is not None:
                progress(done, total)
            stopped = should_stop is not None and should_stop()
            if stopped:
                break
            first, done = done, run_ticks(done, min(done + chunk, total), rows, done)
            if record:
                for index, column in enumerate(kept):
                    table[index, first:done] = rows[: done - first, column]
        if progress is not None:
            progress(done, total)
        run = self.build_run(done, table, columns, time.perf_counter() - began)
        if stopped:
            return replace(run, status=RunStatus.INTERRUPTED, reason=f"stopped at {done * TICK:.3f} s")
        return run

    def build_run(self, done: int, log: np.ndarray, columns: Sequence[int] | None, wall_s: float) -> Run:
        """Return the run of the first ``done`` ticks.

        ``log``: shape ``(n_columns, n)``. ``columns``: see :meth:`run`. ``wall_s``: wall-clock time in [s].
        """
        problem, (status, reason), names = self.setup, self.status_after(done), self.layout.names
        kept = names if columns is None else [names[index] for index in columns]
        return Run(
            experiment=problem.experiment,
            table=problem.table,
            own_table=problem.own_table,
            log=LogArrays(log[:, :done], kept, problem.table.phase_names, problem.own_phase_names),
            switches=self.phase_switches(),
            status=status,
            reason=reason,
            wall_s=wall_s,
            body_weight=problem.world.body_weight,
            trip=self.trip(),
            traffic=self._traffic(max(1, done)),
        )

    def number(self, *path: str) -> int:
        """Return an integer of the record; ``path``: names of the nested fields that lead to it.

        Access to a field of a NumPy record by its name is ten times as fast as by an attribute.
        """
        found = self.episode
        for name in path:
            found = found[name] if isinstance(found, np.void) else getattr(found, name)
        return int(found)

    def status_after(self, done: int) -> tuple[RunStatus, str]:
        """Return status and reason after ``done`` ticks; completed if the run has not ended early."""
        status = self.number("status")
        if status == COMPLETED:
            return RunStatus.COMPLETED, ""
        world, when = self.setup.world, f"at {done * TICK:.3f} s"
        lean, reach = math.degrees(world.fall_pitch), world.max_reach
        reasons = {
            DIVERGED: f"the state diverged {when}; try a smaller integration step",
            FELL: f"the pelvis fell below {world.fall_height:.2f} m {when}",
            TIPPED: f"the trunk leaned by more than {lean:.0f} deg {when}",
            CRUTCH_LOST: f"a hand lost its crutch, more than {reach:.2f} m from the shoulder {when}",
        }
        return RunStatus.DIVERGED if status == DIVERGED else RunStatus.FELL, reasons[status]

    def phase_switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Return the switches of the phases so far, beginning with the one of index ``first``."""
        names, sides = self.setup.table.phase_names, self.setup.sides
        happened = self.number("recording", "n_switches")
        causes = [*(item.cause for item in self.setup.table.transitions), POSTURE]  # last for transition -1
        found = [
            PhaseSwitch(tick, sides[leg], names[source], names[target], causes[chosen], chosen)
            for tick, leg, source, target, chosen in self.switches[first:happened].tolist()
        ]
        return tuple(found)

    def trip(self) -> Trip | None:
        """Return the trip of the safety monitor with its tick, cause and place, or None."""
        tick = self.number("controller", "trip", "tick")
        if tick < 0:
            return None
        trip, joints, sides = self.state.controller.trip, self.setup.joints, self.setup.sides
        part, side, joint = int(trip.part), None, None
        if part >= len(joints):  # the legs follow the joints
            side = sides[part - len(joints)]
        elif part >= 0:  # a negative number is the supply
            side, joint = joints[part].side, joints[part].joint
        return Trip(tick, list(TripCause)[int(trip.cause)], side, joint)

    def _traffic(self, ticks: int) -> dict[str, Any] | None:
        """Return the bus traffic of a run of at least 1 tick for the summary; None without a bus."""
        if self.setup.experiment.network is None:
            return None
        network, bus, frames = self.state.network, self.state.network.bus, {}
        # Frames that the sender counts as sent, sent frames that did not arrive, payloads that a newer one
        # replaced before they were sent, and transmissions that ended in error frames.
        counts = "sent", "lost", "replaced", "destroyed"
        for kind, channels in (
            (SETPOINT_SUFFIX, network.setpoints),
            (MEASUREMENT_SUFFIX, network.measurements),
        ):
            for joint, channel in zip(self.setup.joints, channels, strict=True):
                frame = bus.frames[int(channel.frame)]
                frames[f"{joint.side}_{joint.joint}_{kind}"] = {
                    # Age of the values that the receiver uses, since the sender wrote them, over all ticks.
                    "mean_age_s": TICK * int(channel.age_sum) / ticks,
                    "max_age_s": TICK * int(channel.max_age),
                    **{name: int(getattr(frame, name)) for name in counts},
                    # Time from the instant at which a frame was due to its arrival.
                    "max_response_s": _BUS_UNIT * int(frame.worst_response),
                }
        totals = {key: sum(frame[key] for frame in frames.values()) for key in ("sent", "lost", "destroyed")}
        nodes = nodes_of([f"{joint.side}_{joint.joint}" for joint in self.setup.joints])
        bus_offs = {name: int(node.bus_offs) for name, node in zip(nodes, bus.nodes, strict=True)}
        load = float(bus.busy) / (ticks * float(bus.tick))  # share of the time in which the bus is busy
        return {"bus_load": load, **totals, "bus_offs": bus_offs, "frames": frames}
