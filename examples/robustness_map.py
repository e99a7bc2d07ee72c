"""Robustness map of the shipped gait table: which wearers, belt speeds and supports it walks with.

The sweep of examples/sweep.yaml: 320 walks over mass, height, belt speed and supported share of the weight.
Two minutes on two cores; page: docs/background/robustness_map.md.
"""

# %% [markdown]
# The same map of a table of your own is `twin-gait sweep` with `table:` under `settings` in its file.

# %%
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


# %%
def spec_in(folder: str, *, quick: bool) -> Path:
    """The specification of the sweep; the quick form takes the ends of each range and no time."""
    document = yaml.safe_load(SPEC.read_text(encoding="utf-8"))
    if quick:
        document["settings"]["duration_s"] = 0.3
        document["parameters"] |= {"patient.mass_kg": [55, 95], "scenario.belt_speed_m_per_s": [0.30, 0.42]}
        document["parameters"] |= {"patient.height_m": [1.75], "scenario.support.share": [0.4, 0.7]}
    path = Path(folder) / "spec.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def rows_of(table: pd.DataFrame) -> pd.DataFrame:
    """What the map tells of each walk: its place, its outcome, and what the feet did."""
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
    """Share that walked at each support, and what became of the others."""
    rows = []
    for support, block in walks.groupby("support_share"):
        others = block["outcome"][block["outcome"] != "walked"].value_counts()
        rows.append(
            {
                "support": f"{support:.0%}",
                "walked": f"{len(block) - others.sum()} of {len(block)}",
                "others": ", ".join(f"{count} {word}" for word, count in others.items()) or "none",
            }
        )
    return rows


# %%
if __name__ == "__main__":
    form = form_of("robustness_map")
    with tempfile.TemporaryDirectory() as folder, Workers(form.workers) as workers:
        sweep = load_sweep(spec_in(folder, quick=form.quick))
        out = Path(folder) / "map"
        result = run_sweep(sweep, out, workers=workers)
        for name in ("heat_map_walked.png", "main_effects_walked.png"):
            shutil.copy(out / "figures" / name, form.out)
    walks = rows_of(result.table)
    walks.to_csv(form.out / "robustness_map.csv", index=False, lineterminator="\n")
    share = float((walks["outcome"] == "walked").mean())
    print(f"{len(walks)} walks of {sweep.experiment.duration:g} s: {share:.1%} walked")
    form.keep(
        {
            "walks": len(walks),
            "walked": int((walks["outcome"] == "walked").sum()),
            "share": share,
            "supports": support_rows(walks),
        }
    )
