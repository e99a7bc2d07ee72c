"""Run directory: the files of a run, written atomically, and their reader."""

import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.experiments import load_experiment, resolved_document
from twin_gait.control.safety import Trip, TripCause
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import (
    read_json,
    read_parquet,
    read_text,
    write_atomically,
    write_json,
    write_parquet,
)
from twin_gait.gait.machine import POSTURE, PhaseSwitch
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.report.failures import failed_pictures, format_error
from twin_gait.report.pages import FIGURES_FOLDER
from twin_gait.runs.folders import FolderKind, journal_path, staged_directory
from twin_gait.runs.stored_log import check_log
from twin_gait.runs.stored_run import StoredRun
from twin_gait.runs.stride_table import STRIDES_FILE, strides_csv
from twin_gait.runs.summary import software_versions, summarise_run
from twin_gait.runs.user_files import referenced_files, store_files
from twin_gait.simulation.log import LOG_SCHEMA_VERSION, meaning_of, unit_of
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import JointName, Side

EXPERIMENT_FILE = "experiment.yaml"
LOG_FILE = "log.parquet"
SWITCHES_FILE = "transitions.csv"
SUMMARY_FILE = "summary.json"
ANIMATION_FILE = "animation.html"
RUN_DIRECTORY = FolderKind("a run directory", EXPERIMENT_FILE)


def write_run(
    run: Run,
    directory: Path,
    *,
    document: dict[str, Any] | None = None,
    pictures: bool = True,
    accuracy: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Write all files of a run into a folder; return the summary.

    A picture or page that cannot be drawn causes a warning, is recorded in the summary and is left out.
    """
    files = store_files(referenced_files(run.experiment), directory)
    resolved = resolved_document(run.experiment, document, software_versions(), files)
    write_atomically(directory / EXPERIMENT_FILE, dump_yaml(resolved))
    write_log(run.log, directory / LOG_FILE, run.status)
    switches = format_switches_csv(
        run.switches, ("hip", "knee"), lambda *parts: run.log["_".join(parts)].to_numpy()
    )
    write_atomically(directory / SWITCHES_FILE, switches)
    write_atomically(directory / STRIDES_FILE, strides_csv(run.strides))
    summary = summarise_run(run)
    if accuracy is not None:
        summary["accuracy"] = accuracy
    write_json(directory / SUMMARY_FILE, summary)
    if pictures and len(run.log) > 1:
        failed = _write_page(StoredRun(run, summary), directory / ANIMATION_FILE)
        record = failed_pictures(_draw_figures(run, directory / FIGURES_FOLDER) | failed)
        if record:
            summary |= record
            write_json(directory / SUMMARY_FILE, summary)
    return summary


def _write_page(stored: StoredRun, path: Path) -> dict[str, str]:
    """Write the page that plays a run; return the reason by the name of the file if that fails."""
    try:
        from twin_gait.runs.run_page import render_run_page

        write_atomically(path, render_run_page([stored]))
    except Exception as error:
        return {path.name: format_error(error)}
    return {}


def _draw_figures(run: Run, folder: Path) -> dict[str, str]:
    """Draw the first figures of a run into a folder; return the reason by the name of each that failed.

    A reason that applies to all of them, such as a failed import of matplotlib, has the name of the folder.
    """
    try:
        from twin_gait.report.figures import default_figures, write_figures

        return write_figures(run, folder, default_figures(run))
    except Exception as error:
        return {folder.name: format_error(error)}


def save_run(run: Run, folder: str | Path, *, pictures: bool = True, force: bool = False) -> Path:
    """Write a run directory, as ``twin-gait simulate`` does.

    ``run``: the run. ``folder``: the new directory, which appears when it is complete. ``pictures``: whether
    to draw the first figures and the animation. ``force``: whether an existing run directory may be
    replaced. Returns the directory. Raises RunDirectoryError if it exists without ``force`` or is not a run
    directory, or cannot be written.
    """
    target = Path(folder).expanduser()
    with staged_directory(target, RUN_DIRECTORY, force=force) as staging:
        write_run(run, staging, pictures=pictures)
    return target


def write_log(log: pd.DataFrame, path: Path, status: str) -> None:
    """Write a log as parquet, with units, meanings, schema version and status in the metadata."""
    units, meanings = (json.dumps({name: of(name) for name in log.columns}) for of in (unit_of, meaning_of))
    about = {"schema_version": str(LOG_SCHEMA_VERSION), "status": status}
    write_parquet(path, log, **about, units=units, meanings=meanings)


# Returns the quantity of a side, a joint and a name at every tick.
Measured = Callable[[Side, str, str], np.ndarray]


def format_switches_csv(
    switches: Sequence[PhaseSwitch], joints: Sequence[str], measured: Measured, start: float = 0.0
) -> str:
    """Return switches with causes, angles and velocities as CSV text; ``start``: time of tick 0 [s]."""
    names = [(joint, name) for joint in joints for name in ("angle_rad", "velocity_rad_per_s")]
    heads = ("tick", "time_s", "side", "from", "to", "cause", *(f"{joint}_{name}" for joint, name in names))
    rows = [
        (item.tick, f"{start + item.time:.3f}", *item[1:5],
         *(repr(float(measured(item.side, *name)[item.tick])) for name in names))
        for item in switches
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=heads).to_csv(index=False, lineterminator="\n")


def _read_switches(path: Path, table: GaitTable) -> tuple[PhaseSwitch, ...]:
    indices = {(item.source, item.target, item.cause): k for k, item in enumerate(table.transitions)}
    try:
        rows = pd.read_csv(io.StringIO(read_text(path)), dtype=str, keep_default_na=False)
        edges = zip(rows["from"], rows["to"], rows["cause"], strict=True)
        return tuple(
            PhaseSwitch(int(tick), Side(side), *way, -1 if way[-1] == POSTURE else indices[way])
            for tick, side, way in zip(rows["tick"], rows["side"], edges, strict=True)
        )
    except (OSError, ValueError, KeyError) as error:
        raise RunDirectoryError(f"{path}: cannot be read ({error!r})") from error


def load_run(folder: str | Path) -> Run:
    """Read a run directory.

    ``folder``: the directory. Returns the run with its log, switches and trip, and the experiment with all
    resolved values, such as the integrator that its engine chose. Raises ParameterFileError if its experiment
    file has a mistake, or URDF or table have changed since. Raises RunDirectoryError if it is not a complete
    run directory.
    """
    return read_stored_run(Path(folder)).run


def read_stored_run(directory: Path) -> StoredRun:
    """Read a run with its summary; raise the errors of :func:`load_run`."""
    directory = directory.expanduser()
    if journal_path(directory.absolute()).is_file():
        way_out = f"twin-gait sessions complete {directory}"
        raise RunDirectoryError(f"{directory}: its walk is still running, or was killed; {way_out}")
    if not (directory / EXPERIMENT_FILE).is_file():
        raise RunDirectoryError(f"{directory}: not a run directory: it has no {EXPERIMENT_FILE}")
    experiment = load_experiment(directory / EXPERIMENT_FILE).experiment
    # A controller of the user, whose module may no longer exist, does not change the data that are read here.
    problem = build_setup(replace(experiment, controller=None))
    table = problem.table
    switches = _read_switches(directory / SWITCHES_FILE, table)
    try:
        log = read_parquet(directory / LOG_FILE)
        summary = read_json(directory / SUMMARY_FILE)
        run = Run(
            experiment=experiment,
            table=table,
            own_table=problem.own_table,
            log=log,
            switches=switches,
            status=RunStatus(summary["status"]),
            reason=summary["reason"],
            wall_s=float(summary["wall_s"]),
            body_weight=problem.world.body_weight,
            trip=_parse_trip(summary["safety"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException) as error:
        raise RunDirectoryError(f"{directory}: cannot be read ({error})".replace("\n", " ")) from error
    if summary.get("log_schema_version") != LOG_SCHEMA_VERSION:
        again = f"use that one, or run it anew: twin-gait simulate {directory / EXPERIMENT_FILE}"
        raise RunDirectoryError(f"{directory}: its log is from another version of the program; {again}")
    run = replace(run, log=check_log(log, problem, directory / LOG_FILE))
    late = next((item.tick for item in switches if not 0 <= item.tick < len(log)), None)
    if late is not None:
        raise RunDirectoryError(
            f"{directory / SWITCHES_FILE}: tick: expected 0 to {len(log) - 1} as in {LOG_FILE}, got {late}"
        )
    return StoredRun(run, summary, directory.absolute().name)


def _parse_trip(safety: Mapping[str, Any]) -> Trip | None:
    """Return the trip of the safety monitor from that part of a summary; None without a trip."""
    if not safety["tripped"]:
        return None
    side, _, joint = safety["location"].partition(" ")
    known = JointName(joint) if joint in list(JointName) else None
    at = Side(side) if joint else None
    return Trip(round(safety["time_s"] / TICK), TripCause(safety["cause"]), at, known)
