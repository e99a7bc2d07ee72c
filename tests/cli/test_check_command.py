"""``twin-gait check``: what it prints, and its exit status."""

from __future__ import annotations

import argparse
import json
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest
from errors import raises

from twin_gait import load_experiment, presets
from twin_gait.checking.check import check_before_run, rules
from twin_gait.checking.finding import Finding, Severity
from twin_gait.cli import main
from twin_gait.cli import tables as command
from twin_gait.cli.findings import heading
from twin_gait.cli.terminal import DONE, FAILED
from twin_gait.configuration.gait_table_file import named_file
from twin_gait.exceptions import TwinGaitError
from twin_gait.report.pages import render


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    parsed = parser.parse_args(["check", *arguments])
    return int(parsed.run(parsed))


@pytest.fixture
def stiff_knee(tmp_path: Path) -> str:
    """Return a published machine whose early swing waits for an unreachable knee angle."""
    text = named_file("osl_walking").read_text(encoding="utf-8")
    assert "knee.angle_deg > 50" in text
    path = tmp_path / "stiff_knee.yaml"
    path.write_text(text.replace("knee.angle_deg > 50", "knee.angle_deg > 150"), encoding="utf-8")
    return str(path)


def test_sound_table_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("osl_walking") == DONE
    assert capsys.readouterr().out.splitlines()[-1].startswith("osl_walking, by itself: 0 errors, ")


def test_error_fails_the_check_and_shows_location_reason_and_suggestion(
    stiff_knee: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(stiff_knee) == FAILED
    lines = capsys.readouterr().out.splitlines()
    index = lines.index("error never_opens: early_swing → late_swing (knee_flexed)")
    assert "no signals inside the limits open" in lines[index + 1]
    assert (
        "    → correct thresholds, debounce or timeout, or remove the transition"
        in lines[index + 1 : index + 5]
    )
    assert [line.split()[0] for line in lines if line.startswith(("error", "warning"))] == sorted(
        line.split()[0] for line in lines if line.startswith(("error", "warning"))
    )
    assert lines[-1].startswith("osl_walking, by itself: 4 errors, ")


def test_json_has_the_same_findings(stiff_knee: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(stiff_knee, "--json") == FAILED
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"schema_version", "table", "experiment", "counts", "findings"}
    errors = {item["rule"] for item in document["findings"] if item["severity"] == "error"}
    assert errors == {"never_opens", "trap", "unreachable_phase", "deadlock"}
    assert document["counts"]["errors"] == 4
    assert {item["rule"] for item in document["findings"]} <= set(rules())
    keys = {
        "rule",
        "severity",
        "phase",
        "transition",
        "side",
        "reason",
        "suggestion",
        "counterexample",
        "waived",
    }
    assert all(set(item) == keys for item in document["findings"])


def test_experiment_can_be_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    run("bench_leg", "--experiment", "treadmill_guided", "--json")
    document = json.loads(capsys.readouterr().out)
    assert document["experiment"] == "treadmill_guided"
    # With two legs the stepping of the bench leg lets both swing.
    assert "both_in_swing" in {item["rule"] for item in document["findings"]}


def test_rules_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--rules") == DONE
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(rules())
    assert all(meaning in line for line, meaning in zip(lines, rules().values(), strict=True))


@pytest.mark.parametrize(
    ("arguments", "explained"),
    [
        ([], ("check", "--experiment", "--rules")),
        (["nowhere.yaml"], ("nowhere.yaml", "treadmill_guided")),
        (["treadmill_guided", "--experiment", "nowhere"], ("nowhere", "treadmill_guided")),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], explained: tuple[object, ...]) -> None:
    with raises(TwinGaitError, *explained) as caught:
        run(*arguments)
    assert len(str(caught.value).splitlines()) == 1


def test_malformed_table_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text("joints: [hip", encoding="utf-8")
    with raises(TwinGaitError, "broken.yaml", "YAML"):
        run(str(path))


def finding(**changes: object) -> Finding:
    values = {
        "rule": "cascade",
        "severity": Severity.WARNING,
        "reason": "it is left in its first tick",
        "suggestion": "separate the thresholds",
        "phase": "early_stance",
        "counterexample": {"hip.angle_deg": -2.5, "other.phase": "late_stance"},
    }
    return Finding(**{**values, **changes})  # type: ignore[arg-type]


def shown(one: Finding) -> list[str]:
    case = SimpleNamespace(table=SimpleNamespace(name="mine"), experiment=None)
    content = {"case": case, "findings": [one], "heading": heading, "counted": "1 warning"}
    *lines, last = render("check.txt", content).splitlines()
    assert last == "mine, by itself: 1 warning"
    return lines


def test_waived_finding_shows_the_reason_of_the_table() -> None:
    assert shown(finding(waived="the belt is slow")) == [
        "waived warning cascade: early_stance",
        "    the belt is slow",
    ]


def test_live_finding_shows_reason_counterexample_and_suggestion() -> None:
    assert shown(finding()) == [
        "warning cascade: early_stance",
        "    it is left in its first tick",
        "    at hip.angle_deg -2.5, other.phase late_stance",
        "    → separate the thresholds",
    ]


def test_waived_findings_are_only_counted_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("treadmill_guided") == DONE
    brief = capsys.readouterr().out.splitlines()
    assert not any(line.startswith("waived") for line in brief)
    number = int(re.findall(r"(\d+) waived \(--waived lists them\)$", brief[-1])[0])
    assert run("treadmill_guided", "--waived") == DONE
    whole = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("waived warning ") for line in whole) == number > 10
    assert whole[-1].endswith(f"{number} waived")
    assert run("treadmill_guided", "--json") == DONE
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert sum(item["waived"] is not None for item in findings) == number


OWN_PHASES = """\
schema_version: 2
joints: [hip, knee]
phases:
  stance:
    hip: {stiffness_Nm_per_deg: 0.5, equilibrium_deg: -5, damping_ratio: 1, friction_compensation_gain: 0}
    knee: {stiffness_Nm_per_deg: 1, equilibrium_deg: 5, damping_ratio: 1, friction_compensation_gain: 0}
  swing:
    hip: {stiffness_Nm_per_deg: 0.5, equilibrium_deg: 25, damping_ratio: 1, friction_compensation_gain: 0}
    knee: {stiffness_Nm_per_deg: 1, equilibrium_deg: 60, damping_ratio: 1, friction_compensation_gain: 0}
transitions:
  - {from: stance, to: swing, cause: lift, all: ["hip.angle_deg < -2"]}
  - {from: swing, to: stance, cause: land, all: ["hip.angle_deg > 20"]}
  - {from: stance, to: swing, cause: timeout, after_s: 2}
  - {from: swing, to: stance, cause: timeout, after_s: 1}
"""


def test_a_table_with_phases_of_its_own_is_checked_from_its_first_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(OWN_PHASES, encoding="utf-8")
    run(str(path))
    assert capsys.readouterr().out.splitlines()[-1].startswith("own, against treadmill: ")
    with raises(TwinGaitError, "scenario.leading_phase", "stance", "swing"):
        run(str(path), "--experiment", "treadmill_guided")
    run(str(path), "--experiment", "treadmill_guided", "--set", "scenario.leading_phase=swing",
        "--set", "scenario.trailing_phase=stance")  # fmt: skip
    assert "own, against treadmill_guided: " in capsys.readouterr().out


# ---------------------------------------------------------------------- before a run

SHORT = ("bench_leg", "--duration", "0.05", "--no-pictures")


@pytest.fixture
def no_way_out(tmp_path: Path) -> str:
    """Return the table of the bench leg with an exit that never opens."""
    path = tmp_path / "no_way_out.yaml"
    path.write_text(
        "schema_version: 2\nextends: bench_leg\ntransitions:\n"
        "  - {from: swing_flexion, to: swing_extension, cause: clearance, all: ['knee.angle_deg > 200']}\n",
        encoding="utf-8",
    )
    return str(path)


@pytest.mark.parametrize("name", sorted(presets()))
def test_shipped_presets_run_without_an_error_or_a_live_warning(name: str) -> None:
    assert check_before_run(load_experiment(name).experiment) == []


def test_an_error_of_the_table_stops_the_run_before_a_folder_is_made(
    no_way_out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["simulate", *SHORT, "--out", str(out), "--set", f"table={no_way_out}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "2 errors" in line and "never_opens: swing_flexion → swing_extension (clearance)" in line
    assert "--unchecked" in line
    assert not out.exists()


def test_unchecked_runs_it_as_it_is(no_way_out: str, tmp_path: Path) -> None:
    arguments = ["simulate", *SHORT, "--set", f"table={no_way_out}", "--unchecked"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run" / "log.parquet").is_file()


def test_warnings_are_one_line_with_the_command_that_shows_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", *SHORT, "--out", str(tmp_path / "run"), "--set", "table.waive=[]"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    number = int(re.findall(r"(\d+) warning", line)[0])
    command = shlex.split(line.partition("see twin-gait ")[2])
    assert main(command) == 0
    shown = capsys.readouterr().out.splitlines()
    assert sum(text.startswith("warning ") for text in shown) == number > 1


def test_a_run_directory_can_be_checked_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    assert main(["simulate", *SHORT, "--out", str(out), "--unchecked", "--set", "table.waive=[]"]) == 0
    assert run("--experiment", str(out)) == DONE
    assert " 0 waived" in capsys.readouterr().out.splitlines()[-1]


def test_a_waiver_of_no_rule_stops_the_run_in_both_kinds_of_tables(
    capsys: pytest.CaptureFixture[str],
) -> None:
    waiver = "[{rule: nonsense, reason: because}]"
    for preset, kind in (("bench_leg", "table"), ("day", "modes")):
        assert main(["simulate", preset, "--duration", "0.05", "--set", f"{kind}.waive={waiver}"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "invalid_waiver" in line and "'nonsense'" in line
