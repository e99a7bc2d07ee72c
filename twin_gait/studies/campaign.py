"""Test campaigns on the simulated joint bench: that of the thesis (section 2.2.3), and a motor-driven one."""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np

from twin_gait import __version__
from twin_gait.configuration.bench_device import BENCH_DEVICE, bench_joint
from twin_gait.configuration.device_file import load_device
from twin_gait.files import write_atomically, write_json
from twin_gait.parameters import quantities
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.simulation.bench_joint.episode import LOG_COLUMNS, BenchVariation
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.simulation.run import RunStatus
from twin_gait.studies.jobs import WorkCallbacks, run_jobs
from twin_gait.vocabulary import JointName
from twin_gait.worlds.bench_control import LOWEST_VELOCITIES, CosinePath, DutyControl, TorqueControl
from twin_gait.worlds.bench_joint import HORIZONTAL, BenchJoint

WEIGHTS = (3.0, 2.5, 2.0, 1.5, 1.0)  # [kg], thesis 2.2.3
TESTS_PER_WEIGHT = 9
TRANSPARENCY_GAINS = (1.0, 1.10, 1.15)  # K, thesis 2.2.3
FREQUENCY = 3.0  # f in [Hz], thesis 2.2.3
AMPLITUDE_RANGE = (140.0, 195.0)  # A in counts from the heaviest to the lightest weight, thesis 2.2.3
AMPLITUDE_STEP = 5.0  # [counts]; "by 5 or 10", thesis appendix B
REST_AT_STOP = 0.3  # [s]; duration of the log after the joint reached the stop
LONGEST_DROP = 20.0  # [s]; the test of a joint that sticks ends after this time
# The path of the motor-driven tests starts horizontally at 90°, so that logs of both protocols are read in
# the same way, rises by at most 92° and returns; its period is the shortest that keeps 2.5 rad/s within the
# range of the joint.
TWO_WAY_SPEEDS = (0.15, 2.5)  # peaks of the first and the last test in [rad/s]
TWO_WAY_PERIOD = 2.0  # [s]
TWO_WAY_STIFFNESS = 600.0  # [N·m/rad]; an assumption, 13 rad/s on the bare armature
TWO_WAY_DAMPING_RATIO = 0.7  # on the bare armature
SETTINGS_FILE = "campaign.json"
CAMPAIGN = FolderKind("a campaign", SETTINGS_FILE)
# Standard deviations between tests with the same settings (assumptions): of the friction, as a fraction, and
# of the offset of the current measurement in [A].
SPREAD = {"friction": 0.02, "current_offset": 0.005}
_DIGITS = "%.9g"


class Protocol(StrEnum):
    """Way in which the joint is moved."""

    # protocol of the thesis: the weight falls from 90° to the stop under duty-based transparency
    DROP = "drop"
    TWO_WAY = "two-way"  # the motor moves the joint back and forth, at up to ±2.5 rad/s


@dataclass(frozen=True, kw_only=True)
class Campaign(quantities.Parameters):
    """A campaign on one joint.

    Attributes:
        joint: Joint with a drive.
        protocol: Way in which the joint is moved.
        seed: Seed of everything that is random.
        device: Name of a shipped device, or path of a file, with drive and friction of the joint.
        bench: Bench without weight and controller; None for the bench of the joint of the device.
        cycles: Number of back-and-forth cycles in a motor-driven test.
    """

    joint: JointName
    protocol: Protocol = Protocol.DROP
    seed: Annotated[int, quantities.SEEDS] = 0
    device: str = BENCH_DEVICE
    bench: BenchJoint | None = None
    cycles: Annotated[int, quantities.integer_range(1, 1000, "half an hour of strides")] = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        self.plain_bench()  # raises an error for a joint without a drive

    def plain_bench(self) -> BenchJoint:
        """Return the bench to start from, with a friction ripple of 0.3 N·m.

        The ripple is an assumption: some teeth of the gear have more friction.
        """
        if self.bench is not None:
            return self.bench
        bench = bench_joint(self.joint, self.device)
        return replace(bench, friction=replace(bench.friction, ripple=0.3))

    @property
    def friction_model(self) -> FrictionParameters:
        """Friction model of the compensator of the device; without a gain it is not used."""
        model: FrictionParameters = (
            load_device(self.device).parameters()["control"].friction_model[self.joint]
        )
        return model


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """One test of a campaign."""

    name: str  # name of the file
    mass: float  # mass on the link in [kg]
    number: int  # number of the test with this weight, 1 to 9
    settings: Mapping[str, float]  # settings for the header of the log
    test: BenchJoint  # bench of the test
    variation: BenchVariation  # random deviations
    noise_seed: int  # seed of the sensor noise


def planned_tests(campaign: Campaign) -> list[PlannedTest]:
    """Return the tests of a campaign, weight by weight, nine for each of five weights.

    Each test has its own seed.
    """
    plans, bench = [], campaign.plain_bench()
    seeds = np.random.SeedSequence(campaign.seed).spawn(len(WEIGHTS) * TESTS_PER_WEIGHT)
    for index, seed in enumerate(seeds):
        mass, number = WEIGHTS[index // TESTS_PER_WEIGHT], index % TESTS_PER_WEIGHT + 1
        if campaign.protocol is Protocol.DROP:
            settings, changes = _drop(campaign.joint, mass, number)
        else:
            settings, changes = _two_way(campaign, number)
        link = replace(bench.link, mass=mass)
        test = replace(bench, link=link, start_angle=HORIZONTAL, **changes)
        rng = np.random.default_rng(seed)
        variation = BenchVariation(
            current_offset=SPREAD["current_offset"] * float(rng.standard_normal()),
            friction_ratio=max(0.0, 1.0 + SPREAD["friction"] * float(rng.standard_normal())),
            ripple_phase=float(rng.uniform(0.0, 2.0 * math.pi)),
            duty_start=int(rng.integers(0, 1000)),
        )
        name, noise = f"{campaign.joint}_{mass:g}kg_{number}.log", int(seed.generate_state(1)[0])
        plans.append(PlannedTest(name, mass, number, settings, test, variation, noise))
    return plans


def drop_amplitude(mass: float, step: int) -> float:
    """Compute the amplitude A of the protocol for a weight, in counts.

    It is 140 to 150 counts for 3 kg and 185 to 195 counts for 1 kg, linear in between. ``mass``: in [kg].
    ``step``: 0, 1 or 2, in units of ``AMPLITUDE_STEP``.
    """
    lowest, highest = AMPLITUDE_RANGE
    lightness = (WEIGHTS[0] - mass) / (WEIGHTS[0] - WEIGHTS[-1])
    return lowest + lightness * (highest - lowest - 2.0 * AMPLITUDE_STEP) + step * AMPLITUDE_STEP


def _drop(joint: JointName, mass: float, number: int) -> tuple[dict[str, float], dict[str, Any]]:
    """Return the settings of a drop test, and the changes of the bench."""
    gain, amplitude = TRANSPARENCY_GAINS[(number - 1) // 3], drop_amplitude(mass, (number - 1) % 3)
    control = DutyControl(
        amplitude=amplitude,
        frequency=FREQUENCY,
        transparency_gain=gain,
        lowest_velocity=LOWEST_VELOCITIES.get(joint, LOWEST_VELOCITIES[JointName.KNEE]),
    )
    changes = {"control": control, "duration": LONGEST_DROP, "rest_at_stop": REST_AT_STOP}
    return {"K": gain, "A_counts": amplitude, "f_Hz": FREQUENCY}, changes


def _two_way(campaign: Campaign, number: int) -> tuple[dict[str, float], dict[str, Any]]:
    """Return the settings of a motor-driven test, and the changes of the bench.

    They do not depend on the weight.
    """
    lowest, highest = TWO_WAY_SPEEDS
    speed = lowest + (number - 1) / (TESTS_PER_WEIGHT - 1) * (highest - lowest)
    amplitude, frequency = -speed * TWO_WAY_PERIOD / math.pi, 1.0 / TWO_WAY_PERIOD
    armature = campaign.plain_bench().actuator.armature
    control = TorqueControl(
        friction_model=campaign.friction_model,
        friction_compensation_gain=0.0,
        stiffness=TWO_WAY_STIFFNESS,
        damping=2.0 * TWO_WAY_DAMPING_RATIO * math.sqrt(TWO_WAY_STIFFNESS * armature),
        path=CosinePath(start_angle=HORIZONTAL, amplitude=amplitude, frequency=frequency),
    )
    settings = {"peak_speed_rad_per_s": speed, "period_s": TWO_WAY_PERIOD, "cycles": float(campaign.cycles)}
    return settings, {"control": control, "duration": campaign.cycles * TWO_WAY_PERIOD}


def run_campaign(campaign: Campaign, directory: Path, **watch: Unpack[WorkCallbacks]) -> dict[str, Any]:
    """Simulate a campaign and write its logs; the folder appears when all of them are done.

    Returns the content of ``campaign.json``: ``status``, and ``tests`` with an entry for each. Raises
    RunDirectoryError if the folder exists or cannot be written.
    """
    plans = planned_tests(campaign)
    with staged_directory(directory, CAMPAIGN) as staging:
        lines = run_jobs(partial(_perform, campaign, staging, watch.get("on_compile")), plans, **watch)
        status = RunStatus.COMPLETED if len(lines) == len(plans) else RunStatus.INTERRUPTED
        document = {
            "synthetic": True, "twin_gait_version": __version__, "joint": campaign.joint,
            "protocol": campaign.protocol, "seed": campaign.seed, "status": status,
            "columns": LOG_COLUMNS, "bench": asdict(campaign.plain_bench()), "spread": SPREAD,
            "tests": lines,
        }  # fmt: skip
        write_json(staging / SETTINGS_FILE, document)
    return document


def _perform(
    campaign: Campaign, folder: Path, on_compile: Callable[[], None] | None, plan: PlannedTest
) -> dict[str, Any]:
    """Simulate a test and write its log; return its entry for ``campaign.json``."""
    run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation, on_compile=on_compile)
    header = {
        "joint": str(campaign.joint), "protocol": str(campaign.protocol), "mass_kg": f"{plan.mass:g}",
        "test": plan.number, **{name: f"{value:g}" for name, value in plan.settings.items()},
        "campaign_seed": campaign.seed,
    }  # fmt: skip
    write_atomically(folder / plan.name, log_text(run, header))
    return {
        "file": plan.name,
        "mass_kg": plan.mass,
        "test": plan.number,
        **plan.settings,
        "status": str(run.status),
        "duration_s": round(len(run.log) * 1e-3, 3),
        "variation": asdict(plan.variation),
        "noise_seed": plan.noise_seed,
    }


def log_text(run: BenchRun, header: Mapping[str, object]) -> str:
    """Return a log as text: comments, column names with units, one row per millisecond.

    The lines ``# name: value`` of the header follow the line that states that the data are synthetic.
    """
    first = f"# synthetic data: simulated by twin_gait {__version__}, not measured"
    lines = [first, *(f"# {name}: {value}" for name, value in header.items())]
    return "\n".join(lines) + "\n" + run.log[list(LOG_COLUMNS)].to_csv(index=False, float_format=_DIGITS)
