"""Stability of the sampled loop: does the spectral radius of its transition matrix predict instability?

`twin-gait check` combines the steps of firmware and leg in a frame of ten ticks in one matrix, with coupled
hip and knee. Here its spectral radius is compared with the compiled engine on 128 settings of k, b and G of
the bench leg, with linear friction and with the true friction. Two minutes on one core; page:
docs/background/loop_stability.md.
"""

# %% [markdown]
# ## The bench leg in one posture
# Every case has the same k, b and G in hip and knee. The *true* leg has the friction law, the limits and the
# stops, and starts 5° away. The *linear* leg has the slopes of friction and its model at a velocity, and
# starts so near that nothing saturates while its growth or decay is observed.

# %%
from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from gallery import read_options
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from whatif.endings import Ending, classify

from twin_gait import Experiment, GaitTable, JointName, Run, RunStatus, Side, load_experiment, simulate
from twin_gait.checking.hanging_leg import friction_slope, linear_loops
from twin_gait.checking.linear_loop import LinearLoop, spectral_radius, transition_matrix
from twin_gait.gait.table import JointImpedance, PhaseParameters
from twin_gait.palette import BLACK, BLUE, GREY, VERMILLION
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.report.canvas import save
from twin_gait.studies.jobs import run_jobs
from twin_gait.worlds.bench_leg import BenchLeg

STIFFNESSES = tuple(math.degrees(value) for value in (0.3, 1.0, 2.5, 6.0))  # [N·m/rad]
DAMPINGS = (0.0, 10.0, 30.0, 90.0)  # [N·m·s/rad]
GAINS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0)
POSTURE = (math.radians(20.0), math.radians(40.0))  # hip and knee, far from the stops
VELOCITIES = (0.0, 1.0)  # [rad/s] at which the friction laws are linearised
LINEAR_START, TRUE_START = 1e-5, math.radians(5.0)  # [rad] away from the posture
DURATION = 10.0  # [s]
HOLD = "hold"


class Case(NamedTuple):
    """Point of the grid, the same for hip and knee."""

    stiffness: float  # [N·m/rad]
    damping: float  # [N·m·s/rad]
    gain: float


def posture(shift: float) -> dict[JointName, float]:
    """Return the joint angles at the start in [rad], shifted from the posture."""
    hip, knee = POSTURE
    return {JointName.HIP: hip + shift, JointName.KNEE: knee + shift}


def true_experiment(case: Case) -> Experiment:
    """Return a bench leg in one posture, with the gravity compensation of the shipped swing phases."""
    base = load_experiment("bench_leg").experiment
    joints = {
        name: JointImpedance(
            stiffness=case.stiffness,
            damping=case.damping,
            equilibrium_angle=angle,
            friction_compensation_gain=case.gain,
        )
        for name, angle in zip(base.table.joints, POSTURE, strict=True)
    }
    phase = PhaseParameters(joints=joints, gravity_compensation=1.0)
    table = GaitTable(name=HOLD, joints=base.table.joints, phases={HOLD: phase}, transitions=())
    scenario = BenchLeg(start_angles=posture(TRUE_START))
    # Instability is the subject here: no monitor may end it.
    control = replace(base.control, safety=replace(base.control.safety, enabled=False))
    return replace(base, name=HOLD, table=table, scenario=scenario, control=control, duration=DURATION)


def linear_experiment(case: Case, velocity: float) -> Experiment:
    """Return the same leg with friction and its model replaced by their slopes at a velocity in [rad/s]."""
    true = true_experiment(case)
    plant, control = true.plant, true.control
    viscous_plant = {joint: viscous(law, velocity) for joint, law in plant.true_friction().items()}
    viscous_model = {joint: viscous(law, velocity) for joint, law in control.friction_model.items()}
    ratios = dict.fromkeys(plant.friction, 1.0)
    return replace(
        true,
        scenario=BenchLeg(start_angles=posture(LINEAR_START)),
        plant=replace(plant, friction=viscous_plant, friction_ratio=ratios),
        control=replace(control, friction_model=viscous_model),
    )


def viscous(law: FrictionParameters, velocity: float) -> FrictionParameters:
    slope = friction_slope(law, velocity)
    return FrictionParameters(
        breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=slope
    )


# %% [markdown]
# ## Prediction and simulation

# %%
UNDECIDED = 0.005  # a case with a spectral radius this close to 1 is left out
EARLY, LATE = (2.0, 3.0), (9.0, 10.0)  # [s] in which the sizes of a linear motion are compared
LARGE = 0.05  # [rad]; a linear motion of this size is unstable, and no longer linear
ROUNDING = 1e-12  # [rad]; a linear motion of this size has decayed
BEFORE, END = (5.0, 7.5), (7.5, 10.0)  # [s] in which the sizes of a true motion are compared


class Result(NamedTuple):
    """Prediction and simulation of one case."""

    case: Case
    radii: tuple[float, ...]  # spectral radius at each of VELOCITIES
    unstable: tuple[bool, ...]  # whether the linear run is unstable, at each of VELOCITIES
    ending: Ending  # ending of the true run
    amplitude: float  # [rad] amplitude at the end of the true run

    def misses(self) -> int:
        """Count the velocities at which the prediction is clear and wrong."""
        pairs = zip(self.radii, self.unstable, strict=True)
        return sum(abs(radius - 1.0) >= UNDECIDED and (radius > 1.0) != seen for radius, seen in pairs)


def grid() -> list[Case]:
    return [Case(*values) for values in itertools.product(STIFFNESSES, DAMPINGS, GAINS)]


@cache
def any_loop(velocity: float) -> LinearLoop:
    """Return the loop of the bench leg at the posture, into which a case inserts its k, b and G."""
    (loop,) = linear_loops(true_experiment(grid()[0]), velocity).values()
    return loop


def predicted_radius(case: Case, velocity: float) -> float:
    """Compute the spectral radius of the closed-loop transition matrix with friction linearised."""
    k, b, gain = (value * np.ones(len(POSTURE)) for value in case)
    return spectral_radius(transition_matrix(replace(any_loop(velocity), stiffness=k, damping=b, gain=gain)))


def motion(run: Run) -> np.ndarray:
    """Return the angles of hip and knee relative to the posture in [rad], shape ``(n_ticks, 2)``."""
    columns = [f"{Side.RIGHT}_{joint}_angle_rad" for joint in (JointName.HIP, JointName.KNEE)]
    return run.log[columns].to_numpy() - np.array(POSTURE)


def within(run: Run, span: tuple[float, float]) -> np.ndarray:
    return ((run.log["time_s"] >= span[0]) & (run.log["time_s"] < span[1])).to_numpy()


def linear_run_is_unstable(case: Case, velocity: float) -> bool:
    """Return whether a small motion of the linear leg becomes large, or is larger at the end than early."""
    run = simulate(linear_experiment(case, velocity))
    size = np.abs(motion(run)).max(axis=1)
    if run.status is RunStatus.DIVERGED or size.max() > LARGE:
        return True
    early, late = (float(size[within(run, span)].max()) for span in (EARLY, LATE))
    return late > max(early, ROUNDING)


def true_ending(case: Case) -> tuple[Ending, float]:
    """Return the ending of the leg with friction, limits and stops, and half its final range in [rad]."""
    run = simulate(true_experiment(case))
    if run.status is RunStatus.DIVERGED:
        return Ending.RUNAWAY, math.inf
    before, end = (motion(run)[within(run, span)] for span in (BEFORE, END))
    stops = [f"{Side.RIGHT}_{name}_stop_torque_Nm" for name in (JointName.HIP, JointName.KNEE)]
    return classify(before, end, at_stop=bool(run.log.loc[within(run, END), stops].to_numpy().any()))


def cross_check(case: Case) -> Result:
    """Predict one case and simulate it."""
    radii = tuple(predicted_radius(case, velocity) for velocity in VELOCITIES)
    unstable = tuple(linear_run_is_unstable(case, velocity) for velocity in VELOCITIES)
    return Result(case, radii, unstable, *true_ending(case))


# %% [markdown]
# ## Table and picture
# Background: spectral radius at rest. Marks: linear run (colour) and run with friction (shape).

# %%
LEVELS = (0.0, 0.95, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03, 2.0)
TINTS = ("#8fbfe0", "#aed0e9", "#cde2f2", "#e9f2fa", "#fbebe3", "#f6d0bd", "#efb295", "#e8926b")


def row_of(result: Result) -> dict[str, Any]:
    """Return a row of the table, with units in the names of its columns."""
    row: dict[str, Any] = {
        "stiffness_Nm_per_deg": round(math.radians(result.case.stiffness), 6),
        "damping_Nms_per_rad": result.case.damping,
        "friction_compensation_gain": result.case.gain,
    }
    for velocity, radius, unstable in zip(VELOCITIES, result.radii, result.unstable, strict=True):
        row[f"spectral_radius_at_{velocity:g}_rad_per_s"] = round(radius, 5)
        row[f"linear_run_at_{velocity:g}_rad_per_s"] = "unstable" if unstable else "stable"
    amplitude = round(math.degrees(result.amplitude), 4)
    return {**row, "true_run": str(result.ending), "true_amplitude_deg": amplitude}


def shown(result: Result) -> dict[str, str]:
    """Format a row for the page."""
    cells = {"b [N·m·s/rad]": f"{result.case.damping:g}", "G": f"{result.case.gain:g}"}
    for velocity, radius, unstable in zip(VELOCITIES, result.radii, result.unstable, strict=True):
        condition = f"at ±{velocity:g} rad/s" if velocity else "at rest"
        near = " (left out)" if abs(radius - 1.0) < UNDECIDED else ""
        cells[f"spectral radius {condition}"] = f"{radius:.4f}"
        cells[f"linear run {condition}"] = ("unstable" if unstable else "stable") + near
    cycles = result.ending is Ending.LIMIT_CYCLE
    amplitude = f", {math.degrees(result.amplitude):.2f}°" if cycles else ""
    return {**cells, "with friction": f"{result.ending}{amplitude}"}


def draw(results: Sequence[Result], samples: int = 33) -> Figure:
    """Draw a panel per stiffness, with G to the right and b upwards; ``samples``: background per axis."""
    figure = Figure(figsize=(11.0, 8.2), layout="constrained")
    figure.suptitle(
        "Stability: spectral radius of the transition matrix at rest, linear run and run with friction\n"
        "bench leg, same k, b and G in hip and knee",
        fontsize="large",
    )
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    gains = np.linspace(0.0, 1.0, samples)
    dampings = np.linspace(0.0, math.sqrt(1.35 * DAMPINGS[-1]), samples) ** 2
    for axes, k in zip(panels.flat, STIFFNESSES, strict=True):
        radii = [[predicted_radius(Case(k, b, gain), 0.0) for gain in gains] for b in dampings]
        axes.contour(gains, dampings, radii, levels=[1.0], colors=BLACK, linewidths=1.2)
        filled = axes.contourf(gains, dampings, radii, levels=LEVELS, colors=TINTS)
        for result in results:
            if result.case.stiffness == k:
                draw_mark(axes, result)
        axes.set_title(f"k = {math.radians(k):g} N·m/deg", fontsize="medium")
        axes.set_yscale("function", functions=(np.sqrt, np.square))
        axes.set_yticks(DAMPINGS, [f"{value:g}" for value in DAMPINGS])
        axes.set(xlim=(-0.05, 1.07), ylim=(0.0, 1.35 * DAMPINGS[-1]))
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("friction compensation gain G")
    for axes in panels[:, 0]:
        axes.set_ylabel("b [N·m·s/rad]")
    bar = figure.colorbar(filled, ax=panels, ticks=LEVELS[1:-1], pad=0.01, shrink=0.7)
    bar.set_label("spectral radius of 10 ms")
    marks = [
        mark("linear run stable", "s", BLUE),
        mark("with friction: rest", *look(Ending.REST, GREY)),
        Line2D([], [], color=BLACK, label="spectral radius 1"),
        mark("linear run unstable", "s", VERMILLION),
        mark("with friction: limit cycle, amplitude", *look(Ending.LIMIT_CYCLE, GREY)),
        mark("with friction: runaway into the stops", *look(Ending.RUNAWAY, GREY)),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=3, frameon=False)
    return figure


def look(ending: Ending, colour: str) -> tuple[str, str, str, float]:
    """Return marker, edge, filling and size of an ending."""
    if ending is Ending.RUNAWAY:
        return "X", colour, colour, 9.0
    return ("o", colour, colour, 5.0) if ending is Ending.REST else ("o", colour, "white", 9.0)


def mark(label: str, marker: str, edge: str, filling: str | None = None, size: float = 6.0) -> Line2D:
    width = 1.8 if filling == "white" else 0.5
    return Line2D(
        [], [], linestyle="none", marker=marker, markersize=size, label=label,
        markeredgecolor=edge, markerfacecolor=filling or edge, markeredgewidth=width,
    )  # fmt: skip


def draw_mark(axes: Axes, result: Result) -> None:
    position = (result.case.gain, result.case.damping)
    point = mark("", *look(result.ending, VERMILLION if result.unstable[0] else BLUE))
    point.set(xdata=position[:1], ydata=position[1:], clip_on=False, zorder=3)
    axes.add_line(point)
    if result.ending is Ending.LIMIT_CYCLE:
        degrees = math.degrees(result.amplitude)
        axes.annotate(
            f"{degrees:.0f}°" if degrees >= 9.95 else f"{degrees:.1f}°",
            position,
            xytext=(0, 7),
            textcoords="offset points",
            ha="center",
            fontsize="x-small",
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )


# %%
if __name__ == "__main__":
    form = read_options("loop_stability")
    results = run_jobs(cross_check, grid()[5::24] if form.quick else grid(), workers=form.workers)
    save(draw(results, 6 if form.quick else 33), form.out / "loop_stability.png", resolution=100)
    pd.DataFrame(map(row_of, results)).to_csv(form.out / "loop_stability.csv", index=False)
    pairs = [pair for result in results for pair in zip(result.radii, result.unstable, strict=True)]
    decided = [unstable for radius, unstable in pairs if abs(radius - 1.0) >= UNDECIDED]
    surprising = [
        result
        for result in results
        if result.ending is not Ending.REST and max(result.radii) <= 1.0 - UNDECIDED
    ]
    ratios = true_experiment(grid()[0]).plant.friction_ratio
    numbers = {
        "settings": len(results),
        "linear_runs": len(pairs),
        "decided": len(decided),
        "unstable": sum(decided),
        "misses": sum(result.misses() for result in results),
        "moving_though_stable": len(surprising),
        "friction_ratio": {str(joint): ratio for joint, ratio in ratios.items()},
        "rows": [shown(result) for result in results if result.case.stiffness == STIFFNESSES[2]],
    }
    form.write_results(numbers)
    print({name: value for name, value in numbers.items() if name != "rows"})
