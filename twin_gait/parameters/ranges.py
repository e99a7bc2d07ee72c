"""Ranges of numbers, with the reason why nothing lies outside."""

import dataclasses
import math
from dataclasses import dataclass
from numbers import Real

from twin_gait.exceptions import ParameterError


def require(condition: bool, name: str, expected: str, value: object) -> None:
    """Raise a :class:`ParameterError` unless a condition holds.

    ``condition``: what must be true. ``name``: name of the parameter as the user knows it. ``expected``: what
    would have been right, in words. ``value``: what was given. Raises ParameterError if the condition is
    false.
    """
    if not condition:
        raise ParameterError(f"{name}: expected {expected}, got {value!r}")


SMALLEST_SHARE = 1e-30  # of the largest value, which a number above 0 has at least


@dataclass(frozen=True)
class Range:
    """Range of a number."""

    least: float = -math.inf  # Least value.
    most: float = math.inf  # Largest value.
    above: bool = False  # Whether the least value itself is outside.
    words: str = ""  # What is expected, for messages; made from the numbers where empty.
    endless: bool = False  # Whether infinity is meant, too: a time that never comes, ``null`` in a file.
    reason: str = ""  # Why nothing lies outside, for messages and pages.

    def holds(self, value: float) -> bool:
        """Return whether a value lies within."""
        if value == math.inf:
            return self.endless
        inside = self.least < value <= self.most if self.above else self.least <= value <= self.most
        if self.above and self.least == 0.0 and math.isfinite(self.most):
            # So much less than the largest value is a mistake; divided by it, other numbers overflow.
            inside = SMALLEST_SHARE * self.most <= value <= self.most
        return inside and math.isfinite(value)

    def completed(self, general: "Range") -> "Range":
        """Return the range with the ends of a general one, and its reason, where it has none of its own."""
        least = self.least if math.isfinite(self.least) else general.least
        most = self.most if math.isfinite(self.most) else general.most
        if (least, most) == (self.least, self.most):
            return self
        return dataclasses.replace(
            self, least=least, most=most, words="", reason=self.reason or general.reason
        )

    def in_unit(self, factor: float) -> "Range":
        """The range in a unit, given by its value in SI; words, which say it in SI, stay there."""
        words = self.words if factor == 1.0 else ""
        return dataclasses.replace(self, least=self.least / factor, most=self.most / factor, words=words)

    def require(self, name: str, value: float, *, whole: bool = False) -> None:
        """Raise a :class:`ParameterError` unless a value, or a whole number, lies within."""
        fits = isinstance(value, int if whole else Real)
        if not (fits and self.holds(value)):  # the expected range is put into words only for an error
            require(False, name, self.expected, value)

    @property
    def expected(self) -> str:
        """What is expected, in words."""
        if self.words:
            return self.words
        reason = f" ({self.reason})" if self.reason else ""
        if math.isfinite(self.most):
            link = f"above {self.least:g} and at most" if self.above else f"from {self.least:g} to"
            return f"a number {link} {self.most:g}{reason}"
        if math.isinf(self.least):
            return "a finite number"
        return f"a number above {self.least:g}" if self.above else f"a number of {self.least:g} or more"


# Signs; the ends that are left open are those of the quantity.
POSITIVE, NOT_NEGATIVE, SHARE = Range(0.0, above=True), Range(0.0), Range(0.0, 1.0)
FINITE, LATER = Range(), Range(0.0, endless=True)
SEEDS = Range(0, 2**64 - 1, words="a whole number from 0 to 2^64 - 1")


def whole(least: int, most: int, reason: str) -> Range:
    """Return a range of whole numbers."""
    return Range(least, most, words=f"a whole number from {least} to {most} ({reason})")


def within(most: float, reason: str) -> Range:
    """Return the range of a quantity that may have either sign; the sign of a field narrows it."""
    return Range(-most, most, reason=reason)
