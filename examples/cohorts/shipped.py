"""Shipped people on the shipped walk, and the default wearer in braces of other stiffness."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from twin_gait import Experiment, JointName, Run, Side, load_experiment, simulate, summarise_run
from twin_gait.parameters.environment import BraceParameters

MASS_ALONE = "mass alone"
JOINTS = (JointName.HIP, JointName.KNEE)
SUPPORTS = (0.6, 0.4)


def experiment_of(name: str, support: float, duration: float) -> Experiment:
    """Return the guided walk with a shipped person, or with ``mass alone``."""
    settings = [f"scenario.support.share={support}", f"duration_s={duration}"]
    person = [] if name == MASS_ALONE else [f"patient={name}"]
    return load_experiment("treadmill_guided", [*settings, *person]).experiment


def wearer_peak(run: Run, joint: JointName) -> float:
    """Return the highest torque of effort and passive moments at either joint in [N·m]; no push acts here."""
    return max(float(run.log[f"{side}_{joint}_external_torque_Nm"].abs().max()) for side in Side)


def wearer_power(run: Run, joint: JointName) -> float:
    """Compute the mean power of effort and passive moments together at both joints in [W].

    The wearer is one body with the device, and no push acts here.
    """
    names = [f"{side}_{joint}" for side in Side]
    torques = run.log[[f"{name}_external_torque_Nm" for name in names]].to_numpy()
    velocities = run.log[[f"{name}_velocity_rad_per_s" for name in names]].to_numpy()
    return float((torques * velocities).sum(axis=1).mean())


def person_row(name: str, duration: float) -> dict[str, Any]:
    """Simulate one person at both supports and return a row; all numbers are those of the first support."""
    runs = [simulate(experiment_of(name, support, duration)) for support in SUPPORTS]
    sides = list(summarise_run(runs[0])["sides"].values())
    further = [sum(side[key] for side in sides) for key in ("further_contacts", "scuffs")]
    return {
        "who": name,
        **{
            f"{support:.0%} support": str(run.verdict.outcome)
            for support, run in zip(SUPPORTS, runs, strict=True)
        },
        "stride [s]": pair([side["stride_time_mean_s"] for side in sides], ".2f"),
        "swing [%]": pair([side["swing_share"] for side in sides], ".1f", 100.0),
        "knee RMSE [°]": pair([side["rmse_knee_by_contact_deg"] for side in sides], ".1f"),
        "further contacts, scuffs": pair(further, "d", 1),
        "peak of the wearer's torque, hip, knee [N·m]": pair(
            [wearer_peak(runs[0], j) for j in JOINTS], ".0f"
        ),
        "their mean power, hips, knees [W]": pair([wearer_power(runs[0], j) for j in JOINTS], ".1f"),
    }


def stiffened(factor: float) -> BraceParameters:
    """Return the default braces, stiffer by a factor, with the same share of critical damping."""
    grown = {
        name: replace(brace, stiffness=factor * brace.stiffness, damping=math.sqrt(factor) * brace.damping)
        for name, brace in vars(BraceParameters()).items()
    }
    return BraceParameters(**grown)


def brace_row(factor: float, duration: float) -> dict[str, Any]:
    """Simulate the default wearer in braces stiffened by a factor, and return a row of the page."""
    alone = experiment_of(MASS_ALONE, SUPPORTS[0], duration)
    run = simulate(replace(alone, interface=stiffened(factor)))
    summary = summarise_run(run)
    braces = summary["interaction"]

    def largest(key: str) -> list[float]:
        return [max(braces[f"{side}_{joint}"][key] for side in Side) for joint in JOINTS]

    return {
        "times as stiff": f"{factor:g}",
        "the walk": str(run.verdict.outcome),
        "stride [s]": pair([side["stride_time_mean_s"] for side in summary["sides"].values()], ".2f"),
        "RMS torque, hip, knee [N·m]": pair(largest("torque_rms_Nm"), ".1f"),
        "most relative motion, hip, knee [°]": pair(largest("motion_peak_deg"), ".1f"),
        "at the pelvis [mm]": f"{braces['pelvis']['motion_peak_mm']:.0f}",
    }


def pair(values: list[float | None], form: str, factor: float = 1.0) -> str:
    """Format two numbers for a table."""
    return ", ".join("–" if value is None else format(factor * value, form) for value in values)
