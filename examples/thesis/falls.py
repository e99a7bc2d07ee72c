"""The falls of the knee under duty-based transparency control, and what decides when it breaks away."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from thesis.bench import KNEE, SEED
from thesis.friction import DEVIATIONS, FACTOR, WINDOW, table_values

from twin_gait.identification import BenchSetup, moving_average
from twin_gait.simulation import BenchRun, BenchVariation, simulate_bench
from twin_gait.studies import Campaign, PlannedTest, planned_tests
from twin_gait.worlds import (
    BENCH_ACTUATORS,
    HORIZONTAL,
    STOP_ANGLE,
    TRANSPARENCY_STEPS,
    BenchJoint,
    DutyControl,
    LoadAngle,
    bench_joint,
)

BENCH = bench_joint(KNEE)
MASSES = (3.0, 2.5, 2.0, 1.5, 1.0)  # [kg], thesis 2.2.3
GAINS = (1.0, 1.10, 1.15)  # K, thesis 2.2.3
FREQUENCY = 3.0  # f in [Hz], thesis 2.2.3
AMPLITUDES = (140.0, 195.0)  # A in counts from the heaviest to the lightest weight, thesis 2.2.3
STEP = 5.0  # of A in counts, thesis appendix B
PLACES = 24  # in the sine or on the gear that are tried
ZOOM = 1.5  # [s] of a fall that is simulated to see it begin


@dataclass(frozen=True, eq=False)
class Fall:
    """A fall up to the stop: K, A in counts; time in [s], angle, logged velocity, and share of full duty."""

    gain: float
    amplitude: float
    time: np.ndarray
    angle: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """After the thesis's post-processing, at 100 Hz in [rad] / [s]."""
        return moving_average(self.velocity[::FACTOR], WINDOW)

    @property
    def mean_speed(self) -> float:
        """Way over time in [rad] / [s]."""
        return float((self.angle[-1] - self.angle[0]) / self.time[-1])

    @property
    def roughness(self) -> float:
        """Ups and downs of the filtered speed over its largest: 1 if it only grows, 2 more with a stall."""
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
    """Torque of the standing knee by one count of duty, K_t τ V/(N R), in [N m]."""
    motor = BENCH.actuator
    current = BENCH.battery.voltage / (BENCH.drive.counts * motor.resistance)
    return motor.torque_constant * motor.gear_ratio * current


def neutral_gain(joint: str = KNEE) -> float:
    r"""K beyond which the linear part of (2.1b) speeds the joint up.

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
    """Load torque of the bench in [N m], equation (2.8), as corrected or as printed."""
    return BenchSetup(actuator=BENCH_ACTUATORS[KNEE], load_angle=form).load_torque(angle, mass)


def fall_numbers(mass: float, seed: int = SEED) -> dict[str, Any]:
    """Speeds of the falls of a weight, and how rough they are beside those of the next heavier one."""
    falls, place = falls_of(mass, seed), MASSES.index(mass)
    slow, fast = (np.mean([fall.mean_speed for fall in falls if fall.gain == K]) for K in GAINS[::2])
    numbers: dict[str, Any] = {
        "speed_ratio": float(fast / slow),
        "slowest": float(np.mean([fall.time[-1] for fall in falls if fall.gain == GAINS[0]])),
    }
    if place:
        pairs = zip(falls, falls_of(MASSES[place - 1], seed), strict=True)
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
    """Falls that differ in one thing, which ``label`` names."""

    label: str
    runs: tuple[BenchRun, ...]

    @property
    def breakaway(self) -> np.ndarray:
        """Times in [s] after which the joint has moved by 1°; NaN for one that did not."""
        return np.array([_breakaway(run) for run in self.runs])

    @property
    def spread(self) -> float:
        """Standard deviation of these times in [s]."""
        return float(np.std(self.breakaway))


def _breakaway(run: BenchRun) -> float:
    moved = np.abs(run.column("link_angle_rad") - run.test.start_angle) > math.radians(1.0)
    return round(float(np.argmax(moved)) * 1e-3, 3) if moved.any() else math.nan


def beginnings(seed: int = SEED) -> tuple[Beginnings, Beginnings, Beginnings]:
    """First instants of a fall of 3 kg with K = 1.10: over A, moment in the sine, place on the gear."""
    plans = planned_falls(seed)[3:6]  # K = 1.10 with all A
    tests = [replace(plan.test, duration=ZOOM) for plan in plans]
    middle = replace(tests[0], control=tests[1].control)
    moments = [round(TRANSPARENCY_STEPS / FREQUENCY * place / PLACES) for place in range(PLACES)]
    turns = 2.0 * math.pi * np.arange(PLACES) / PLACES
    return (
        Beginnings(f"A, {STEP:g} counts apart", tuple(_begin(test, seed) for test in tests)),
        Beginnings("moment in the sine", tuple(_begin(middle, seed, duty_start=tick) for tick in moments)),
        Beginnings("place on the gear", tuple(_begin(middle, seed, ripple_phase=turn) for turn in turns)),
    )


def _begin(test: BenchJoint, seed: int, *, duty_start: int = 0, ripple_phase: float = 0.0) -> BenchRun:
    variation = BenchVariation(duty_start=duty_start, ripple_phase=float(ripple_phase))
    return simulate_bench(test, seed=seed, variation=variation)


def spread_of_wait(period: float, share: float) -> float:
    r"""Spread of the wait for a moment at which the joint can start, switched on at any moment alike.

    The wait is 0 in the share :math:`s` of each period :math:`T` and uniform up to :math:`(1-s)T` in the
    rest: :math:`\sigma^2 = T^2 [(1-s)^3/3 - (1-s)^4/4]`.
    """
    rest = 1.0 - share
    return period * math.sqrt(rest**3 / 3.0 - rest**4 / 4.0)


def breakaway_numbers(sets: Sequence[Beginnings]) -> dict[str, float]:
    """Spreads of the times of break-away, and the change by A."""
    amplitudes, moments, places = sets
    times = amplitudes.breakaway
    return {
        "change": float(times[-1] - times[0]),
        "sine": moments.spread,
        # Half of a sine drives the joint along the fall; at the other end one moment of it does.
        "sine_low": spread_of_wait(1.0 / FREQUENCY, 0.5),
        "sine_high": spread_of_wait(1.0 / FREQUENCY, 0.0),
        "amplitude_ms": 1e3 * amplitudes.spread,
        "sine_ms": 1e3 * moments.spread,
        "gear_ms": 1e3 * places.spread,
        "sine_over_amplitude": moments.spread / amplitudes.spread,
    }
