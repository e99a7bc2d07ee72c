"""The scene of the live page: whole for new pages, its changes for open ones."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from twin_gait.control import SafetyState
from twin_gait.gait.table import TICK
from twin_gait.leg_model import LegModel
from twin_gait.viewer import surroundings
from twin_gait.viewer.commands import Window
from twin_gait.viewer.motion import MODE, LegMotion, Motion, PhaseSpells, leg_columns
from twin_gait.viewer.page import About, leg_entry, page_data
from twin_gait.viewer.staging import Setting, build_scene
from twin_gait.vocabulary import HOLD, JointName

_DEGREES = 180.0 / math.pi
_UNUSED = "inertia_compensation"  # its gain is 0 in a live walk


# What curves did over some ticks: the ``first`` one, the ``end`` after the last one, and under ``columns``
# ticks and values by the columns of the log, in the units of the log; None is not a number.
Trace = Mapping[str, Any]


class LiveFigure:
    """Draws a leg model and moves it after rows of a log.

    Attributes:
        window: Takes the drawing; pages get it from there.
        page: Description of the page.
    """

    def __init__(
        self,
        model: LegModel,
        *,
        drives: Sequence[JointName],
        about: About,
        phases: Sequence[str] = (),
        **setting: Unpack[Setting],
    ) -> None:
        """Draw.

        ``setting``: what is drawn around the figure; see :class:`~twin_gait.viewer.staging.Setting`. Raises
        ModelError if the URDF cannot be read. Raises ViewerError if a mesh cannot be read.
        """
        self.window = Window()
        self._phases = (*phases, HOLD)
        self._scene = build_scene(self.window, model, drives=drives, **setting)
        self._time, self._travelled, self._traced = 0.0, 0.0, 0
        left_out = {f"{joint}_{_UNUSED}" for joint in drives}
        left_out |= set() if self._scene.arrows else {"force"}
        left_out |= set() if setting.get("crutches") else {"crutch"}
        # What is read out of each leg: column of the log, and factor from its unit to the one that is shown.
        self._columns = {
            side: {
                key: (column, _DEGREES if key in drives else 1.0)
                for key, column in leg_columns(side, drives).items()
                if key not in left_out
            }
            for side in model.sides
        }
        self.page = page_data(
            about, mode="live", view=self._scene.view,
            missing_meshes=self._scene.missing_meshes, phases=self._phases, arrows=bool(self._scene.arrows),
            legs=[leg_entry(side, ["phase", *columns]) for side, columns in self._columns.items()],
        )  # fmt: skip
        self.window.send({"type": "page", "path": "", "page": self.page})

    def show(
        self,
        time: float,
        q: Sequence[float],
        row: Mapping[str, Any],
        *,
        traces: Iterable[Trace] = (),
        events: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """Move everything to a moment.

        ``time`` in [s]; ``q``: coordinates of the model, shape ``(nv,)``; ``row``: row of the log of that
        moment, by column; a phase is a name; ``traces``: what the curves did since the last moment, in order.
        """
        posture = np.asarray(q, dtype=float)  # null is not a number
        if not np.isfinite(posture).all():
            return  # a walk that diverged stays as it was last seen
        now, held = np.array([time]), row["safety_state"] == SafetyState.HOLD.code
        phases = {side: self._phases.index(HOLD if held else row[f"{side}_phase"]) for side in self._columns}
        legs = {side: LegMotion(PhaseSpells(now, np.array([code])), {}) for side, code in phases.items()}
        columns = {
            name: np.array([value], dtype=float) for name, value in row.items() if not isinstance(value, str)
        }
        motion = Motion(now, posture[None, :], legs, self._phases, columns)
        self.window.apply(self._scene.state_at(motion, 0))
        self._move_belt(time, row.get("belt_speed_m_per_s", 0.0))
        numbers = [
            {key: factor * float(columns[name][0]) for key, (name, factor) in self._columns[side].items()}
            | {"phase": code}
            for side, code in phases.items()
        ]
        sample = {"time": time, "legs": numbers, "curves": self._curves(traces), "events": list(events)}
        sample |= {"mode": int(row[MODE])} if MODE in row else {}
        self.window.sample(sample)

    def _move_belt(self, time: float, speed: float) -> None:
        self._travelled += speed * max(0.0, time - self._time)
        self._time = time
        if speed != 0.0:
            offset = surroundings.belt_offset(self._travelled)
            self.window.apply({(surroundings.BELT, "position"): [offset, 0.0, 0.0]})

    def _curves(self, traces: Iterable[Trace]) -> list[dict[str, Any]]:
        """Times in [s] and values of every curve of every leg; no line where a trace is missing."""
        curves: list[dict[str, Any]] = [
            {key: {"times": [], "values": []} for key in columns} for columns in self._columns.values()
        ]
        for trace in traces:
            missing, self._traced = trace["first"] != self._traced, trace["end"]
            for leg, columns in zip(curves, self._columns.values(), strict=True):
                for key, (column, factor) in columns.items():
                    ticks, values = trace["columns"][column]
                    if missing:
                        ticks, values = [trace["first"], *ticks], [None, *values]
                    leg[key]["times"] += [round(tick * TICK, 3) for tick in ticks]
                    leg[key]["values"] += [None if item is None else item * factor for item in values]
        return curves
