"""Many runs: batches, sweeps, tuning, comparison, faults, and the job runner under all of them.

What is offered here is imported when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.studies.batch import overridden
    from twin_gait.studies.campaign import Campaign, Protocol, TwoWayProtocol, planned_tests
    from twin_gait.studies.fault_campaign import (
        FaultCampaign,
        draw_faults,
        fault_row,
        outcome_table,
        simulate_faults,
    )
    from twin_gait.studies.jobs import JobFailed, Workers, run_jobs
    from twin_gait.studies.processes import WorkersLost
    from twin_gait.studies.sweep.spec import load_sweep
    from twin_gait.studies.sweep.sweep import run_sweep
    from twin_gait.studies.tune.parts import rate_walk
    from twin_gait.studies.tune.tune import tuned_table
    from twin_gait.studies.virtual_people import BodySizes, cohort

__all__ = [
    "BodySizes",
    "Campaign",
    "FaultCampaign",
    "JobFailed",
    "Protocol",
    "TwoWayProtocol",
    "Workers",
    "WorkersLost",
    "cohort",
    "draw_faults",
    "fault_row",
    "load_sweep",
    "outcome_table",
    "overridden",
    "planned_tests",
    "rate_walk",
    "run_jobs",
    "run_sweep",
    "simulate_faults",
    "tuned_table",
]

_HOMES = {
    "BodySizes": "virtual_people",
    "Campaign": "campaign",
    "JobFailed": "jobs",
    "Protocol": "campaign",
    "TwoWayProtocol": "campaign",
    "Workers": "jobs",
    "WorkersLost": "processes",
    "cohort": "virtual_people",
    "load_sweep": "sweep.spec",
    "overridden": "batch",
    "planned_tests": "campaign",
    "rate_walk": "tune.parts",
    "run_jobs": "jobs",
    "run_sweep": "sweep.sweep",
    "tuned_table": "tune.tune",
    "FaultCampaign": "fault_campaign",
    "draw_faults": "fault_campaign",
    "fault_row": "fault_campaign",
    "outcome_table": "fault_campaign",
    "simulate_faults": "fault_campaign",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
