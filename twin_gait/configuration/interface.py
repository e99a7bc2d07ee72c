"""What binds the wearer to the device, as YAML: one body with it, or braces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import model_validator

from twin_gait.configuration.validation import Number, Strict
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import BraceParameters, SpringDamper

_JOINTS = ("hip", "knee", "ankle")


class TurningBraceEntry(Strict):
    """Spring and damper of a brace at a joint."""

    stiffness_Nm_per_rad: Number | None = None
    damping_Nms_per_rad: Number | None = None

    def convert(self, default: SpringDamper) -> SpringDamper:
        """Convert; what is not given is taken from the default."""
        return _spring_damper(default, self.stiffness_Nm_per_rad, self.damping_Nms_per_rad)


class SlidingBraceEntry(Strict):
    """Spring and damper of the brace at the pelvis."""

    stiffness_N_per_m: Number | None = None
    damping_Ns_per_m: Number | None = None

    def convert(self, default: SpringDamper) -> SpringDamper:
        """Convert; what is not given is taken from the default."""
        return _spring_damper(default, self.stiffness_N_per_m, self.damping_Ns_per_m)


def _spring_damper(default: SpringDamper, stiffness: float | None, damping: float | None) -> SpringDamper:
    return SpringDamper(
        stiffness=default.stiffness if stiffness is None else stiffness,
        damping=default.damping if damping is None else damping,
    )


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
        given = [name for name in ("pelvis", *_JOINTS) if getattr(self, name) is not None]
        if self.kind == "rigid" and given:
            raise ValueError(f"rigid has no {given[0]}: set kind to brace, or interface to rigid as a whole")
        return self

    def convert(self) -> BraceParameters | None:
        """Convert; None for one body.

        Raises:
            ParameterError: If a number is out of range; it begins with the place.
        """
        if self.kind == "rigid":
            return None
        standard = BraceParameters()
        found = {}
        for name in ("pelvis", *_JOINTS):
            entry, default = getattr(self, name), getattr(standard, name)
            try:
                found[name] = default if entry is None else entry.convert(default)
            except ParameterError as error:
                raise ParameterError(f"{name} {error}") from error
        return BraceParameters(**found)


def interface_document(braces: BraceParameters | None) -> dict[str, Any]:
    """What binds wearer and device as the mapping of a file.

    Args:
        braces: The braces, or None for one body.

    Returns:
        The mapping; reading it gives the same.
    """
    if braces is None:
        return {"kind": "rigid"}
    pelvis = braces.pelvis
    document: dict[str, Any] = {
        "kind": "brace",
        "pelvis": {"stiffness_N_per_m": pelvis.stiffness, "damping_Ns_per_m": pelvis.damping},
    }
    for name in _JOINTS:
        item: SpringDamper = getattr(braces, name)
        document[name] = {"stiffness_Nm_per_rad": item.stiffness, "damping_Nms_per_rad": item.damping}
    return document
