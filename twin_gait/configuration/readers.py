"""Sections of a file that say more than the fields of their parameters: see :mod:`.sections`."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, create_model, model_validator

from twin_gait.configuration.sections import Section, reads
from twin_gait.configuration.sections import section_of as section_of
from twin_gait.configuration.sections import type_of as type_of
from twin_gait.configuration.validation import Number, Strict
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment, Integration
from twin_gait.gait.guards import AllOf, AnyOf, Guard
from twin_gait.gait.table import LONGEST, TICK, JointImpedance, PhaseParameters, Scaling, Transition
from twin_gait.parameters import JointCondition, Patient, StribeckFriction
from twin_gait.parameters.wearer import WEARER_JOINTS
from twin_gait.vocabulary import JointName, Side

SIDES = ("both", "left", "right")


_DIRECTIONS = ("viscous_friction_forward", "viscous_friction_backward")


@reads(StribeckFriction)
class StribeckReader(Section):
    """Friction with a Stribeck curve: a linear viscous friction may be given for both directions."""

    viscous_friction_Nms_per_rad: Number | None = None

    def values(self) -> dict[str, Any]:
        """Fields that are given; a linear viscous friction is that of both directions."""
        values, both = super().values(), self.viscous_friction_Nms_per_rad
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

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        conditions = {(side, joint): self._condition(side, joint) for side in Side for joint in WEARER_JOINTS}
        does = {place: item for place, item in conditions.items() if item != JointCondition()}
        return {**super().values(), "conditions": does}

    def _condition(self, side: Side, joint: JointName) -> JointCondition:
        common, own = (getattr(getattr(self, name), joint).values() for name in ("both", side))
        try:
            return JointCondition(**{**common, **own})
        except ParameterError as error:
            raise ParameterError(f"{side if own else 'both'}.{joint}.{error}") from error

    @classmethod
    def document(cls, parameters: Patient) -> dict[str, Any]:
        """As the mapping of a file, in SI.

        What both sides have in common stands under ``both``; what does nothing is left out.
        """
        sides: dict[str, dict[str, Any]] = {name: {} for name in SIDES}
        usual = _Condition.document(JointCondition())
        for joint in WEARER_JOINTS:
            conditions = (parameters.conditions.get((side, joint), JointCondition()) for side in Side)
            written = (_Condition.document(item).items() for item in conditions)
            left, right = ({key: value for key, value in item if value != usual[key]} for item in written)
            both = {key: value for key, value in left.items() if right.get(key) == value}
            own = ({key: item[key] for key in item if key not in both} for item in (left, right))
            for name, items in zip(SIDES, (both, *own), strict=True):
                if items:
                    sides[name][str(joint)] = items
        document: dict[str, Any] = super().document(parameters)
        return document | {name: joints for name, joints in sides.items() if joints}


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
    integration: section_of(Integration) | None = None  # type: ignore[valid-type]
    provenance: ProvenanceEntry | None = None

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

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        return super().values() | {"joints": {joint: getattr(self, joint) for joint in self.joints}}

    @classmethod
    def document(cls, parameters: PhaseParameters) -> dict[str, Any]:
        """As the mapping of a file, in SI."""
        write = section_of(JointImpedance).document
        joints = {name: write(joint) for name, joint in parameters.joints.items()}
        return joints | super().document(parameters)


def _seconds(after: float) -> float:
    """A time that is rounded to ticks."""
    if not TICK / 2 < after <= LONGEST * TICK:
        raise ValueError(f"expected {TICK:g} to {LONGEST * TICK:g} s, got {after:g}")
    return after


@reads(Transition)
class TransitionReader(Section):
    """One entry of the transition list; its guard is read for a table, which has the signals."""

    cause: str = Field(min_length=1)
    all: list[Any] | None = None
    any: list[Any] | None = None
    after_s: Annotated[Number, AfterValidator(_seconds)] | None = None
    remove: bool = False

    @model_validator(mode="after")
    def _one_condition(self) -> TransitionReader:
        if self.remove:
            raise ValueError("remove: there is nothing inherited to remove; it goes with extends")
        if self.all is not None and self.any is not None:
            raise ValueError("give either all or any at this level; nest the other inside it")
        return self

    def values(self) -> dict[str, Any]:
        """Fields that are given, without the guard; times in ticks."""
        return super().values() | {"time_out_ticks": self.after_s and round(self.after_s / TICK)}

    @classmethod
    def document(cls, parameters: Transition) -> dict[str, Any]:
        """As an entry of a file."""
        found: dict[str, Any] = super().document(parameters)
        driven_by = found.pop("driven_by")
        if parameters.guard != AllOf(guards=()):
            written = _guard(parameters.guard)
            found |= written if isinstance(written, dict) else {"all": [written]}
        if parameters.time_out_ticks is not None:
            found["after_s"] = round(parameters.time_out_ticks * TICK, 3)
        return found if driven_by == "joint" else {**found, "driven_by": driven_by}


def _guard(guard: Guard) -> Any:
    if isinstance(guard, (AllOf, AnyOf)):
        return {"all" if isinstance(guard, AllOf) else "any": [_guard(inner) for inner in guard.guards]}
    return str(guard)
