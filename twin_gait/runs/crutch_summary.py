"""What crutches do in a run, in numbers, and what becomes of it without them."""

import math
from dataclasses import replace
from typing import Any

from twin_gait.gait.table import TICK
from twin_gait.measures.crutches import TRUNK_PITCH, crutch_use
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate


def crutch_summary(run: Run) -> dict[str, Any]:
    """Way, lean and arms of a run with a free trunk; nothing for one whose pelvis is guided.

    The run is repeated without crutches: what the arms are needed for is not left to belief.
    """
    if TRUNK_PITCH not in run.log or len(run.log) == 0:
        return {}
    log = run.log
    way = float(log["pelvis_forward_m"].iloc[-1] - log["pelvis_forward_m"].iloc[0])
    lean = log[TRUNK_PITCH]
    energy = float(log["battery_power_W"].sum()) * TICK
    uses = {side: crutch_use(log, side, TICK, run.body_weight) for side in run.sides}
    arms = {str(side): _in_words(use.__dict__) for side, use in uses.items() if use is not None}
    return {
        "free_trunk": {
            "distance_m": way,
            "speed_m_per_s": way / run.duration,
            "lean_lowest_deg": math.degrees(float(lean.min())),
            "lean_highest_deg": math.degrees(float(lean.max())),
            "battery_energy_per_metre_J": energy / way if way > 0.0 else None,
            "arms": arms,
            "without_arms": _without_arms(run),
        }
    }


def _in_words(use: dict[str, float]) -> dict[str, float]:
    units = {"impulse": "Ns", "push_peak": "N", "moment_peak": "Nm", "work_done": "J", "work_taken": "J"}
    return {f"{name}_{units[name]}" if name in units else name: value for name, value in use.items()}


def _without_arms(run: Run) -> dict[str, Any] | None:
    """How the same run ends without crutches, and when."""
    world = run.experiment.scenario.without_aids()
    if world is None:
        return None
    bare = simulate(replace(run.experiment, scenario=world))
    return {"status": str(bare.status), "reason": bare.reason, "duration_s": bare.duration}
