"""Ground forces: forces of the guided walk on the belt, their change with the support and with the foot.

Vertical and fore-aft force over the stride, in units of the carried weight; the figure compares the default
walk with normative curves. Is the walk still a walk if less weight is carried, and if the feet are harder or
shorter? Seconds; the measures are defined in docs/reference/summary.md.
"""

# %%
from __future__ import annotations

import pandas as pd
from gallery import read_options

from twin_gait import Run, load_experiment, simulate, summarise_run
from twin_gait.report.canvas import save

form = read_options("ground_forces")
SUPPORTS = (0.4, 0.6) if form.quick else (0.3, 0.4, 0.5, 0.6, 0.7, 0.8)


def walk(*settings: str) -> Run:
    """Simulate the guided walk with some settings."""
    duration = f"duration_s={8 if form.quick else 20}"
    return simulate(load_experiment("treadmill_guided", [*settings, duration]).experiment)


# %% [markdown]
# ## Over the stride
# Force of each foot from heel strike to heel strike in the guided walk (60 % of the weight in the harness).

# %%
figure = walk().plot("ground_forces")
save(figure, form.out / "ground_forces.png")

# %% [markdown]
# ## With more and less support
# Loading peak, trough, push-off peak and the least load over 6–20 % of the cycle in units of the carried
# weight, impulses of braking and propulsion, and the power that the belt delivers.

# %%
MEASURES = {
    "loading peak": "loading_peak",
    "trough": "trough",
    "push-off peak": "push_off_peak",
    "least load": "min_load",
    "braking [N s]": "braking_impulse_Ns",
    "propulsion [N s]": "propulsion_impulse_Ns",
    "belt [W]": "belt_power_W",
}
rows = []
for support in SUPPORTS:
    summary = summarise_run(walk(f"scenario.support.share={support}"))
    row = {"support": f"{support:.0%}", "outcome": summary["outcome"]}
    if "walk" in (left := summary["sides"]["left"]):
        found = {name: left["walk"][key] for name, key in MEASURES.items()}
        row |= {name: "–" if value is None else f"{value:.2f}" for name, value in found.items()}
    rows.append(row)
print(pd.DataFrame(rows).fillna("").to_string(index=False))

# %% [markdown]
# ## Against measurements with support
# Vertical force of 18 healthy adults who walked on level ground in a harness, more slowly than usual (Barela
# et al. 2014, Braz J Phys Ther 18:572, table of peaks; the speed was not found), in units of the carried
# weight: means of right and left leg in percent of the body weight, over the share that the harness leaves.

# %%
SHAPE = ("loading peak", "trough", "push-off peak")
BARELA = {0.0: (104.0, 75.5, 94.0), 0.15: (86.5, 67.0, 76.0), 0.30: (74.0, 60.0, 66.5)}
measured = [
    {"walk": f"adults, {share:.0%} support (Barela et al. 2014)"}
    | {name: f"{value / (100.0 * (1.0 - share)):.2f}" for name, value in zip(SHAPE, values, strict=True)}
    for share, values in BARELA.items()
]
default = next(row for row in rows if row["support"] == "60%")
measured.append({"walk": "guided walk, 60% support", **{name: default[name] for name in SHAPE}})
healthy = summarise_run(walk())["walk_reference"]
measured.append(
    {"walk": "Winter (1991), slow cadence", **{name: f"{healthy[MEASURES[name]]:.2f}" for name in SHAPE}}
)
print(pd.DataFrame(measured).to_string(index=False))

# %% [markdown]
# ## With other feet
# One number of the contact, or the distance of its two points, differs from the guided walk. The compression
# is the largest depth of a point of a foot after 5 s, the error is that of the left knee.

# %%
KEY = "scenario.contact."
FEET: dict[str, tuple[str, ...]] = {
    "default (soft)": (),
    "calibrated": ("scenario.contact=calibrated",),
    **{
        f"stiffness {value:.0e}": (f"{KEY}stiffness_N_per_m1p5={value}",)
        for value in (1e5, 2e5, 5e5, 1e6, 2e6)
    },
    **{f"dissipation {value}": (f"{KEY}dissipation_s_per_m={value}",) for value in (0.5, 1.5, 4.0)},
    **{
        f"forefoot {ratio} times as stiff as the heel": (f"{KEY}forefoot_stiffness_N_per_m1p5={ratio * 3e5}",)
        for ratio in (0.5, 2, 4)
    },
    **{f"heel to forefoot {share:.0%}": (f"leg.heel_to_forefoot={share}",) for share in (0.70, 0.74, 0.77)},
    "calibrated, heel to forefoot 77%": ("scenario.contact=calibrated", "leg.heel_to_forefoot=0.77"),
    "default (soft), in braces": ("interface=brace",),
    "calibrated, in braces": ("interface=brace", "scenario.contact=calibrated"),
}
feet = []
for name, settings in list(FEET.items())[: 2 if form.quick else None]:
    run = walk(*settings)
    summary, steady = summarise_run(run), run.log[run.log["time_s"] > 5.0]
    row = {"foot": name, "outcome": summary["outcome"]}
    left = summary["sides"]["left"]
    if "walk" in left:
        row["load peak"] = f"{left['walk']['load_peak']:.2f}"
        row["braking peak"] = f"{left['walk']['braking_peak']:.2f}"
        row["compression [mm]"] = f"{-1e3 * steady.filter(like='_foot_clearance_m').min().min():.1f}"
        row["slip [mm]"] = f"{1e3 * left['walk']['slip_m']:.0f}"
        row["toe clearance [mm]"] = f"{1e3 * left['toe_clearance_mean_m']:.0f}"
        row["knee error [deg]"] = f"{left['rmse_knee_by_contact_deg']:.1f}"
    feet.append(row)
form.write_results({"rows": rows, "measured": measured, "feet": feet})
print(pd.DataFrame(feet).fillna("").to_string(index=False))
