"""``twin-gait replay``."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any

from twin_gait import replay
from twin_gait.cli import options
from twin_gait.cli.terminal import DONE, answer, progress_bar

FOUND = "found"  # --mirror without a number: the stride time is found in the angles


_TEXTS = (
    ("--columns", "Q=NAME,…", "columns by name, such as time=t,left_hip_angle=hip_l,left_phase=state"),
    ("--offset-deg", "JOINT=X,…", "added to the angles of a joint, such as hip=5"),
    ("--start", "SIDE=PHASE,…", "phases at the start (the recorded ones, or the table's first)"),
)
_NUMBERS = (
    ("--speed", None, "KM_PER_H", "belt speed that the table is scaled to"),
    ("--total-mass", None, "KG", "of wearer and device, for foot.load_bw"),
)


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "replay", run)
    add = parser.add_argument
    add("log", metavar="LOG", help="run directory, log file, koopman@SPEED or winter")
    add("--table", metavar="T", help="packaged gait table or file (a run's own; treadmill)")
    add("--convention", metavar="NAME", help="names and signs of the angles in the log")
    for flag, metavar, text in _TEXTS:
        add(flag, default="", metavar=metavar, help=text)
    add("--units", choices=["deg", "rad"], help="unit of columns that do not say theirs")
    options.add_numbers(parser, _NUMBERS)
    text = "make the other leg: this one half a stride (of S seconds) earlier"
    add("--mirror", nargs="?", const=FOUND, metavar="S", help=text)
    options.add_out(parser, "DIR", "folder for phases, transitions and figure")
    options.add(parser, "--no-pictures", "--json")


def run(arguments: argparse.Namespace) -> int:
    """Run recorded joint angles through a gait table.

    Run the gait state machine over recorded angles and print which phases and switches the table gives. LOG
    is a run directory, a .parquet or .csv log, a .mot or .sto motion of OpenSim, or normative gait:
    koopman@1.5 (speed in km/h) or winter.
    """
    request = make_request(arguments)
    with progress_bar("replaying", "tick") as progress:
        result = replay.replay_log(request, progress=progress)
    if arguments.out is not None:
        replay.write_replay(result, arguments.out, force=arguments.force, pictures=not arguments.no_pictures)
    summary = replay.summarise_replay(result)
    folder = [] if arguments.out is None else [str(arguments.out)]
    answer(arguments, [*summary_lines(summary), *folder], lambda: {**summary, "directory": arguments.out})
    return DONE


def make_request(arguments: argparse.Namespace) -> replay.ReplayRequest:
    """Turn arguments into a request."""
    from twin_gait.conventions import find_convention
    from twin_gait.measures import KILOMETRES_PER_HOUR
    from twin_gait.vocabulary import JointName, Side

    offsets = {
        JointName(joint): math.radians(options.number(f"--offset-deg {joint}", text))
        for joint, text in options.pairs("--offset-deg", arguments.offset_deg, list(JointName)).items()
    }
    starts = options.pairs("--start", arguments.start, list(Side))
    speed, mirror, named = arguments.speed, arguments.mirror, arguments.convention
    columns = options.pairs("--columns", arguments.columns)
    return replay.ReplayRequest(
        log=arguments.log,
        table=arguments.table,
        log_format=replay.LogFormat(
            convention=named and find_convention(named),
            columns=columns,
            units=arguments.units,
            offsets=offsets,
        ),
        speed=None if speed is None else speed / KILOMETRES_PER_HOUR,
        mass=arguments.total_mass,
        mirror=mirror is not None,
        stride_time=None if mirror in (None, FOUND) else options.number("--mirror", mirror),
        start_phases={Side(side): phase for side, phase in starts.items()},
    )


def summary_lines(summary: dict[str, Any]) -> Iterator[str]:
    """What a reader wants first: strides, switches by cause, agreement."""
    yield f"{summary['log']}: {summary['duration_s']:g} s through the table {summary['table']}"
    if summary["assumed_signals"]:
        taken = ", ".join(f"{name} {value:g}" for name, value in summary["assumed_signals"].items())
        yield f"not in the log, so taken as: {taken}"
    for side, values in summary["sides"].items():
        yield f"{side}: {_strides(values, summary['cycles'])}"
        for item in values["switches"]:
            yield f"  {item['count']:4d} × {item['from']} → {item['to']} ({item['cause']})"
        if values["agreement"] is not None:
            yield f"  {_agreement(values['agreement'])}"


def _strides(values: dict[str, Any], cycles: list[list[str]]) -> str:
    if not values["strides"]:
        return "no whole stride"
    plural = "s" if values["strides"] > 1 else ""
    cycle = (
        f"all {len(cycles[0])} phases once and in order" if len(cycles) == 1 else "one of the table's cycles"
    )
    return (
        f"{values['strides']} stride{plural} of {values['stride_time_mean_s']:.2f} s, "
        f"{values['strides_with_the_whole_cycle']} with {cycle}"
    )


def _agreement(values: dict[str, Any]) -> str:
    lags = [lag for phase in values["entry_lags_s"].values() for lag in phase]
    matched = [abs(lag) for lag in lags if lag is not None]
    text = f"recorded phases: {100 * values['equal_share']:.1f} % of the ticks equal"
    if matched:
        text += f", {len(matched)} of {len(lags)} switches found, at most {1000 * max(matched):.0f} ms apart"
    return text
