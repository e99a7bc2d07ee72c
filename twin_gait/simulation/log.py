"""Columns of the log, which ``log.yaml`` declares with the expressions that read them from the episode.

The function that writes a row in every tick is generated from these expressions (:attr:`LogLayout.writer`).
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain, count
from pathlib import Path

import numpy as np
import pandas as pd

from twin_gait.gait.table import TICK
from twin_gait.labels import label_of
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.vocabulary import JointName
from twin_gait.yaml12 import load_data

LOG_SCHEMA_VERSION = 4
# Columns of codes, without a unit.
CODE_COLUMNS = "safety_state", "trip_cause", "mode", "request", "rejected"


@dataclass(frozen=True, eq=False)
class ColumnGroup:
    """Columns of one object, or of each of several objects of a kind."""

    columns: Mapping[str, tuple[str, str]]  # expression and meaning, by the name without prefix of the object
    # Statement that assigns the names used in the expressions, from the episode ``e`` and the number ``n`` of
    # the object among its kind.
    preamble: str = ""


_DECLARED = load_data(Path(__file__).with_suffix(".yaml"))
GROUPS = {name: ColumnGroup(**group) for name, group in _DECLARED.items()}
BRACE, PELVIS_BRACE, TRUNK_BRACE = GROUPS["brace"], GROUPS["pelvis_brace"], GROUPS["trunk_brace"]
WORK = GROUPS["work"]


class LogArrays:
    """Columns of a log by name, with phases as indices in the gait table; the length is that of the run."""

    def __init__(
        self,
        rows: np.ndarray,
        names: Sequence[str],
        phases: Sequence[str],
        own_phases: Sequence[str] = (),
    ) -> None:
        """Store references to the columns.

        ``rows``: shape ``(n_columns, n_ticks)``. ``names``: names of the columns. ``phases``: names of the
        phases of the gait table. ``own_phases``: those of the wearer's own gait.
        """
        self._rows, self._names, self._phases, self._own_phases = rows, names, phases, own_phases
        self._places = dict(zip(names, range(len(names)), strict=True))

    def __len__(self) -> int:
        """Return the number of ticks."""
        return int(self._rows.shape[1])

    def __contains__(self, name: object) -> bool:
        """Return whether there is a column of this name."""
        return name in self._places or name == "time_s"

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column, shape ``(n_ticks,)``."""
        if name == "time_s":
            return np.arange(len(self)) * TICK
        return np.asarray(self._rows[self._places[name]])

    def table(self) -> pd.DataFrame:
        """Build the table with ``time_s`` as the first column and phases by name."""
        rows = self._rows.T
        log = pd.DataFrame(np.asfortranarray(rows), columns=list(self._names), copy=False)
        log.insert(0, "time_s", self["time_s"])
        phases = pd.CategoricalDtype(pd.Index(self._phases))
        for name in (name for name in self._names if name.endswith("_phase")):
            kind = pd.CategoricalDtype(pd.Index(self._own_phases)) if name.endswith("_own_phase") else phases
            log[name] = pd.Categorical.from_codes(self[name].astype(np.int64), dtype=kind)
        return log


WORK_SOURCES = tuple(name.removesuffix("_work_J") for name in WORK.columns)


def work_sources(columns: Container[str]) -> tuple[str, ...]:
    """Return the sources of work in a log, with braces and own gait if the log has a column for them."""
    return (*WORK_SOURCES, *(source for source in ("brace", "own_gait") if f"{source}_work_J" in columns))


def state_columns(model: LegModel, *, wearer: bool = False) -> tuple[list[str], list[str]]:
    """Return the names of the columns of coordinates and of velocities, in the order of a model.

    ``wearer``: whether the state is the wearer's own, if braces connect wearer and device.
    """
    prefix = "wearer_" * wearer
    names = {
        model.pelvis_index: (f"{prefix}pelvis_height_m", f"{prefix}pelvis_velocity_m_per_s"),
        model.forward_index: (f"{prefix}pelvis_forward_m", f"{prefix}pelvis_forward_velocity_m_per_s"),
        model.pitch_index: (f"{prefix}trunk_pitch_rad", f"{prefix}trunk_pitch_velocity_rad_per_s"),
    }
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            name = f"{side}_{joint}_{prefix}"
            names[model.index(side, joint)] = (f"{name}angle_rad", f"{name}velocity_rad_per_s")
    return [names[index][0] for index in range(model.nv)], [names[index][1] for index in range(model.nv)]


def unit_of(name: str) -> str:
    """Return the unit of a column from the end of its name; ``name`` for a phase, ``code`` for a state."""
    if name.endswith("_phase"):
        return "name"
    return "code" if name in CODE_COLUMNS else label_of(name).unit


def meaning_of(name: str) -> str:
    """Return the declared meaning of a column of a log; empty if the column is not declared."""
    columns = chain.from_iterable(group.columns.items() for group in GROUPS.values())
    known = {ending: meaning for ending, (_, meaning) in columns if name.endswith(ending)}
    return known[max(known, key=len)] if known else ""


@dataclass(frozen=True)
class LogLayout:
    """Order of the columns in a row of the log, by the objects to which they belong.

    ``time_s`` and the names of the phases are added when the table is built.
    """

    # Objects in order, each with the prefix of its column names, its number among its kind, and its columns.
    groups: tuple[tuple[str, int, ColumnGroup], ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in the order of the numbers of a row."""
        return tuple(prefix + name for prefix, _, kind in self.groups for name in kind.columns)

    @cached_property
    def writer(self) -> str:
        """Source code of ``write_row``, which writes all columns into a row of the log."""
        lines, index = ["def write_row(e, row):"], count()
        for _, number, kind in self.groups:
            lines += [f"n = {number}", kind.preamble]
            lines += [f"row[{next(index)}] = {found}" for found, _ in kind.columns.values()]
        return "\n    ".join(lines) + "\n"


def log_layout(setup: SimulationSetup) -> LogLayout:
    """Return the layout of the log of a simulation setup."""
    world, model, own = setup.world, setup.world.model, setup.own_gait
    joints = [f"{item.side}_{item.joint}_" for item in setup.joints]
    passive = {f"{side}_{joint}_": joint for side, joint in setup.passive}
    driven_ankles = [f"{side}_{JointName.ANKLE}_" for side in model.legs]
    feet = [f"{side}_foot_" for side in model.legs if world.contact_frames.get(side)]
    guides = model.pelvis_index, model.forward_index, model.pitch_index
    pelvis, forward, pitch = (guide is not None for guide in guides)
    braced, single = world.braces is not None, [""]  # one object, whose columns have no prefix
    moved = [] if own is None else own.moved
    # Objects of each kind, by their prefix or, where some of a kind have other columns, by number and prefix.
    kinds: tuple[tuple[Iterable[str | tuple[int, str]], str], ...] = (
        ([f"{side}_" for side in setup.sides], "phase"),
        (joints, "joint"),
        ([item for item in enumerate(passive) if passive[item[1]] is JointName.ANKLE], "passive"),
        ([item for item in enumerate(passive) if passive[item[1]] is not JointName.ANKLE], "undriven"),
        ([item for item in enumerate(driven_ankles) if item[1] in joints], "ankle"),
        ([f"{side}_" for side in model.legs if own is not None], "own_phase"),
        ([(number, f"{side}_{joint}_") for number, side, joint in moved], "own_joint"),
        (feet, "foot"),
        (single * bool(feet), "ground"),
        (single * pelvis, "pelvis"),
        (single * forward, "forward"),
        (single * pitch, "trunk"),
        ([f"{side}_" for side in model.sides[: len(world.arms)]], "crutch"),
        (single * (world.seat is not None), "seat"),
        (single, "energy"),
        (single, "work"),
        (single * braced, "brace_work"),
        (single * (own is not None), "own_work"),
        (single, "monitor"),
        ([*joints, *passive] * braced, "brace"),
        (single * (braced and pelvis), "pelvis_brace"),
        (single * (braced and forward), "forward_brace"),
        (single * (braced and pitch), "trunk_brace"),
        (single * (setup.experiment.modes is not None), "supervisor"),
    )
    groups = []
    for objects, kind in kinds:
        for place, item in enumerate(objects):
            number, prefix = (place, item) if isinstance(item, str) else item
            groups.append((prefix, number, GROUPS[kind]))
    return _layout_of(tuple(groups))


_layout_of = lru_cache(maxsize=32)(LogLayout)  # episodes of a batch have one layout
