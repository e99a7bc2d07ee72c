"""Groups of commands, options that mean the same everywhere, completion, and answers for programs."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from errors import states
from table_builder import FIVE_PHASES

from twin_gait.cli import main
from twin_gait.cli.program import GROUPS, build_parser
from twin_gait.files import to_json_value
from twin_gait.live.session_records import SessionRecorder

COMMANDS = {
    "run and look": ["simulate", "live", "view", "plot", "export", "sessions"],
    "gait tables": ["presets", "diagram", "check", "replay"],
    "test bench and identification": ["bench", "identify"],
    "the device": ["device", "firmware"],
    "many runs": ["sweep", "compare", "tune", "faults"],
}


def parsers(parser: argparse.ArgumentParser, name: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Return the parsers of all commands and actions by name."""
    yield name, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for key, command in action.choices.items():
                yield from parsers(command, f"{name} {key}".strip())


def test_help_has_at_most_eighteen_commands_in_groups_each_on_one_line(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    parser = build_parser()
    shown = parser.format_help()
    assert list(GROUPS) == list(COMMANDS)
    assert {title: list(commands) for title, commands in parser.groups.items()} == COMMANDS
    assert sum(map(len, COMMANDS.values())) <= 18
    for title, commands in parser.groups.items():
        assert f"\n{title}:\n" in shown
        for name, text in commands.items():
            assert f"  {name:<20}  {text}\n" in shown


def test_options_of_one_name_mean_the_same_everywhere():
    meanings: dict[str, set[tuple[object, ...]]] = {}
    for name, parser in parsers(build_parser()):
        for action in parser._actions:
            for flag in action.option_strings:
                # What a path or a number stands for differs by command; how it is given does not.
                meanings.setdefault(flag, set()).add((type(action), action.nargs))
                if flag in (
                    "--force",
                    "--json",
                    "--no-pictures",
                    "--seed",
                    "--unchecked",
                    "--workers",
                    "--set",
                ):
                    meanings.setdefault(f"help of {flag}", set()).add((action.help, action.metavar))
        flags = {flag for action in parser._actions for flag in action.option_strings}
        assert "--debug" in flags, name
        if "--patient" in flags:
            assert {"--set", "--mass", "--height", "--speed", "--support"} <= flags, name
        if "--force" in flags:
            assert {"--out", "--dbc"} & flags, name
    different = {flag: found for flag, found in meanings.items() if len(found) > 1}
    # A shorthand of --set is a list where there is an experiment, and a value where there is none.
    assert set(different) <= {"--device", "--duration", "--mass", "--seed", "--speed", "--table"}, different


def test_every_command_of_an_experiment_checks_its_table():
    taking = {name for name, parser in parsers(build_parser()) if "--unchecked" in parser.format_help()}
    assert taking == {"simulate", "live", "sweep", "compare", "tune", "faults", "firmware"}


@pytest.fixture
def no_way_out(tmp_path):
    """Return tables with an exit that never opens."""

    def write(base: str) -> str:
        path = tmp_path / f"no_way_out_{base}.yaml"
        guard = "{from: swing_flexion, to: swing_extension, cause: clearance, all: ['knee.angle_deg > 200']}"
        path.write_text(f"schema_version: 2\nextends: {base}\ntransitions:\n  - {guard}\n", encoding="utf-8")
        return str(path)

    return write


@pytest.mark.parametrize("command", ["live", "compare", "tune", "faults", "firmware"])
def test_an_error_of_the_table_stops_a_command_before_a_folder_is_made(
    command, no_way_out, tmp_path, monkeypatch, capsys
):
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    out = ["--out", "out"] if command in ("tune", "firmware") else []
    assert main([command, "treadmill_guided", "--set", f"table={no_way_out('treadmill_guided')}", *out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "never_opens: swing_flexion" in line and "--unchecked" in line
    assert list(folder.iterdir()) == []


def test_an_error_of_the_table_stops_a_sweep_unless_it_is_unchecked(no_way_out, tmp_path, capsys):
    spec = tmp_path / "sweep.yaml"
    spec.write_text(
        "experiment: bench_leg\nmethod: grid\nparameters: {scenario.start.hip_deg: [5, 6]}\n"
        f"settings: {{duration_s: 0.05, table: {no_way_out('bench_leg')}}}\n"
    )
    out = tmp_path / "out"
    words = ["sweep", str(spec), "--out", str(out), "--workers", "1", "--no-pictures"]
    assert main(words) == 2
    assert "never_opens" in capsys.readouterr().err and not out.exists()
    assert main([*words, "--unchecked", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["status"], document["finished"], document["directory"]) == ("completed", 2, str(out))


# ---------------------------------------------------------------------- answers for programs


def answered(capsys, *words: object, status: int = 0):
    """Return the document that a command prints."""
    assert main([*map(str, words), "--json"]) == status
    return json.loads(capsys.readouterr().out)


def test_simulate_answers_with_its_summary(tmp_path, capsys):
    out = tmp_path / "run"
    document = answered(capsys, "simulate", "bench_leg", "--duration", "0.3", "--no-pictures", "--out", out)
    assert document.pop("directory") == str(out)
    assert document == json.loads((out / "summary.json").read_text())


def test_presets_answer_with_names_or_with_a_document(capsys):
    document = answered(capsys, "presets")
    assert "treadmill_guided" in document["experiments"] and "stroke_left" in document["patients"]
    assert "sup_2009" in document["gait_tables"]
    assert answered(capsys, "presets", "treadmill_guided")["patient"]["mass_kg"] == 70
    assert answered(capsys, "presets", "treadmill_guided", "--as-table")["phases"]["late_stance"]
    assert "both" in answered(capsys, "presets", "stroke_left") or "left" in answered(
        capsys, "presets", "stroke_left"
    )


def test_rules_of_the_check_are_a_document(capsys):
    assert "never_opens" in answered(capsys, "check", "--rules")


def test_faults_answer_with_a_row_each(capsys):
    words = ("faults", "bench_leg", "--count", 2, "--duration", 3, "--workers", 1, "--seed", 3)
    document = answered(capsys, *words)
    assert (document["status"], document["seed"], len(document["faults"]), document["violations"]) == (
        "completed",
        3,
        2,
        [],
    )
    assert {"fault", "outcome", "within_limits"} <= set(document["faults"][0])


def test_faults_in_a_run_that_does_not_walk_are_refused(capsys):
    """Faults added to such a run would break no limit."""
    held = ("--set", "control.safety.speed_share=0.05", "--unchecked")
    words = ("faults", "treadmill_guided", "--count", "2", "--duration", "3", "--workers", "1", *held)
    assert main(words) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("treadmill_guided, 3 s ") and states(line, "held from")
    assert main([*words, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert states(document["baseline_problem"], "held from") and document["faults"] == []


def test_compare_answers_with_its_numbers(tmp_path, capsys):
    out = tmp_path / "out"
    words = ("compare", "--controllers", "transparent", "--duration", 2, "--patient", "stroke_left")
    document = answered(capsys, *words, "--out", out)
    assert document.pop("directory") == str(out)
    assert document == json.loads((out / "compare.json").read_text()) and document["patient"] == "stroke_left"


def test_replay_answers_with_its_summary(tmp_path, capsys):
    out = tmp_path / "out"
    document = answered(
        capsys, "replay", "koopman@1.5", "--table", FIVE_PHASES, "--no-pictures", "--out", out
    )
    assert document.pop("directory") == str(out)
    assert document == json.loads((out / "summary.json").read_text())
    assert document["sides"]["left"]["strides"] == 7


def test_identify_answers_with_its_document(tmp_path, capsys):
    log = tmp_path / "log.csv"
    velocity = np.linspace(-2.0, 2.0, 200)
    rows = [f"{w},{1.5 * np.sign(w) + 0.8 * w}" for w in velocity]
    log.write_text("\n".join(["velocity_rad_per_s,friction_torque_Nm", *rows]) + "\n")
    out = tmp_path / "out"
    words = ("identify", log, "--model", "coulomb_viscous", "--no-cross-validation", "--no-pictures")
    document = answered(capsys, *words, "--out", out)
    assert document.pop("directory") == str(out)
    assert document == json.loads((out / "identification.json").read_text())


def test_sessions_are_a_list(tmp_path, capsys):
    records = tmp_path / "sessions"
    recorder = SessionRecorder(
        records, user="Ann", experiment="treadmill_guided", document={"duration_s": 600}, folder=Path("run")
    )
    recorder.close("completed", 600000, {}, [])
    (entry,) = answered(capsys, "sessions", "--records", records, "list")
    assert (entry["user"], entry["experiment"], entry["status"]) == ("Ann", "treadmill_guided", "completed")


def test_numbers_that_are_not_finite_become_null():
    rows = {
        "a": (np.float64("nan"), np.int64(2)),
        "b": [float("inf"), True, None, Path("x")],
        3: np.bool_(False),
    }
    assert to_json_value(rows) == {"a": [None, 2], "b": [None, True, None, "x"], "3": False}


# ---------------------------------------------------------------------- completion


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_is_printed_for_every_shell(shell, capsys):
    with pytest.raises(SystemExit) as left:
        main(["--print-completion", shell])
    assert left.value.code == 0
    script = capsys.readouterr().out
    for command in (name for group in COMMANDS.values() for name in group):
        assert command in script


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        (["twin-gait", "ide"], {"identify"}),
        (["twin-gait", "bench", ""], {"campaign"}),
        (["twin-gait", "simulate", "--fail"], {"--fail-on-fall"}),
        (["twin-gait", "export", "run", "--format", ""], {"csv", "mot", "sto", "opensim", "candump", "asc"}),
    ],
)
def test_bash_completes(typed, expected, tmp_path):
    script = subprocess.run(
        [sys.executable, "-m", "twin_gait", "--print-completion", "bash"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    (tmp_path / "complete.sh").write_text(script)
    words = " ".join(f"'{word}'" for word in typed)
    program = (
        f"source complete.sh; COMP_WORDS=({words}); COMP_CWORD={len(typed) - 1}; "
        "$(complete -p twin-gait | sed 's/.*-F \\([^ ]*\\).*/\\1/'); printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, cwd=tmp_path, check=False)
    offered = set(done.stdout.split())
    assert expected <= offered, (done.stdout, done.stderr)
    if typed[-1]:
        assert all(word.startswith(typed[-1]) for word in offered)
