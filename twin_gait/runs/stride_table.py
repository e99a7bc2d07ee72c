"""Table of strides of a run: one row for each stride and side; the content of ``strides.csv``."""

import io
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import RunDirectoryError
from twin_gait.experiment.events import Change
from twin_gait.files import MOST_TEXT, read_text, to_json_value
from twin_gait.measures.strides import SKIPPED_STRIDES
from twin_gait.runs.leg_strides import LegStrides
from twin_gait.simulation.run import Run
from twin_gait.yaml12 import load_yaml

STRIDES_FILE = "strides.csv"
# Columns that identify a row; all other columns are quantities.
IDENTITY = ("side", "stride", "condition", "settled", "start_s")
STATISTICS = ("mean", "sd", "n", "median")
# Ends of the names of the log columns that the table reads in addition to those of a summary of many runs.
STRIDE_LOG_COLUMNS = (
    "_measured_angle_rad", "_equilibrium_rad", "_stiffness_Nm_per_rad", "_friction_torque_Nm",
    "_brace_torque_Nm", "_wearer_velocity_rad_per_s",
)  # fmt: skip


@cache
def column_meanings() -> dict[str, dict[str, str]]:
    """Return the meaning of every column by the object to which it belongs, and by its name."""
    text = Path(__file__).with_name("stride_columns.yaml").read_text(encoding="utf-8")
    found: dict[str, dict[str, str]] = load_yaml(text)
    return found


def stride_table(run: Run, *, skip_strides: int = SKIPPED_STRIDES) -> pd.DataFrame:
    """Compute the table of strides of a run.

    ``skip_strides``: number of strides at the start of each condition that are marked as not settled. Returns
    one row for each stride in even walking, of one side after the other; units are in the names of the
    columns. A quantity that the experiment does not define has no column, one that a stride does not define
    is NaN.
    """
    legs = [LegStrides(run, record, skip=0) for record in run.leg_records()]
    changes = np.array(
        [event.tick for event in run.experiment.events if isinstance(event, Change)], dtype=int
    )
    # A condition counts from the first one in which a leg begins a stride.
    spans = np.unique(np.concatenate([_changes_before(changes, leg.strides[:, 0]) for leg in legs]))
    tables = []
    for leg in legs:
        first, end = leg.strides.T
        span = _changes_before(changes, first)
        place = np.arange(len(span)) - span.searchsorted(span)  # place of the stride in its condition, from 0
        identity = {
            "side": str(leg.record.side),
            "stride": np.arange(1, len(span) + 1),
            "condition": spans.searchsorted(span) + 1,
            "settled": (place >= skip_strides) & (_changes_before(changes, end - 1) == span),
        }
        tables.append(pd.DataFrame({**identity, **leg.all_values()}))
    return pd.concat(tables, ignore_index=True)


def _changes_before(changes: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """Count the changes of parameters up to each tick; ``changes``: their ticks in ascending order."""
    return np.asarray(changes.searchsorted(ticks, side="right"))


def stride_statistics(table: pd.DataFrame) -> pd.DataFrame:
    """Compute mean, sample standard deviation, number and median over the settled strides.

    ``table`` from :func:`stride_table`. Returns one row for each condition, side and quantity with the
    columns of ``STATISTICS``, indexed by ``condition``, ``side`` and ``measure``.
    """
    settled = table[table["settled"]]
    others = [name for name in ("stride", "settled", "start_s") if name in settled]
    values = settled.drop(columns=others).melt(["condition", "side"], var_name="measure")
    groups = values.groupby(["condition", "side", "measure"], sort=False)["value"]
    found = {"mean": groups.mean(), "sd": groups.std(), "n": groups.count(), "median": groups.median()}
    return pd.DataFrame(found)


def statistics_summary(table: pd.DataFrame) -> dict[str, Any]:
    """Return :func:`stride_statistics` as nested mappings of plain values: condition, side and quantity."""
    nested: dict[str, dict[str, dict[str, Any]]] = {}
    for row in stride_statistics(table).reset_index().to_dict("records"):
        condition, side, measure = (str(row.pop(name)) for name in ("condition", "side", "measure"))
        nested.setdefault(condition, {}).setdefault(side, {})[measure] = row
    found: dict[str, Any] = to_json_value(nested)
    return found


def read_strides(folder: Path) -> pd.DataFrame:
    """Read the table of strides of a run directory, or of another folder that has one.

    Raises RunDirectoryError if there is no such file, a column that every table has is missing, or a value is
    not a number.
    """
    path = folder.expanduser() / STRIDES_FILE
    if not path.is_file():
        experiment = path.with_name("experiment.yaml")
        again = f"; run it again: twin-gait simulate {experiment}" if experiment.is_file() else ""
        raise RunDirectoryError(f"{path}: there is no such file; expected a folder with strides{again}")
    try:
        table = pd.read_csv(io.StringIO(read_text(path, MOST_TEXT)))
    except (OSError, ValueError) as error:
        raise RunDirectoryError(f"{path}: cannot be read ({' '.join(str(error).split())})") from error
    missing = [name for name in (*IDENTITY, "stride_time_s") if name not in table]
    if missing:
        raise RunDirectoryError(f"{path}: {missing[0]}: there is no such column; expected a table of strides")
    if table.empty:
        return table.astype({"settled": bool})
    wrong = [name for name in table if name != "side" and table[name].dtype.kind not in "bif"]
    if wrong or table["settled"].dtype.kind != "b":
        name = (wrong or ["settled"])[0]
        expected = "True or False" if name == "settled" else "numbers"
        raise RunDirectoryError(
            f"{path}: {name}: expected {expected}, got {str(table[name].iloc[:1].squeeze())[:40]!r}"
        )
    return table


def strides_csv(table: pd.DataFrame) -> str:
    """Return a table of strides as CSV with all digits."""
    return table.to_csv(index=False, lineterminator="\n")
