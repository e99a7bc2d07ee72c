"""Functions with other globals: all the way down, and nothing else touched."""

from __future__ import annotations

from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest

from twin_gait.core.contact import Ground, ground_contact_force
from twin_gait.core.impedance import impedance_torque
from twin_gait.simulation.binding import kernel_functions, specialize

ROOMS = """
import math
import numpy as np

FACTOR, FLAG = 2.0, False

def entry(x):
    return middle(x) + FACTOR

def middle(x):
    return law(x) + math.floor(x)

def law(x):
    if FLAG:
        return unknown_name
    return FACTOR * x

def power(x, n):
    return 1.0 if n == 0 else FACTOR * x * power(x, n - 1)

def even(n):
    return True if n == 0 else odd(n - 1)

def odd(n):
    return False if n == 0 else even(n - 1)

def outside(x):
    return foreign(x) + FACTOR

def summed(n):
    return sum(law(i) for i in range(n)) + len([law(i) for i in range(n)])

def applied(xs):
    return list(map(lambda x: FACTOR * x, xs))

def by_default(x, factor=FACTOR, *, offset=1.0):
    return factor * x + offset + FACTOR
"""


@pytest.fixture
def rooms() -> ModuleType:
    """A module of this package, and one function in it that is of another."""
    made, other = ModuleType("twin_gait.rooms_of_a_test"), ModuleType("elsewhere")
    exec("FACTOR = 10.0\ndef foreign(x):\n    return FACTOR * x", other.__dict__)
    exec(ROOMS, made.__dict__)
    made.foreign = other.foreign  # type: ignore[attr-defined]
    return made


def test_globals_change_all_the_way_down(rooms: ModuleType) -> None:
    bound = specialize(rooms.entry, {"FACTOR": 5.0})
    assert bound(1.5) == 5.0 * 1.5 + 1 + 5.0
    assert specialize(rooms.entry, {"law": lambda x: -x})(1.5) == -1.5 + 1 + 2.0


def test_the_original_stays_as_it_was(rooms: ModuleType) -> None:
    before, names = dict(vars(rooms)), {"FACTOR": 5.0, "law": lambda x: 0.0}
    specialize(rooms.entry, names)
    assert dict(vars(rooms)) == before
    assert rooms.entry(1.5) == 2.0 * 1.5 + 1 + 2.0


def test_two_bindings_do_not_know_each_other(rooms: ModuleType) -> None:
    first, second = (specialize(rooms.entry, {"FACTOR": factor}) for factor in (3.0, 4.0))
    assert (first(1.0), second(1.0)) == (3.0 + 1 + 3.0, 4.0 + 1 + 4.0)


def test_a_function_may_call_itself(rooms: ModuleType) -> None:
    assert specialize(rooms.power, {"FACTOR": 3.0})(2.0, 2) == 36.0
    assert rooms.power(2.0, 2) == 16.0


def test_functions_may_call_each_other_in_a_ring(rooms: ModuleType) -> None:
    wrapped: list[FunctionType] = []
    bound = specialize(rooms.even, {}, lambda function: wrapped.append(function) or function)  # type: ignore[func-returns-value]
    assert bound(7) is False and bound(8) is True
    assert [function.__name__ for function in wrapped] == ["even", "odd"]
    assert wrapped[1].__globals__["even"] is bound


def test_functions_of_others_are_called_as_they_are(rooms: ModuleType) -> None:
    bound = specialize(rooms.outside, {"FACTOR": 5.0})
    assert bound(1.0) == 10.0 + 5.0
    assert bound.__globals__["foreign"] is rooms.foreign
    assert specialize(rooms.middle, {}).__globals__["math"] is rooms.math


def test_what_a_comprehension_calls_is_bound_too(rooms: ModuleType) -> None:
    assert specialize(rooms.summed, {"FACTOR": 5.0})(3) == 5.0 * 3 + 3
    assert specialize(rooms.applied, {"FACTOR": 5.0})([1.0, 2.0]) == [5.0, 10.0]


def test_defaults_and_closures_are_kept(rooms: ModuleType) -> None:
    assert specialize(rooms.by_default, {"FACTOR": 5.0})(1.0) == 2.0 + 1.0 + 5.0
    weight = 7.0

    def closure(x: float) -> float:
        return weight * x

    assert specialize(closure, {"weight": 1.0})(2.0) == 14.0


def test_every_function_is_wrapped_once(rooms: ModuleType) -> None:
    wrapped: list[str] = []

    def wrap(function: FunctionType) -> Any:
        wrapped.append(function.__qualname__)
        return lambda *values: ("wrapped", function(*values))

    assert specialize(rooms.middle, {"math": ModuleType("math")}, wrap)
    assert wrapped == ["middle", "law"]


def of_before(room: Any, before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Whether a second binding of a function is that of the first."""
    made: dict[Any, Any] = {}
    first = specialize(room, before, cache=made)
    return specialize(room, after, cache=made) is first


def test_what_was_made_before_is_taken_if_all_that_it_names_is_the_same(rooms: ModuleType) -> None:
    def other(x: float) -> float:
        return -x

    assert of_before(rooms.entry, {"FACTOR": 5.0}, {"FACTOR": 5.0, "UNKNOWN": 1})
    assert of_before(rooms.summed, {"law": other}, {"law": other})
    assert not of_before(rooms.entry, {"FACTOR": 5.0}, {"FACTOR": 6.0})
    assert not of_before(rooms.summed, {"FACTOR": 5.0}, {"FACTOR": 6.0})  # named in what it calls
    assert not of_before(rooms.entry, {}, {"law": other})
    assert not of_before(rooms.middle, {}, {"math": ModuleType("math")})
    assert not of_before(rooms.even, {}, {})  # in a ring


@pytest.mark.parametrize("after", [0, 0.0, False])
def test_equal_numbers_of_another_kind_are_others(rooms: ModuleType, after: float) -> None:
    assert not of_before(rooms.law, {"FACTOR": -0.0}, {"FACTOR": after})
    assert not of_before(rooms.law, {"FACTOR": (-0.0, 1)}, {"FACTOR": (after, 1)})
    assert of_before(rooms.law, {"FACTOR": (after, 1)}, {"FACTOR": (after, 1)})
    assert not of_before(rooms.law, {"FACTOR": np.float64(0.0)}, {"FACTOR": after})


def test_defaults_and_closures_count_too(rooms: ModuleType) -> None:
    def times(weight: float) -> FunctionType:
        return lambda x: weight * x  # type: ignore[return-value]

    made: dict[Any, Any] = {}
    two, three, again = (specialize(times(weight), {}, cache=made) for weight in (2.0, 3.0, 2.0))
    assert (two(1.0), three(1.0)) == (2.0, 3.0) and again is two
    before = specialize(rooms.by_default, {}, cache=made)
    rooms.by_default.__kwdefaults__ = {"offset": 2.0}
    assert specialize(rooms.by_default, {}, cache=made)(1.0) == before(1.0) + 1.0


def test_an_attribute_of_the_name_of_a_function_is_no_call_of_it(rooms: ModuleType) -> None:
    exec("def whole(x):\n    return x.law\ndef law(x):\n    return unknown_name", vars(rooms))
    wrapped: list[str] = []
    specialize(rooms.whole, {}, lambda function: wrapped.append(function.__name__) or function)  # type: ignore[func-returns-value]
    assert wrapped == ["whole"]


def test_what_is_no_function_is_refused(rooms: ModuleType) -> None:
    with pytest.raises(AssertionError):
        specialize(np.sin, {})


def test_laws_of_this_package_are_bound_and_give_what_they_gave() -> None:
    bound = specialize(impedance_torque, {})
    assert bound is not impedance_torque
    assert bound(0.3, 2.0, 100.0, 10.0, 0.2) == impedance_torque(0.3, 2.0, 100.0, 10.0, 0.2)
    force = specialize(ground_contact_force, {"contact_normal_force": lambda *_: 100.0})
    assert force(Ground(1.0, 3e5, 0.5, 0.8, 0.05), -0.01, 5.0, 0.0)[1] == 100.0


def test_functions_of_a_generated_kernel_count_as_ours() -> None:
    text = "def double(x):\n    return twice(x)\n\ndef quadruple(x):\n    return double(double(x))\n"

    def twice(x: float) -> float:
        return 2.0 * x

    functions = kernel_functions(text, {"twice": twice})
    assert set(functions) == {"double", "quadruple"}
    assert functions["quadruple"](1.0) == 4.0
    assert specialize(functions["quadruple"], {"twice": lambda x: 3.0 * x})(1.0) == 9.0
