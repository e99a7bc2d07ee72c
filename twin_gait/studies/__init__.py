"""Many runs: batches, sweeps, tuning, comparison, faults, campaigns, and the job runner under all of them.

What is offered here is imported when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.studies.campaign import Campaign, Protocol, TwoWayProtocol, planned_tests
    from twin_gait.studies.jobs import JobFailed, Workers, run_jobs
    from twin_gait.studies.processes import WorkersLost

__all__ = [
    "Campaign",
    "JobFailed",
    "Protocol",
    "TwoWayProtocol",
    "Workers",
    "WorkersLost",
    "planned_tests",
    "run_jobs",
]

_HOMES = {
    "Campaign": "campaign",
    "JobFailed": "jobs",
    "Protocol": "campaign",
    "TwoWayProtocol": "campaign",
    "Workers": "jobs",
    "WorkersLost": "processes",
    "planned_tests": "campaign",
    "run_jobs": "jobs",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
