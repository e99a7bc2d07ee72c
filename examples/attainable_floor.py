"""The attainable floor: how close can these motors bring this body to the reference at all?

Optimal control of half a symmetric stride with the engine's own equations of motion (direct collocation,
casadi and ipopt), with and without the further goals of a walk in addition to its angles. Every solution is
replayed in the engine and compared with the walks of the shipped gait tables. Ten minutes on one core; needs
the extra `floor`; page: docs/background/attainable_floor.md.
"""

# %%
from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from floor.walk import NOTHING, Goals, Search, Walk, require_casadi
from gallery import read_options
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait import Run, TwinGaitError, load_experiment, simulate, summarise_run
from twin_gait.gait.table import TICK
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.reference import reference_curve
from twin_gait.measures.strides import normalise_strides
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, VERMILLION
from twin_gait.report.canvas import put_legend, save, style_panel

# %% [markdown]
# ## Goals
# The goals of the guided walk, one by one, together, and more ambitious ones; forces in carried weights.

# %%
GUIDES = ("vertical", "harness")
TABLES = ("treadmill_guided", "treadmill_pre_swing")
GOALS = Goals(1.2, 0.7, 0.4, 5.0, 9.0, 3.0, 10.0)
AMBITIOUS = Goals(1.1, 0.8, 0.4, 0.0, 4.0, 7.0, 15.0)
Rows = list[tuple[dict[str, Any], Run]]  # measures of walks, with their runs
WORDS = {
    "peak": "peak ≤ 1.2",
    "trough": "trough ≥ 0.7",
    "loading": "load over 6–20 % ≥ 0.4",
    "forward_N": "fore-aft force ≤ 5 N",
    "contact_deg": "knee at contact ≤ 9°",
    "yield_deg": "knee yields ≥ 3°",
    "clearance_mm": "clearance ≥ 10 mm",
}
WEIGHTS = (0.03, 0.01, 0.003, 0.1)  # weights of the effort, in the order of the search
LEAST = 0.003  # weight of the effort at which walks are compared
INTERVALS, FEW_INTERVALS = 50, 30
# Possible changes, with all goals: name, settings, stride time in [s] (None: that of the reference).
CHANGES: tuple[tuple[str, tuple[str, ...], float | None], ...] = (
    ("motors of 90 N·m", ("control.limits.torque_Nm=90",), None),
    ("no friction", ("plant.friction_ratio.hip=0", "plant.friction_ratio.knee=0"), None),
    ("gears without losses", tuple(f"plant.actuators.{j}.gear_efficiency=1" for j in ("hip", "knee")), None),
    ("orthosis slack at a right angle", ("plant.ankle.rest_deg=0",), None),
    (
        "orthosis of 200 N·m/rad, slack at a right angle",
        ("plant.ankle.stiffness_Nm_per_rad=200", "plant.ankle.rest_deg=0"),
        None,
    ),
    ("stride of 1.92 s", (), 1.92),
)


def settings_of(guide: str, *more: str) -> list[str]:
    return [f"scenario.support.guide={guide}", *more]


# %% [markdown]
# ## Numbers of a walk
# Measures of the program over the last strides of both legs; a solution is measured in its replay.


# %%
def numbers_of(run: Run) -> dict[str, Any]:
    """Return errors, effort and forces of a run; only its outcome if it has no strides."""
    summary, record = summarise_run(run), run.experiment.scenario
    sides = list(summary["sides"].values())
    if any(side.get("rmse_hip_by_contact_deg") is None for side in sides):
        return {"outcome": summary["outcome"]}
    found = {
        f"{joint}_deg": mean(side[f"rmse_{joint}_by_contact_deg"] for side in sides)
        for joint in ("hip", "knee")
    }
    torques = [item["torque_rms_Nm"] for side in sides for item in side["joints"].values()]
    curves = {name: cycles_of(run, name).mean(axis=0) for name in ("foot_normal_force_N", "knee_angle_rad")}
    carried = run.body_weight * (1.0 - record.support.share)
    force, knee = curves["foot_normal_force_N"] / carried, np.degrees(curves["knee_angle_rad"])
    return {
        "outcome": summary["outcome"],
        **found,
        "error_deg": float(np.sqrt(0.5 * (found["hip_deg"] ** 2 + found["knee_deg"] ** 2))),
        "torque_Nm": float(np.sqrt(np.mean(np.square(torques)))),
        "battery_W": summary["battery_power_mean_W"],
        "stride_s": mean(side["stride_time_mean_s"] for side in sides),
        "peak": float(cycles_of(run, "foot_normal_force_N").max(axis=1).mean() / carried),
        "trough": float(force[18:46].min()),
        "loading": float(force[6:21].min()),
        "forward_N": 2.0 * float(cycles_of(run, "foot_friction_force_N")[:, :-1].mean()),
        "contact_deg": float(knee[0]),
        "yield_deg": float(knee[:31].max() - knee[0]),
        "clearance_mm": 1e3 * mean(side["toe_clearance_mean_m"] for side in sides),
    }


def mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def cycles_of(run: Run, column: str) -> np.ndarray:
    """Return the counted strides of both legs for a column over the cycle, shape ``(n, 101)``."""
    found = []
    for side in run.sides:
        strides = leg_record(run.log, side, run.table.phase_names, TICK).strides()[2:]
        found.append(normalise_strides(run.log[f"{side}_{column}"].to_numpy(), strides))
    return np.concatenate(found)


# %% [markdown]
# ## Searches
# The first guess is a simulated walk of the default table; each solution is the guess for the next weight.


# %%
def search_of(settings: Sequence[str], intervals: int, stride: float | None = None) -> Search:
    all_settings = [*settings, "engine=pinocchio", "control.safety.enabled=false"]
    return Search(load_experiment("treadmill_guided", all_settings).experiment, intervals, stride)


def row_of(walk: Walk, name: str) -> tuple[dict[str, Any], Run]:
    """Return the measures of a solution from its replay, and the walk of its replay."""
    if not walk.succeeded:
        return {"walk": name, "outcome": "no optimum found"}, None
    run = walk.replayed()
    row = {"walk": name, "weight": walk.weight, "optimality": walk.optimality, "drift_deg": walk.drift(run)}
    walked = walk.walked(run)
    return {**row, **numbers_of(walked)}, walked


def swept(
    search: Search, goals: Goals, guesses: Sequence[np.ndarray], name: str, weights: Sequence[float]
) -> tuple[Rows, Walk]:
    """Return rows and runs of all weights by rising effort, and the walk of the least weight.

    Args:
        guesses: Guesses for the first weight, tried in turn until one leads to an optimum.
    """
    walks: dict[float, Walk] = {}
    for weight in weights:
        if walks:
            guesses = [walks[min(walks, key=lambda solved: abs(math.log(solved / weight)))].unknowns]
        tried = (search.solve(guess, weight, goals) for guess in guesses)
        found = next((walk for walk in tried if walk.succeeded), None)
        if found is None:
            raise TwinGaitError(f"attainable_floor: {name}, weight {weight:g}: ipopt found no optimum")
        walks[weight] = found
    return [row_of(walks[weight], name) for weight in sorted(walks, reverse=True)], walks[min(walks)]


# %% [markdown]
# ## Picture


# %%
def draw(sweeps: dict[str, Rows], tables: list[tuple[str, dict[str, Any], Run]]) -> Figure:
    """Draw error over effort, angles of hip and knee, and vertical force."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    panels = figure.subplots(2, 2)
    colours = dict(zip(reversed(sweeps), (BLUISH_GREEN, BLUE, GREY), strict=False))
    for name, found in sweeps.items():
        rows = pd.DataFrame([row for row, _ in found])
        panels[0, 0].plot(rows["torque_Nm"], rows["error_deg"], ".-", color=colours[name], label=name)
    marks = dict(zip(TABLES, ((VERMILLION, "o"), (ORANGE, "s")), strict=True))
    for name, row, run in tables:
        colour, mark = marks[name.split(",")[0]]
        filled = colour if guided(run) == GUIDES[1] else "none"
        label = f"table {name}"
        panels[0, 0].plot(row["torque_Nm"], row["error_deg"], mark, color=colour, mfc=filled, label=label)
    style_panel(panels[0, 0], "error over effort", "RMSE of hip and knee [deg]")
    panels[0, 0].set(xlabel="RMS torque of the four motors [N·m]", ylim=(0.0, None))
    harness = [item for item in tables if guided(item[2]) == GUIDES[1]] or tables
    lines = [(name, found[-1][1], colours[name]) for name, found in sweeps.items()][-2:]
    lines.append((f"table {harness[0][0]}", harness[0][2], VERMILLION))
    for axes, joint in ((panels[0, 1], "hip"), (panels[1, 0], "knee")):
        percent, run = np.arange(101.0), lines[0][1]
        speed, height = run.experiment.scenario.belt_speed, run.experiment.patient.height
        curve = np.degrees(reference_curve(joint, percent, speed=speed, height=height))
        axes.plot(percent, curve, "--", color=BLACK, label="reference" if joint == "hip" else None)
        draw_lines(axes, lines, f"{joint}_angle_rad", lambda run: math.degrees(1.0))
        style_panel(axes, joint, "angle [deg]")
    draw_lines(panels[1, 1], lines, "foot_normal_force_N", carried_part)
    panels[1, 1].axhline(GOALS.peak, color=REDDISH_PURPLE, linewidth=0.8, label="goal for the peak")
    style_panel(panels[1, 1], "vertical force of a foot", "of the carried weight")
    for axes in panels.flat[1:]:
        axes.set(xlabel="gait cycle [%]", xlim=(0.0, 100.0))
    handles = [
        item
        for axes in (panels[0, 0], panels[0, 1], panels[1, 1])
        for item in axes.get_legend_handles_labels()[0]
    ]
    put_legend(figure, handles)
    return figure


def guided(run: Run) -> str:
    return str(run.experiment.scenario.support.guide)


def carried_part(run: Run) -> float:
    return 1.0 / (run.body_weight * (1.0 - run.experiment.scenario.support.share))


def draw_lines(axes: Axes, lines: list[Any], column: str, scale: Any) -> None:
    for _, run, colour in lines:
        axes.plot(np.arange(101.0), scale(run) * cycles_of(run, column).mean(axis=0), color=colour)


# %% [markdown]
# ## Numbers of the page


# %%
def line_of(row: dict[str, Any]) -> dict[str, str]:
    """Format a row for the page."""
    if "hip_deg" not in row:
        return {"walk": row["walk"], "RMSE hip / knee [°]": row["outcome"]}
    return {
        "walk": row["walk"],
        "RMSE hip / knee [°]": f"{row['hip_deg']:.1f} / {row['knee_deg']:.1f}",
        "RMS torque [N·m]": f"{row['torque_Nm']:.0f}",
        "battery [W]": f"{row['battery_W']:.0f}",
        "peak / trough / 6–20 %": f"{row['peak']:.2f} / {row['trough']:.2f} / {row['loading']:.2f}",
        "fore-aft [N]": f"{row['forward_N']:+.0f}",
        "knee at contact, yield [°]": f"{row['contact_deg']:.1f}, {row['yield_deg']:.1f}",
        "clearance [mm]": f"{row['clearance_mm']:.0f}",
    }


def gap_of(name: str, row: dict[str, Any], guide: str, sweeps: dict[str, Rows]) -> dict[str, str]:
    """Return the error of a table above the least error of solutions, and above that at the same effort."""
    line = {
        "table": name,
        "error [°]": f"{row['error_deg']:.1f}",
        "RMS torque [N·m]": f"{row['torque_Nm']:.0f}",
    }
    for words in ("nothing else", "all goals"):
        found = pd.DataFrame([item for item, _ in sweeps.get(f"{guide}, {words}", [])])
        for kind in ("the least", "that of its effort"):
            text = ""
            if len(found):
                floor = np.interp(row["torque_Nm"], found["torque_Nm"], found["error_deg"], left=np.nan)
                gap = row["error_deg"] - (found["error_deg"].min() if kind == "the least" else floor)
                text = "not with so little" if np.isnan(gap) else f"{gap:.1f}"
            line[f"above {kind}, {words} [°]"] = text
    return line


# %%
def simulated_tables(quick: bool) -> list[tuple[str, dict[str, Any], Run]]:
    found = []
    for guide in GUIDES[1:] if quick else GUIDES:
        for name in TABLES:
            run = simulate(
                load_experiment("treadmill_guided", settings_of(guide, f"table={name}")).experiment
            )
            found.append((f"{name}, {guide}", numbers_of(run), run))
    return found


# %%
if __name__ == "__main__":
    form = read_options("attainable_floor")
    require_casadi()
    intervals, weights = (FEW_INTERVALS, WEIGHTS[:1]) if form.quick else (INTERVALS, WEIGHTS)
    tables = simulated_tables(form.quick)
    sweeps: dict[str, Rows] = {}
    prices: list[dict[str, Any]] = []
    for guide in GUIDES[1:] if form.quick else GUIDES:
        search = search_of(settings_of(guide), intervals)
        starts = [
            search.start_from(run) for _, row, run in tables if guided(run) == guide and "hip_deg" in row
        ]
        name = f"{guide}, nothing else"
        sweeps[name], free = swept(search, NOTHING, starts, name, weights)
    name = f"{guide}, all goals"
    sweeps[name], best = swept(search, GOALS, [free.unknowns, *starts], name, weights)
    if not form.quick:
        alone = {words: NOTHING._replace(**{key: getattr(GOALS, key)}) for key, words in WORDS.items()}
        variants = {
            **alone,
            "all but the clearance": GOALS._replace(clearance_mm=-np.inf),
            "dreams": AMBITIOUS,
        }
        prices += [
            row_of(search.solve(free.unknowns, LEAST, item), words)[0] for words, item in variants.items()
        ]
        for words, settings, stride in CHANGES:
            changed = search_of(settings_of(guide, *settings), intervals, stride)
            walk = changed.solve(best.unknowns, LEAST, GOALS)
            prices.append(row_of(walk, f"all goals, {words}")[0])
    rows = [row for found in sweeps.values() for row, _ in found]
    floors = [found[-1][0] for found in sweeps.values()]
    save(draw(sweeps, tables), form.out / "attainable_floor.png", resolution=90)
    form.write_results(
        {
            "stride_s": 2.0 * search.half,
            "optimality": max(row["optimality"] for row in [*rows, *prices] if "optimality" in row),
            "drift_deg": max(row["drift_deg"] for row in [*rows, *prices] if "drift_deg" in row),
            "walks": len(rows) + len(prices),
            "floor": {"vertical": floors[0], "harness": floors[-2], "goals": floors[-1]},
            "sweeps": [line_of(row) | {"weight": f"{row['weight']:g}"} for row in rows],
            "prices": [line_of(row) for row in prices],
            "tables": [line_of({**row, "walk": name}) for name, row, _ in tables],
            "gaps": [
                gap_of(name, row, name.split(", ")[1], sweeps)
                for name, row, _ in tables
                if "error_deg" in row
            ],
        }
    )
    print(pd.DataFrame([line_of(row) for row in [*rows, *prices]]).to_string())
