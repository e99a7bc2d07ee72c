"""Between the simulation that runs live and the pages that show it.

Frames move the scene and the numbers; events and the state of the controls go to the panels; what a panel
says becomes a message of the session, or is refused if it is none.
"""

import json
import secrets
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from twin_gait.experiment import Experiment
from twin_gait.live.protocol import (
    Action,
    DoAction,
    Event,
    Frame,
    MessageRefused,
    Response,
    State,
    id_of,
    read_message,
)
from twin_gait.live.server import LiveServer, Panel
from twin_gait.live.session import LiveSession
from twin_gait.runs.run_page import belt_speed_of, describe, modes_of, setting_of
from twin_gait.viewer.live_figure import LiveFigure
from twin_gait.viewer.page import About, live_page
from twin_gait.worlds.scenario import BELT_SPEED

PERIOD = 0.03  # [s] between two looks at the session: some 33 frames a second
READ_OUT = 100  # ticks between two read-outs of a panel
EVENTS_SHOWN = 400  # to a page that comes late


class LivePage:
    """The pages of one live session; belongs to one event loop.

    Attributes:
        server: The web server.
    """

    def __init__(self, session: LiveSession, experiment: Experiment, *, port: int, user: str = "") -> None:
        """Draw the scene and listen.

        Raises ModelError if the URDF cannot be read. Raises ViewerError if a mesh cannot be read or no port
        is free.
        """
        self._session, self._user = session, user
        self._belt_speed = belt_speed_of(experiment)
        self._scenario, self._modes = experiment.scenario, modes_of(experiment)
        self._walked_until = 0.0  # the last moment seen without a trip
        self._sides = tuple(str(side) for side in experiment.leg.legs)
        self._state: State | None = None
        self._short: dict[str, Any] | None = None
        self._number = self._serial = self._told_at = 0
        self._id = secrets.token_hex(8)  # a page that outlives the session must not take the next one for it
        self.figure = LiveFigure(
            experiment.build_world().model, drives=experiment.joints,
            about=About(
                title=f"twin_gait live · {experiment.name}",
                subtitle=describe(experiment.patient, self._belt_speed), modes=self._modes,
            ),
            phases=experiment.table.phase_names, **setting_of(experiment),
        )  # fmt: skip
        self.server = LiveServer(
            live_page(), first_port=port, on_message=self._hear, on_stop=self._stop,
            refusal=lambda reason: self._refusal(reason).to_dict(), greeting=self._greeting,
            scene=self.figure.window.everything,
        )  # fmt: skip

    @property
    def url(self) -> str:
        """Address of the page."""
        return self.server.url

    def update(self) -> None:
        """Bring what is new in the session to all pages; call it every ``PERIOD``."""
        for event in self._session.events(self._serial):
            self._serial = event.serial
            self.server.tell(event.to_dict())
        self._tell_state()
        number, text = self._session.news.frame
        if number != self._number:
            self._number = number
            self._show(Frame.from_dict(json.loads(text)))

    def _show(self, frame: Frame) -> None:
        """Show a moment on all pages."""
        if frame.log:  # empty before the first tick
            belt_speed = self._belt_speed * self._belt_share(frame)
            self.figure.show(
                frame.time_s, frame.q, frame.log, belt_speed=belt_speed, traces=self._session.news.traces(),
                events=frame.events,
            )  # fmt: skip
            self.server.show(self.figure.window.changes())
        before, self._short = self._short, self._shortened(frame)
        if before is None or before["status"] != frame.status or abs(frame.tick - self._told_at) >= READ_OUT:
            self._told_at = frame.tick
            self.server.tell(self._short, key="frame")

    def _belt_share(self, frame: Frame) -> float:
        """Share of the speed that is set which the belt has, by its profile and after a trip."""
        walking = self._scenario.walking
        if walking is None or walking.belt.cruise == 0.0:
            return 1.0
        if not frame.log["safety_state"]:
            self._walked_until = frame.time_s
        return walking.belt_speed_at(frame.time_s, self._walked_until) / walking.belt.cruise

    async def close(self) -> None:
        """End the server."""
        await self.server.close()

    def _shortened(self, frame: Frame) -> dict[str, Any]:
        """What a panel reads out of a frame; the scene has the rest."""
        entries = frame.to_dict()
        short = {key: entries[key] for key in ("kind", "tick", "time_s", "status", "events", "deadlines")}
        held = bool(frame.log.get("safety_state"))
        phases = {side: None if held else frame.log.get(f"{side}_phase") for side in self._sides}
        code = frame.log.get("mode")
        mode = self._modes[int(code)] if self._modes and code is not None else None
        return short | {"phases": phases, "mode": mode}

    def _tell_state(self) -> None:
        state = self._session.state()
        known = self._state
        if known is not None and known.controls is state.controls and known.saved == state.saved:
            return  # only its serial number is new
        self._state = state
        scales = {item.name: item.scale for item in self._scenario.adjustments}
        for control in state.controls:
            if control.name == BELT_SPEED:
                self._belt_speed = float(control.value) * scales[BELT_SPEED]
        self.server.tell(state.to_dict(), key="state")

    def _greeting(self) -> Iterator[dict[str, Any]]:
        yield {"kind": "page", "session": self._id, "phases": self.figure.page["phases"]}
        if self._state is not None:
            yield self._state.to_dict()
        for event in self._session.events()[-EVENTS_SHOWN:]:
            if event.serial <= self._serial:
                yield event.to_dict()
        if self._short is not None:
            yield self._short

    def _hear(self, panel: Panel, text: str) -> None:
        try:
            message = read_message(text)
        except MessageRefused as error:
            self._session.refuse(str(error), id=id_of(text), user=self._user)
            return
        self._session.submit(replace(message, user=message.user or self._user))

    def _stop(self) -> None:
        self._session.submit(DoAction(id="stop", user=self._user, action=Action.STOP))

    def _refusal(self, reason: str) -> Event:
        tick = 0 if self._short is None else int(self._short["tick"])
        return Event(serial=0, response=Response.REFUSED, text=reason, tick=tick)
