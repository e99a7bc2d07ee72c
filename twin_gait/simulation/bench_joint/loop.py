"""Simulation of a test on the joint bench: its record at tick 0, and its run in a cached compiled loop."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.core.actuator import Motor
from twin_gait.core.control_tick import new_encoder
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import first_order_gain, new_delay_line
from twin_gait.core.friction import ROTATIONAL
from twin_gait.core.motor_drive import current_loop_gains
from twin_gait.core.plant import ImposedMotion
from twin_gait.gait.table import TICK
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.parameters.quantities import from_attributes
from twin_gait.simulation.bench_joint import episode as record
from twin_gait.simulation.bench_joint.tick import ANGLE_NOISE, CURRENT_NOISE, UNIT_NOISE, run_ticks
from twin_gait.simulation.binding import kernel_functions
from twin_gait.simulation.code_cache import CompiledLoop, Loop, OnCompile, cached_loop, source_key
from twin_gait.simulation.compiled_engine import compiled_rows, run_ticks_at, text_of
from twin_gait.simulation.episode import DIVERGED
from twin_gait.simulation.record import to_array
from twin_gait.simulation.run import RunStatus
from twin_gait.worlds.bench_control import CosinePath, DutyControl, OldFrictionModel, TorqueControl
from twin_gait.worlds.bench_joint import (
    HORIZONTAL,
    BenchJoint,
    CatalogueEfficiency,
    CurrentLoop,
    InertialSensor,
    InertialUnit,
    LoadAngle,
    Torsion,
)


@dataclass(frozen=True, eq=False)
class BenchRun:
    """Result of a test."""

    test: BenchJoint  # Parameters of the test.
    # Log with one row per tick; after ``LOG_COLUMNS`` come quantities that no bench can measure: friction,
    # true motion and true current.
    log: pd.DataFrame
    status: RunStatus  # Status at the end, completed or diverged.

    def column(self, name: str) -> np.ndarray:
        """Return a column by its name, which includes the unit, shape ``(n_ticks,)``."""
        return self.log[name].to_numpy()


def simulate_bench(
    test: BenchJoint,
    *,
    seed: int = 0,
    variation: record.BenchVariation | None = None,
    on_compile: OnCompile = None,
) -> BenchRun:
    """Simulate a test.

    Args:
        test: Parameters of the bench and of the test.
        seed: Seed of the noise of encoder, inertial unit and current.
        variation: Random differences from other tests, by default none.
        on_compile: Called if the loop has to be compiled.

    Returns:
        The run.

    Raises:
        ParameterError: If parts of the test are incompatible.
    """
    ticks = max(1, round(test.duration / TICK))
    episode, noise = bench_episode(test, variation or record.BenchVariation()), bench_noise(test, ticks, seed)
    rows, recording = np.zeros((ticks, len(record.LAYOUT.names))), episode.recording
    recording.log, recording.noise, recording.n_noise = rows.ctypes.data, noise.ctypes.data, noise.size
    store, other_laws = to_array(episode), episode.friction.law > ROTATIONAL
    done = _loop(store.dtype, other_laws, on_compile)(store.ctypes.data, 0, ticks)
    diverged = store[0]["status"] == DIVERGED
    log = pd.DataFrame(rows[:done], columns=list(record.LAYOUT.names))
    return BenchRun(test, log, RunStatus.DIVERGED if diverged else RunStatus.COMPLETED)


def _loop(episode: np.dtype[Any], other_laws: bool, on_compile: OnCompile) -> Loop:
    """Return the compiled loop of tests with one layout, without the slow laws besides (3.1) if possible."""

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop, record_accessor

        names = {
            **bench_loop_names(other_laws),
            **compiled_rows(len(record.LAYOUT.names), 1),
            "run_ticks": run_ticks,
        }
        return compile_loop(run_ticks_at, {**names, "episode_at": record_accessor(episode)})

    key = f"bench {text_of(episode)} {record.LAYOUT.writer} {other_laws} {TICK}"
    return cached_loop(source_key(key), make, on_compile)


def bench_loop_names(other_laws: bool) -> dict[str, Any]:
    """Return the names that the steps of a test are bound to, except the rows of log and noise."""
    return {"WITH_OTHER_FRICTION_LAWS": other_laws, **kernel_functions(record.LAYOUT.writer, {"TICK": TICK})}


def bench_noise(test: BenchJoint, ticks: int, seed: int) -> np.ndarray:
    """Draw the noise of a test; sensors without noise draw no random numbers.

    Returns shape ``(ticks, 2 + periods)``: noise of the encoder in [rad], then standard normal numbers for
    the inertial unit and for the current sample in each period of the current loop.
    """
    rng, sensors, periods = np.random.default_rng(seed), test.sensors, _periods(test)
    noise = np.zeros((ticks, CURRENT_NOISE + periods))
    if not sensors.ideal and sensors.angle_noise > 0.0:
        noise[:, ANGLE_NOISE] = sensors.angle_noise * rng.standard_normal(ticks)
    if test.drive.noise > 0.0:
        noise[:, CURRENT_NOISE:] = rng.standard_normal((ticks, periods))
    if test.inertial_unit is not None:
        noise[:, UNIT_NOISE] = rng.standard_normal(ticks)
    return noise


def bench_episode(test: BenchJoint, variation: record.BenchVariation) -> record.BenchEpisode:
    """Return the record of a test at tick 0.

    Raises ParameterError if parts of the test are incompatible.
    """
    link, friction, sensors = test.link, test.friction, test.sensors
    resolution = 2.0 * math.pi / (sensors.encoder_counts * test.actuator.gear_ratio)
    torque = _torque_control(test)
    path = CosinePath(start_angle=torque.equilibrium_angle, amplitude=0.0, frequency=1.0)
    constant = (test.actuator.gear_efficiency, 0.0, 0.0, 0.0, 0.0, 0.0)
    sine, cosine = sine_cosine(variation.ripple_phase)
    motion = ImposedMotion()
    if test.imposed_motion is not None:
        motion = from_attributes(ImposedMotion, test.imposed_motion, index=0, start_angle=test.start_angle)
    unit = test.inertial_unit or InertialUnit(sensor=InertialSensor.GYROSCOPE)
    return record.BenchEpisode(
        test=replace(
            test, control=None, efficiency=None, torsion=None, inertial_unit=None, imposed_motion=None
        ),
        fast_gain=first_order_gain(TICK, sensors.fast_time_constant),
        encoder=new_encoder(0.0 if sensors.ideal else resolution, test.start_angle, sensors.window),
        motor=from_attributes(Motor, test.actuator),
        variation=variation,
        winding=_winding(test),
        bus_voltage=test.battery.voltage,
        rotor=record.Body(test.actuator.armature, test.start_angle, test.start_velocity),
        link=record.Body(link.total_inertia, test.start_angle, test.start_velocity),
        horizontal_angle=HORIZONTAL if link.load_angle is LoadAngle.CORRECTED else 0.0,
        mass_moment=link.total_moment,
        torsion=test.torsion or Torsion(),
        compliant=test.torsion is not None,
        efficiency=test.efficiency or CatalogueEfficiency(coefficients=constant),
        friction=friction.law.scaled(variation.friction_ratio).to_plant_friction(),
        ripple_cosine=friction.ripple * cosine,
        ripple_sine=friction.ripple * sine,
        imposed_motion=motion,
        unit=unit,
        acceleration=_acceleration(test, unit),
        torque_control=replace(torque, old_model=None, path=None),
        path=torque.path or path,
        old_model=torque.old_model or OldFrictionModel(),
        uses_old_model=torque.old_model is not None,
        duty_control=test.control if isinstance(test.control, DutyControl) else DutyControl(),
    )


def _periods(test: BenchJoint) -> int:
    return round(test.drive.rate * TICK)


def _winding(test: BenchJoint) -> record.Winding:
    drive, periods = test.drive, _periods(test)
    kind = record.PI if drive.loop is CurrentLoop.PI else record.IDEAL
    if not isinstance(test.control, TorqueControl):
        kind = record.OPEN if test.control is None else record.DUTY
    gains = current_loop_gains(test.actuator.resistance, drive.inductance, drive.bandwidth)
    return record.Winding(kind, periods, TICK / periods, *gains, new_delay_line(drive.delay))


def _acceleration(test: BenchJoint, unit: InertialUnit) -> record.Acceleration:
    used = test.inertial_unit is not None and isinstance(test.control, TorqueControl)
    source = 1 + list(InertialSensor).index(unit.sensor) if used else record.ENCODER
    time_constant = unit.time_constant if used else test.sensors.fast_time_constant
    return record.Acceleration(source, first_order_gain(TICK, time_constant), new_delay_line(unit.delay))


def _torque_control(test: BenchJoint) -> TorqueControl:
    if not isinstance(test.control, TorqueControl):
        none = FrictionParameters(
            breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=0.0
        )
        return TorqueControl(friction_model=none)  # not used
    return replace(test.control, friction_model=test.control.friction_model.normalised())
