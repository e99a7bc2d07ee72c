"""What the engines share: the shape of their result and the columns of their log."""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from twin_gait.control import Trip
from twin_gait.gait.machine import POSTURE, PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.simulation.episode import DIVERGED, FELL, LET_GO, TIPPED
from twin_gait.simulation.log import LogLayout
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.traffic import BusTraffic, bus_traffic
from twin_gait.simulation.watching import trip_of

# A joint that turns faster than this is no longer physical: the run has diverged.
DIVERGED_VELOCITY = 1e3  # [rad] / [s]


class EngineResult(NamedTuple):
    """Result of an engine."""

    rows: np.ndarray  # Log numbers, shape ``(n_ticks, n_columns)``.
    switches: tuple[PhaseSwitch, ...]  # Phase switches.
    status: RunStatus  # How the run ended.
    reason: str  # Why, if it did not complete.
    trip: Trip | None = None  # What the safety monitor tripped on, or None.
    traffic: BusTraffic | None = None  # Of the bus, or None without one.


def log_layout(problem: Problem) -> LogLayout:
    """Columns that a problem's log has."""
    legs = problem.world.model.legs
    return LogLayout(
        legs=dict.fromkeys(legs, problem.experiment.joints),
        passive=problem.passive,
        feet=tuple(side for side in legs if problem.world.contact_frames.get(side)),
        pelvis=problem.world.model.pelvis_index is not None,
        forward=problem.world.model.forward_index is not None,
        free=problem.world.model.pitch_index is not None,
        crutches=problem.sides[: len(problem.world.arms)],
        seat=problem.world.seat is not None,
        braced=problem.world.braces is not None,
        supervised=problem.experiment.modes is not None,
    )


def ending_of(status: int, ticks: int, problem: Problem) -> tuple[RunStatus, str]:
    """How a run stands after some ticks, and why; completed as long as nothing has ended it."""
    world, when = problem.world, f"at {ticks * TICK:.3f} s"
    lean, reach = math.degrees(world.fall_pitch), world.longest_reach
    reasons = {
        DIVERGED: f"the state diverged {when}; try a smaller integration step",
        FELL: f"the pelvis fell below {world.fall_height or 0.0:.2f} m {when}",
        TIPPED: f"the trunk leaned by more than {lean:.0f} deg {when}",
        LET_GO: f"a hand let go of its crutch, more than {reach:.2f} m from the shoulder {when}",
    }
    if status not in reasons:
        return RunStatus.COMPLETED, ""
    return RunStatus.DIVERGED if status == DIVERGED else RunStatus.FELL, reasons[status]


def result_of(
    problem: Problem,
    episode: Any,
    rows: np.ndarray,
    switches: tuple[PhaseSwitch, ...],
    done: int,
    ended: tuple[RunStatus, str],
) -> EngineResult:
    """The result of a run of some ticks from its record, plain or NumPy's; ``ended``: how, and why."""
    trip, traffic = trip_of(problem, episode), bus_traffic(problem, episode, done)
    return EngineResult(rows, switches, *ended, trip, traffic)


def switches_of(
    problem: Problem, switches: Iterable[tuple[int, int, int, int, int]]
) -> tuple[PhaseSwitch, ...]:
    """Changes of phase by name, of tick, leg, source, target and transition of each."""
    names, sides = problem.table.phase_names, problem.sides
    causes = [item.cause for item in problem.table.transitions]
    return tuple(
        PhaseSwitch(
            tick, sides[leg], names[source], names[target], causes[chosen] if chosen >= 0 else POSTURE, chosen
        )
        for tick, leg, source, target, chosen in switches
    )


def run_in_chunks(
    problem: Problem,
    chunk: int,
    run_ticks: Callable[[int, int], tuple[int, int]],
    progress: Callable[[int, int], None] | None,
    should_stop: Callable[[], bool] | None,
) -> tuple[int, tuple[RunStatus, str]]:
    """Run to the end of the experiment, or to a fall, divergence or a request to stop.

    ``run_ticks``: from first tick and one past the last of a chunk to the ticks run since the start and the
    status of the episode. Returns the ticks run, and how it ended, and why.
    """
    total, done = problem.experiment.n_ticks, 0
    status, reason = RunStatus.COMPLETED, ""
    while done < total and status is RunStatus.COMPLETED:
        if progress is not None:
            progress(done, total)
        if should_stop is not None and should_stop():
            status, reason = RunStatus.INTERRUPTED, stopped_reason(done)
            break
        done, code = run_ticks(done, min(done + chunk, total))
        status, reason = ending_of(code, done, problem)
    if progress is not None:
        progress(done, total)
    return done, (status, reason)


def stopped_reason(ticks: int) -> str:
    """Why a run that was asked to stop ended."""
    return f"stopped at {ticks * TICK:.3f} s"
