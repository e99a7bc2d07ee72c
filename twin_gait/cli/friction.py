"""``twin-gait bench`` and ``identify``: the joint test bench, and the friction that logs of one give."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait import identification as of
from twin_gait import parameters, simulation, studies
from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, answer, progress_bar
from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.vocabulary import JointName

if TYPE_CHECKING:
    from twin_gait.worlds.bench_joint import BenchJoint

_PROTOCOL = "the thesis's falls, or driven by the motor to ±2.5 rad/s (drop)"
_CAMPAIGN_CHOICES = (
    ("--protocol", ("drop", "two-way"), "drop", _PROTOCOL),
    ("--load-angle", ("corrected", "printed"), "corrected", "form of (2.8)"),
    ("--current-loop", ("pi", "ideal"), "pi", "of figure 2.13, or perfect (pi)"),
)
_CAMPAIGN_NUMBERS = (
    ("--friction-ratio", 1.0, "S", "true friction over table 3.1 (1)"),
    ("--friction-ripple-Nm", 0.3, "NM", "friction that repeats with the gear (0.3)"),
    ("--lever-m", 0.30, "M", "from the axis to the weight (0.30)"),
    ("--longest", 20.0, "S", "when a fall that sticks is ended (20)"),
)
PRINTED_MODELS = 5
SUFFIXES = (".log", ".csv", ".txt", ".tsv", ".dat")
_LOSS = "weighing of residuals: Huber's for logs and where outliers stand alone, else least squares"
_CHOICES = (
    ("--joint", ("hip", "knee"), None, "whose motor and gear it is (for currents)"),
    ("--processing", ("zero_phase", "thesis", "none"), None, "smoothing of the logs"),
    ("--current", ("measured", "target"), None, "which current drives (measured)"),
    ("--loss", ("auto", "huber", "linear"), "auto", _LOSS),
)
_NUMBERS = (
    ("--cutoff-Hz", None, "F", "of the zero-phase filter (40)"),
    ("--standstill-rad-per-s", None, "W", "slower samples are rejected (0.002; series 0)"),
)
_BENCH = (
    ("--mass", None, "KG", "weight, where file and file name do not say"),
    ("--lever-m", None, "B", "from the axis to the weight (0.30)"),
    ("--link-inertia-kgm2", None, "J", "about the axis (0.02)"),
    ("--link-moment-kgm", None, "S", "mass of the link times its arm (0)"),
)
_LOAD_ANGLE = "F b cos(θ - 90°), or F b cos θ as the thesis prints it"


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    about = "Simulate the joint test bench of the thesis. All data that it writes are synthetic."
    parser = commands.add_parser("bench", help="simulate the joint test bench", description=about)
    actions = parser.add_subparsers(
        dest="action", required=True, parser_class=type(parser), metavar="campaign"
    )
    campaign = options.add_command(actions, "campaign", run_campaign_command)
    campaign.add_argument("--joint", choices=("knee", "hip"), required=True, help="whose motor and friction")
    campaign.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder to make")
    options.add_choices(campaign, _CAMPAIGN_CHOICES)
    options.add_numbers(campaign, _CAMPAIGN_NUMBERS)
    options.add(campaign, "--seed")

    parser = options.add_command(commands, "identify", identify)
    add = parser.add_argument
    add("logs", nargs="+", type=Path, metavar="LOG", help="text tables; a folder gives its files")
    options.add_out(parser, "DIR", "folder to make", required=True)
    text = "columns by name, such as time=t,velocity=dq2,friction_torque=tau2; -NAME turns the sign"
    add("--columns", default="", metavar="Q=NAME,…", help=text)
    text = "units of columns that do not say theirs, such as velocity=deg/s,time=ms (SI)"
    add("--units", default="", metavar="Q=UNIT,…", help=text)
    add("--model", action="append", default=[], metavar="NAME,…", help="models to fit (all)")
    options.add_choices(parser, _CHOICES)
    options.add_numbers(parser, _NUMBERS)
    add("--physical", action="store_true", help="no negative friction, break-away at least Coulomb")
    add("--no-cross-validation", action="store_true", help="do not leave files out in turn")
    bench = parser.add_argument_group("test bench, for logs with a current")
    options.add_numbers(bench, _BENCH)
    text = "what the first angle is set to: 90 (horizontal), or 'as-logged'"
    bench.add_argument("--start-angle-deg", metavar="A", help=text)
    options.add_choices(bench, [("--load-angle", ("corrected", "printed"), "corrected", _LOAD_ANGLE)])
    text = "J_mass = m b instead of m b²"
    bench.add_argument("--mass-inertia-as-printed", action="store_true", help=text)
    options.add(parser, "--seed", "--no-pictures", "--json")


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
    print("\n".join(report_campaign(result, out)))
    if result["status"] is simulation.RunStatus.INTERRUPTED:
        return terminal.interrupted("the logs so far are kept")
    return DONE


def report_campaign(result: Mapping[str, Any], out: Path) -> Iterator[str]:
    """Results in a few lines."""
    tests = result["tests"]
    yield f"{result['status']}: {len(tests)} synthetic logs in {out}"
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


def identify(arguments: argparse.Namespace) -> int:
    """Identify the friction of a joint from logs.

    Fit friction models to logs of a test bench, or to series of velocity and friction torque. Each file is
    one test. Written: identification.json (models best first), parameter files that simulate takes, the
    samples, and figures.
    """
    from twin_gait.identification.writing import IDENTIFICATION, write_identification
    from twin_gait.runs.folders import check_target

    chosen = make_options(arguments)
    check_target(arguments.out, IDENTIFICATION, force=arguments.force)
    paths = list(_files(arguments.logs))
    with progress_bar("identifying", "step") as progress:
        result = of.identify_logs(paths, chosen, progress)
    joint = None if arguments.joint is None else JointName(arguments.joint)
    pictures = not arguments.no_pictures
    document = write_identification(result, arguments.out, joint, force=arguments.force, pictures=pictures)
    lines = [*summary_lines(document), *_parameter_file_lines(document)]
    answer(arguments, [*lines, str(arguments.out)], lambda: {**document, "directory": arguments.out})
    return DONE


def _parameter_file_lines(document: Mapping[str, Any]) -> Iterator[str]:
    """Which law each parameter file has, or why there is none."""
    from twin_gait.identification.writing import PARAMETER_FILES

    written, fitted = document["parameter_files"], {item["name"] for item in document["models"]}
    if document["joint"] is None:
        yield f"no {' and no '.join(PARAMETER_FILES)}: say whose friction it is with --joint"
        return
    for file, laws in PARAMETER_FILES.items():
        known = fitted.intersection(laws)
        if file in written:
            yield f"{file}: {written[file]}"
        elif known:
            yield f"no {file}: {', '.join(sorted(known))}, as fitted, would drive the joint; try --physical"
        else:
            yield f"no {file}: it takes {', '.join(laws)}, of which none was fitted; add --model"


def make_options(arguments: argparse.Namespace) -> of.IdentificationOptions:
    """Turn arguments into options."""
    from twin_gait.parameters.quantities import WHOLE

    def by_quantity(flag: str, text: str) -> dict[of.Quantity, str]:
        given = options.pairs(flag, text, list(map(str, of.Quantity)))
        return {of.Quantity(name): value for name, value in given.items()}

    WHOLE.require("--seed", arguments.seed)
    processing = options.given(
        processing=arguments.processing and of.Processing(arguments.processing),
        cutoff=arguments.cutoff_Hz,
        current=arguments.current and of.CurrentSource(arguments.current),
        standstill_velocity=arguments.standstill_rad_per_s,
    )
    names, units = by_quantity("--columns", arguments.columns), by_quantity("--units", arguments.units)
    loss = of.Loss(arguments.loss)
    return of.IdentificationOptions(
        columns=of.LogColumns(names=names, units=units),
        bench=_bench_of_logs(arguments),
        processing=of.ProcessingOptions(**processing),
        fit=of.FitOptions(loss=loss, physical=arguments.physical, seed=arguments.seed),
        models=tuple(name.strip() for item in arguments.model for name in item.split(",") if name.strip()),
        cross_validation=not arguments.no_cross_validation,
    )


def _bench_of_logs(arguments: argparse.Namespace) -> Any:
    """The bench; None without a joint, whose motor would be unknown."""
    from twin_gait.worlds import LoadAngle

    if arguments.joint is None:
        return None
    stated: dict[str, Any] = options.given(
        mass=arguments.mass, lever=arguments.lever_m, link_inertia=arguments.link_inertia_kgm2,
        link_moment=arguments.link_moment_kgm,
    )  # fmt: skip
    if arguments.start_angle_deg == "as-logged":
        stated["start_angle"] = None
    elif arguments.start_angle_deg is not None:
        degrees = options.number("--start-angle-deg", arguments.start_angle_deg, "a number or as-logged")
        stated["start_angle"] = math.radians(degrees)
    return of.BenchSetup(
        actuator=parameters.KNEE_ACTUATOR if arguments.joint == "knee" else parameters.HIP_ACTUATOR,
        load_angle=LoadAngle(arguments.load_angle),
        mass_as_printed=arguments.mass_inertia_as_printed,
        **stated,
    )


def _files(paths: list[Path]) -> Iterator[Path]:
    """Files as given, and those of folders by name."""
    for path in (path.expanduser() for path in paths):
        if not path.is_dir():
            yield path
            continue
        found = sorted(item for item in path.iterdir() if item.suffix.lower() in SUFFIXES)
        if not found:
            raise ParameterError(f"{path}: the folder has no .log, .csv, .txt, .tsv or .dat file")
        yield from found


def summary_lines(document: dict[str, Any]) -> Iterator[str]:
    """What a reader wants first: the models, the best one's parameters, the warnings."""
    counts = [test["samples"] for test in document["tests"]]
    used = sum(count["used"] for count in counts)
    whole = sum(count.get("after_decimation", count["read"]) for count in counts)
    plural = "s" if len(document["tests"]) > 1 else ""
    order = document["method"]["order"]
    yield f"{len(document['tests'])} file{plural}, {used} samples of {whole}; best first by {order}"
    for item in document["models"][:PRINTED_MODELS]:
        runs = [run for run in item["cross_validation"] if run["rmse"] is not None]
        left_out = "".join(f", {run['rmse']:.4g} with {run['left_out']} left out" for run in runs)
        yield f"  {item['name']:<26} RMSE {item['rmse']:.4g} N m{left_out}, R² {item['r_squared']:.3f}"
    if len(document["models"]) > PRINTED_MODELS:
        yield f"  and {len(document['models']) - PRINTED_MODELS} more"
    best = document["models"][0]
    yield f"{best['name']}: {best['formula']}"
    for name, value in best["parameters"].items():
        low, high = best["intervals_95"][name]
        interval = "" if low is None or high is None else f"  [{low:.5g}, {high:.5g}]"
        yield f"  {name:<34} {value:.5g}{interval}"
    for warning in [*document["warnings"], *best["warnings"]]:
        yield f"warning: {warning}"
