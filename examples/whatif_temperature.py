"""What if the friction changes with temperature, age or load?

The model of the compensator is the true friction law of a new, unloaded knee at one temperature, identified
exactly. The knee is then moved by hand, and pushed, under other conditions. All cases are simulated on the
joint bench. One minute on one core; page: docs/background/whatif.md.
"""

# %%
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pandas as pd
from gallery import read_options
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from whatif.endings import Ending
from whatif.figures import (
    SERIES,
    draw_endings,
    draw_series,
    ending_handles,
    label_axes,
    simulated_and_predicted,
)
from whatif.temperature import (
    COULOMB_LOSS_PER_KELVIN,
    COULOMB_PER_LOAD,
    REFERENCE_TEMPERATURE,
    Case,
    Condition,
    best_row,
    case_row,
    viscous_loss_per_kelvin,
)

from twin_gait.palette import BLACK, GREY
from twin_gait.report.canvas import put_legend, save, style_panel
from twin_gait.studies.jobs import run_jobs

# %% [markdown]
# ## Conditions
# Temperatures with compensators of three temperatures; ages and loads with the compensator of 25 °C.

# %%
TEMPERATURES = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)  # [°C]
IDENTIFIED_AT = (10.0, 25.0, 40.0)  # [°C]
GAINS = tuple(round(0.1 * step, 1) for step in range(14))
AGES = (0.8, 1.3)  # friction over that of a new joint: run in, and without grease; assumptions
LOADS = (1.0, 2.0, 3.0)  # [kg]


def cases(*, quick: bool = False) -> Iterator[Case]:
    """Yield the cases without their gains, in order; a few of them in the quick form."""
    for identified in IDENTIFIED_AT[1:2] if quick else IDENTIFIED_AT:
        for temperature in TEMPERATURES[1::3] if quick else TEMPERATURES:
            yield Case(Condition("temperature", temperature=temperature), identified)
    for ageing in AGES:
        yield Case(Condition("age", ageing=ageing))
    for load in LOADS[2:] if quick else LOADS:
        yield Case(Condition("load", load=load))


# %% [markdown]
# ## Numbers of the page


# %%
def largest_safe_gain(table: pd.DataFrame) -> float:
    """Return the largest gain of a table up to which the joint comes to rest in all of its cases."""
    gains, moving = table["gain"], table[table["ending"] != Ending.REST]["gain"]
    return float(gains[gains < moving.min()].max() if len(moving) else gains.max())


def numbers_of(table: pd.DataFrame, best: pd.DataFrame) -> dict[str, Any]:
    """Return the results of the model of 25 °C in cold and heat, the worst case, age, and largest load."""
    by_temperature = best[best["kind"] == "temperature"]
    reference = by_temperature[by_temperature["identified_at_degC"] == REFERENCE_TEMPERATURE]
    ends = reference.sort_values("temperature_degC").iloc[[0, -1]]
    tried = table[(table["kind"] == "temperature") & (table["identified_at_degC"] == REFERENCE_TEMPERATURE)]
    safe = largest_safe_gain(tried)
    left = tried[tried["gain"] == safe].set_index("temperature_degC")["hand_friction_Nm"]
    cold, warm = (
        {**row, "hand_friction_at_safe_gain_Nm": left[row["temperature_degC"]]}
        for row in ends.to_dict("records")
    )
    ages = best[best["kind"] == "age"].sort_values("ageing").to_dict("records")
    return {
        "viscous_loss_percent_per_kelvin": 100.0 * viscous_loss_per_kelvin(),
        "coulomb_loss_percent_per_kelvin": 100.0 * COULOMB_LOSS_PER_KELVIN,
        "coulomb_per_load": COULOMB_PER_LOAD,
        "cold": cold,
        "warm": warm,
        "worst": by_temperature.sort_values("largest_resting_gain").iloc[0].to_dict(),
        "safe_gain": safe,
        "run_in": ages[0],
        "worn": ages[-1],
        "heaviest": best[best["kind"] == "load"].sort_values("load_kg").iloc[-1].to_dict(),
    }


# %% [markdown]
# ## Picture


# %%
def draw(table: pd.DataFrame, best: pd.DataFrame) -> Figure:
    """Draw endings over G and temperature for each compensator; gains and remaining friction below."""
    warm, warm_best = table[table["kind"] == "temperature"], best[best["kind"] == "temperature"]
    models = sorted(warm["identified_at_degC"].unique())
    figure = Figure(figsize=(15.0, 9.6), layout="constrained")
    figure.suptitle(
        "A friction compensator under conditions that it was not identified at: knee, true law of table 3.1",
        fontsize="large",
    )
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    for axes, model in zip(above.subplots(1, len(models), squeeze=False)[0], models, strict=True):
        draw_endings(axes, warm[warm["identified_at_degC"] == model], "gain", "temperature_degC")
        axes.set_title(f"model identified at {model:g} °C: joint pushed, on a spring", fontsize="medium")
        axes.set(xlabel="G", ylabel="true temperature [°C]")
    panels = below.subplots(1, 4)
    names = {model: f"identified at {model:g} °C" for model in models}
    for axes, simulated, closed, title in (
        (panels[0], "largest_resting_gain", "least_torque_ratio", "largest resting G"),
        (panels[1], "best_gain", "closed_best_gain", "G of least friction"),
    ):
        draw_series(axes, warm_best, "identified_at_degC", "temperature_degC", simulated, closed, names)
        axes.axhline(1.0, color=BLACK, linewidth=0.8)
        style_panel(axes, title, "G")
        label_axes(axes, "true temperature [°C]")
    draw_left(panels[2], warm[warm["identified_at_degC"] == REFERENCE_TEMPERATURE])
    draw_others(panels[3], best[best["kind"] != "temperature"])
    put_legend(figure, ending_handles(table), simulated_and_predicted("simulated", "closed form"))
    return figure


def draw_left(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the remaining friction over the temperature, for some gains."""
    gains = [gain for gain in (0.0, 0.4, 0.8, 1.0, 1.2) if gain in set(rows["gain"])]
    for gain, colour in zip(gains, SERIES, strict=False):
        chosen = rows[rows["gain"] == gain].sort_values("temperature_degC")
        positions, values = chosen["temperature_degC"], chosen["hand_friction_Nm"]
        axes.plot(positions, values, "o-", color=colour, markersize=4, label=f"G = {gain:g}")
    style_panel(axes, f"friction left, identified at {REFERENCE_TEMPERATURE:g} °C", "RMS [N·m]")
    axes.set_ylim(0.0, 1.25 * float(rows["hand_friction_Nm"].max()))  # space for the legend above the lines
    label_axes(axes, "true temperature [°C]", ncols=2, loc="upper right")


def draw_others(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw age and load: both gains, simulated and in closed form."""
    labels = [
        f"friction × {row.ageing:g}" if row.kind == "age" else f"load {row.load_kg:g} kg"
        for row in rows.itertuples()
    ]
    positions = range(len(rows))
    for simulated, closed, name, colour in (
        ("largest_resting_gain", "least_torque_ratio", "largest at rest", SERIES[0]),
        ("best_gain", "closed_best_gain", "least friction", SERIES[1]),
    ):
        axes.plot(rows[closed], positions, "|", color=colour, markersize=14, markeredgewidth=2)
        axes.plot(rows[simulated], positions, "o", color=colour, markersize=5, label=name)
    axes.axvline(1.0, color=GREY, linewidth=0.8)
    axes.set_yticks(list(positions), labels)
    style_panel(axes, "age and load (bars: closed form)", "")
    label_axes(axes, "G")


# %%
if __name__ == "__main__":
    form = read_options("whatif_temperature")
    base_cases = list(cases(quick=form.quick))
    tried = [case._replace(gain=gain) for case in base_cases for gain in GAINS[:: 4 if form.quick else 1]]
    table = pd.DataFrame(run_jobs(case_row, tried, workers=form.workers))
    best = pd.DataFrame(run_jobs(best_row, base_cases, workers=form.workers))
    table.to_csv(form.out / "cases.csv", index=False)
    best.to_csv(form.out / "best.csv", index=False)
    save(draw(table, best), form.out / "temperature.png", resolution=80)
    form.write_results(numbers_of(table, best))
    print(best.to_string(index=False))
