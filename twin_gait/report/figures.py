"""All pictures of a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from twin_gait.report.canvas import save
from twin_gait.report.currents import draw_currents
from twin_gait.report.cycle import draw_angles, draw_cycle
from twin_gait.report.energy import draw_energy
from twin_gait.report.feet import draw_feet
from twin_gait.report.portrait import draw_portrait
from twin_gait.report.torques import draw_torques
from twin_gait.simulation.run import Run

# File name and what draws it; a drawing that does not apply to the run gives None.
PICTURES: dict[str, Callable[[Run], Figure | None]] = {
    "gait_cycle.png": draw_cycle,
    "joint_angles.png": draw_angles,
    "torques.png": draw_torques,
    "currents.png": draw_currents,
    "feet.png": draw_feet,
    "phase_portrait.png": draw_portrait,
    "energy.png": draw_energy,
}


def write_figures(run: Run, directory: Path) -> list[Path]:
    """Draw a run.

    A run without strides has no picture of the gait cycle, and one without ground none of the feet.

    Args:
        run: The run, with at least two rows in its log.
        directory: An existing folder.

    Returns:
        The files that were written.
    """
    written = []
    for name, draw in PICTURES.items():
        figure = draw(run)
        if figure is not None:
            written.append(save(figure, directory / name))
    return written
