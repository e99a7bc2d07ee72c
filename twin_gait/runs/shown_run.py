"""Read runs of any age to look at them."""

from pathlib import Path

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.validation import read_yaml
from twin_gait.exceptions import ParameterFileError, RunDirectoryError
from twin_gait.experiment import Experiment
from twin_gait.runs.record import EXPERIMENT_FILE, LOG_FILE, load_run, read_run
from twin_gait.runs.run_page import ShownRun, with_walk

_URDF_KEY = "provenance.urdf_sha256"
_URDF_NOTE = "The URDF has changed since this run."


def read_shown_run(directory: Path) -> ShownRun:
    """Read a run to look at it.

    A URDF that has changed since the run forbids to run it again, but not to look at it: the page says so.
    """
    directory = Path(directory).expanduser()
    name = f"twin_gait · {directory.absolute().name}"
    try:
        notes: tuple[str, ...] = ()
        stored = load_run(directory)
    except ParameterFileError as error:
        if error.key != _URDF_KEY:
            raise
        stored, notes = read_run(directory, _as_it_is_now(directory)), (_URDF_NOTE,)
    shown = ShownRun(name, stored.experiment, stored.log, notes, stored.events, stored.outcome)
    if "time_s" not in shown.log.columns or shown.log.empty:
        raise RunDirectoryError(f"{directory / LOG_FILE}: has no rows to show; run the simulation again")
    return with_walk(shown, stored.summary)


def _as_it_is_now(directory: Path) -> Experiment:
    path = directory / EXPERIMENT_FILE
    data = {key: value for key, value in read_yaml(path).items() if key != "provenance"}
    return experiment_from_mapping(data, str(path), directory)
