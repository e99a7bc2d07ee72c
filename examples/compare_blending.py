"""Compare ways to blend: how smoothly do stiffness, damping and equilibrium pass from phase to phase?

The default walk with parameters that step, fade linearly, or along the minimum-jerk curve, for several
durations. It prints what docs/blending.md shows and writes blending.png beside itself or into the folder
given as argument.
"""

import sys
from pathlib import Path

from twin_gait import load_experiment
from twin_gait.report.blending import draw_blending
from twin_gait.report.canvas import save
from twin_gait.studies.blending import CASES, compare_blending, comparison_text, switches_text


def main(folder: Path, duration: float = 20.0, cases=CASES) -> None:
    experiment = load_experiment("treadmill", [f"duration_s={duration}"]).experiment
    comparison = compare_blending(experiment, cases)
    print(comparison_text(comparison.table))

    # What each kind of switch does in the way in which the table is shipped.
    shipped, found = experiment.table.blending, comparison.switches
    same = (found["law"] == str(shipped.law)) & (found["duration_ms"] == shipped.duration_ticks)
    settled = found["tick"] > 5000
    print(f"\n{shipped.law}, {shipped.duration_ticks} ms, mean over the switches after 5 s:\n")
    print(switches_text(found[same & settled]))

    figure = draw_blending(comparison.table, comparison.traces, comparison.telling_switches())
    save(figure, folder / "blending.png")
    print(f"\nwrote {folder / 'blending.png'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
    # Homework: the law that gives the least jerk here is not the one called "minimum jerk". Why?
