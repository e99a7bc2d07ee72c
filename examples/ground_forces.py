"""Ground forces: forces of the default walk on the belt, and their change with the support.

Vertical and fore-aft force over the stride, in units of the carried weight; the figure compares the default
walk with normative curves. Is the walk still a walk if less weight is carried? Seconds; the measures are
defined in docs/reference/summary.md.
"""

# %%
from __future__ import annotations

import pandas as pd
from gallery import form_of

from twin_gait import Run, load_experiment, simulate, summarise
from twin_gait.report import save

form = form_of("ground_forces")
SUPPORTS = (0.4, 0.6) if form.quick else (0.3, 0.4, 0.5, 0.6, 0.7, 0.8)


def walk(support: float) -> Run:
    """Simulate the default walk with another share of the weight carried by the harness."""
    settings = [f"scenario.support.share={support}", f"duration_s={8 if form.quick else 20}"]
    return simulate(load_experiment("treadmill", settings).experiment)


# %% [markdown]
# ## Over the stride
# Force of each foot from heel strike to heel strike in the default walk (60 % of the weight in the harness).

# %%
figure = walk(0.6).plot("ground_forces")
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
    "least load": "least_load",
    "braking [N s]": "braking_impulse_Ns",
    "propulsion [N s]": "propulsion_impulse_Ns",
    "belt [W]": "belt_power_W",
}
rows = []
for support in SUPPORTS:
    summary = summarise(walk(support))
    row = {"support": f"{support:.0%}", "outcome": summary["outcome"]}
    if "walk" in (left := summary["sides"]["left"]):
        found = {name: left["walk"][key] for name, key in MEASURES.items()}
        row |= {name: "–" if value is None else f"{value:.2f}" for name, value in found.items()}
    rows.append(row)
form.keep({"rows": rows})
print(pd.DataFrame(rows).fillna("").to_string(index=False))
