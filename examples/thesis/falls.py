"""Falls of the knee under duty-based transparency control, and causes of its time of break-away."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from thesis.bench import KNEE, SEED
from thesis.friction import DEVIATIONS, FACTOR, WINDOW, table_values

from twin_gait.configuration.bench_device import BENCH_ACTUATORS, bench_joint
from twin_gait.identification.processing import BenchSetup
from twin_gait.identification.signals import moving_average
from twin_gait.simulation.bench_joint.episode import BenchVariation
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.studies.campaign import Campaign, PlannedTest, planned_tests
from twin_gait.worlds.bench_control import TRANSPARENCY_STEPS, DutyControl
from twin_gait.worlds.bench_joint import HORIZONTAL, STOP_ANGLE, BenchJoint, LoadAngle

BENCH = bench_joint(KNEE)
MASSES = (3.0, 2.5, 2.0, 1.5, 1.0)  # [kg], thesis 2.2.3
GAINS = (1.0, 1.10, 1.15)  # K, thesis 2.2.3
FREQUENCY = 3.0  # f in [Hz], thesis 2.2.3
AMPLITUDES = (140.0, 195.0)  # A in counts from the heaviest to the lightest weight, thesis 2.2.3
STEP = 5.0  # of A in counts, thesis appendix B
TRIALS = 24  # tried instants of the sine, or positions of the gear
ZOOM = 1.5  # [s] of a fall that is simulated to see it begin


@dataclass(frozen=True, eq=False)
class Fall:
    """Fall up to the stop: K, A in counts; time in [s], angle, logged velocity, and share of full duty."""

    gain: float
    amplitude: float
    time: np.ndarray
    angle: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """Return the speed after the post-processing of the thesis, at 100 Hz in [rad/s]."""
        return moving_average(self.velocity[::FACTOR], WINDOW)

    @property
    def mean_speed(self) -> float:
        """Return the distance over the time in [rad/s]."""
        return float((self.angle[-1] - self.angle[0]) / self.time[-1])

    @property
    def roughness(self) -> float:
        """Return total variation over maximum of the filtered speed: 1 if monotonic, 3 if stalled."""
        speed = self.speed
        return float(np.abs(np.diff(speed, prepend=0.0)).sum() / speed.max())


def planned_falls(seed: int = SEED) -> list[PlannedTest]:
    """Return the falls of the knee's campaign: five weights, three K, three A."""
    return planned_tests(Campaign(joint=KNEE, seed=seed))


@cache
def falls_of(mass: float, seed: int = SEED) -> tuple[Fall, ...]:
    """Return the nine falls of a weight in [kg], in the order of the protocol."""
    return tuple(_fall(plan) for plan in planned_falls(seed) if plan.mass == mass)


def _fall(plan: PlannedTest) -> Fall:
    run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
    reached = run.column("link_angle_rad") >= run.test.link.upper_stop
    end = int(np.argmax(reached)) + 1 if reached.any() else len(reached)
    names = ("time_s", "position_rad", "velocity_rad_per_s", "duty")
    return Fall(plan.settings["K"], plan.settings["A_counts"], *(run.column(name)[:end] for name in names))


# ---------------------------------------------------------------------- figures A.1 and A.2


def torque_per_count() -> float:
    """Return the torque of the resting knee by one count of duty, K_t τ V/(N R), in [N·m]."""
    motor = BENCH.actuator
    current = BENCH.battery.voltage / (BENCH.drive.counts * motor.resistance)
    return motor.torque_constant * motor.gear_ratio * current


def neutral_gain(joint: str = KNEE) -> float:
    r"""Return K beyond which the linear part of (2.1b) accelerates the joint.

    The winding brakes with :math:`(K_t\tau)^2 (1 - K p)/R`, :math:`p` the share of the back-EMF in
    :math:`p_1`; with the viscous friction :math:`d` it vanishes at :math:`K = [1 + d R/(K_t\tau)^2]/p`.
    """
    motor = BENCH_ACTUATORS[joint]
    per_current = motor.torque_constant * motor.gear_ratio
    friction = table_values(joint)["d"] * motor.resistance / (per_current * per_current)
    return (1.0 + friction) / DutyControl().back_emf_share


def duty_numbers() -> dict[str, float]:
    """Return the counts of A that compensate the weights, and the torque of one count at rest."""
    weights = (MASSES[0] - MASSES[-1]) * BENCH.gravity * BENCH.link.lever
    return {"counts": weights / torque_per_count(), "torque_per_count": torque_per_count()}


# ---------------------------------------------------------------------- figures B.1 to B.5


def load_torque(angle: np.ndarray, mass: float, form: LoadAngle = LoadAngle.CORRECTED) -> np.ndarray:
    """Compute the load torque of the bench in [N·m], equation (2.8), as corrected or as printed."""
    return BenchSetup(actuator=BENCH_ACTUATORS[KNEE], load_angle=form).load_torque(angle, mass)


def fall_numbers(mass: float, seed: int = SEED) -> dict[str, Any]:
    """Return the speeds of the falls of a weight, and their roughness compared with the previous weight."""
    falls, index = falls_of(mass, seed), MASSES.index(mass)
    slow, fast = (np.mean([fall.mean_speed for fall in falls if fall.gain == K]) for K in GAINS[::2])
    numbers: dict[str, Any] = {
        "speed_ratio": float(fast / slow),
        "slowest": float(np.mean([fall.time[-1] for fall in falls if fall.gain == GAINS[0]])),
    }
    if index:
        pairs = zip(falls, falls_of(MASSES[index - 1], seed), strict=True)
        ratios = np.log([light.roughness / heavy.roughness for light, heavy in pairs])
        error = float(np.std(ratios, ddof=1)) / math.sqrt(len(ratios))
        numbers["roughness"] = math.exp(float(np.mean(ratios)))
        numbers["roughness_low"] = math.exp(-DEVIATIONS * error)
        return numbers
    ends = np.array([HORIZONTAL, STOP_ANGLE])
    numbers["load"], numbers["load_as_printed"] = (
        load_torque(ends, mass, form).tolist() for form in (LoadAngle.CORRECTED, LoadAngle.PRINTED)
    )
    return {**numbers, "load_ratio": numbers["load"][1] / numbers["load"][0]}


# ---------------------------------------------------------------------- figure B.6


@dataclass(frozen=True, eq=False)
class Beginnings:
    """Falls that differ in one property, named by ``label``."""

    label: str
    runs: tuple[BenchRun, ...]

    @property
    def breakaway(self) -> np.ndarray:
        """Return the times [s] after which the joint has moved by 1°; NaN if it has not."""
        return np.array([_breakaway(run) for run in self.runs])

    @property
    def spread(self) -> float:
        """Return the standard deviation of these times in [s]."""
        return float(np.std(self.breakaway))


def _breakaway(run: BenchRun) -> float:
    moved = np.abs(run.column("link_angle_rad") - run.test.start_angle) > math.radians(1.0)
    return round(float(np.argmax(moved)) * 1e-3, 3) if moved.any() else math.nan


def beginnings(seed: int = SEED) -> tuple[Beginnings, Beginnings, Beginnings]:
    """Simulate the start of falls of 3 kg, K = 1.10, over A, instant of the sine and position of the gear."""
    plans = planned_falls(seed)[3:6]  # K = 1.10 with all A
    tests = [replace(plan.test, duration=ZOOM) for plan in plans]
    middle = replace(tests[0], control=tests[1].control)
    moments = [round(TRANSPARENCY_STEPS / FREQUENCY * number / TRIALS) for number in range(TRIALS)]
    turns = 2.0 * math.pi * np.arange(TRIALS) / TRIALS
    return (
        Beginnings(f"A, {STEP:g} counts apart", tuple(_begin(test, seed) for test in tests)),
        Beginnings("moment in the sine", tuple(_begin(middle, seed, duty_start=tick) for tick in moments)),
        Beginnings("place on the gear", tuple(_begin(middle, seed, ripple_phase=turn) for turn in turns)),
    )


def _begin(test: BenchJoint, seed: int, *, duty_start: int = 0, ripple_phase: float = 0.0) -> BenchRun:
    variation = BenchVariation(duty_start=duty_start, ripple_phase=float(ripple_phase))
    return simulate_bench(test, seed=seed, variation=variation)


def spread_of_wait(period: float, share: float) -> float:
    r"""Return the spread of the waiting time until the joint can start, for a uniform switch-on time.

    The wait is 0 in the share :math:`s` of each period :math:`T` and uniform up to :math:`(1-s)T` in the
    rest: :math:`\sigma^2 = T^2 [(1-s)^3/3 - (1-s)^4/4]`.
    """
    rest = 1.0 - share
    return period * math.sqrt(rest**3 / 3.0 - rest**4 / 4.0)


def breakaway_numbers(sets: Sequence[Beginnings]) -> dict[str, float]:
    """Return the spreads of the times of break-away, and the change by A."""
    amplitudes, moments, positions = sets
    times = amplitudes.breakaway
    return {
        "change": float(times[-1] - times[0]),
        "sine": moments.spread,
        # Half of a sine drives the joint along the fall; at the other end one moment of it does.
        "sine_low": spread_of_wait(1.0 / FREQUENCY, 0.5),
        "sine_high": spread_of_wait(1.0 / FREQUENCY, 0.0),
        "amplitude_ms": 1e3 * amplitudes.spread,
        "sine_ms": 1e3 * moments.spread,
        "gear_ms": 1e3 * positions.spread,
        "sine_over_amplitude": moments.spread / amplitudes.spread,
    }
