"""Paragraphs on temperature, age and load, computed from the tables of the study."""

from __future__ import annotations

import numpy as np
import pandas as pd

from twin_gait.studies.loop_stability.loop_stability import Ending
from twin_gait.studies.whatif.temperature import (
    COULOMB_LOSS_PER_KELVIN,
    COULOMB_PER_LOAD,
    TemperatureStudy,
    viscous_loss_per_kelvin,
)
from twin_gait.studies.whatif.words import paragraph

_WARMTH = """
A kelvin takes {viscous:.1%} of the viscous friction away (the gear's catalogue at 25 °C) and
{coulomb:.2%} of the Coulomb friction (an assumption). A compensator identified at {model:g} °C then lets
a pushed joint rest up to G = {rest_cold:.2f} at {cold:g} °C and up to {rest_warm:.2f} at {warm:g} °C;
least friction is left to a leading hand at G = {best_cold:.2f} and {best_warm:.2f} (closed form
{closed_cold:.2f} and {closed_warm:.2f}). What is identified cold is too strong when warm: at worst here,
identified at {worst_model:g} °C and used at {worst_at:g} °C, the joint rests up to {worst_gain:.2f} only.
G = {safe:g} is the largest of those tried at which the model of {model:g} °C lets the joint rest at every
temperature; the hand then feels {left_cold:.2f} N m RMS of friction at {cold:g} °C and {left_warm:.2f} at
{warm:g} °C, of {without_cold:.2f} and {without_warm:.2f} without compensation.
"""
_OTHERS = """
Age scales the whole law, and the largest resting G with it: {aged}. A joint that runs in after it was
identified becomes unstable at gains that were safe. Load acts the other way: with {share:.0%} of it as
Coulomb friction the limit under {load:g} kg is {rest_load:.2f} and the best G {best_load:.2f}. A
compensator is safe if it was identified warm, run in and unloaded, and leaves some friction everywhere
else.
"""


def temperature_text(found: TemperatureStudy) -> tuple[str, ...]:
    """Paragraphs on temperature, age and load.

    Args:
        found: The study.

    Returns:
        On temperature, and on age and load.
    """
    return _warmth_text(found), _others_text(found.best)


def _warmth_text(found: TemperatureStudy) -> str:
    best = found.best[found.best["kind"] == "temperature"]
    model = float(np.median(best["identified_at_degC"].unique()))
    rows = best[best["identified_at_degC"] == model].sort_values("temperature_degC")
    cold, warm = rows.iloc[0], rows.iloc[-1]
    cases = found.cases[found.cases["kind"] == "temperature"]
    mine = cases[cases["identified_at_degC"] == model]
    safe = largest_safe_gain(mine)
    left = mine[mine["gain"] == safe].set_index("temperature_degC")["hand_friction_Nm"]
    worst = best.sort_values("largest_resting_gain").iloc[0]
    return paragraph(
        _WARMTH,
        viscous=viscous_loss_per_kelvin(),
        coulomb=COULOMB_LOSS_PER_KELVIN,
        model=model,
        cold=cold["temperature_degC"],
        warm=warm["temperature_degC"],
        rest_cold=cold["largest_resting_gain"],
        rest_warm=warm["largest_resting_gain"],
        best_cold=cold["best_gain"],
        best_warm=warm["best_gain"],
        closed_cold=cold["closed_best_gain"],
        closed_warm=warm["closed_best_gain"],
        worst_model=worst["identified_at_degC"],
        worst_at=worst["temperature_degC"],
        worst_gain=worst["largest_resting_gain"],
        safe=safe,
        left_cold=left[cold["temperature_degC"]],
        left_warm=left[warm["temperature_degC"]],
        without_cold=cold["hand_friction_without_Nm"],
        without_warm=warm["hand_friction_without_Nm"],
    )


def largest_safe_gain(cases: pd.DataFrame) -> float:
    """Largest gain of a table up to which the joint rests in all of its cases.

    Args:
        cases: With ``gain`` and ``ending``.

    Returns:
        The gain.
    """
    moving = cases[cases["ending"] != Ending.REST]["gain"]
    gains = cases["gain"]
    return float(gains[gains < moving.min()].max() if len(moving) else gains.max())


def _others_text(best: pd.DataFrame) -> str:
    ages = best[best["kind"] == "age"].sort_values("ageing")
    heaviest = best[best["kind"] == "load"].sort_values("load_kg").iloc[-1]
    aged = [
        f"{gain:.2f} at {ratio:g} times the friction"
        for ratio, gain in zip(ages["ageing"], ages["largest_resting_gain"], strict=True)
    ]
    return paragraph(
        _OTHERS,
        aged=" and ".join(aged),
        share=COULOMB_PER_LOAD,
        load=heaviest["load_kg"],
        rest_load=heaviest["largest_resting_gain"],
        best_load=heaviest["best_gain"],
    )
