"""Every parameter is declared once, in its class; keys and checks are made of that."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field, replace
from importlib import import_module
from pkgutil import walk_packages
from typing import Annotated, Any

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st

import twin_gait
from twin_gait import load_experiment
from twin_gait.configuration.custom_sections import section_of
from twin_gait.exceptions import ParameterError
from twin_gait.parameters.quantities import (
    NON_NEGATIVE_OR_INFINITE,
    POSITIVE,
    Angle,
    CustomSerialized,
    Key,
    Parameters,
    Range,
    Time,
    UnitInKeys,
    declarations,
)
from twin_gait.parameters.wearer import JointCondition, Patient
from twin_gait.vocabulary import JointName, SegmentModel, Side


def subclasses(kind: type[Any]) -> set[type[Any]]:
    """All classes that derive from one, in the package."""
    found = {item for item in kind.__subclasses__() if item.__module__.startswith("twin_gait.")}
    return found.union(*(subclasses(item) for item in kind.__subclasses__()))


for module in walk_packages(twin_gait.__path__, "twin_gait."):
    if module.name.split(".")[1] in ("parameters", "experiment", "worlds", "gait", "control", "leg_model"):
        import_module(module.name)
CLASSES = sorted(
    (kind for kind in subclasses(Parameters) if hasattr(kind, "__dataclass_fields__")),
    key=lambda kind: kind.__name__,
)


def test_declarations_include_the_parameters_of_an_experiment() -> None:
    names = {kind.__name__ for kind in CLASSES}
    assert {"Experiment", "Treadmill", "SafetyParameters", "JointImpedance", "Patient"} <= names


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_every_parameter_has_a_description(kind: type[Any]) -> None:
    for item in declarations(kind):
        assert item.meaning, f"{item.name}: no meaning in the docstring of its class"
        if item.kind is float:
            assert item.unit is not None, f"{item.name}: no unit"
            assert item.range is not None, f"{item.name}: no range"
        if item.range is not None and item.default is not MISSING and item.default is not None:
            item.coerce(item.default)


@dataclass(frozen=True, kw_only=True)
class Sample(Parameters):
    """Parameters of a test.

    Attributes:
        swing: How far it swings
            and no further.
        pause: Until it starts; see :func:`math.sin`.
        posture: Of the joints.
    """

    swing: Annotated[Angle, Range(0.0, math.pi)]
    pause: Annotated[Time, NON_NEGATIVE_OR_INFINITE, Key("rest")] = math.inf
    posture: Annotated[dict[JointName, Angle], UnitInKeys()] = field(default_factory=dict)


def test_keys_follow_from_name_and_unit() -> None:
    swing, pause, posture = declarations(Sample)
    assert list(swing.keys) == ["swing_rad", "swing_deg"]
    assert list(pause.keys) == ["rest_s", "rest_ms"]
    assert list(posture.keys) == ["posture"]
    assert swing.meaning == "How far it swings and no further."
    assert pause.meaning == "Until it starts; see `math.sin`."
    assert (swing.default, pause.default) == (MISSING, math.inf)


@pytest.mark.parametrize("value", [-0.1, 3.2, math.nan, math.inf])
def test_a_value_out_of_its_range_is_refused_by_name(value: float) -> None:
    with raises(ParameterError, "swing", "0", "3.14159"):
        Sample(swing=value)


def test_an_entry_of_a_mapping_is_refused_by_its_name() -> None:
    with raises(ParameterError, "posture", "knee", "-3.14159", "nan"):
        Sample(swing=1.0, posture={JointName.KNEE: math.nan})


def test_numpy_numbers_and_enumeration_words_are_converted_to_the_type_of_the_field() -> None:
    made = Sample(swing=np.float32(0.5), pause=np.int64(2), posture={"knee": np.float64(0.1)})  # type: ignore[dict-item]
    assert made == Sample(swing=0.5, pause=2, posture={JointName.KNEE: 0.1})
    assert [type(value) for value in (made.swing, made.pause, *made.posture.values())] == [float, int, float]
    assert next(iter(made.posture)) is JointName.KNEE
    patient = Patient(segment_model="winter", conditions={("left", "knee"): JointCondition()})  # type: ignore
    assert patient.segment_model is SegmentModel.WINTER and next(iter(patient.conditions))[0] is Side.LEFT


@pytest.mark.parametrize("value", ["0.5", None, np.array(0.5), [0.5]])
def test_values_that_are_not_numbers_are_refused_by_name(value: Any) -> None:
    with raises(ParameterError, "swing", "0", "3.14159"):
        Sample(swing=value)


def test_an_unknown_enumeration_word_is_refused_with_the_accepted_words() -> None:
    with raises(ParameterError, "segment_model", "de_leva", "winter", "Winter"):
        Patient(segment_model="Winter")  # type: ignore[arg-type]
    with raises(ParameterError, "posture", "hip", "knee", "ankle", "elbow"):
        Sample(swing=0.5, posture={"elbow": 0.1})  # type: ignore[dict-item]


def test_open_bounds_are_excluded_from_a_range() -> None:
    assert POSITIVE.contains(5e-324) and not POSITIVE.contains(0.0)
    assert (
        Range(0.0).contains(0.0)
        and not Range(0.0).contains(math.inf)
        and NON_NEGATIVE_OR_INFINITE.contains(math.inf)
    )


@given(
    swing=st.floats(0.0, math.pi),
    pause=st.floats(0.0, 3600.0) | st.just(math.inf),
    knee=st.floats(-math.pi, math.pi),
)
def test_written_values_are_read_back_bit_for_bit(swing: float, pause: float, knee: float) -> None:
    made = Sample(swing=swing, pause=pause, posture={JointName.KNEE: knee})
    document = section_of(Sample).document(made)
    assert section_of(Sample).model_validate(document).convert() == made


def test_fields_with_own_readers_are_listed() -> None:
    by_hand = {
        f"{kind.__name__}.{item.name}"
        for kind in CLASSES
        for item in declarations(kind)
        if item.find_annotation(CustomSerialized)
    }
    assert by_hand == {
        "Experiment.controller",
        "Experiment.events",
        "Experiment.modes",
        "Experiment.own_gait",
        "Experiment.reference",
        "Experiment.table",
        "OwnGait.table",
        "Patient.conditions",
        "PhaseParameters.joints",
        "Transition.guard",
        "Transition.timeout_ticks",
    }


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("table", None, ("GaitTable", "None")),
        ("patient", 70, ("Patient", "70")),
        ("integration", "rk4", ("Integration", "rk4")),
        ("faults", None, ("tuple", "None")),
        ("faults", (3,), ("Fault", "3")),
        ("engine", None, ("pinocchio", "compiled", "None")),
    ],
)
def test_a_record_of_another_type_is_refused(field, value, expected):
    with raises(ParameterError, field, *expected):
        replace(load_experiment("bench_leg").experiment, **{field: value})
