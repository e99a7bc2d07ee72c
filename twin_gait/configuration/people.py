"""People: the wearer as YAML, inside an experiment, in a file of his own, or by the name of a preset.

What holds for both sides stands under ``both``; ``left`` and ``right`` are laid over it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from twin_gait.configuration.overrides import merge
from twin_gait.configuration.validation import DEGREE, Number, Strict, converting, one_of, read_yaml, validate
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import JointCondition, Patient
from twin_gait.vocabulary import MOTOR_JOINTS, JointName, SegmentModel, Sex, Side

SIDES = ("both", "left", "right")
_HEADER = ("schema_version", "name", "description")


class JointConditionEntry(Strict):
    """What the wearer does at one joint; what is not given is left as it is underneath."""

    passive: Number | None = None
    contracture_deg: Number | None = None
    contracture_rad: Number | None = None
    stretch_reflex_threshold_deg_per_s: Number | None = None
    stretch_reflex_threshold_rad_per_s: Number | None = None
    stretch_reflex_gain_Nms_per_rad: Number | None = None
    effort: Number | None = None
    strength: Number | None = None

    @model_validator(mode="after")
    def _one_unit_each(self) -> JointConditionEntry:
        self.convert_angles()
        return self

    def convert_angles(self) -> tuple[float, float]:
        """Contracture in [rad] and speed of the catch in [rad] / [s]."""
        standard = JointCondition()
        contracture = {"contracture_deg": DEGREE, "contracture_rad": 1.0}
        speed = {"stretch_reflex_threshold_deg_per_s": DEGREE, "stretch_reflex_threshold_rad_per_s": 1.0}
        return (
            one_of(self, contracture, standard.contracture),
            one_of(self, speed, standard.stretch_reflex_threshold),
        )

    def convert(self) -> JointCondition:
        """Convert to SI."""
        contracture, stretch_reflex_threshold = self.convert_angles()
        plain = {
            "passive": self.passive,
            "stretch_reflex_gain": self.stretch_reflex_gain_Nms_per_rad,
            "effort": self.effort,
            "strength": self.strength,
        }
        given = {name: value for name, value in plain.items() if value is not None}
        return JointCondition(
            contracture=contracture, stretch_reflex_threshold=stretch_reflex_threshold, **given
        )


class SideEntry(Strict):
    """Hip and knee of one side, or of both."""

    hip: JointConditionEntry = JointConditionEntry()
    knee: JointConditionEntry = JointConditionEntry()


class PatientEntry(Strict):
    """The wearer."""

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

    def convert(self) -> Patient:
        """Convert to SI."""
        conditions = {(side, joint): self._condition(side, joint) for side in Side for joint in MOTOR_JOINTS}
        return Patient(
            mass=self.mass_kg,
            height=self.height_m,
            sex=self.sex,
            segment_model=self.segment_model,
            conditions={place: item for place, item in conditions.items() if item != JointCondition()},
            effort_delay=one_of(self, {"effort_delay_s": 1.0, "effort_delay_ms": 1e-3}, Patient.effort_delay),
            effort_noise=self.effort_noise,
        )

    def _condition(self, side: Side, joint: JointName) -> JointCondition:
        common = getattr(self.both, joint).model_dump(exclude_none=True)
        own = getattr(getattr(self, side), joint).model_dump(exclude_none=True)
        try:
            return JointConditionEntry(**merge(common, own)).convert()
        except ParameterError as error:
            raise ParameterError(f"{side if own else 'both'}.{joint}.{error}") from error


class PersonFile(PatientEntry):
    """A person in a file of his own."""

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
    """File of somebody that ships, with its sources, ready to be edited.

    Args:
        name: One of :func:`people`.

    Returns:
        The YAML text.
    """
    return (_folder() / f"{name}.yaml").read_text(encoding="utf-8")


def names_a_person(value: Any) -> bool:
    """Whether a ``patient`` of a file names somebody, instead of saying everything itself."""
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
        ParameterError: If there is nobody of that name.
        ParameterFileError: If his file has a mistake.
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
    raise ParameterError(f"nobody is called {name!r}: neither a file nor one of {', '.join(people())}")


def _folder() -> Path:
    return Path(str(files("twin_gait.configuration"))) / "people"


def patient_document(patient: Patient) -> dict[str, Any]:
    """A wearer as the mapping of a file, in SI.

    Args:
        patient: The wearer.

    Returns:
        The mapping; what both sides have in common stands under ``both``, what does nothing is left out.
    """
    document: dict[str, Any] = {
        "mass_kg": patient.mass,
        "height_m": patient.height,
        "sex": str(patient.sex),
        "segment_model": str(patient.segment_model),
        "effort_delay_s": patient.effort_delay,
        "effort_noise": patient.effort_noise,
    }
    sides: dict[str, dict[str, Any]] = {name: {} for name in SIDES}
    for joint in MOTOR_JOINTS:
        left, right = (_condition_document(patient, side, joint) for side in Side)
        both = {key: value for key, value in left.items() if right.get(key) == value}
        sides["both"][str(joint)] = both
        sides["left"][str(joint)] = {key: value for key, value in left.items() if key not in both}
        sides["right"][str(joint)] = {key: value for key, value in right.items() if key not in both}
    return document | _without_empty(sides)


def _condition_document(patient: Patient, side: Side, joint: JointName) -> dict[str, float]:
    standard = JointCondition()
    condition = patient.conditions.get((side, joint), standard)
    keys = {
        "passive": "passive",
        "contracture": "contracture_rad",
        "stretch_reflex_threshold": "stretch_reflex_threshold_rad_per_s",
        "stretch_reflex_gain": "stretch_reflex_gain_Nms_per_rad",
        "effort": "effort",
        "strength": "strength",
    }
    values = {key: getattr(condition, name) for name, key in keys.items()}
    return {
        key: values[key] for name, key in keys.items() if getattr(condition, name) != getattr(standard, name)
    }


def _without_empty(sides: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    kept = {name: {joint: item for joint, item in joints.items() if item} for name, joints in sides.items()}
    return {name: joints for name, joints in kept.items() if joints}
