"""The walk in real time: blocks of 10 ms against a clock, commands between them, a frame now and then.

Nothing here waits for anybody: commands are taken if there are some, and what is sent is handed to a function
that must return at once. The clock and the sleep are passed in.
"""

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.files import finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.live.journal import AppliedChange, Piece
from twin_gait.live.protocol import Frame
from twin_gait.live.realtime import BLOCK_TICKS, PERIOD, BlockClock
from twin_gait.live.stepping import Asking, SteppedRun
from twin_gait.live.walk import LiveWalk
from twin_gait.simulation.run import RunStatus
from twin_gait.viewer.motion import extremes, leg_columns
from twin_gait.viewer.page import event_entries
from twin_gait.worlds.faults import parse_fault

FRAME_BLOCKS = 2  # a frame every 20 ms: 50 a second
MOST_TRACES = 400  # kept for who does not read: eight seconds, which is what a page remembers
STILL_FRAME = 10 * PERIOD  # [s] between two frames while nothing moves
PIECE_TICKS = 500  # between two pieces: a kill loses no more than this and what waits to be written


class LoopStatus(StrEnum):
    """What the walk does."""

    WALKING = "walking"
    PAUSED = "paused"
    WAITING = "waiting"
    HELD = "held"
    FELL = "fell"
    DIVERGED = "diverged"
    ENDED = "ended"


@dataclass
class _Kept:
    """What of the present walk has been handed over."""

    tick: int = 0
    switches: int = 0
    changes: list[AppliedChange] = field(default_factory=list)  # that have not been


@dataclass(kw_only=True)
class LiveLoop:
    """Runs one walk after the other until it is told to end; :meth:`walk` starts it."""

    run: SteppedRun  # the walk at tick 0
    now: Callable[[], float]  # time in [s] of a clock that never goes back
    sleep: Callable[[float], None]  # waits for a time in [s]
    commands: Callable[[], Mapping[str, Any] | None]  # gives the next command, or None; returns at once
    send: Callable[[Mapping[str, Any]], None]  # takes a frame or an answer; returns at once
    keep: Callable[[Piece], None]  # takes the next piece of the walk, its last one marked; returns at once
    longest: int  # ticks of a walk
    paused: bool = False  # whether to wait for the command to walk
    tells_rows: bool = False  # whether to send all rows of the log, for a bus
    clock: BlockClock = field(default_factory=BlockClock)  # deadlines of the blocks

    def __post_init__(self) -> None:
        """Begin with nothing handed over."""
        self._walk, self._kept, self._began, self._ended = LiveWalk(self.run), _Kept(), self.now(), False
        self._table: Mapping[str, Any] | None = None  # as it was changed to
        self._last_frame, self._traced = -np.inf, 0
        self._asked: list[tuple[Asking, Mapping[str, Any]]] = []  # that the supervisor has yet to answer
        layout = self.run.layout
        self._columns = {
            name: layout.positions[name]
            for side, joints in layout.legs.items()
            for name in leg_columns(side, joints).values()
            if name in layout.positions
        }

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
            self._keep_what_is_new()
        self._keep_piece(over=True)
        self._send_frame()

    @property
    def status(self) -> LoopStatus:
        """What the walk does at present."""
        if self._ended:
            return LoopStatus.ENDED
        if self.run.status is not RunStatus.COMPLETED:
            return LoopStatus(str(self.run.status))
        if self.run.trip is not None:
            return LoopStatus.HELD
        if self.paused:
            return LoopStatus.PAUSED
        return LoopStatus.WAITING if self.run.waiting() else LoopStatus.WALKING

    @property
    def _moving(self) -> bool:
        """Whether time goes on: in a hold it does, so that the legs are lowered even in a pause."""
        over = self.run.status is not RunStatus.COMPLETED or self._ended
        return not over and (self.run.trip is not None or not self.paused)

    def _one_block(self) -> None:
        """Wait for the next block, or run it if its time has come."""
        wait = self.clock.wait(self.now())
        if wait > 0.0:
            self.sleep(wait)
            return  # for commands that came meanwhile
        first = self.run.tick
        left = min(BLOCK_TICKS, self.longest - first)
        self._walk.advance(left - 1)
        q = self.run.q
        self.run.advance(1)
        if self.tells_rows:
            self._send_rows(first)
        self.clock.finished(self.now())
        self._tell_requests()
        # A look at the last row is always possible, and the page has yet to be shown what was not traced.
        self.run.forget_rows(min(self._kept.tick, self._traced) - 1)
        if self.run.tick // BLOCK_TICKS % FRAME_BLOCKS == 0 or not self._moving:
            self._send_frame(q)

    def _stand(self) -> None:
        self.clock.pause()
        if self.now() - self._last_frame >= STILL_FRAME:
            self._send_frame()
        self.sleep(PERIOD)

    # ------------------------------------------------------------------ what is kept

    def _keep_what_is_new(self) -> None:
        """Hand a piece over when there is enough for one, and what there is when the walk stands still."""
        new = self.run.tick - self._kept.tick
        if new >= PIECE_TICKS or ((new or self._kept.changes) and not self._moving):
            self._keep_piece()

    def _keep_piece(self, *, over: bool = False) -> None:
        run, kept = self.run, self._kept
        piece = Piece(
            rows=run.rows(kept.tick), switches=run.switches(kept.switches), changes=tuple(kept.changes),
            table=self._table, status=run.status, reason=run.reason, trip=run.trip,
            wall_s=self.now() - self._began, over=over,
        )  # fmt: skip
        self._kept = _Kept(run.tick, kept.switches + len(piece.switches))
        self.keep(piece)

    # ------------------------------------------------------------------ frames

    def _send_frame(self, q: np.ndarray | None = None) -> None:
        """Send the last row of the log with the coordinates that belong to it."""
        run = self.run
        tick = max(run.tick - 1, 0)
        rows = run.rows(tick)
        self._last_frame = self.now()
        frame = Frame(
            tick=tick, time_s=tick * TICK, status=str(self.status),
            q=tuple((run.q if q is None else q).tolist()),
            log=self._named(rows[-1].tolist()) if len(rows) else {}, events=tuple(event_entries(run.events)),
            deadlines=self.clock.statistics(),
        )  # fmt: skip
        self._send_trace()
        self.send(frame.to_dict())

    def _send_trace(self) -> None:
        """Send what the curves of a page did since the last frame."""
        first, self._traced = self._traced, self.run.tick
        if first == self.run.tick:
            return
        values = self.run.rows(first)[:, list(self._columns.values())]
        rows, found = extremes(values)
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
            answer: dict[str, Any] = {"refused": ""}
            try:
                if command["command"] == "request":  # answered when the tick has been run
                    self._require_going("request", held=True)
                    self._asked.append((self.run.request(command["request"]), command))
                    continue
                if command["command"] == "moment":
                    answer["moment"] = self._walk.moment()
                else:
                    self._obey(command)
            except TwinGaitError as error:
                answer["refused"] = " ".join(str(error).split())
            # After a restart the tick is that of the new walk.
            fault = {"fault": command["fault"]} if "fault" in command else {}
            self._answer(command, self.run.tick, answer, fault)

    def _answer(
        self, command: Mapping[str, Any], tick: int, answer: Mapping[str, Any], more: Mapping[str, Any]
    ) -> None:
        """Answer a command and, if it was obeyed, note it with ``more`` among the changes of the walk."""
        if not answer["refused"] and "note" in command:
            self._kept.changes.append(AppliedChange(tick, {**command["note"], **more}))
        serial, status = command.get("serial", 0), str(self.status)
        self.send({"kind": "answer", "serial": serial, **answer, "tick": tick, "status": status})

    def _tell_requests(self) -> None:
        """Say what became of the requests of the ticks that have been run."""
        while self._asked and self._asked[0][0].tick < self.run.tick:
            asking, command = self._asked.pop(0)
            found = self.run.answer(asking)
            told = {"text": f"{found.request}: {found.before} → {found.after}"}
            self._answer(command, asking.tick, {"refused": found.refused, **told}, told)

    def _obey(self, command: Mapping[str, Any]) -> None:
        name, run = command["command"], self.run
        if name in ("walk", "push", "fault", "step"):
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
                self._walk.set(command["numbers"])
                self._table = command.get("table") or self._table
            case "push":
                run.push(command["joint"], command["torque"], command["ticks"])
            case "fault":
                run.inject(parse_fault(command["fault"]))
            case "step":
                if not run.waiting():
                    way_out = "switch steps by hand on, and wait for the status"
                    raise ParameterError(f"step: no leg waits for one; {way_out}")
                run.release()

    def _require_going(self, name: str, *, held: bool = False) -> None:
        """Refuse what a walk that has ended cannot do; ``held``: whether one that is held can."""
        if self.run.status is not RunStatus.COMPLETED or (self.run.trip is not None and not held):
            raise ParameterError(f"{name}: the walk is over; start again")

    def _restart(self) -> None:
        if self.run.tick > 0:
            self._keep_piece(over=True)
            self._kept = _Kept()
        self._walk.restart()
        for _, command in self._asked:
            self._answer(command, 0, {"refused": "a new walk has begun"}, {})
        self._traced, self._asked = 0, []
        self.paused, self._began = False, self.now()
        self.clock.pause()
