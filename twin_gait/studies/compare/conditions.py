r"""Comparison of conditions: the settled strides of two or more folders, measure by measure and as curves.

A folder has a table of strides (:mod:`twin_gait.runs.stride_table`) and, for the curves, a log with angles.
The samples are strides. They are neither independent of each other nor of different people, so that an
interval describes these walks and no group of people.

The interval of a difference of means is Welch's, with Student's t distribution and the degrees of freedom of
Welch and Satterthwaite (B. L. Welch: The generalization of 'Student's' problem when several different
population variances are involved, Biometrika 34 (1947) 28-35),

.. math::

    \bar x_B - \bar x_A \pm t_\nu \sqrt{s_A^2 / n_A + s_B^2 / n_B} .

The band of a difference of mean curves has the same form at every percent of the stride. Its factor in place
of :math:`t_\nu` makes the whole curve lie in the band with the confidence: it is the quantile of the largest
standardised deviation of resampled strides or, if spm1d is installed, the threshold of random field theory.
"""

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.stats import t as student

from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.files import require_parquet
from twin_gait.measures.leg_record import wearer_column
from twin_gait.measures.strides import PERCENT
from twin_gait.runs.record import LOG_FILE
from twin_gait.runs.stride_table import IDENTITY, read_strides
from twin_gait.studies.compare.comparison import CONFIDENCE
from twin_gait.vocabulary import JointName, Side

MOST_CONDITIONS = 6  # largest number of conditions whose colours can be distinguished
RESAMPLES = 2000  # number of resampled sets of strides, with a fixed seed
FEWEST_STRIDES = 3  # smallest number of strides for a band of a difference
Curves = dict[tuple[Side, JointName], np.ndarray]


@dataclass(frozen=True, eq=False)
class Condition:
    """Settled strides of a folder in one condition."""

    name: str
    table: pd.DataFrame  # rows of the table of strides
    curves: Curves  # angle in [deg] at ``PERCENT`` of each stride, shape ``(n_strides, 101)``


class CurveDifference(NamedTuple):
    """Difference of two mean curves at ``PERCENT`` in [deg]."""

    mean: np.ndarray  # shape ``(101,)``
    half_width: np.ndarray  # half-width of the band that contains the whole curve, shape ``(101,)``

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First and last percent of each span in which the band excludes zero."""
        apart = np.concatenate(([False], np.abs(self.mean) > self.half_width, [False]))
        edges = np.flatnonzero(apart[1:] != apart[:-1]).tolist()
        return [(first, end - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def read_conditions(folders: Sequence[Path]) -> list[Condition]:
    """Read the settled strides of folders; a folder with several conditions gives one for each.

    Raises RunDirectoryError if a folder has no table of strides, no settled stride or cannot be read, and
    ParameterError unless there are 2 to 6 conditions.
    """
    names = [folder.expanduser().absolute().name for folder in folders]
    found = []
    for folder, name in zip(folders, names, strict=True):
        title, table = name if names.count(name) == 1 else str(folder), read_strides(folder)
        settled = table[table["settled"]]
        if settled.empty:
            raise RunDirectoryError(f"{folder}: has no settled stride; simulate or record a longer walk")
        for condition, rows in settled.groupby("condition"):
            whole = title if table["condition"].nunique() == 1 else f"{title}, condition {condition}"
            found.append(Condition(whole, rows, _read_curves(folder / LOG_FILE, rows)))
    if not 2 <= len(found) <= MOST_CONDITIONS:
        shown = ", ".join(item.name for item in found)
        raise ParameterError(
            f"compare: expected 2 to {MOST_CONDITIONS} conditions with settled strides, got {shown}; name "
            "other run directories"
        )
    return found


def _read_curves(log: Path, table: pd.DataFrame) -> Curves:
    """Return the angles of the wearer's joints over the strides of a table; empty without a log."""
    if not log.is_file():
        return {}
    try:
        require_parquet(log)
        columns = pq.read_schema(log).names
        angles = {
            (side, joint): wearer_column(columns, side, joint, "angle_rad")
            for side in Side for joint in JointName
        }  # fmt: skip
        angles = {key: name for key, name in angles.items() if name in columns}
        values = pq.read_table(log, columns=["time_s", *angles.values()]).to_pandas()
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise RunDirectoryError(f"{log}: cannot be read ({' '.join(str(error).split())})") from error
    found, time = Curves(), values["time_s"].to_numpy(float)
    for (side, joint), name in angles.items():
        rows = table[table["side"] == side]
        start, length = (rows[key].to_numpy(float)[:, None] for key in ("start_s", "stride_time_s"))
        instants = start + PERCENT / PERCENT[-1] * length
        if len(rows):
            found[side, joint] = np.degrees(np.interp(instants, time, values[name].to_numpy(float)))
    return found


def differences(first: Condition, other: Condition) -> pd.DataFrame:
    """Compare every measure that two conditions have in common.

    Returns one row for each side and measure: mean, sample standard deviation and number of each, the
    difference of the second from the first, and the bounds of its interval. NaN where a condition has fewer
    than two values.
    """
    tables = (first.table, other.table)
    sides = [side for side in Side if all((table["side"] == side).any() for table in tables)]
    measures = [name for name in first.table if name not in IDENTITY and name in other.table]
    rows = []
    for side in sides:
        legs = [table[table["side"] == side] for table in tables]
        for measure in measures:
            values = [leg[measure].dropna().to_numpy(float) for leg in legs]
            if all(map(len, values)):
                rows.append({"side": str(side), "measure": measure, **_difference(*values)})
    return pd.DataFrame(rows)


def _difference(first: np.ndarray, second: np.ndarray) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, values in (("first", first), ("second", second)):
        deviation = float(np.std(values, ddof=1)) if len(values) > 1 else np.nan
        found |= {f"{name}_mean": float(values.mean()), f"{name}_sd": deviation, f"{name}_n": len(values)}
    difference, half_width = found["second_mean"] - found["first_mean"], welch_half_width(first, second)
    return {
        **found,
        "difference": difference,
        "low": difference - half_width,
        "high": difference + half_width,
    }


def welch_half_width(first: np.ndarray, second: np.ndarray) -> float:
    """Compute the half-width of Welch's interval of a difference of means; NaN for fewer than two values."""
    if min(len(first), len(second)) < 2:
        return np.nan
    parts = [float(np.var(values, ddof=1)) / len(values) for values in (first, second)]
    total = sum(parts)
    if total == 0.0:
        return 0.0
    squares = (part**2 / (len(values) - 1) for part, values in zip(parts, (first, second), strict=True))
    return float(student.ppf(0.5 + 0.5 * CONFIDENCE, total**2 / sum(squares)) * np.sqrt(total))


def has_spm1d() -> bool:
    """Return whether spm1d, which is optional, is installed."""
    return importlib.util.find_spec("spm1d") is not None


def curve_difference(first: np.ndarray, second: np.ndarray) -> CurveDifference | None:
    """Compute the difference of the mean curves of two conditions with its band.

    ``first``, ``second``: curves of the strides, shape ``(n_strides, 101)``. Returns None for fewer than
    three strides of either.
    """
    if min(len(first), len(second)) < FEWEST_STRIDES:
        return None
    mean = second.mean(axis=0) - first.mean(axis=0)
    error = np.sqrt(sum(curves.var(axis=0, ddof=1) / len(curves) for curves in (first, second)))
    factor = _field_threshold(first, second) if has_spm1d() else _resampled_threshold(first, second, error)
    return CurveDifference(mean, factor * error)


def _field_threshold(first: np.ndarray, second: np.ndarray) -> float:
    """Return the threshold of t for the whole curve by random field theory (spm1d)."""
    import spm1d

    statistic = spm1d.stats.ttest2(second, first, equal_var=False)
    return float(statistic.inference(1.0 - CONFIDENCE, two_tailed=True).zstar)


def _resampled_threshold(first: np.ndarray, second: np.ndarray, error: np.ndarray) -> float:
    """Return the quantile of the largest standardised deviation of resampled mean differences."""
    generator, deviation = np.random.default_rng(0), np.zeros((RESAMPLES, len(PERCENT)))
    for sign, curves in ((-1.0, first), (1.0, second)):
        count = len(curves)
        drawn = generator.integers(count, size=(RESAMPLES, count))
        weights = np.array([np.bincount(row, minlength=count) for row in drawn]) / count
        # A resampled set varies by the share (n - 1)/n of the sample variance.
        deviation += sign * np.sqrt(count / (count - 1)) * weights @ (curves - curves.mean(axis=0))
    known = error > 0.0
    largest = np.abs(deviation[:, known] / error[known]).max(axis=1, initial=0.0)
    return float(np.quantile(largest, CONFIDENCE))


def curve_differences(
    first: Condition, other: Condition
) -> dict[tuple[Side, JointName], CurveDifference | None]:
    """Compare the curves that two conditions have in common, by side and joint."""
    common = [key for key in first.curves if key in other.curves]
    return {key: curve_difference(first.curves[key], other.curves[key]) for key in common}


def curves_table(conditions: Sequence[Condition]) -> pd.DataFrame:
    """Return mean and standard deviation of every curve, and its difference from the first condition.

    One row for each condition, side, joint and percent.
    """
    rows: list[dict[str, Any]] = []
    for condition in conditions:
        apart = curve_differences(conditions[0], condition) if condition is not conditions[0] else {}
        for (side, joint), curves in condition.curves.items():
            found, none = apart.get((side, joint)), np.full(len(PERCENT), np.nan)
            columns = {
                "percent": PERCENT,
                "mean_deg": curves.mean(axis=0),
                "sd_deg": curves.std(axis=0, ddof=1) if len(curves) > 1 else none,
                "difference_deg": none if found is None else found.mean,
                "half_width_deg": none if found is None else found.half_width,
            }
            name = {"condition": condition.name, "side": str(side), "joint": str(joint)}
            rows += [
                name | dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
            ]
    return pd.DataFrame(rows)
