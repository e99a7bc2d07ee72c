"""What becomes of a live walk if a change is applied: its present moment run ahead in a process of its own.

``python -m twin_gait.live.forecast`` speaks as :mod:`twin_gait.live.process` does. It is handed a moment of
the walk and the numbers of the change, lets them fade in as the walk would, and runs on for ``LEAST`` ticks
and as much longer as ``BUDGET`` allows; the walk itself knows nothing of it. What a change does may depend on
the moment of the stride in which it is made, which nobody chooses to the tenth of a second: it is tried at
``LATER`` further moments.
"""

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.files import dump, finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.live.process import begin
from twin_gait.live.stepping import SteppedRun
from twin_gait.live.walk import LiveWalk
from twin_gait.measures.leg_record import LegRecord, leg_record
from twin_gait.measures.outcome import gait_verdict
from twin_gait.runs.leg_summary import summarise_side
from twin_gait.simulation.engine import EngineResult
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulator import run_of
from twin_gait.vocabulary import Outcome
from twin_gait.worlds.scenario import BELT_SPEED

HORIZON = 20_000  # ticks that are looked ahead at most
LEAST = 8_000  # ticks that are looked ahead in any case: four strides; a change that fells does so by then
BUDGET = 0.25  # [s] of computing after which the look ahead ends where it is
HELD_TICKS = 2_000  # ticks of a hold that are looked at: a wearer who falls in it has fallen by then
LATER, APART = 3, 450  # moments at which the change is tried as well, ticks apart: quarters of a stride
PIECE_TICKS, BLOCK_TICKS = 250, 10  # that are run at a time: usually, and while steps wait for a hand
NICENESS = 5  # the walk goes first


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """What comes."""

    text: str  # in one sentence
    bad: bool  # whether the wearer falls or hangs, the monitor trips, the walk stalls or the state diverges
    horizon_s: float  # how far ahead was looked, in [s]
    # mean deviation of both sides from the reference by joint in [deg] RMS, from the second stride on; None
    # where there is no reference or no stride
    rmse_deg: Mapping[str, float | None]
    # share of the time in which the most loaded joint is at a limit of torque, current or voltage
    saturated_share: float


def foresee(
    walk: LiveWalk,
    moment: Mapping[str, Any],
    numbers: Mapping[str, Any],
    *,
    now: Callable[[], float] = time.perf_counter,
    horizon: int = HORIZON,
) -> Forecast:
    """Run a moment ahead with other settings.

    ``walk`` of the same experiment; what it did before is forgotten; ``moment`` of a ``LiveWalk``; ``now``:
    time in [s], for the budget. Returns the forecast; of a walk that is over, that of a new start.
    """
    until = now() + BUDGET
    least = min(LEAST, horizon)
    first = _run_ahead(walk, moment, numbers, range(least, horizon + 1), lambda: now() > until)
    run, begun = walk.run, "after a new start " if first == 0 and moment["run"]["tick"] > 0 else ""
    ends, ahead = _endings(walk, first), f"for the {(run.tick - first) * TICK:.0f} s looked ahead"
    shown = _shown(walk, first, numbers)
    records = _records(shown, first)
    sides = [summarise_side(shown, record, 1) for record in records]
    verdict, bad = gait_verdict(records), bool(ends)
    if ends:
        told = ends
    elif not (numbers["watching"] and records[0].steady):
        told = f"does not fall {ahead}"
    elif run.waiting():
        told = f"waits for a step {ahead}"
    elif verdict.outcome is Outcome.WALKED:
        told = f"walks on {ahead}"
    else:
        told, bad = f"{verdict.outcome} {ahead}: {verdict.reason}", True
    # The other looks come last: the walk forgets the change over them.
    if begun == "" and ends and _ends_anyway(walk, moment, run.tick - first):
        told += ", as it does without the change"
    elif begun == "" and numbers["watching"] and bad == bool(ends):
        tried = enumerate(_later(walk, moment, numbers, least), 1)
        number, later = next(((n, ended) for n, ended in tried if bool(ended) != bad), (0, ""))
        if number:
            told += f"; made {number * APART * TICK:.1f} s later it {later or 'does not'}"
            bad = True
    return Forecast(
        text=begun + told,
        bad=bad,
        horizon_s=len(shown.log) * TICK,
        rmse_deg=_deviations(sides),
        saturated_share=max(item["saturated_share"] for side in sides for item in side["joints"].values()),
    )


def _run_ahead(
    walk: LiveWalk,
    moment: Mapping[str, Any],
    numbers: Mapping[str, Any] | None,
    ticks: range,
    enough: Callable[[], bool],
) -> int:
    """Run on from a moment, or from the start if that walk is over, by the first to last ticks of a range."""
    run = walk.run
    walk.go_on_from(moment)
    ended = run.trip is not None or run.status is not RunStatus.COMPLETED
    if numbers is not None:
        walk.set(numbers)
    if ended:
        walk.restart()
    first = run.tick
    piece = PIECE_TICKS if run.held_phase is None else BLOCK_TICKS
    while run.status is RunStatus.COMPLETED and (done := run.tick - first) < ticks[-1]:
        held = run.trip is not None and run.tick - run.trip.tick >= HELD_TICKS
        if held or (done >= ticks[0] and enough()):
            break
        walk.advance(min(piece, ticks[-1] - done))
    return first


def _ends_anyway(walk: LiveWalk, moment: Mapping[str, Any], ticks: int) -> bool:
    """Whether a walk ends within some ticks without a change."""
    looked = range(ticks, ticks + 1)
    return bool(_endings(walk, _run_ahead(walk, moment, None, looked, lambda: True)))


def _later(
    walk: LiveWalk, moment: Mapping[str, Any], numbers: Mapping[str, Any], ticks: int
) -> Iterator[str]:
    """How the walk ends within some ticks of the change if that is made at each of the later moments."""
    for _ in range(LATER):
        if _ends_anyway(walk, moment, APART):
            return
        moment = walk.moment()
        looked = range(ticks, ticks + 1)
        yield _endings(walk, _run_ahead(walk, moment, numbers, looked, lambda: True))


def _endings(walk: LiveWalk, first: int) -> str:
    """How a walk ended after a first tick, in words; of one that goes on nothing."""
    run, found = walk.run, []
    if run.trip is not None:
        found.append(f"trips after {(run.trip.tick - first) * TICK:.1f} s ({run.trip.text})")
    if run.status is not RunStatus.COMPLETED:
        what = {RunStatus.FELL: "falls", RunStatus.DIVERGED: "diverges"}[run.status]
        found.append(f"{what} after {(run.tick - first) * TICK:.1f} s")
    return " and ".join(found)


def _shown(walk: LiveWalk, first: int, numbers: Mapping[str, Any]) -> Run:
    """What was looked ahead, as a run that begins with its first tick."""
    run, problem = walk.run, walk.run.problem
    experiment, speed = problem.experiment, numbers["belt_speed"]
    if speed and experiment.scenario.adjusts(BELT_SPEED):
        experiment = replace(experiment, scenario=experiment.scenario.adjusted(BELT_SPEED, speed))
    switches = tuple(item._replace(tick=item.tick - first) for item in run.switches())
    # Whatever tripped: the legs are looked at to the end.
    result = EngineResult(run.rows(first), switches, run.status, run.reason)
    return run_of(replace(problem, experiment=experiment), result, 0.0)


def _records(shown: Run, first: int) -> list[LegRecord]:
    """Both legs, with the time of even walking counted from the first tick."""
    begin, end = (max(time - first * TICK, 0.0) for time in shown.experiment.scenario.steady)
    steady = ((begin, end),) if shown.experiment.modes is None else shown.steady
    names = shown.table.phase_names
    return [
        leg_record(shown.log, side, names, TICK, steady=steady, waiting=shown.waiting) for side in shown.sides
    ]


def _deviations(sides: list[dict[str, Any]]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for joint in sides[0]["joints"]:
        of_sides = [side.get(f"rmse_{joint}_by_contact_deg", np.nan) for side in sides]
        found[joint] = finite_or_none(float(np.mean(of_sides)))
    return found


def main() -> int:
    """Read the set-up, then requests, until the input ends."""
    os.nice(NICENESS)
    setup, output = begin(signal.SIGINT, signal.SIGHUP, signal.SIGTERM)
    if setup is None:
        return 0
    problem = build_problem(experiment_from_mapping(setup["document"], "experiment", Path()))
    walk = LiveWalk(SteppedRun(problem))
    foresee(walk, walk.moment(), setup["numbers"], horizon=PIECE_TICKS)  # the first one takes longest
    for line in sys.stdin:
        request = json.loads(line)
        if request["command"] == "end":
            break
        found = asdict(foresee(walk, request["moment"], request["numbers"]))
        answer = {"kind": "answer", "serial": request["serial"], "refused": "", "forecast": found}
        output.write(dump(answer) + "\n")
        output.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
