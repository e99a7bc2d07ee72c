"""``twin-gait benchmark``: the compiled engine and its peers, in one process and in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.experiment import IntegrationMethod
from twin_gait.gait.table import TICK
from twin_gait.studies.accuracy import REFINEMENT
from twin_gait.studies.benchmark.contestant import Contestant
from twin_gait.studies.benchmark.engines import ENGINE_CONTESTANTS, EngineSession, SimulateSession
from twin_gait.studies.benchmark.measurement import (
    Entry,
    Progress,
    Timing,
    machine,
    speed_ratio,
    time_in_turn,
)
from twin_gait.studies.benchmark.mujoco import MUJOCO_CONTESTANTS
from twin_gait.studies.benchmark.plain import PLAIN
from twin_gait.studies.benchmark.ratios import WALK_SUBJECT, judge, verdict_rows
from twin_gait.studies.benchmark.scaling import (
    CHAINS,
    EPISODES,
    JOINTS,
    QUICK_EPISODES,
    QUICK_JOINTS,
    WORKERS,
    scale_batch,
    scale_joints,
)
from twin_gait.studies.benchmark.subjects import RK4_TENTH_MS, Case, cases_of
from twin_gait.studies.validation.mujoco_witness import import_mujoco

SCHEMA_VERSION = 1
CONTESTANTS: tuple[Contestant, ...] = (*ENGINE_CONTESTANTS, PLAIN, *MUJOCO_CONTESTANTS)
JUDGED = ("compiled", "batch")  # the contestants that others are set in relation to
STAGES = {IntegrationMethod.SEMI_IMPLICIT_EULER: 1, IntegrationMethod.RK4: 4}


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How much is measured.

    Attributes:
        rounds: Rounds that count.
        evaluations: Of the dynamics in one run of native code.
        python_evaluations: Likewise of a contestant that steps through Python.
        joints: Sizes of the chains.
        episodes: Sizes of the batches.
        walk_ticks: Length of the walk that is timed as a whole.
    """

    rounds: int = 15
    evaluations: int = 20_000
    python_evaluations: int = 2_000
    joints: tuple[int, ...] = JOINTS
    episodes: tuple[int, ...] = EPISODES
    walk_ticks: int = 20_000


QUICK = Extent(
    rounds=5,
    evaluations=5_000,
    python_evaluations=400,
    joints=QUICK_JOINTS,
    episodes=QUICK_EPISODES,
)


def benchmark(
    only: str | None = None, extent: Extent | None = None, *, progress: Progress | None = None
) -> dict[str, Any]:
    """Time all contestants of all cases, and how their cost grows.

    Args:
        only: One subject, without the scaling; None for everything.
        extent: How much is measured; in full if None.
        progress: Called with runs done and in all.

    Returns:
        The document: machine, cases, walk, scaling, verdicts; plain values for JSON. ``left_out`` says
        which contestants are missing and why.

    Raises:
        ParameterError: If there is no such subject.
    """
    extent = extent or Extent()
    cases = cases_of(only)
    contestants, left_out = _available()
    document: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "rounds": extent.rounds,
        "machine_before": machine(),
        "left_out": left_out,
    }
    with_mujoco = not left_out
    with _counted(progress, _runs(cases, contestants, extent, with_mujoco, only)) as on_run:
        document["cases"] = [_case_document(case, contestants, extent, on_run) for case in cases]
        if only in (None, WALK_SUBJECT):
            document["walk"] = _time_walk(extent, on_run)
        if only is None:
            document["scaling"] = {
                "joints": scale_joints(extent.joints, extent.rounds, mujoco=with_mujoco, on_run=on_run),
                "batch": scale_batch(extent.episodes, extent.rounds, mujoco=with_mujoco, on_run=on_run),
            }
    document["load_average_after"] = machine()["load_average"]
    document["verdicts"] = verdict_rows(judge(document))
    return document


def _available() -> tuple[list[Contestant], list[str]]:
    """Contestants that can run here, and a line for those that cannot."""
    try:
        import_mujoco()
    except MissingOptionalDependency as missing:
        return [item for item in CONTESTANTS if item.needs is None], [f"MuJoCo: {missing}"]
    return list(CONTESTANTS), []


def _runs(
    cases: Sequence[Case],
    contestants: Sequence[Contestant],
    extent: Extent,
    with_mujoco: bool,
    only: str | None,
) -> int:
    """Runs in all, for the progress."""
    turns = len(cases) * len(contestants)
    if only in (None, WALK_SUBJECT):
        turns += 1
    if only is None:
        chains = len(CHAINS) if with_mujoco else len(CHAINS) - 1
        batches = len(WORKERS) * (2 if with_mujoco else 1)
        turns += chains * len(extent.joints) + batches * len(extent.episodes)
    return turns * (extent.rounds + 1)


@contextmanager
def _counted(progress: Progress | None, total: int) -> Iterator[Callable[[], None]]:
    done = 0

    def on_run() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    if progress is not None:
        progress(0, total)
    yield on_run


# ---------------------------------------------------------------------- one case


def ticks_of(case: Case, contestant: Contestant, extent: Extent) -> int:
    """Length of one run of a contestant.

    Args:
        case: The case.
        contestant: The contestant.
        extent: How much is measured.

    Returns:
        Ticks, of each episode; native code runs at least as long as its angles are compared. Episodes of a
        batch are no shorter than a single one: people run them for seconds, not for a few hundred ticks.
    """
    per_tick = STAGES[case.integration.method] * case.integration.substeps
    if not contestant.compiled:
        return max(1, extent.python_evaluations // per_tick)
    return max(case.compared_ticks, extent.evaluations // per_tick)


def _case_document(
    case: Case, contestants: Sequence[Contestant], extent: Extent, on_run: Callable[[], None]
) -> dict[str, Any]:
    lengths = {item.name: ticks_of(case, item, extent) for item in contestants}
    sessions = {item.name: item.open(case, lengths[item.name]) for item in contestants}
    entries = [
        Entry(item.name, sessions[item.name], lengths[item.name] * item.episodes) for item in contestants
    ]
    times = time_in_turn(entries, extent.rounds, on_run)
    reference = reference_angles(case)
    rows = []
    for item in contestants:
        error = angle_error(case, item, lengths[item.name], sessions[item.name].angles(), reference)
        rows.append(_row(item, lengths[item.name], times, error))
    return {
        "subject": case.subject,
        "stepping": case.stepping,
        "method": str(case.integration.method),
        "step_s": case.integration.step,
        "joints": reference.shape[1],
        "compared_ticks": case.compared_ticks,
        "rows": rows,
    }


def _row(item: Contestant, ticks: int, times: Mapping[str, Timing], error: float | None) -> dict[str, Any]:
    timing = times[item.name]
    return {
        "contestant": item.name,
        "label": item.label,
        "ticks": ticks,
        "episodes": item.episodes,
        "ns_per_tick": timing.median,
        "ns_per_tick_quartiles": list(timing.quartiles),
        "realtime_factor": TICK / (timing.median * 1e-9),
        "processor_share": float(np.median(timing.processor)),
        "processor_ns_per_tick": timing.processor_median,
        "ratio_to": {name: speed_ratio(timing, times[name]) for name in JUDGED if name != item.name},
        "largest_angle_error_rad": error,
    }


def reference_angles(case: Case) -> np.ndarray:
    """Coordinates of a case by Runge-Kutta at a tenth of the finest step of the subject.

    Args:
        case: The case.

    Returns:
        Shape ``(compared_ticks, nv)``.
    """
    steps = [item.integration for item in cases_of(case.subject)]
    finest = min((item for item in steps if item.method is IntegrationMethod.RK4), key=lambda item: item.step)
    fine = replace(case.experiment, integration=replace(finest, step=finest.step / REFINEMENT))
    session = EngineSession(replace(case, experiment=fine), case.compared_ticks, compiled=True)
    session.run()
    angles = session.angles()
    assert angles is not None  # it records
    return angles


def angle_error(
    case: Case, item: Contestant, ticks: int, angles: np.ndarray | None, reference: np.ndarray
) -> float | None:
    """Largest difference of an angle from the reference, over the compared ticks.

    Args:
        case: The case.
        item: The contestant.
        ticks: Length of its timed runs.
        angles: Of its last run; None if it makes another motion or keeps no record.
        reference: From :func:`reference_angles`.

    Returns:
        In [rad] (the height of a pelvis in [m]), or None.
    """
    if angles is None:
        return None
    if ticks < case.compared_ticks:
        session = item.open(case, case.compared_ticks)
        session.run()
        angles = session.angles()
        assert angles is not None  # it gave some before
    difference = np.abs(angles[: case.compared_ticks] - reference)
    return float(difference.max())


def _time_walk(extent: Extent, on_run: Callable[[], None]) -> dict[str, Any]:
    """The preset of the treadmill as ``twin-gait simulate`` runs it."""
    (case,) = [item for item in cases_of(WALK_SUBJECT) if item.integration == RK4_TENTH_MS]
    session = SimulateSession(case, extent.walk_ticks)
    timing = time_in_turn([Entry("walk", session, 1)], extent.rounds, on_run)["walk"]
    run = session.last
    assert run is not None  # it has just run
    low, high = timing.quartiles
    return {
        "stepping": case.stepping,
        "duration_s": run.duration,
        "status": str(run.status),
        "wall_s": timing.median * 1e-9,
        "wall_s_quartiles": [low * 1e-9, high * 1e-9],
        "loop_wall_s": run.wall_s,
    }
