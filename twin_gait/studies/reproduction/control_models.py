"""Figures 2.12 and 2.20: TWIN's old friction model, and the linear stiffness."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from twin_gait.core.friction_models import coulomb_viscous_tanh_torque
from twin_gait.palette import BLACK, BLUE, GREY, ORANGE, REDDISH_PURPLE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.scenario.bench_joint import OldFrictionModel
from twin_gait.simulation.bench_joint import BenchRun, simulate_bench
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.control_bench import (
    EQUILIBRIUM,
    REACH,
    STIFFNESS_PER_DEG,
    electromechanical_torque,
    last_period,
    led_by_hand,
    model_torque,
    slope_per_deg,
    torque_control,
    with_ideal_current,
)
from twin_gait.studies.reproduction.control_impedance import STIFFNESS

SLOW, QUICK = (math.radians(5.0), 0.15), (REACH, 2.5)  # reach in [rad] and velocity in [rad] / [s] of a hand
AXIS_VELOCITY, AXIS_TORQUE = 6.0, 10.0  # [rad] / [s] and [N m]; the axes of figure 2.12
SPRING_ANGLE, SPRING_TORQUE = 20.0, 1.0  # [deg] and [N m]; what k was chosen from (thesis 2.4)
AXIS_ANGLE, AXIS_SPRING = 70.0, 3.5  # [deg] and [N m]; the axes of figure 2.20
TABLE_DIP = (0.02, 0.6)  # [rad] / [s]; where old and new model are compared


# ---------------------------------------------------------------------- figure 2.12


def old_model_test(reach: float, fastest: float, seed: int) -> BenchRun:
    """Lead the knee by hand with the old friction model as the only controller, G = 1.

    Args:
        reach: Of the hand to either side in [rad].
        fastest: Its velocity in the middle in [rad] / [s].
        seed: Of the encoder's noise.

    Returns:
        The run; the joint has all of the model's friction.
    """
    control = replace(torque_control(1.0), old_model=OldFrictionModel())
    return simulate_bench(
        with_ideal_current(led_by_hand(control, reach=reach, fastest=fastest, ratio=1.0)), seed=seed
    )


def seen_steepness(run: BenchRun) -> float:
    r"""Steepness of the old model as a log shows it.

    From :math:`T = F_s \tanh(\kappa\omega) + F_v\omega` in every row between a fifth and four fifths of F_s.

    Args:
        run: A slow test.

    Returns:
        Median of κ in [s] / [rad].
    """
    model, rows = OldFrictionModel(), last_period(run)
    velocity = run.column("motor_velocity_rad_per_s")[rows]
    share = (electromechanical_torque(run)[rows] - model.viscous * velocity) / model.coulomb
    used = (np.abs(share) > 0.2) & (np.abs(share) < 0.8)
    return float(np.median(np.arctanh(share[used]) / velocity[used]))


def old_law(velocity: np.ndarray) -> np.ndarray:
    """Old friction model, equation (2.5), in [N m].

    Args:
        velocity: In [rad] / [s], shape ``(n,)``.

    Returns:
        Shape ``(n,)``.
    """
    model = OldFrictionModel()
    return np.asarray(coulomb_viscous_tanh_torque(velocity, model.coulomb, model.viscous, model.steepness))


def make_old_model(folder: Path, seed: int) -> Reproduction:
    """Read the old friction model off a joint that it compensates.

    Args:
        folder: Not used.
        seed: Of the encoder's noise.

    Returns:
        What was found.
    """
    slow, quick = old_model_test(*SLOW, seed), old_model_test(*QUICK, seed)
    model, motor, battery = OldFrictionModel(), slow.test.actuator, slow.test.battery
    no_load = battery.voltage / (motor.torque_constant * motor.gear_ratio)
    velocity = np.linspace(*TABLE_DIP, 400)
    surplus = old_law(velocity) - model_torque(velocity)
    end = float(old_law(np.array([AXIS_VELOCITY]))[0])
    return Reproduction(
        key="fig-2.12",
        title="TWIN's old friction model",
        figure=draw_old_model(slow, quick),
        claims=(
            Claim(
                name="steepness of the old model, seen in the motor's torque",
                thesis=model.steepness,
                ours=seen_steepness(slow),
                unit="s/rad",
                kind=Kind.CALIBRATED,
                reason="The 40 of equation (2.5) was put in; this is a check of the bench.",
                source="equation (2.5), figure 2.12",
            ),
        ),
        text="A hand leads the knee, once slowly and once fast, while the old model of equation (2.5) "
        "compensates with G = 1; the torque of the motor over the velocity is the model. The thesis prints "
        "the 40 but neither F_v nor F_s; ours are the d and b of table 3.1. Against a joint with the "
        f"friction of table 3.1 this model compensates too much by up to {surplus.max():.1f} N m, at "
        f"{velocity[int(np.argmax(surplus))]:.2f} rad/s, where that friction has its dip.",
        readings=(
            f"With our F_v and F_s the old model is {end:.1f} N m at {AXIS_VELOCITY:.0f} rad/s, and leaves "
            f"the printed axes, ±{AXIS_VELOCITY:.0f} rad/s and ±{AXIS_TORQUE:.0f} N m. If the printed curve "
            f"does not, then F_s + {AXIS_VELOCITY:.0f} F_v was at most {AXIS_TORQUE:.0f} N m.",
            f"The joint cannot reach {AXIS_VELOCITY:.0f} rad/s: at {battery.voltage} V the 24 V motor has "
            f"its no-load speed at {no_load:.1f} rad/s behind the gear.",
        ),
    )


def draw_old_model(slow: BenchRun, quick: BenchRun) -> Figure:
    """Draw the old model, and what the motor gave.

    Args:
        slow: Slow hand.
        quick: Fast hand.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    wide, close = figure.subplots(1, 2)
    for axes, run, end in ((wide, quick, AXIS_VELOCITY), (close, slow, 0.3)):
        rows = last_period(run)
        fine = np.linspace(-end, end, 801)
        seen = run.column("motor_velocity_rad_per_s")[rows], electromechanical_torque(run)[rows]
        axes.plot(*(values[::10] for values in seen), ".", color=BLUE, label="motor on the bench")
        axes.plot(fine, old_law(fine), color=BLACK, linewidth=1.2, label="old model (2.5)")
        axes.plot(fine, model_torque(fine), color=ORANGE, linestyle="--", label="table 3.1")
        axes.set_xlabel("velocity (rad/s)")
    wide.axhspan(-AXIS_TORQUE, AXIS_TORQUE, color=GREY, alpha=0.12, label="axes of the thesis")
    style_panel(wide, "the whole axis of the thesis", "friction torque (N m)")
    style_panel(close, "close: a slow hand", "friction torque (N m)")
    figure.legend(*wide.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


# ---------------------------------------------------------------------- figure 2.20


def make_stiffness(folder: Path, seed: int) -> Reproduction:
    """Lead the knee against the spring alone, without compensation.

    Args:
        folder: Not used.
        seed: Of the noise.

    Returns:
        What was found.
    """
    run = simulate_bench(led_by_hand(torque_control(0.0, stiffness=STIFFNESS)), seed=seed)
    rows = last_period(run)
    torque = electromechanical_torque(run)
    at_angle = SPRING_ANGLE * slope_per_deg(run, torque, rows)
    reason = f"k = {STIFFNESS_PER_DEG} N m/deg was put in; this is a check of the bench."
    return Reproduction(
        key="fig-2.20",
        title="Linear stiffness",
        figure=draw_stiffness(run),
        claims=(
            Claim(
                name=f"torque of the spring at {SPRING_ANGLE:.0f}°",
                thesis=SPRING_TORQUE,
                ours=at_angle,
                unit="N m",
                kind=Kind.CALIBRATED,
                reason=reason,
                source="section 2.4, figure 2.20",
            ),
        ),
        text="A hand leads the knee about θ0 with the spring alone, G = 0. The motor's torque is a line "
        f"through {at_angle:.3f} N m at {SPRING_ANGLE:.0f}°. The hand feels the spring and all of the "
        f"friction, which at {SPRING_ANGLE:.0f}° is more than the spring: a joint with a spring this soft "
        "stays where it is put until friction is compensated.",
        readings=(
            f"As printed, the abscissa of figure 2.20 is an angle that ends at {AXIS_SPRING} deg and the "
            f"ordinate ends at {AXIS_ANGLE:.0f}: a slope of {AXIS_ANGLE / AXIS_SPRING:.0f}.",
            f"With the labels exchanged the figure shows {AXIS_SPRING} N m at {AXIS_ANGLE:.0f}°: "
            f"{AXIS_SPRING / AXIS_ANGLE:.3f} N m/deg, the k of the text.",
        ),
    )


def draw_stiffness(run: BenchRun) -> Figure:
    """Draw the spring as the motor gives it and as the hand feels it.

    Args:
        run: The test.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    rows = last_period(run)
    angle = np.degrees(run.column("position_rad")[rows] - EQUILIBRIUM)
    axes.plot(
        angle, run.column("hand_torque_Nm")[rows], color=REDDISH_PURPLE, label="hand, friction included"
    )
    axes.plot(angle, -electromechanical_torque(run)[rows], color=BLUE, label="motor, $-T_{em}$: the spring")
    axes.plot(SPRING_ANGLE, SPRING_TORQUE, "o", color=VERMILLION, label="thesis: 1 N m at about 20°")
    axes.set_xlabel("θ - θ0 (deg)")
    axes.legend(fontsize="small", frameon=False, loc="upper left")
    style_panel(axes, "spring of 0.05 N m/deg without friction compensation", "torque (N m)")
    return figure


OLD_MODEL = Recipe(key="fig-2.12", title="TWIN's old friction model", make=make_old_model)
SPRING = Recipe(key="fig-2.20", title="Linear stiffness", make=make_stiffness)
