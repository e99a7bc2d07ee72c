"""Pages of a live session: the scene, the server and its panels.

Blocks of the walk update the scene and the numbers. Events and the state of the controls are sent to the
panels. Text from a panel is parsed to a message of the session, or rejected if it is invalid.
"""

from __future__ import annotations

import asyncio
import json
import math
import secrets
import time
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from tornado.web import HTTPError, RequestHandler

from twin_gait.control.safety import SafetyState
from twin_gait.files import finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.live import protocol
from twin_gait.live.protocol import RateLimiter
from twin_gait.live.session import LiveSession
from twin_gait.live.telemetry import Block
from twin_gait.measures.leg_record import phase_column
from twin_gait.report.formatting import describe
from twin_gait.runs.run_page import mode_names, scene_options
from twin_gait.simulation.log import log_layout, state_columns
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.viewer import environment
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.motion import (
    MODE,
    LegMotion,
    Motion,
    PhaseSpells,
    extremes,
    has_muscles,
    leg_columns,
    leg_values,
)
from twin_gait.viewer.page import PageTexts, live_page, page_data
from twin_gait.viewer.scene import build_scene
from twin_gait.viewer.server import Change, GuardedHandler, GuardedSocket, SceneServer
from twin_gait.vocabulary import HOLD, Side

PERIOD = 0.03  # [s], period of the updates from the session: about 33 frames per second
BEAT = 0.1  # [s], period of the heartbeat
MOST_MESSAGES, BURST = 20, 100  # messages of one page per second, and at once; a stop is not counted
CONFIRMED_WITHIN = 0.4  # [s], timeout of the confirmation of a stop without a socket
_UNUSED = "inertia_compensation"  # its gain is 0 in a live walk
Message = Mapping[str, Any]


class LiveScene:
    """Scene of the legs of an experiment, which blocks of the log move.

    Attributes:
        window: Collector of the drawing commands, from which pages receive them.
        page: Description of the page.
        phases: Phase of the gait table by leg of the device; None in a hold and before the first block.
        mode: Mode of operation; None in a walk without modes, and before the first block.
    """

    def __init__(self, simulation_setup: SimulationSetup) -> None:
        """Draw the legs of an experiment. Raises ModelError if the URDF cannot be read."""
        experiment, model, columns = (
            simulation_setup.experiment,
            simulation_setup.world.model,
            log_layout(simulation_setup).names,
        )
        self.window = CommandBuffer()
        self.mode: str | None = None
        self._scene = build_scene(self.window, model, **scene_options(experiment))
        phases = simulation_setup.table.phase_names, simulation_setup.own_phase_names
        self._names, self._modes = (*dict.fromkeys(chain(*phases)), HOLD), mode_names(experiment)
        self._coordinates, self._travelled = state_columns(model)[0], 0.0
        self.phases: dict[str, str | None] = dict.fromkeys(map(str, experiment.sides))
        self._shown = {
            side: [key for key in leg_columns(columns, side) if not key.endswith(_UNUSED)]
            for side in model.sides
        }
        title = f"twin_gait live · {experiment.name}"
        self.page = page_data(
            PageTexts(title=title, subtitle=describe(experiment), modes=self._modes), mode="live",
            view=self._scene.view, phases=self._names, shown=self._shown,
            muscles=has_muscles(columns),
        )  # fmt: skip
        self.window.send({"type": "page", "path": "", "page": self.page})

    def show(self, blocks: Sequence[Block], events: Sequence[Mapping[str, Any]] = ()) -> None:
        """Move the scene to the last tick of some blocks, and extend the curves."""
        ticks = np.concatenate([np.arange(block.first, block.end) for block in blocks])
        columns = {
            name: np.concatenate([block.columns[name] for block in blocks]) for name in blocks[-1].columns
        }
        row = {name: column[-1:] for name, column in columns.items()}
        held = row["safety_state"][0] == SafetyState.HOLD.code
        shown = {side: HOLD if held else str(row[phase_column(row, side)][0]) for side in self._shown}
        self.phases = {side: None if held else shown[Side(side)] for side in self.phases}
        self.mode = self._modes[int(row[MODE][0])] if self._modes else None
        posture = np.column_stack([row[name] for name in self._coordinates])
        if not np.isfinite(posture).all():
            return  # the scene of a walk that diverged keeps its last valid state
        now = TICK * ticks[-1:]
        codes = {side: self._names.index(phase) for side, phase in shown.items()}
        legs = {side: LegMotion(PhaseSpells(now, np.array([code])), {}) for side, code in codes.items()}
        self.window.apply(self._scene.state_at(Motion(now, posture, legs, self._names, row), 0))
        self._move_belt(columns)
        numbers, curves = [], []
        for side, keys in self._shown.items():
            values = leg_values(columns, side)
            numbers.append({key: float(values[key][-1]) for key in keys} | {"phase": codes[side]})
            curves.append({key: _curve(ticks, values[key]) for key in keys})
        sample = {"time": float(now[0]), "legs": numbers, "curves": curves}
        mode = {"mode": int(row[MODE][0])} if MODE in row else {}
        self.window.sample({**sample, **mode, "events": list(events)})

    def _move_belt(self, columns: Mapping[str, np.ndarray]) -> None:
        speeds = columns.get("belt_speed_m_per_s", np.zeros(1))
        self._travelled += TICK * float(speeds.sum())
        if speeds.any():
            offset = environment.belt_offset(self._travelled)
            self.window.apply({(environment.BELT, "position"): [offset, 0.0, 0.0]})


def _curve(ticks: np.ndarray, values: np.ndarray) -> dict[str, list[float | None]]:
    """Return times in [s] and values of the points that represent a curve faithfully."""
    rows, found = (part.ravel() for part in extremes(values[:, None]))
    times = np.round(TICK * ticks[rows], 3).tolist()
    return {"times": times, "values": list(map(finite_or_none, found.tolist()))}


class StopHandler(GuardedHandler):
    """Handler of a stop over HTTP, for a page whose socket is not open."""

    needs_origin = True

    async def post(self) -> None:
        """Stop the walk, and reply when the simulation has confirmed it.

        Raises HTTPError with status 504 if there is no confirmation within ``CONFIRMED_WITHIN``.
        """
        if not await self.server.stop():
            raise HTTPError(504, reason="sent, but the simulation has not confirmed it yet")
        self.write("stopped\n")


class ReportHandler(GuardedHandler):
    """Handler of the report of the session so far."""

    async def get(self) -> None:
        """Send the report, or status 503 with the reason if it cannot be made."""
        page, problem = await self.server.report()
        if problem:
            self.set_status(503)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.write(page or problem)


class PanelSocket(GuardedSocket):
    """Web socket of the panel of a page."""

    def open(self) -> None:
        """Send the initial messages of the panel."""
        super().open()
        self.limit = RateLimiter(MOST_MESSAGES, BURST)
        for message in self.server.initial_messages():
            self.send(message)

    def send(self, message: Message, *, key: Hashable | None = None) -> None:
        """Send a message as soon as this panel accepts it; ``key`` as in :meth:`LivePageServer.publish`."""
        text = json.dumps(message, allow_nan=False)
        self.outbox.post([(object() if key is None else key, text)])

    def on_message(self, message: str | bytes) -> None:
        """Pass a message of the page to the server."""
        self.server.receive(self, message)

    async def write_batch(self, batch: list[str]) -> None:
        """Write a batch as one message: a list of its messages."""
        await self.try_write(f"[{','.join(batch)}]")


class LivePageServer(SceneServer):
    """Server of the pages of one live session; it must be used inside of one event loop."""

    def __init__(self, session: LiveSession, *, port: int) -> None:
        """Draw the scene and start to listen.

        Raises ModelError if the URDF cannot be read, and ViewerError if no port is free.
        """
        self._session = session
        self._controls: tuple[protocol.Control, ...] = ()  # controls that were last sent to the panels
        self._sent_frame: dict[str, Any] = {}  # frame that was last sent to the panels
        self._frame = session.walk.frame  # last telemetry
        self._serial = 0
        self._last_beat = -math.inf
        self._reporting = asyncio.Lock()  # one report at a time
        self._id = secrets.token_hex(8)  # lets a page that outlives the session detect the next session
        self.figure = LiveScene(session.panel.simulation_setup)
        super().__init__(live_page(), first_port=port)

    def update(self) -> None:
        """Send the changes of the session to all pages; call it every ``PERIOD``."""
        for event in self._session.event_log.after(self._serial):
            self._serial = event.serial
            self.publish(event.to_dict())
        state = self._session.state()
        if state.controls is not self._controls:
            self._controls = state.controls
            self.publish(state.to_dict(), key="state")
        silence, now = self._session.walk.time_since_message(), time.monotonic()
        if self._session.walk.alive and now - self._last_beat >= BEAT:
            self._last_beat = now
            self.publish(
                protocol.Heartbeat(time_since_message_s=round(silence, 3)).to_dict(), key="heartbeat"
            )
        before, self._frame = self._frame, self._session.walk.frame
        if self._frame is not before:
            self._show(self._frame)

    def _show(self, frame: Message) -> None:
        """Show the telemetry of the walk on all pages."""
        if blocks := self._session.walk.blocks():
            self.figure.show(blocks, frame["events"])
            self.show(self.figure.window.changes())
        self._sent_frame = protocol.Frame(
            tick=frame["tick"], time_s=frame["tick"] * TICK, status=frame["status"],
            phases=self.figure.phases, mode=self.figure.mode,
            deadlines=protocol.DeadlineStatistics(**frame["deadlines"]), events=tuple(frame["events"]),
        ).to_dict()  # fmt: skip
        self.publish(self._sent_frame, key="frame")

    # ------------------------------------------------------------------ functions for the server

    @property
    def pages(self) -> list[PanelSocket]:
        """Sockets of the open panels."""
        return [one for one in self.sockets if isinstance(one, PanelSocket)]

    def publish(self, message: Message, *, key: Hashable | None = None) -> None:
        """Send a message to all panels.

        ``key``: a later message of the same key replaces a waiting one; None sends every message.
        """
        for panel in self.pages:
            panel.send(message, key=key)

    def routes(self) -> list[tuple[str, type[RequestHandler]]]:
        """Return the paths and their handlers."""
        return [
            *super().routes(),
            (r"/stop", StopHandler),
            (r"/report", ReportHandler),
            (r"/panel", PanelSocket),
        ]

    def scene(self) -> Iterable[Change]:
        """Return the whole scene for a newly opened page."""
        return [("scene", self.figure.window.packed())]

    def initial_messages(self) -> Iterator[Message]:
        """Yield session, state, events and last frame for a newly opened panel."""
        phases, report = self.figure.page["phases"], self._session.report_command is not None
        yield {"kind": "page", "session": self._id, "phases": phases, "report": report}
        yield self._session.state().to_dict()
        yield from (event.to_dict() for event in self._session.event_log.after(0))
        if self._sent_frame:
            yield self._sent_frame

    def receive(self, panel: PanelSocket, text: str | bytes) -> None:
        """Parse a message of a page and submit it to the session, unless the rate of messages is too high."""
        user, limit = self._session.user, panel.limit
        message: protocol.Message | str
        try:
            message = protocol.read_message(text)
        except protocol.MessageRejected as error:
            message = str(error)
        stops = isinstance(message, protocol.DoAction) and message.action == "stop"
        dropped = limit.dropped
        if not stops and not limit.allows(time.monotonic()):
            if not dropped:
                faster = f"a page sends more than {MOST_MESSAGES} messages per second"
                self._session.event_log.emit("refused", f"{faster}; the others are dropped", user=user)
            return
        if dropped and not stops:
            limit.dropped = 0
            self._session.event_log.emit("note", f"{dropped} messages of a page were dropped", user=user)
        if isinstance(message, str):
            self._session.event_log.emit("refused", message, user=user)
        else:
            self._session.submit(message.model_copy(update={"user": message.user or user}))

    async def report(self) -> tuple[str, str]:
        """Write the report of the session so far; return the page, or an empty text and the reason.

        Another process makes it, so that neither its time nor its memory affects the walk.
        """
        command = self._session.report_command
        if command is None:
            return "", "there is no report, because this session is not recorded"
        async with self._reporting:
            pipe = asyncio.subprocess.PIPE
            process = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)
            _, errors = await process.communicate()
        if process.returncode != 0:
            return "", errors.decode(errors="replace")
        return self._session.report_path.read_text(encoding="utf-8"), ""

    async def stop(self) -> bool:
        """Stop the walk; return whether the simulation has confirmed it within ``CONFIRMED_WITHIN``."""
        message = protocol.DoAction(id="stop", user=self._session.user, action="stop")
        result = self._session.submit(message)
        if result is not None:
            await asyncio.wait([asyncio.wrap_future(result)], timeout=CONFIRMED_WITHIN)
        return result is not None and result.done() and result.result()
