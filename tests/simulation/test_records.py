"""One definition of a record: its dtype, its numbers, its copies."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st

from twin_gait import load_experiment
from twin_gait.parameters.quantities import from_attributes
from twin_gait.simulation.binding import kernel_functions, specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.record import ABSENT, deep_copy, dtype_of, to_array
from twin_gait.simulation.simulation_setup import build_setup


@dataclass(slots=True)
class Inner:
    gain: float
    count: int = 0


@dataclass(slots=True)
class Outer:
    flag: bool
    number: int
    value: float
    row: list[float]
    table: list[list[float]]
    inner: Inner
    many: list[Inner]
    spare: list[Inner] = field(default_factory=list)
    missing: Inner = ABSENT


def outer() -> Outer:
    many = [Inner(0.25, 1), Inner(4.0, 2)]
    return Outer(True, -3, 0.1, [1.0, 2.0, 3.0], [[1.5, 2.5], [3.5, 4.5]], Inner(0.5, 7), many)


def numpy_record(sample: Any) -> Any:
    store = to_array(sample)
    assert store.shape == (1,) and store.dtype == dtype_of(sample)
    return store[0]


# ------------------------------------------------------------------ class and instance to dtype


def test_types_come_from_the_class_and_lengths_from_the_instance() -> None:
    inner = np.dtype([("gain", "f8"), ("count", "i8")], align=True)
    assert dtype_of(outer()) == np.dtype(
        [
            ("flag", "i8"),
            ("number", "i8"),
            ("value", "f8"),
            ("row", "f8", (3,)),
            ("table", "f8", (2, 2)),
            ("inner", inner),
            ("many", inner, (2,)),
        ],
        align=True,
    )


def test_a_record_is_aligned_as_c_would() -> None:
    dtype = dtype_of(outer())
    assert dtype.isalignedstruct
    assert dtype.fields is not None
    assert {dtype.fields[name][1] % 8 for name in dtype.names or ()} == {0}  # also behind the single byte


def test_a_whole_number_in_a_field_of_floats_makes_no_whole_numbers_of_it() -> None:
    assert dtype_of(Inner(1))["gain"] == np.float64
    assert numpy_record(Inner(1))["gain"] == 1.0


def test_absent_and_empty_fields_are_left_out() -> None:
    names = dtype_of(outer()).names or ()
    assert "spare" not in names and "missing" not in names
    filled = outer()
    filled.spare, filled.missing = [Inner(1.0)], Inner(2.0)
    assert set(dtype_of(filled).names or ()) - set(names) == {"spare", "missing"}


# ------------------------------------------------------------------ instance to record


def test_every_value_is_written_to_the_field_of_its_name() -> None:
    record = numpy_record(outer())
    assert (bool(record["flag"]), int(record["number"]), float(record["value"])) == (True, -3, 0.1)
    assert record["row"].tolist() == [1.0, 2.0, 3.0]
    assert record["table"].tolist() == [[1.5, 2.5], [3.5, 4.5]]
    assert record["inner"].tolist() == (0.5, 7)
    assert record["many"].tolist() == [(0.25, 1), (4.0, 2)]


@given(st.floats(), st.integers(-(2**63), 2**63 - 1), st.booleans())
def test_numbers_are_kept_to_the_bit(value: float, number: int, flag: bool) -> None:
    sample = outer()
    sample.value, sample.number, sample.flag = value, number, flag
    record = numpy_record(sample)
    assert np.float64(value).tobytes() == record["value"].tobytes()
    assert (int(record["number"]), bool(record["flag"])) == (number, flag)


def check_written(sample: Any, record: Any) -> int:
    """Compare an instance with what was written, name by name; gives the numbers compared."""
    if isinstance(sample, list):
        return sum(check_written(item, record[index]) for index, item in enumerate(sample))
    if not is_dataclass(sample):
        assert record == sample or (math.isnan(sample) and math.isnan(record))
        return 1
    count = 0
    for item in fields(sample):
        value = getattr(sample, item.name)
        if value is ABSENT or value == []:
            assert item.name not in record.dtype.names
        else:
            count += check_written(value, record[item.name])
    return count


CASES = [
    ("bench_leg", ()),
    ("treadmill_guided", ()),
    ("treadmill_start_stop", ()),
    ("treadmill_guided", ("patient=stroke_left", "interface=brace", "faults=['motor_dead:left_hip@0.1s']")),
]


@pytest.mark.parametrize(("preset", "settings"), CASES)
def test_a_whole_episode_is_written_without_padding(preset: str, settings: tuple[str, ...]) -> None:
    problem = build_setup(load_experiment(preset, [*settings]).experiment)
    _, episode, _ = assemble(problem)
    record = numpy_record(episode)
    count = check_written(episode, record)
    assert 300 < count and record.dtype.itemsize == 8 * count  # a bool is filled up to 8 bytes


@pytest.mark.parametrize(("preset", "settings"), CASES)
def test_every_column_of_the_log_is_read_in_the_record(preset: str, settings: tuple[str, ...]) -> None:
    problem = build_setup(load_experiment(preset, [*settings]).experiment)
    layout, (_, episode, structure) = log_layout(problem), assemble(problem)
    write_row = specialize(kernel_functions(layout.writer, {})["write_row"], structure)
    row = [math.nan] * len(layout.names)
    write_row(episode, row)
    found = dict(zip(layout.names, row, strict=True))
    assert all(math.isfinite(value) for value in row)
    for joint in problem.joints:
        assert found[f"{joint.side}_{joint.joint}_angle_rad"] == problem.world.start_q[joint.coordinate]


# ------------------------------------------------------------------ copies


def test_a_copy_is_equal_and_shares_nothing() -> None:
    first = outer()
    second = deep_copy(first)
    assert second == first
    second.row[0] = second.table[0][0] = second.inner.gain = second.many[1].gain = 99.0
    second.spare.append(Inner(1.0))
    assert first == outer()


@dataclass(frozen=True)
class Parameters:
    gain: float = 0.75
    other: str = "not part of the record"


def test_a_record_is_taken_from_attributes_of_the_same_names() -> None:
    assert from_attributes(Inner, Parameters(), count=4) == Inner(0.75, 4)
    assert from_attributes(Inner, Parameters(), gain=1.0, count=4) == Inner(1.0, 4)


def test_a_field_with_a_default_keeps_it_if_nothing_sets_it() -> None:
    assert from_attributes(Inner, Parameters()) == Inner(0.75, 0)


# ------------------------------------------------------------------ what must fail


def test_a_record_that_lacks_an_attribute_is_not_made_up() -> None:
    with raises(TypeError, "Inner", "gain"):
        from_attributes(Inner, object(), count=1)


def test_a_field_that_the_record_does_not_have_is_refused() -> None:
    with raises(TypeError, "Inner", "surplus"):
        from_attributes(Inner, Parameters(), count=1, surplus=2)


@dataclass(slots=True)
class Ragged:
    rows: list[list[float]]


@dataclass(slots=True)
class Many:
    entries: list[Ragged]


@pytest.mark.parametrize(
    "sample", [Ragged([[1.0, 2.0], [3.0]]), Many([Ragged([[1.0]]), Ragged([[1.0], [2.0]])])]
)
def test_lists_of_unlike_length_are_refused(sample: Any) -> None:
    with pytest.raises((ValueError, TypeError)):
        to_array(sample)


def test_slots_refuse_a_name_that_is_misspelt() -> None:
    with pytest.raises(AttributeError):
        outer().vlaue = 1.0  # type: ignore[attr-defined]
