"""Result of a simulation: log, switches, status, events and measures of a run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

import twin_gait
from twin_gait.control.safety import Trip
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.ground_strides import WalkConditions
from twin_gait.measures.leg_record import (
    WHOLE_RUN,
    LegRecord,
    LogColumns,
    Spans,
    leg_record,
    phase_indices,
)
from twin_gait.measures.outcome import EventKind, RunEvent, Verdict, judge_gait
from twin_gait.measures.strides import SKIPPED_STRIDES
from twin_gait.measures.walk import walk_measures, walk_power
from twin_gait.simulation.log import LogArrays, LogLayout
from twin_gait.simulation.request_results import RequestResult, request_result
from twin_gait.vocabulary import GaitPhase, Outcome, Side
from twin_gait.worlds.faults import Fault

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class RunStatus(StrEnum):
    """Status at the end of the integration; the outcome of the gait is :attr:`Run.verdict`."""

    COMPLETED = "completed"
    FELL = "fell"
    DIVERGED = "diverged"
    INTERRUPTED = "interrupted"


# Events of the statuses; a run with any other status has no event at its end.
_ENDINGS = {RunStatus.FELL: EventKind.FALL, RunStatus.DIVERGED: EventKind.DIVERGENCE}


def run_events(
    faults: Iterable[Fault], trip: Trip | None, status: RunStatus, end: float
) -> tuple[RunEvent, ...]:
    """Return the events of a run in the order of time; a cause comes before its effect at the same time.

    ``faults``: faults of the experiment; those after the end are left out. ``trip``: trip of the safety
    monitor, or None. ``end``: time of the last row of the log in [s].
    """

    def words(name: str) -> str:
        return name.replace("_", " ")

    occurred = (item for item in faults if item.time <= end)
    found = [
        RunEvent(EventKind.FAULT, item.time, words(item.kind), words(item.location)) for item in occurred
    ]
    if trip is not None:
        found.append(RunEvent(EventKind.TRIP, trip.time, words(trip.cause), trip.location))
    if status in _ENDINGS:
        found.append(RunEvent(_ENDINGS[status], end))
    return tuple(sorted(found, key=lambda event: event.time))


class _Log:
    """Descriptor of the log of a run; the first read builds the table from the arrays of an engine."""

    def __get__(self, run: Run | None, owner: type[Run]) -> pd.DataFrame:
        if run is None:
            raise AttributeError("log")  # the field has no default
        kept = vars(run)["log"]
        if isinstance(kept, LogArrays):
            kept = vars(run)["log"] = kept.table()
        table: pd.DataFrame = kept
        return table

    def __set__(self, run: Run, log: pd.DataFrame | LogArrays) -> None:
        vars(run)["log"] = log


@dataclass(frozen=True, kw_only=True, repr=False)
class Run:
    """Result of a finished simulation.

    ``save``, ``plot`` and ``strides`` call functions of the public namespace, which are looked up at each
    call, because the simulation itself writes no files, draws no figures and has no reference gait.
    """

    experiment: Experiment  # Experiment that was run.
    table: GaitTable  # Gait table after scaling to wearer, support and speed.
    log: _Log = _Log()  # Table with one row per tick; units are in the column names.
    switches: tuple[PhaseSwitch, ...]  # Every change of phase with its cause.
    status: RunStatus  # Status at the end of the run.
    reason: str  # Reason for the status, if the run did not complete.
    wall_s: float  # Wall-clock time of the integration in [s].
    body_weight: float  # Weight of wearer and device in [N].
    own_table: GaitTable | None = None  # Gait table of the wearer's own gait after scaling, or None.
    trip: Trip | None = None  # Trip of the safety monitor, or None.
    # Traffic of the bus for the summary; None without a bus, in live walks and for runs read from a file.
    traffic: Mapping[str, Any] | None = None

    def __repr__(self) -> str:
        """Return one line with the experiment, the outcome and the events."""
        events = "".join(f", {event.text} at {event.time:.2f} s" for event in self.events)
        size = f"{len(self.log)} ticks x {self.log.shape[1]} columns, {len(self.switches)} switches"
        word = self.verdict.outcome or self.status
        return f"<Run {self.experiment.name}: {word}, {self.duration:g} s ({size}){events}>"

    def _repr_html_(self) -> str:
        """Return the outcome and the events as a small table for a notebook."""
        word = self.verdict.outcome or self.status
        rows = [
            ("simulated", f"{self.duration:g} s in {self.wall_s:.2f} s, {len(self.log)} ticks"),
            ("log", f"{self.log.shape[1]} columns; {len(self.switches)} switches of phase"),
            *((f"{event.time:.2f} s", event.text) for event in self.events),
            *(("why", reason) for reason in (self.verdict.reason,) if reason),
        ]
        lines = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
        name = escape(self.experiment.name)
        return f"<table><caption>{name}: <b>{escape(word)}</b></caption>{lines}</table>"

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write the run directory and return its path; see :func:`twin_gait.save_run`."""
        return twin_gait.save_run(self, folder, force=force)

    @cached_property
    def strides(self) -> pd.DataFrame:
        """Table with one row for each stride and side; see :func:`twin_gait.stride_table`."""
        return twin_gait.stride_table(self)

    def plot(self, figure: str = "gait_cycle", *, width_mm: float | None = None) -> Figure:
        """Draw a figure of the run; see :func:`twin_gait.plot_run`."""
        return twin_gait.plot_run(self, figure, width_mm=width_mm)

    @property
    def columns(self) -> LogColumns:
        """Columns of the log by name; access to them does not build the table."""
        columns: LogColumns = vars(self)["log"]
        return columns

    @property
    def duration(self) -> float:
        """Simulated time in [s]."""
        return len(self.columns) * TICK

    @property
    def sides(self) -> tuple[Side, ...]:
        """Sides of the legs of the wearer, with or without a device."""
        return tuple(self.experiment.leg.legs)

    def leg_table(self, side: Side) -> GaitTable:
        """Return the gait table whose phases a leg has: that of the device, or of the wearer's own gait."""
        if side in self.experiment.sides or self.own_table is None:
            return self.table
        return self.own_table

    def leg_record(self, side: Side, *, device: bool = False) -> LegRecord:
        """Return the data of a leg for gait measures.

        ``device``: whether the angles are those of the device, not those of a wearer in braces.
        """
        return self._read_leg(side, device=True) if device else self._legs[side]

    def leg_records(self) -> list[LegRecord]:
        """Return the data of all legs for gait measures, in the order of :attr:`sides`."""
        return list(self._legs.values())

    @cached_property
    def _legs(self) -> dict[Side, LegRecord]:
        return {side: self._read_leg(side) for side in self.sides}

    def _read_leg(self, side: Side, *, device: bool = False) -> LegRecord:
        names = self.leg_table(side).phase_names
        steady, waiting = self.steady_spans, self.waiting_mask
        return leg_record(self.columns, side, names, TICK, steady=steady, waiting=waiting, device=device)

    @cached_property
    def waiting_mask(self) -> np.ndarray:
        """Mask of the ticks in which the legs stand because no step is requested, or the belt is at rest."""
        modes, log, waiting = self.experiment.modes, self.columns, np.zeros(len(self.columns), dtype=bool)
        if modes is not None:
            codes = [code for code, name in enumerate(modes.phase_names) if modes.waits_for_step(name)]
            names = self.table.phase_names
            swings = [code for code, phase in enumerate(names) if self.table.is_swing(phase)]
            waiting |= np.isin(log["mode"], codes)
            for side in self.sides:
                waiting &= ~np.isin(phase_indices(log, side, names), swings)
        walking = self.experiment.scenario.walking
        if walking is not None and walking.belt.cruise > 0.0:
            waiting |= np.asarray(log["belt_speed_m_per_s"]) == 0.0
        return waiting

    @cached_property
    def walkway(self) -> WalkConditions | None:
        """Parameters of ground and support; None on the bench, or if the support carries all weight."""
        walking = self.experiment.scenario.walking
        if walking is None or walking.support_share == 1.0:
            return None
        contact = walking.contact
        return WalkConditions(
            carried_weight=walking.carried_share * self.body_weight or math.nan,
            friction_coefficient=contact.friction_coefficient,
            transition_velocity=contact.transition_velocity,
        )

    def walk_measures(self, *, skip: int = SKIPPED_STRIDES) -> dict[Side, dict[str, float]]:
        """Compute ground forces, joint measures and powers by leg (:mod:`twin_gait.measures.walk`).

        ``skip``: strides at the start that do not count. The result is empty without a walkway.
        """
        walkway = self.walkway
        if walkway is None:
            return {}
        legs, found = self.leg_records(), dict[Side, dict[str, float]]()
        for leg, other in zip(legs, reversed(legs), strict=True):
            names = self.leg_table(leg.side).phase_names
            swing = names.index(GaitPhase.SWING_FLEXION) if GaitPhase.SWING_FLEXION in names else None
            found[leg.side] = walk_measures(self.columns, leg, other, walkway, swing_phase=swing, skip=skip)
        return found

    def walk_power(
        self, *, skip: int = SKIPPED_STRIDES, legs: Mapping[Side, Mapping[str, float]] | None = None
    ) -> dict[str, float] | None:
        """Add up the powers that drive the walk, by names with units; None without a walkway.

        ``legs``: walk measures of the legs, computed by default.
        """
        walkway = self.walkway
        if walkway is None:
            return None
        if legs is None:
            legs = self.walk_measures(skip=skip)
        bounds = self.leg_record(self.sides[0]).strides(skip=skip)
        return walk_power(self.columns, legs.values(), bounds, walkway)

    @cached_property
    def verdict(self) -> Verdict:
        """Outcome of the gait in one word, and its reason; see :mod:`twin_gait.measures.outcome`."""
        if self.status is RunStatus.DIVERGED:
            return Verdict(Outcome.DIVERGED, self.reason)
        held = "" if self.trip is None else f"held from {self.trip.time:.3f} s on: {self.trip.text}"
        if self.status is RunStatus.FELL:
            return Verdict(Outcome.FELL, ", ".join(filter(None, (self.reason, held))))
        if held:
            return Verdict(Outcome.HELD, held)
        tables = [self.leg_table(side) for side in self.sides]
        swings = any(
            table.transitions and any(table.is_swing(phase) for phase in table.phases) for table in tables
        )
        if not swings or not self.steady_spans:
            missing = "no phase of the gait table has swing in its name, or no mode requested a step"
            return Verdict(None, f"no walk to judge: {missing}")
        return judge_gait(self.leg_records())

    @property
    def baseline_problem(self) -> str:
        """Reason why other runs cannot be compared with this one, if it does not walk; otherwise empty."""
        outcome, reason = self.verdict
        if outcome in (Outcome.WALKED, None):  # None: the experiment has no walk
            return ""
        return f"the baseline does not walk: {outcome}, {reason}" if reason else f"the baseline {outcome}"

    @cached_property
    def steady_spans(self) -> Spans:
        """Spans of time in [s] in which the legs are to walk evenly.

        They depend on scenario and modes and end at a trip. A span in which no step is requested is left out.
        """
        first, last = self.experiment.scenario.steady
        if self.trip is not None:
            last = min(last, self.trip.time)
        spans, modes = WHOLE_RUN, self.experiment.modes
        if modes is not None:
            walking = [code for code, mode in enumerate(modes.phases.values()) if mode.walk]
            walks = np.concatenate(([0], np.isin(self.columns["mode"], walking), [0]))
            bounds = (np.flatnonzero(np.diff(walks)).reshape(-1, 2) - (0, 1)).tolist()
            spans = tuple((i * TICK, k * TICK) for i, k in bounds if not self.waiting_mask[i:k].all())
        clipped = ((max(first, begin), min(last, end)) for begin, end in spans)
        return tuple((begin, end) for begin, end in clipped if begin < end)

    @cached_property
    def request_results(self) -> tuple[RequestResult, ...]:
        """Results of the requests; see :mod:`twin_gait.simulation.request_results`. Empty without modes."""
        modes, initial, found = self.experiment.modes, self.experiment.initial_mode, list[RequestResult]()
        if modes is not None:
            first = 0 if initial is None else modes.phase_index(initial)
            # Mode before each tick, and after the last one.
            codes = np.concatenate([[first], self.log["mode"].to_numpy()]).astype(int)
            entries = np.flatnonzero(np.diff(codes))
            for tick in np.flatnonzero(self.log["request"].to_numpy()).tolist():
                ticks = tick - max(entries[entries < tick].tolist(), default=0)
                before = modes.phase_names[codes[tick]]
                found.append(
                    request_result(self.log, tick, before, ticks, modes, self.table, self.body_weight)
                )
        return tuple(found)

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """Injected faults, trip, fall and divergence in the order of time."""
        end = (len(self.columns) - 1) * TICK
        return run_events(self.experiment.faults, self.trip, self.status, end)


def log_table(rows: np.ndarray, layout: LogLayout, table: GaitTable) -> pd.DataFrame:
    """Build the log table of rows with all columns, shape ``(n_ticks, n_columns)``."""
    return LogArrays(rows.T, layout.names, table.phase_names).table()
