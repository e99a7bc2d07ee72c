"""``twin-gait presets``, ``diagram``, ``check`` and ``replay``: commands for gait tables."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from twin_gait.cli import options
from twin_gait.cli.findings import counted, heading
from twin_gait.cli.terminal import DONE, FAILED, answer
from twin_gait.exceptions import ParameterError, ParameterFileError

DIAGRAMS = ("transitions", "truth", "svg", "mermaid")


def add_parser(commands: Any) -> None:
    """Add the commands to the parser."""
    parser = options.add_command(commands, "presets", show_presets)
    add = parser.add_argument
    add("name", nargs="?", help="name of the preset, device, person or table to print as YAML")
    add("--as-table", action="store_true", help="print the gait table if a preset has the same name")
    add(
        "--schema",
        choices=["experiment", "device", "table", "modes"],
        help="print the JSON Schema of a kind of file",
    )
    options.add(parser, "--json")

    parser = options.add_command(commands, "diagram", draw_diagram)
    add = parser.add_argument
    add("table", metavar="TABLE", help="packaged gait table or table of modes, or a YAML file")
    add("--format", choices=DIAGRAMS, default=DIAGRAMS[0], help="form of the output (transitions)")

    parser = options.add_command(commands, "check", check_table)
    add = parser.add_argument
    add("table", nargs="?", metavar="TABLE", help="packaged table, YAML file, or preset with a table")
    add("--experiment", metavar="FILE", help="preset, file or run directory of the experiment that uses it")
    options.add_settings(parser)
    options.add(parser, "--json")
    add("--rules", action="store_true", help="list the rules of the check and exit")
    add("--waived", action="store_true", help="also list the findings that the table waives")

    parser = options.add_command(commands, "replay", replay_walk)
    add = parser.add_argument
    add("log", metavar="LOG", help="run directory, log file, koopman@SPEED or winter")
    add("--table", metavar="T", help="packaged gait table or file (table of the run; treadmill_guided)")
    add("--convention", metavar="NAME", help="convention of the names and signs of the angles in the log")
    text = "names of columns, such as time=t,left_hip_angle=hip_l,left_phase=state; -NAME inverts the sign"
    add("--columns", default="", metavar="Q=NAME,…", help=text)
    add("--units", choices=["deg", "rad"], help="unit of angles whose names do not state it")
    add("--time-unit", metavar="UNIT", help="unit of the time, if its name does not state it (s)")
    add("--cycle-time-s", type=float, metavar="S", help="duration of a stride whose log has time as a share")
    add("--max-gap-s", type=float, metavar="S", help="longest gap in the log that is interpolated (0.1)")
    add("--speed", type=float, metavar="KM_PER_H", help="belt speed to which the table is scaled")
    add("--subject", metavar="NAME", help="person of a C3D or LocoHub file; name of the person in --strides")
    add("--task", metavar="NAME", help="task or task_id of a LocoHub file, and of --strides")
    text = "walk for the errors in strides.csv: koopman@SPEED, winter, or a file of LocoHub"
    add("--reference", metavar="WALK", help=text)
    text = "write the strides from heel strike to heel strike in the format of LocoHub"
    add("--strides", type=Path, metavar="FILE.parquet", help=text)
    add("--total-mass", type=float, metavar="KG", help="mass of wearer and device, for foot.load_bw")
    options.add_out(parser, "DIR", "folder for phases, transitions and figure")
    options.add(parser, "--no-pictures", "--json")


def show_presets(arguments: argparse.Namespace) -> int:
    """List experiments, devices, people, tables; print one.

    List the packaged experiments, devices, patients, own gaits, tables and policies, or print one as a file
    that can be edited: a preset with every value, a device, a person, a table or a policy.
    """
    from twin_gait.configuration.device_file import list_devices
    from twin_gait.configuration.experiments import list_own_gaits, list_patients, presets
    from twin_gait.configuration.gait_table_file import packaged_gait_tables, packaged_mode_tables
    from twin_gait.configuration.schema import json_schema
    from twin_gait.configuration.validation import descriptions, packaged
    from twin_gait.report.pages import lines
    from twin_gait.yaml12 import load_yaml

    if arguments.schema is not None:
        print(json.dumps(json_schema(arguments.schema), indent=1, ensure_ascii=False))
    elif arguments.name is None:
        known = {
            "experiments": presets(),
            "devices": list_devices(),
            "patients": list_patients(),
            "own_gaits": list_own_gaits(),
            "gait_tables": packaged_gait_tables(),
            "modes": packaged_mode_tables(),
            "policies": descriptions(packaged("policies")),
        }
        answer(arguments, lines("presets.txt", known), known)
    else:
        text = _text_of(arguments.name, as_table=arguments.as_table)
        answer(arguments, [text.removesuffix("\n")], load_yaml(text))
    return DONE


def _text_of(name: str, *, as_table: bool) -> str:
    from twin_gait.configuration.documents import dump_yaml
    from twin_gait.configuration.experiments import load_experiment, presets
    from twin_gait.configuration.gait_table_file import named_file, packaged_gait_tables
    from twin_gait.configuration.schema import comment_for
    from twin_gait.configuration.validation import packaged

    named = name in packaged_gait_tables() and name not in presets()
    if as_table or named:
        return named_file(name).read_text(encoding="utf-8")
    for kind in ("modes", "patients", "own_gaits", "devices", "policies"):
        if name in packaged(kind):
            return named_file(name, kind).read_text(encoding="utf-8")
    document = load_experiment(name).document
    return f"{comment_for('experiment')}\n{dump_yaml(document)}"


def draw_diagram(arguments: argparse.Namespace) -> int:
    """Draw the state machine of a gait table.

    Print the state-transition table, the truth table or the state diagram of a gait table.
    """
    from twin_gait.configuration.gait_table_file import load_state_table
    from twin_gait.gait.documents import transition_table, truth_table
    from twin_gait.report.state_diagram import state_diagram_mermaid, state_diagram_svg

    table = load_state_table(arguments.table)
    writers = (transition_table, truth_table, state_diagram_svg, state_diagram_mermaid)
    print(dict(zip(DIAGRAMS, writers, strict=True))[arguments.format](table), end="")
    return DONE


def check_table(arguments: argparse.Namespace) -> int:
    """Check a gait table without a run.

    Check a gait table by static analysis: transitions that conflict, follow immediately or never fire, phases
    that cannot be reached or left, both legs in swing, and more. The exit status is 1 if there is an error.
    """
    from twin_gait.checking.check import check, counts, load_case, report, rules
    from twin_gait.report.pages import lines

    if arguments.rules:
        answer(arguments, lines("rules.txt", {"rules": rules()}), rules())
        return DONE
    if arguments.table is None and arguments.experiment is None:
        raise ParameterError("check: expected a gait table or --experiment; --rules lists the rules")
    case = load_case(arguments.table, arguments.experiment, arguments.settings)
    findings = check(case)
    shown = [finding for finding in findings if arguments.waived or not finding.waived]
    hint = " (--waived lists them)" if len(shown) < len(findings) else ""
    content = {"case": case, "findings": shown, "heading": heading}
    content |= {"counted": counted(counts(findings)) + hint}
    answer(arguments, lines("check.txt", content), report(case, findings))
    return FAILED if counts(findings)["errors"] else DONE


def replay_walk(arguments: argparse.Namespace) -> int:
    """Run recorded joint angles through a gait table.

    Run the gait state machine on recorded angles and print the phases and transitions that follow. LOG
    is a run directory, a .parquet or .csv log, a .mot or .sto motion of OpenSim, a .c3d file with joint
    angles, a .parquet file of LocoHub, or normative gait: koopman@1.5 (speed in km/h) or winter.
    """
    from twin_gait.conventions import find_convention
    from twin_gait.measures.reference import KILOMETRES_PER_HOUR
    from twin_gait.replay.foot_events import write_strides
    from twin_gait.replay.machine import replay_log
    from twin_gait.replay.recording import LogFormat
    from twin_gait.replay.strides import read_reference, replay_strides
    from twin_gait.replay.writing import summarise_replay, write_replay
    from twin_gait.report.pages import lines

    speed, named = arguments.speed, arguments.convention
    log_format = LogFormat(
        convention=named and find_convention(named),
        columns=options.pairs("--columns", arguments.columns),
        units=arguments.units,
        time_unit=arguments.time_unit,
        cycle_time=arguments.cycle_time_s,
        subject=arguments.subject,
        task=arguments.task,
        **options.drop_none(max_gap=arguments.max_gap_s),
    )
    result = replay_log(
        arguments.log,
        table=arguments.table,
        log_format=log_format,
        speed=None if speed is None else speed / KILOMETRES_PER_HOUR,
        mass=arguments.total_mass,
    )
    if arguments.strides is not None:
        options.check_file("--strides", arguments.strides, force=arguments.force, form="parquet")
        names = options.drop_none(subject=arguments.subject, task=arguments.task)
        written = write_strides(result.recording, arguments.strides, **names)
        print(f"{arguments.strides}: {written}", file=sys.stderr)
    summary = summarise_replay(result)
    if arguments.out is None and arguments.reference is not None:
        raise ParameterError("--reference: its errors are written into a folder; add --out DIR")
    if arguments.out is not None:
        angles = None if arguments.reference is None else read_reference(arguments.reference)
        try:
            strides = replay_strides(result, angles)
        except ParameterFileError as error:
            summary["warnings"].append(f"no table of strides is written: {error}")
            strides = None
        pictures = not arguments.no_pictures
        write_replay(result, arguments.out, strides=strides, force=arguments.force, pictures=pictures)
    document = {**summary, "directory": arguments.out}
    answer(arguments, lines("replay.txt", document), document)
    return DONE
