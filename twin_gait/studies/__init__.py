"""What people do with many runs: sweep, tune, compare, put them to the test."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.studies.campaign import (
        Campaign,
        PlannedTest,
        Protocol,
        TwoWayProtocol,
        planned_tests,
        run_campaign,
    )

__all__ = [
    "Campaign",
    "PlannedTest",
    "Protocol",
    "TwoWayProtocol",
    "planned_tests",
    "run_campaign",
]

_HOMES = {
    "Campaign": "campaign",
    "PlannedTest": "campaign",
    "Protocol": "campaign",
    "TwoWayProtocol": "campaign",
    "planned_tests": "campaign",
    "run_campaign": "campaign",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
