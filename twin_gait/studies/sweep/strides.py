"""Strides of the episodes of a sweep: small files while it runs, and one table at the end of every call."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from twin_gait.files import write_atomically, write_parquet
from twin_gait.runs.stride_table import STRIDE_LOG_COLUMNS, STRIDES_FILE, stride_table, strides_csv
from twin_gait.simulation.run import Run
from twin_gait.studies.batch import (
    SUMMARY_LOG_COLUMNS,
    FlatSummary,
    Override,
    flat_summary,
    settings_table,
)

PARTS_FOLDER = "strides_parts"
LOG_COLUMNS = (*SUMMARY_LOG_COLUMNS, *STRIDE_LOG_COLUMNS)
_KEY = ["episode", "side", "stride"]


def measure_with_strides(run: Run) -> tuple[FlatSummary, pd.DataFrame]:
    """Return the summary of a run in one row, and its table of strides."""
    return flat_summary(run), stride_table(run)


def store_strides(directory: Path, tables: Mapping[int, pd.DataFrame]) -> None:
    """Write the strides of some episodes, by their numbers, to a part of their own."""
    parts = directory / PARTS_FOLDER
    parts.mkdir(exist_ok=True)
    table = pd.concat([item.assign(episode=episode) for episode, item in sorted(tables.items())])
    write_parquet(parts / f"{min(tables):08d}-{max(tables):08d}.parquet", table)


def merge_strides(directory: Path, overrides: Sequence[Override], episodes: pd.Index) -> None:
    """Merge the strides of all finished episodes into one table, with the values that each episode changes.

    ``episodes``: numbers of the finished episodes; strides of others are left out, because they run again.
    The parts are kept until all episodes are finished.
    """
    parts = sorted((directory / PARTS_FOLDER).glob("[!.]*"))
    if not parts:
        return
    rows = pd.concat(map(pd.read_parquet, parts), ignore_index=True)
    rows = rows[rows["episode"].isin(episodes)].drop_duplicates(_KEY).sort_values(_KEY)
    settings = settings_table(overrides).rename_axis("episode").reset_index()
    write_atomically(directory / STRIDES_FILE, strides_csv(settings.merge(rows, on="episode")))
    if len(episodes) == len(overrides):
        shutil.rmtree(directory / PARTS_FOLDER, ignore_errors=True)
