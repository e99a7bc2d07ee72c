"""The live viewer: start the server, show a model, move it, play a log in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pandas as pd

from twin_gait.exceptions import ViewerError
from twin_gait.leg_model import LegJoints, LegModel
from twin_gait.leg_model.urdf import build_model, find_urdf
from twin_gait.parameters import Patient
from twin_gait.viewer.commands import Command
from twin_gait.viewer.live.window import LiveWindow
from twin_gait.viewer.motion import FRAMES_PER_SECOND, Motion, read_motion
from twin_gait.viewer.page import leg_entry, live_page, page_data
from twin_gait.viewer.page_server import PageServer
from twin_gait.viewer.scene import Scene
from twin_gait.viewer.staging import build_scene, build_urdf_scene
from twin_gait.viewer.surroundings import Belt
from twin_gait.viewer.urdf_page import counted
from twin_gait.vocabulary import Side

FIRST_PORT = 7000


class _Batch:
    """Window that keeps what is drawn until the server's thread takes it."""

    def __init__(self) -> None:
        self.calls: list[Callable[[LiveWindow], None]] = []

    def send(self, command: Command) -> None:
        self.post(lambda window: window.send(command))

    def post(self, call: Callable[[LiveWindow], None]) -> None:
        self.calls.append(call)


class LiveViewer:
    """A page in the browser that shows what it is told, on this machine only.

    Use it as a context manager; its server ends with it, and with this process however that ends. It does
    not belong into a control loop: sending a posture takes milliseconds. Hand it a finished log, or a copy of
    the state at 30 Hz.

    Attributes:
        url: Address of the page, with the token that lets in.
    """

    def __init__(self, *, port: int = FIRST_PORT, timeout: float = 10.0) -> None:
        """Start the server.

        Args:
            port: Of the page; if it is taken the next one is tried. 0 lets the system choose.
            timeout: Longest wait for the server in [s].

        Raises:
            ViewerError: If the port is out of range or the server does not start.
        """
        self._server = PageServer(live_page(), port=port, timeout=timeout)
        self._window = _Batch()
        self.url = self._server.url
        self._model: LegModel | None = None
        self._scene: Scene | None = None
        self._belt_speed: Belt = 0.0

    def show(
        self,
        model: LegModel,
        *,
        title: str = "twin_gait",
        subtitle: str = "",
        patient: Patient | None = None,
        belt_speed: Belt = 0.0,
        phases: Sequence[str] = (),
        curves: Sequence[str] = ("hip", "knee"),
    ) -> None:
        """Draw a model.

        Args:
            model: The model.
            title: Heading of the page.
            subtitle: Line below it.
            patient: The wearer to draw, or None.
            belt_speed: Of the treadmill in [m] / [s], or the way that its belt has gone by a time.
            phases: Names of the phases in order, or none.
            curves: What the page reads out, by the names of :class:`twin_gait.viewer.motion.LegMotion`.

        Raises:
            ModelError: If the URDF cannot be read.
            ViewerError: If the server does not answer.
        """
        self._clear()
        self._model, self._belt_speed = model, belt_speed
        self._scene = build_scene(self._window, model, patient=patient)
        shows = [*(["phase"] if phases else []), *curves]
        legs = [leg_entry(side, shows) for side in model.sides]
        self._describe(title, subtitle, phases, legs)

    def show_urdf(self, path: str | Path, *, up_axis: str = "z") -> None:
        """Draw any URDF with all its coordinates at zero.

        Args:
            path: The file, or the name of a packaged one.
            up_axis: ``"x"``, ``"y"`` or ``"z"``: the vertical of the URDF.

        Raises:
            ModelError: If the URDF cannot be read.
            ViewerError: If a mesh cannot be read or the server does not answer.
        """
        self._clear()
        urdf = find_urdf(path)
        model = build_model(urdf)
        self._model = None
        self._scene = build_urdf_scene(self._window, model, urdf, up_axis=up_axis)
        self._describe(urdf.name, counted(model), [], [])

    def pose(
        self,
        q: np.ndarray,
        *,
        time: float = 0.0,
        phases: Mapping[Side, int] | None = None,
    ) -> None:
        """Move the figure.

        Args:
            q: Coordinates of the model, shape ``(nv,)``.
            time: What the page's clock shows in [s].
            phases: Position of each leg's phase among the phases shown, if known.

        Raises:
            ViewerError: If nothing is shown yet or the server does not answer.
        """
        scene = self._drawn()
        scene.apply(scene.posture_state(np.asarray(q, dtype=float)))
        if self._model is not None:
            self._sample(time, [_angles(self._model, side, q, phases) for side in self._model.sides])
        self._bring()

    def play(
        self, log: pd.DataFrame, *, speed: float = 1.0, should_stop: Callable[[], bool] | None = None
    ) -> None:
        """Play a log once, in real time.

        Args:
            log: One row per tick, of the model that is shown.
            speed: Seconds of the log per second; above 0.
            should_stop: Asked at every frame; True ends the play.

        Raises:
            ViewerError: If no leg model is shown, the log does not fit it, or the server does not answer.
        """
        if not speed > 0.0:
            raise ViewerError(f"speed: expected a number above 0, got {speed!r}")
        if self._model is None:
            raise ViewerError("nothing to play the log on; show its leg model first")
        motion = read_motion(log, self._model, frames_per_second=FRAMES_PER_SECOND)
        self._drawn().draw_trails(motion)
        began = time.monotonic()
        shown, frame, last = -1.0, 0, len(motion.times) - 1
        while not (should_stop is not None and should_stop()):
            time.sleep(max(0.0, float(motion.times[frame]) / speed - (time.monotonic() - began)))
            self._show_frame(motion, frame, shown)
            shown = float(motion.times[frame])
            if frame == last:
                return
            # A slow page misses frames rather than falling behind.
            due = int(np.searchsorted(motion.times, speed * (time.monotonic() - began)))
            frame = min(last, max(frame + 1, due))

    def pages(self) -> int:
        """How many browser pages are connected.

        Raises:
            ViewerError: If the server does not answer.
        """
        return self._server.pages()

    def close(self) -> None:
        """End the server."""
        self._server.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the server."""
        self.close()

    def _drawn(self) -> Scene:
        if self._scene is None:
            raise ViewerError("nothing is shown yet; call show() first")
        return self._scene

    def _clear(self) -> None:
        if self._scene is not None:
            self._window.post(LiveWindow.clear)

    def _bring(self) -> None:
        """Bring what has been drawn to the pages."""
        calls, self._window.calls = self._window.calls, []
        self._server.call(lambda: [call(self._server.window) for call in calls])
        self._server.show()

    def _describe(
        self, title: str, subtitle: str, phases: Sequence[str], legs: Sequence[Mapping[str, Any]]
    ) -> None:
        scene = self._drawn()
        page = page_data(
            mode="live", title=title, subtitle=subtitle, missing_meshes=scene.missing_meshes,
            view=scene.view, phases=phases, legs=legs, arrows=bool(scene.arrows),
        )  # fmt: skip
        self._window.post(lambda window: window.describe(page))
        self._bring()

    def _sample(self, time: float, legs: Sequence[Mapping[str, float]], **more: Any) -> None:
        sample = {"time": float(time), "legs": list(legs), **more}
        self._window.post(lambda window: window.sample(sample))

    def _show_frame(self, motion: Motion, frame: int, shown: float) -> None:
        scene = self._drawn()
        scene.apply(scene.state_at(motion, frame, self._belt_speed))
        when = float(motion.times[frame])
        legs, curves = [], []
        for leg in motion.legs.values():
            values = {name: curve.at(when) for name, curve in leg.curves.items()}
            legs.append(values | {"phase": -1 if leg.phases is None else leg.phases.at(when)})
            curves.append({name: curve.between(shown, when).to_dict() for name, curve in leg.curves.items()})
        self._sample(when, legs, curves=curves)
        self._bring()


def show_run(
    log: pd.DataFrame,
    model: LegModel,
    *,
    title: str = "twin_gait",
    subtitle: str = "",
    patient: Patient | None = None,
    belt_speed: Belt = 0.0,
    speed: float = 1.0,
    repeat: bool = True,
    port: int = FIRST_PORT,
    should_stop: Callable[[], bool] | None = None,
    announce: Callable[[str], None] | None = None,
) -> None:
    """Play a log in the live viewer, in real time, again and again.

    Args:
        log: One row per tick.
        model: The model that the log is about.
        title: Heading of the page.
        subtitle: Line below it.
        patient: The wearer to draw, or None.
        belt_speed: Of the treadmill in [m] / [s], or the way that its belt has gone by a time.
        speed: Seconds of the log per second.
        repeat: Whether to start over at the end.
        port: First port to try.
        should_stop: Asked at every frame; True ends the show.
        announce: Called with the address of the page once it can be opened.

    Raises:
        ModelError: If the URDF cannot be read.
        ViewerError: If the log does not fit the model or the server fails.
    """
    motion = read_motion(log, model, frames_per_second=FRAMES_PER_SECOND)
    curves = next(iter(motion.legs.values())).curves
    with LiveViewer(port=port) as viewer:
        viewer.show(
            model, title=title, subtitle=subtitle, patient=patient, belt_speed=belt_speed,
            phases=motion.phase_names, curves=tuple(curves),
        )  # fmt: skip
        if announce is not None:
            announce(viewer.url)
        while not (should_stop is not None and should_stop()):
            viewer.play(log, speed=speed, should_stop=should_stop)
            if not repeat:
                return


def view_urdf(
    path: str | Path, legs: Mapping[Side, LegJoints] | None = None, *, port: int = FIRST_PORT
) -> LiveViewer:
    """Show a URDF in its neutral posture.

    Args:
        path: The file, or the name of a packaged one.
        legs: Joint names per side, to draw it as a leg model; None draws whatever the file has.
        port: First port to try.

    Returns:
        The viewer; close it, or use it as a context manager.

    Raises:
        ModelError: If the URDF cannot be read.
        ViewerError: If a mesh cannot be read or the server fails.
    """
    viewer = LiveViewer(port=port)
    try:
        if legs is None:
            viewer.show_urdf(path)
        else:
            model = LegModel(path, legs)
            viewer.show(model, title=model.urdf_path.name, curves=())
    except BaseException:
        viewer.close()
        raise
    return viewer


def _angles(
    model: LegModel, side: Side, q: np.ndarray, phases: Mapping[Side, int] | None
) -> dict[str, float]:
    angles = {
        str(joint): float(np.degrees(q[model.index(side, joint)])) for joint, _ in model.legs[side].items()
    }
    return angles | {"phase": -1 if phases is None else int(phases.get(side, -1))}
