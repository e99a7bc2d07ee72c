"""Ranges of numbers, with the reason for their limits."""

import dataclasses
import math
from dataclasses import dataclass
from numbers import Real

from twin_gait.exceptions import ParameterError


def require(condition: bool, name: str, expected: str, value: object) -> None:
    """Raise a :class:`ParameterError` unless a condition is true.

    ``condition``: the required condition. ``name``: name of the parameter for the user. ``expected``: the
    accepted values, in words. ``value``: the given value. Raises ParameterError if the condition is false.
    """
    if not condition:
        raise ParameterError(f"{name}: expected {expected}, got {value!r}")


SMALLEST_SHARE = 1e-30  # Minimum of a number above 0 as a share of its largest value.


@dataclass(frozen=True)
class Range:
    """Range of a number."""

    minimum: float = -math.inf  # Smallest value.
    maximum: float = math.inf  # Largest value.
    exclusive_minimum: bool = False  # Whether the smallest value itself is excluded.
    words: str = ""  # Accepted values, for messages; made from the numbers if empty.
    # Whether infinity is included, too: a time that is never reached, ``null`` in a file.
    allows_infinity: bool = False
    reason: str = ""  # Reason for the limits, for messages and pages.

    def contains(self, value: float) -> bool:
        """Check whether a value is within the range."""
        if value == math.inf:
            return self.allows_infinity
        inside = (
            self.minimum < value <= self.maximum
            if self.exclusive_minimum
            else self.minimum <= value <= self.maximum
        )
        if self.exclusive_minimum and self.minimum == 0.0 and math.isfinite(self.maximum):
            # A value so far below the largest one is a mistake; a division by it overflows.
            inside = SMALLEST_SHARE * self.maximum <= value <= self.maximum
        return inside and math.isfinite(value)

    def fill_limits(self, general: "Range") -> "Range":
        """Return the range with missing limits, and the reason, taken from a general range."""
        least = self.minimum if math.isfinite(self.minimum) else general.minimum
        most = self.maximum if math.isfinite(self.maximum) else general.maximum
        if (least, most) == (self.minimum, self.maximum):
            return self
        return dataclasses.replace(
            self, minimum=least, maximum=most, words="", reason=self.reason or general.reason
        )

    def convert_unit(self, factor: float) -> "Range":
        """Return the range in a unit, given by its value in SI; ``words`` are in SI and dropped otherwise."""
        words = self.words if factor == 1.0 else ""
        return dataclasses.replace(
            self, minimum=self.minimum / factor, maximum=self.maximum / factor, words=words
        )

    def require(self, name: str, value: float, *, whole: bool = False) -> None:
        """Raise a :class:`ParameterError` unless a value, or a whole number, is within the range."""
        fits = isinstance(value, int if whole else Real)
        if not (fits and self.contains(value)):  # The text of the range is only made for an error.
            require(False, name, self.expected, value)

    @property
    def expected(self) -> str:
        """Accepted values, in words."""
        if self.words:
            return self.words
        reason = f" ({self.reason})" if self.reason else ""
        if math.isfinite(self.maximum):
            link = (
                f"above {self.minimum:g} and at most"
                if self.exclusive_minimum
                else f"from {self.minimum:g} to"
            )
            return f"a number {link} {self.maximum:g}{reason}"
        if math.isinf(self.minimum):
            return "a finite number"
        return (
            f"a number above {self.minimum:g}"
            if self.exclusive_minimum
            else f"a number of {self.minimum:g} or more"
        )


# Ranges by sign; limits that are not given are those of the quantity.
POSITIVE, NOT_NEGATIVE, SHARE = Range(0.0, exclusive_minimum=True), Range(0.0), Range(0.0, 1.0)
FINITE, NON_NEGATIVE_OR_INFINITE = Range(), Range(0.0, allows_infinity=True)
SEEDS = Range(0, 2**64 - 1, words="a whole number from 0 to 2^64 - 1")


def integer_range(least: int, most: int, reason: str) -> Range:
    """Return a range of whole numbers."""
    return Range(least, most, words=f"a whole number from {least} to {most} ({reason})")


def symmetric_range(most: float, reason: str) -> Range:
    """Return the range of a quantity that may have either sign; the sign of a field narrows it."""
    return Range(-most, most, reason=reason)
