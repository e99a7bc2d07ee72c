"""What a simulation gives back."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd

from twin_gait.control import Trip
from twin_gait.experiment import Experiment
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.events import RunEvent, run_events
from twin_gait.simulation.columns import LogLayout
from twin_gait.vocabulary import Side

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Report and studies stand above the simulation. What a user calls on a run is looked up by name when it is
# called, in the namespace that they import from, so that no module here depends on those floors.
_PUBLIC = "twin_gait"


class RunStatus(StrEnum):
    """How a run ended."""

    COMPLETED = "completed"
    FELL = "fell"
    DIVERGED = "diverged"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True, repr=False)
class Run:
    """A finished simulation.

    ``save`` and ``plot`` are those of the public namespace: a simulation itself touches no disk and draws
    nothing.

    Attributes:
        experiment: What was run.
        table: The gait table after scaling to wearer, support and speed.
        log: One row per tick; units are in the column names.
        switches: Every change of phase with its cause.
        status: How the run ended.
        reason: Why, if it did not complete.
        wall_s: Wall-clock time of the integration in [s].
        body_weight: Weight of wearer and device in [N].
        trip: What the safety monitor tripped on, or None.
    """

    experiment: Experiment
    table: GaitTable
    log: pd.DataFrame
    switches: tuple[PhaseSwitch, ...]
    status: RunStatus
    reason: str
    wall_s: float
    body_weight: float
    trip: Trip | None = None

    def __repr__(self) -> str:
        """One line: what was run and how it ended."""
        events = "".join(f", {event.text} at {event.time:.2f} s" for event in self.events)
        size = f"{len(self.log)} ticks x {self.log.shape[1]} columns, {len(self.switches)} switches"
        return f"<Run {self.experiment.name}: {self.status}, {self.duration:g} s ({size}){events}>"

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write the run directory; see :func:`twin_gait.save_run`."""
        return cast(Path, import_module(_PUBLIC).save_run(self, folder, force=force))

    def plot(
        self, figure: str = "gait_cycle", *, width_mm: float | None = None, out: str | Path | None = None
    ) -> Figure:
        """Draw a picture of the run; see :func:`twin_gait.plot_run`."""
        drawn = import_module(_PUBLIC).plot_run(self, figure, width_mm=width_mm, out=out)
        return cast("Figure", drawn)

    @property
    def duration(self) -> float:
        """Simulated time in [s]."""
        return len(self.log) * TICK

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs in the log."""
        return tuple(self.experiment.leg.legs)

    @property
    def steady(self) -> tuple[float, float]:
        """From when to when in [s] the legs walk evenly: as the experiment has it, and not in a safe hold."""
        first, last = self.experiment.steady
        return first, last if self.trip is None else min(last, self.trip.time)

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """Faults that struck, trip, fall and divergence in the order of time."""
        end = (len(self.log) - 1) * TICK
        return run_events(self.experiment.faults, self.trip, self.status, end)


def log_table(rows: np.ndarray, layout: LogLayout, table: GaitTable) -> pd.DataFrame:
    """Make the log table of the numbers that an engine wrote.

    Args:
        rows: Shape ``(n_ticks, n_columns)`` in the order of the layout.
        layout: Names of the columns.
        table: For the names of the phases.

    Returns:
        The table, with ``time_s`` in front and phases by name.
    """
    log = pd.DataFrame(rows, columns=list(layout.names))
    log.insert(0, "time_s", np.arange(len(rows)) * TICK)
    for side in layout.legs:
        codes = rows[:, layout.positions[f"{side}_phase"]].astype(np.int64)
        log[f"{side}_phase"] = pd.Categorical.from_codes(codes, categories=pd.Index(table.phase_names))
    return log
