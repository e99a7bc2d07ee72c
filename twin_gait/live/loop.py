"""Walk in real time: blocks of 10 ms paced by a clock, commands between them, telemetry after each.

The loop waits for nothing except its clock: it reads commands without blocking, and sends through a function
that must return immediately. The functions for time and sleep are arguments.
"""

import base64
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment.events import FADE_TICKS
from twin_gait.files import dump
from twin_gait.gait.table import TICK
from twin_gait.live.journal import LogChunk
from twin_gait.live.protocol import DeadlineStatistics, one_line
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.simulation_setup import to_ticks
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.viewer.page import event_entries
from twin_gait.worlds.faults import parse_fault

BLOCK_TICKS = 10
PERIOD = BLOCK_TICKS * TICK  # [s]
LATE = PERIOD  # [s]; a block that is finished later than this after its time counts as late
CATCH_UP = 5 * PERIOD  # [s]; a loop that is further behind skips the time instead of catching up

# Characters of the events of a walk. Beyond it, changes are rejected: its experiment file must be readable.
LONGEST_SCRIPT = 500_000

# Commands that are recorded as events; the stop, which occurs once, is never rejected for this reason.
RECORDED = ("settings", "push", "fault", "step", "request")

Command = Mapping[str, Any]


class BlockClock:
    """Clock of the blocks: the start of the next block, and the lateness of the blocks so far.

    The deadline of a block is one period after its start, which is the start of the next block. The caller
    passes the time in.
    """

    def __init__(self) -> None:
        """Begin without any block."""
        self.statistics = DeadlineStatistics()  # statistics of all blocks so far
        self._due: float | None = None  # start of the next block; None starts it at the next call of wait()

    def wait(self, now: float) -> float:
        """Return the time until the next block may begin.

        ``now``: present time in [s]. Returns the time in [s], 0 if the block is due. A loop that is more than
        ``CATCH_UP`` behind continues from now; the skipped time is counted as lost, and its blocks as late.
        """
        behind = 0.0 if self._due is None else now - self._due
        if behind > CATCH_UP:
            self.statistics.lost_s += behind
            self._count(behind, round(behind / PERIOD))
        if self._due is None or behind > CATCH_UP:
            self._due = now
        return max(0.0, self._due - now)

    def finished(self, now: float) -> None:
        """Count a block. ``now``: time in [s] at which it was finished."""
        assert self._due is not None  # wait() is called before a block is finished
        self._due += PERIOD
        self._count(max(0.0, now - self._due), 1)

    def _count(self, lateness: float, blocks: int) -> None:
        counted = self.statistics
        counted.blocks += blocks
        counted.late += blocks * (lateness > LATE)
        counted.worst_ms = max(counted.worst_ms, 1e3 * lateness)

    def pause(self) -> None:
        """Start the next block at the next call of :meth:`wait`; the time until then is not lost."""
        self._due = None


@dataclass(kw_only=True)
class LiveLoop:
    """Loop that runs one walk after the other until a command ends it; :meth:`walk` starts it."""

    run: SteppedRun  # the walk at tick 0
    now: Callable[[], float]  # returns the time in [s] of a monotonic clock
    sleep: Callable[[float], None]  # waits for a time in [s]
    commands: Callable[[], Command | None]  # returns the next command, or None, immediately
    send: Callable[[Mapping[str, Any]], None]  # sends telemetry or an answer; returns immediately
    # stores a chunk of the walk, the last one marked; returns immediately
    store_chunk: Callable[[LogChunk], None]
    clock: BlockClock = field(default_factory=BlockClock)  # deadlines of the blocks

    def __post_init__(self) -> None:
        """Begin the first walk."""
        self._longest = self.run.setup.experiment.n_ticks
        self._ended = self.paused = False
        # all changes from the preset, in the form of an event's ``set``
        self._all_changes: Mapping[str, Any] = {}
        self._begin()

    def _begin(self) -> None:
        """Begin a walk."""
        self._start_time = self.now()
        self._sent_ticks = self._switches = 0  # numbers of ticks and switches that have been sent
        self._events: list[Mapping[str, Any]] = []  # events that have not been stored
        self._script_length = 0  # number of characters of the events of this walk

    # ------------------------------------------------------------------ the loop

    def walk(self) -> None:
        """Run until a command ends the loop, or a walk reaches its longest duration."""
        while not self._ended:
            self._execute_commands()
            if self._is_advancing:
                self._run_block()
            else:
                self.clock.pause()
                self.sleep(PERIOD)
                self.send({"kind": "heartbeat"})  # otherwise, the telemetry of a block is the heartbeat
            self._ended = self._ended or self.run.tick >= self._longest
        self._store_and_send(over=True)

    @property
    def status(self) -> str:
        """Present status of the walk, as in a :class:`~twin_gait.live.protocol.Frame`."""
        if self._ended:
            return "ended"
        if self.run.status is not RunStatus.COMPLETED:
            return str(self.run.status)
        if self.run.trip is not None:
            return "held"
        if self.paused:
            return "paused"
        return "waiting" if self.run.waiting_legs() else "walking"

    @property
    def _is_advancing(self) -> bool:
        """Whether simulated time advances: also in a hold, so that the legs are lowered even in a pause."""
        return self.status in ("walking", "waiting", "held")

    def _run_block(self) -> None:
        """Wait for the next block, or run it if it is due."""
        wait, run = self.clock.wait(self.now()), self.run
        if wait > 0.0:
            self.sleep(wait)
            return  # so that commands are read first
        run.advance(min(BLOCK_TICKS - run.tick % BLOCK_TICKS, self._longest - run.tick))
        self.clock.finished(self.now())
        self._store_and_send()
        run.discard_rows(self._sent_ticks - 1)  # the last row stays available

    def _store_and_send(self, *, over: bool = False) -> None:
        """Store the next chunk of the walk, and send it with the state of the walk."""
        run, first, trip = self.run, self._sent_ticks, self.run.trip
        piece = LogChunk(
            rows=run.rows(first), switches=run.switches(self._switches), events=tuple(self._events),
            status=run.status,
            reason=run.reason,
            trip=trip,
            wall_s=self.now() - self._start_time,
            is_last=over,
        )  # fmt: skip
        self._sent_ticks, self._events = run.tick, []
        self._switches += len(piece.switches)
        self.store_chunk(piece)
        self.send(
            {"kind": "telemetry", "first": first, "tick": run.tick, "status": self.status,
             "rows": base64.b64encode(np.ascontiguousarray(piece.rows)).decode(),
             "events": event_entries(run.events), "deadlines": asdict(self.clock.statistics),
             "tripped": "" if trip is None or trip.joint is None else f"{trip.side}_{trip.joint}"}
        )  # fmt: skip

    # ------------------------------------------------------------------ commands

    def _execute_commands(self) -> None:
        """Execute the received commands, and answer them."""
        while (command := self.commands()) is not None:
            answer: dict[str, Any] = {"kind": "answer", "refused": "", "text": ""}
            try:
                answer |= self._execute(command)
            except TwinGaitError as error:
                answer["refused"] = one_line(error)
            answer.setdefault("tick", self.run.tick)  # after a restart, the tick of the new walk
            self.send(answer)
            if not self._is_advancing:  # otherwise, the next block sends the state
                self._store_and_send()

    def _execute(self, command: Command) -> dict[str, Any]:
        """Execute a command, and record it as an event; return the fields of its answer, such as ``text``."""
        name, run = command["command"], self.run
        if name in RECORDED and self._script_length > LONGEST_SCRIPT:
            raise ParameterError(f"{name}: there are too many events in one walk; restart the walk")
        if name in ("walk", "push", "fault", "step", "request"):
            self._require_walking(name)
        match name:
            case "end":
                self._ended = True
            case "walk" | "pause":
                self.paused = name == "pause"
            case "stop":
                if run.trip is None:
                    self._record(command, stop=True)
                run.stop()
            case "restart":
                self._restart(command)
            case "settings":  # they fade in
                self._all_changes = command["whole"]
                self._record(command, set=command["set"], fade_ms=FADE_TICKS)
                run.set(command["numbers"])
            case "snapshot":
                return {"snapshot": run.snapshot()}
            case "request":
                answer = run.request(command["request"])  # this runs the next tick, in which it is handled
                self._record(command, answer.time, request=answer.request)
                if answer.rejection:
                    raise ParameterError(answer.rejection)
                return {
                    "text": f"{answer.request}: {answer.mode_before} → {answer.mode_after}",
                    "tick": answer.tick,
                }
            case "push":
                joint, torque, duration = (command[name] for name in ("joint", "torque", "duration"))
                names = [f"{item.side}_{item.joint}" for item in run.setup.joints]
                run.push(names.index(joint), torque, to_ticks(duration))
                push = {"joint": joint, "torque_Nm": torque, "duration_ms": to_ticks(duration)}
                self._record(command, push=push)
                return {"text": f"push {joint}: {torque:g} N·m for {duration:g} s"}
            case "fault":
                fault = parse_fault(command["fault"])
                run.inject(fault)
                self._record(command, fault=fault.untimed_notation)
                return {"text": f"fault {command['fault'].partition('@')[0]}"}
            case "step":
                if not run.waiting_legs():
                    remedy = "switch steps by hand on, and wait until a leg waits for its step"
                    raise ParameterError(f"step: no leg waits for a step; {remedy}")
                run.release()
                self._record(command, step=True)
        return {"text": name}

    def _record(self, command: Command, time: float | None = None, **action: Any) -> None:
        """Record an event in the form of an experiment file, at ``time`` in [s] or before the next tick."""
        time = self.run.tick * TICK if time is None else time
        by = {"by": command["user"]} if command.get("user") else {}
        self._events.append({"time_s": round(time, 3), **action, **by})
        self._script_length += len(dump(self._events[-1]))

    def _require_walking(self, name: str) -> None:
        """Raise ParameterError if the walk is over; in a hold, the supervisor still handles requests."""
        held = self.run.trip is not None and name != "request"
        if held or self.run.status is not RunStatus.COMPLETED:
            raise ParameterError(f"{name}: the walk has ended; restart it")

    def _restart(self, command: Command) -> None:
        """Begin a new walk, whose first event contains all changes from the preset."""
        if self.run.tick > 0:
            self._store_and_send(over=True)
        self.run.restart()
        self.paused = False
        self._begin()
        if self._all_changes:
            self._record(command, set=self._all_changes, fade_ms=0)
        self.clock.pause()
