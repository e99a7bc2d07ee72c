"""Tests that a run folder contains the files of the user and is readable without the originals."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from errors import raises

from twin_gait import load_experiment, load_run, save_run, simulate
from twin_gait.cli import main
from twin_gait.exceptions import TwinGaitError
from twin_gait.files import shipped_file
from twin_gait.live.journal import Journal, LogChunk, complete
from twin_gait.runs.user_files import FILES_FOLDER
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.viewer.visuals import load_visuals

MESH = "thigh.stl"


def original(name: str) -> Path:
    path = shipped_file(name)
    assert path is not None
    return path


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return a folder with own files: URDF with three kinds of mesh paths, DBC, person, table, modes."""
    folder = tmp_path / "lab"
    (folder / "robot" / "urdf").mkdir(parents=True)
    (folder / "robot" / "parts").mkdir()
    text = original("twin.urdf").read_text(encoding="utf-8")
    names = sorted({part.split('"')[0] for part in text.split('filename="')[1:]})
    for number, name in enumerate(names):
        source = original("twin.urdf").parent / name
        copy = folder / "robot" / "parts" / f"{number}{source.suffix}"
        shutil.copyfile(source, copy)
        ways = f"package://robot/parts/{copy.name}", f"../parts/{copy.name}", str(copy)
        text = text.replace(f'filename="{name}"', f'filename="{ways[number % 3]}"')
    (folder / "robot" / "urdf" / "leg.urdf").write_text(text, encoding="utf-8")
    dbc = original("twin.dbc").read_text(encoding="utf-8") + '\nCM_ "of this laboratory";\n'
    (folder / "bus.dbc").write_text(dbc, encoding="utf-8")
    (folder / "person.yaml").write_text("schema_version: 2\nname: p\nmass_kg: 71\nheight_m: 1.7\n")
    (folder / "table.yaml").write_text(
        "extends: treadmill_guided\nblending: {duration_ms: 35}\n", encoding="utf-8"
    )
    document = {
        "preset": "treadmill_guided", "duration_s": 0.4, "leg": {"urdf": "robot/urdf/leg.urdf"},
        "network": {"dbc": "bus.dbc"}, "patient": "person.yaml", "table": "table.yaml",
    }  # fmt: skip
    (folder / "mine.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return folder


def remove(folder: Path) -> None:
    shutil.rmtree(folder)


def change(folder: Path) -> None:
    for path in folder.rglob("*"):
        if path.is_file():
            path.write_bytes(b"something else")


@pytest.mark.parametrize("loss", [remove, pytest.param(change, marks=pytest.mark.slow)])
def test_a_run_is_read_drawn_and_repeated_without_the_original_files(
    loss: Callable[[Path], None], own: Path, tmp_path: Path, capsys
) -> None:
    run_folder = tmp_path / "here" / "walk"
    assert main(["simulate", str(own / "mine.yaml"), "--out", str(run_folder), "--unchecked"]) == 0
    first = load_run(run_folder)
    looks = load_visuals(first.experiment.build_world().model.model, own / "robot" / "urdf" / "leg.urdf")
    loss(own)
    moved = tmp_path / "elsewhere" / "walk"
    moved.parent.mkdir()
    (tmp_path / "here").rename(tmp_path / "elsewhere" / "there")
    (tmp_path / "elsewhere" / "there" / "walk").rename(moved)

    again = load_run(moved)
    assert again.log.equals(first.log)
    kept = load_visuals(again.experiment.build_world().model.model, Path(again.experiment.leg.urdf))
    assert [part.shape.vertices.tolist() for part in kept] == [part.shape.vertices.tolist() for part in looks]
    assert simulate(again.experiment).log.equals(first.log)
    second = tmp_path / "second"
    code = "import sys; from twin_gait.cli import main; sys.exit(main(sys.argv[1:]))"
    commands = (
        ["plot", str(moved), "--figure", "torques", "--out", str(tmp_path / "figures")],
        ["view", str(moved), "--out", str(tmp_path / "page.html")],
        ["export", str(moved), "--format", "candump", "--out", str(tmp_path / "can.log")],
        ["simulate", str(moved), "--no-pictures", "--unchecked", "--out", str(second)],
    )
    for command in commands:
        done = subprocess.run([sys.executable, "-c", code, *command], cwd="/", capture_output=True, text=True)
        assert done.returncode == 0 and "does not exist" not in done.stderr, done.stderr
    assert load_run(second).log.equals(first.log)

    document = yaml.safe_load((moved / "experiment.yaml").read_text(encoding="utf-8"))
    assert document["leg"]["urdf"] == "files/leg.urdf" and document["network"]["dbc"] == "files/bus.dbc"
    assert str(tmp_path) not in (moved / "experiment.yaml").read_text(encoding="utf-8")
    assert document["patient"]["mass_kg"] == 71.0 and document["table"]["blending"]["duration_ms"] == 35


def test_a_copy_that_was_changed_is_refused(own: Path, tmp_path: Path) -> None:
    run = simulate(load_experiment(own / "mine.yaml").experiment)
    folder = save_run(run, tmp_path / "walk", pictures=False)
    copy = folder / FILES_FOLDER / "leg.urdf"
    copy.write_text(copy.read_text(encoding="utf-8").replace("mass value", "mass  value"), encoding="utf-8")
    with raises(TwinGaitError, "urdf_sha256", "leg.urdf"):
        load_run(folder)


@pytest.mark.parametrize("preset", ["treadmill_guided", "bench_leg"])
def test_files_that_ship_are_named_and_not_copied(preset: str, tmp_path: Path) -> None:
    run = simulate(
        load_experiment(
            preset, ["duration_s=0.2", "network=can"] if preset == "treadmill_guided" else ["duration_s=0.2"]
        ).experiment
    )
    folder = save_run(run, tmp_path / "walk", pictures=False)
    document = yaml.safe_load((folder / "experiment.yaml").read_text(encoding="utf-8"))
    assert document["leg"]["urdf"] in ("twin.urdf", "twin_leg.urdf")
    assert not (folder / FILES_FOLDER).exists()
    assert load_run(folder).log.equals(run.log)


def test_a_path_from_the_working_folder_is_kept_too(own: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(own)
    loaded = load_experiment(
        "treadmill_guided", ["leg.urdf=robot/urdf/leg.urdf", "network.dbc=bus.dbc", "duration_s=0.2"]
    )
    monkeypatch.chdir(tmp_path)  # a script may go elsewhere before it saves
    run = simulate(loaded.experiment)
    folder = save_run(run, tmp_path / "walk", pictures=False)
    shutil.rmtree(own)
    assert load_run(folder).log.equals(run.log)


def test_a_live_walk_is_written_in_the_same_way(own: Path, tmp_path: Path) -> None:
    loaded = load_experiment(own / "mine.yaml", ["network=ideal"])
    run = simulate(loaded.experiment)
    columns = [name for name in run.log.columns if name != "time_s"]
    rows = run.log[columns].apply(lambda column: column.cat.codes if column.dtype == "category" else column)
    journal = Journal(
        columns, {"document": loaded.document, "folder": str(tmp_path / "walk"), "force": False}, print
    )
    journal.store(LogChunk(rows=rows.to_numpy(float), is_last=True))
    journal.close()
    assert len(build_setup(loaded.experiment).sides) == 2
    (folder,) = complete(journal.path)
    shutil.rmtree(own)
    assert load_run(folder).log.shape == run.log.shape
    assert (folder / FILES_FOLDER / "leg.urdf").is_file()
