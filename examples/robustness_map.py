"""Robustness map of the shipped gait table: the wearers, belt speeds and supports with which it walks.

The sweep of examples/sweep.yaml: 320 walks over mass, height, belt speed and supported share of the weight. A
Latin hypercube of 400 walks extends to heavier wearers and less support, with friction and battery voltage
varied as well, to find the limits. Two minutes on two cores; page: docs/background/robustness_map.md.
"""

# %% [markdown]
# For another table, `twin-gait sweep` makes the same map with `table:` under `settings` in its file.

# %%
import itertools
import shutil
import tempfile
from pathlib import Path

import pandas as pd
import yaml
from gallery import form_of

from twin_gait.studies import Workers, load_sweep, run_sweep

SPEC = Path(__file__).parent / "sweep.yaml" if "__file__" in globals() else Path("sweep.yaml")
SHORT = {
    "patient.mass_kg": "mass_kg",
    "patient.height_m": "height_m",
    "scenario.belt_speed_m_per_s": "speed_m_per_s",
    "scenario.support.share": "support_share",
}
# Wider sample: up to the heaviest wearer of the device, and down to a fifth of the weight supported.
BEYOND = {
    "patient.mass_kg": {"from": 50, "to": 110},
    "patient.height_m": {"from": 1.60, "to": 1.90},
    "scenario.belt_speed_m_per_s": {"from": 0.30, "to": 0.42},
    "scenario.support.share": {"from": 0.2, "to": 0.7},
    "plant.friction_ratio.hip": {"from": 0.35, "to": 1.0},
    "plant.friction_ratio.knee": {"from": 0.35, "to": 1.0},
    "plant.battery.voltage_V": {"from": 24.0, "to": 28.8},
}
BEYOND_SAMPLES = 400
DEVICE_MASS = 20.0  # [kg]
CARRIED_BOUNDS = (0.0, 60.0, 70.0, 80.0, 110.0)  # [kg]


# %%
def spec_in(folder: str, *, quick: bool) -> Path:
    """Write the specification of the sweep; the quick form has the ends of each range and 5 s."""
    document = yaml.safe_load(SPEC.read_text(encoding="utf-8"))
    if quick:
        document["settings"]["duration_s"] = 5
        document["parameters"] |= {"patient.mass_kg": [55, 95], "scenario.belt_speed_m_per_s": [0.30, 0.42]}
        document["parameters"] |= {"patient.height_m": [1.75], "scenario.support.share": [0.4, 0.7]}
    path = Path(folder) / "spec.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def spec_beyond(folder: str, *, quick: bool) -> Path:
    """Write the specification of the wider sample; the quick form has a few walks of 5 s."""
    document = yaml.safe_load(SPEC.read_text(encoding="utf-8"))
    document |= {"method": "latin_hypercube", "parameters": BEYOND, "samples": 8 if quick else BEYOND_SAMPLES}
    if quick:
        document["settings"]["duration_s"] = 5
    path = Path(folder) / "beyond.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def carried_rows(walks: pd.DataFrame) -> list[dict]:
    """Return the share that walked by the mass that the legs carry: (wearer + device) · (1 - support)."""
    carried = (walks["mass_kg"] + DEVICE_MASS) * (1.0 - walks["support_share"])
    rows = []
    for low, high in itertools.pairwise(CARRIED_BOUNDS):
        block = walks[(low <= carried) & (carried < high)]
        if len(block):
            rows.append({"carried mass": f"{low:g} to {high:g} kg", **outcomes_of(block)})
    return rows


def outcomes_of(block: pd.DataFrame) -> dict[str, str]:
    """Count the successful walks of a block, and the outcomes of the others."""
    others = block["outcome"][block["outcome"] != "walked"].value_counts()
    return {
        "walked": f"{len(block) - others.sum()} of {len(block)}",
        "others": ", ".join(f"{count} {word}" for word, count in others.items()) or "none",
    }


def rows_of(table: pd.DataFrame) -> pd.DataFrame:
    """Return the columns of the map for each walk: coordinates, outcome, and measures of the feet."""
    sides = ("left", "right")
    return (
        table[[*SHORT, "outcome", "duration_s"]]
        .rename(columns=SHORT)
        .round({"speed_m_per_s": 6})
        .assign(
            strides=table[[f"{side}_strides" for side in sides]].min(axis=1),
            further_contacts=table[[f"{side}_further_contacts" for side in sides]].sum(axis=1),
            time_outs=table[[f"{side}_time_outs" for side in sides]].sum(axis=1),
        )
    )


def support_rows(walks: pd.DataFrame) -> list[dict]:
    """Return the share that walked at each support, and the outcomes of the others."""
    return [
        {"support": f"{support:.0%}", **outcomes_of(block)}
        for support, block in walks.groupby("support_share")
    ]


# %%
if __name__ == "__main__":
    form = form_of("robustness_map")
    with tempfile.TemporaryDirectory() as folder, Workers(form.workers) as workers:
        sweep = load_sweep(spec_in(folder, quick=form.quick))
        out = Path(folder) / "map"
        result = run_sweep(sweep, out, workers=workers)
        for name in ("heat_map_walked.png", "main_effects_walked.png"):
            shutil.copy(out / "figures" / name, form.out)
        wider = load_sweep(spec_beyond(folder, quick=form.quick))
        beyond = rows_of(run_sweep(wider, Path(folder) / "beyond", workers=workers).table)
    walks = rows_of(result.table)
    walks.to_csv(form.out / "robustness_map.csv", index=False, lineterminator="\n")
    beyond.to_csv(form.out / "beyond.csv", index=False, lineterminator="\n")
    share = float((walks["outcome"] == "walked").mean())
    print(f"{len(walks)} walks of {sweep.experiment.duration:g} s: {share:.1%} walked")
    form.keep(
        {
            "walks": len(walks),
            "walked": int((walks["outcome"] == "walked").sum()),
            "share": share,
            "supports": support_rows(walks),
            "beyond": carried_rows(beyond),
        }
    )
