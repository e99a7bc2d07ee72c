"""Controllers of one's own, in both engines, and what is refused of them."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numba
import numpy as np
import pytest
from errors import raises, warns

from twin_gait import load_experiment, simulate
from twin_gait.control.controller import Controller, find_cycle_interval
from twin_gait.control.controllers import CONTROLLERS
from twin_gait.control.controllers.position import Position
from twin_gait.control.safety import TripCause
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.device import ControlMode
from twin_gait.experiment.experiment import Experiment
from twin_gait.simulation import code_cache
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.simulator import SlowControllerWarning
from twin_gait.vocabulary import JointName, Side


def bench(*settings: str) -> Experiment:
    return load_experiment("bench_leg", ["duration_s=0.5", *settings]).experiment


# ------------------------------------------------------------------ twenty lines


@dataclass(slots=True)
class Fading:
    """Share of the springs that is left, by leg."""

    left: list[float]


class FadingHelp(Controller):
    """Takes a tenth of its springs from a leg with every stride."""

    def initial_memory(self, plan):
        return Fading([1.0] * len(plan.sides))

    @staticmethod
    def tick(memory, device, tick, period):
        per_leg = len(device.joints) // len(device.legs)
        for number in range(len(device.legs)):
            leg = device.legs[number]
            if leg.phase == 0 and leg.entry_tick == tick > 0:
                memory.left[number] = max(0.8, 0.9 * memory.left[number])
            for index in range(per_leg * number, per_leg * (number + 1)):
                device.joints[index].setpoint.stiffness *= memory.left[number]


@pytest.mark.slow
def test_a_controller_of_twenty_lines_has_memory_by_leg_and_reads_phases():
    settings = ["duration_s=4", "engine=pinocchio"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment, controller=FadingHelp())
    problem = build_setup(run.experiment)
    for number, side in enumerate(problem.sides):
        codes = np.asarray(run.log[f"{side}_phase"].cat.codes)
        strides = np.flatnonzero((codes[1:] == 0) & (codes[:-1] != 0)) + 1
        ends = np.flatnonzero((codes[1:] != 0) & (codes[:-1] == 0))  # nearly faded
        end = ends[ends > strides[0]][-1]
        share = max(0.8, 0.9 ** (strides < end).sum())
        assert share < 1.0
        given = run.log[f"{side}_knee_stiffness_Nm_per_rad"].iloc[end]
        assert given == pytest.approx(share * problem.phase_rows[number, 0, 4], rel=0.02)


# ------------------------------------------------------------------ engines


class Weaker(Controller):
    """Half the spring, no friction compensation, and a law of the package."""

    @staticmethod
    def tick(memory, device, tick, period):
        before, share = find_cycle_interval(tick * period, 101)
        for joint in device.joints:
            joint.setpoint.stiffness *= 0.5
            joint.setpoint.gain = 0.0
            joint.setpoint.target = 0.01 * (before + share)


def test_an_own_controller_acts_in_both_engines():
    compiled, standard = simulate(bench(), controller=Weaker()), simulate(bench())
    stepping = f"integration={{method: {compiled.experiment.resolved_integration.method}, step_ms: 1}}"
    stepped = simulate(bench("engine=pinocchio", stepping), controller=Weaker())
    assert not compiled.log["right_hip_friction_compensation_torque_Nm"].any()
    assert standard.log["right_hip_friction_compensation_torque_Nm"].any()
    np.testing.assert_allclose(compiled.log["right_hip_target_torque_Nm"], compiled.log["time_s"], atol=1e-9)
    for column in ("right_knee_angle_rad", "right_hip_motor_torque_Nm"):
        np.testing.assert_allclose(compiled.log[column], stepped.log[column], atol=1e-9)


@pytest.mark.slow
def test_assistance_scales_the_command_of_the_controller():
    run = simulate(bench("control.assistance.knee=0.5"), controller=Weaker())
    full = build_setup(bench()).phase_rows[0, :, [0, 4]]
    first = run.log.iloc[0]
    assert first["right_hip_stiffness_Nm_per_rad"] == 0.5 * full[0][0]
    assert first["right_knee_stiffness_Nm_per_rad"] == 0.25 * full[1][0]


def test_a_controller_that_is_compiled_by_its_writer_is_compiled_once():
    controller, compilations = controller_with(numba.njit(halve)), []
    first, made = simulate(bench(), controller=controller), len(code_cache._loops)
    second = simulate(bench(), controller=controller, on_compile=lambda: compilations.append(1))
    assert len(code_cache._loops) == made and not compilations
    assert first.log.equals(second.log)


def halve(memory, device, tick, period):
    for joint in device.joints:
        joint.setpoint.stiffness *= 0.5


class Counts:
    """A tick that numba cannot compile."""

    def __init__(self, answer=None) -> None:
        self.calls, self.answer = 0, answer

    def __call__(self, memory, device, tick, period):
        self.calls += 1
        return self.answer


def controller_with(tick_, **more) -> Controller:
    """An instance of a class of one's own."""
    return type("Mine", (Controller,), {"tick": staticmethod(tick_), **more})()


def test_a_controller_that_cannot_be_compiled_works_with_a_notice():
    counts = Counts()
    with warns(SlowControllerWarning, "Mine"):
        run = simulate(bench("duration_s=0.1"), controller=controller_with(counts))
    assert run.status == "completed" and counts.calls == 100


def test_a_tick_with_bytecode_unknown_to_numba_runs_in_python():
    def imports(memory, device, tick, period):
        import math

        device.joints[0].setpoint.target = math.sin(0.01 * tick)

    with pytest.warns(SlowControllerWarning):
        run = simulate(bench("duration_s=0.05"), controller=controller_with(imports))
    assert run.log["right_hip_target_torque_Nm"].iloc[-1] == pytest.approx(np.sin(0.49))


def test_setpoints_alone_cost_no_tick_and_replace_the_modes():
    class Soft(Controller):
        def setpoints(self, plan, side, rows):
            rows[:, 0] = 10.0
            return rows

    run = simulate(bench("control.mode=position"), controller=Soft())
    assert set(run.log["right_hip_stiffness_Nm_per_rad"]) == {10.0}
    problem = build_setup(bench(), Soft())
    assert not assemble(problem)[2]["WITH_CONTROLLER"] and not problem.controller.tick_functions()


# ------------------------------------------------------------------ what is refused


def too_few(memory, device):
    pass


def answers(memory, device, tick, period):
    return 1.0


def text(memory, device, tick, period):
    device.joints[0].setpoint.stiffness = "soft"


def complex_number(memory, device, tick, period):
    device.joints[0].setpoint.target = 1j


class Draws:
    pass


@dataclass(slots=True)
class Words:
    """No record: it has a text."""

    share: float
    name: str = "no number"


@dataclass(slots=True)
class Ragged:
    """No record: its lists are unlike."""

    rows: list[list[float]]


@dataclass(slots=True)
class Counted:
    """Whole numbers."""

    strides: int
    by_joint: list[int]


def counts_halves(memory, device, tick, period):
    memory.strides += 0.5


def counts_halves_by_joint(memory, device, tick, period):
    for number in range(len(device.joints)):
        memory.by_joint[number] += 0.5


def counted(self, plan):
    return Counted(0, [0, 0])


NO_MEMORY = ("memory", "dataclass", "slots")
TAKES = "tick(memory, device, tick, period)"
WRONG = {
    "a function": (halve, ("halve", "Controller", "<class 'function'>")),
    "the class": (
        Weaker,
        ("Controller", "class", "Weaker()"),
    ),
    "arguments": (
        controller_with(too_few),
        ("tick(memory, device, tick, period)", "tick(memory, device)"),
    ),
    "a method": (
        type("Mine", (Controller,), {"tick": halve})(),
        ("tick(memory, device, tick, period)", "tick(device, tick, period)"),
    ),
    "an answer": (
        controller_with(answers),
        ("tick",),
    ),
    "a text": (controller_with(text), ("setpoint.stiffness", "soft")),
    "a complex number": (controller_with(complex_number), ("setpoint.target", "1j")),
    "setpoints": (
        controller_with(halve, setpoints=lambda self, plan, side, rows: rows[1:]),
        ("setpoints", "(5, 9)"),
    ),
    "setpoints that are none": (
        controller_with(halve, setpoints=lambda self, plan, side, rows: None),
        ("setpoints", "(5, 9)", "None"),
    ),
    "a setpoint that is not finite": (
        controller_with(halve, setpoints=lambda self, plan, side, rows: rows * np.nan),
        ("setpoints", "(5, 9)", "nan"),
    ),
    "a memory": (
        controller_with(halve, initial_memory=lambda self, plan: {"share": 1.0}),
        NO_MEMORY,
    ),
    "a plain memory": (
        controller_with(halve, initial_memory=lambda self, plan: Draws()),
        NO_MEMORY,
    ),
    "words": (controller_with(halve, initial_memory=lambda self, plan: Words(1.0)), NO_MEMORY),
    "a float that would be cut": (
        controller_with(counts_halves, initial_memory=counted),
        ("strides", "int", "float"),
    ),
    "a float that would be cut in a list": (
        controller_with(counts_halves_by_joint, initial_memory=counted),
        ("by_joint", "int", "float"),
    ),
    "a float at the start": (
        controller_with(halve, initial_memory=lambda self, plan: Counted(0, [0, 0.5])),
        ("by_joint", "int", "float"),
    ),
    "rows": (
        controller_with(halve, initial_memory=lambda self, plan: Ragged([[1.0], [1.0, 2.0]])),
        NO_MEMORY,
    ),
}


@pytest.mark.filterwarnings("ignore::twin_gait.simulation.simulator.SlowControllerWarning")
@pytest.mark.parametrize("engine", ["compiled", "pinocchio"])
@pytest.mark.parametrize("wrong", WRONG)
def test_a_controller_that_is_wrong_is_named_in_one_line(wrong, engine):
    controller, message = WRONG[wrong]
    with raises(ParameterError, *message) as caught:
        simulate(bench("duration_s=0.1", f"engine={engine}"), controller=controller)
    assert "\n" not in str(caught.value) and re.match("controller '(Mine|Weaker|halve)': ", str(caught.value))


def test_a_float_that_a_called_function_would_cut_is_refused():
    helper = numba.njit(counts_halves_by_joint)

    def calls(memory, device, tick, period):
        helper(memory, device, tick, period)

    with raises(ParameterError, "by_joint", "int", "float"):
        simulate(bench("duration_s=0.1"), controller=controller_with(calls, initial_memory=counted))


def divides(memory, device, tick, period):
    joint = device.joints[0]
    joint.setpoint.target = 1.0 / (joint.setpoint.gain - joint.setpoint.gain)


def counts_too_far(memory, device, tick, period):
    device.joints[9].setpoint.target = 1.0


@pytest.mark.parametrize("tick", [divides, counts_too_far])
def test_a_controller_that_raises_in_compiled_code_is_named(tick):
    with raises(ParameterError, "Mine", "engine=pinocchio"):
        simulate(bench("duration_s=0.1"), controller=controller_with(tick))


@pytest.mark.filterwarnings("ignore::twin_gait.simulation.simulator.SlowControllerWarning")
def test_a_missing_field_raises_the_python_error():
    def misspells(memory, device, tick, period):
        device.joints[0].setpoint.stifness = 1.0

    with raises(AttributeError, "JointSetpoint", "stifness"):
        simulate(bench("duration_s=0.1"), controller=controller_with(misspells))


@pytest.mark.parametrize("engine", ["compiled", "pinocchio"])
def test_a_nan_command_of_a_controller_trips(engine):
    def breaks(memory, device, tick, period):
        device.joints[0].setpoint.target = 1e300 * 1e300 * 0.0 if tick >= 100 else 0.0

    run = simulate(bench("duration_s=0.3", f"engine={engine}"), controller=controller_with(breaks))
    assert run.trip == (100, TripCause.COMMAND, Side.RIGHT, JointName.HIP)
    kept = [name for name in run.log if not name.endswith("_phase")]
    assert np.isfinite(run.log[kept].to_numpy()).all()


# ------------------------------------------------------------------ those that ship


def test_a_module_of_the_folder_is_a_mode():
    assert {str(mode) for mode in ControlMode} == set(CONTROLLERS)
    assert CONTROLLERS["position"] is Position
    stiff = load_experiment("bench_leg", ["control.mode=position", "control.path.damping_ratio=0.3"])
    controller = build_setup(stiff.experiment).controller
    assert isinstance(controller, Position) and controller.path.damping_ratio == 0.3


def test_a_mode_whose_tick_is_not_static_is_refused_like_an_own_controller(monkeypatch):
    monkeypatch.setattr(Position, "tick", lambda memory, device, tick, period: None)
    with raises(ParameterError, "Position", TAKES):
        build_setup(load_experiment("treadmill_guided", ["control.mode=position"]).experiment)
