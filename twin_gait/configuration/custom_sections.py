"""Sections of a file with more keys than the fields of their parameters: see :mod:`.sections`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, create_model, model_validator

from twin_gait.configuration.events import EventEntry
from twin_gait.configuration.reference_file import ReferenceSection
from twin_gait.configuration.sections import Section, register_section
from twin_gait.configuration.sections import section_of as section_of
from twin_gait.configuration.sections import type_of as type_of
from twin_gait.configuration.validation import Flag, Number, Strict
from twin_gait.control.user_controller import UserController
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Experiment, Integration
from twin_gait.gait.guards import AllOf, AnyOf, Guard
from twin_gait.gait.table import MAX_TICKS, TICK, PhaseParameters, Transition
from twin_gait.parameters.wearer import WEARER_JOINTS, JointCondition, Patient
from twin_gait.vocabulary import JointName, Side

SIDES = ("both", "left", "right")


_Condition = section_of(JointCondition)
_Joints: Any = create_model(  # type: ignore[call-overload]
    "Joints", __base__=Strict, **{joint: (_Condition, _Condition()) for joint in WEARER_JOINTS}
)


@register_section(Patient)
class PatientSection(Section):
    """Section of the wearer: ``left`` and ``right`` override the values under ``both``."""

    both: _Joints = _Joints()
    left: _Joints = _Joints()
    right: _Joints = _Joints()

    def values(self) -> dict[str, Any]:
        """Return the fields that are given, in SI."""
        conditions = {(side, joint): self._condition(side, joint) for side in Side for joint in WEARER_JOINTS}
        changed = {key: item for key, item in conditions.items() if item != JointCondition()}
        return {**super().values(), "conditions": changed}

    def _condition(self, side: Side, joint: JointName) -> JointCondition:
        common, one_sided = (getattr(getattr(self, name), joint).values() for name in ("both", side))
        try:
            return JointCondition(**{**common, **one_sided})
        except ParameterError as error:
            raise ParameterError(f"{side if one_sided else 'both'}.{joint}.{error}") from error

    @classmethod
    def document(cls, parameters: Patient) -> dict[str, Any]:
        """Convert a wearer to the mapping of a file, in SI.

        Values that both sides have in common are under ``both``; those that equal the default are left out.
        """
        sides: dict[str, dict[str, Any]] = {name: {} for name in SIDES}
        usual = _Condition.document(JointCondition())
        for joint in WEARER_JOINTS:
            conditions = (parameters.conditions.get((side, joint), JointCondition()) for side in Side)
            written = (_Condition.document(item).items() for item in conditions)
            left, right = ({key: value for key, value in item if value != usual[key]} for item in written)
            both = {key: value for key, value in left.items() if right.get(key) == value}
            one_sided = ({key: item[key] for key in item if key not in both} for item in (left, right))
            for name, items in zip(SIDES, (both, *one_sided), strict=True):
                if items:
                    sides[name][str(joint)] = items
        document: dict[str, Any] = super().document(parameters)
        return document | {name: joints for name, joints in sides.items() if joints}


class _UserControllerFields(Strict):
    """Record of a controller of the user's own, as stored in a run folder."""

    name: str
    module: str
    other_modules: list[str] = Field(default_factory=list)
    source: str = ""
    source_sha256: str
    attributes: dict[str, Any] | None = None
    attributes_sha256: str = ""
    constants: dict[str, bool | int | float] = Field(default_factory=dict)


# A keyword of Python cannot be the name of a field in a class statement.
UserControllerSection: Any = create_model(  # type: ignore[call-overload]
    "OwnController", __base__=_UserControllerFields, **{"class": (str, ...)}
)


def convert_user_controller(section: Any) -> UserController:
    """Convert a validated section to the record of a controller."""
    values = section.model_dump()
    others = tuple(values.pop("other_modules"))
    return UserController(class_name=values.pop("class"), other_modules=others, **values)


def user_controller_document(record: UserController) -> dict[str, Any]:
    """Convert a record to the mapping of a file; empty values are left out."""
    values = {"name": record.name, "module": record.module, "class": record.class_name, **asdict(record)}
    values |= {"other_modules": list(record.other_modules), "source": values.pop("source")}
    return {
        key: value for key, value in values.items() if key != "class_name" and value not in ("", [], None)
    }


@register_section(Experiment)
class ExperimentSection(Section):
    """Section of an experiment file after its presets have been merged."""

    schema_version: Literal[2] = 2
    description: str = ""
    scenario: Section
    table: dict[str, Any]
    modes: dict[str, Any] | None = None
    own_gait: dict[str, Any] | None = None
    events: tuple[EventEntry, ...] = ()
    reference: ReferenceSection | None = None
    integration: section_of(Integration) | None = None  # type: ignore[valid-type]
    controller: UserControllerSection | None = None
    provenance: dict[str, Any] | None = None


@register_section(PhaseParameters)
class PhaseSection(Section):
    """Section of a phase: the impedance of each joint in addition to the declared fields."""

    joints: ClassVar[tuple[str, ...]] = ()

    def values(self) -> dict[str, Any]:
        """Return the fields that are given, in SI."""
        return super().values() | {"joints": {joint: getattr(self, joint) for joint in self.joints}}


@register_section(Transition)
class TransitionSection(Section):
    """Entry of the transition list; its guard is parsed for a table, which has the signals."""

    cause: str = Field(min_length=1)
    all: list[Any] | None = None
    any: list[Any] | None = None
    after_s: Annotated[Number, Field(gt=TICK / 2, le=MAX_TICKS * TICK)] | None = None
    remove: Flag = False

    @model_validator(mode="after")
    def _one_condition(self) -> TransitionSection:
        if self.remove:
            raise ValueError("remove: this table inherits no transition; use remove only with extends")
        if self.all is not None and self.any is not None:
            raise ValueError("give either all or any at this level; nest the other inside it")
        return self

    def values(self) -> dict[str, Any]:
        """Return the fields that are given, without the guard; times in ticks."""
        return super().values() | {"timeout_ticks": self.after_s and round(self.after_s / TICK)}

    @classmethod
    def document(cls, parameters: Transition) -> dict[str, Any]:
        """Convert a transition to an entry of a file."""
        found: dict[str, Any] = super().document(parameters)
        if parameters.guard != AllOf(guards=()):
            written = _guard(parameters.guard)
            found |= written if isinstance(written, dict) else {"all": [written]}
        if parameters.timeout_ticks is not None:
            found["after_s"] = round(parameters.timeout_ticks * TICK, 3)
        return found


def _guard(guard: Guard) -> Any:
    if isinstance(guard, (AllOf, AnyOf)):
        return {"all" if isinstance(guard, AllOf) else "any": [_guard(inner) for inner in guard.guards]}
    return str(guard)
