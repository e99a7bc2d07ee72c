"""The walk in real time: blocks of 10 ms against a clock, commands between them, a frame now and then.

Nothing here waits for anybody: commands are taken if there are some, and what is sent is handed to a function
that must return at once. The clock and the sleep are passed in.
"""

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.files import finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.live.journal import Piece
from twin_gait.live.protocol import Frame, one_line
from twin_gait.live.realtime import BLOCK_TICKS, PERIOD, BlockClock
from twin_gait.live.stepping import Asking, SteppedRun
from twin_gait.simulation.run import RunStatus
from twin_gait.viewer.motion import extremes, leg_columns
from twin_gait.viewer.page import event_entries
from twin_gait.worlds.faults import parse_fault

FRAME_BLOCKS = 2  # a frame every 20 ms: 50 a second
STILL_FRAME = 10 * PERIOD  # [s] between two frames while nothing moves
PIECE_TICKS = 500  # between two pieces: a kill loses no more than this and what waits to be written

Command = Mapping[str, Any]


@dataclass(kw_only=True)
class LiveLoop:
    """Runs one walk after the other until it is told to end; :meth:`walk` starts it."""

    run: SteppedRun  # the walk at tick 0
    now: Callable[[], float]  # time in [s] of a clock that never goes back
    sleep: Callable[[float], None]  # waits for a time in [s]
    commands: Callable[[], Command | None]  # gives the next command, or None; returns at once
    send: Callable[[Mapping[str, Any]], None]  # takes a frame or an answer; returns at once
    keep: Callable[[Piece], None]  # takes the next piece of the walk, its last one marked; returns at once
    longest: int  # ticks of a walk
    paused: bool = False  # whether to wait for the command to walk
    tells_rows: bool = False  # whether to send all rows of the log, for a bus
    clock: BlockClock = field(default_factory=BlockClock)  # deadlines of the blocks

    def __post_init__(self) -> None:
        """Begin with nothing handed over."""
        self._ended, self._last_frame = False, -np.inf
        self._asked: list[tuple[Asking, Command]] = []  # that the supervisor has yet to answer
        self._changes: list[Mapping[str, Any]] = []  # that have not been handed over
        layout = self.run.layout
        self._columns = {
            name: layout.positions[name]
            for side, joints in layout.legs.items()
            for name in leg_columns(side, joints).values()
            if name in layout.positions
        }
        self._begin()

    def _begin(self) -> None:
        """Begin a walk."""
        self._began = self.now()
        self._kept = self._switches = self._traced = 0  # ticks and switches handed over, ticks in curves

    # ------------------------------------------------------------------ the loop

    def walk(self) -> None:
        """Walk until a command ends it, or the longest time is over."""
        while not self._ended:
            self._take_commands()
            if self._moving:
                self._one_block()
            else:
                self._stand()
            self._ended = self._ended or self.run.tick >= self.longest
            new = self.run.tick - self._kept
            if new >= PIECE_TICKS or ((new or self._changes) and not self._moving):
                self._keep_piece()
        self._keep_piece(over=True)
        self._send_frame()

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
        wait = self.clock.wait(self.now())
        if wait > 0.0:
            self.sleep(wait)
            return  # for commands that came meanwhile
        first = self.run.tick
        self.run.advance(min(BLOCK_TICKS, self.longest - first))
        if self.tells_rows:
            self._send_rows(first)
        self.clock.finished(self.now())
        self._tell_requests()
        # A look at the last row is always possible, and the page has yet to be shown what was not traced.
        self.run.forget_rows(min(self._kept, self._traced) - 1)
        if self.run.tick // BLOCK_TICKS % FRAME_BLOCKS == 0 or not self._moving:
            self._send_frame()

    def _stand(self) -> None:
        self.clock.pause()
        if self.now() - self._last_frame >= STILL_FRAME:
            self._send_frame()
        self.sleep(PERIOD)

    # ------------------------------------------------------------------ what is handed over

    def _keep_piece(self, *, over: bool = False) -> None:
        run = self.run
        piece = Piece(
            rows=run.rows(self._kept), switches=run.switches(self._switches), changes=tuple(self._changes),
            faults=run.injected, status=run.status, reason=run.reason, trip=run.trip,
            wall_s=self.now() - self._began, over=over,
        )  # fmt: skip
        self._kept, self._changes = run.tick, []
        self._switches += len(piece.switches)
        self.keep(piece)

    def _send_frame(self) -> None:
        """Send the last row of the log, and the curves up to it."""
        run = self.run
        tick = max(run.tick - 1, 0)
        rows = run.rows(tick)
        self._last_frame = self.now()
        frame = Frame(
            tick=tick, time_s=tick * TICK, status=self.status,
            log=self._named(rows[-1].tolist()) if len(rows) else {}, events=tuple(event_entries(run.events)),
            deadlines=self.clock.statistics,
        )  # fmt: skip
        if self._traced < run.tick:
            self._send_trace()
        self.send(frame.to_dict())

    def _send_trace(self) -> None:
        """Send what the curves of a page did since the last frame."""
        first, self._traced = self._traced, self.run.tick
        rows, found = extremes(self.run.rows(first)[:, list(self._columns.values())])
        ticks, shown = (first + rows).T.tolist(), found.T.tolist()
        columns = {
            name: [ticks[k], [finite_or_none(value) for value in shown[k]]]
            for k, name in enumerate(self._columns)
        }
        self.send({"kind": "trace", "first": first, "end": self.run.tick, "columns": columns})

    def _send_rows(self, first: int) -> None:
        """Send the rows of a block as they are."""
        rows, trip = np.ascontiguousarray(self.run.rows(first)), self.run.trip
        tripped = "" if trip is None or trip.joint is None else f"{trip.side}_{trip.joint}"
        text = base64.b64encode(rows.tobytes()).decode()
        self.send({"kind": "rows", "first": first, "rows": text, "tripped": tripped})

    def _named(self, row: list[float]) -> dict[str, float | str]:
        layout, names = self.run.layout, self.run.problem.table.phase_names
        log: dict[str, float | str] = dict(zip(layout.names, row, strict=True))
        for side in layout.legs:
            log[f"{side}_phase"] = names[int(row[layout.positions[f"{side}_phase"]])]
        return log

    # ------------------------------------------------------------------ commands

    def _take_commands(self) -> None:
        while (command := self.commands()) is not None:
            try:
                answer = self._obey(command)
            except TwinGaitError as error:
                answer = {"refused": one_line(error)}
            if answer is not None:  # after a restart the tick is that of the new walk
                self._answer(command, self.run.tick, answer)

    def _answer(self, command: Command, tick: int, answer: Mapping[str, Any]) -> None:
        """Answer a command and, if it was obeyed, note it among the changes of the walk."""
        if not answer.get("refused") and "note" in command:
            text = answer.get("text", command["note"].get("text", ""))
            self._changes.append({**command["note"], "text": text, "tick": tick})
        serial = command.get("serial", 0)
        self.send({"kind": "answer", "serial": serial, "refused": "", **answer, "tick": tick})

    def _tell_requests(self) -> None:
        """Say what became of the requests of the ticks that have been run."""
        while self._asked and self._asked[0][0].tick < self.run.tick:
            asking, command = self._asked.pop(0)
            found = self.run.answer(asking)
            text = f"{found.request}: {found.before} → {found.after}"
            self._answer(command, asking.tick, {"refused": found.refused, "text": text})

    def _obey(self, command: Command) -> dict[str, Any] | None:
        """Obey a command; gives what its answer has to tell, or None if that comes later."""
        name, run = command["command"], self.run
        if name in ("walk", "push", "fault", "step", "request"):
            self._require_going(name)
        match name:
            case "end":
                self._ended = True
            case "walk" | "pause":
                self.paused = name == "pause"
            case "stop":
                run.stop()
            case "restart":
                self._restart()
            case "settings":  # they fade in
                run.set(command["numbers"])
            case "moment":
                return {"moment": run.moment()}
            case "request":  # answered when the tick has been run
                self._asked.append((run.request(command["request"]), command))
                return None
            case "push":
                run.push(command["joint"], command["torque"], command["ticks"])
            case "fault":
                run.inject(parse_fault(command["fault"]))
            case "step":
                if not run.waiting():
                    way_out = "switch steps by hand on, and wait for the status"
                    raise ParameterError(f"step: no leg waits for one; {way_out}")
                run.release()
        return {}

    def _require_going(self, name: str) -> None:
        """Refuse what a walk that is over cannot do; in a hold the supervisor still answers."""
        held = self.run.trip is not None and name != "request"
        if held or self.run.status is not RunStatus.COMPLETED:
            raise ParameterError(f"{name}: the walk is over; start again")

    def _restart(self) -> None:
        if self.run.tick > 0:
            self._keep_piece(over=True)
        self.run.restart()
        for _, command in self._asked:
            self._answer(command, 0, {"refused": "a new walk has begun"})
        self._asked, self.paused = [], False
        self._begin()
        self.clock.pause()
