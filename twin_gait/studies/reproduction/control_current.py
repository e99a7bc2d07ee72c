"""Figure 3.5: target current, measured current, and the target computed again from the log."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.core.actuator import torque_to_current
from twin_gait.identification.signals import decimate, moving_average
from twin_gait.measures.effort import root_mean_square
from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.simulation.bench_joint import TICK, BenchRun, simulate_bench
from twin_gait.studies.reproduction.claim import Claim, Kind, Recipe, Reproduction
from twin_gait.studies.reproduction.control_bench import (
    GAINS,
    HAND_VELOCITIES,
    REACH,
    SHORT_REACH,
    lag_of_current_loop,
    last_period,
    led_by_hand,
    model_torque,
    torque_control,
)

MEASURED_RMSE = 0.0113  # [A], target and measured current (thesis 3.5)
OFF_LINE_RMSE = 0.0035  # [A], target current and the one computed after the test (thesis 3.5)


def off_line_current(run: BenchRun, phase: int) -> np.ndarray:
    """Target current computed after the test, from nothing but the log's velocity.

    The post-processing of section 2.3.1 on the log's 1 kHz velocity, the friction model, equation (2.16).

    Args:
        run: The test.
        phase: Row of the log whose velocity is the first one kept, 0 to 9: a log does not say at which of its
            rows the firmware took its samples.

    Returns:
        In [A], each value held until the next one, zero before the first, shape ``(n_ticks,)``.
    """
    sensors, motor = run.test.sensors, run.test.actuator
    velocity = decimate(run.column("velocity_rad_per_s")[phase:], sensors.decimation)
    gain = run.test.control.friction_compensation_gain  # type: ignore[union-attr]
    torque = gain * model_torque(moving_average(velocity, sensors.window))
    held = np.repeat(torque, sensors.decimation)[: len(run.rows) - phase]
    torque_rows = np.concatenate([np.zeros(phase), held])
    per_torque = torque_to_current(1.0, motor.torque_constant, motor.gear_ratio, motor.gear_efficiency)
    return np.asarray(per_torque * torque_rows)


class Hand(NamedTuple):
    """How a hand leads the knee.

    Attributes:
        reach: To either side in [rad].
        fastest: Velocity in the middle in [rad] / [s].
    """

    reach: float
    fastest: float

    @property
    def words(self) -> str:
        """For a legend."""
        return f"{2.0 * math.degrees(self.reach):.0f}°, up to {self.fastest} rad/s"


@dataclass(frozen=True, eq=False)
class CurrentErrors:
    """The currents of one test.

    Attributes:
        hand: How the hand moved.
        run: The test.
        measured: RMSE of target and measured current in [A].
        off_line: RMSE of target and recomputed current in [A] for every phase of decimation.
    """

    hand: Hand
    run: BenchRun
    measured: float
    off_line: tuple[float, ...]

    @property
    def any_phase(self) -> float:
        """RMSE of target and recomputed current in [A] where every phase is as likely as the others."""
        return root_mean_square(np.array(self.off_line))


def current_errors(hand: Hand, seed: int) -> CurrentErrors:
    """Lead the knee by hand in the transparent mode and compare its currents.

    Args:
        hand: How the hand moves.
        seed: Of the noise.

    Returns:
        The errors over the second period of the hand.
    """
    test = led_by_hand(torque_control(GAINS[0]), reach=hand.reach, fastest=hand.fastest)
    run = simulate_bench(test, seed=seed)
    rows = last_period(run)
    target = run.column("target_current_A")[rows]
    errors = [off_line_current(run, phase)[rows] - target for phase in range(test.sensors.decimation)]
    return CurrentErrors(
        hand=hand,
        run=run,
        measured=root_mean_square(run.column("measured_current_A")[rows] - target),
        off_line=tuple(root_mean_square(error) for error in errors),
    )


def geometric_mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Middle of positive numbers on a logarithmic scale, and the factor from it to the ends.

    Args:
        values: The numbers.

    Returns:
        Root of least times largest, and root of largest over least.
    """
    return math.sqrt(min(values) * max(values)), math.sqrt(max(values) / min(values))


def make_current_validation(folder: Path, seed: int) -> Reproduction:
    """Compare target, measured and recomputed current.

    Args:
        folder: Not used.
        seed: Of the noise.

    Returns:
        What was found.
    """
    hands = [Hand(*values) for values in itertools.product((SHORT_REACH, REACH), HAND_VELOCITIES)]
    found = [current_errors(hand, seed) for hand in hands]
    shown = found[0]
    return Reproduction(
        key="fig-3.5",
        title="Target, measured and recomputed current",
        figure=draw_currents(found),
        claims=(_measured_claim(found), _off_line_claim(found)),
        text="A hand leads the transparent knee (G = 0.35). The target current is computed again from the "
        "log's velocity alone, by the filter and the model of the thesis. It does not come out exactly: the "
        "firmware differences the angle over 10 ms, the log's velocity is a difference over 1 ms of which "
        "every tenth is kept, and the log does not say which tenth. The error stands where the hand turns, "
        f"for there the friction model is steep: {1e3 * min(each.any_phase for each in found):.1f} to "
        f"{1e3 * max(each.any_phase for each in found):.1f} mA, by how often and how fast it turns. A small "
        "RMSE shows that the model was carried over correctly. It does not show that the model is the "
        "friction of the joint, for that plays no part in either current.",
        readings=(
            f"As printed in section 3.5: target and measured current agree to {MEASURED_RMSE} A, a proof "
            f"that the torque control works. In our log that is {1e2 * _share(shown):.0f} % of the "
            "target's RMS.",
            "As printed in chapter 4: the measured current is very noisy and the loop hard to use. Both can "
            f"be: with {shown.run.test.drive.noise} A of noise in every sample the log looks noisy, while "
            "winding and rotor smooth the motion.",
        ),
    )


def _share(errors: CurrentErrors) -> float:
    rows = last_period(errors.run)
    return errors.measured / root_mean_square(errors.run.column("target_current_A")[rows])


def expected_rmse(run: BenchRun) -> float:
    r"""RMSE of target and measured current by its parts, :math:`\sqrt{\sigma^2 + l^2\,\overline{\alpha^2}}`.

    Args:
        run: A test with a hand.

    Returns:
        In [A]: noise of a sample, and the lag of the loop behind the back-EMF at the acceleration of the
        last period; ripple and delay left out.
    """
    acceleration = run.column("motor_acceleration_rad_per_s2")[last_period(run)]
    return math.hypot(run.test.drive.noise, lag_of_current_loop(run.test) * root_mean_square(acceleration))


def _measured_claim(found: Sequence[CurrentErrors]) -> Claim:
    values, parts = [each.measured for each in found], [expected_rmse(each.run) for each in found]
    return Claim(
        name="RMSE of target and measured current",
        thesis=MEASURED_RMSE,
        ours=geometric_mean_and_spread(values)[0],
        unit="A",
        kind=Kind.CALIBRATED,
        reason=f"The noise of a current sample, {found[0].run.test.drive.noise} A, was chosen so that this "
        f"comes near: {1e3 * min(values):.1f} to {1e3 * max(values):.1f} mA by the hand. Noise and the "
        f"loop's lag behind the back-EMF, in closed form, are {1e3 * min(parts):.1f} to "
        f"{1e3 * max(parts):.1f} mA of it.",
        source="section 3.5, figure 3.5",
    )


def _off_line_claim(found: Sequence[CurrentErrors]) -> Claim:
    values = [each.any_phase for each in found]
    ours, spread = geometric_mean_and_spread(values)
    return Claim(
        name="RMSE of target current and the one recomputed from the log",
        thesis=OFF_LINE_RMSE,
        ours=ours,
        unit="A",
        kind=Kind.PREDICTED,
        low=OFF_LINE_RMSE / spread,
        high=OFF_LINE_RMSE * spread,
        reason="The thesis prints neither path nor speed of the hand. Between 40° and the whole range of the "
        f"knee, 0.3 and 0.6 rad/s, we find {1e3 * min(values):.1f} to {1e3 * max(values):.1f} mA, a factor "
        f"of {spread:.2f} to either side of their geometric mean, which is our number. The thesis's hand may "
        "be off the middle one by as much.",
        source="section 3.5, figure 3.5",
    )


def draw_currents(found: Sequence[CurrentErrors]) -> Figure:
    """Draw the currents of a period, their turn closely, and the errors by phase.

    Args:
        found: Of all hands; the first one's currents are drawn.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 2)
    period, close = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, 0])
    run = found[0].run
    rows, target = last_period(run), run.column("target_current_A")
    turn = rows.start + 500 + int(np.argmin(np.abs(target[rows.start + 500 : rows.stop - 500])))
    _draw_lines(period, run, rows)
    _draw_lines(close, run, slice(turn - 150, turn + 200))
    style_panel(period, f"{found[0].hand.words}, G = {GAINS[0]}", "current (A)")
    style_panel(close, "where the hand turns", "current (A)")
    figure.legend(*period.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    _draw_errors(figure.add_subplot(grid[1, 1]), found)
    return figure


def _draw_lines(axes: Axes, run: BenchRun, rows: slice) -> None:
    time = np.arange(rows.start, rows.stop) * TICK
    sampled = run.column("measured_current_A")[rows]
    axes.plot(time, sampled, color=BLUE, linewidth=0.5, alpha=0.6, label="measured")
    axes.plot(time, run.column("target_current_A")[rows], color=VERMILLION, linewidth=1.6, label="target")
    axes.plot(
        time,
        off_line_current(run, run.test.sensors.decimation // 2)[rows],
        color=ORANGE,
        linewidth=1.2,
        linestyle="--",
        label="recomputed from the log, five ticks out of phase",
    )
    axes.set_xlabel("time (s)")


def _draw_errors(axes: Axes, found: Sequence[CurrentErrors]) -> None:
    for errors, colour in zip(found, (SKY_BLUE, ORANGE, GREY, BLUISH_GREEN), strict=True):
        axes.plot(1e3 * np.array(errors.off_line), color=colour, marker="o", label=errors.hand.words)
    axes.axhline(1e3 * OFF_LINE_RMSE, color=VERMILLION, linestyle="--", label=f"thesis: {OFF_LINE_RMSE} A")
    axes.set_xlabel("row of the log at which decimation begins")
    axes.set_xticks(range(len(found[0].off_line)))
    axes.set_ylim(0.0, 1.6e3 * max(max(errors.off_line) for errors in found))
    axes.legend(fontsize="small", frameon=False, loc="upper left", ncols=2)
    style_panel(axes, "target less recomputed current", "RMSE (mA)")


CURRENT = Recipe(key="fig-3.5", title="Target, measured and recomputed current", make=make_current_validation)
