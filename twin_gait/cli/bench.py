"""``twin-gait bench``: the campaign of the joint test bench."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait import simulation, studies
from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE
from twin_gait.exceptions import RunDirectoryError
from twin_gait.vocabulary import JointName

if TYPE_CHECKING:
    from twin_gait.studies.campaign import CampaignResult
    from twin_gait.worlds.bench_joint import BenchJoint

_PROTOCOL = "the thesis's falls, or driven by the motor to ±2.5 rad/s (drop)"
_CHOICES = (
    ("--protocol", ("drop", "two-way"), "drop", _PROTOCOL),
    ("--load-angle", ("corrected", "printed"), "corrected", "form of (2.8)"),
    ("--current-loop", ("pi", "ideal"), "pi", "of figure 2.13, or perfect (pi)"),
)
_NUMBERS = (
    ("--friction-ratio", 1.0, "S", "true friction over table 3.1 (1)"),
    ("--friction-ripple-Nm", 0.3, "NM", "friction that repeats with the gear (0.3)"),
    ("--lever-m", 0.30, "M", "from the axis to the weight (0.30)"),
    ("--longest", 20.0, "S", "when a fall that sticks is ended (20)"),
)


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    about = "Simulate the joint test bench of the thesis. All data that it writes are synthetic."
    parser = commands.add_parser("bench", help="simulate the joint test bench", description=about)
    actions = parser.add_subparsers(
        dest="action", required=True, parser_class=type(parser), metavar="campaign"
    )
    campaign = options.add_command(actions, "campaign", run_campaign_command)
    campaign.add_argument("--joint", choices=("knee", "hip"), required=True, help="whose motor and friction")
    campaign.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder to make")
    options.add_choices(campaign, _CHOICES)
    options.add_numbers(campaign, _NUMBERS)
    options.add(campaign, "--seed")


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
    out = arguments.out
    campaign = studies.Campaign(
        joint=JointName(arguments.joint),
        protocol=studies.Protocol(arguments.protocol),
        seed=arguments.seed,
        bench=bench_of(arguments),
        longest=arguments.longest,
    )
    if out.exists():
        raise RunDirectoryError(f"{out}: exists; choose another --out")
    with terminal.watched(str(campaign.protocol), "test") as watch:
        result = studies.run_campaign(campaign, out, **watch)
    print("\n".join(report_campaign(result)))
    if result.status is simulation.RunStatus.INTERRUPTED:
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
