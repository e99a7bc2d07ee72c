"""``twin-gait bench`` and ``identify``: the joint test bench, and the friction that logs of one give."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from twin_gait import identification as of
from twin_gait import parameters, simulation, studies
from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, answer, progress_bar
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.vocabulary import JointName

_PROTOCOL = "the thesis's falls, or driven by the motor to ±2.5 rad/s (drop)"
# Numbers of the bench on which logs were made, by their field of a BenchSetup.
_BENCH = {
    "mass": ("--mass", "KG", "weight, where the name of a file does not say"),
    "lever": ("--lever-m", "B", "from the axis to the weight (0.30)"),
    "link_inertia": ("--link-inertia-kgm2", "J", "about the axis (0.02)"),
    "link_moment": ("--link-moment-kgm", "S", "mass of the link times its arm (0)"),
}
# Numbers of the motor on the bench, by their field of ActuatorParameters; those of --joint without them.
_MOTOR = {
    "torque_constant": ("--torque-constant", "NM_PER_A", "torque constant of the motor (that of --joint)"),
    "gear_ratio": ("--gear-ratio", "N", "turns of the motor in one turn of the joint (that of --joint)"),
    "rotor_inertia": ("--rotor-inertia", "KGM2", "rotor and gear, at the motor (that of --joint)"),
}


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    about = "Simulate the joint test bench of the thesis. All data that it writes are synthetic."
    parser = commands.add_parser("bench", help="simulate the joint test bench", description=about)
    actions = parser.add_subparsers(required=True, parser_class=type(parser), metavar="campaign")
    add = options.add_command(actions, "campaign", run_campaign_command).add_argument
    add("--joint", choices=("knee", "hip"), required=True, help="whose motor and friction")
    add("--out", type=Path, metavar="DIR", required=True, help="folder to make")
    add("--protocol", choices=("drop", "two-way"), default="drop", help=_PROTOCOL)
    add("--seed", **options.SHARED["--seed"])

    parser = options.add_command(commands, "identify", identify)
    add = parser.add_argument
    add("logs", nargs="+", type=Path, metavar="LOG", help="text tables; a folder gives its .log files")
    options.add_out(parser, "DIR", "folder to make", required=True)
    text = "columns by name, such as time=t,velocity=dq2,friction_torque=tau2; -NAME turns the sign"
    add("--columns", default="", metavar="Q=NAME,…", help=text)
    text = "units of columns that do not say theirs, such as velocity=deg/s,time=ms (SI)"
    add("--units", default="", metavar="Q=UNIT,…", help=text)
    add("--model", action="append", default=[], metavar="NAME,…", help="models to fit (all)")
    add("--joint", choices=("hip", "knee"), help="whose motor and gear it is (for currents)")
    text = "smoothing of logs with a current (zero_phase)"
    add("--processing", choices=("zero_phase", "thesis"), default="zero_phase", help=text)
    add("--physical", action="store_true", help="no negative friction, break-away at least Coulomb")
    add("--no-cross-validation", action="store_true", help="do not leave files out in turn")
    bench = parser.add_argument_group("test bench, for logs with a current")
    for field, (flag, unit, text) in {**_BENCH, **_MOTOR}.items():
        bench.add_argument(flag, dest=field, type=float, metavar=unit, help=text)
    bench.add_argument("--start-angle-deg", type=float, metavar="A", help="first angle of every log (90)")
    text = "time by which the current leads the angle in the logs in ms; negative if it lags (0)"
    bench.add_argument("--current-delay-ms", type=float, metavar="MS", help=text)
    bench.add_argument("--unwrap", action="store_true", help="the encoder starts again at each turn")
    bench.add_argument("--angles-as-logged", action="store_true", help="leave the angles as they are")
    options.add(parser, "--seed", "--no-pictures", "--json")


def run_campaign_command(arguments: argparse.Namespace) -> int:
    """Five weights, nine tests each, as log files.

    Simulate a testing campaign: 45 .log files in the thesis's columns, and campaign.json with the true
    friction.
    """
    joint, protocol, out = JointName(arguments.joint), studies.Protocol(arguments.protocol), arguments.out
    campaign = studies.Campaign(joint=joint, protocol=protocol, seed=arguments.seed)
    if out.exists():
        raise RunDirectoryError(f"{out}: exists; choose another --out")
    with terminal.watched(str(protocol), "test") as watch:
        result = studies.run_campaign(campaign, out, **watch)
    print(f"{result['status']}: {len(result['tests'])} synthetic logs in {out}")
    diverged = [test["file"] for test in result["tests"] if test["status"] == "diverged"]
    if diverged:
        print(f"  diverged: {', '.join(diverged)}")
    if result["status"] is simulation.RunStatus.INTERRUPTED:
        return terminal.stopped("the logs so far are kept")
    return DONE


def identify(arguments: argparse.Namespace) -> int:
    """Identify the friction of a joint from logs.

    Fit friction models to logs of a test bench, or to series of velocity and friction torque. Each file is
    one test. Written: identification.json (models best first), parameter files that simulate takes, and
    figures.
    """
    from twin_gait.identification.writing import IDENTIFICATION, PARAMETER_FILES, write_identification
    from twin_gait.report.pages import lines
    from twin_gait.runs.folders import check_target

    chosen = make_options(arguments)
    check_target(arguments.out, IDENTIFICATION, force=arguments.force)
    paths = list(_files(arguments.logs))
    with progress_bar("identifying", "step") as progress:
        result = of.identify_logs(paths, chosen, progress)
    joint = None if arguments.joint is None else JointName(arguments.joint)
    pictures = not arguments.no_pictures
    document = write_identification(result, arguments.out, joint, force=arguments.force, pictures=pictures)
    told = {**document, "directory": arguments.out}
    answer(arguments, lines("identification.txt", {**told, "laws": PARAMETER_FILES}), told)
    return DONE


def make_options(arguments: argparse.Namespace) -> of.IdentificationOptions:
    """Turn arguments into options."""
    from twin_gait.parameters.quantities import SEEDS

    def by_quantity(flag: str, text: str) -> dict[of.Quantity, str]:
        given = options.pairs(flag, text, list(map(str, of.Quantity)))
        return {of.Quantity(name): value for name, value in given.items()}

    SEEDS.require("--seed", arguments.seed)
    names, units = by_quantity("--columns", arguments.columns), by_quantity("--units", arguments.units)
    return of.IdentificationOptions(
        columns=of.LogColumns(names=names, units=units, unwrap=arguments.unwrap),
        bench=_bench_of_logs(arguments),
        processing=of.Processing(arguments.processing),
        fit=of.FitOptions(physical=arguments.physical, seed=arguments.seed),
        models=tuple(name.strip() for item in arguments.model for name in item.split(",") if name.strip()),
        cross_validation=not arguments.no_cross_validation,
    )


def _bench_of_logs(arguments: argparse.Namespace) -> of.BenchSetup | None:
    """Return the bench; None without a joint and a motor, because the torque constant would be unknown."""
    motor: dict[str, Any] = options.given(**{field: getattr(arguments, field) for field in _MOTOR})
    if arguments.joint is None:
        if not motor:
            return None
        if missing := [flag for field, (flag, _, _) in _MOTOR.items() if field not in motor]:
            raise ParameterError(f"--joint: without it a motor needs {', '.join(missing)}, too")
    stated: dict[str, Any] = options.given(**{field: getattr(arguments, field) for field in _BENCH})
    if arguments.start_angle_deg is not None:
        stated["start_angle"] = math.radians(arguments.start_angle_deg)
    if arguments.angles_as_logged:
        stated["start_angle"] = None
    if arguments.current_delay_ms is not None:
        stated["current_delay"] = 1e-3 * arguments.current_delay_ms
    actuator = parameters.HIP_ACTUATOR if arguments.joint == "hip" else parameters.KNEE_ACTUATOR
    if "rotor_inertia" in motor:
        motor["gear_inertia"] = 0.0  # It is part of the inertia that is given.
    return of.BenchSetup(actuator=replace(actuator, **motor), **stated)


def _files(paths: list[Path]) -> Iterator[Path]:
    """Files as given, and the logs of folders by name."""
    for path in (path.expanduser() for path in paths):
        found = sorted(path.glob("*.log")) if path.is_dir() else [path]
        if not found:
            raise ParameterError(f"{path}: the folder has no .log file")
        yield from found
