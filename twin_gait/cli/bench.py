"""``twin-gait bench``: the joint test bench and its campaign."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli.options import check_file
from twin_gait.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    note_compilation,
    progress_bar,
    stop_on_interrupt,
)

if TYPE_CHECKING:
    from twin_gait.scenario.bench_joint import BenchJoint, DutyControl, TorqueControl
    from twin_gait.scenario.bench_leg import HandParameters
    from twin_gait.simulation.bench_joint import BenchRun
    from twin_gait.studies.campaign import CampaignResult

CONTROLLERS = ("duty", "friction", "old-friction", "impedance", "off")


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "bench",
        help="the joint test bench: one test, or a campaign of 45",
        description="Simulate the joint test bench of the thesis. All data that it writes are synthetic.",
    )
    actions = parser.add_subparsers(
        dest="action", required=True, parser_class=type(parser), metavar="campaign|run"
    )
    _add_campaign(actions)
    _add_run(actions)


def _add_campaign(actions: Any) -> None:
    parser = actions.add_parser(
        "campaign",
        help="five weights, nine tests each, as log files",
        description=(
            "Simulate a testing campaign: 45 .log files in the thesis's columns, and campaign.json with the "
            "true friction."
        ),
    )
    _add_bench(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder to make")
    parser.add_argument(
        "--protocol",
        choices=("drop", "two-way", "both"),
        default="drop",
        help="the thesis's falls, or led by the motor to ±2.5 rad/s, or a folder for each (drop)",
    )
    parser.add_argument(
        "--longest-s", type=float, default=20.0, metavar="S", help="when a fall that sticks is ended (20)"
    )
    parser.set_defaults(run=run_campaign_command)


def _add_run(actions: Any) -> None:
    parser = actions.add_parser(
        "run",
        help="one test, with what no bench can see beside it",
        description="Simulate one test and write its log with the true motion, friction and current.",
    )
    _add_bench(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", required=True, help="log to write")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    add = parser.add_argument
    add("--controller", choices=CONTROLLERS, default="friction", help="what drives the motor (friction)")
    add("--mass-kg", type=float, default=2.0, metavar="KG", help="weight on the link (2)")
    add("--duration-s", type=float, default=5.0, metavar="S", help="of the test (5)")
    add("--start-angle-deg", type=float, default=90.0, metavar="DEG", help="90 is level (90)")
    add("--friction-compensation-gain", type=float, default=0.35, metavar="G", help="G (0.35)")
    add("--target-torque-Nm", type=float, default=0.0, metavar="NM", help="of equation (2.16) (0)")
    add("--stiffness-Nm-per-deg", type=float, default=0.05, metavar="K", help="of the impedance (0.05)")
    add("--damping-Nms-per-rad", type=float, default=0.0, metavar="B", help="of the impedance (0)")
    add("--equilibrium-deg", type=float, default=60.0, metavar="DEG", help="of the impedance (60)")
    add("--inertia-compensation", type=float, default=0.0, metavar="SHARE", help="of the known inertia (0)")
    add("--transparency-gain", type=float, default=1.10, metavar="K", help="K of the duty control (1.10)")
    add("--amplitude-counts", type=float, default=170.0, metavar="A", help="A of the duty control (170)")
    add("--frequency-Hz", type=float, default=3.0, metavar="HZ", help="f of the duty control (3)")
    add("--hand-amplitude-deg", type=float, metavar="DEG", help="a hand leads the link so far and back")
    add("--hand-frequency-Hz", type=float, default=0.25, metavar="HZ", help="of the hand (0.25)")
    parser.set_defaults(run=run_test_command)


def _add_bench(parser: Any) -> None:
    """What a test and a campaign have in common."""
    add = parser.add_argument
    add("--joint", choices=("knee", "hip"), required=True, help="whose motor and friction")
    add("--seed", type=int, default=0, metavar="N", help="of everything that chance decides (0)")
    add("--friction-ratio", type=float, default=1.0, metavar="S", help="true friction over table 3.1 (1)")
    add("--friction-ripple-Nm", type=float, metavar="NM", help="friction that repeats with the gear (0.3)")
    add("--friction-per-load", type=float, default=0.0, metavar="SHARE", help="Coulomb friction per load (0)")
    add("--lever-m", type=float, default=0.30, metavar="M", help="from the axis to the weight (0.30)")
    add("--load-angle", choices=("corrected", "printed"), default="corrected", help="form of (2.8)")
    add("--current-loop", choices=("pi", "ideal"), default="pi", help="of figure 2.13, or perfect (pi)")
    add("--current-noise-A", type=float, metavar="A", help="of a current sample (0.011)")
    add("--battery-V", type=float, default=28.8, metavar="V", help="open-circuit voltage (28.8)")
    add("--gear-temperature-degC", type=float, metavar="C", help="adds the gear's losses from its catalogue")
    add("--torsional-stiffness-Nm-per-rad", type=float, metavar="K", help="of the gear (rigid)")


def bench_of(arguments: argparse.Namespace) -> BenchJoint:
    """The bench as the flags describe it, without a controller.

    Args:
        arguments: Of the command line.

    Returns:
        The bench.
    """
    from twin_gait.parameters import BatteryParameters
    from twin_gait.scenario.bench_joint import (
        BENCH_FRICTION,
        BenchFriction,
        CatalogueEfficiency,
        CurrentLoop,
        LinkParameters,
        LoadAngle,
        Torsion,
        bench_joint,
    )
    from twin_gait.vocabulary import JointName

    joint = JointName(arguments.joint)
    bench = bench_joint(
        joint,
        friction=BenchFriction(
            law=BENCH_FRICTION[joint].scaled(arguments.friction_ratio),
            coulomb_per_load=arguments.friction_per_load,
            ripple=0.3 if arguments.friction_ripple_Nm is None else arguments.friction_ripple_Nm,
        ),
        link=LinkParameters(lever=arguments.lever_m, load_angle=LoadAngle(arguments.load_angle)),
        battery=BatteryParameters(voltage=arguments.battery_V),
    )
    drive = replace(bench.drive, loop=CurrentLoop(arguments.current_loop))
    if arguments.current_noise_A is not None:
        drive = replace(drive, noise=arguments.current_noise_A)
    temperature, stiffness = arguments.gear_temperature_degC, arguments.torsional_stiffness_Nm_per_rad
    return replace(
        bench,
        drive=drive,
        efficiency=None if temperature is None else CatalogueEfficiency(temperature=temperature),
        torsion=None if stiffness is None else Torsion(stiffness=stiffness),
    )


def run_campaign_command(arguments: argparse.Namespace) -> int:
    """Simulate one campaign or both."""
    from twin_gait.exceptions import RunDirectoryError
    from twin_gait.simulation import RunStatus
    from twin_gait.studies.campaign import Campaign, Protocol, run_campaign
    from twin_gait.vocabulary import JointName

    both = arguments.protocol == "both"
    protocols = list(Protocol) if both else [Protocol(arguments.protocol)]
    campaigns = [
        Campaign(
            joint=JointName(arguments.joint),
            protocol=protocol,
            seed=arguments.seed,
            bench=bench_of(arguments),
            longest=arguments.longest_s,
        )
        for protocol in protocols
    ]
    if arguments.out.exists():
        raise RunDirectoryError(f"{arguments.out}: exists; choose another --out")
    for campaign in campaigns:
        folder = arguments.out / str(campaign.protocol) if both else arguments.out
        with (
            stop_on_interrupt() as should_stop,
            progress_bar(str(campaign.protocol), "test") as progress,
        ):
            result = run_campaign(
                campaign, folder, progress=progress, should_stop=should_stop, on_compile=note_compilation
            )
        report_campaign(result)
        if result.status is RunStatus.INTERRUPTED:
            print("twin-gait: interrupted; the logs so far are kept", file=sys.stderr)
            return INTERRUPTED
    return DONE


def report_campaign(result: CampaignResult) -> None:
    """Print what came out, in a few lines."""
    tests = result.tests
    print(f"{result.status}: {len(tests)} synthetic logs in {result.directory}")
    if not tests:
        return
    fastest = max(test["highest_velocity_rad_per_s"] for test in tests)
    slowest = min(test["lowest_velocity_rad_per_s"] for test in tests)
    print(f"  joint velocity {slowest:.2f} to {fastest:.2f} rad/s")
    stops = sum(test["stop_s"] is not None for test in tests)
    if stops:
        print(f"  {stops} reached the stop, {len(tests) - stops} stuck or still on their way")
    diverged = [test["file"] for test in tests if test["status"] == "diverged"]
    if diverged:
        print(f"  diverged: {', '.join(diverged)}")


def run_test_command(arguments: argparse.Namespace) -> int:
    """Simulate one test."""
    from twin_gait.files import write_atomically
    from twin_gait.parameters import require
    from twin_gait.simulation import RunStatus
    from twin_gait.simulation.bench_joint import simulate_bench
    from twin_gait.studies.campaign import log_text

    require(arguments.seed >= 0, "seed", "a whole number of 0 or more", arguments.seed)
    out: Path = arguments.out
    check_file("--out", out, force=arguments.force)
    bench = bench_of(arguments)
    test = replace(
        bench,
        link=replace(bench.link, mass=arguments.mass_kg),
        control=_control_of(arguments),
        hand=_hand_of(arguments),
        start_angle=math.radians(arguments.start_angle_deg),
        duration=arguments.duration_s,
    )
    with stop_on_interrupt() as should_stop, progress_bar("simulating", "tick") as progress:
        run = simulate_bench(
            test,
            seed=arguments.seed,
            progress=progress,
            should_stop=should_stop,
            on_compile=note_compilation,
        )
    header = {
        "joint": arguments.joint,
        "controller": arguments.controller,
        "mass_kg": f"{arguments.mass_kg:g}",
        "seed": arguments.seed,
        "status": str(run.status),
    }
    write_atomically(out, log_text(run, header, truth=True))
    report_test(run, out)
    if run.status is RunStatus.INTERRUPTED:
        print("twin-gait: interrupted; the log so far is kept", file=sys.stderr)
        return INTERRUPTED
    return FAILED if run.status is RunStatus.DIVERGED else DONE


def _control_of(arguments: argparse.Namespace) -> DutyControl | TorqueControl | None:
    from twin_gait.control import Controller
    from twin_gait.scenario.bench_joint import (
        BENCH_FRICTION,
        LOWEST_VELOCITIES,
        DutyControl,
        OldFrictionModel,
        TorqueControl,
    )
    from twin_gait.vocabulary import JointName

    joint = JointName(arguments.joint)
    if arguments.controller == "off":
        return None
    if arguments.controller == "duty":
        return DutyControl(
            amplitude=arguments.amplitude_counts,
            frequency=arguments.frequency_Hz,
            transparency_gain=arguments.transparency_gain,
            lowest_velocity=LOWEST_VELOCITIES[joint],
        )
    springy = arguments.controller == "impedance"
    return TorqueControl(
        controller=Controller(friction_model=BENCH_FRICTION[joint]),
        old_model=OldFrictionModel() if arguments.controller == "old-friction" else None,
        friction_compensation_gain=arguments.friction_compensation_gain,
        target_torque=arguments.target_torque_Nm,
        stiffness=arguments.stiffness_Nm_per_deg * 180.0 / math.pi if springy else 0.0,
        damping=arguments.damping_Nms_per_rad if springy else 0.0,
        equilibrium_angle=math.radians(arguments.equilibrium_deg),
        inertia_compensation=arguments.inertia_compensation,
    )


def _hand_of(arguments: argparse.Namespace) -> HandParameters | None:
    from twin_gait.scenario.bench_leg import HandParameters
    from twin_gait.vocabulary import JointName

    if arguments.hand_amplitude_deg is None:
        return None
    return HandParameters(
        joint=JointName(arguments.joint),
        amplitude=math.radians(arguments.hand_amplitude_deg),
        frequency=arguments.hand_frequency_Hz,
    )


def report_test(run: BenchRun, out: Path) -> None:
    """Print what one looks at first."""
    import numpy as np

    from twin_gait.studies.campaign import summarise

    velocity = run.column("motor_velocity_rad_per_s")
    summary = summarise(run)
    print(f"{run.status}: {len(run.rows) * 1e-3:g} s of synthetic data in {out}")
    print(f"  joint velocity {velocity.min():.3f} to {velocity.max():.3f} rad/s")
    for name, words in (("breakaway_s", "moved by 1°"), ("stop_s", "reached the stop")):
        if summary[name] is not None:
            print(f"  {words} after {summary[name]:g} s")
    print(f"  RMSE of target and measured current {summary['current_rmse_A']:.4f} A")
    if run.test.hand is not None:
        hand = run.column("hand_torque_Nm")
        rms, most = np.sqrt(np.mean(hand * hand)), np.abs(hand).max()
        print(f"  the hand needed {rms:.2f} N m RMS, {most:.2f} N m at most")
