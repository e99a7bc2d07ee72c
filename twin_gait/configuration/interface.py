"""What binds the wearer to the device, as YAML: one body with it, or braces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Literal

from pydantic import model_validator

from twin_gait.configuration.sections import Section
from twin_gait.configuration.validation import Number, Strict
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import BraceParameters, SpringDamper
from twin_gait.vocabulary import JointName

PLACES = ("pelvis", "hip", "knee", "ankle")


class TurningBraceEntry(Section):
    """Spring and damper of a brace at a joint."""

    parameters: ClassVar = SpringDamper
    stiffness_Nm_per_rad: Number | None = None
    damping_Nms_per_rad: Number | None = None


class SlidingBraceEntry(Section):
    """Spring and damper of the brace at the pelvis."""

    parameters: ClassVar = SpringDamper
    stiffness_N_per_m: Number | None = None
    damping_Ns_per_m: Number | None = None


class InterfaceEntry(Strict):
    """Between wearer and device: ``rigid``, ``brace``, or a mapping with such a ``kind``."""

    kind: Literal["rigid", "brace"]
    pelvis: SlidingBraceEntry | None = None
    hip: TurningBraceEntry | None = None
    knee: TurningBraceEntry | None = None
    ankle: TurningBraceEntry | None = None

    @model_validator(mode="before")
    @classmethod
    def _word_for_a_mapping(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {"kind": value}
        if not isinstance(value, Mapping):
            raise ValueError(f"expected rigid, brace or a mapping with a kind, got {value!r}")
        return value

    @model_validator(mode="after")
    def _rigid_has_no_springs(self) -> InterfaceEntry:
        given = [name for name in PLACES if getattr(self, name) is not None]
        if self.kind == "rigid" and given:
            raise ValueError(f"rigid has no {given[0]}: set kind to brace, or interface to rigid as a whole")
        return self

    def convert(self) -> BraceParameters | None:
        """Convert; None for one body."""
        if self.kind == "rigid":
            return None
        standard = BraceParameters()
        found = {}
        for name in PLACES:
            entry, default = getattr(self, name), getattr(standard, name)
            try:
                found[name] = default if entry is None else replace(default, **entry.values())
            except ParameterError as error:
                raise ParameterError(f"{name} {error}") from error
        return BraceParameters(**found)


def interface_document(braces: BraceParameters | None) -> dict[str, Any]:
    """What binds wearer and device as the mapping of a file."""
    if braces is None:
        return {"kind": "rigid"}
    kinds = {name: TurningBraceEntry if name in list(JointName) else SlidingBraceEntry for name in PLACES}
    return {"kind": "brace", **{name: kinds[name].document(getattr(braces, name)) for name in PLACES}}
