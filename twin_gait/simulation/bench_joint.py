"""Run a test on the joint bench, compiled or as plain Python."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pandas as pd

from twin_gait.control import ControllerFunction
from twin_gait.core.control_tick import controller_torques
from twin_gait.core.estimation import first_order_gain
from twin_gait.core.motor_drive import current_loop_gains
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import require
from twin_gait.scenario.bench_joint import (
    HORIZONTAL,
    TRANSPARENCY_STEPS,
    BenchJoint,
    CompensationVelocity,
    CurrentLoop,
    DutyControl,
    InertialSensor,
    LoadAngle,
    TorqueControl,
)
from twin_gait.simulation import bench_joint_loop as loop
from twin_gait.simulation.compiling import compiled_before, load_module, register_core
from twin_gait.simulation.engine import DIVERGED_VELOCITY
from twin_gait.simulation.keeping import source_key
from twin_gait.simulation.run import RunStatus

TICK = 1e-3  # [s], the firmware's
CHUNK_TICKS = 5000  # between two looks at progress and interruption
# Columns of the thesis's log files, in this order; the others are what no bench can see.
LOG_COLUMNS = loop.COLUMNS[:9]


@dataclass(frozen=True, eq=False)
class BenchVariation:
    """What differs from one test to the next though nothing was changed.

    Attributes:
        current_offset: Of the current measurement in [A].
        friction_ratio: On the friction law.
        ripple_phase: Of the friction that repeats with the angle, in [rad].
        duty_start: Ticks that the sine of (2.1a) has run when the test begins.
    """

    current_offset: float = 0.0
    friction_ratio: float = 1.0
    ripple_phase: float = 0.0
    duty_start: int = 0


@dataclass(frozen=True, eq=False)
class BenchRun:
    """What a test left behind.

    Attributes:
        test: The test.
        rows: Log, shape ``(n_ticks, n_columns)``.
        status: Completed, diverged or interrupted.
    """

    test: BenchJoint
    rows: np.ndarray
    status: RunStatus

    def column(self, name: str) -> np.ndarray:
        """A column by its name, shape ``(n_ticks,)``.

        Args:
            name: One of :data:`twin_gait.simulation.bench_joint_loop.COLUMNS`.

        Returns:
            The values.

        Raises:
            ParameterError: If there is no such column.
        """
        if name not in loop.COLUMNS:
            raise ParameterError(f"{name}: no such column; there are {', '.join(loop.COLUMNS)}")
        return np.asarray(self.rows[:, loop.COLUMNS.index(name)])

    def log(self, *, truth: bool = True) -> pd.DataFrame:
        """The log as a table.

        Args:
            truth: Also what no bench can see: friction, true motion, true current.

        Returns:
            One row per tick.
        """
        columns = loop.COLUMNS if truth else LOG_COLUMNS
        return pd.DataFrame(self.rows[:, : len(columns)], columns=list(columns))


def simulate_bench(
    test: BenchJoint,
    *,
    seed: int = 0,
    variation: BenchVariation | None = None,
    compiled: bool = True,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> BenchRun:
    """Simulate a test.

    Args:
        test: The bench and what is done on it.
        seed: Of the noise of current and encoder.
        variation: What chance adds to this test.
        compiled: False runs the same loop as plain Python, some hundred times slower.
        progress: Called with ticks done and in all.
        should_stop: Asked between chunks; True ends the test there.
        on_compile: Called if the loop has to be compiled.

    Returns:
        The run.

    Raises:
        ParameterError: If parts of the test do not go together.
    """
    law = test.control.controller.law if isinstance(test.control, TorqueControl) else controller_torques
    run_ticks = _compiled_loop(law, on_compile) if compiled else _plain_loop(law)
    ticks = max(1, round(test.duration / TICK))
    bench = bench_arrays(test, ticks, seed, variation or BenchVariation())
    rows = np.zeros((ticks, len(loop.COLUMNS)))
    done, status = 0, RunStatus.COMPLETED
    while done < ticks:
        if should_stop is not None and should_stop():
            status = RunStatus.INTERRUPTED
            break
        end = min(done + CHUNK_TICKS, ticks)
        reached = int(run_ticks(bench, done, end, rows))
        done = reached
        if progress is not None:
            progress(done, ticks)
        if bench.state[loop.DIVERGED]:
            status = RunStatus.DIVERGED
        if reached < end or status is RunStatus.DIVERGED:
            break
    return BenchRun(test, rows[:done], status)


def bench_arrays(test: BenchJoint, ticks: int, seed: int, variation: BenchVariation) -> loop.BenchArrays:
    """Lay a test out as arrays.

    Args:
        test: The test.
        ticks: Its length.
        seed: Of the noise.
        variation: What chance adds.

    Returns:
        The arrays, with the state at tick 0.
    """
    numbers = _numbers(test, variation)
    loops = int(numbers[loop.LOOPS])
    rng = np.random.default_rng(seed)
    sensors = test.sensors
    encoder_noise = np.zeros(ticks)
    if not sensors.ideal and sensors.angle_noise > 0.0:
        encoder_noise = sensors.angle_noise * rng.standard_normal(ticks)
    loop_noise = rng.standard_normal(ticks * loops) if test.drive.noise > 0.0 else np.zeros(ticks * loops)
    unit = test.inertial_unit
    inertial_noise = np.zeros(0) if unit is None else rng.standard_normal(ticks)
    resolution = 2.0 * math.pi / (sensors.encoder_counts * test.actuator.gear_ratio)
    state = np.zeros(loop.STATE_COUNT)
    state[loop.MOTOR_ANGLE] = state[loop.LINK_ANGLE] = test.start_angle
    state[loop.MOTOR_VELOCITY] = state[loop.LINK_VELOCITY] = test.start_velocity
    state[loop.BUS_VOLTAGE] = test.battery.voltage
    return loop.BenchArrays(
        numbers=numbers,
        state=state,
        angles=np.zeros(1),
        resolution=np.array([0.0 if sensors.ideal else resolution]),
        measured=np.zeros((1, 3)),
        decimated_angle=np.zeros(1),
        ring=np.zeros((sensors.window, 1)),
        delayed=np.zeros(test.drive.delay + 1),
        encoder_noise=encoder_noise,
        loop_noise=loop_noise,
        inertial=np.zeros(1 if unit is None else unit.delay + 1),
        inertial_noise=inertial_noise,
    )


def _numbers(test: BenchJoint, variation: BenchVariation) -> np.ndarray:
    values = {
        **_plant_numbers(test, variation),
        **_drive_numbers(test, variation),
        **_control_numbers(test, variation),
    }
    numbers = np.zeros(loop.NUMBER_COUNT)
    for position, value in values.items():
        numbers[position] = value
    return numbers


def _plant_numbers(test: BenchJoint, variation: BenchVariation) -> dict[int, float]:
    link, friction = test.link, test.friction
    law = friction.law.scaled(variation.friction_ratio).normalised()
    values = {
        loop.MOTOR_INERTIA: test.actuator.armature,
        loop.LINK_INERTIA: link.total_inertia,
        loop.LINK_MOMENT: link.total_moment,
        loop.GRAVITY: test.gravity,
        loop.HORIZONTAL_ANGLE: HORIZONTAL if link.load_angle is LoadAngle.CORRECTED else 0.0,
        loop.STOP_LOWER: link.lower_stop,
        loop.STOP_UPPER: link.upper_stop,
        loop.STOP_STIFFNESS: link.stops.stiffness,
        loop.STOP_DISSIPATION: link.stops.dissipation,
        loop.FRICTION_A: law.breakaway_torque,
        loop.FRICTION_B: law.coulomb_friction,
        loop.FRICTION_C: law.breakaway_velocity,
        loop.FRICTION_D: law.viscous_friction,
        loop.CONDITIONED: float(friction.depends_on_conditions),
        loop.COULOMB_PER_LOAD: friction.coulomb_per_load,
        loop.COULOMB_PER_KELVIN: friction.coulomb_per_kelvin,
        loop.VISCOUS_PER_KELVIN: friction.viscous_per_kelvin,
        loop.FRICTION_TEMPERATURE: friction.temperature,
        loop.RIPPLE_COSINE: friction.ripple * math.cos(variation.ripple_phase),
        loop.RIPPLE_SINE: friction.ripple * math.sin(variation.ripple_phase),
        loop.RIPPLE_ORDER: 2.0 * test.actuator.gear_ratio,
        loop.LOSS_VELOCITY: 1.0,
        loop.REST_TICKS: test.rest_at_stop / TICK,
        loop.DIVERGED_VELOCITY: DIVERGED_VELOCITY,
        loop.HAND_FREQUENCY: 1.0,
    }
    if test.torsion is not None:
        values[loop.TORSION_STIFFNESS] = test.torsion.stiffness
        values[loop.TORSION_DAMPING] = test.torsion.damping
    if test.efficiency is not None:
        values[loop.LOSSY] = 1.0
        values[loop.GEAR_TEMPERATURE] = test.efficiency.temperature
        values[loop.LOSS_VELOCITY] = test.efficiency.transition_velocity
        for place, coefficient in enumerate(test.efficiency.coefficients):
            values[loop.EFFICIENCY_0 + place] = coefficient
    if test.hand is not None:
        values[loop.HAND_START] = test.start_angle
        values[loop.HAND_AMPLITUDE] = test.hand.amplitude
        values[loop.HAND_FREQUENCY] = test.hand.frequency
        values[loop.HAND_STIFFNESS] = test.hand.stiffness
        values[loop.HAND_DAMPING] = test.hand.damping
        values[loop.HAND_RELEASE] = test.hand.release_time
    return values


def _drive_numbers(test: BenchJoint, variation: BenchVariation) -> dict[int, float]:
    actuator, drive = test.actuator, test.drive
    proportional, integral = current_loop_gains(actuator.resistance, drive.inductance, drive.bandwidth)
    loops = round(drive.rate * TICK)
    return {
        loop.PERIOD: TICK,
        loop.LOOP_PERIOD: TICK / loops,
        loop.LOOPS: loops,
        loop.MODE: _mode(test),
        loop.TORQUE_CONSTANT: actuator.torque_constant,
        loop.GEAR_RATIO: actuator.gear_ratio,
        loop.GEAR_EFFICIENCY: actuator.gear_efficiency,
        loop.RESISTANCE: actuator.resistance,
        loop.INDUCTANCE: drive.inductance,
        loop.POLE_PAIRS: drive.pole_pairs,
        loop.CURRENT_RIPPLE: drive.ripple,
        loop.CURRENT_NOISE: drive.noise,
        loop.CURRENT_OFFSET: variation.current_offset,
        loop.CURRENT_RESOLUTION: drive.resolution,
        loop.PROPORTIONAL_GAIN: proportional,
        loop.INTEGRAL_GAIN: integral,
        loop.COUNTS: drive.counts,
        loop.BATTERY_VOLTAGE: test.battery.voltage,
        loop.BATTERY_RESISTANCE: test.battery.internal_resistance,
        loop.TORQUE_LIMIT: test.limits.torque,
        loop.CURRENT_LIMIT: test.limits.current,
    }


def _mode(test: BenchJoint) -> float:
    if test.control is None:
        return loop.OPEN
    if isinstance(test.control, DutyControl):
        return loop.DUTY
    return loop.PI if test.drive.loop is CurrentLoop.PI else loop.IDEAL


def _control_numbers(test: BenchJoint, variation: BenchVariation) -> dict[int, float]:
    values = {
        loop.FAST_GAIN: first_order_gain(TICK, test.sensors.fast_time_constant),
        loop.DECIMATION: float(test.sensors.decimation),
        loop.MODEL_C: 1.0,
        loop.DUTY_STEPS: TRANSPARENCY_STEPS,
        loop.PATH_FREQUENCY: 1.0,
    }
    if isinstance(test.control, DutyControl):
        return values | _duty_numbers(test, test.control, variation)
    if isinstance(test.control, TorqueControl):
        return values | _torque_numbers(test.control) | _unit_numbers(test)
    return values


def _unit_numbers(test: BenchJoint) -> dict[int, float]:
    unit = test.inertial_unit
    if unit is None:
        return {loop.UNIT: loop.ENCODER}
    gyroscope = unit.sensor is InertialSensor.GYROSCOPE
    return {
        loop.UNIT: loop.GYROSCOPE if gyroscope else loop.ACCELEROMETER,
        loop.UNIT_LEVER: unit.lever,
        loop.UNIT_NOISE: unit.noise,
        loop.UNIT_GAIN: first_order_gain(TICK, unit.time_constant),
    }


def _duty_numbers(test: BenchJoint, control: DutyControl, variation: BenchVariation) -> dict[int, float]:
    require(test.drive.counts > 0, "pwm counts", "1 or more for a controller of duties", test.drive.counts)
    static, linear, quadratic = control.voltages(test.actuator)
    return {
        loop.DUTY_AMPLITUDE: control.amplitude,
        loop.DUTY_FREQUENCY: control.frequency,
        loop.DUTY_START: float(variation.duty_start),
        loop.LOWEST_VELOCITY: control.lowest_velocity,
        loop.TRANSPARENCY_GAIN: control.transparency_gain,
        loop.P0: static,
        loop.P1: linear,
        loop.P2: quadratic,
        loop.DUTY_LIMIT: control.duty_limit * test.drive.counts,
    }


def _torque_numbers(control: TorqueControl) -> dict[int, float]:
    model = control.controller.friction_model.normalised()
    values = {
        loop.MODEL_A: model.breakaway_torque,
        loop.MODEL_B: model.coulomb_friction,
        loop.MODEL_C: model.breakaway_velocity,
        loop.MODEL_D: model.viscous_friction,
        loop.COMPENSATION_GAIN: control.friction_compensation_gain,
        loop.FOLLOWS_REFERENCE: float(control.compensation_velocity is CompensationVelocity.REFERENCE),
        loop.DEAD_ZONE: control.dead_zone,
        loop.TARGET_TORQUE: control.target_torque,
        loop.STIFFNESS: control.stiffness,
        loop.DAMPING: control.damping,
        loop.EQUILIBRIUM: control.equilibrium_angle,
        loop.INERTIA_SHARE: control.inertia_compensation,
    }
    if control.old_model is not None:
        values[loop.OLD_MODEL] = 1.0
        values[loop.MODEL_B] = control.old_model.coulomb
        values[loop.MODEL_C] = control.old_model.steepness
        values[loop.MODEL_D] = control.old_model.viscous
    if control.path is not None:
        values[loop.EQUILIBRIUM] = control.path.start_angle
        values[loop.PATH_AMPLITUDE] = control.path.amplitude
        values[loop.PATH_FREQUENCY] = control.path.frequency
    return values


RunTicks = Callable[[loop.BenchArrays, int, int, np.ndarray], int]


def _plain_loop(law: ControllerFunction) -> RunTicks:
    if law is controller_torques:
        return loop.run_ticks
    module = ModuleType("twin_gait_bench_with_controller")
    exec(compile(inspect.getsource(loop), module.__name__, "exec"), module.__dict__)
    module.__dict__["controller_torques"] = law
    run_ticks: RunTicks = module.__dict__["run_ticks"]
    return run_ticks


def _compiled_loop(law: ControllerFunction, on_compile: Callable[[], None] | None) -> RunTicks:
    if law is not controller_torques:
        run_ticks: RunTicks = _module_with(law).__dict__["run_ticks"]
        return run_ticks
    text = loop_text()
    key = source_key(text)
    if on_compile is not None and not compiled_before(key):
        on_compile()
    kept: RunTicks = load_module(key, lambda: text).run_ticks
    return kept


@lru_cache(maxsize=1)
def loop_text() -> str:
    """The loop as it is compiled: the same text with decorators; its hash is part of the cache's key."""
    text = inspect.getsource(loop).replace("import numpy as np\n", _PREAMBLE, 1)
    # compiling.compiled_before looks for what numba has kept under this name.
    text = text.replace("def run_ticks(", "@_kept\ndef run_ticks(", 1)
    # numba compiles at the first call, when all functions of the module exist, whatever their order.
    text = re.sub(r"^(?<!@_kept\n)def ", "@_jit\ndef ", text, flags=re.MULTILINE)
    return text


_PREAMBLE = """import numba
import numpy as np

_kept = numba.njit(cache=True, nogil=True, error_model="numpy")
_jit = numba.njit(nogil=True, error_model="numpy")
"""


@lru_cache(maxsize=8)
def _module_with(law: ControllerFunction) -> ModuleType:
    """Generated module with a controller of the user's, compiled for this process only."""
    register_core()
    module = ModuleType("twin_gait_bench_with_controller")
    exec(compile(loop_text().replace("cache=True, ", ""), module.__name__, "exec"), module.__dict__)
    module.__dict__["controller_torques"] = _jitted(law)
    return module


def _jitted(law: Any) -> Any:
    return law if isinstance(law, numba.core.dispatcher.Dispatcher) else numba.njit(nogil=True)(law)
