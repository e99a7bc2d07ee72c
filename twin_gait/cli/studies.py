"""``twin-gait sweep``, ``compare``, ``tune`` and ``faults``: commands that simulate many runs."""

from __future__ import annotations

import argparse
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED, INTERRUPTED
from twin_gait.exceptions import ParameterError
from twin_gait.runs.folders import check_target

# [s], duration of each run of a comparison; assistance that adapts with each stride settles in 20 strides.
COMPARE_DURATION = 60.0
# [s], duration of each run with a fault; the gait starts within 1 s, and a fault shows effects within 2 s.
FAULT_DURATION = 8.0
COMPARISONS = Path("compare")
COMPARED_WALK = "treadmill_guided"  # walk on which every controller was tried; see docs/reference/compare.md
# Options of a tuning that only the robust search has.
ROBUST_ONLY = ("population", "draws", "held_out", "spread", "scatter", "also")
NAMES = "table, position, assist_as_needed, twincare, policy, transparent, gravity, constant"


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    parser = options.add_command(commands, "sweep", sweep)
    parser.add_argument("spec", type=Path, metavar="SPEC", help="YAML file, such as examples/sweep.yaml")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="folder of the sweep")
    options.add_settings(parser)
    options.add(parser, "--unchecked", "--workers", "--scheduler", "--no-pictures", "--json")

    parser = options.add_command(commands, "compare", compare)
    options.add_experiment(parser, seconds=f"{COMPARE_DURATION:g}", default=COMPARED_WALK)
    text = "further folders with strides.csv: compares the strides of the first one and of these"
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help=text)
    text = f"names of controllers, separated by commas (all of {NAMES} that suit the experiment)"
    parser.add_argument("--controllers", metavar="NAME,…", help=text)
    parser.add_argument(
        "--seeds", type=int, default=1, metavar="N", help="runs that differ in mass, friction and speed (1)"
    )
    options.add_out(parser, "DIR", f"folder to write ({COMPARISONS}/NAME)")
    options.add(parser, "--json")

    parser = options.add_command(commands, "tune", tune)
    add = parser.add_argument
    options.add_experiment(parser, seconds=None)
    options.add_out(parser, "DIR", "folder of the tuning", required=True)
    add("--minutes", type=float, default=3.0, metavar="M", help="time limit of the whole command (3)")
    add("--generations", type=int, metavar="N", help="number of generations, instead of a time limit")
    add("--keep-thresholds", action="store_false", dest="thresholds", help="do not tune the transitions")
    add("--keep-blending", action="store_false", dest="blending", help="do not tune the blending")
    add("--per-side", action="store_true", help="tune each leg separately (hemiparesis)")
    add("--robust", action="store_true", help="tune for random wearers, supports, belts, drives and grounds")
    robust = parser.add_argument_group("options of --robust")
    add = robust.add_argument
    add(
        "--population",
        type=int,
        metavar="N",
        help="number of candidates of a generation before the table walks (24)",
    )
    add("--draws", type=int, metavar="N", help="number of random worlds of the search (8)")
    add("--held-out", type=int, metavar="N", help="number of other random worlds for the result (100)")
    add("--spread", type=float, metavar="S", help="standard deviation of the first candidates (0.08)")
    add("--scatter", type=float, metavar="S", help="random distance of the start from the table (0)")
    text = "also search this number of the experiment between LOW and HIGH, from START; may be repeated"
    add("--also", type=_range, action="append", metavar="KEY=LOW:START:HIGH", help=text)
    options.add(parser, "--seed", "--workers", "--scheduler", "--json")

    parser = options.add_command(commands, "faults", faults)
    options.add_experiment(parser, seconds=f"{FAULT_DURATION:g}")
    parser.add_argument("--count", type=int, default=100, metavar="N", help="number of faults (100)")
    options.add(parser, "--seed", "--workers", "--json")


def _range(text: str) -> tuple[str, tuple[float, float, float]]:
    """Read ``KEY=LOW:START:HIGH``; raise ArgumentTypeError for anything else."""
    key, _, numbers = text.partition("=")
    try:
        low, start, high = map(float, numbers.split(":"))
    except ValueError:
        low = start = high = math.nan
    if not (key and math.isfinite(high - low) and low <= start <= high and low < high):
        expected = "KEY=LOW:START:HIGH with three rising numbers, such as scenario.arms.reach_deg=5:8:20"
        raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}")
    return key, (low, start, high)


def sweep(arguments: argparse.Namespace) -> int:
    """Simulate an experiment over any of its parameters.

    Simulate a grid, a Latin hypercube or a list of episodes, on this machine or a Dask cluster. The same
    command resumes a sweep that was stopped or killed.
    """
    from twin_gait.report.pages import lines
    from twin_gait.simulation.run import RunStatus
    from twin_gait.studies.sweep.spec import load_sweep
    from twin_gait.studies.sweep.sweep import run_sweep
    from twin_gait.studies.workers import Workers, WorkersLost

    number = options.worker_count(arguments)
    spec = load_sweep(arguments.spec, arguments.settings)
    if not arguments.unchecked:
        options.check_table(spec.experiment)
    again = f"the same command resumes the sweep in {arguments.out}"
    pictures = not arguments.no_pictures
    try:
        with (
            Workers(number, arguments.scheduler) as workers,
            terminal.work_callbacks("sweeping", "episode") as watch,
        ):
            result = run_sweep(spec, arguments.out, workers=workers, pictures=pictures, **watch)
    except WorkersLost as error:
        return terminal.report_stop(f"finished episodes have been written, and {again}", str(error), FAILED)
    document = {**result.summary, "directory": arguments.out}
    terminal.answer(arguments, lines("sweep.txt", document), document)
    return terminal.report_stop(again) if document["status"] is RunStatus.INTERRUPTED else DONE


def compare(arguments: argparse.Namespace) -> int:
    """Compare controllers, or the strides of runs.

    Simulate one wearer on the ground with several controllers; or compare the strides of run directories,
    or of the conditions of one session. Write a folder with an HTML page, its figure, and the numbers as CSV
    and JSON.
    """
    from twin_gait.runs.stride_table import STRIDES_FILE
    from twin_gait.studies.compare import comparison, writing

    first = Path(arguments.experiment).expanduser()
    if arguments.folders or (first / STRIDES_FILE).is_file():
        return _compare_conditions(arguments, [first, *arguments.folders])
    names = [name.strip() for name in (arguments.controllers or "").split(",") if name.strip()]
    controllers = list(comparison.find_controllers(names or list(comparison.CONTROLLERS)))
    experiment = options.load_experiment(arguments, f"duration_s={COMPARE_DURATION:g}").experiment
    person = experiment.patient and experiment.patient.name
    wearer = person or "the wearer of the experiment"
    out: Path = arguments.out or COMPARISONS / (person or "wearer")
    check_target(out, writing.COMPARISON, force=arguments.force)
    if not names:
        controllers = [item for item in controllers if item.can_drive(experiment)]
    with terminal.work_callbacks("compare", "run") as watch:
        result = comparison.compare(experiment, controllers, seeds=arguments.seeds, **watch)
    if result is None:
        return terminal.report_stop("nothing was written")
    writing.write_comparison(result, wearer, out, force=arguments.force)
    lines = [*writing.format_comparison(result), str(out / writing.PAGE_FILE)]
    terminal.answer(arguments, lines, {**writing.comparison_summary(result, wearer), "directory": out})
    return DONE


def _compare_conditions(arguments: argparse.Namespace, folders: list[Path]) -> int:
    """Compare the settled strides of folders."""
    from twin_gait.studies.compare import condition_page, conditions, writing

    changed = [arguments.controllers, arguments.controller, *arguments.settings, arguments.seeds - 1]
    if any(changed):
        text = "options that change an experiment apply to controllers only; leave them out"
        raise ParameterError(f"compare {folders[0]}: {text}")
    out: Path = arguments.out or COMPARISONS / "-".join(folder.absolute().name for folder in folders)
    check_target(out, writing.COMPARISON, force=arguments.force)
    found = conditions.read_conditions(folders)
    table, summary = condition_page.write_conditions(found, out, force=arguments.force)
    lines = [*condition_page.format_conditions(table), str(out / writing.PAGE_FILE)]
    differences = table.to_dict("records")
    terminal.answer(arguments, lines, {**summary, "differences": differences, "directory": out})
    return DONE


def tune(arguments: argparse.Namespace) -> int:
    """Tune a gait table to one person.

    Optimise the parameters of a gait table, test the best tables on a robustness set, and write the best one
    with a report.
    """
    from twin_gait.report.formatting import describe_wearer
    from twin_gait.report.tune import summary
    from twin_gait.studies.tune import result, tune
    from twin_gait.studies.tune.tune import TuningSettings
    from twin_gait.studies.workers import Workers

    options.worker_count(arguments)
    experiment, out = options.load_experiment(arguments).experiment, arguments.out
    options_given = vars(arguments) | {"also": dict(arguments.also or ())}
    names = {item.name for item in fields(TuningSettings)}
    given = {name: value for name, value in options_given.items() if name in names and value is not None}
    only = [name for name in ROBUST_ONLY if given.get(name) and not arguments.robust]
    if only:
        raise ParameterError(f"--{only[0].replace('_', '-')}: is an option of --robust; add --robust")
    settings = TuningSettings(**given)
    check_target(out, result.TUNING, force=arguments.force)

    with (
        Workers(options.worker_count(arguments), arguments.scheduler) as workers,
        terminal.stop_on_interrupt() as should_stop,
    ):
        tuning = tune.tune(
            experiment, settings, workers=workers, report=terminal.note_line, should_stop=should_stop,
        )  # fmt: skip
    terminal.clear_line()
    if tuning is None:
        return terminal.report_stop("nothing was written")
    wearer = ", ".join(describe_wearer(experiment))
    found = result.write_tuning(tuning, out, wearer=wearer, force=arguments.force)
    terminal.answer(arguments, [*summary(found), f"  {out}"], {**found, "directory": out})
    return DONE


def faults(arguments: argparse.Namespace) -> int:
    """Inject seeded faults and tabulate the outcomes.

    Simulate an experiment once for each of many seeded faults of encoders, motors, controller, load sensors
    and supply, and print a table of the outcomes. The exit status is 1 if a limit was exceeded, a value is
    empty, a trip did not end in the hold, or the experiment does not walk without a fault.
    """
    from twin_gait.simulation.run import RunStatus
    from twin_gait.simulation.simulator import simulate
    from twin_gait.studies.fault_campaign import draw_faults, outcome_table, simulate_faults, violations

    workers, seed = options.worker_count(arguments), arguments.seed
    base = options.load_experiment(arguments, f"duration_s={FAULT_DURATION:g}").experiment
    drawn = draw_faults(base, arguments.count, seed)
    healthy = simulate(replace(base, faults=()))
    terminal.clear_line()
    if problem := healthy.baseline_problem:
        text = f"{base.name}, {base.duration:g} s without a fault: {problem}; faults in it cannot be judged"
        known = {"experiment": base.name, "baseline_problem": problem, "faults": []}
        terminal.answer(arguments, [text], known)
        return FAILED
    with terminal.work_callbacks("faults", "fault") as watch:
        table = simulate_faults(base, drawn, workers=workers, **watch)
    status = RunStatus.COMPLETED if len(table) == len(drawn) else RunStatus.INTERRUPTED
    broken = list(violations(table)["fault"]) if len(table) else []
    lines = [f"{base.name}, {base.duration:g} s each, {len(table)} faults, seed {seed}"]
    if len(table):
        lines.append(outcome_table(table).to_string(index=False))
        found = ", ".join(broken[:5]) or "none"
        lines.append(f"faults with an exceeded limit, an empty value or an unfinished hold: {found}")
    document = {
        "experiment": base.name, "duration_s": base.duration, "seed": seed, "status": str(status),
        "violations": broken, "faults": table.to_dict("records"),
    }  # fmt: skip
    terminal.answer(arguments, lines, document)
    if status is RunStatus.INTERRUPTED:
        return INTERRUPTED
    return FAILED if broken else DONE
