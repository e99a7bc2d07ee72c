"""Modes under requests, leans and faults at random: on signals, and in whole walks on the floor."""

from __future__ import annotations

import copy
import itertools
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from twin_gait import Experiment, load_experiment, simulate
from twin_gait.control import device_schedule
from twin_gait.control.gait_controller import trip_on_causes
from twin_gait.control.safety import TripCause
from twin_gait.control.supervisor import choose_mode
from twin_gait.core.inertial import trunk_specific_force, update_pitch_estimate
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.executors import scalar_driver
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.schedule import NAMES
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.fault_campaign import DRAWN_KINDS
from twin_gait.vocabulary import Outcome
from twin_gait.worlds.faults import FaultKind

TABLE = Path(__file__).parents[1] / "tables" / "treadmill_modes.yaml"
ALL, SAMPLE, FEW_WALKS = range(1000), range(0, 1000, 50), range(2)
REPEATING = FaultKind.FOOT_LOAD_STUCK, FaultKind.ENCODER_FREEZE
DEGREE = math.pi / 180.0
LEAN, GUARD = 8.0, 9.0  # [deg]: threshold of the true pitch, and threshold of the guard on the measured pitch

every = pytest.param(ALL, marks=pytest.mark.slow, id="all")


# ------------------------------------------------------------------ whole walks


def walk(seed: int, seconds: float = 12.0) -> Experiment:
    """A wearer who walks by requests at random, noise on, with a fault in five of six walks."""
    draw = np.random.default_rng(seed)
    requests = [f"{draw.choice(['walk', 'walk_automatic'])}@0.5s"]
    times = np.cumsum(draw.uniform(0.4, 1.4, size=40))
    names = draw.choice(["step", "step", "step", "stop", "walk", "walk_automatic"], size=40)
    requests += [f"{n}@{0.6 + t:.3f}s" for n, t in zip(names, times, strict=True) if 0.6 + t < seconds]
    faults = []
    if seed % 6:
        kind = DRAWN_KINDS[seed % len(DRAWN_KINDS)]
        target = f"{draw.choice(['left', 'right'])}_{draw.choice(['hip', 'knee'])}"
        target = target.split("_")[0] + "_foot" if kind is FaultKind.FOOT_LOAD_STUCK else target
        target = "" if kind is FaultKind.SUPPLY_DIP else f":{target}"
        target = target if not target or target.startswith(":") else f":{target}"
        faults = [f"{kind}{target}@{draw.uniform(1.0, 0.6 * seconds):.3f}s"]
    return load_experiment(
        "overground",
        [
            "modes=walking",
            f"requests=[{', '.join(requests)}]",
            f"faults=[{', '.join(faults)}]",
            "sensors.ideal=false",
            "sensors.angle_noise_rad=2e-5",
            f"patient.mass_kg={draw.uniform(55, 85):.1f}",
            f"patient.height_m={draw.uniform(1.65, 1.85):.2f}",
            f"seed={seed}",
            f"duration_s={seconds}",
        ],
    ).experiment


def swings(run: Run) -> np.ndarray:
    """Legs in swing, tick by tick."""
    names = [name for name in run.table.phase_names if run.table.is_swing(name)]
    return sum(run.log[f"{side}_phase"].isin(names).to_numpy().astype(int) for side in run.sides)


# ------------------------------------------------------------------ on signals


class Device:
    """Supervisor and legs of an experiment, in plain Python, fed with signals."""

    def __init__(self, experiment: Experiment) -> None:
        problem = build_setup(experiment)
        engine = self.engine = ReferenceEngine(problem)
        names = (engine.log_row, engine.switch_row, engine.noise_row, engine.choose_transition)
        bound = {**assemble(problem)[2], **{item.__name__: item for item in names}}
        parts = ("choose", device_schedule.SUPERVISE), ("decide", device_schedule.STATE_MACHINES)
        self.choose, self.decide = (
            specialize(scalar_driver(name, (part,), NAMES), bound) for name, part in parts
        )
        self.modes, self.table = experiment.modes, problem.table
        self.fresh = copy.deepcopy((engine.episode, engine.machines))

    def restart(self) -> None:
        self.engine.episode, self.engine.machines = copy.deepcopy(self.fresh)

    @property
    def supervisor(self):
        return self.engine.episode.controller.supervisor

    @property
    def mode(self) -> str:
        return self.modes.phase_names[self.supervisor.mode]

    def phases(self) -> list[str]:
        return [self.table.phase_names[leg.phase] for leg in self.engine.episode.controller.legs]

    def tick(self, tick: int, request: int) -> None:
        e = self.engine.episode
        self.supervisor.request = request
        trip_on_causes(e.controller, tick)
        self.choose(e, tick)
        if e.controller.trip.tick < 0:
            self.decide(e, tick)


@cache
def device(name: str) -> Device:
    if name == "floor":
        settings = ["modes=walking", "sensors.ideal=false"]
        return Device(load_experiment("overground", settings).experiment)
    settings = [f"table={TABLE}", "modes=twin", "initial_mode=standing"]
    return Device(load_experiment("treadmill_start_stop", settings).experiment)


def measure(controller, draw: np.random.Generator) -> None:
    """Anything that legs and trunk could read."""
    for number, joint in enumerate(controller.joints):
        low, high = ((-20.0, 70.0), (0.0, 80.0))[number % 2]
        joint.measurement.angle = draw.uniform(low, high) * DEGREE
        joint.measurement.velocity = draw.normal(0.0, 1.0)
    for leg in controller.legs:
        leg.load = draw.choice([0.0, draw.uniform(0.0, 1.2)])
    controller.device_signals.trunk_pitch = draw.uniform(-10.0, 25.0) * DEGREE


@pytest.mark.parametrize("name", ["floor", "treadmill_guided"])
@pytest.mark.parametrize("seeds", [pytest.param(SAMPLE, id="sample"), every])
def test_random_requests_leans_and_faults_never_lift_both_legs_nor_answer_the_chair_in_a_walk(name, seeds):
    """Some 2 s each; spells of signals of 5 to 250 ms, a request in every other spell."""
    controlled = device(name)
    visited, answered = set(), 0
    for seed in seeds:
        draw = np.random.default_rng(seed)
        controlled.restart()
        controller = controlled.engine.episode.controller
        fault, next_spell = int(draw.integers(500, 6000)), 0
        since = controlled.supervisor.entry_tick = -int(draw.integers(0, 5000))
        for tick in range(2000):
            request, before = 0, controlled.mode
            if tick == next_spell:
                next_spell += int(draw.integers(5, 250))
                measure(controller, draw)
                request = int(draw.integers(0, 2) * draw.integers(1, len(controlled.modes.requests) + 1))
            if tick == fault:
                controller.joints[seed % 4].measurement.cause = 1
            controlled.tick(tick, request)
            after = controlled.mode
            visited.add(after)
            assert sum(map(controlled.table.is_swing, controlled.phases())) < 2
            assert after == "hold" if tick >= fault else after != "hold"
            requested = request and controlled.modes.requests[request - 1]
            if requested and not controlled.supervisor.rejected:
                answered += 1
                assert before != "hold" and tick != fault
                assert (
                    requested != "sit"
                    or before == "sit_up"
                    or (before == "standing" and tick - since >= 3000)
                )
            if controlled.supervisor.entered:
                since = tick
    assert answered > len(seeds) and {"hold", "walk_manual", "stopping"} <= visited


@cache
def recorded() -> Run:
    """A walk by lean, of which the phases, and how hips are shaken, are taken."""
    return simulate(
        load_experiment(
            "overground", ["modes=walking", "requests=[walk_automatic@0.5s]", "duration_s=12"]
        ).experiment
    )


def leaning(lean: float, held: int) -> np.ndarray:
    """Return the pitch [rad] of a trunk that leans by an angle [deg] in 0.15 s, holds, and returns."""
    way = 0.5 - 0.5 * np.cos(np.pi * np.arange(150) / 150)
    return lean * DEGREE * np.concatenate([way, np.ones(held), way[::-1], np.zeros(300)])


def steps_by(pitch: np.ndarray, start: int, draw: np.random.Generator) -> tuple[bool, bool]:
    """Return whether a lean triggers a step, measured by the inertial unit with its noise.

    Phases and accelerations of the hips are those of a recorded walk from a tick on.

    Returns:
        Whether a step is triggered, and whether the measured pitch was beyond the guard for 200 ticks with
        both feet on the ground.
    """
    run, controlled = recorded(), device("floor")
    sensor, ticks = run.experiment.sensors.trunk, slice(start, start + len(pitch))
    rate = np.gradient(pitch, 1e-3)
    turning = np.gradient(rate, 1e-3)
    speeds = [run.log[f"pelvis_{name}velocity_m_per_s"].to_numpy() for name in ("forward_", "")]
    ahead, up = (np.gradient(speed, 1e-3)[ticks] for speed in speeds)
    swinging = swings(run)[ticks]
    controlled.restart()
    unit, supervisor = controlled.engine.episode.trunk_unit, controlled.supervisor
    # Where a trunk that has been upright for long is measured.
    unit.pitch = sensor.gyroscope_bias * sensor.time_constant - sensor.accelerometer_bias / 9.81
    names = controlled.modes.phase_names
    supervisor.mode, index_of = names.index("walk_automatic"), list(controlled.modes.signals).index
    pitch_index, swing_index = index_of("trunk.pitch_deg"), index_of("legs_in_swing")
    beyond = 0
    for tick in range(len(pitch)):
        felt = trunk_specific_force(unit, pitch[tick], rate[tick], turning[tick], ahead[tick], up[tick], 9.81)
        noise = draw.normal(0.0, sensor.accelerometer_noise, 2)
        gyroscope = rate[tick] + draw.normal(0.0, sensor.gyroscope_noise)
        update_pitch_estimate(unit, gyroscope, felt[0] + noise[0], felt[1] + noise[1], 1e-3)
        beyond = beyond + 1 if unit.pitch > GUARD * DEGREE and swinging[tick] == 0 else 0
        supervisor.signals[pitch_index], supervisor.signals[swing_index] = unit.pitch, float(swinging[tick])
        choose_mode(supervisor, tick, False)
        if names[supervisor.mode] == "automatic_step":
            return True, beyond == 200
    return False, beyond >= 200


@pytest.mark.slow  # many walks of many seconds
@pytest.mark.parametrize("seeds", [pytest.param(SAMPLE, id="sample"), every])
def test_no_lean_makes_a_step_below_the_threshold_or_before_the_hold_time(seeds):
    """Accelerations of the hips, noise and biases put the measured pitch off by less than a degree."""
    last, stepped = len(recorded().log) - 2500, 0
    for seed in seeds:
        draw = np.random.default_rng(seed)
        lean = draw.uniform(*[(0.0, LEAN), (LEAN, 20.0)][seed // 50 % 2])
        steps, due = steps_by(leaning(lean, int(draw.integers(0, 800))), int(draw.integers(2000, last)), draw)
        assert steps == due
        assert lean > LEAN or not steps
        stepped += steps
    assert stepped


# ------------------------------------------------------------------ in whole walks


@pytest.mark.parametrize("seeds", [pytest.param(FEW_WALKS, id="sample", marks=pytest.mark.slow), every])
def test_every_fault_on_the_floor_leads_to_a_hold_or_to_a_fall_that_is_reported(seeds):
    for seed in seeds:
        run = simulate(walk(seed))
        limits = run.experiment.control.limits
        for side, joint in itertools.product(run.sides, run.experiment.joints):
            torque = run.log[f"{side}_{joint}_motor_torque_Nm"].abs().max()
            assert torque <= limits[joint].torque * (1.0 + 1e-9)
        assert swings(run).max() < 2
        # A frozen reading differs from a healthy sensor only if the value would have changed.
        undetected = all(fault.kind in REPEATING for fault in run.experiment.faults)
        assert undetected or run.trip is not None or run.status is RunStatus.FELL
        if run.trip is not None:
            hold = run.experiment.modes.phase_index("hold")
            assert (run.log["safety_state"][run.trip.tick :] == 1).all()
            # A command is seen to be wild behind the supervisor: the mode is the hold a tick later.
            held_from = run.trip.tick + (run.trip.cause is TripCause.COMMAND)
            assert (run.log["mode"].to_numpy()[held_from:] == hold).all()
        assert run.verdict.outcome is Outcome.FELL if run.status is RunStatus.FELL else run.duration == 12.0
