"""The library of ``--target osl``, loaded by a stub of opensourceleg's CompiledController."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from firmware_tools import require_tools

from twin_gait import load_experiment
from twin_gait.cli.program import main
from twin_gait.control.safety import TripCause
from twin_gait.core.safety import MISSING_TRIP, NO_TRIP
from twin_gait.firmware.osl import write_osl
from twin_gait.firmware.project import EXOSKELETON, Project, print_project
from twin_gait.simulation.record import dtype_of

TICKS = 1500


class Controller:
    """Stub of the interface: a library, types, records of inputs and outputs, and a call with both."""

    types = ctypes

    def __init__(
        self,
        *,
        library_name: str,
        library_path: str,
        main_function_name: str,
        initialization_function_name: str | None,
        cleanup_function_name: str | None,
    ) -> None:
        library = ctypes.CDLL(str(Path(library_path, f"{library_name}.so")))
        self.main, self.inputs, self.outputs = library[main_function_name], None, None
        assert initialization_function_name is not None and cleanup_function_name is None
        library[initialization_function_name]()

    def define_inputs(self, fields: list[tuple[str, Any]]) -> None:
        self.inputs = type("Given", (ctypes.Structure,), {"_fields_": fields})()

    def define_outputs(self, fields: list[tuple[str, Any]]) -> None:
        self.outputs = type("Taken", (ctypes.Structure,), {"_fields_": fields})()

    def run(self) -> Any:
        self.main(ctypes.byref(self.inputs), ctypes.byref(self.outputs))
        return self.outputs


def written(folder: Path, preset: str) -> tuple[Project, ModuleType]:
    """Return a project, and its loader in Python, next to the library."""
    require_tools("gcc")
    project = print_project(load_experiment(preset).experiment)
    project.write_sources(folder)
    assert write_osl(project, folder) == folder / "osl" / "twin_gait_osl.so"
    spec = importlib.util.spec_from_file_location(f"osl_{preset}", folder / "osl" / "osl_controller.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return project, module


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> tuple[Project, ModuleType]:
    return written(tmp_path_factory.mktemp("osl"), "osl_prosthesis")


def motion(project: Project) -> np.ndarray:
    """Return the inputs of a made-up walk with all phases of the table, then a jump of the knee."""
    rows = np.zeros(TICKS, dtype_of(project.exoskeleton.inputs))
    angle = 2.0 * np.pi * np.arange(TICKS) / 1000.0
    rows["boards"]["angle"][:, 0] = 0.55 - 0.5 * np.cos(angle + 2.0)
    rows["boards"]["angle"][:, 1] = 0.15 * np.sin(angle)
    rows["direct"]["loads"][:, 0] = np.clip(0.8 * np.sin(angle) + 0.01 * np.sin(40 * angle), 0.0, None)
    rows["direct"]["bus_voltage"], rows["direct"]["device_signals"]["walk"] = 36.0, 1.0
    for joint, board in enumerate(project.exoskeleton.record.boards):
        speed = np.gradient(rows["boards"]["angle"][:, joint], 1e-3)
        rows["boards"]["voltage"][:, joint] = board.bounds.emf_constant * speed
    rows["boards"]["angle"][-50:, 0] += 0.3
    return rows


def give(controller: Any, project: Project, row: np.void, ticks: int = 1) -> None:
    """Write a row of inputs to the record of the library."""
    given = controller.inputs
    for number, joint in enumerate(project.joints):
        for name in ("angle", "voltage", "current", "current_deviation"):
            setattr(given, f"{joint}_{name}", row["boards"][name][number])
    given.left_load, given.bus_voltage = row["direct"]["loads"][0], row["direct"]["bus_voltage"]
    given.walk, given.ticks = row["direct"]["device_signals"]["walk"], ticks


def numbers(outputs: Any) -> dict[str, float]:
    return {name: getattr(outputs, name) for name, _ in outputs._fields_}


def test_every_tick_equals_the_controller_of_the_simulation_bit_for_bit(leg) -> None:
    project, module = leg
    rows, controller = motion(project), module.load_controller(Controller)
    sample = next(item for item in project.samples if item.name == EXOSKELETON)
    with project.python_unit(sample) as unit:
        expected = unit.exchange(rows)
    phases = set()
    for row, wanted in zip(rows, expected, strict=True):
        give(controller, project, row)
        outputs = controller.run()
        for number, joint in enumerate(project.joints):
            found = [
                getattr(outputs, f"{joint}_{name}")
                for name in ("current", "torque", "stiffness", "damping", "equilibrium", "held")
            ]
            command, setpoint = wanted["commands"][number], wanted["setpoints"][number]
            assert found == [
                command["target_current"], command["torque"], setpoint["stiffness"], setpoint["damping"],
                setpoint["equilibrium"], setpoint["held"],
            ]  # fmt: skip
        assert outputs.left_phase == wanted["decision"]["phases"][0]
        assert outputs.trip_cause == wanted["decision"]["trip_cause"]
        phases.add(module.PHASES[outputs.left_phase])
    assert len(phases) == 4  # the walk has every phase of the table
    assert list(TripCause)[expected["decision"]["trip_cause"][-60]].code == NO_TRIP
    assert module.TRIP_CAUSES[outputs.trip_cause] == "encoder_jump" and outputs.left_knee_held


def test_a_slower_loop_gives_the_ticks_between_two_readings_a_straight_line(leg) -> None:
    project, module = leg
    rows = motion(project)[:1000]
    slow, found = module.load_controller(Controller), []
    for row in rows[::5]:
        give(slow, project, row, ticks=5)
        found.append(numbers(slow.run()))
    fast = module.load_controller(Controller)  # starts the one controller of the library again
    before = None
    for row, wanted in zip(rows[::5], found, strict=True):
        for tick in range(1, 6):
            between = row.copy()
            if before is not None and tick < 5:
                start = before["boards"]["angle"]
                between["boards"]["angle"] = start + tick / 5 * (row["boards"]["angle"] - start)
            give(fast, project, between)
            last = numbers(fast.run())
        before = row
        assert last == wanted
    assert wanted["trip_cause"] == NO_TRIP


def test_a_loop_that_stalls_longer_than_the_timeout_of_a_board_trips(leg) -> None:
    project, module = leg
    rows, controller = motion(project), module.load_controller(Controller)
    for row, ticks, cause in ((0, 1, NO_TRIP), (20, 20, NO_TRIP), (41, 21, MISSING_TRIP)):
        give(controller, project, rows[row], ticks)
        assert controller.run().trip_cause == cause
    assert controller.outputs.left_knee_held and controller.outputs.left_ankle_held


def test_no_time_leaves_the_outputs_and_a_negative_time_trips(leg) -> None:
    project, module = leg
    rows, controller = motion(project), module.load_controller(Controller)
    give(controller, project, rows[0])
    before = numbers(controller.run())
    give(controller, project, rows[300], ticks=0)
    assert numbers(controller.run()) == before
    give(controller, project, rows[1])
    after = numbers(controller.run())
    assert after != before and after["trip_cause"] == NO_TRIP  # row 300 has left no trace
    give(controller, project, rows[2], ticks=-1)
    assert controller.run().trip_cause == MISSING_TRIP


def test_the_actuators_of_the_library_are_read_and_commanded_in_their_units(leg) -> None:
    _, module = leg
    controller, commanded = module.load_controller(Controller), {}

    def actuator(joint: str, angle: float) -> SimpleNamespace:
        command = lambda value: commanded.update({joint: value})  # noqa: E731
        readings = {"motor_current": 250.0, "motor_voltage": -1200.0, "battery_voltage": 36000.0}
        return SimpleNamespace(output_position=angle, set_motor_current=command, **readings)

    actuators = {"left_knee": actuator("left_knee", 0.2), "left_ankle": actuator("left_ankle", -0.1)}
    outputs = module.step(controller, actuators, {"left": 0.6}, ticks=1)
    given = controller.inputs
    assert (given.left_knee_angle, given.left_ankle_angle, given.left_load) == (0.2, -0.1, 0.6)
    assert (given.left_knee_voltage, given.left_knee_current, given.bus_voltage) == (-1.2, 0.25, 36.0)
    assert given.left_knee_current_deviation == 0.25  # nothing was commanded before the first step
    first = outputs.left_knee_current
    assert first != 0.0 and commanded["left_knee"] == 1e3 * first
    module.step(controller, actuators, {"left": 0.6}, ticks=1)
    assert given.left_knee_current_deviation == 0.25 - first


@pytest.mark.parametrize("preset", ["osl_prosthesis", "day", "treadmill_ankle"])
def test_the_loader_declares_the_records_of_the_header(preset, leg, tmp_path) -> None:
    project, module = leg if preset == "osl_prosthesis" else written(tmp_path, preset)
    if preset == "day":
        assert {"request", "mode"} <= {name for name, _ in module.INPUTS + module.OUTPUTS}
    header = (Path(module.__file__).parent / "osl.h").read_text()
    for name, fields in (("Inputs", module.INPUTS), ("Outputs", module.OUTPUTS)):
        body = header[: header.index(f"}} {name};")].rpartition("typedef struct {")[2]
        declared = re.findall(r"^ +(\w+) (\w+);", body, re.MULTILINE)
        kinds = {"int32_t": "c_int32", "double": "c_double"}
        assert [(field, kinds[kind]) for kind, field in declared] == fields
    assert project.joints == module.JOINTS


def test_the_command_writes_the_library_or_says_that_gcc_is_missing(tmp_path, capsys, monkeypatch) -> None:
    require_tools("gcc")
    words = ["firmware", "bench_leg", "--duration", "0.2", "--target", "osl"]
    assert main([*words, "--out", str(tmp_path / "c"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["library"] == "osl/twin_gait_osl.so"
    assert (tmp_path / "c" / "osl" / "twin_gait_osl.so").is_file()
    monkeypatch.setenv("PATH", "")
    assert main([*words, "--out", str(tmp_path / "other")]) == 0
    assert "make -C osl" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "other" / "osl").iterdir()}
    assert names == {"Makefile", "osl.c", "osl.h", "osl_controller.py"}
    for more in ([], ["--verify"]):
        assert main([*words, *more]) == 2
        assert "--out" in capsys.readouterr().err
