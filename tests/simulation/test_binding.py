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
def module() -> ModuleType:
    """A module of this package, and one function in it that is of another."""
    made, other = ModuleType("twin_gait.module_of_a_test"), ModuleType("elsewhere")
    exec("FACTOR = 10.0\ndef foreign(x):\n    return FACTOR * x", other.__dict__)
    exec(ROOMS, made.__dict__)
    made.foreign = other.foreign  # type: ignore[attr-defined]
    return made


def test_globals_change_in_all_called_functions(module: ModuleType) -> None:
    bound = specialize(module.entry, {"FACTOR": 5.0})
    assert bound(1.5) == 5.0 * 1.5 + 1 + 5.0
    assert specialize(module.entry, {"law": lambda x: -x})(1.5) == -1.5 + 1 + 2.0


def test_the_original_is_unchanged(module: ModuleType) -> None:
    before, names = dict(vars(module)), {"FACTOR": 5.0, "law": lambda x: 0.0}
    specialize(module.entry, names)
    assert dict(vars(module)) == before
    assert module.entry(1.5) == 2.0 * 1.5 + 1 + 2.0


def test_two_specializations_are_independent(module: ModuleType) -> None:
    first, second = (specialize(module.entry, {"FACTOR": factor}) for factor in (3.0, 4.0))
    assert (first(1.0), second(1.0)) == (3.0 + 1 + 3.0, 4.0 + 1 + 4.0)


def test_a_function_may_call_itself(module: ModuleType) -> None:
    assert specialize(module.power, {"FACTOR": 3.0})(2.0, 2) == 36.0
    assert module.power(2.0, 2) == 16.0


def test_functions_may_call_each_other_in_a_ring(module: ModuleType) -> None:
    wrapped: list[FunctionType] = []
    bound = specialize(module.even, {}, lambda function: wrapped.append(function) or function)  # type: ignore[func-returns-value]
    assert bound(7) is False and bound(8) is True
    assert [function.__name__ for function in wrapped] == ["even", "odd"]
    assert wrapped[1].__globals__["even"] is bound


def test_functions_of_other_packages_are_not_specialized(module: ModuleType) -> None:
    bound = specialize(module.outside, {"FACTOR": 5.0})
    assert bound(1.0) == 10.0 + 5.0
    assert bound.__globals__["foreign"] is module.foreign
    assert specialize(module.middle, {}).__globals__["math"] is module.math


def test_calls_in_a_comprehension_are_specialized(module: ModuleType) -> None:
    assert specialize(module.summed, {"FACTOR": 5.0})(3) == 5.0 * 3 + 3
    assert specialize(module.applied, {"FACTOR": 5.0})([1.0, 2.0]) == [5.0, 10.0]


def test_defaults_and_closures_are_kept(module: ModuleType) -> None:
    assert specialize(module.by_default, {"FACTOR": 5.0})(1.0) == 2.0 + 1.0 + 5.0
    weight = 7.0

    def closure(x: float) -> float:
        return weight * x

    assert specialize(closure, {"weight": 1.0})(2.0) == 14.0


def test_every_function_is_wrapped_once(module: ModuleType) -> None:
    wrapped: list[str] = []

    def wrap(function: FunctionType) -> Any:
        wrapped.append(function.__qualname__)
        return lambda *values: ("wrapped", function(*values))

    assert specialize(module.middle, {"math": ModuleType("math")}, wrap)
    assert wrapped == ["middle", "law"]


def is_reused(function: Any, before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Whether a second binding of a function is that of the first."""
    made: dict[Any, Any] = {}
    first = specialize(function, before, cache=made)
    return specialize(function, after, cache=made) is first


def test_a_cached_specialization_is_reused_if_all_its_names_are_equal(module: ModuleType) -> None:
    def other(x: float) -> float:
        return -x

    assert is_reused(module.entry, {"FACTOR": 5.0}, {"FACTOR": 5.0, "UNKNOWN": 1})
    assert is_reused(module.summed, {"law": other}, {"law": other})
    assert not is_reused(module.entry, {"FACTOR": 5.0}, {"FACTOR": 6.0})
    assert not is_reused(module.summed, {"FACTOR": 5.0}, {"FACTOR": 6.0})  # named in what it calls
    assert not is_reused(module.entry, {}, {"law": other})
    assert not is_reused(module.middle, {}, {"math": ModuleType("math")})
    assert not is_reused(module.even, {}, {})  # in a ring


@pytest.mark.parametrize("after", [0, 0.0, False])
def test_equal_numbers_of_another_type_are_different_keys(module: ModuleType, after: float) -> None:
    assert not is_reused(module.law, {"FACTOR": -0.0}, {"FACTOR": after})
    assert not is_reused(module.law, {"FACTOR": (-0.0, 1)}, {"FACTOR": (after, 1)})
    assert is_reused(module.law, {"FACTOR": (after, 1)}, {"FACTOR": (after, 1)})
    assert not is_reused(module.law, {"FACTOR": np.float64(0.0)}, {"FACTOR": after})


def test_defaults_and_closures_count_too(module: ModuleType) -> None:
    def times(weight: float) -> FunctionType:
        return lambda x: weight * x  # type: ignore[return-value]

    made: dict[Any, Any] = {}
    two, three, again = (specialize(times(weight), {}, cache=made) for weight in (2.0, 3.0, 2.0))
    assert (two(1.0), three(1.0)) == (2.0, 3.0) and again is two
    before = specialize(module.by_default, {}, cache=made)
    module.by_default.__kwdefaults__ = {"offset": 2.0}
    assert specialize(module.by_default, {}, cache=made)(1.0) == before(1.0) + 1.0


def test_an_attribute_named_like_a_function_is_not_a_call(module: ModuleType) -> None:
    exec("def whole(x):\n    return x.law\ndef law(x):\n    return unknown_name", vars(module))
    wrapped: list[str] = []
    specialize(module.whole, {}, lambda function: wrapped.append(function.__name__) or function)  # type: ignore[func-returns-value]
    assert wrapped == ["whole"]


def test_objects_that_are_not_functions_are_refused(module: ModuleType) -> None:
    with pytest.raises(AssertionError):
        specialize(np.sin, {})


def test_specialized_laws_of_this_package_give_the_same_results() -> None:
    bound = specialize(impedance_torque, {})
    assert bound is not impedance_torque
    assert bound(0.3, 2.0, 100.0, 10.0, 0.2) == impedance_torque(0.3, 2.0, 100.0, 10.0, 0.2)
    force = specialize(ground_contact_force, {"contact_normal_force": lambda *_: 100.0})
    assert force(Ground(1.0, 3e5, 0.5, 0.8, 0.05), 3e5, 0.5, -0.01, 5.0, 0.0)[1] == 100.0


def test_functions_of_a_generated_kernel_count_as_own_functions() -> None:
    text = "def double(x):\n    return twice(x)\n\ndef quadruple(x):\n    return double(double(x))\n"

    def twice(x: float) -> float:
        return 2.0 * x

    functions = kernel_functions(text, {"twice": twice})
    assert set(functions) == {"double", "quadruple"}
    assert functions["quadruple"](1.0) == 4.0
    assert specialize(functions["quadruple"], {"twice": lambda x: 3.0 * x})(1.0) == 9.0
