"""Tests of the folder of ``twin-gait firmware``: it compiles, its numbers match the simulation, it fits."""

from __future__ import annotations

import ctypes
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from errors import raises, states
from firmware_tools import SANITIZE, require_tools, symbols
from printed_library import CLibrary
from test_printer import bits

from twin_gait import load_experiment
from twin_gait.cli.program import main
from twin_gait.core.safety import BUS_TRIP, COMMAND_TRIP, JUMP_TRIP, MISSING_TRIP, NO_TRIP
from twin_gait.exceptions import GaitTableError
from twin_gait.firmware import project, units
from twin_gait.firmware.cross import UnitSources, build_object, sizes
from twin_gait.firmware.exoskeleton_unit import record_vectors
from twin_gait.firmware.project import (
    EXOSKELETON,
    GAIT_CONTROLLER,
    JOINT_BOARD,
    UNITS,
    Project,
    print_project,
)
from twin_gait.gait.guards import AllOf, Comparison
from twin_gait.gait.program import DEVICE_BITS, compile_guards
from twin_gait.gait.table import TICK
from twin_gait.parameters.network import NetworkParameters
from twin_gait.simulation.record import deep_copy

STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
# Of each kind of code one; other numbers in the records are other numbers only.
SHIPPED = {
    "treadmill_guided": ("treadmill_guided",),
    "treadmill_ankle": ("treadmill_ankle",),
    "treadmill_start_stop": ("treadmill_start_stop",),
    "bench_leg": ("bench_leg",),
    "inertia and network": ("treadmill_guided", "control.inertia_compensation=0.5", "network={kind: can}"),
}
FUZZ = Path(__file__).with_name("fuzz.c")
MODES_TABLE = Path(__file__).parents[1] / "tables" / "treadmill_modes.yaml"


class Printed(NamedTuple):
    project: Project
    folder: Path


def run(*words: Any, cwd: Path | None = None) -> str:
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def camel_case(name: str) -> str:
    """``sine_cosine`` as a type is written, ``SineCosine``."""
    return "".join(word.capitalize() for word in name.split("_"))


@pytest.fixture(scope="module", params=SHIPPED)
def printed(request, tmp_path_factory) -> Printed:
    preset, *changes = SHIPPED[request.param]
    project, folder = print_project(load_experiment(preset, changes).experiment), tmp_path_factory.mktemp("c")
    project.write_sources(folder)
    return Printed(project, folder)


@pytest.fixture(scope="module")
def treadmill() -> Project:
    return print_project(load_experiment("treadmill_guided").experiment)


# ------------------------------------------------------------------------- the quality of the C


# clang warns before it compiles; gcc sees some things only as it optimises, which is the same for both reals.
@pytest.mark.parametrize(
    "command",
    [
        ["gcc"],
        ["gcc", "-fsyntax-only", "-DREAL_DOUBLE"],
        ["clang", "-fsyntax-only"],
        ["clang", "-fsyntax-only", "-DREAL_DOUBLE"],
    ],
)
def test_compilers_report_no_warnings(printed, command, tmp_path):
    require_tools(command[0])
    for name in UNITS:
        source = printed.folder / f"{name}.c"
        assert run(*command, *STRICT, "-c", source, "-o", tmp_path / "unit.o") == ""


def test_a_program_in_cpp_links_with_it_and_its_names_are_its_own(printed, tmp_path):
    require_tools("g++", "gcc", "nm")
    objects = [tmp_path / f"{name}.o" for name in UNITS]
    for name, made in zip(UNITS, objects, strict=True):
        run("gcc", "-O1", "-c", printed.folder / f"{name}.c", "-o", made)
    main = tmp_path / "main.cpp"
    main.write_text(
        "".join(f'#include "{name}.h"\n' for name in UNITS) + "int main() {\n"
        "  static Exoskeleton unit; static ExoskeletonInputs inputs; static ExoskeletonOutputs outputs;\n"
        "  exoskeleton_init(&unit); exoskeleton_step(&unit, &inputs, &outputs);\n"
        "  CanFrame frame; real values[16] = {1}; can_pack(&message_battery, values, &frame);\n}\n"
    )
    strict = ["-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{printed.folder}"]
    run("g++", *strict, main, *objects, "-o", tmp_path / "program")
    run(tmp_path / "program")
    own = tuple(f"{name}_" for name in (*UNITS[:-1], "can", "message"))
    lines = run("nm", "--format=posix", "--extern-only", "--defined-only", *objects).splitlines()
    shared = {line.split()[0] for line in lines if line and not line.endswith(":")}
    assert {"can_pack", "message_battery"} <= shared
    assert all(name.startswith(own) for name in shared), shared


def test_cppcheck_reports_nothing(printed):
    require_tools("cppcheck")
    checks = "--enable=warning,style,performance,portability"
    sources = [printed.folder / f"{name}.c" for name in UNITS]
    assert run("cppcheck", "--std=c99", "--error-exitcode=1", "-q", checks, *sources) == ""


MISRA = Path(project.__file__).with_name("project_files") / "MISRA.md"


@pytest.mark.parametrize(
    ("preset", "changes"),
    [
        pytest.param("treadmill_guided", (), marks=pytest.mark.slow),
        ("treadmill_start_stop", (f"table={MODES_TABLE}", "modes=twin", "initial_mode=standing")),
    ],
)
def test_stated_deviations_from_misra_match_cppcheck(preset, changes, tmp_path):
    require_tools("cppcheck")
    print_project(load_experiment(preset, changes).experiment).write_sources(tmp_path)
    output = run("cppcheck", "--addon=misra", "--std=c99", "-q", *(tmp_path / f"{name}.c" for name in UNITS))
    rows = [line.strip("| ").split(" | ") for line in MISRA.read_text().splitlines()]
    stated = {row[0]: row for row in rows if re.fullmatch(r"\d+\.\d+", row[0])}
    assert set(stated) == set(re.findall(r"\[misra-c2012-([\d.]+)\]", output))
    assert all(len(row) == 5 and row[1] in ("required", "advisory") for row in stated.values())


LIMITS = {JOINT_BOARD: (4096, 512), GAIT_CONTROLLER: (12 * 1024, 2048)}  # bytes of flash and RAM


def test_units_fit_and_need_no_library(printed, tmp_path):
    """RAM consists of the records of the unit, its inputs and its outputs, which the caller stores."""
    require_tools("arm-none-eabi-gcc")
    records = printed.folder / "records.c"
    names = [
        f"{kind}{part}" for kind in ("JointBoard", "GaitController") for part in ("", "Inputs", "Outputs")
    ]
    records.write_text(
        '#include "types.h"\n' + "".join(f"char of_{name}[sizeof({name})];\n" for name in names)
    )
    measured = build_object(UnitSources("records", printed.folder), tmp_path)
    for name in UNITS:
        made = build_object(UnitSources(name, printed.folder), tmp_path)
        flash, variables = sizes(made)
        assert variables == 0  # nothing global is written to
        wanted = {item for item, letter in symbols([made]).items() if letter == "U"}
        assert wanted <= {"memcpy", "memset", "memmove"}
        if name in LIMITS:
            listed = run("arm-none-eabi-nm", "-S", measured).splitlines()
            ram = sum(int(line.split()[1], 16) for line in listed if f"of_{camel_case(name)}" in line)
            assert flash <= LIMITS[name][0] and 0 < ram <= LIMITS[name][1]


def test_the_manifest_states_the_sizes_of_records(printed, tmp_path):
    require_tools("arm-none-eabi-gcc")
    sizes_stated = printed.project.manifest({"provenance": {}})["record_bytes"]
    records = printed.folder / "records.c"
    records.write_text(
        '#include "types.h"\n'
        + "".join(f"char of_{name}[sizeof({camel_case(name)})];\n" for name in sizes_stated)
    )
    measured = build_object(UnitSources("records", printed.folder), tmp_path)
    lines = [line.split() for line in run("arm-none-eabi-nm", "-S", measured).splitlines()]
    assert {words[3].removeprefix("of_"): int(words[1], 16) for words in lines} == sizes_stated


def fuzz(project: Project, folder: Path, count: int, *more: str) -> None:
    """Feed seeded NaN, infinities, stuck and jumping encoders; fuzz.c fails at a non-finite current."""
    require_tools("gcc")
    sources = [folder / f"{name}.c" for name in (EXOSKELETON, JOINT_BOARD, GAIT_CONTROLLER)]
    first = f"-DFIRST_BOARD={JOINT_BOARD}_{project.joints[0]}_init"
    phases = f"-DPHASES={len(project.setup.table.phases)}"
    program = folder / "fuzz"
    run("gcc", *STRICT[:5], *SANITIZE, *more, first, phases, f"-I{folder}", FUZZ, *sources, "-o", program)
    rows = [line.split() for line in run(program, count, 7).splitlines()]
    episodes, trips = (sum(int(row[column]) for row in rows) for column in (0, 1))
    assert episodes == count // 1000 and trips > 0.8 * episodes


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["-DREAL_DOUBLE"]])
def test_a_million_random_inputs_cause_no_undefined_behaviour(treadmill, tmp_path, more):
    treadmill.write_sources(tmp_path)
    fuzz(treadmill, tmp_path, 1_000_000, *more)


def test_random_inputs_cause_no_undefined_behaviour(treadmill, tmp_path):
    treadmill.write_sources(tmp_path)
    fuzz(treadmill, tmp_path, 50_000)


# ------------------------------------------------------------------------- the units apart


def test_separate_boards_and_gait_controller_equal_the_linked_unit(treadmill):
    """Without a bus a separate board receives a setpoint in the next tick; the linked unit has another order.

    Setpoints and phases are equal in every tick, and so is every current whose setpoint equals the one of
    the previous tick.
    """
    require_tools("gcc")
    library, linked = CLibrary(treadmill.program), treadmill.exoskeleton
    settings, joints = linked.record.settings, range(len(linked.record.boards))
    whole = library.structure(deep_copy(linked.record))
    boards = [
        library.structure(units.JointBoard(settings, deep_copy(board))) for board in linked.record.boards
    ]
    central = library.structure(units.GaitController(settings, deep_copy(linked.record.controller)))
    inputs, outputs = deep_copy(linked.inputs), deep_copy(linked.outputs)
    found = [units.JointBoardOutputs() for _ in joints]
    controller_inputs = units.GaitControllerInputs(
        inputs.direct, [item.measurement for item in found], [True] * 4
    )
    controller_outputs = units.GaitControllerOutputs(
        deep_copy(outputs.decision), [item.setpoint for item in inputs.boards]
    )
    phases, same, errors = set(), 0, []
    walk = replace(treadmill.setup.experiment, duration=2.5)
    for tick, row in enumerate(record_vectors(walk).inputs):
        for board, read in zip(inputs.boards, row["boards"], strict=True):
            board.angle, board.voltage = float(read["angle"]), float(read["voltage"])
            board.current, board.current_deviation = float(read["current"]), float(read["current_deviation"])
            board.received = tick > 0
        inputs.direct.loads[:] = row["direct"]["loads"].tolist()
        inputs.direct.bus_voltage = float(row["direct"]["bus_voltage"])
        for number in joints:
            library.call("joint_board_step", boards[number], inputs.boards[number], found[number])
        before = [bits(setpoint) for setpoint in controller_outputs.setpoints]
        library.call("exoskeleton_step", whole, inputs, outputs)
        library.call("gait_controller_step", central, controller_inputs, controller_outputs)
        assert bits(controller_outputs.decision) == bits(outputs.decision), tick
        phases.add(controller_outputs.decision.phases[0])
        for number, command in enumerate(outputs.commands):
            setpoint, given = controller_outputs.setpoints[number], found[number].command
            linked_setpoint = whole.boards[number].setpoint
            for name in ("stiffness", "damping", "equilibrium", "gain", "gravity", "inertia", "target"):
                assert getattr(linked_setpoint, name) == getattr(setpoint, name), (tick, number, name)
            if bits(setpoint) == before[number]:
                assert bits(given) == bits(command), (tick, number)
                same += 1
            else:
                errors.append(abs(given.target_current - command.target_current))
    assert len(phases) == len(treadmill.setup.table.phases)
    assert same > 1000 and len(errors) > 1000
    assert 0.0 < np.median(errors) < 0.05  # [A]: what an older set point costs


def test_an_invalid_command_trips_the_whole_linked_unit_or_its_separate_board(treadmill):
    require_tools("gcc")
    library, linked = CLibrary(treadmill.program), treadmill.exoskeleton
    settings = linked.record.settings
    wild = deep_copy(linked.record)
    for joint in wild.controller.joints:
        joint.target = 1e4  # far above what is plausible
    whole, inputs, outputs = library.structure(wild), deep_copy(linked.inputs), deep_copy(linked.outputs)
    for board, state in zip(inputs.boards, linked.record.boards, strict=True):
        board.angle = state.encoder.angle
    inputs.direct.bus_voltage = 28.8
    library.call("exoskeleton_step", whole, inputs, outputs)
    assert outputs.decision.trip_cause == COMMAND_TRIP
    assert [board.setpoint.damping for board in whole.boards] == [settings.limits.hold_damping] * 4
    board = library.structure(units.JointBoard(settings, deep_copy(linked.record.boards[0])))
    setpoint = units.JointSetpoint(target=1e4, gravity=float("nan"))
    apart, found = (
        units.JointBoardInputs(inputs.boards[0].angle, setpoint=setpoint, received=True),
        units.JointBoardOutputs(),
    )
    library.call("joint_board_step", board, apart, found)
    assert board.state.setpoint.damping == settings.limits.hold_damping
    assert found.command.target_current == 0.0  # no weight is carried that is no number
    library.call("joint_board_step", board, apart, found)
    assert found.measurement.cause == COMMAND_TRIP


def new_boards(project: Project) -> tuple[CLibrary, list[Any], list[units.JointBoardInputs]]:
    """Return boards after their ``init`` in C, and inputs of a leg at the start of the walk."""
    library, boards, inputs = CLibrary(project.program), [], []
    for name, state in zip(project.joints, project.exoskeleton.record.boards, strict=True):
        board = library.structure(units.JointBoard(project.exoskeleton.record.settings, deep_copy(state)))
        library.handle[f"{JOINT_BOARD}_{name}_init"](ctypes.byref(board))
        boards.append(board)
        inputs.append(units.JointBoardInputs(state.encoder.angle))
    return library, boards, inputs


def test_a_board_starts_at_any_joint_angle(treadmill):
    """A real leg never starts within 0.02 rad of the start of the simulated walk."""
    require_tools("gcc")
    library, boards, inputs = new_boards(treadmill)
    found = units.JointBoardOutputs()
    for number, (board, read) in enumerate(zip(boards, inputs, strict=True)):
        read.angle += 0.3
        for tick in range(20):
            library.call("joint_board_step", board, read, found)
            assert found.measurement.cause == NO_TRIP, (number, tick)
        read.angle += 0.03  # that is a jump
        library.call("joint_board_step", board, read, found)
        assert found.measurement.cause == JUMP_TRIP


def test_an_encoder_that_is_missing_from_the_start_trips_its_board(treadmill):
    require_tools("gcc")
    library, (board, *_), (read, *_) = new_boards(treadmill)
    found, read.angle = units.JointBoardOutputs(), float("nan")
    for _ in range(2):
        library.call("joint_board_step", board, read, found)
        assert (found.measurement.cause, found.command.target_current) == (MISSING_TRIP, 0.0)


def test_separate_units_trip_on_silence_for_an_experiment_without_a_bus(treadmill):
    require_tools("gcc")
    assert treadmill.setup.experiment.network is None
    library, (board, *_), (read, *_) = new_boards(treadmill)
    found, silences = units.JointBoardOutputs(), round(NetworkParameters().board_timeout / TICK)
    read.setpoint, read.received = units.JointSetpoint(stiffness=100.0, equilibrium=read.angle + 0.1), True
    for _ in range(1 + silences):
        library.call("joint_board_step", board, read, found)
        assert found.measurement.cause == NO_TRIP and found.command.target_current > 0.5
        read.received = False
    library.call("joint_board_step", board, read, found)
    assert found.measurement.cause == BUS_TRIP and board.state.setpoint.stiffness == 0.0
    linked = treadmill.exoskeleton
    central = library.structure(
        units.GaitController(linked.record.settings, deep_copy(linked.record.controller))
    )
    library.handle[f"{GAIT_CONTROLLER}_init"](ctypes.byref(central))
    controller_inputs = units.GaitControllerInputs(
        deep_copy(linked.inputs.direct), [units.Measurement()] * 4, [True] * 4
    )
    controller_inputs.direct.bus_voltage = 28.8
    controller_outputs = units.GaitControllerOutputs(
        deep_copy(linked.outputs.decision), [units.JointSetpoint() for _ in range(4)]
    )
    for _ in range(1 + silences):
        library.call("gait_controller_step", central, controller_inputs, controller_outputs)
        assert controller_outputs.decision.trip_cause == NO_TRIP
        controller_inputs.received[2] = False
    library.call("gait_controller_step", central, controller_inputs, controller_outputs)
    assert (controller_outputs.decision.trip_cause, controller_outputs.decision.trip_part) == (BUS_TRIP, 2)


def test_a_missed_measurement_causes_no_second_acceleration():
    """Frames come in every second tick; a change of the velocity counts once."""
    require_tools("gcc")
    project = print_project(
        load_experiment("treadmill_guided", ["control.inertia_compensation=0.5"]).experiment
    )
    linked, library = project.exoskeleton, CLibrary(project.program)
    controller = deep_copy(linked.record.controller)
    central = library.structure(units.GaitController(linked.record.settings, controller))
    measurements = [units.Measurement() for _ in linked.record.boards]
    surroundings = deep_copy(linked.inputs.direct)
    surroundings.bus_voltage = 28.8
    controller_inputs = units.GaitControllerInputs(surroundings, measurements, [True] * 4)
    controller_outputs = units.GaitControllerOutputs(
        deep_copy(linked.outputs.decision), [units.JointSetpoint() for _ in range(4)]
    )
    rates = []
    for tick in range(200):
        controller_inputs.received = [tick % 2 == 0] * 4
        if tick % 2 == 0:
            measurements[0].last_velocity = measurements[0].velocity
            measurements[0].velocity = 0.004 * tick  # 4 rad/s²
        library.call("gait_controller_step", central, controller_inputs, controller_outputs)
        rates.append(central.state.joints[0].rate)
    np.testing.assert_allclose(np.mean(rates[-10:]), 4.0, rtol=0.01)


# ------------------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("firmware") / "c"
    assert main(["firmware", "treadmill_guided", "--out", str(out)]) == 0
    return out


def test_the_folder_is_complete_and_states_its_purpose(folder):
    names = {path.name for path in folder.iterdir()}
    assert {f"{name}.{end}" for name in UNITS for end in "ch"} <= names
    manifest = json.loads((folder / "manifest.json").read_text())
    text = (folder / "README.md").read_text()
    assert "MISRA.md" in text and "| 15.5 |" in (folder / "MISRA.md").read_text()
    assert manifest["source_sha256"][:16] in text and "{{" not in text and "{%" not in text
    document = yaml.safe_load((folder / "experiment.yaml").read_text())
    assert document["provenance"]["table_sha256"] == manifest["provenance"]["table_sha256"]
    for path in folder.glob("*.h"):
        assert "Not a medical device." in " ".join(path.read_text().partition("*/")[0].split())


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_commands_of_its_readme_run(folder, compiler):
    require_tools(compiler, "make", "arm-none-eabi-gcc")
    commands = (folder / "README.md").read_text().partition("```sh\n")[2].partition("```")[0].splitlines()
    assert len(commands) == 2
    for line in commands:
        output = run(*line.partition("#")[0].split(), f"CC={compiler}", cwd=folder)
        if "test" in line:
            assert "boards and gait controller apart: 0 ticks with other bits" in output
            assert re.search(r"generated inputs: \d{4,} lines, 0 with other bits", output)
            double, single = (text for text in output.splitlines() if "ticks:" in text)
            assert double.startswith("3000 ticks: 0 with other bits,")
            assert " 0 with a phase more than a tick away" in single
            assert 0.0 < float(single.split()[-3]) < 1e-4
    run("make", "clean", cwd=folder)


def test_the_runner_finds_a_difference(folder, tmp_path):
    require_tools("gcc", "make")
    rows = (folder / "vectors.csv").read_text().splitlines()
    words = rows[500].split(",")
    words[-4] = repr(float(words[-4]) + 0.5)  # a current
    (tmp_path / "vectors.csv").write_text("\n".join([*rows[:500], ",".join(words), *rows[501:]]) + "\n")
    for target in ("host", "double"):
        run("make", target, cwd=folder)
    for name in ("float", "double"):
        command = [folder / "build" / name, tmp_path / "vectors.csv", folder / "excitation.csv"]
        assert subprocess.run(command, capture_output=True, check=False).returncode == 1
    run("make", "clean", cwd=folder)


def test_a_folder_that_exists_is_replaced_with_force_only(folder, capsys, tmp_path):
    assert main(["firmware", "treadmill_guided", "--out", str(folder)]) == 2
    assert "--force" in capsys.readouterr().err
    (tmp_path / "mine.txt").write_text("")
    assert main(["firmware", "treadmill_guided", "--force", "--out", str(tmp_path)]) == 2
    assert states(capsys.readouterr().err, tmp_path) and (tmp_path / "mine.txt").exists()


@pytest.mark.parametrize(
    ("setting", "key", "supported"),
    [
        ("control.mode=position", "control.mode", "impedance"),
        ("control.assistance.adaptive=true", "control.assistance.adaptive", "false"),
        ("control.delay_ms=3", "control.delay_ms", "0"),
        ("network={kind: can, impedance: ccu}", "network.impedance", "board"),
    ],
)
def test_features_unsupported_in_c_are_refused_in_one_line(setting, key, supported, capsys, tmp_path):
    out = tmp_path / "c"
    assert main(["firmware", "treadmill_guided", "--unchecked", "--set", setting, "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert states(line, key, supported)
    assert not any(tmp_path.iterdir())


def test_a_guard_that_needs_more_than_32_bits_is_refused(treadmill):
    table = treadmill.setup.table
    guard = AllOf(guards=(Comparison(signal="hip.angle_deg", minus=None, operator="<", threshold=1.0),) * 31)
    transitions = tuple(replace(item, guard=guard) for item in table.transitions)
    with raises(GaitTableError, "31", "30"):
        compile_guards(replace(table, transitions=transitions), DEVICE_BITS)


def test_results_of_the_generated_dynamics_have_names_and_comments(printed):
    """No name of a line or a result is only a running number."""
    text = "".join((printed.folder / f"{name}.c").read_text() for name in (EXOSKELETON, GAIT_CONTROLLER))
    assert not re.findall(r"\bt\d+\b|\.number_\d+|\bvalue_\d+\b", text)
    body = text.partition("static void control_gravity(")[2].partition("\n}\n")[0]
    assert "    /* Forward pass, acceleration: " in body and "    /* Backward pass, torque: " in body
    assert re.search(r"const real sine_\w+ = \w+\.sine", body)
    assert "/* Compute the gravity torques. */\nstatic void control_gravity(" in text
