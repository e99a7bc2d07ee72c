"""Tests that an edited, truncated or damaged run folder is refused in one line with the location."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from errors import raises, states

from twin_gait import load_experiment, load_run, save_run, simulate
from twin_gait.cli import main
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_parquet

KNEE = "left_knee_angle_rad"
Damage = Callable[[Path], object]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = simulate(load_experiment("treadmill_guided", ["duration_s=2.5"]).experiment)
    return save_run(run, tmp_path_factory.mktemp("runs") / "walk", pictures=False)


def log(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Damage:
    return lambda folder: write_parquet(
        folder / "log.parquet", change(pd.read_parquet(folder / "log.parquet"))
    )


def cell(name: str, row: int, value: object) -> Damage:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        column = table[name].astype(str).astype(object)
        column.iloc[row] = value
        return table.assign(**{name: column})

    return log(change)


def text(file: str, change: Callable[[str], str]) -> Damage:
    return lambda folder: (folder / file).write_text(change((folder / file).read_text()))


def summary(change: Callable[[dict[str, Any]], Any]) -> Damage:
    return text("summary.json", lambda given: json.dumps(change(json.loads(given))))


DAMAGES: dict[str, tuple[Damage, str]] = {
    "no time": (log(lambda table: table.drop(columns="time_s")), ("log.parquet", "time_s")),
    "no knee": (log(lambda table: table.drop(columns=KNEE)), ("log.parquet", KNEE)),
    "no power": (
        log(lambda table: table.drop(columns="battery_power_W")),
        ("log.parquet", "battery_power_W"),
    ),
    "half of the columns": (
        log(lambda table: table.iloc[:, :40]),
        ("log.parquet", "left_knee_stop_torque_Nm", "92"),
    ),
    "text": (cell(KNEE, 3, "abc"), ("log.parquet", KNEE, "row 4", "abc")),
    "another phase": (cell("left_phase", 5, "dancing"), ("log.parquet", "left_phase", "row 6", "dancing")),
    "times": (log(lambda table: table[::-1]), ("log.parquet", "time_s", "row 1")),
    "a tick is missing": (log(lambda table: table.drop(index=7)), ("log.parquet", "time_s", "row 8")),
    "one row": (log(lambda table: table.iloc[:1]), ("transitions.csv", "tick", "0")),
    "no row": (log(lambda table: table.iloc[:0]), ("log.parquet",)),
    "no columns": (log(lambda table: table[[]]), ("log.parquet",)),
    "no log": (lambda folder: (folder / "log.parquet").unlink(), ("walk", "log.parquet")),
    "other bytes": (lambda folder: (folder / "log.parquet").write_bytes(b"x" * 99), ("walk",)),
    "tick": (
        text("transitions.csv", lambda given: given.replace("\n", "\n-5", 1)),
        ("transitions.csv", "tick", "-599"),
    ),
    "a list": (summary(lambda given: [given]), ("walk",)),
    "no number": (summary(lambda given: {**given, "wall_s": "x"}), ("walk", "x")),
    "trip": (summary(lambda given: {**given, "safety": {"tripped": True, "location": 3}}), ("walk",)),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_folder_is_refused_in_one_line(name: str, kept: Path, tmp_path: Path, capsys) -> None:
    damage, message = DAMAGES[name]
    folder = tmp_path / "walk"
    shutil.copytree(kept, folder)
    damage(folder)
    with raises(RunDirectoryError, *message):
        load_run(folder)
    for words in (
        ["plot", folder, "--out", tmp_path / "figures"],
        ["view", folder, "--out", tmp_path / "page.html"],
        ["view", kept, folder, "--out", tmp_path / "page.html"],
        ["export", folder, "--out", tmp_path / "log.csv"],
        ["export", folder, "--format", "opensim", "--out", tmp_path / "opensim"],
    ):
        assert main(list(map(str, words))) == 2, words
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert main(["replay", str(folder)]) in (0, 2)
    assert [path.name for path in tmp_path.iterdir()] == ["walk"]


def test_a_summary_without_its_measures_is_refused_by_the_page(kept: Path, tmp_path: Path, capsys) -> None:
    folder = tmp_path / "walk"
    shutil.copytree(kept, folder)
    summary(lambda given: {key: given[key] for key in given if key not in ("sides", "power")})(folder)
    assert main(["view", str(folder), "--out", str(tmp_path / "page.html")]) == 2
    assert states(capsys.readouterr().err, "summary.json")
    assert main(["export", str(folder), "--out", str(tmp_path / "log.csv")]) == 0


def test_phases_as_plain_text_are_accepted(kept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    shutil.copytree(kept, folder)
    log(lambda table: table.assign(left_phase=table["left_phase"].astype(str)))(folder)
    assert load_run(folder).log.equals(load_run(kept).log)


@pytest.mark.parametrize("ticks", [1, 2, 3])
def test_a_run_of_a_few_ticks_is_drawn_and_read_again(ticks: int, tmp_path: Path) -> None:
    run = simulate(load_experiment("treadmill_guided", [f"duration_s={ticks / 1000}"]).experiment)
    folder = save_run(run, tmp_path / "walk")
    assert load_run(folder).log.equals(run.log)
    assert main(["view", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    assert main(["export", str(folder), "--out", str(tmp_path / "log.csv")]) == 0
