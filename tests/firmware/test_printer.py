"""Tests that printed functions, compiled with double numbers, give the same bits as Python."""

from __future__ import annotations

import copy
import math
import random
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, get_type_hints

import pytest
from firmware_tools import require_tools
from printed_library import CLibrary

from twin_gait import load_experiment
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.control import device_schedule, gait_controller, joint_board
from twin_gait.core import elementary
from twin_gait.core.actuator import Motor
from twin_gait.core.blending import blend_share
from twin_gait.core.control_tick import (
    ImpedanceSetpoint,
    blend_setpoint,
    measure_joint,
    new_encoder,
    target_current,
)
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.guards import evaluate_guard, next_transition
from twin_gait.core.impedance import impedance_torque
from twin_gait.core.safety import NO_TRIP, Bounds, MonitorState, monitor_joint
from twin_gait.firmware import units
from twin_gait.firmware.printer import Program, TranslationUnit, print_units
from twin_gait.gait.program import compile_guards
from twin_gait.kernels.generated import write_control_gravity, write_merged_functions
from twin_gait.simulation.binding import kernel_functions, specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.simulation_setup import build_setup

ODD = [0.0, -0.0, 1.0, -1.0, 5e-324, 1e308, math.inf, -math.inf, math.nan]
BOUNDS = Bounds(
    *(-0.5, 0.5, 4.0, 0.05, 0.1, 0.3, 3, 0.01, 0.05, 30.0, 4, 60.0),
    *(5.0, 0.1, 20.0, 1e-3, 1e-4, 2.0, 5, 7.0, 0.5),
)


def first_multiple_above(x: float, y: float, z: float) -> float:
    """Use a loop that ends early, extrema of three numbers, and an assignment to several names."""
    found = unfound = 0.0
    for number in range(5):
        if number * x > y:
            found = float(number)
            break
    return min(found, max(x, y, z), z) + unfound


LAWS = [
    measure_joint,
    next_transition,
    evaluate_guard,
    blend_setpoint,
    blend_share,
    impedance_torque,
    monitor_joint,
    target_current,
    rotational_friction_torque,
    elementary.exponential,
    elementary.settled_share,
    elementary.hyperbolic_tangent,
    elementary.sine_cosine,
    first_multiple_above,
]
STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


@pytest.fixture(scope="module")
def guards() -> Any:
    return compile_guards(load_gait_table("treadmill_guided"))


@pytest.fixture(scope="module")
def laws(guards) -> Program:
    samples = {"encoder": new_encoder(1e-3, 0.1, 10), "treadmill": guards}
    shapes = [BOUNDS, MonitorState(), Motor(1.0, 2.0, 3.0), ImpedanceSetpoint(1.0, 2.0, 3.0, 4.0)]
    return print_units([TranslationUnit("laws", LAWS, samples)], shapes=shapes)


@pytest.fixture(scope="module")
def library(laws) -> CLibrary:
    require_tools("gcc")
    return CLibrary(laws)


def numbers(draw: random.Random, count: int, spread: float = 3.0) -> list[float]:
    """Return random numbers of which one in ten is unusual (NaN, infinite, zero)."""
    return [draw.choice(ODD) if draw.random() < 0.1 else draw.uniform(-spread, spread) for _ in range(count)]


def bits(value: Any) -> Any:
    """Return a value that is equal for equal bits; all NaN are equal."""
    if isinstance(value, (list, tuple)):
        return [bits(item) for item in value]
    if isinstance(value, float):
        return "nan" if value != value else struct.pack("d", value)
    if hasattr(value, "__dataclass_fields__"):
        return [bits(getattr(value, name)) for name in value.__dataclass_fields__]
    return value


@pytest.mark.parametrize("law", [blend_share, *LAWS[5:6], *LAWS[8:]])
def test_laws_on_numbers(library, law):
    draw = random.Random(law.__name__)
    integer = law is blend_share
    for _ in range(3000):
        given = numbers(draw, law.__code__.co_argcount)
        if integer:
            given[1] = draw.randrange(3)
        if law is rotational_friction_torque:
            given[3] = given[3] or 0.3  # not zero, where Python raises and C does not
        if law is elementary.sine_cosine and abs(given[0]) > 1e9:
            continue  # where they mean nothing
        assert bits(library.call(law.__name__, *given)) == bits(law(*given)), given


def test_filters_of_an_encoder(library):
    draw = random.Random(1)
    for resolution in (0.0, 1e-3, 0.3):
        ours = new_encoder(resolution, 0.1, 10)
        theirs = copy.deepcopy(ours)
        for tick in range(1500):
            # Python raises at infinity, where a count has no number.
            reading = draw.choice([math.nan, -0.0, 1e300, *(draw.uniform(-1.0, 1.0) for _ in range(20))])
            given = (tick, reading, 1e-3, 0.18, 10)
            measure_joint(theirs, *given)
            library.call("measure_joint", ours, *given)
            assert bits(ours) == bits(theirs)


def test_an_infinite_reading_causes_no_undefined_conversion(library):
    encoder = new_encoder(1e-3, 0.1, 10)
    library.call("measure_joint", encoder, 1, math.inf, 1e-3, 0.18, 10)
    assert encoder.angle == math.inf


def test_the_machine_with_debounce_and_timeouts(library, guards):
    draw, table = random.Random(2), library.structure(guards)
    debounce = [0] * guards.n_transitions
    expected, found = list(debounce), set()
    for tick in range(20_000):
        if tick % 6 == 0:  # long enough for the longest debounce
            signals = numbers(draw, 13, 0.6)
            phase, other, ticks = draw.randrange(5), draw.randrange(-1, 5), draw.randrange(2000)
        transition = next_transition(guards, phase, ticks, signals, other, expected)
        assert library.call("next_transition", table, phase, ticks, signals, other, debounce) == transition
        assert debounce == expected
        found.add(transition)
    assert len(found) == guards.n_transitions + 1  # each one was taken, and none


def test_a_printed_table_is_the_one_of_python(library, guards):
    """The C function uses the constant of its source, not the argument."""
    table = type(library.structure(guards)).in_dll(library.handle, "treadmill")
    assert table.n_transitions == guards.n_transitions
    for theirs, ours in zip(guards.comparisons, table.comparisons[: len(guards.comparisons)], strict=True):
        assert (ours.signal_a, ours.factor_a, ours.threshold) == (
            theirs.signal_a,
            theirs.factor_a,
            theirs.threshold,
        )


def test_the_monitor_of_a_joint_finds_every_cause(library):
    draw, causes = random.Random(3), set()
    for _ in range(5000):
        values = numbers(draw, 7, 1.0)
        streaks = [draw.randrange(6) for _ in range(3)]
        ours = MonitorState(*(10.0 ** draw.uniform(-3, 2) * value for value in values), *streaks)
        encoder = new_encoder(0.0, draw.choice([0.0, draw.uniform(-0.6, 0.6), math.nan, math.inf]), 10)
        encoder.last_angle = encoder.angle + draw.choice([0.0, 0.01, 1.0])
        encoder.velocity_fast = draw.uniform(-5.0, 5.0)
        theirs = copy.deepcopy(ours)
        cause = monitor_joint(BOUNDS, theirs, encoder, 1e-3)
        assert library.call("monitor_joint", BOUNDS, ours, encoder, 1e-3) == cause
        assert bits(ours) == bits(theirs)
        causes.add(cause)
    assert len(causes) == 12  # eleven, and none


def test_limits_and_setpoints(library):
    draw = random.Random(4)
    for _ in range(1000):
        motor = Motor(0.1, 100.0, 0.5)
        given = *numbers(draw, 1, 100.0), 60.0, 5.0
        assert bits(library.call("target_current", motor, *given)) == bits(target_current(motor, *given))
        start, target, ours = (ImpedanceSetpoint(*numbers(draw, 4)) for _ in range(3))
        theirs, share = copy.deepcopy(ours), draw.random()
        blend_setpoint(start, target, share, theirs)
        library.call("blend_setpoint", start, target, share, ours)
        assert bits(ours) == bits(theirs)


# ------------------------------------------------------------------------- the functions of the device


EXCLUDED = {"controller_tick"}  # which the tick of the controller takes


def functions_of(module: ModuleType) -> list[FunctionType]:
    found = [item for item in vars(module).values() if isinstance(item, FunctionType)]
    # Those of the supervisor are printed where there is one: tests of the supervisor in C.
    found = [item for item in found if "supervisor" not in item.__code__.co_names]
    return [item for item in found if item.__module__ == module.__name__ and item.__name__ not in EXCLUDED]


def scrambled(record: Any, draw: random.Random) -> Any:
    """Return a copy with other numbers, except counts and indices."""
    made = copy.deepcopy(record)

    def scramble(value: Any) -> Any:
        if isinstance(value, list):
            return [scramble(item) for item in value]
        if isinstance(value, bool):
            return draw.random() < 0.5
        if isinstance(value, float):
            return numbers(draw, 1)[0]
        for name in getattr(value, "__slots__", ()):
            before = getattr(value, name)
            other = draw.randrange(3) if name.endswith(("cause", "chosen")) else scramble(before)
            setattr(value, name, draw.randrange(-1, 50) if name in ("tick", "entry_tick") else other)
        return value

    return scramble(made)


class Device(NamedTuple):
    """Episode, build flags, gravity kernel as text and in Python, and printed program."""

    episode: Any
    structure: dict[str, Any]
    text: str
    kernel: dict[str, Any]
    program: Program


CALLED = {"sine_cosine": elementary.sine_cosine}
# Without those of the kernel and of the supervisor.
ELSEWHERE = "control_gravity", "control_inertia", "compute_gravity", "compute_inertia", "apply_posture"
DEVICE_STEPS = [item for item in functions_of(device_schedule) if item.__name__ not in ELSEWHERE]


@pytest.fixture(scope="module")
def device() -> Device:
    problem = build_setup(load_experiment("treadmill_guided", ["control.assistance.hip=0.7"]).experiment)
    kernel, episode, constants = assemble(problem)
    structure = {**constants, **problem.controller.tick_functions()}
    text = write_control_gravity(kernel[2], kernel[3])
    text = "\n\n".join([*write_merged_functions(text), text])
    controlling = [*functions_of(gait_controller), *DEVICE_STEPS, device_schedule.control_gravity]
    parts = [
        TranslationUnit("joint_board", functions_of(joint_board), {"left_hip": episode.joints[0].board}),
        TranslationUnit("gait_controller", controlling, {"controller": episode.controller}),
    ]
    program = print_units(parts, {**structure, **CALLED}, text, [episode.rates, episode.limits])
    return Device(episode, structure, text, kernel_functions(text, CALLED), program)


@pytest.fixture(scope="module")
def device_library(device) -> CLibrary:
    require_tools("gcc")
    return CLibrary(device.program)


@pytest.mark.parametrize(
    "function",
    [*functions_of(joint_board), *functions_of(gait_controller), *DEVICE_STEPS],
    ids=lambda function: function.__name__,
)
def test_functions_of_board_and_gait_controller(device, device_library, function):
    episode, structure = device.episode, device.structure
    draw, names = random.Random(function.__name__), function.__code__.co_varnames
    bound, hints = specialize(function, structure), get_type_hints(function)
    samples = {
        "board": episode.joints[0].board,
        "controller": episode.controller,
        "joint": episode.controller.joints[1],
        "leg": episode.controller.legs[0],
        "rates": episode.rates,
        "limits": episode.limits,
        "heard": episode.controller.device_signals,
        "measurement": episode.controller.joints[0].measurement,
        "command": episode.joints[0].board.command,
        "demand": episode.controller.joints[0].setpoint,
    }

    def argument(name: str) -> Any:
        hint = hints[name]
        if hint == list[float]:
            return list(episode.controller.signals)
        if name in ("rates", "limits"):
            return samples[name]
        if hint in (float, bool, int):
            count = draw.randrange(2) if name in ("number", "part") else draw.randrange(1000)
            return {float: draw.uniform(-2.0, 2.0), bool: count % 2 == 0, int: count % 7}[hint]
        record = next(item for item in samples.values() if type(item) is hint)
        return scrambled(record, draw)

    compared = 0
    while compared < 60:
        given = [argument(name) for name in names[: function.__code__.co_argcount]]
        expected = copy.deepcopy(given)
        try:
            result = bound(*expected)
        except (ValueError, OverflowError, ZeroDivisionError):  # C has NaN and infinity instead
            continue
        compared += 1
        assert bits(device_library.call(function.__name__, *given)) == bits(result)
        assert bits(given) == bits(expected)


def test_the_gravity_kernel(device, device_library):
    episode, kernel = device.episode, device.kernel
    draw, model = random.Random(5), episode.controller.model
    for _ in range(500):
        q = [draw.uniform(-3.0, 3.0) for _ in model.q]
        ours, theirs = [0.0] * len(q), [0.0] * len(q)
        kernel["control_gravity"](q, model.bodies, model.gravity, theirs)
        device_library.call("control_gravity", q, model.bodies, model.gravity, ours)
        assert bits(ours) == bits(theirs)


def whole_unit(device: Device) -> tuple[units.Exoskeleton, Any, Any, Program]:
    """Return boards and gait controller as one unit, with inputs, outputs and C program."""
    episode = device.episode
    settings = units.UnitSettings(episode.rates, episode.limits, True)
    boards = [copy.deepcopy(joint.board) for joint in episode.joints]
    ours = units.Exoskeleton(settings, boards, copy.deepcopy(episode.controller))
    inputs = units.ExoskeletonInputs(
        [units.JointBoardInputs() for _ in boards], units.DirectInputs([0.0, 0.0])
    )
    outputs = units.ExoskeletonOutputs(
        [units.JointSetpoint() for _ in boards],
        [units.Command() for _ in boards],
        units.Decision([0, 0], [0, 0]),
    )
    unit = TranslationUnit("exoskeleton", [units.exoskeleton_step], {"exoskeleton": ours})
    constants = {**device.structure, **CALLED}
    return ours, inputs, outputs, print_units([unit], constants, device.text, [inputs, outputs])


def test_the_whole_unit_tick_by_tick(device):
    """Compare state and outputs at every tick under random inputs, before and after a trip."""
    require_tools("gcc")
    structure, kernel = device.structure, device.kernel
    ours, inputs, outputs, program = whole_unit(device)
    library, step = CLibrary(program), specialize(units.exoskeleton_step, {**structure, **kernel})
    draw = random.Random(6)
    for _ in range(4):
        theirs, found = copy.deepcopy(ours), copy.deepcopy(ours)
        state = library.structure(theirs)
        expected, given = copy.deepcopy(outputs), copy.deepcopy(outputs)
        angle, trips = [board.encoder.angle for board in ours.boards], set()
        for tick in range(1500):
            wild = 0.02 if tick > 700 else 0.0
            angle = [x + draw.uniform(-2e-3, 2e-3) for x in angle]
            for x, board in zip(angle, inputs.boards, strict=True):
                board.angle = math.nan if draw.random() < 0.1 * wild else x
                board.current = draw.uniform(-5.0, 5.0)
                board.voltage = 0.6 * board.current
                board.current_deviation = 3.0 * (draw.random() < wild)
            inputs.direct.loads = [draw.uniform(0.0, 1.0), draw.uniform(0.0, 1.0)]
            inputs.direct.bus_voltage = draw.uniform(45.0, 50.0)
            inputs.direct.device_signals.trunk_pitch = draw.uniform(-0.2, 0.2)
            step(theirs, inputs, expected)
            library.call("exoskeleton_step", state, inputs, given)
            assert bits(given) == bits(expected), tick
            trips.add(expected.decision.trip_cause)
            if trips == {NO_TRIP}:
                assert theirs.controller.signals[-3:] == [inputs.direct.device_signals.trunk_pitch, 1.0, 1.0]
        library.read_back(state, found)
        assert bits(found) == bits(theirs)
        assert len(trips) > 1


def test_unwritten_records_are_tables_in_flash(device):
    text = whole_unit(device)[-1].files["types.h"]
    assert "const ImpedanceSetpoint *setpoints;" in text and "ImpedanceSetpoint blended;" in text
    assert "const TransitionRule *transitions;" in text and "    int32_t target;" in text


def test_code_disabled_by_a_build_flag_is_not_printed(device):
    text = device.program.files["gait_controller.c"]
    assert "assistance_tick(" in text and "assisted[number].share" in text
    assert "adapted_assistance" not in text
    structure = device.structure
    unit = TranslationUnit(
        "demand", [gait_controller.compute_setpoint], {"controller": device.episode.controller}
    )
    plain = print_units([unit], {**structure, "WITH_CONTROLLER": False}, shapes=[device.episode.limits])
    assert "set_phase_setpoint" in plain.files["demand.c"]
    acted = print_units([unit], structure, shapes=[device.episode.limits])
    assert "set_phase_setpoint" not in acted.files["demand.c"]


# ------------------------------------------------------------------------- the quality of the C


def written(program: Program, folder: Path) -> list[Path]:
    for name, text in program.files.items():
        (folder / name).write_text(text)
    return sorted(folder.glob("*.c"))


def run(*words: Any) -> str:
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("more", [[], ["-DREAL_DOUBLE"]])
def test_compilers_report_no_warnings(laws, compiler, more, tmp_path):
    require_tools(compiler)
    for source in written(laws, tmp_path):
        assert run(compiler, *STRICT, *more, "-c", source, "-o", source.with_suffix(".o")) == ""


def test_every_file_has_a_header_and_the_hash_follows_the_sources(laws, guards):
    for name, text in laws.files.items():
        assert "Not a medical device." in " ".join(text.partition("*/")[0].split()), name
        if name.endswith(".h"):
            assert f"#ifndef TWIN_GAIT_{name.upper().replace('.', '_')}" in text

    def hash_of(entries: Sequence[Any], table: Any) -> str:
        return print_units([TranslationUnit("machine", entries, {"table": table})]).source_hash

    changed = copy.deepcopy(guards)
    changed.comparisons[0].threshold += 1e-9
    first = hash_of([next_transition], guards)
    assert first == hash_of([next_transition], copy.deepcopy(guards))
    assert len({first, hash_of([next_transition], changed), hash_of([evaluate_guard], guards)}) == 3
