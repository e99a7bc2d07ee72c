"""Tests of the pictures that are drawn for each kind of run, and of their agreement with the log."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from matplotlib import colors
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox
from numpy.testing import assert_allclose
from synthetic_run import HIP_OFFSET, LAG, PHASE_TICKS, STRIDE, synthetic_run

from twin_gait import load_experiment, simulate
from twin_gait.control.safety import Trip, TripCause
from twin_gait.gait.table import TICK
from twin_gait.palette import EVENT_COLOUR, HELD_COLOUR, PHASE_COLOURS, SIDE_COLOURS, phase_colour
from twin_gait.report.canvas import STRIP_OPACITY, event_window, last_strides
from twin_gait.report.figures import FIGURES, plot_run, write_figures
from twin_gait.report.reference import reference_cycle
from twin_gait.report.run_figures import (
    draw_angles,
    draw_currents,
    draw_cycle,
    draw_feet,
    draw_ground_forces,
    draw_portrait,
    draw_torques,
)
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.vocabulary import GaitPhase, JointName, Side
from twin_gait.worlds.faults import parse_fault

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def walk() -> Run:
    return synthetic_run()


@pytest.fixture(scope="module")
def bench_run() -> Run:
    """Too short for a stride."""
    return simulate(replace(load_experiment("bench_leg").experiment, duration=0.6))


def walk_time(run: Run) -> np.ndarray:
    return run.log["time_s"].to_numpy()


def png_size(path: Path) -> tuple[int, int]:
    content = path.read_bytes()
    assert content.startswith(PNG_SIGNATURE)
    width, height = struct.unpack(">II", content[16:24])
    return width, height


def line(figure: Figure, panel: int, label: str) -> Line2D:
    return next(item for item in figure.axes[panel].get_lines() if item.get_label() == label)


class Strip(NamedTuple):
    """A phase in full colour at the top of a panel; the pale band behind has the same edges."""

    start: float
    colour: str


def strips(figure: Figure, panel: int = 0) -> list[Strip]:
    (shown,) = (item for item in figure.axes[panel].collections if item.get_alpha() == STRIP_OPACITY)
    return [
        Strip(float(path.vertices[:, 0].min()), colors.to_hex(colour).upper())  # type: ignore[index]
        for path, colour in zip(shown.get_paths(), np.asarray(shown.get_facecolor()), strict=True)
    ]


def legend_labels(figure: Figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts() if text.get_text().strip()]


def test_walk_gets_every_picture(walk: Run, tmp_path: Path) -> None:
    assert write_figures(walk, tmp_path, list(FIGURES)) == {}
    files = sorted(tmp_path.iterdir())
    assert [path.name for path in files] == sorted(f"{name}.png" for name in FIGURES)
    for path in files:
        width, height = png_size(path)
        assert width >= 1200 and height >= 800
        assert path.stat().st_size > 30_000  # an empty canvas of this size has some 10 kB


def test_bench_run_without_strides_gets_time_series(bench_run: Run, tmp_path: Path) -> None:
    assert write_figures(bench_run, tmp_path, list(FIGURES)) == {}
    absent = ("gait_cycle", "ground_forces", "feet")
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == sorted(f"{name}.png" for name in FIGURES if name not in absent)
    assert all(draw(bench_run) is None for draw in (draw_cycle, draw_ground_forces, draw_feet))


def test_shortest_log_that_can_be_drawn(walk: Run, tmp_path: Path) -> None:
    assert write_figures(replace(walk, log=walk.log.iloc[:2]), tmp_path, list(FIGURES)) == {}
    assert len(list(tmp_path.iterdir())) == len(FIGURES) - 2  # no strides


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("tripped_too", [False, True])
def test_elements_within_fixed_margins_are_neither_cut_off_nor_covered(
    walk: Run, tripped: Run, name: str, tripped_too: bool
) -> None:
    figure = plot_run(tripped if tripped_too else walk, name)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [axes.get_tightbbox(renderer) for axes in figure.axes]
    boxes += [item.get_window_extent(renderer) for item in (*figure.texts, *figure.legends)]
    for box in boxes:
        assert box is not None and figure.bbox.contains(*box.min) and figure.bbox.contains(*box.max)
    for first, second in combinations(boxes, 2):
        common = Bbox.intersection(first, second)
        # The frame of a text is larger than its ink.
        assert common is None or min(common.width, common.height) < figure.dpi / 50


def test_cycle_shows_the_mean_and_the_reference(walk: Run) -> None:
    figure = draw_cycle(walk)
    assert figure is not None
    mean = line(figure, 0, "mean over strides")
    reference = line(figure, 0, "healthy, Koopman (2014)")
    assert_allclose(mean.get_xdata(), np.arange(101))
    gap = np.asarray(mean.get_ydata()) - np.asarray(reference.get_ydata())
    assert_allclose(gap, np.degrees(HIP_OFFSET), atol=2e-3)
    assert "left hip, 3 strides (the first 2 of 5 settle), RMSE 5.7°" in [
        axes.get_title() for axes in figure.axes
    ]


def test_cycle_bands_change_at_the_phase_boundaries(walk: Run) -> None:
    figure = draw_cycle(walk)
    assert figure is not None
    starts = [strip.start for strip in strips(figure)]
    assert LAG == PHASE_TICKS[0]  # early stance is over when the heel strikes, at 0 and at 100 %
    boundaries = np.append(np.cumsum(PHASE_TICKS)[1:] - LAG, STRIDE) / STRIDE * 100.0
    assert_allclose(starts[1:], boundaries, atol=1.0)  # the cycle is sampled at whole percents
    cycle = (*list(GaitPhase)[1:], GaitPhase.EARLY_STANCE, GaitPhase.MIDDLE_STANCE)
    expected = [PHASE_COLOURS[phase] for phase in cycle]
    assert [strip.colour for strip in strips(figure)] == expected


def test_torques_show_the_parts_that_act_and_the_limits(walk: Run) -> None:
    figure = draw_torques(walk)
    labels = legend_labels(figure)
    assert "impedance torque" in labels and "motor torque" in labels and "torque limit" in labels
    assert "friction compensation torque" not in labels  # zero throughout this walk
    limit = walk.experiment.control.limits[JointName.HIP].torque
    heights = {float(np.asarray(item.get_ydata())[0]) for item in figure.axes[0].get_lines()[-2:]}
    assert heights == {limit, -limit}


def test_currents_show_the_current_at_the_torque_limit(walk: Run) -> None:
    figure = draw_currents(walk)
    # 60 N·m at the knee through K_t 0.0705 N·m/A and a gear of 100.
    knee = next(index for index, axes in enumerate(figure.axes) if axes.get_title() == "left knee")
    shown = float(np.asarray(line(figure, knee, "current at the torque limit").get_ydata())[0])
    assert shown == pytest.approx(60.0 / 7.05)
    (power,) = (item for item in plot_run(walk, "battery").axes[0].get_lines()
                if item.get_label() == "battery power")  # fmt: skip
    assert set(np.unique(np.asarray(power.get_ydata()))) <= {100.0, -20.0}


def test_feet_mark_the_heel_strikes(walk: Run) -> None:
    figure = draw_feet(walk)
    assert figure is not None
    strikes = np.asarray(line(figure, 0, "left heel strike").get_xdata())
    assert_allclose(strikes, [(LAG + k * STRIDE) * TICK for k in (3, 4, 5)])
    assert line(figure, 0, "right foot").get_color() == SIDE_COLOURS[walk.leg_records()[1].side]


def test_portrait_is_coloured_by_phase(walk: Run) -> None:
    drawn = draw_portrait(walk).axes[0].get_lines()[:-1]  # the last is the axis
    for marker in ("None", "o"):
        found = {item.get_color() for item in drawn if item.get_marker() == marker}
        assert found == set(PHASE_COLOURS.values())


def test_angles_of_a_long_run_show_its_end(walk: Run) -> None:
    time = np.asarray(line(draw_angles(walk), 0, "angle").get_xdata())
    assert_allclose(time, walk.log["time_s"])


def test_window_holds_the_last_two_strides_of_the_first_leg(walk: Run) -> None:
    time = walk_time(walk)[last_strides(walk)]
    assert (time[0], time[-1]) == pytest.approx(((LAG + 3 * STRIDE) * TICK, (LAG + 5 * STRIDE) * TICK))


def test_reference_needs_a_belt_and_a_wearer(walk: Run, bench_run: Run) -> None:
    assert reference_cycle(walk.experiment, JointName.HIP) is not None
    assert reference_cycle(bench_run.experiment, JointName.HIP) is None
    assert reference_cycle(replace(walk.experiment, patient=None), JointName.HIP) is None


def test_phases_have_colours_of_their_own_and_unknown_ones_get_one() -> None:
    assert len(set(PHASE_COLOURS.values())) == len(GaitPhase)
    assert phase_colour("late_stance") == PHASE_COLOURS[GaitPhase.LATE_STANCE]
    unknown = [phase_colour(name, position) for position, name in enumerate(("lift", "reach"))]
    assert unknown[0] != unknown[1] and not set(unknown) & set(PHASE_COLOURS.values())


# ---------------------------------------------------------------------- events of the run

STRUCK, TRIPPED = 4.0, 4.5  # [s]


@pytest.fixture(scope="module")
def tripped(walk: Run) -> Run:
    fault = parse_fault(f"encoder_freeze:left_knee@{STRUCK}s")
    trip = Trip(round(TRIPPED / TICK), TripCause.ENCODER_FROZEN, Side.LEFT, JointName.KNEE)
    experiment = replace(walk.experiment, faults=(fault,))
    return replace(walk, experiment=experiment, trip=trip, status=RunStatus.FELL)


@pytest.mark.parametrize("draw", [draw_angles, draw_torques, draw_currents, draw_feet])
def test_pictures_over_time_mark_fault_trip_and_fall(tripped: Run, walk: Run, draw: Callable) -> None:
    figure, end = draw(tripped), tripped.log["time_s"].iloc[-1]
    marks = {
        str(item.get_label()): item for item in figure.axes[0].get_lines() if item.get_color() == EVENT_COLOUR
    }
    assert {label: float(item.get_xdata()[0]) for label, item in marks.items()} == pytest.approx(
        {"fault": STRUCK, "trip": TRIPPED, "fall": end}
    )
    assert set(marks) <= set(legend_labels(figure))
    assert len({str(item.get_linestyle()) for item in marks.values()}) == 3
    last = figure.get_suptitle().splitlines()[-1]
    assert (
        last
        == "fault: encoder freeze, left knee, 4.00 s · trip: encoder frozen, left knee, 4.50 s · fall, 7.20 s"
    )
    assert not any(item.get_color() == EVENT_COLOUR for axes in draw(walk).axes for item in axes.get_lines())


@pytest.mark.parametrize("draw", [draw_angles, draw_torques, draw_currents])
def test_phases_are_grey_after_the_trip(tripped: Run, draw: Callable) -> None:
    figure = draw(tripped)
    *before, last = strips(figure)
    assert last == (pytest.approx(TRIPPED), HELD_COLOUR)
    assert before and HELD_COLOUR not in {strip.colour for strip in before}
    assert "held after the trip" in legend_labels(figure)


def test_the_window_includes_the_event(tripped: Run) -> None:
    long = replace(tripped, trip=None, status=RunStatus.COMPLETED)
    time = walk_time(long)[event_window(long, 1.5)]
    assert (time[0], time[-1]) == pytest.approx((STRUCK - 0.5, STRUCK + 1.0), abs=2e-3)
    quiet = replace(long, experiment=replace(long.experiment, faults=()))
    assert walk_time(quiet)[event_window(quiet, 1.5)][-1] == pytest.approx(7.199)


def test_a_stride_with_a_trip_is_not_counted(tripped: Run, walk: Run) -> None:
    assert walk.steady_spans == ((0.0, math.inf),) and tripped.steady_spans == ((0.0, TRIPPED),)
    for record, whole in zip(tripped.leg_records(), walk.leg_records(), strict=True):
        strides = record.strides(skip=0)
        assert 0 < len(strides) < len(whole.strides(skip=0))
        assert strides[-1, 1] * TICK <= TRIPPED
