"""``twin-gait bench``: the joint test bench and its campaign."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED
from twin_gait.exceptions import RunDirectoryError
from twin_gait.vocabulary import JointName

if TYPE_CHECKING:
    from twin_gait.simulation.bench_joint import BenchRun
    from twin_gait.studies.campaign import CampaignResult
    from twin_gait.worlds.bench_joint import BenchJoint, DutyControl, TorqueControl

CONTROLLERS = ("duty", "friction", "old-friction", "impedance", "off")
# Words that are chosen: option, words, default, meaning.
_FORMS = (
    ("--load-angle", ("corrected", "printed"), "corrected", "form of (2.8)"),
    ("--current-loop", ("pi", "ideal"), "pi", "of figure 2.13, or perfect (pi)"),
)
_CONTROLLER = ("--controller", CONTROLLERS, "friction", "what drives the motor (friction)")
_HOW = "the thesis's falls, or driven by the motor to ±2.5 rad/s (drop)"
_PROTOCOL = ("--protocol", ("drop", "two-way"), "drop", _HOW)
# Numbers of the bench, of one test, and of its controller: option, default, unit, meaning.
_BENCH = (
    ("--friction-ratio", 1.0, "S", "true friction over table 3.1 (1)"),
    ("--friction-ripple-Nm", 0.3, "NM", "friction that repeats with the gear (0.3)"),
    ("--lever-m", 0.30, "M", "from the axis to the weight (0.30)"),
)
_TEST = (
    ("--mass", 2.0, "KG", "weight on the link (2)"),
    ("--duration", 5.0, "S", "of the test (5)"),
    ("--start-angle-deg", 90.0, "DEG", "90 is level (90)"),
    ("--imposed-amplitude-deg", None, "DEG", "motion imposed on the link: so far and back"),
    ("--imposed-frequency-Hz", 0.25, "HZ", "of the imposed motion (0.25)"),
    ("--friction-compensation-gain", 0.35, "G", "G (0.35)"),
    ("--target-torque-Nm", 0.0, "NM", "of equation (2.16) (0)"),
    ("--stiffness-Nm-per-deg", 0.05, "K", "of the impedance (0.05)"),
    ("--damping-Nms-per-rad", 0.0, "B", "of the impedance (0)"),
    ("--equilibrium-deg", 60.0, "DEG", "of the impedance (60)"),
    ("--inertia-compensation", 0.0, "SHARE", "of the known inertia (0)"),
    ("--transparency-gain", 1.10, "K", "K of the duty control (1.10)"),
    ("--amplitude-counts", 170.0, "A", "A of the duty control (170)"),
    ("--frequency-Hz", 3.0, "HZ", "f of the duty control (3)"),
)


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    about = "Simulate the joint test bench of the thesis. All data that it writes are synthetic."
    parser = commands.add_parser("bench", help="simulate the joint test bench", description=about)
    actions = parser.add_subparsers(
        dest="action", required=True, parser_class=type(parser), metavar="campaign|run"
    )
    campaign = options.add_command(actions, "campaign", run_campaign_command)
    options.add_numbers(
        campaign, (*_BENCH, ("--longest", 20.0, "S", "when a fall that sticks is ended (20)"))
    )
    campaign.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder to make")
    test = options.add_command(actions, "run", run_test_command)
    options.add_numbers(test, (*_BENCH, *_TEST))
    options.add_out(test, "FILE", "log to write", required=True)
    for one, words in ((campaign, _PROTOCOL), (test, _CONTROLLER)):
        one.add_argument("--joint", choices=("knee", "hip"), required=True, help="whose motor and friction")
        options.add(one, "--seed")
        options.add_choices(one, (*_FORMS, words))


def bench_of(arguments: argparse.Namespace) -> BenchJoint:
    """The bench as the options describe it, without a controller."""
    from twin_gait import worlds as world

    law = world.BENCH_FRICTION[arguments.joint].scaled(arguments.friction_ratio)
    bench = world.bench_joint(
        JointName(arguments.joint),
        friction=world.BenchFriction(law=law, ripple=arguments.friction_ripple_Nm),
        link=world.LinkParameters(lever=arguments.lever_m, load_angle=world.LoadAngle(arguments.load_angle)),
    )
    return replace(bench, drive=replace(bench.drive, loop=world.CurrentLoop(arguments.current_loop)))


def run_campaign_command(arguments: argparse.Namespace) -> int:
    """Five weights, nine tests each, as log files.

    Simulate a testing campaign: 45 .log files in the thesis's columns, and campaign.json with the true
    friction.
    """
    from twin_gait.simulation import RunStatus
    from twin_gait.studies import Campaign, Protocol, run_campaign

    out = arguments.out
    campaign = Campaign(
        joint=JointName(arguments.joint),
        protocol=Protocol(arguments.protocol),
        seed=arguments.seed,
        bench=bench_of(arguments),
        longest=arguments.longest,
    )
    if out.exists():
        raise RunDirectoryError(f"{out}: exists; choose another --out")
    with terminal.watched(str(campaign.protocol), "test") as watch:
        result = run_campaign(campaign, out, **watch)
    print("\n".join(report_campaign(result)))
    if result.status is RunStatus.INTERRUPTED:
        return terminal.interrupted("the logs so far are kept")
    return DONE


def report_campaign(result: CampaignResult) -> Iterator[str]:
    """Results in a few lines."""
    tests = result.tests
    yield f"{result.status}: {len(tests)} synthetic logs in {result.directory}"
    if not tests:
        return
    fastest = max(test["highest_velocity_rad_per_s"] for test in tests)
    slowest = min(test["lowest_velocity_rad_per_s"] for test in tests)
    yield f"  joint velocity {slowest:.2f} to {fastest:.2f} rad/s"
    stops = sum(test["stop_s"] is not None for test in tests)
    if stops:
        yield f"  {stops} reached the stop, {len(tests) - stops} stuck or still on their way"
    diverged = [test["file"] for test in tests if test["status"] == "diverged"]
    if diverged:
        yield f"  diverged: {', '.join(diverged)}"


def run_test_command(arguments: argparse.Namespace) -> int:
    """One test, with what no bench can measure beside it.

    Simulate one test and write its log with the true motion, friction and current.
    """
    from twin_gait.files import write_atomically
    from twin_gait.parameters.quantities import WHOLE
    from twin_gait.simulation import RunStatus
    from twin_gait.simulation.bench_joint import simulate_bench
    from twin_gait.studies.campaign import log_text
    from twin_gait.worlds.bench_leg import ImposedMotionParameters

    WHOLE.require("seed", arguments.seed)
    options.check_file("--out", arguments.out, force=arguments.force)
    bench, imposed = bench_of(arguments), None
    if arguments.imposed_amplitude_deg is not None:
        amplitude, frequency = math.radians(arguments.imposed_amplitude_deg), arguments.imposed_frequency_Hz
        joint = JointName(arguments.joint)
        imposed = ImposedMotionParameters(joint=joint, amplitude=amplitude, frequency=frequency)
    test = replace(
        bench,
        link=replace(bench.link, mass=arguments.mass),
        control=_control_of(arguments),
        imposed_motion=imposed,
        start_angle=math.radians(arguments.start_angle_deg),
        duration=arguments.duration,
    )
    with terminal.watched("simulating", "tick") as watch:
        run = simulate_bench(test, seed=arguments.seed, **watch)
    header = {
        "joint": arguments.joint, "controller": arguments.controller, "mass_kg": f"{arguments.mass:g}",
        "seed": arguments.seed, "status": str(run.status),
    }  # fmt: skip
    write_atomically(arguments.out, log_text(run, header, truth=True))
    print("\n".join(report_test(run, arguments.out)))
    if run.status is RunStatus.INTERRUPTED:
        return terminal.interrupted("the log so far is kept")
    return FAILED if run.status is RunStatus.DIVERGED else DONE


def _control_of(arguments: argparse.Namespace) -> DutyControl | TorqueControl | None:
    from twin_gait import worlds as world

    joint = JointName(arguments.joint)
    if arguments.controller == "off":
        return None
    if arguments.controller == "duty":
        return world.DutyControl(
            amplitude=arguments.amplitude_counts,
            frequency=arguments.frequency_Hz,
            transparency_gain=arguments.transparency_gain,
            lowest_velocity=world.LOWEST_VELOCITIES[joint],
        )
    springy = arguments.controller == "impedance"
    return world.TorqueControl(
        friction_model=world.BENCH_FRICTION[joint],
        old_model=world.OldFrictionModel() if arguments.controller == "old-friction" else None,
        friction_compensation_gain=arguments.friction_compensation_gain,
        target_torque=arguments.target_torque_Nm,
        stiffness=math.degrees(arguments.stiffness_Nm_per_deg) if springy else 0.0,
        damping=arguments.damping_Nms_per_rad if springy else 0.0,
        equilibrium_angle=math.radians(arguments.equilibrium_deg),
        inertia_compensation=arguments.inertia_compensation,
    )


def report_test(run: BenchRun, out: Path) -> Iterator[str]:
    """What one looks at first."""
    import numpy as np

    from twin_gait.studies.campaign import summarise

    velocity, summary = run.column("motor_velocity_rad_per_s"), summarise(run)
    yield f"{run.status}: {len(run.rows) * 1e-3:g} s of synthetic data in {out}"
    yield f"  joint velocity {velocity.min():.3f} to {velocity.max():.3f} rad/s"
    for name, words in (("breakaway_s", "moved by 1°"), ("stop_s", "reached the stop")):
        if summary[name] is not None:
            yield f"  {words} after {summary[name]:g} s"
    yield f"  RMSE of target and measured current {summary['current_rmse_A']:.4f} A"
    if run.test.imposed_motion is not None:
        torque = run.column("imposed_motion_torque_Nm")
        rms, most = np.sqrt(np.mean(torque * torque)), np.abs(torque).max()
        yield f"  the imposed motion needed {rms:.2f} N m RMS, {most:.2f} N m at most"
