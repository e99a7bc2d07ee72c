"""Static checks of a gait table: what can go wrong, found without a run.

A rule is a function ``(case: CheckCase) -> list[Finding]``; its name is the id of its findings and the first
line of its docstring says what it finds. Each module lists its rules in ``RULES``. Public are the pieces of
the rules on stability: the closed-loop transition matrix and the friction laws in it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.checking.hanging_leg import friction_slope, friction_torque, linear_loops
    from twin_gait.checking.linear_loop import LinearLoop, leg_motion, spectral_radius, transition_matrix
    from twin_gait.checking.stability import largest_stable

__all__ = [
    "LinearLoop",
    "friction_slope",
    "friction_torque",
    "largest_stable",
    "leg_motion",
    "linear_loops",
    "spectral_radius",
    "transition_matrix",
]

_HOMES = {
    "LinearLoop": "linear_loop",
    "friction_slope": "hanging_leg",
    "friction_torque": "hanging_leg",
    "largest_stable": "stability",
    "leg_motion": "linear_loop",
    "linear_loops": "hanging_leg",
    "spectral_radius": "linear_loop",
    "transition_matrix": "linear_loop",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
