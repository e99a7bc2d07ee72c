"""Figure 3.4: the laws of both joints, identified from motor-driven tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from twin_gait.identification import Processing
from twin_gait.palette import JOINT_COLOURS
from twin_gait.report.canvas import style_panel
from twin_gait.scenario.bench_joint import BENCH_ACTUATORS
from twin_gait.studies.campaign import (
    TESTS_PER_WEIGHT,
    WEIGHTS,
    Protocol,
    Spread,
    TwoWayProtocol,
)
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.friction_drawing import AXIS_END
from twin_gait.studies.reproduction.shared import (
    LEVEL,
    LawFit,
    fit_campaign,
    law_torque,
    table_values,
)
from twin_gait.vocabulary import JointName

JOINTS = (JointName.KNEE, JointName.HIP)
DEVIATIONS = 3.0  # standard deviations that chance is given
Fits = Mapping[JointName, LawFit]


def driven_fits(folder: Path, seed: int, *, mass_as_printed: bool = False) -> Fits:
    """Both joints' laws from motor-driven tests without delay.

    Args:
        folder: Shared by the recipes.
        seed: Of the campaigns.
        mass_as_printed: Whether J_mass is m b.

    Returns:
        A fit for each joint.
    """
    return {
        joint: fit_campaign(
            folder,
            joint,
            Protocol.TWO_WAY,
            Processing.ZERO_PHASE,
            seed,
            mass_as_printed=mass_as_printed,
        )
        for joint in JOINTS
    }


def make_comparison(folder: Path, seed: int) -> Reproduction:
    """Figure 3.4: both laws over the speed.

    Args:
        folder: Shared by the recipes.
        seed: Of the campaigns.

    Returns:
        The figure with its claims.
    """
    fits = driven_fits(folder, seed)
    viscous = [table_values(joint)["d"] for joint in (JointName.HIP, JointName.KNEE)]
    return Reproduction(
        key="fig-3.4",
        title="Friction models of hip and knee",
        figure=draw_comparison(fits),
        claims=(*(_torque_claim(joint, fits[joint]) for joint in JOINTS), *_shape_claims(fits)),
        text=(
            "The benches carry the friction of table 3.1. From logs of motor-driven tests in both directions "
            "alone, identification gives the curves back; the thesis's numbers are equation (3.1) with the "
            "printed table. In both joints friction first rises, then dips and rises again: break-away is "
            "below Coulomb friction, so that the exponential is a dip and no Stribeck peak."
        ),
        readings=(
            "The thesis says that the two graphs differ only by the Stribeck and Coulomb effects; its table "
            f"has viscous coefficients of {viscous[0]:g} and {viscous[1]:g}, a ratio of "
            f"{viscous[0] / viscous[1]:.3f} (identified: "
            f"{fits[JointName.HIP].values['d'] / fits[JointName.KNEE].values['d']:.3f}).",
        ),
    )


def _torque_claim(joint: JointName, fit: LawFit) -> Claim:
    printed = _torque_at(table_values(joint), AXIS_END)
    margin = chance_of_torque(joint, printed, AXIS_END)
    spread = Spread()
    return Claim(
        name=f"friction of the {joint} at {AXIS_END:g} rad/s",
        thesis=printed,
        ours=_torque_at(fit.values, AXIS_END),
        unit="N m",
        kind=Kind.PREDICTED,
        low=printed - margin,
        high=printed + margin,
        reason=f"what chance adds to a test, {100.0 * spread.friction:g} % of friction and "
        f"{1000.0 * spread.current_offset:g} mA of offset, over the tests that reach this speed: "
        f"{DEVIATIONS:g} standard deviations",
        source="figure 3.4 by (3.1) and table 3.1",
    )


def _torque_at(values: Mapping[str, float], speed: float) -> float:
    return float(law_torque(values, np.array([speed]))[0])


def chance_of_torque(joint: JointName, torque: float, speed: float) -> float:
    """How far a friction torque may be off by chance, known before any test is simulated.

    Args:
        joint: Knee or hip.
        torque: In [N m].
        speed: At which it acts in [rad] / [s].

    Returns:
        Three standard deviations of the mean over the tests that reach the speed, in [N m].
    """
    spread, way, actuator = Spread(), TwoWayProtocol(), BENCH_ACTUATORS[joint]
    peaks = np.linspace(way.lowest_speed, way.highest_speed, TESTS_PER_WEIGHT)
    tests = len(WEIGHTS) * int((peaks >= speed).sum())
    offset = spread.current_offset * actuator.torque_constant * actuator.gear_ratio
    return DEVIATIONS * math.hypot(spread.friction * torque, offset) / math.sqrt(tests)


def _shape_claims(fits: Fits) -> tuple[Claim, ...]:
    claims = []
    for joint in JOINTS:
        printed, fit = dip_velocity(table_values(joint)), fits[joint]
        relative = fit.half_width("c", LEVEL) / fit.values["c"]
        claims.append(
            Claim(
                name=f"speed of least friction, {joint}",
                thesis=printed,
                ours=dip_velocity(fit.values),
                unit="rad/s",
                kind=Kind.PREDICTED,
                low=printed * (1.0 - relative),
                high=printed * (1.0 + relative),
                reason=f"the dip lies at a multiple of c, whose {100.0 * LEVEL:g} % interval is "
                f"±{100.0 * relative:.1f} %",
                source="figure 3.4 by (3.1) and table 3.1",
            )
        )
    return tuple(claims)


def dip_velocity(values: Mapping[str, float]) -> float:
    """Speed of least friction beyond the first rise, in [rad] / [s].

    Args:
        values: a, b, c and d of equation (3.1), with a below b.

    Returns:
        Where the law has its minimum; the exponential is strongest at c/√2.
    """
    c = values["c"]
    found = minimize_scalar(
        lambda speed: _torque_at(values, speed),
        bounds=(0.3 * c, 1.5 * c),
        method="bounded",
        options={"xatol": 1e-6},
    )
    return float(found.x)


def draw_comparison(fits: Fits) -> Figure:
    """Both laws, printed and identified, over low speeds and over those of a gait."""
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    for axes, end, title in zip(
        figure.subplots(1, 2),
        (AXIS_END, TwoWayProtocol().highest_speed),
        ("falls", "motor-driven tests"),
        strict=True,
    ):
        _draw_laws(axes, fits, end)
        style_panel(axes, f"speeds of the {title}", "friction torque [N m]")
    figure.axes[0].legend(frameon=False, fontsize="small", loc="lower right")
    return figure


def _draw_laws(axes: Axes, fits: Fits, end: float) -> None:
    speeds = np.concatenate([[0.0], end * np.linspace(0.01, 1.0, 300) ** 2])
    for joint, fit in fits.items():
        colour = JOINT_COLOURS[joint]
        axes.plot(
            speeds,
            law_torque(table_values(joint), speeds),
            color=colour,
            alpha=0.35,
            linewidth=5.0,
            label=f"{joint}, table 3.1",
        )
        axes.plot(speeds, law_torque(fit.values, speeds), "--", color=colour, label=f"{joint}, identified")
    axes.set(xlabel="velocity [rad/s]", xlim=(0.0, end), ylim=(0.0, None))


RECIPES = (Recipe(key="fig-3.4", title="Friction models of hip and knee", make=make_comparison),)
