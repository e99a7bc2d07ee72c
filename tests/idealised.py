"""Limit cases that files may not contain, such as a rotor of 10⁶ kg·m², for tests against closed forms."""

from __future__ import annotations

import copy
from typing import TypeVar

Record = TypeVar("Record")


def idealised(parameters: Record, **changes: float) -> Record:
    """Return a copy of parameters with values outside of their ranges."""
    made = copy.copy(parameters)
    for name, value in changes.items():
        assert hasattr(made, name)
        object.__setattr__(made, name, value)
    return made
