"""Checks of parameters; each ends in one line with the name, what was expected, and what was given."""

from __future__ import annotations

import math

from twin_gait.exceptions import ParameterError


def require(condition: bool, name: str, expected: str, value: object) -> None:
    """Raise a :class:`ParameterError` that names the parameter unless a condition holds.

    Args:
        condition: What must be true.
        name: Name of the parameter as the user knows it.
        expected: What would have been right, in words.
        value: What was given.

    Raises:
        ParameterError: If the condition is false.
    """
    if not condition:
        raise ParameterError(f"{name}: expected {expected}, got {value!r}")


def require_positive(name: str, value: float) -> None:
    """Raise unless a value is a finite number above zero.

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it is not.
    """
    require(math.isfinite(value) and value > 0.0, name, "a number above 0", value)


def require_non_negative(name: str, value: float) -> None:
    """Raise unless a value is a finite number, zero or above.

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it is not.
    """
    require(math.isfinite(value) and value >= 0.0, name, "a number of 0 or more", value)


def require_share(name: str, value: float) -> None:
    """Raise unless a value lies in [0, 1].

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it does not.
    """
    require(0.0 <= value <= 1.0, name, "a number from 0 to 1", value)


def require_count(name: str, value: int) -> None:
    """Raise unless a value is a whole number above zero.

    Args:
        name: Name of the parameter as the user knows it.
        value: The value.

    Raises:
        ParameterError: If it is not.
    """
    require(isinstance(value, int) and value >= 1, name, "a whole number above 0", value)
