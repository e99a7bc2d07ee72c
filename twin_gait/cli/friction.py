"""``twin-gait bench`` and ``identify``: joint test bench, and identification of friction from its logs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, answer, progress_bar
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.vocabulary import JointName

if TYPE_CHECKING:
    from twin_gait.identification.identify import IdentificationOptions
    from twin_gait.identification.processing import BenchSetup
    from twin_gait.identification.reading import Quantity
    from twin_gait.parameters.drives import ActuatorParameters

DEFAULT_DEVICE = "twin_leg"  # One leg of TWIN on its stand.
_JOINT = "hip, knee or ankle; the device must have a drive there"
_DEVICE = f"device with the drive of --joint: a packaged device, or a YAML file ({DEFAULT_DEVICE})"
_PROTOCOL = "drops as in the thesis, or motion driven by the motor to ±2.5 rad/s (drop)"
# Options for the parameters of the bench that recorded the logs, by field of BenchSetup.
_BENCH = {
    "mass": ("--mass", "KG", "mass of the weight, if the name of a file does not state it"),
    "lever": ("--lever-m", "B", "distance of the weight from the axis (0.30)"),
    "link_inertia": ("--link-inertia-kgm2", "J", "inertia of the link about the axis (0.02)"),
    "link_moment": ("--link-moment-kgm", "S", "mass of the link times the lever of its centre of mass (0)"),
}
# Options for the parameters of the motor, by field of ActuatorParameters; --joint gives their defaults.
_MOTOR = {
    "torque_constant": ("--torque-constant", "NM_PER_A", "torque constant of the motor (value of --joint)"),
    "gear_ratio": ("--gear-ratio", "N", "turns of the motor per turn of the joint (value of --joint)"),
    "rotor_inertia": ("--rotor-inertia", "KGM2", "inertia of rotor and gear at the motor (value of --joint)"),
}


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    about = "Simulate the joint test bench of the thesis. All written data are synthetic."
    parser = commands.add_parser("bench", help="simulate the joint test bench", description=about)
    actions = parser.add_subparsers(required=True, parser_class=type(parser), metavar="campaign")
    add = options.add_command(actions, "campaign", run_campaign_command).add_argument
    add("--joint", choices=list(JointName), required=True, help=f"joint to simulate: {_JOINT}")
    add("--device", metavar="NAME", help=_DEVICE)
    add("--out", type=Path, metavar="DIR", required=True, help="folder to write")
    add("--protocol", choices=("drop", "two-way"), default="drop", help=_PROTOCOL)
    add("--seed", **options.SHARED["--seed"])

    parser = options.add_command(commands, "identify", identify)
    add = parser.add_argument
    add("logs", nargs="+", type=Path, metavar="LOG", help="text table, or a folder with .log files")
    options.add_out(parser, "DIR", "folder to write", required=True)
    text = "names of columns, such as time=t,velocity=dq2,friction_torque=tau2; -NAME inverts the sign"
    add("--columns", default="", metavar="Q=NAME,…", help=text)
    text = "units of columns whose names do not state them, such as velocity=deg/s,time=ms (SI)"
    add("--units", default="", metavar="Q=UNIT,…", help=text)
    add("--model", action="append", default=[], metavar="NAME,…", help="friction models to fit (all)")
    add("--joint", choices=list(JointName), help=f"joint of the logs: {_JOINT}")
    add("--device", metavar="NAME", help=_DEVICE)
    text = "filter of logs with a current (zero_phase)"
    add("--processing", choices=("zero_phase", "thesis"), default="zero_phase", help=text)
    text = "fit only friction of 0 or more, with break-away friction of at least Coulomb friction"
    add("--physical", action="store_true", help=text)
    add("--no-cross-validation", action="store_true", help="skip the fits that leave out one file each")
    bench = parser.add_argument_group("test bench, for logs with a current")
    for field, (flag, unit, text) in {**_BENCH, **_MOTOR}.items():
        bench.add_argument(flag, dest=field, type=float, metavar=unit, help=text)
    bench.add_argument("--start-angle-deg", type=float, metavar="A", help="start angle of every log (90)")
    text = "time by which the current in the logs leads the angle; negative if it lags (0)"
    bench.add_argument("--current-delay-ms", type=float, metavar="MS", help=text)
    bench.add_argument("--unwrap", action="store_true", help="unwrap angles that restart at each turn")
    bench.add_argument("--angles-as-logged", action="store_true", help="keep the offset of the logged angles")
    options.add(parser, "--seed", "--no-pictures", "--json")


def run_campaign_command(arguments: argparse.Namespace) -> int:
    """Simulate a campaign: five weights, nine tests each.

    Simulate a testing campaign and write 45 .log files with the thesis's columns, and campaign.json with the
    true friction. With --device, drive, friction, battery, limits and encoder are those of the device.
    """
    from twin_gait.configuration.device_file import load_device
    from twin_gait.simulation.run import RunStatus
    from twin_gait.studies.campaign import Campaign, Protocol, run_campaign

    joint, protocol, out = JointName(arguments.joint), Protocol(arguments.protocol), arguments.out
    load_device(arguments.device or DEFAULT_DEVICE).parameters_of_drive(joint)
    device = options.drop_none(device=arguments.device)
    campaign = Campaign(joint=joint, protocol=protocol, seed=arguments.seed, **device)
    if out.exists():
        raise RunDirectoryError(f"{out}: exists; choose another --out")
    with terminal.work_callbacks(str(protocol), "test") as watch:
        result = run_campaign(campaign, out, **watch)
    print(f"{result['status']}: {len(result['tests'])} synthetic logs in {out}")
    diverged = [test["file"] for test in result["tests"] if test["status"] == "diverged"]
    if diverged:
        print(f"  diverged: {', '.join(diverged)}")
    if result["status"] is RunStatus.INTERRUPTED:
        return terminal.report_stop("the logs that are complete have been written")
    return DONE


def identify(arguments: argparse.Namespace) -> int:
    """Identify the friction of a joint from logs.

    Fit friction models to logs of a test bench, or to series of velocity and friction torque. Each file is
    one test. The command writes identification.json (best model first), devices with the identified friction,
    and figures.
    """
    from twin_gait.configuration.device_file import load_device
    from twin_gait.identification.identify import identify_logs
    from twin_gait.identification.writing import IDENTIFICATION, PARAMETER_FILES, write_identification
    from twin_gait.report.pages import lines
    from twin_gait.runs.folders import check_target

    chosen = make_options(arguments)
    check_target(arguments.out, IDENTIFICATION, force=arguments.force)
    paths = list(_files(arguments.logs))
    with progress_bar("identifying", "step") as progress:
        result = identify_logs(paths, chosen, progress)
    joint = None if arguments.joint is None else JointName(arguments.joint)
    pictures = not arguments.no_pictures
    device = load_device(arguments.device or DEFAULT_DEVICE)
    document = write_identification(
        result, arguments.out, joint, device, force=arguments.force, pictures=pictures
    )
    output = {**document, "directory": arguments.out}
    answer(arguments, lines("identification.txt", {**output, "laws": PARAMETER_FILES}), output)
    return DONE


def make_options(arguments: argparse.Namespace) -> IdentificationOptions:
    """Convert arguments to options of the identification."""
    from twin_gait.identification.fitting import FitOptions
    from twin_gait.identification.identify import IdentificationOptions
    from twin_gait.identification.processing import Processing
    from twin_gait.identification.reading import ColumnOptions, Quantity
    from twin_gait.parameters.quantities import SEEDS

    def by_quantity(flag: str, text: str) -> dict[Quantity, str]:
        given = options.pairs(flag, text, list(map(str, Quantity)))
        return {Quantity(name): value for name, value in given.items()}

    SEEDS.require("--seed", arguments.seed)
    names, units = by_quantity("--columns", arguments.columns), by_quantity("--units", arguments.units)
    return IdentificationOptions(
        columns=ColumnOptions(names=names, units=units, unwrap=arguments.unwrap),
        bench=_bench_of_logs(arguments),
        processing=Processing(arguments.processing),
        fit=FitOptions(physical=arguments.physical, seed=arguments.seed),
        models=tuple(name.strip() for item in arguments.model for name in item.split(",") if name.strip()),
        cross_validation=not arguments.no_cross_validation,
    )


def _bench_of_logs(arguments: argparse.Namespace) -> BenchSetup | None:
    """Return the bench, or None if neither joint nor motor is given, so that the torque constant is unknown.

    Raises :class:`ParameterError` if the motor is given only in part and ``--joint`` is missing.
    """
    from twin_gait.identification.processing import BenchSetup

    motor: dict[str, Any] = options.drop_none(**{field: getattr(arguments, field) for field in _MOTOR})
    if arguments.joint is None:
        if arguments.device is not None:
            raise ParameterError("--device: needs the joint of the logs; add --joint, or leave --device out")
        if not motor:
            return None
        if missing := [flag for field, (flag, _, _) in _MOTOR.items() if field not in motor]:
            raise ParameterError(f"--joint: is missing; add it, or add {', '.join(missing)} as well")
    stated: dict[str, Any] = options.drop_none(**{field: getattr(arguments, field) for field in _BENCH})
    if arguments.start_angle_deg is not None:
        stated["start_angle"] = math.radians(arguments.start_angle_deg)
    if arguments.angles_as_logged:
        stated["start_angle"] = None
    if arguments.current_delay_ms is not None:
        stated["current_delay"] = 1e-3 * arguments.current_delay_ms
    if "rotor_inertia" in motor:
        motor["gear_inertia"] = 0.0  # It is included in the given inertia.
    return BenchSetup(actuator=replace(_actuator(arguments), **motor), **stated)


def _actuator(arguments: argparse.Namespace) -> ActuatorParameters:
    """Return motor and gear of the joint; without a joint, a motor whose numbers all options replace."""
    from twin_gait.configuration.device_file import load_device

    device = load_device(arguments.device or DEFAULT_DEVICE)
    joint = JointName(arguments.joint or JointName.KNEE)
    actuators: dict[JointName, ActuatorParameters] = device.parameters_of_drive(joint)["plant"].actuators
    return actuators[joint]


def _files(paths: list[Path]) -> Iterator[Path]:
    """Yield the given files, and the ``.log`` files of each folder in the order of their names."""
    for path in (path.expanduser() for path in paths):
        found = sorted(path.glob("*.log")) if path.is_dir() else [path]
        if not found:
            raise ParameterError(f"{path}: expected a folder with .log files, got none")
        yield from found
