"""People: the wearer as YAML, inside an experiment, in a file of its own, or by the name of a preset.

What holds for both sides stands under ``both``; ``left`` and ``right`` are laid over it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field

from twin_gait.configuration.overrides import merge
from twin_gait.configuration.sections import Section
from twin_gait.configuration.validation import Number, Strict, converting, read_yaml, validate
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import JointCondition, Patient
from twin_gait.parameters.wearer import WEARER_JOINTS
from twin_gait.vocabulary import JointName, SegmentModel, Sex, Side

SIDES = ("both", "left", "right")
_HEADER = ("schema_version", "name", "description")


class JointConditionEntry(Section):
    """What the wearer does at one joint; what is not given is left as it is underneath."""

    parameters: ClassVar = JointCondition
    passive: Number | None = None
    contracture_deg: Number | None = None
    contracture_rad: Number | None = None
    stretch_reflex_threshold_deg_per_s: Number | None = None
    stretch_reflex_threshold_rad_per_s: Number | None = None
    stretch_reflex_gain_Nms_per_rad: Number | None = None
    effort: Number | None = None
    strength: Number | None = None


class SideEntry(Strict):
    """Hip and knee of one side, or of both."""

    hip: JointConditionEntry = JointConditionEntry()
    knee: JointConditionEntry = JointConditionEntry()


class PatientEntry(Section):
    """The wearer."""

    parameters: ClassVar = Patient
    mass_kg: Number = Patient.mass
    height_m: Number = Patient.height
    sex: Sex = Sex.MALE
    segment_model: SegmentModel = Patient.segment_model
    effort_delay_s: Number | None = None
    effort_delay_ms: Number | None = None
    effort_noise: Number = Patient.effort_noise
    both: SideEntry = SideEntry()
    left: SideEntry = SideEntry()
    right: SideEntry = SideEntry()

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        conditions = {(side, joint): self._condition(side, joint) for side in Side for joint in WEARER_JOINTS}
        does = {place: item for place, item in conditions.items() if item != JointCondition()}
        return {**super().values(), "conditions": does}

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
        return super().document(parameters) | {name: joints for name, joints in sides.items() if joints}

    def _condition(self, side: Side, joint: JointName) -> JointCondition:
        common = getattr(self.both, joint).model_dump(exclude_none=True)
        own = getattr(getattr(self, side), joint).model_dump(exclude_none=True)
        try:
            condition: JointCondition = JointConditionEntry(**merge(common, own)).convert()
        except ParameterError as error:
            raise ParameterError(f"{side if own else 'both'}.{joint}.{error}") from error
        return condition


def _condition_document(patient: Patient, side: Side, joint: JointName) -> dict[str, float]:
    usual = JointConditionEntry.document(JointCondition())
    own = JointConditionEntry.document(patient.conditions.get((side, joint), JointCondition()))
    return {key: value for key, value in own.items() if value != usual[key]}


class PersonFile(PatientEntry):
    """A person in a file of its own."""

    schema_version: Literal[1] = 1
    name: str = Field(default="", max_length=80)
    description: str = ""


def people() -> dict[str, str]:
    """Names of the people that ship with their one-line descriptions."""
    found = {}
    for path in sorted(_folder().glob("*.yaml")):
        found[path.stem] = " ".join(str(read_yaml(path).get("description", "")).split())
    return found


def person_text(name: str) -> str:
    """File of a person that ships, with its sources, ready to be edited."""
    return (_folder() / f"{name}.yaml").read_text(encoding="utf-8")


def names_a_person(value: Any) -> bool:
    """Whether a ``patient`` of a file names a person instead of stating everything itself."""
    return isinstance(value, str) or (isinstance(value, Mapping) and "preset" in value)


def person_document(value: str | Mapping[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """Look a named person up.

    Args:
        value: Name of a person that ships, path of a file, or a mapping with such a name under ``preset``
            and changes beside it.
        folder: Folder that a relative path starts from; the working folder comes next.

    Returns:
        The ``patient`` of an experiment file.

    Raises:
        ParameterError: If there is no such person.
        ParameterFileError: If the file has a mistake.
    """
    name = value if isinstance(value, str) else value["preset"]
    changes = {} if isinstance(value, str) else {key: item for key, item in value.items() if key != "preset"}
    path = _find(name, folder)
    data = read_yaml(path)
    converting(str(path), "", validate(PersonFile, data, str(path)).convert)
    return merge({key: item for key, item in data.items() if key not in _HEADER}, changes)


def _find(name: Any, folder: Path) -> Path:
    if isinstance(name, str) and name:
        packaged = _folder() / f"{name}.yaml"
        if "/" not in name and packaged.is_file():
            return packaged
        for candidate in (folder / name, Path(name).expanduser()):
            if candidate.is_file():
                return candidate
    raise ParameterError(f"no person {name!r}: neither a file nor one of {', '.join(people())}")


def _folder() -> Path:
    return Path(str(files("twin_gait.configuration"))) / "people"
