"""Scalars are those of the core schema of YAML 1.2, in files, in ``--set`` and in what the program writes.

The values are those of section 10.3.2 of the specification (https://yaml.org/spec/1.2.2/).
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from errors import raises, states

from twin_gait import load_experiment
from twin_gait.cli import main
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.configuration.validation import parse_assignment, parse_yaml
from twin_gait.exceptions import ParameterFileError
from twin_gait.yaml12 import MOST_VALUES, dump_yaml, load_yaml

SCALARS = {
    "060": 60, "-025": -25, "0o14": 12, "0x3A": 58, "+12": 12, "010.5": 10.5, "1e3": 1000.0, "-2E+05": -2e5,
    ".5": 0.5, "12.": 12.0, "-.inf": -math.inf, "~": None, "Null": None, "true": True, "FALSE": False,
    "1_000": "1_000", "1:30": "1:30", "1:30.5": "1:30.5", "0b11": "0b11", "0,5": "0,5", "yes": "yes",
    "no": "no", "on": "on", "Off": "Off", "y": "y", "2001-01-01": "2001-01-01", "=": "=",
}  # fmt: skip


@pytest.mark.parametrize(("text", "value"), SCALARS.items(), ids=list(SCALARS))
def test_a_scalar_has_the_value_of_the_specification_everywhere(text: str, value: object) -> None:
    for found in (load_yaml(text), parse_yaml(f"a: {text}", "f")["a"], parse_assignment(f"a={text}")[1]):
        assert found == value and type(found) is type(value)


@pytest.mark.parametrize("text", [*SCALARS, "1_0", "0o17", "plain", "12 kg", ""])
def test_a_written_text_stays_a_text_for_readers_of_both_versions(text: str) -> None:
    written = dump_yaml({"a": text})
    assert load_yaml(written) == yaml.safe_load(written) == {"a": text}


def test_zero_padded_angles_of_a_gait_table_are_decimal(tmp_path: Path) -> None:
    def phase(hip: str, knee: str) -> str:
        spring = "stiffness_Nm_per_deg: 1, damping_Nms_per_rad: 0.5, friction_compensation_gain: 0"
        legs = (
            f"{joint}: {{equilibrium_deg: {angle}, {spring}}}"
            for joint, angle in (("hip", hip), ("knee", knee))
        )
        return f"{{{', '.join(legs)}}}"

    path = tmp_path / "padded.yaml"
    path.write_text(
        "schema_version: 2\njoints: [hip, knee]\n"
        f"phases: {{stance: {phase('-010', '005')}, swing: {phase('025', '060')}}}\n",
        encoding="utf-8",
    )
    phases = load_gait_table(path).phases.values()
    angles = [math.degrees(joint.equilibrium_angle) for phase in phases for joint in phase.joints.values()]
    assert angles == pytest.approx([-10.0, 5.0, 25.0, 60.0], rel=1e-12)


@pytest.mark.parametrize(
    ("setting", "explained"),
    [
        ("duration_s=1_000", ("duration_s", "1_000", "1000")),
        ("duration_s=1:30", ("duration_s", "1:30")),
        ("duration_s=0,5", ("duration_s", "0,5")),
        ("seed='7'", ("seed", "7")),
        ("sensors.ideal=off", ("sensors.ideal", "true", "false", "off")),
        ("sensors.ideal=1", ("sensors.ideal", "true", "false", "1")),
    ],
)
def test_text_is_neither_number_nor_truth_value(setting: str, explained: tuple[object, ...]) -> None:
    with raises(ParameterFileError, *explained):
        load_experiment("treadmill_guided", [setting])


def test_a_decimal_comma_between_braces_is_named() -> None:
    with raises(ParameterFileError, "line 1", "column 10", "5"):
        parse_yaml("a: {b: 0,5}", "table.yaml")


def nested(levels: int) -> str:
    """Lists of nine aliases each, nested: nine to the power of the levels once they are written out."""
    names = "abcdefghijklmnop"[:levels]
    lists = [f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]" for before, name in pairwise(names)]
    return "\n".join(["a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]", *lists])


def test_excessive_alias_expansion_is_refused_by_every_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bomb.yaml"
    path.write_text(nested(9), encoding="utf-8")
    for command in (["sweep", "--out", str(tmp_path / "out")], ["simulate"], ["check"]):
        assert main([*command, str(path)]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and states(lines[0], MOST_VALUES)


def test_limited_alias_expansion_is_read() -> None:
    data = parse_yaml(nested(3), "table.yaml")
    assert [len(item) for item in (data["c"], data["c"][0], data["c"][0][0])] == [9, 9, 9]
