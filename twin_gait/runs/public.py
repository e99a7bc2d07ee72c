"""What a user does with one run in Python: keep it, read it again, draw it."""

from pathlib import Path

from matplotlib.figure import Figure

from twin_gait.exceptions import ParameterError
from twin_gait.report.canvas import FORMATS, save
from twin_gait.report.figures import draw_figure, draw_for_paper
from twin_gait.runs import record
from twin_gait.runs.folders import staged_directory
from twin_gait.simulation.run import Run


def save_run(run: Run, folder: str | Path, *, pictures: bool = True, force: bool = False) -> Path:
    """Write a run directory, as ``twin-gait simulate`` does.

    ``run``: the run. ``folder``: the directory to make; it appears when all in it is written. ``pictures``:
    whether to draw figures and animation. ``force``: whether an existing run directory may be replaced.
    Returns the directory. Raises RunDirectoryError if it exists, or cannot be written.
    """
    target = Path(folder).expanduser()
    with staged_directory(target, record.RUN_DIRECTORY, force=force) as staging:
        record.write_run(run, staging, pictures=pictures)
    return target


def load_run(folder: str | Path) -> Run:
    """Read a run directory back.

    ``folder``: the directory. Returns the run, with log, switches and trip as they were, and the experiment
    with everything resolved, such as the integrator that its engine chose. Raises ParameterFileError if its
    experiment file has a mistake, or URDF or table have changed since. Raises RunDirectoryError if it is not
    a complete run directory.
    """
    return record.load_run(Path(folder)).run


def plot_run(
    run: Run, figure: str = "gait_cycle", *, width_mm: float | None = None, out: str | Path | None = None
) -> Figure:
    """Draw a picture of a run.

    Args:
        run: The run.
        figure: ``gait_cycle``, ``ground_forces``, ``joint_angles``, ``torques``, ``currents``,
            ``battery``, ``feet`` or ``phase_portrait``.
        width_mm: Of a figure for print, 85 or 174 for one column or two, with letters and without a title;
            None draws for a screen.
        out: A .pdf, .svg or .png file to write it into, or None.

    Returns:
        The figure; notebooks show it after ``%matplotlib inline``.

    Raises:
        ParameterError: If there is no such picture, none of this run, or the width or the format is another.
        RunDirectoryError: If the file cannot be written.
    """
    path = None if out is None else Path(out)
    if path is not None and path.suffix[1:] not in FORMATS:
        raise ParameterError(f"out: expected a name ending in .{', .'.join(FORMATS)}, got {path.name!r}")
    drawn = draw_figure(run, figure) if width_mm is None else draw_for_paper(run, figure, width_mm)[0]
    if path is not None:
        save(drawn, path)
    return drawn
