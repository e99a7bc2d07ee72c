"""Tests that unsupported code is refused in one line with function, line and construct."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from errors import raises

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.printer import TranslationUnit, print_units
from twin_gait.simulation.record import ABSENT


@dataclass(slots=True)
class Cell:
    """Something small.

    Attributes:
        charge: In [C].
        count: Of something.
        row: Numbers.
        absent: Nothing.
    """

    charge: float = 0.0
    count: int = 0
    row: list[float] = field(default_factory=lambda: [0.0, 0.0])
    absent: float = ABSENT


def printed(function: Callable[..., Any], **names: Any) -> str:
    return print_units([TranslationUnit("unit", [function], {})], names, shapes=[Cell()]).files["unit.c"]


def bump(cell: Cell) -> int:
    cell.count += 1
    return cell.count


def again(x: float) -> float:
    return again(x)


def while_loop(x: float) -> float:
    while x > 0.0:
        x -= 1.0
    return x


def comprehension(x: float) -> float:
    return sum([x for _ in range(3)])


def library_call(x: float) -> float:
    return math.sqrt(x)


def power(x: float) -> float:
    return x**2


def two_kinds(x: float) -> float:
    y = 1
    y = x
    return y


def text(x: float) -> float:
    name = "x"
    return x if name else 0.0


def number_as_truth(x: int) -> bool:
    return x and True


def no_such_field(cell: Cell) -> float:
    return cell.absent


def whole_record(cell: Cell, other: Cell) -> None:
    cell.row = other.row


def order(cell: Cell) -> int:
    return cell.count + bump(cell)


def order_of_a_target(cell: Cell) -> None:
    cell.row[cell.count] = 1.0 * bump(cell)


def exchanged(cell: Cell, x: float) -> None:
    cell.charge, cell.count = x, int(cell.charge > 0.0)


def from_the_end(cell: Cell) -> float:
    return cell.row[-1]


def unknown_length(row: list[float]) -> int:
    return len(row)


def counted_twice(x: int) -> int:
    for i in range(3):
        i = 3
        x += i
    return x


def ends_elsewhere(x: int) -> int:
    for i in range(x):
        x += i
    return x


def ends_where_a_call_says(cell: Cell) -> None:
    for _ in range(cell.count):
        bump(cell)


def of_a_dictionary(x: dict[str, float]) -> float:
    return x["x"]


def pair(x: float) -> tuple[float, float]:
    return x, -x


def passed_on(x: float) -> tuple[float, float]:
    return pair(x)


@pytest.mark.parametrize(
    "function, line, expected",
    [
        (again, 0, "recursion"),
        (while_loop, 1, "while x > 0.0: x = x - 1.0: this kind of statement"),
        (comprehension, 1, "sum"),
        (library_call, 1, "math.sqrt(x): this function"),
        (power, 1, "x ** 2: this kind of arithmetic"),
        (two_kinds, 2, "x: is real where int32_t is expected"),
        (text, 1, "'x': this kind of expression cannot be printed"),
        (number_as_truth, 1, "is int32_t where bool is expected"),
        (no_such_field, 1, "cell.absent: no sample of Cell has the field absent"),
        (whole_record, 1, "cell.row: a record or list can only be changed entry by entry"),
        (order, 1, "bump(cell): changes records in an expression"),
        (order_of_a_target, 1, "bump(cell): changes records in an expression"),
        (exchanged, 1, "values are exchanged"),
        (from_the_end, 1, "counted from its beginning"),
        (unknown_length, 1, "row: is not a list with one known length"),
        (counted_twice, 1, "i: the loop variable must not be assigned"),
        (ends_where_a_call_says, 1, "cell.count: may change in the loop"),
        (ends_elsewhere, 1, "x: may change in the loop"),
        (passed_on, 1, "pair(x): several numbers of another function"),
        (of_a_dictionary, 0, "x has a type that cannot be printed"),
    ],
    ids=lambda item: getattr(item, "__name__", ""),
)
def test_refused(function, line, expected):
    with pytest.raises(FirmwareError) as caught:
        printed(function)
    message = str(caught.value)
    first = function.__code__.co_firstlineno
    assert message.startswith(f"{__name__}.{function.__name__}, line {first + line}: ")
    assert expected in message and "\n" not in message


def test_two_constants_of_one_name_are_refused(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name, level in (("lower", 1.0), ("higher", 2.0)):
        (tmp_path / f"{name}_of_two.py").write_text(
            f"LEVEL = {level}\ndef {name}(x: float) -> float:\n    return x + LEVEL\n"
        )
    entries = [getattr(importlib.import_module(f"{name}_of_two"), name) for name in ("lower", "higher")]
    with raises(FirmwareError, "LEVEL"):
        print_units([TranslationUnit("unit", entries, {})])


def test_a_generated_function_is_named_too():
    def called(x: float) -> float:
        raise NotImplementedError

    with raises(FirmwareError, "generated.called", "line 2", "nothing"):
        print_units([TranslationUnit("unit", [called], {})], text="def called(x):\n    return x + nothing\n")


def shortened(cell: Cell, x: float) -> float:
    if DEAD and no_such_name:  # noqa: F821
        return no_such_name  # noqa: F821
    kept, count = x, cell.count
    if not DEAD or x > 1.0:
        kept += 1.0
    return kept + count


DEAD = False


def test_code_disabled_by_a_build_flag_is_not_checked():
    text = printed(shortened)
    assert "no_such_name" not in text and "if" not in text.split("shortened(")[1]
