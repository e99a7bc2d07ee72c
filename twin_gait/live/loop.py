"""The walk in real time: blocks of 10 ms against a clock, commands between them, news after each.

Nothing here waits for anybody: commands are taken if there are some, and what is sent is handed to a function
that must return at once. The clock and the sleep are passed in.
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
from twin_gait.live.journal import Piece
from twin_gait.live.protocol import DeadlineStatistics, one_line
from twin_gait.simulation.problem import ticks
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.viewer.page import event_entries
from twin_gait.worlds.faults import parse_fault

BLOCK_TICKS = 10
PERIOD = BLOCK_TICKS * TICK  # [s]
LATE = PERIOD  # [s]; a block that is finished later than this after its time counts as late
CATCH_UP = 5 * PERIOD  # [s]; a loop further behind than this gives the time up instead of racing after it

# Characters of the events of a walk. With more, changes are refused, so that its experiment file can be read.
LONGEST_SCRIPT = 500_000

# Commands that add to the events; the stop, which comes once, is never refused for that.
RECORDED = ("settings", "push", "fault", "step", "request")

Command = Mapping[str, Any]


class BlockClock:
    """When the next block is to begin, and how late the blocks so far were finished.

    A block is to be finished a period after its time, when that of the next begins. The caller asks the time;
    nothing here does.
    """

    def __init__(self) -> None:
        """Begin without any block."""
        self.statistics = DeadlineStatistics()  # of all blocks so far
        self._due: float | None = None  # time of the next block; None for as soon as it is waited for

    def wait(self, now: float) -> float:
        """Time until the next block may begin.

        ``now``: present time in [s]. Returns time in [s]; 0 if the block is due. A loop that is more than
        ``CATCH_UP`` behind goes on from now; the time that it gives up is counted as lost, and the blocks
        that belonged there as late.
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
        assert self._due is not None  # a block is waited for before it is finished
        self._due += PERIOD
        self._count(max(0.0, now - self._due), 1)

    def _count(self, lateness: float, blocks: int) -> None:
        counted = self.statistics
        counted.blocks += blocks
        counted.late += blocks * (lateness > LATE)
        counted.worst_ms = max(counted.worst_ms, 1e3 * lateness)

    def pause(self) -> None:
        """Let the next block begin whenever it is waited for: time until then is nobody's loss."""
        self._due = None


@dataclass(kw_only=True)
class LiveLoop:
    """Runs one walk after the other until it is told to end; :meth:`walk` starts it."""

    run: SteppedRun  # the walk at tick 0
    now: Callable[[], float]  # time in [s] of a clock that never goes back
    sleep: Callable[[float], None]  # waits for a time in [s]
    commands: Callable[[], Command | None]  # gives the next command, or None; returns at once
    send: Callable[[Mapping[str, Any]], None]  # takes news or an answer; returns at once
    keep: Callable[[Piece], None]  # takes what is new in the walk, its last piece marked; returns at once
    clock: BlockClock = field(default_factory=BlockClock)  # deadlines of the blocks

    def __post_init__(self) -> None:
        """Begin with nothing handed over."""
        self._longest = self.run.problem.experiment.n_ticks
        self._ended = self.paused = False
        self._whole: Mapping[str, Any] = {}  # all that differs from the preset, as ``set`` of an event
        self._begin()

    def _begin(self) -> None:
        """Begin a walk."""
        self._began = self.now()
        self._told = self._switches = 0  # ticks and switches handed over
        self._events: list[Mapping[str, Any]] = []  # that have not been handed over
        self._script = 0  # characters of the events of this walk

    # ------------------------------------------------------------------ the loop

    def walk(self) -> None:
        """Walk until a command ends it, or the longest time is over."""
        while not self._ended:
            self._take_commands()
            if self._moving:
                self._one_block()
            else:
                self.clock.pause()
                self.sleep(PERIOD)
                self.send({"kind": "beat"})  # else the news of a block is the heartbeat
            self._ended = self._ended or self.run.tick >= self._longest
        self._hand_over(over=True)

    @property
    def status(self) -> str:
        """What the walk does at present, as a :class:`~twin_gait.live.protocol.Frame` has it."""
        if self._ended:
            return "ended"
        if self.run.status is not RunStatus.COMPLETED:
            return str(self.run.status)
        if self.run.trip is not None:
            return "held"
        if self.paused:
            return "paused"
        return "waiting" if self.run.waiting() else "walking"

    @property
    def _moving(self) -> bool:
        """Whether time goes on: in a hold it does, so that the legs are lowered even in a pause."""
        return self.status in ("walking", "waiting", "held")

    def _one_block(self) -> None:
        """Wait for the next block, or run it if its time has come."""
        wait, run = self.clock.wait(self.now()), self.run
        if wait > 0.0:
            self.sleep(wait)
            return  # for commands that came meanwhile
        run.advance(min(BLOCK_TICKS - run.tick % BLOCK_TICKS, self._longest - run.tick))
        self.clock.finished(self.now())
        self._hand_over()
        run.forget_rows(self._told - 1)  # a look at the last row is always possible

    def _hand_over(self, *, over: bool = False) -> None:
        """Keep what is new in the walk, and send it with how the walk stands."""
        run, first, trip = self.run, self._told, self.run.trip
        piece = Piece(
            rows=run.rows(first), switches=run.switches(self._switches), events=tuple(self._events),
            status=run.status, reason=run.reason, trip=trip, wall_s=self.now() - self._began, over=over,
        )  # fmt: skip
        self._told, self._events = run.tick, []
        self._switches += len(piece.switches)
        self.keep(piece)
        self.send(
            {"kind": "news", "first": first, "tick": run.tick, "status": self.status,
             "rows": base64.b64encode(np.ascontiguousarray(piece.rows)).decode(),
             "events": event_entries(run.events), "deadlines": asdict(self.clock.statistics),
             "tripped": "" if trip is None or trip.joint is None else f"{trip.side}_{trip.joint}"}
        )  # fmt: skip

    # ------------------------------------------------------------------ commands

    def _take_commands(self) -> None:
        """Execute the commands that have come, and answer them."""
        while (command := self.commands()) is not None:
            answer: dict[str, Any] = {"kind": "answer", "refused": "", "text": ""}
            try:
                answer |= self._obey(command)
            except TwinGaitError as error:
                answer["refused"] = one_line(error)
            answer.setdefault("tick", self.run.tick)  # after a restart it is that of the new walk
            self.send(answer)
            if not self._moving:  # else the next block tells how it stands
                self._hand_over()

    def _obey(self, command: Command) -> dict[str, Any]:
        """Execute a command, and record it as an event; gives the fields of its answer, ``text`` in words."""
        name, run = command["command"], self.run
        if name in RECORDED and self._script > LONGEST_SCRIPT:
            raise ParameterError(f"{name}: too many events in one walk; start again")
        if name in ("walk", "push", "fault", "step", "request"):
            self._require_going(name)
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
                self._whole = command["whole"]
                self._record(command, set=command["set"], fade_ms=FADE_TICKS)
                run.set(command["numbers"])
            case "moment":
                return {"moment": run.moment()}
            case "request":
                answer = run.request(command["request"])  # in the next tick, which it runs
                self._record(command, answer.time, request=answer.request)
                if answer.refused:
                    raise ParameterError(answer.refused)
                return {"text": f"{answer.request}: {answer.before} → {answer.after}", "tick": answer.tick}
            case "push":
                joint, torque, duration = (command[name] for name in ("joint", "torque", "duration"))
                names = [f"{item.side}_{item.joint}" for item in run.problem.joints]
                run.push(names.index(joint), torque, ticks(duration))
                push = {"joint": joint, "torque_Nm": torque, "duration_ms": ticks(duration)}
                self._record(command, push=push)
                return {"text": f"push {joint}: {torque:g} Nm for {duration:g} s"}
            case "fault":
                fault = parse_fault(command["fault"])
                run.inject(fault)
                self._record(command, fault=fault.without_time)
                return {"text": f"fault {command['fault'].partition('@')[0]}"}
            case "step":
                if not run.waiting():
                    raise ParameterError("step: no leg waits for one; switch steps by hand on, and wait")
                run.release()
                self._record(command, step=True)
        return {"text": name}

    def _record(self, command: Command, time: float | None = None, **action: Any) -> None:
        """Record an event, as an experiment file has it, at a time in [s] or before the next tick."""
        time = self.run.tick * TICK if time is None else time
        by = {"by": command["user"]} if command.get("user") else {}
        self._events.append({"time_s": round(time, 3), **action, **by})
        self._script += len(dump(self._events[-1]))

    def _require_going(self, name: str) -> None:
        """Refuse what a walk that is over cannot do; in a hold the supervisor still answers."""
        held = self.run.trip is not None and name != "request"
        if held or self.run.status is not RunStatus.COMPLETED:
            raise ParameterError(f"{name}: the walk is over; start again")

    def _restart(self, command: Command) -> None:
        """Begin a new walk, whose first event has all that has been changed."""
        if self.run.tick > 0:
            self._hand_over(over=True)
        self.run.restart()
        self.paused = False
        self._begin()
        if self._whole:
            self._record(command, set=self._whole, fade_ms=0)
        self.clock.pause()
