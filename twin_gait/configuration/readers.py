"""Sections of a file that say more than the fields of their parameters: see :mod:`.sections`."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field, create_model, model_validator

from twin_gait.configuration.sections import Section, reads, within
from twin_gait.configuration.sections import section_of as section_of
from twin_gait.configuration.validation import Number, Strict, merge
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment
from twin_gait.gait.table import JointImpedance, PhaseParameters, Scaling
from twin_gait.parameters import JointCondition, Patient, StribeckFriction
from twin_gait.parameters.wearer import WEARER_JOINTS
from twin_gait.vocabulary import JointName, Side

SIDES = ("both", "left", "right")


_DIRECTIONS = ("viscous_friction_forward", "viscous_friction_backward")


@reads(StribeckFriction)
class StribeckReader(Section):
    """Friction with a Stribeck curve: a linear viscous friction may be given for both directions."""

    viscous_friction_Nms_per_rad: Number | None = None

    def values(self, default: Any = None) -> dict[str, Any]:
        """Fields that are given; a linear viscous friction is that of both directions."""
        values, both = super().values(default), self.viscous_friction_Nms_per_rad
        if both is None:
            return values
        linear = dict.fromkeys(_DIRECTIONS, both) | {"viscous_exponent": 1.0}
        if any(values[name] != linear[name] for name in linear if name in values):
            raise ParameterError(
                f"viscous_friction_Nms_per_rad: {both:g} is linear and of both directions; leave it out "
                "beside viscous_friction_forward_Nm, viscous_friction_backward_Nm or viscous_exponent"
            )
        return {**values, **linear}

    @classmethod
    def document(cls, parameters: Any) -> dict[str, Any]:
        """As the mapping of a file: what is given."""
        given = super().document(parameters)
        forward, backward = (getattr(parameters, name) for name in _DIRECTIONS)
        if forward == backward and parameters.viscous_exponent == 1.0:
            for key in ("viscous_friction_forward_Nm", "viscous_friction_backward_Nm", "viscous_exponent"):
                del given[key]
            given["viscous_friction_Nms_per_rad"] = forward
        return given


_Condition = section_of(JointCondition)
_Joints = create_model(  # type: ignore[call-overload]
    "Joints", __base__=Strict, **{joint: (_Condition, _Condition()) for joint in WEARER_JOINTS}
)
_Sides = create_model(  # type: ignore[call-overload]
    "Sides", __base__=Section, **{name: (_Joints, _Joints()) for name in SIDES}
)


@reads(Patient)
class PatientReader(_Sides):  # type: ignore[misc, valid-type]
    """The wearer: ``left`` and ``right`` are laid over what stands under ``both``."""

    def values(self, default: Any = None) -> dict[str, Any]:
        """Fields that are given, in SI."""
        conditions = {(side, joint): self._condition(side, joint) for side in Side for joint in WEARER_JOINTS}
        does = {place: item for place, item in conditions.items() if item != JointCondition()}
        return {**super().values(default), "conditions": does}

    @classmethod
    def document(cls, parameters: Patient) -> dict[str, Any]:
        """As the mapping of a file, in SI.

        What both sides have in common stands under ``both``; what does nothing is left out.
        """
        sides: dict[str, dict[str, Any]] = {name: {} for name in SIDES}
        for joint in WEARER_JOINTS:
            left, right = (_condition_document(parameters, side, joint) for side in Side)
            both = {key: value for key, value in left.items() if right.get(key) == value}
            own = ({key: item[key] for key in item if key not in both} for item in (left, right))
            for name, items in zip(SIDES, (both, *own), strict=True):
                if items:
                    sides[name][str(joint)] = items
        document: dict[str, Any] = super().document(parameters)
        return document | {name: joints for name, joints in sides.items() if joints}

    def _condition(self, side: Side, joint: JointName) -> JointCondition:
        common = getattr(self.both, joint).model_dump(exclude_unset=True, exclude_none=True)
        own = getattr(getattr(self, side), joint).model_dump(exclude_unset=True, exclude_none=True)
        try:
            condition: JointCondition = _Condition(**merge(common, own)).convert()
        except ParameterError as error:
            raise ParameterError(f"{side if own else 'both'}.{joint}.{error}") from error
        return condition


def _condition_document(patient: Patient, side: Side, joint: JointName) -> dict[str, float]:
    usual = _Condition.document(JointCondition())
    own = _Condition.document(patient.conditions.get((side, joint), JointCondition()))
    return {key: value for key, value in own.items() if value != usual[key]}


class ProvenanceEntry(Strict):
    """What a resolved experiment was made with."""

    urdf_sha256: str | None = None
    table_sha256: str | None = None
    versions: dict[str, str] = Field(default_factory=dict)


@reads(Experiment)
class ExperimentReader(Section):
    """An experiment file, presets merged in."""

    schema_version: Literal[1] = 1
    description: str = ""
    scenario: Section
    table: dict[str, Any]
    modes: dict[str, Any] | None = None
    provenance: ProvenanceEntry | None = None

    @model_validator(mode="after")
    def _name_is_a_word(self) -> ExperimentReader:
        name = self.name  # type: ignore[attr-defined]  # a declared field
        if not name or any(character in name for character in "/\\\0\n"):
            raise ValueError(f"name: expected a plain name, got {name!r}")
        return self

    @classmethod
    def document(cls, parameters: Experiment) -> dict[str, Any]:
        """As the mapping of a file, in SI, without the gait table and the modes."""
        world = parameters.scenario
        return {**super().document(parameters), "scenario": section_of(type(world)).document(world)}


@reads(Scaling)
class ScalingReader(Section):
    """Scaling laws; what is usual is not written."""

    @classmethod
    def document(cls, parameters: Scaling) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        written = super().document
        usual, own = written(Scaling()), written(parameters)
        return {key: value for key, value in own.items() if key == "stance_phases" or usual.get(key) != value}


@reads(PhaseParameters)
class PhaseReader(Section):
    """What a phase sets: the impedance of each joint beside the rest."""

    joints: ClassVar[tuple[str, ...]] = ()

    def values(self, default: Any = None) -> dict[str, Any]:
        """Fields that are given, in SI."""
        joints = {joint: within(joint, getattr(self, joint).convert) for joint in self.joints}
        return super().values(default) | {"joints": joints}

    @classmethod
    def document(cls, parameters: PhaseParameters) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        joints = {name: _Joint.document(joint) for name, joint in parameters.joints.items()}
        return joints | super().document(parameters)


_Joint = section_of(JointImpedance)
