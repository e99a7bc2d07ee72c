"""Between the simulation that runs live and the pages that show it: the server, its panels, the scene.

Frames move the scene and the numbers; events and the state of the controls go to the panels; what a panel
says becomes a message of the session, or is refused if it is none.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Any

from tornado.web import RequestHandler

from twin_gait.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.live import protocol
from twin_gait.live.session import LiveSession
from twin_gait.runs.run_page import describe, modes_of, setting_of
from twin_gait.simulation.log import state_columns
from twin_gait.viewer.live_figure import LiveFigure
from twin_gait.viewer.page import About, live_page
from twin_gait.viewer.server import Change, Guarded, GuardedSocket, SceneServer

PERIOD = 0.03  # [s] between two looks at the session: some 33 frames a second
Message = Mapping[str, Any]


class StopHandler(Guarded):
    """The way to stop when the socket of a page is not open."""

    needs_origin = True

    def post(self) -> None:
        """Stop."""
        self.server.stop()
        self.write("stopped\n")


class Panel(GuardedSocket):
    """Talks with the panel of a page."""

    def open(self) -> None:
        """Send what the panel has to know."""
        super().open()
        for message in self.server.greeting():
            self.tell(message)

    def tell(self, message: Message, *, key: Hashable | None = None) -> None:
        """Tell this panel something as soon as it listens; ``key`` as in :meth:`LivePage.tell`."""
        text = json.dumps(message, allow_nan=False)
        self.outbox.post([(object() if key is None else key, text)])

    def on_message(self, message: str | bytes) -> None:
        """Hand on what the page says."""
        self.server.hear(self, message)

    async def write_batch(self, batch: list[str]) -> None:
        """Write one message for the batch: a list of what was told."""
        await self.write_or_leave(f"[{','.join(batch)}]")


class LivePage(SceneServer):
    """The pages of one live session; belongs to one event loop."""

    def __init__(self, session: LiveSession, experiment: Experiment, *, port: int) -> None:
        """Draw the scene and listen.

        Raises ModelError if the URDF cannot be read. Raises ViewerError if a mesh cannot be read or no port
        is free.
        """
        self._session = session
        self._modes = modes_of(experiment)
        self._sides = tuple(map(str, experiment.leg.legs))
        self._controls: tuple[protocol.Control, ...] = ()  # that the panels have been told of
        self._told: dict[str, Any] = {}  # the last frame as the panels have it
        self._frame = session.news.frame  # the last one
        self._serial = 0
        self._id = secrets.token_hex(8)  # a page that outlives the session must not take the next one for it
        model = experiment.build_world().model
        self._coordinates = state_columns(model)[0]
        self.figure = LiveFigure(
            model, drives=experiment.joints,
            about=About(
                title=f"twin_gait live · {experiment.name}",
                subtitle=describe(experiment), modes=self._modes,
            ),
            phases=experiment.table.phase_names, **setting_of(experiment),
        )  # fmt: skip
        super().__init__(live_page(), first_port=port)

    def update(self) -> None:
        """Bring what is new in the session to all pages; call it every ``PERIOD``."""
        for event in self._session.book.after(self._serial):
            self._serial = event.serial
            self.tell(event.to_dict())
        state = self._session.state()
        if state.controls is not self._controls:
            self._controls = state.controls
            self.tell(state.to_dict(), key="state")
        before, self._frame = self._frame, self._session.news.frame
        if self._frame is not before:
            self._show(self._frame)

    def _show(self, frame: Message) -> None:
        """Show a moment on all pages."""
        log, time = frame["log"], frame["tick"] * TICK
        if log:  # empty before the first tick
            blocks = [(block.first, block.columns) for block in self._session.news.blocks()]
            q = [log[name] for name in self._coordinates]
            self.figure.show(time, q, log, blocks=blocks, events=frame["events"])
            self.show(self.figure.window.changes())
        held = log.get("safety_state")
        self._told = protocol.Frame(
            tick=frame["tick"], time_s=time, status=frame["status"],
            phases={side: None if held else log.get(f"{side}_phase") for side in self._sides},
            mode=self._modes[int(log["mode"])] if self._modes and log else None,
            deadlines=protocol.DeadlineStatistics(**frame["deadlines"]), events=tuple(frame["events"]),
        ).to_dict()  # fmt: skip
        self.tell(self._told, key="frame")

    # ------------------------------------------------------------------ what the server asks

    @property
    def pages(self) -> list[Panel]:
        """Open panels."""
        return [one for one in self.sockets if isinstance(one, Panel)]

    def tell(self, message: Message, *, key: Hashable | None = None) -> None:
        """Tell all panels something.

        ``key``: a later message of the same key makes this one needless; None keeps every one.
        """
        for panel in self.pages:
            panel.tell(message, key=key)

    def routes(self) -> list[tuple[str, type[RequestHandler]]]:
        """Paths and who answers them."""
        return [*super().routes(), (r"/stop", StopHandler), (r"/panel", Panel)]

    def scene(self) -> Iterable[Change]:
        """The whole scene for a page that has just been opened."""
        return [("scene", self.figure.window.packed())]

    def greeting(self) -> Iterator[Message]:
        """Session, state, events and numbers for a panel that has just been opened."""
        yield {"kind": "page", "session": self._id, "phases": self.figure.page["phases"]}
        yield self._session.state().to_dict()
        yield from (event.to_dict() for event in self._session.book.after(0))
        if self._told:
            yield self._told

    def hear(self, panel: Panel, text: str | bytes) -> None:
        """Make a message of the session of what a page says."""
        try:
            message = protocol.read_message(text)
        except protocol.MessageRefused as error:
            self._session.book.emit("refused", str(error), user=self._session.user)
            return
        self._session.submit(message.model_copy(update={"user": message.user or self._session.user}))

    def stop(self) -> None:
        """Stop the walk."""
        self._session.submit(protocol.DoAction(id="stop", user=self._session.user, action="stop"))
