"""Limits of validity: the effect of each assumption on the guided walk.

Fifteen assumed numbers are changed one at a time over their plausible range, and all together (Sobol
indices). Assumptions about the structure, such as a rigid connection of wearer and device, are replaced one
at a time. 2 220 walks of 12 s, ten minutes on two cores; page: docs/background/limits.md.
"""

# %%
from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from gallery import read_options
from matplotlib.figure import Figure
from scipy.stats import qmc, sobol_indices

from twin_gait import Experiment, load_experiment, simulate_batch
from twin_gait.leg_model.urdf import packaged_urdf
from twin_gait.palette import BLACK, BLUE, GREY, VERMILLION
from twin_gait.report.canvas import save, style_panel
from twin_gait.studies.workers import Workers

DURATION = 12.0  # [s]
SAMPLES, SEED = 128, 7  # base samples of the Sobol indices, a power of two
WALKED = "walked"


# %% [markdown]
# ## The assumptions
# A range is the uncertainty of a number that was not measured on this device. Ratios are drawn evenly on a
# logarithmic scale. A number of two keys has the same value in both.


# %%
@dataclass(frozen=True)
class Assumption:
    """Number that is assumed, with its plausible range."""

    label: str
    kind: str  # guided, passive, contact, drive, sensed, wearer
    low: float
    nominal: float
    high: float
    unit: str
    keys: tuple[str, ...]
    ratio: bool = False  # drawn evenly on a logarithmic scale

    def at(self, share: float) -> float:
        """Return the value at a share from 0 to 1 of the range."""
        if self.ratio:
            return self.low * math.pow(self.high / self.low, share)
        return self.low + share * (self.high - self.low)

    def text(self, value: float) -> str:
        """Format a value for the table."""
        return f"{value:g}" if value < 1e4 else f"{value / 1e5:g}e5"


CONTACT, SUPPORT = "scenario.contact.", "scenario.support."
GEARS = tuple(f"plant.actuators.{joint}.gear_efficiency" for joint in ("hip", "knee"))
RATIOS = tuple(f"plant.friction_ratio.{joint}" for joint in ("hip", "knee"))
PASSIVE = tuple(f"patient.both.{joint}.passive" for joint in ("hip", "knee"))
ASSUMPTIONS = (
    Assumption("contact stiffness", "contact", 1.5e5, 3e5, 6e5, "N/m^1.5",
               (f"{CONTACT}stiffness_N_per_m1p5",), ratio=True),
    Assumption("contact dissipation", "contact", 1.25, 2.5, 5.0, "s/m",
               (f"{CONTACT}dissipation_s_per_m",), ratio=True),
    Assumption("friction coefficient of the soles", "contact", 0.5, 0.8, 1.0, "",
               (f"{CONTACT}friction_coefficient",)),
    Assumption("transition velocity of the soles", "contact", 0.025, 0.05, 0.1, "m/s",
               (f"{CONTACT}transition_velocity_m_per_s",), ratio=True),
    Assumption("ankle orthosis, stiffness", "passive", 50.0, 75.0, 110.0, "N·m/rad",
               ("plant.ankle.stiffness_Nm_per_rad",), ratio=True),
    Assumption("ankle orthosis, damping", "passive", 3.0, 6.0, 12.0, "N·m·s/rad",
               ("plant.ankle.damping_Nms_per_rad",), ratio=True),
    Assumption("passive moments of hip and knee", "passive", 0.0, 0.0, 1.0, "of healthy", PASSIVE),
    Assumption("supported share of the weight", "guided", 0.55, 0.6, 0.65, "", (f"{SUPPORT}share",)),
    Assumption("harness, fore-aft stiffness", "guided", 750.0, 1500.0, 3000.0, "N/m",
               (f"{SUPPORT}forward_stiffness_N_per_m",), ratio=True),
    Assumption("harness, fore-aft damping", "guided", 150.0, 300.0, 600.0, "N·s/m",
               (f"{SUPPORT}forward_damping_Ns_per_m",), ratio=True),
    Assumption("gear efficiency", "drive", 0.75, 0.85, 0.95, "", GEARS),
    Assumption("true over modelled friction", "drive", 0.35, 0.5, 1.0, "", RATIOS, ratio=True),
    Assumption("lag of the fast velocity", "sensed", 0.0025, 0.005, 0.010, "s",
               ("sensors.fast_time_constant_s",), ratio=True),
    Assumption("mass that the device assumes", "wearer", 63.0, 70.0, 77.0, "kg",
               ("control.patient.mass_kg",)),
    Assumption("height that the device assumes", "wearer", 1.70, 1.75, 1.80, "m",
               ("control.patient.height_m",)),
)  # fmt: skip
# Wearer that the device assumes; the body of the simulation is that of the preset.
ASSUMED_WEARER = {"mass_kg": 70.0, "height_m": 1.75, "sex": "male"}


def changes_of(values: Mapping[Assumption, float]) -> dict[str, float]:
    """Return the changes of the guided walk for values of some assumptions."""
    changes = {key: value for item, value in values.items() for key in item.keys}
    if any(key.startswith("control.patient.") for key in changes):
        changes = {f"control.patient.{key}": value for key, value in ASSUMED_WEARER.items()} | changes
    return changes


# Other structures and conditions, by label: kind, settings of the experiment, changes of one walk.
STRUCTURES: dict[str, tuple[str, tuple[str, ...], dict[str, object]]] = {
    "pelvis guided vertically, no fore-aft motion": ("guided", (f"{SUPPORT}guide=vertical",), {}),
    "braces instead of a rigid connection": ("passive", ("interface=brace",), {}),
    "wearer with complete SCI: contractures, spasticity": ("wearer", (), {"patient": "complete_sci"}),
    "segments of Winter (2009)": ("wearer", (), {"patient.segment_model": "winter"}),
    "body of a woman": ("wearer", (), {"patient.sex": "female"}),
    "noise and steps of the encoders": (
        "sensed", (), {"sensors.ideal": False, "sensors.angle_noise_rad": 2e-5}),
    "torque limit 50 N·m": ("drive", (), {"control.limits.torque_Nm": 50.0}),
    "torque limit 100 N·m": ("drive", (), {"control.limits.torque_Nm": 100.0}),
    "empty battery, 24 V": ("drive", (), {"plant.battery.voltage_V": 24.0}),
    "belt 10 % slower": ("guided", (), {"scenario.belt_speed_m_per_s": 0.375}),
    "belt 10 % faster": ("guided", (), {"scenario.belt_speed_m_per_s": 0.4583}),
}  # fmt: skip
SOLES = {"sole 10 % shorter": 0.9, "sole 10 % longer": 1.1}  # distances of heel and toe from the ankle


@contextlib.contextmanager
def other_soles() -> Iterator[dict[str, tuple[str, ...]]]:
    """Write the device with soles of another length; yield the settings of each."""
    text = packaged_urdf("twin.urdf").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        found = {}
        for label, ratio in SOLES.items():
            changed = text
            for reach in (-0.05, 0.17):
                changed = changed.replace(f'xyz="{reach:g} 0 -0.08"', f'xyz="{ratio * reach:.4f} 0 -0.08"')
            path = Path(folder) / f"{label.replace(' ', '_').replace('%', '')}.urdf"
            path.write_text(changed, encoding="utf-8")
            found[label] = (f"leg.urdf={path}",)
        yield found


# %% [markdown]
# ## Results of a walk


# %%
@dataclass(frozen=True)
class Output:
    """Result of a walk; the worse leg counts."""

    title: str
    unit: str
    columns: tuple[str, ...]
    worse: str  # min or max over the columns
    sign: float = 1.0
    digits: int = 1


def _legs(name: str) -> tuple[str, ...]:
    return tuple(f"{side}_{name}" for side in ("left", "right"))


OUTPUTS = {
    "hip": Output("hip error", "°", _legs("rmse_hip_by_contact_deg"), "max"),
    "knee": Output("knee error", "°", _legs("rmse_knee_by_contact_deg"), "max"),
    "load": Output("load peak", "carried weight", _legs("load_peak"), "max", digits=2),
    "braking": Output("braking peak", "carried weight", _legs("braking_peak"), "min", -1.0, 2),
    "yield": Output("knee yield", "°", _legs("knee_yield_deg"), "min"),
    "battery": Output("battery", "W", ("battery_power_mean_W",), "max", digits=0),
}


def outputs_of(table: pd.DataFrame) -> pd.DataFrame:
    """Return the results of walks, a column each; NaN where a walk ended early. The index is kept."""
    found = {
        name: item.sign * getattr(table[list(item.columns)].astype(float), item.worse)(axis=1)
        for name, item in OUTPUTS.items()
    }
    return pd.DataFrame(found).where(table["outcome"] == WALKED)


def one_at_a_time(base: Experiment, workers: Workers | int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Simulate both ends of every range; return the results at the low and at the high ends."""
    ends = [changes_of({item: item.at(end)}) for end in (0.0, 1.0) for item in ASSUMPTIONS]
    found = outputs_of(simulate_batch(base, ends, workers=workers))
    labels = [item.label for item in ASSUMPTIONS]
    low, high = (part.set_axis(labels) for part in (found[: len(labels)], found[len(labels) :]))
    return low, high


def structure_results(duration: float, *, quick: bool) -> pd.DataFrame:
    """Simulate the other structures and return their results, a row each."""
    rows = {}
    with other_soles() as soles:
        cases = {label: (settings, changes) for label, (_, settings, changes) in STRUCTURES.items()}
        cases |= {label: (settings, {}) for label, settings in soles.items()}
        if quick:  # without those that need a compilation of their own
            cases = {label: case for label, case in cases.items() if not case[0]}
        for label, (settings, changes) in cases.items():
            base = load_experiment("treadmill_guided", [f"duration_s={duration}", *settings]).experiment
            rows[label] = outputs_of(simulate_batch(base, [changes])).iloc[0]
    return pd.DataFrame(rows).T


# %% [markdown]
# ## Sobol indices
# The first index of an assumption is the share of the variance of a result that it causes alone, the total
# index also counts its interactions with the others (Saltelli et al. 2010, doi:10.1016/j.cpc.2009.09.018).


# %%
def saltelli_points(dimension: int, samples: int) -> np.ndarray:
    """Draw the points of Saltelli's design in the unit cube: A, B, and A with each column of B.

    Returns shape ``(dimension + 2, samples, dimension)``.
    """
    drawn = qmc.Sobol(2 * dimension, rng=SEED).random(samples)
    first, second = drawn[:, :dimension], drawn[:, dimension:]
    mixed = np.repeat(first[None], dimension, axis=0)
    for column in range(dimension):
        mixed[column, :, column] = second[:, column]
    return np.concatenate([first[None], second[None], mixed])


def indices_of(values: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the indices of results at the points of :func:`saltelli_points`.

    ``values``: shape ``(dimension + 2, samples)``. Returns ``first`` and ``total`` index and the half width
    of their 95 % intervals (bootstrap), shape ``(dimension,)`` each.
    """
    parts = {"f_A": values[0][None], "f_B": values[1][None], "f_AB": values[2:, None]}
    found = sobol_indices(func=parts, n=values.shape[1])
    spread = found.bootstrap(n_resamples=200)
    intervals = {"first": spread.first_order, "total": spread.total_order}
    halves = {
        f"{name}_half": 0.5 * (item.confidence_interval.high - item.confidence_interval.low).ravel()
        for name, item in intervals.items()
    }
    return {"first": found.first_order.ravel(), "total": found.total_order.ravel(), **halves}


def sobol_walks(base: Experiment, samples: int, workers: Workers | int) -> pd.DataFrame:
    """Simulate the walks of Saltelli's design and return their results in its order."""
    points = saltelli_points(len(ASSUMPTIONS), samples)
    changes = [
        changes_of({item: item.at(float(share)) for item, share in zip(ASSUMPTIONS, point, strict=True)})
        for point in points.reshape(-1, len(ASSUMPTIONS))
    ]
    return outputs_of(simulate_batch(base, changes, workers=workers))


def indices_table(results: pd.DataFrame, samples: int) -> dict[str, dict[str, np.ndarray]]:
    """Compute the indices of every result; a walk that ended early has the median of the others."""
    filled = results.fillna(results.median())
    shape = (len(ASSUMPTIONS) + 2, samples)
    return {name: indices_of(filled[name].to_numpy().reshape(shape)) for name in OUTPUTS}


# %% [markdown]
# ## Figures


# %%
def spans(low: pd.DataFrame, high: pd.DataFrame, nominal: pd.Series) -> pd.DataFrame:
    """Return the largest change of each result over the range of each assumption."""
    ends = np.stack([low.to_numpy(), high.to_numpy(), np.broadcast_to(nominal.to_numpy(), low.shape)])
    return pd.DataFrame(np.nanmax(ends, axis=0) - np.nanmin(ends, axis=0), low.index, low.columns)


def draw_tornado(low: pd.DataFrame, high: pd.DataFrame, nominal: pd.Series) -> Figure:
    """Draw the change of every result over the range of every assumption, the largest at the top."""
    moved = spans(low, high, nominal)
    order = (moved / moved.max()).sum(axis=1).sort_values().index
    figure = Figure(figsize=(13.0, 6.2), layout="constrained")
    panels = figure.subplots(1, len(OUTPUTS), sharey=True)
    rows = np.arange(len(order))
    for panel, (name, item) in zip(panels, OUTPUTS.items(), strict=True):
        for ends, shift, colour, words in (
            (low, 0.18, BLUE, "low end of the range"),
            (high, -0.18, VERMILLION, "high end"),
        ):
            change = (ends.loc[order, name] - nominal[name]).to_numpy()
            panel.barh(rows + shift, change, left=nominal[name], color=colour, height=0.36, label=words)
            for row in rows[np.isnan(change)]:
                panel.plot(nominal[name], row + shift, "x", color=BLACK, markersize=5)
        panel.axvline(nominal[name], color=GREY, linewidth=0.8)
        style_panel(panel, item.title, "")
        panel.set_xlabel(f"[{item.unit}]")
        panel.margins(x=0.12)
        panel.locator_params(axis="x", nbins=4)
        panel.grid(axis="y", visible=False)
    panels[0].set_yticks(rows, order)
    panels[0].set_ylim(-0.6, len(order) - 0.4)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=2, frameon=False)
    return figure


def draw_indices(indices: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Draw the total indices of all results as a table of colours, and the first indices as numbers."""
    total = np.array([indices[name]["total"] for name in OUTPUTS]).T
    first = np.array([indices[name]["first"] for name in OUTPUTS]).T
    order = np.argsort(-total.sum(axis=1))
    figure = Figure(figsize=(8.6, 6.2), layout="constrained")
    panel = figure.subplots()
    drawn = panel.imshow(np.clip(total[order], 0.0, 1.0), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for row, index in enumerate(order):
        for column in range(len(OUTPUTS)):
            share, alone = total[index, column], first[index, column]
            if share > 0.03:
                text = f"{max(share, 0):.2f} ({max(alone, 0):.2f})"
                colour = "white" if share > 0.55 else "black"
                panel.text(column, row, text, ha="center", va="center", fontsize=9, color=colour)
    panel.set_yticks(range(len(order)), [ASSUMPTIONS[index].label for index in order])
    panel.set_xticks(range(len(OUTPUTS)), [item.title.replace(" ", "\n") for item in OUTPUTS.values()])
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    figure.colorbar(drawn, ax=panel, label="total index (first index in brackets)")
    return figure


# %% [markdown]
# ## Tables of the page


# %%
def assumption_rows(low: pd.DataFrame, high: pd.DataFrame, nominal: pd.Series) -> list[dict[str, str]]:
    """Return a row for each assumption with the results at both ends of its range."""
    moved = spans(low, high, nominal)
    order = (moved / moved.max()).sum(axis=1).sort_values(ascending=False).index
    known = {item.label: item for item in ASSUMPTIONS}
    rows = []
    for label in order:
        item = known[label]
        limits = f"{item.text(item.low)} to {item.text(item.high)} {item.unit}".strip()
        row = {"assumption": label, "kind": item.kind, "range": limits}
        for name, output in OUTPUTS.items():
            found = [end.loc[label, name] for end in (low, high)]
            row[f"{output.title} [{output.unit}]"] = " / ".join(_number(value, output) for value in found)
        rows.append(row)
    return rows


def structure_rows(results: pd.DataFrame, nominal: pd.Series) -> list[dict[str, str]]:
    """Return the guided walk and a row for each other structure."""
    kinds = {label: kind for label, (kind, *_) in STRUCTURES.items()} | dict.fromkeys(SOLES, "contact")
    rows = []
    for label, found in {"the guided walk": nominal, **dict(results.iterrows())}.items():
        row = {"change": label, "kind": kinds.get(label, "")}
        for name, output in OUTPUTS.items():
            row[f"{output.title} [{output.unit}]"] = _number(found[name], output)
        rows.append(row)
    return rows


def _number(value: float, output: Output) -> str:
    return "does not walk" if math.isnan(value) else f"{value:.{output.digits}f}"


def spread_rows(sample: pd.DataFrame, nominal: pd.Series, indices: Mapping) -> list[dict[str, str]]:
    """Return the 90 % range of every result if all assumptions vary, and the assumptions that cause it."""
    rows = []
    for name, output in OUTPUTS.items():
        low, middle, high = sample[name].quantile([0.05, 0.5, 0.95])
        total = indices[name]["total"]
        largest = np.argsort(-total)[:3]
        causes = ", ".join(f"{ASSUMPTIONS[index].label} {max(total[index], 0):.2f}" for index in largest)
        rows.append(
            {
                "result": f"{output.title} [{output.unit}]",
                "guided walk": _number(nominal[name], output),
                "median": _number(middle, output),
                "90 % range": f"{_number(low, output)} to {_number(high, output)}",
                "largest total indices": causes,
            }
        )
    return rows


def plain(indices: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return indices as plain numbers by result and assumption."""
    return {
        name: {
            item.label: {key: round(float(values[number]), 3) for key, values in found.items()}
            for number, item in enumerate(ASSUMPTIONS)
        }
        for name, found in indices.items()
    }


# %%
def main() -> None:
    """Run the study in the form of the command line."""
    form = read_options("limits_of_validity")
    samples = 2 if form.quick else SAMPLES
    base = load_experiment("treadmill_guided", [f"duration_s={DURATION}"]).experiment
    with Workers(form.workers) as workers:
        nominal = outputs_of(simulate_batch(base, [{}])).iloc[0]
        low, high = one_at_a_time(base, workers)
        results = sobol_walks(base, samples, workers)
    structures = structure_results(DURATION, quick=form.quick)
    indices = indices_table(results, samples)
    drawn = results[: 2 * samples]  # A and B, independent draws of all assumptions
    save(draw_tornado(low, high, nominal), form.out / "limits_of_validity.png", resolution=100)
    save(draw_indices(indices), form.out / "sobol_indices.png", resolution=100)
    ended = int(results["hip"].isna().sum())
    print(f"{len(results)} walks, {ended} ended early", drawn.describe().round(2), sep="\n")
    form.write_results(
        {
            "walks": len(results) + 2 * len(ASSUMPTIONS) + len(structures) + 1,
            "samples": samples,
            "sobol_walks": len(results),
            "ended": ended,
            "nominal": nominal.round(4).to_dict(),
            "with_passive_moments": high.loc["passive moments of hip and knee"].round(4).to_dict(),
            "assumptions": assumption_rows(low, high, nominal),
            "structures": structure_rows(structures, nominal),
            "spread": spread_rows(drawn, nominal, indices),
            "indices": plain(indices),
        }
    )


if __name__ == "__main__":
    main()
