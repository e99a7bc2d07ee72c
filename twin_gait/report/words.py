"""Words that pictures and pages share; nothing heavy is imported here."""

from __future__ import annotations

from twin_gait.parameters import Patient


def wearer_words(patient: Patient | None) -> str:
    """Mass and height of a wearer, if there is one."""
    return "no wearer" if patient is None else f"{patient.mass:g} kg, {patient.height:.2f} m"
