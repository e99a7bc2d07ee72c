"""The page of the documentation on the stability of the loop: table, picture and text, made again at will.

``python -m twin_gait.studies.loop_stability.page docs`` takes two minutes and writes ``loop_stability.md``,
``.csv`` and ``.png`` into the folder.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from twin_gait.files import write_atomically
from twin_gait.palette import BLACK, BLUE, GREY, VERMILLION
from twin_gait.report.canvas import picture_bytes
from twin_gait.studies.loop_stability.loop_stability import (
    DAMPINGS,
    STIFFNESSES,
    UNDECIDED,
    VELOCITIES,
    Case,
    Ending,
    LoopResult,
    grid,
    predicted_radius,
    true_experiment,
    witness_all,
)
from twin_gait.vocabulary import JointName

NAME = "loop_stability"
SHOWN_STIFFNESS = STIFFNESSES[2]  # the small table of the page: 2.5 Nm/deg, as in the shipped tables
_FINE = 33  # samples of G and of b behind the picture
_LEVELS = (0.0, 0.95, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03, 2.0)
_TINTS = ("#8fbfe0", "#aed0e9", "#cde2f2", "#e9f2fa", "#fbebe3", "#f6d0bd", "#efb295", "#e8926b")
_AT_REST = VELOCITIES.index(0.0)

_TEXT = """# Stability of the sampled loop

![Who grows]({name}.png)

`twin-gait check` multiplies out what firmware and leg do in a frame of ten ticks (encoder differences, fast
filter, decimated velocity averaged over ten samples, torque held over each tick, the leg moving on exactly)
into one matrix, hip and knee coupled. Its spectral radius is the factor by which a small motion changes in
10 ms in the long run.

Witness: the compiled engine on {settings} settings of k, b and G, with friction replaced by its slope at
{velocities} rad/s. It shares the leg's parameters and these slopes with the matrix, nothing else. Of {runs}
linear runs {decided} have a spectral radius at least {undecided:g} away from 1 ({growing} above it):
**{misses} misses**.

Beside it the same leg with its friction law (hip {hip:g}, knee {knee:g} times the compensator's model),
torque limit and stops, let go 5° from the equilibrium: rest, a limit cycle with its amplitude over the last
2.5 s of 10 s, or a runaway into the stops. The compensator is steepest at rest; faster motions meet its flat
part and the damper, so that a loop that grows at rest ends in a limit cycle unless spring and damper are
weak. {cycles}

Largest stable gain: it is the ratio of true friction to model, 0.5 here, without a damper, and rises with b.

k = {stiffness:g} Nm/deg; all settings are in [{name}.csv]({name}.csv).

{table}

Made by `python -m twin_gait.studies.{name}_page docs`.
"""


def result_table(results: Sequence[LoopResult]) -> pd.DataFrame:
    """One row per case with units in the column names.

    Args:
        results: Of the cases.

    Returns:
        The table.
    """
    return pd.DataFrame([_row(result) for result in results])


def _row(result: LoopResult) -> dict[str, float | str]:
    row: dict[str, float | str] = {
        "stiffness_Nm_per_deg": round(math.radians(result.case.stiffness), 6),
        "damping_Nms_per_rad": result.case.damping,
        "friction_compensation_gain": result.case.gain,
    }
    for velocity, radius, grows in zip(VELOCITIES, result.radii, result.grows, strict=True):
        row[f"spectral_radius_at_{velocity:g}_rad_per_s"] = round(radius, 5)
        row[f"linear_run_at_{velocity:g}_rad_per_s"] = "grows" if grows else "decays"
    row["true_run"] = str(result.ending)
    row["true_amplitude_deg"] = round(math.degrees(result.amplitude), 4)
    return row


# ---------------------------------------------------------------------- picture


def draw(results: Sequence[LoopResult]) -> Figure:
    """Prediction as ground, both runs as marks: one panel per stiffness, G across, b upwards.

    Args:
        results: Of the whole grid.

    Returns:
        The picture.
    """
    figure = Figure(figsize=(11.0, 8.2), layout="constrained")
    figure.suptitle(
        "Stability: spectral radius of the transition matrix at rest, linear run and run with friction\n"
        "bench leg, same k, b and G in hip and knee",
        fontsize="large",
    )
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, stiffness in zip(panels.flat, STIFFNESSES, strict=True):
        filled = _draw_ground(axes, stiffness)
        for result in results:
            if result.case.stiffness == stiffness:
                _draw_marks(axes, result)
        axes.set_title(f"k = {math.radians(stiffness):g} Nm/deg", fontsize="medium")
        axes.set_yscale("function", functions=(np.sqrt, np.square))
        axes.set_yticks(DAMPINGS, [f"{value:g}" for value in DAMPINGS])
        axes.set(xlim=(-0.05, 1.07), ylim=(0.0, 1.35 * DAMPINGS[-1]))
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("friction compensation gain G")
    for axes in panels[:, 0]:
        axes.set_ylabel("b [Nms/rad]")
    bar = figure.colorbar(filled, ax=panels, ticks=_LEVELS[1:-1], pad=0.01, shrink=0.7)
    bar.set_label("spectral radius of 10 ms")
    figure.legend(handles=_legend(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _draw_ground(axes: Axes, stiffness: float) -> ContourSet:
    gains = np.linspace(0.0, 1.0, _FINE)
    dampings = np.linspace(0.0, math.sqrt(1.35 * DAMPINGS[-1]), _FINE) ** 2
    radii = [[predicted_radius(Case(stiffness, b, gain), 0.0) for gain in gains] for b in dampings.tolist()]
    axes.contour(gains, dampings, radii, levels=[1.0], colors=BLACK, linewidths=1.2)
    return axes.contourf(gains, dampings, radii, levels=_LEVELS, colors=_TINTS)


def _draw_marks(axes: Axes, result: LoopResult) -> None:
    colour = VERMILLION if result.grows[_AT_REST] else BLUE
    place = (result.case.gain, result.case.damping)
    if result.ending is Ending.REST:
        axes.plot(*place, "o", color=colour, markersize=5, clip_on=False, zorder=3)
        return
    runs = result.ending is Ending.RUNAWAY
    axes.plot(
        *place,
        "X" if runs else "o",
        markersize=9,
        markerfacecolor=colour if runs else "white",
        markeredgecolor=colour,
        markeredgewidth=0.5 if runs else 1.8,
        clip_on=False,
        zorder=3,
    )
    if not runs:
        degrees = math.degrees(result.amplitude)
        axes.annotate(
            f"{degrees:.0f}°" if degrees >= 9.95 else f"{degrees:.1f}°",
            place,
            xytext=(0, 7),
            textcoords="offset points",
            ha="center",
            fontsize="x-small",
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )


def _legend() -> list[Line2D]:
    def mark(marker: str, label: str, colour: str, size: float = 6.0, filling: str | None = None) -> Line2D:
        return Line2D(
            [],
            [],
            linestyle="none",
            marker=marker,
            markersize=size,
            color=colour,
            markerfacecolor=filling or colour,
            markeredgewidth=1.8 if filling else 0.5,
            label=label,
        )

    return [
        mark("s", "linear run decays", BLUE),
        mark("o", "with friction: rest", GREY, 5.0),
        Line2D([], [], color=BLACK, label="spectral radius 1"),
        mark("s", "linear run grows", VERMILLION),
        mark("o", "with friction: limit cycle, amplitude", GREY, 9.0, "white"),
        mark("X", "with friction: runs into the stops", GREY, 9.0),
    ]


# ---------------------------------------------------------------------- page


def page(results: Sequence[LoopResult]) -> str:
    """The page as Markdown.

    Args:
        results: Of the whole grid.

    Returns:
        Text with the small table.
    """
    pairs = [pair for result in results for pair in zip(result.radii, result.grows, strict=True)]
    decided = [pair for pair in pairs if abs(pair[0] - 1.0) >= UNDECIDED]
    quiet = [
        result
        for result in results
        if result.ending is not Ending.REST and max(result.radii) <= 1.0 - UNDECIDED
    ]
    ratios = true_experiment(grid()[0]).plant.friction_ratio
    cycles = "No setting keeps cycling while both linear runs clearly decay."
    if quiet:
        cycles = (
            f"{len(quiet)} settings keep cycling although both linear runs clearly decay: no proof of rest."
        )
    text = _TEXT.format(
        name=NAME,
        settings=len(results),
        velocities=" and ".join(f"{velocity:g}" for velocity in VELOCITIES),
        runs=len(pairs),
        decided=len(decided),
        undecided=UNDECIDED,
        growing=sum(grows for _, grows in decided),
        misses=sum(result.misses() for result in results),
        hip=ratios[JointName.HIP],
        knee=ratios[JointName.KNEE],
        cycles=cycles,
        stiffness=math.radians(SHOWN_STIFFNESS),
        table="\n".join(_small_table(results)),
    )
    return text


def _small_table(results: Sequence[LoopResult]) -> list[str]:
    lines = [
        "| b [Nms/rad] | G | radius at rest | linear run | radius at ±1 rad/s | linear run | with friction |",
        "|---|---|---|---|---|---|---|",
    ]
    for result in results:
        if result.case.stiffness != SHOWN_STIFFNESS:
            continue
        cells = [f"{result.case.damping:g}", f"{result.case.gain:g}"]
        for radius, grows in zip(result.radii, result.grows, strict=True):
            near = " (left out)" if abs(radius - 1.0) < UNDECIDED else ""
            cells += [f"{radius:.4f}", ("grows" if grows else "decays") + near]
        moving = result.ending is Ending.LIMIT_CYCLE
        cells.append(f"limit cycle, {math.degrees(result.amplitude):.2f}°" if moving else str(result.ending))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def write_page(folder: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Run the whole grid and write page, table and picture.

    Args:
        folder: Where to write.
        progress: Called with cases done and in all.

    Raises:
        RunDirectoryError: If a file cannot be written.
    """
    results = witness_all(grid(), progress)
    write_atomically(folder / f"{NAME}.csv", result_table(results).to_csv(index=False, lineterminator="\n"))
    write_atomically(folder / f"{NAME}.png", picture_bytes(draw(results)))
    write_atomically(folder / f"{NAME}.md", page(results))


if __name__ == "__main__":
    write_page(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
