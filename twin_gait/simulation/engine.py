"""What the engines share: the shape of their result and the columns of their log."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.control import Trip
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.simulation.columns import LogLayout
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.vocabulary import JointName

# A joint that turns faster than this is no longer physical: the run has diverged.
DIVERGED_VELOCITY = 1e3  # [rad] / [s]


class EngineResult(NamedTuple):
    """Result of an engine.

    Attributes:
        rows: Log numbers, shape ``(n_ticks, n_columns)``.
        switches: Phase switches.
        status: How the run ended.
        reason: Why, if it did not complete.
        trip: What the safety monitor tripped on, or None.
    """

    rows: np.ndarray
    switches: tuple[PhaseSwitch, ...]
    status: RunStatus
    reason: str
    trip: Trip | None = None


def log_layout(problem: Problem) -> LogLayout:
    """Columns that a problem's log has."""
    legs = problem.world.model.legs
    return LogLayout(
        legs={side: tuple(JointName(name) for name in problem.table.joints) for side in legs},
        ankles=tuple(side for side, leg in legs.items() if leg.ankle is not None),
        feet=tuple(side for side in legs if problem.world.contact_frames.get(side)),
        pelvis=problem.world.model.pelvis_index is not None,
        braced=problem.world.braces is not None,
    )


def diverged_reason(ticks: int) -> str:
    """Why a run that diverged in its last tick ended."""
    return f"the state diverged at {ticks * TICK:.3f} s; try a smaller integration step"


def fell_reason(ticks: int, fall_height: float | None) -> str:
    """Why a run in which the wearer fell in the last tick ended."""
    assert fall_height is not None  # without a height there is no fall
    return f"the pelvis fell below {fall_height:.2f} m at {ticks * TICK:.3f} s"


def stopped_reason(ticks: int) -> str:
    """Why a run that was asked to stop ended."""
    return f"stopped at {ticks * TICK:.3f} s"
