"""A test kit for anyone's gait table.

    >>> from twin_gait.testing import transition_tests
    >>> from twin_gait.configuration.gait_table_file import load_gait_table
    >>> tests = transition_tests(load_gait_table("treadmill"))
    >>> for test in tests:
    ...     test.run()

The pytest plugin (:mod:`twin_gait.testing.plugin`) lives here too and is loaded by every pytest, so
names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_gait.testing.approval import approval_text
    from twin_gait.testing.cases import TransitionTest, transition_tests
    from twin_gait.testing.mutation import Mutant, mutants

__all__ = ["Mutant", "TransitionTest", "approval_text", "mutants", "transition_tests"]

_HOMES = {
    "Mutant": "mutation",
    "TransitionTest": "cases",
    "approval_text": "approval",
    "mutants": "mutation",
    "transition_tests": "cases",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that pytest starts as fast as without the kit."""
    if name not in _HOMES:
        raise AttributeError(f"module 'twin_gait.testing' has no attribute {name!r}")
    return getattr(import_module(f"twin_gait.testing.{_HOMES[name]}"), name)
