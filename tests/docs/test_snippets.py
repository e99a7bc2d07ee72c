"""Tests that every block of code in README and pages runs: Python, YAML and shell commands.

Cells of *Start* and of the tutorials run when the site is built, diffs and scripts of the recipes in their
own tests, scripts of ``examples/`` in the gallery. What is left over runs here, in a folder that has the
files a reader would have.
"""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from example_robots import robot_urdf

from twin_gait import load_experiment, load_gait_table, simulate
from twin_gait.cli.program import main
from twin_gait.configuration.device_file import load_device
from twin_gait.configuration.gait_table_file import load_mode_table
from twin_gait.gait.machine import GaitStateMachine

ROOT = Path(__file__).parents[2]
CONFIGURATION = ROOT / "twin_gait" / "configuration"
SECTIONS = ("background", "reference", "tutorials")
PAGES = [
    ROOT / "README.md",
    *(page for name in SECTIONS for page in sorted((ROOT / "docs" / name).glob("*.md"))),
]
BLOCK = re.compile(r"^( *)```(python|yaml|sh)\n(.*?)^ *```", flags=re.DOTALL | re.MULTILINE)
# Commands that run until they are stopped, need other machines or files of a lab, or set up an environment.
NOT_HERE = (
    "trial.c3d",
    "people_phase.parquet",
    "pip ",
    "twin-gait live",
    "twin-gait view",
    "dask",
    "make ",
    "python ",
    "git ",
    "pytest ",
    "--scheduler",
)
# Blocks that identify, sweep, or simulate a day.
LONG = {
    *("identification-0", "modes-1", "faults-0", "network-0", "robustness_map-0"),
    *("running-2", "learning-0", "train_a_controller-0", "blending-0", "firmware-2"),
}
# For blocks that show what is inside of a class.
HEADER = """from __future__ import annotations
from dataclasses import dataclass
from typing import Annotated, ClassVar
from twin_gait.parameters.quantities import NOT_NEGATIVE, RotaryDamping
from twin_gait.vocabulary import PelvisGuide
from twin_gait.worlds.world import Scenario
"""


def blocks(language: str) -> list[pytest.param]:
    """Return the code blocks of a language by page and number."""
    found = []
    for page in PAGES:
        texts = [
            re.sub(f"^{indent}", "", text, flags=re.MULTILINE)
            for indent, kind, text in BLOCK.findall(page.read_text(encoding="utf-8"))
            if kind == language
        ]
        found += [pytest.param(text, id=f"{page.stem}-{number}") for number, text in enumerate(texts)]
    return found


@pytest.fixture(scope="module")
def user_files(tmp_path_factory):
    """Return a folder with the files that the pages use: tables, experiments, a run, logs, a small sweep."""
    folder = tmp_path_factory.mktemp("desk")
    shutil.copy(CONFIGURATION / "tables" / "treadmill_guided.yaml", folder / "my_table.yaml")
    shutil.copy(CONFIGURATION / "modes" / "twin.yaml", folder / "my_modes.yaml")
    shutil.copy(CONFIGURATION / "presets" / "treadmill_guided.yaml", folder / "mine.yaml")
    shutil.copy(CONFIGURATION / "devices" / "twin.yaml", folder / "my_device.yaml")
    spec = yaml.safe_load((ROOT / "examples" / "sweep.yaml").read_text(encoding="utf-8"))
    spec["parameters"] = {"patient.mass_kg": [65, 75]}
    (folder / "examples").mkdir()
    (folder / "examples" / "sweep.yaml").write_text(yaml.safe_dump(spec), encoding="utf-8")
    time = np.arange(0.0, 60.0, 0.01)
    velocity = 2.0 * np.sin(time) * np.linspace(0.1, 1.0, time.size)
    torque = 1.5 * np.tanh(velocity / 0.05) + 0.8 * velocity
    series = pd.DataFrame({"t": time, "dq2": velocity, "tau2": torque})
    for number in (1, 2):
        series.to_csv(folder / f"arm_{number}.csv", index=False)
    hip, knee = 10 + 25 * np.sin(np.pi * time), 30 - 25 * np.cos(np.pi * time)
    pd.DataFrame({"t": time, "hip": hip, "knee": knee}).to_csv(folder / "gait.csv", index=False)
    motion = pd.DataFrame({"time": time, "hip_flexion_r": hip, "knee_angle_r": -knee})
    motion = motion.assign(hip_flexion_l=np.roll(hip, 100), knee_angle_l=-np.roll(knee, 100))
    head = f"walk\nnRows={len(motion)}\nnColumns=5\ninDegrees=yes\nendheader\n"
    (folder / "walk.mot").write_text(head + motion.to_csv(sep="\t", index=False), encoding="utf-8")
    out = ("--out", str(folder / "runs" / "walk"))
    assert main(["simulate", "treadmill_guided", "--duration", "8", "--no-pictures", *out]) == 0
    own = folder / "own.parquet"
    assert main(["export", str(folder / "runs" / "walk"), "--format", "locohub", "--out", str(own)]) == 0
    for name in ("trial1", "trial2"):
        pd.read_parquet(own).assign(subject="P03").to_parquet(folder / f"{name}.parquet")
    out = ("--out", str(folder / "logs"))
    assert main(["bench", "campaign", "--joint", "knee", "--protocol", "two-way", *out]) == 0
    return folder


def run_line(line: str) -> None:
    """Run a line of the shell that calls the program, without a shell.

    Pictures and the proof of printed C take minutes in all and have tests of their own.
    """
    words = shlex.split(re.sub(r"\s*>\s*\S+$", "", line))
    assert words[0] == "twin-gait", f"{line}: who runs this?"
    files = {word: sorted(map(str, Path().glob(word))) for word in words if "*" in word}
    words = [name for word in words[1:] for name in files.get(word, [word])]
    try:
        words = [word for word in words if word not in ("--view", "--verify")]
        status = main([*words, "--no-pictures"] if words[0] == "simulate" else words)
    except SystemExit as leave:  # --print-completion
        status = leave.code
    assert status == 0, line


def lines_here(block: str) -> list[str]:
    """Return the commands of a block that can run here, without comments."""
    lines = (re.split(r" +# ", line)[0].strip() for line in block.replace("\\\n", " ").splitlines())
    return [line for line in lines if line and not any(word in line for word in NOT_HERE)]


def commands() -> list[pytest.param]:
    """Return the blocks of commands that can run here; long ones are slow tests."""
    found = [item for item in blocks("sh") if lines_here(item.values[0])]
    assert {item.id for item in found} >= LONG
    return [
        pytest.param(*item.values, id=item.id, marks=[pytest.mark.slow] * (item.id in LONG)) for item in found
    ]


@pytest.mark.parametrize("block", commands())
def test_commands_run_in_the_order_of_their_block(block, user_files, tmp_path, monkeypatch):
    shutil.copytree(user_files, tmp_path / "desk")
    monkeypatch.chdir(tmp_path / "desk")
    if "human.urdf" in block:
        shutil.copy(robot_urdf("human_description/robots/human.urdf"), "human.urdf")
    for line in lines_here(block):
        run_line(line)


@pytest.fixture(scope="module")
def requested_run():
    """Return a run with requests of modes, as on the pages."""
    settings = ["duration_s=6", "modes=twin", "initial_mode=standing", "requests=[sit@5s]"]
    return simulate(load_experiment("overground", settings).experiment)


@pytest.mark.parametrize("block", blocks("python"))
def test_python_runs(block, requested_run, user_files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(user_files / "my_table.yaml", "my_leg.yaml")
    names = {
        "run": requested_run,
        "my_machine": lambda phase: GaitStateMachine(load_gait_table("my_leg.yaml"), phase),
    }
    exec(compile(HEADER + block, "page", "exec"), names)


def laid_over(below: Any, above: Any) -> Any:
    """Return a document with the keys shown on a page merged into it."""
    if not (isinstance(below, dict) and isinstance(above, dict)):
        return above
    return below | {key: laid_over(below.get(key), value) for key, value in above.items()}


@pytest.mark.parametrize("block", blocks("yaml"))
def test_yaml_loads(block, user_files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in user_files.glob("*.parquet"):
        shutil.copy(path, tmp_path)
    data = yaml.safe_load(block)
    path = Path("mine.yaml")
    if isinstance(data, list):
        data = {"schema_version": 2, "extends": "treadmill_guided", "name": "mine", "transitions": data}
    elif "schema_version" not in data and not isinstance(data.get("modes"), dict):
        name = "overground.yaml" if "modes" in data else "treadmill_guided.yaml"
        preset = CONFIGURATION / "presets" / name
        data = laid_over(yaml.safe_load(preset.read_text(encoding="utf-8")), data)
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    if isinstance(data.get("modes"), dict):
        load_mode_table(path)
    elif "transitions" in data or "scaling" in data:
        load_gait_table(path)
    elif "extends" in data and "plant" in data:
        load_device(str(path))
    else:
        load_experiment(path)
