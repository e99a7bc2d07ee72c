"""The scene of the live page: whole for new pages, its changes for open ones."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from twin_gait.control import SafetyState
from twin_gait.files import finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.leg_model import LegModel
from twin_gait.viewer import surroundings
from twin_gait.viewer.commands import Window
from twin_gait.viewer.motion import MODE, LegMotion, Motion, PhaseSpells, extremes, leg_columns
from twin_gait.viewer.page import About, leg_entry, page_data
from twin_gait.viewer.staging import Setting, build_scene
from twin_gait.vocabulary import HOLD, JointName, Side

_DEGREES = 180.0 / math.pi
_UNUSED = "inertia_compensation"  # its gain is 0 in a live walk

# Some ticks of a walk: the first one, and the columns of the log by name.
Block = tuple[int, Mapping[str, np.ndarray]]


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
        self._time, self._travelled, self._next = 0.0, 0.0, 0
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
        blocks: Iterable[Block] = (),
        events: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """Move everything to a moment.

        ``time`` in [s]; ``q``: coordinates of the model, shape ``(nv,)``; ``row``: row of the log of that
        moment, by column; a phase is a name; ``blocks``: the walk since the last moment, in order.
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
        sample = {"time": time, "legs": numbers, "curves": self._curves(blocks), "events": list(events)}
        sample |= {"mode": int(row[MODE])} if MODE in row else {}
        self.window.sample(sample)

    def _move_belt(self, time: float, speed: float) -> None:
        self._travelled += speed * max(0.0, time - self._time)
        self._time = time
        if speed != 0.0:
            offset = surroundings.belt_offset(self._travelled)
            self.window.apply({(surroundings.BELT, "position"): [offset, 0.0, 0.0]})

    def _curves(self, blocks: Iterable[Block]) -> list[dict[str, Any]]:
        """Times in [s] and values of every curve of every leg; no line where a block is missing."""
        shown = [(leg, key, *column) for leg in self._columns for key, column in self._columns[leg].items()]
        curves: dict[Side, dict[str, Any]] = {leg: {} for leg in self._columns}
        for leg, key, *_ in shown:
            curves[leg][key] = {"times": [], "values": []}
        for first, columns in blocks:
            rows, found = extremes(np.column_stack([columns[name] for _, _, name, _ in shown]))
            times, values = np.round(TICK * (first + rows), 3).T.tolist(), found.T.tolist()
            for place, (leg, key, _, factor) in enumerate(shown):
                curve = curves[leg][key]
                if first != self._next:
                    curve["times"].append(first * TICK)
                    curve["values"].append(None)
                curve["times"] += times[place]
                curve["values"] += [finite_or_none(factor * value) for value in values[place]]
            self._next = first + len(columns["safety_state"])
        return list(curves.values())
