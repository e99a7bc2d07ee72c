"""Assessment of a change before it is applied: by the rules of ``twin-gait check``, and by a forecast.

The forecast simulates the walk ahead from a snapshot, outside of its process and without an effect on it. The
numbers of the change fade in over the same time as in the walk.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin_gait.checking import published_ranges, stability, stuck_phases, torques
from twin_gait.checking.check import build_case
from twin_gait.checking.finding import CheckCase, Rule, Severity, once
from twin_gait.files import finite_or_none
from twin_gait.gait.table import TICK
from twin_gait.live.journal import LogChunk, walked_run
from twin_gait.measures.leg_record import LegRecord, leg_record
from twin_gait.measures.outcome import EventKind, judge_gait
from twin_gait.runs.leg_summary import MeasuredLeg, saturated_shares
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.settings import WALK, Settings, loop_numbers
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.vocabulary import JointName, Outcome

HORIZON = 10_000  # ticks of a forecast: five strides, within which a change that causes a fall does so
HELD_TICKS = 2_000  # ticks of a forecast after a trip, within which a wearer who falls in the hold has fallen
CHUNK_TICKS = 250  # ticks that are simulated at a time
ENDINGS = {EventKind.TRIP: "trips", EventKind.FALL: "falls", EventKind.DIVERGENCE: "diverges"}

# Rules that k, b, θ0 and G can break; an error of one of them rejects a change. The phases of the monitor's
# controls are all alike, so that no phase must be left and no torque jumps at a switch.
REJECTING_RULES: tuple[Rule, ...] = (stability.unstable, stuck_phases.cannot_leave, torques.torque_jump)
# Rules whose findings are warnings of the forecast.
WARNING_RULES: tuple[Rule, ...] = (
    published_ranges.unusual_stiffness,
    published_ranges.equilibrium_beyond_limits,
    published_ranges.unusual_gain,
    stability.effective_damping,
)

FindingKey = tuple[str, str | None, str | None, str | None]  # rule, phase, transition and side of a finding


@once
def _build_check_case(settings: Settings) -> CheckCase:
    """Build the case of the check from settings."""
    return build_case(settings.active_experiment.table, settings.active_experiment, settings.active_setup)


def find_errors(settings: Settings) -> dict[FindingKey, str]:
    """Return the errors of the check that make settings unsafe: the identity of each and a sentence."""
    case = _build_check_case(settings)
    rules = REJECTING_RULES if settings.mode == WALK else REJECTING_RULES[:1]
    found = [item for rule in rules for item in rule(case) if item.severity is Severity.ERROR]
    errors: dict[FindingKey, str] = {}
    for item in found:
        where = item.transition or item.phase
        text = f"{item.rule}{f' ({where})' if where else ''}: {item.reason}; {item.suggestion}"
        errors[item.rule, item.phase, item.transition, item.side] = text
    return errors


@once
def find_warnings(settings: Settings) -> list[str]:
    """Return the warnings of the check about unusual values, one sentence each."""
    case = _build_check_case(settings)
    found = [item for rule in WARNING_RULES for item in rule(case)]
    return [f"{item.phase.replace('_', ' ')}: {item.reason}" if item.phase else item.reason for item in found]


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """Forecast of a change."""

    text: str  # result in one sentence
    bad: bool  # whether the wearer falls or hangs, the monitor trips, the walk stalls or the state diverges
    # RMSE from the reference by joint in [deg], mean of both sides, from the second stride on; null without a
    # reference or a stride
    rmse_deg: Mapping[str, float | None]
    # share of the time in which the most loaded joint is at a limit of torque, current or voltage
    saturated_share: float
    warnings: tuple[str, ...] = ()  # warnings of the check about unusual values in the change


def predict(
    run: SteppedRun, snapshot: Mapping[str, Any], settings: Settings, warnings: tuple[str, ...] = ()
) -> Forecast:
    """Predict a walk from a snapshot with other settings.

    ``run`` of the same experiment, whose previous state is overwritten; ``snapshot``: snapshot of another
    run; ``warnings`` for the forecast. Returns the forecast; if the walk is over, the forecast of a restart.
    """
    run.restore(snapshot)
    over = run.trip is not None or run.status is not RunStatus.COMPLETED
    run.set(loop_numbers(settings))
    if over:
        run.restart()
    first = run.tick
    while run.status is RunStatus.COMPLETED and run.tick - first < HORIZON:
        if run.trip is not None and run.tick - run.trip.tick >= HELD_TICKS:
            break
        run.advance(CHUNK_TICKS)
    switches = tuple(item._replace(tick=item.tick - first) for item in run.switches())
    # The trip is omitted, so that the legs are measured to the end.
    walk = LogChunk(rows=run.rows(first), switches=switches, status=run.status, reason=run.reason)
    ahead = replace(settings.experiment, duration=round(len(walk.rows) * TICK, 3), faults=())
    shown = walked_run(walk, run.setup, ahead)
    records = _records(shown, first)
    legs = [MeasuredLeg(shown, record, 1) for record in records]
    sides = [leg.contact_measures() for leg in legs]
    text, bad = _describe_result(run, first, records)
    off = {
        str(joint): float(
            np.mean(
                [
                    side.get(f"rmse_{joint}_by_contact_deg", np.nan)
                    for side, record in zip(sides, records, strict=True)
                    if joint in record.angles
                ]
            )
        )
        for joint in JointName
        if any(joint in record.angles for record in records)
    }
    return Forecast(
        text=f"after a new start {text}" if over else text,
        bad=bad,
        rmse_deg={joint: finite_or_none(value) for joint, value in off.items()},
        saturated_share=saturated_shares(legs)["worst_joint_saturated_share"],
        warnings=warnings,
    )


def _describe_result(run: SteppedRun, first: int, records: Sequence[LegRecord]) -> tuple[str, bool]:
    """Return the result of a walk after its first tick in one sentence, and whether it is bad."""
    endings = [event for event in run.events if event.kind in ENDINGS]
    if endings:
        times = (f"{ENDINGS[event.kind]} after {event.time - first * TICK:.1f} s" for event in endings)
        return " and ".join(times) + (f" ({run.trip.text})" if run.trip else ""), True
    ahead = f"for the {(run.tick - first) * TICK:.0f} s looked ahead"
    if not (run.numbers["watching"] and records[0].steady) or run.waiting_legs():
        return f"does not fall {ahead}", False
    outcome, reason = judge_gait(records)
    if outcome is Outcome.WALKED:
        return f"walks on {ahead}", False
    if outcome is Outcome.TOO_SHORT:
        return f"makes no whole stride {ahead}", True
    return f"{outcome} {ahead}: {reason}", True


def _records(shown: Run, first: int) -> list[LegRecord]:
    """Return the records of both legs, with the steady part counted from the first tick."""
    begin, end = (max(time - first * TICK, 0.0) for time in shown.experiment.scenario.steady)
    steady = ((begin, end),) if shown.experiment.modes is None else shown.steady_spans
    waiting = shown.waiting_mask
    return [
        leg_record(
            shown.columns, side, shown.leg_table(side).phase_names, TICK, steady=steady, waiting=waiting
        )
        for side in shown.sides
    ]
