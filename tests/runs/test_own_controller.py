"""Tests that a run with an own controller is repeated with that controller, or refused in one line."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from errors import raises, states

from twin_gait import load_experiment, load_run, save_run, simulate
from twin_gait.control.controller import Controller
from twin_gait.control.controllers.position import Position
from twin_gait.control.user_controller import record_controller, restore_controller
from twin_gait.exceptions import FirmwareError, ParameterError, TwinGaitError
from twin_gait.firmware.project import require_printable
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate_blocks
from twin_gait.studies.compare.comparison import CONTROLLERS

POSTURES = """
SHARE = 0.9


class Postures:
    offset = 0.05
"""
SPRINGS = """
import numpy as np
from twin_gait.control.controller import Controller
from NAME_postures import Postures

STIFFNESS = 40.0


class Springs(Postures, Controller):
    def __init__(self, angle=0.2, curve=(0.0, 1.0), maker=None):
        self.angle, self.curve, self.weights = angle, [*curve], np.linspace(0.0, 1.0, 3)
        if maker is not None:
            self.maker = maker

    def setpoints(self, plan, side, rows):
        rows[:, 0], rows[:, 2] = STIFFNESS, self.angle + self.offset * self.curve[1] * self.weights[-1]
        return rows

    @staticmethod
    def tick(memory, device, tick, period):
        device.joints[0].setpoint.target = 2.0
"""


class Own:
    """Module of a user, its class, and a run with it."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self.file, self.base = folder / f"{name}.py", folder / f"{name}_postures.py"
        self.file.write_text(SPRINGS.replace("NAME", name), encoding="utf-8")
        self.base.write_text(POSTURES, encoding="utf-8")
        importlib.invalidate_caches()
        self.module = importlib.import_module(name)

    def run(self, *arguments: object, **more: object) -> Run:
        return simulate(bench(), controller=self.module.Springs(*arguments, **more))

    def forget(self) -> None:
        """Clear the import caches so that the next import reads the files."""
        for name in [name for name in sys.modules if name.startswith(self.name)]:
            del sys.modules[name]
        importlib.invalidate_caches()


def bench(*settings: str):
    return load_experiment("bench_leg", ["duration_s=0.3", *settings]).experiment


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Own:
    folder = tmp_path / "mine"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # a file may change twice within a second
    number = hashlib.sha256(request.node.name.encode()).hexdigest()[:8]
    found = Own(folder, f"springs_{number}")
    request.addfinalizer(found.forget)
    return found


# ------------------------------------------------------------------ run again


def test_the_run_of_a_saved_folder_is_the_same_in_python(own: Own, tmp_path: Path) -> None:
    run, standard = own.run(0.35, curve=(0.0, 2.0)), simulate(bench())
    folder = save_run(run, tmp_path / "walk", pictures=False)
    own.forget()
    stored = load_run(folder)
    assert stored.experiment == run.experiment or stored.experiment.controller == run.experiment.controller
    for experiment in (stored.experiment, load_experiment(folder).experiment):
        again = simulate(experiment)
        assert again.log.equals(run.log) and not again.log.equals(standard.log)
        assert again.experiment.controller == run.experiment.controller
    ((_, together),) = simulate_blocks([stored.experiment])
    assert together.log.equals(run.log)
    assert save_run(stored, tmp_path / "copy", pictures=False) and load_run(tmp_path / "copy").log.equals(
        run.log
    )


@pytest.mark.slow  # another process compiles the controller again
def test_the_run_of_a_saved_folder_is_the_same_on_the_command_line(own: Own, tmp_path: Path) -> None:
    run = own.run(0.35)
    folder = save_run(run, tmp_path / "walk", pictures=False)
    done = command(
        ["simulate", folder, "--unchecked", "--no-pictures", "--out", tmp_path / "again"], own.folder
    )
    assert done.returncode == 0, done.stderr
    assert load_run(tmp_path / "again").log.equals(run.log)


def command(words: list[object], *path: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path))}
    words = [sys.executable, "-m", "twin_gait", *words]
    return subprocess.run(list(map(str, words)), env=environment, capture_output=True, text=True, check=False)


def test_identity_of_a_controller_is_recorded(own: Own, tmp_path: Path) -> None:
    folder = save_run(own.run(0.35), tmp_path / "walk", pictures=False)
    kept = yaml.safe_load((folder / "experiment.yaml").read_text(encoding="utf-8"))["controller"]
    text = "".join(
        f"# module {path.stem}\n{path.read_text(encoding='utf-8')}" for path in (own.file, own.base)
    )
    digest = hashlib.sha256(text.encode()).hexdigest()
    assert kept["module"] == own.name and kept["class"] == kept["name"] == "Springs"
    assert kept["source"] == text and kept["source_sha256"] == digest
    assert kept["attributes"]["angle"] == 0.35 and kept["other_modules"] == [own.base.stem]
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    expected = {"name": "Springs", "module": own.name, "class": "Springs", "source_sha256": digest}
    assert summary["controller"].items() >= expected.items()
    assert "  source: |" in (folder / "experiment.yaml").read_text(encoding="utf-8")  # readable


def test_a_shipped_controller_is_identified_by_its_mode(tmp_path: Path) -> None:
    folder = save_run(simulate(bench("control.mode=gravity")), tmp_path / "walk", pictures=False)
    assert json.loads((folder / "summary.json").read_text())["controller"]["name"] == "gravity"
    assert "controller" not in yaml.safe_load((folder / "experiment.yaml").read_text())


# ------------------------------------------------------------------ without the module


@pytest.mark.slow  # another process compiles the controller again
def test_a_finished_run_is_read_without_the_module(own: Own, tmp_path: Path) -> None:
    run = own.run(0.35)
    folder = save_run(run, tmp_path / "walk", pictures=False)
    for words in (
        ["plot", folder, "--figure", "torques", "--out", tmp_path / "figures"],
        ["view", folder, "--out", tmp_path / "page.html"],
        ["export", folder, "--out", tmp_path / "log.csv"],
    ):
        done = command(words)
        assert done.returncode == 0, done.stderr
    own.file.unlink()
    own.forget()
    assert load_run(folder).log.equals(run.log)


def changed(own: Own) -> None:
    own.file.write_text(own.file.read_text() + "\n# another line\n", encoding="utf-8")


def changed_base(own: Own) -> None:
    own.base.write_text(own.base.read_text().replace("0.05", "0.07"), encoding="utf-8")


def no_class(own: Own) -> None:
    """Delete the class when the module is executed; the hash agrees."""
    sys.modules[own.name] = type(sys)(own.name)
    sys.modules[own.name].__spec__ = importlib.util.spec_from_file_location(own.name, own.file)


def other_constant(own: Own) -> None:
    own.module.STIFFNESS = 41.0


def other_attribute(own: Own) -> None:
    own.module.Springs.offset = 0.06


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda own: own.file.unlink(), ("Springs", "PYTHONPATH")),
        (changed, ("Springs", "source", "controller=null")),
        (changed_base, ("Springs", "source", "controller=null")),
        (no_class, ("Springs", "AttributeError")),
        (other_constant, ("STIFFNESS", "40.0", "41.0")),
        (other_attribute, ("Springs.offset", "0.06")),
    ],
)
def test_another_module_is_refused(
    change: Callable[[Own], object], message: tuple[object, ...], own: Own, tmp_path: Path
) -> None:
    folder = save_run(own.run(), tmp_path / "walk", pictures=False)
    if change in (changed, changed_base) or "PYTHONPATH" in message:
        own.forget()
    change(own)
    with raises(ParameterError, *message) as caught:
        simulate(load_run(folder).experiment)
    assert "\n" not in str(caught.value) and "simulate(load_experiment(RUN).experiment" in str(caught.value)
    # The ways out of the message.
    without = simulate(load_experiment(folder, ["controller=null"]).experiment)
    assert without.log.equals(simulate(bench()).log) and without.experiment.controller is None


def test_the_command_refuses_in_one_line(own: Own, tmp_path: Path) -> None:
    folder = save_run(own.run(), tmp_path / "walk", pictures=False)
    done = command(["simulate", folder, "--unchecked", "--out", tmp_path / "again"])
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert states(done.stderr, own.name) and not (tmp_path / "again").exists()


def test_code_in_a_run_folder_is_never_executed(own: Own, tmp_path: Path, monkeypatch) -> None:
    folder = save_run(own.run(), tmp_path / "walk", pictures=False)
    for path in (own.file, own.base):
        path.rename(folder / path.name)
    own.forget()
    monkeypatch.syspath_prepend(str(folder))
    with raises(ParameterError, "Springs", own.name, folder):
        simulate(load_run(folder).experiment)
    assert own.name not in sys.modules


def test_a_module_of_a_package_is_compared_before_anything_is_executed(tmp_path: Path, monkeypatch) -> None:
    package = tmp_path / "mine" / "laboratory"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise RuntimeError('executed')", encoding="utf-8")
    (package / "law.py").write_text("import os", encoding="utf-8")
    monkeypatch.syspath_prepend(str(package.parent))
    record = replace(record_controller(Position()), module="laboratory.law", class_name="Law")
    with raises(ParameterError, "Position", "laboratory.law"):
        restore_controller(record)


# ------------------------------------------------------------------ as it was made


class Held(Controller):
    """Controller with arbitrary attributes."""

    def __init__(self, **values: object) -> None:
        vars(self).update(values)


@pytest.mark.parametrize(
    "value",
    [
        0.1, -0.0, 1e-5, 1e22, float("inf"), 3, True, None, "π\n'", (1, (2.5, "a")), [1, [2]], {"a": (1,)},
        np.float32(0.1), np.array([[1, 2], [3, 4]]), np.array([0.1, 1e-300]), np.bool_(True),
    ],
    ids=repr,
)  # fmt: skip
def test_attributes_are_restored_exactly(value: object, tmp_path: Path) -> None:
    experiment = replace(bench(), controller=record_controller(Held(value=value)))
    run = simulate(bench("duration_s=0.001"))
    save_run(replace(run, experiment=experiment), tmp_path / "walk", pictures=False)
    record = load_experiment(tmp_path / "walk").experiment.controller
    assert record is not None and record == experiment.controller
    found = restore_controller(record).value  # type: ignore[attr-defined]
    assert type(found) is type(value) and repr(found) == repr(value)
    assert getattr(found, "dtype", None) == getattr(value, "dtype", None)


def test_objects_without_a_file_form_are_rebuilt_or_refused(own: Own) -> None:
    usual = record_controller(Position())  # its parameters are a dataclass
    assert usual.attributes is None and restore_controller(usual) == Position()
    other = record_controller(Position(path=replace(Position().path, damping_ratio=0.8)))
    with raises(ParameterError, "Position", "controller=null"):
        restore_controller(other)
    with raises(ParameterError, "Springs", "controller=null"):
        restore_controller(record_controller(own.module.Springs(maker=lambda: 1)))


@pytest.mark.parametrize(
    ("module", "name", "message"),
    [
        ("__main__", "Springs", ("Held", "script", "notebook")),
        ("tests", "f.<locals>.Springs", ("Held", "function")),
    ],
)
def test_a_controller_that_cannot_be_imported_is_refused_with_a_suggestion(
    module: str, name: str, message: tuple[object, ...]
) -> None:
    record = replace(record_controller(Held()), module=module, class_name=name)
    with raises(ParameterError, *message) as caught:
        simulate(replace(bench(), controller=record))
    assert "controller=Springs(…)" in str(caught.value)
    given = simulate(replace(bench(), controller=record), controller=Held())
    assert given.experiment.controller == record_controller(Held())


@pytest.mark.slow  # another process compiles the controller again
def test_a_script_records_its_source(tmp_path: Path) -> None:
    text = SPRINGS.replace("from NAME_postures import Postures\n", "").replace("(Postures, ", "(")
    text = text.replace("self.offset", "0.0") + (
        "\nfrom twin_gait import load_experiment, save_run, simulate\n"
        "run = simulate(load_experiment('bench_leg', ['duration_s=0.1']).experiment, controller=Springs())\n"
        "save_run(run, 'walk', pictures=False)\n"
    )
    (tmp_path / "script.py").write_text(text, encoding="utf-8")
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True)
    record = load_experiment(tmp_path / "walk").experiment.controller
    assert record is not None and record.module == "__main__" and record.source == text


# ------------------------------------------------------------------ other uses of such an experiment


def test_another_mode_replaces_it_only_if_it_is_removed(own: Own, tmp_path: Path) -> None:
    folder = save_run(own.run(), tmp_path / "walk", pictures=False)
    with raises(TwinGaitError, "control.mode", "controller=null"):
        load_experiment(folder, ["control.mode=gravity"])
    both = load_experiment(folder, ["control.mode=gravity", "controller=null"]).experiment
    assert both.controller is None and both.control.mode == "gravity"


def test_a_comparison_uses_its_own_controllers_and_the_firmware_refuses_own_controllers(own: Own) -> None:
    experiment = own.run().experiment
    fitting = [item for item in CONTROLLERS.values() if item.can_drive(experiment)]
    assert fitting and all(item.apply_to(experiment).controller is None for item in fitting)
    with raises(FirmwareError, "controller", "Springs", "controller=null"):
        require_printable(experiment)


def test_a_record_with_a_mistake_names_the_key(own: Own, tmp_path: Path) -> None:
    folder = save_run(own.run(), tmp_path / "walk", pictures=False)
    path = folder / "experiment.yaml"
    path.write_text(path.read_text().replace("source_sha256:", "hash:"), encoding="utf-8")
    with raises(TwinGaitError, "experiment.yaml", "controller.hash"):
        load_run(folder)
