"""Values: expressions in C with their kind, and literals."""

import math
from dataclasses import dataclass, replace
from typing import Self

from twin_gait.firmware.kinds import BOOL, INT, REAL, Kind, ListKind, Scalar

# Precedence of operators in C; an operand with a higher precedence needs no brackets.
PRIMARY, UNARY, PRODUCT, SUM, SHIFT, RELATION, EQUALITY, BIT_AND, BIT_XOR, BIT_OR, AND, OR, CHOICE = range(
    13, 0, -1
)


@dataclass(frozen=True, slots=True)
class Value:
    """An expression in C."""

    kind: Kind
    text: str
    binds: int = PRIMARY  # precedence of its last operator
    # Origin of a record or a list: whether the text is its address, the name from which it is reached, and
    # the fields (None for entries) between.
    is_address: bool = False
    name: str = ""
    fields: tuple[tuple[type, str] | None, ...] = ()

    def inside(self, binds: int) -> str:
        """Return the text as an operand, in brackets if they are needed."""
        return self.text if self.binds >= binds else f"({self.text})"

    def in_kind(self, target: Kind) -> Self:
        """Convert a number to a kind that can represent it; for a record or a list, return its address."""
        if not isinstance(self.kind, Scalar):
            direct = self.is_address or isinstance(self.kind, ListKind)
            return replace(self, text=self.text if direct else f"&{self.text}", binds=UNARY)
        if target is not REAL or self.kind is REAL:
            return self
        return replace(self, kind=REAL, text=f"(real){self.inside(UNARY)}", binds=UNARY)


def number(value: bool | int | float, kind: Scalar) -> str:
    """Return a literal."""
    if kind is BOOL:
        return "true" if value else "false"
    if kind is INT:
        return str(int(value))
    value = float(value)
    if math.isnan(value):
        return "NAN"
    sign = "-" if math.copysign(1.0, value) < 0.0 else ""
    return f"{sign}INFINITY" if math.isinf(value) else f"{sign}REAL({abs(value)!r})"
