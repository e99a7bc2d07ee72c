"""Walks as other laboratories record them: units, gaps, signs and strides that cannot be right."""

from __future__ import annotations

import json

import numpy as np
import pytest
from errors import raises, states

from twin_gait.cli import main
from twin_gait.conventions import RAJAGOPAL
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.replay.machine import replay_log
from twin_gait.replay.recording import LogFormat, read_recording
from twin_gait.replay.writing import doubtful_strides, phase_onsets, stride_phases
from twin_gait.vocabulary import JointName, Side

HIP, KNEE = JointName.HIP, JointName.KNEE
STEP, PERIOD = 0.01, 1.0
INSTANTS = STEP * np.arange(301)
ANGLES = {
    f"{side}_{joint}_angle": 10.0 + amplitude * np.sin(2.0 * np.pi * (INSTANTS / PERIOD + lead))
    for side, lead in (("left", 0.0), ("right", 0.5))
    for joint, amplitude in (("hip", 20.0), ("knee", 12.0))
}


def walk_text(ending: str = "_deg", time: np.ndarray = INSTANTS, name: str = "time_s", **changed) -> str:
    columns = {
        name: time,
        **{f"{column}{ending}": values for column, values in {**ANGLES, **changed}.items()},
    }
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"


def read(tmp_path, text: str, ending: str = "csv", **log_format):
    path = tmp_path / f"log.{ending}"
    path.write_text(text)
    return read_recording(path, LogFormat(**log_format))


def hip(recording) -> np.ndarray:
    return np.degrees(recording.angles[Side.LEFT, HIP])


# ---------------------------------------------------------------------- units


@pytest.mark.parametrize(
    ("ending", "factor", "log_format"),
    [
        ("_deg", 1.0, {}),
        (" (deg)", 1.0, {}),
        (" [degrees]", 1.0, {}),
        (" (rad)", np.pi / 180, {}),
        ("_rad", np.pi / 180, {}),
        ("", np.pi / 180, {"units": "rad"}),
        ("", 1.0, {"units": "deg"}),
    ],
)
def test_the_unit_of_an_angle_is_read_in_every_form(tmp_path, ending, factor, log_format):
    columns = {name: factor * values for name, values in ANGLES.items()}
    recording = read(tmp_path, walk_text(ending, **columns), **log_format)
    np.testing.assert_allclose(hip(recording)[::10], ANGLES["left_hip_angle"], atol=1e-6)
    assert not recording.warnings


@pytest.mark.parametrize(
    ("name", "factor", "log_format"),
    [
        ("time_ms", 1e3, {}),
        ("time_ms", 1e3, {"columns": {"time": "time_ms"}}),
        ("Time [msec]", 1e3, {}),
        ("t", 1e6, {"time_unit": "us"}),
        ("timestamp (min)", 1 / 60, {}),
    ],
)
def test_the_unit_of_the_time_is_read(tmp_path, name, factor, log_format):
    recording = read(tmp_path, walk_text(time=factor * INSTANTS, name=name), **log_format)
    assert recording.n_ticks == 3001
    np.testing.assert_allclose(hip(recording)[::10], ANGLES["left_hip_angle"], atol=1e-5)


def test_a_time_unit_against_the_name_is_refused(tmp_path):
    with raises(ParameterFileError, "time_s", "s", "--time-unit ms"):
        read(tmp_path, walk_text(), time_unit="ms")


def test_units_that_have_no_effect_are_named(tmp_path):
    recording = read(tmp_path, walk_text(), units="rad")
    assert [states(line, "--units rad") for line in recording.warnings] == [True]
    np.testing.assert_allclose(hip(recording)[::10], ANGLES["left_hip_angle"], atol=1e-6)


def storage_text(flag: str, factor: float = 1.0) -> str:
    names = {"left_hip_angle": "hip_flexion_l", "left_knee_angle": "knee_angle_l"}
    rows = np.column_stack([INSTANTS, *(factor * ANGLES[name] for name in names)])
    lines = ["\t".join(f"{value:.9g}" for value in row) for row in rows]
    head = ["walk", f"nRows={len(rows)}", "nColumns=3", f"inDegrees={flag}", "endheader"]
    return "\n".join([*head, "\t".join(["time", *names.values()]), *lines]) + "\n"


@pytest.mark.parametrize(
    ("flag", "factor", "units", "stated"), [("no", 1.0, "deg", "rad"), ("yes", np.pi / 180, "rad", "deg")]
)
def test_units_override_the_flag_of_a_motion_with_a_notice(tmp_path, flag, factor, units, stated):
    text = storage_text(flag, factor)
    recording = read(tmp_path, text, "mot", convention=RAJAGOPAL, units=units)
    np.testing.assert_allclose(hip(recording)[::10], ANGLES["left_hip_angle"], atol=1e-6)
    assert [states(line, f"--units {units}", stated) for line in recording.warnings] == [True]


def test_radians_that_are_read_as_degrees_are_named(tmp_path):
    recording = read(tmp_path, storage_text("yes", np.pi / 180), "mot", convention=RAJAGOPAL)
    assert len(recording.warnings) == 1
    assert states(recording.warnings[0], "left hip", "0.7 deg", "--units")


# ---------------------------------------------------------------------- time


def test_samples_that_are_too_far_apart_are_refused_in_absolute_terms(tmp_path):
    coarse = {name: values[::30] for name, values in ANGLES.items()}
    with raises(ParameterFileError, "time", "0.3 s", "0.1 s"):
        read(tmp_path, walk_text(time=INSTANTS[::30], **coarse))


PERCENT = np.arange(101.0)
STRIDE = {
    name: 10.0 + 20.0 * np.sin(2.0 * np.pi * (PERCENT / 100 + 0.5 * name.startswith("right")))
    for name in ANGLES
}


@pytest.mark.parametrize(
    "time", [PERCENT, PERCENT / 100, PERCENT + 1.0], ids=["per cent", "share", "rows from 1"]
)
def test_one_stride_over_per_cent_is_repeated_in_the_time_that_is_given(tmp_path, time):
    recording = read(tmp_path, walk_text(time=time, name="time", **STRIDE), cycle_time=1.25)
    assert recording.n_ticks == 10_001
    assert [states(line, "1.25 s", "8") for line in recording.warnings] == [True]
    np.testing.assert_allclose(hip(recording)[:1250], hip(recording)[6250:7500], atol=2e-3)
    np.testing.assert_allclose(hip(recording)[625], 10.0, atol=1e-3)


def test_per_cent_read_as_seconds_is_refused_with_a_suggestion(tmp_path):
    with raises(ParameterFileError, "time", "1 s", "0.1 s", "--cycle-time-s"):
        read(tmp_path, walk_text(time=PERCENT, name="time", **STRIDE))


def test_a_stride_that_does_not_close_is_named(tmp_path):
    columns = {name: values[:76] for name, values in STRIDE.items()}
    recording = read(tmp_path, walk_text(time=PERCENT[:76], name="time", **columns), cycle_time=1.0)
    assert any(states(line, "left hip", "20 deg") for line in recording.warnings)


# ---------------------------------------------------------------------- gaps


def with_gap(first: int, last: int) -> str:
    values = ANGLES["left_knee_angle"].copy()
    values[first : last + 1] = np.nan
    return walk_text(left_knee_angle=values)


def test_a_short_gap_is_interpolated_and_counted(tmp_path):
    recording = read(tmp_path, with_gap(100, 107))
    assert [(gap.column, round(gap.start, 6), round(gap.length, 6)) for gap in recording.gaps] == [
        ("left knee", 0.99, 0.09)
    ]
    knee = np.degrees(recording.angles[Side.LEFT, KNEE])
    # A cubic over 0.09 s of a sine of 1 Hz: the error is at most that of linear interpolation, A (π h/T)²/2.
    assert np.abs(knee[::10] - ANGLES["left_knee_angle"]).max() < 12.0 * (np.pi * 0.09) ** 2 / 2
    assert not recording.warnings


def test_a_long_gap_is_named_and_filled_when_it_is_allowed(tmp_path):
    text = with_gap(100, 119)
    with raises(ParameterFileError, "left knee", "0.21 s", "0.99 s", "--max-gap-s"):
        read(tmp_path, text)
    assert len(read(tmp_path, text, max_gap=0.25).gaps) == 1


def test_missing_rows_are_gaps_too(tmp_path):
    lines = walk_text().splitlines()
    text = "\n".join([*lines[:50], *lines[55:]]) + "\n"
    gaps = read(tmp_path, text).gaps
    assert [(gap.column, round(gap.length, 6)) for gap in gaps] == [("time", 0.06)]
    with raises(ParameterFileError, "0.06 s", "--max-gap-s", "0.05"):
        read(tmp_path, text, max_gap=0.05)


def test_ends_without_values_are_left_out_with_a_notice(tmp_path):
    values = ANGLES["left_knee_angle"].copy()
    values[:12] = np.nan
    recording = read(tmp_path, walk_text(left_knee_angle=values))
    assert recording.start == pytest.approx(0.12) and recording.n_ticks == 3001 - 120
    assert states(recording.warnings[0], "12", "left knee")


@pytest.mark.parametrize("ending", ["csv", "mot"])
def test_a_repeated_row_is_left_out_with_a_notice(tmp_path, ending):
    text = walk_text() if ending == "csv" else storage_text("yes")
    text += text.splitlines()[-1] + "\n"
    convention = {} if ending == "csv" else {"convention": RAJAGOPAL}
    recording = read(tmp_path, text, ending, **convention)
    assert recording.n_ticks == 3001
    assert states(recording.warnings[-1], "1", "302")


# ---------------------------------------------------------------------- signs and columns


def test_a_minus_turns_the_sign_of_any_joint(tmp_path):
    turned = {name: -values for name, values in ANGLES.items()}
    columns = {name: f"-{name}_deg" for name in ANGLES}
    recording = read(tmp_path, walk_text(**turned), columns=columns)
    for side in Side:
        for joint in (HIP, KNEE):
            found = np.degrees(recording.angles[side, joint])[::10]
            np.testing.assert_allclose(found, ANGLES[f"{side}_{joint}_angle"], atol=1e-6)


def test_a_knee_with_the_wrong_sign_is_refused_with_a_suggestion_that_works(tmp_path):
    stiff = 12.0 - 12.0 * np.cos(2.0 * np.pi * INSTANTS)  # 0 to 24 degrees
    text = walk_text(left_knee_angle=-stiff)
    with raises(ParameterFileError, "left knee", "24 deg", "left_knee_angle=-NAME"):
        read(tmp_path, text)
    recording = read(tmp_path, text, columns={"left_knee_angle": "-left_knee_angle_deg"})
    assert np.degrees(recording.angles[Side.LEFT, KNEE]).max() == pytest.approx(24.0)


def test_a_knee_that_is_hyperextended_in_a_walk_is_a_warning(tmp_path):
    recording = read(tmp_path, walk_text(left_knee_angle=20.0 + 38.0 * np.sin(2.0 * np.pi * INSTANTS)))
    assert len(recording.warnings) == 1
    assert states(recording.warnings[0], "left knee", "18 deg", "15 deg")


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"left_hip_angle": "left_hip_angle_deg", "left_knee_angle": "left_hip_angle_deg"},
            ("left_hip_angle_deg", "left_hip_angle", "left_knee_angle"),
        ),
        (
            {"left_hip_angle": "left_hip_angle_deg", "left_knee_angle": "-left_hip_angle_deg"},
            ("left_hip_angle_deg", "left_hip_angle", "left_knee_angle"),
        ),
        ({"left_phase": "-left_hip_angle_deg"}, ("left_hip_angle_deg", "left_phase")),
    ],
)
def test_a_column_has_one_meaning(tmp_path, columns, message):
    with raises(ParameterFileError, *message):
        read(tmp_path, walk_text(), columns=columns)


@pytest.mark.parametrize(
    ("log_format", "message"),
    [
        ({"max_gap": 0.0}, ("max_gap", "0")),
        ({"cycle_time": -1.0}, ("cycle_time", "0")),
        ({"time_unit": "h"}, ("time_unit", "s", "ms", "h")),
    ],
)
def test_numbers_of_a_format_have_a_range(log_format, message):
    with raises(ParameterError, *message):
        LogFormat(**log_format)


# ---------------------------------------------------------------------- strides


def test_phase_onsets_follow_the_strides():
    #                 stride of 20: 0 %, 25 %, 60 %       stride of 10: 0 %, 50 %
    stays = [(2, 7), (0, 5), (1, 7), (2, 8), (0, 5), (2, 5), (0, 3)]
    phases = np.repeat(*np.array(stays).T)
    found = {phase: values.tolist() for phase, values in phase_onsets(phases).items()}
    assert found == {0: [0.0, 0.0], 1: [25.0], 2: [60.0, 50.0]}
    assert phase_onsets(np.zeros(9, dtype=int)) == {}


@pytest.mark.parametrize(
    ("stride_s", "range_deg", "turn", "doubt"),
    [
        (1.0, 30.0, 1.0, None),
        (0.3, 30.0, 1.0, "2 of 2 strides by the table are shorter than 0.4 s"),
        (12.0, 30.0, 1.0, "2 of 2 strides by the table are longer than 10 s"),
        (1.0, 4.0, 1.0, "2 of 2 strides by the table are with less than 5 deg of hip motion"),
        (1.0, 30.0, 0.5, "2 of 2 strides by the table are no whole cycle of the hip"),
    ],
)
def test_an_invalid_stride_is_named(stride_s, range_deg, turn, doubt):
    """The hip is a cosine that makes so much of a turn in each of two strides."""
    ticks = round(1000 * stride_s)
    angle = np.radians(0.5 * range_deg) * np.cos(2 * np.pi * turn * (np.arange(3 * ticks) / ticks - 0.5))
    phases = np.repeat([1, 0, 1, 0, 1, 0], ticks // 2)
    found = doubtful_strides(angle, stride_phases(phases))
    assert len(found) == (doubt is not None) and all(line.startswith(doubt) for line in found)


def test_the_command_prints_and_stores_onsets_gaps_and_warnings(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text(with_gap(100, 107))
    command = ["replay", str(path), "--table", "bench_leg", "--units", "rad", "--no-pictures"]
    assert main([*command, "--max-gap-s", "0.1", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert states(printed, "1 gap", "0.09 s", "warning: --units rad")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [gap["column"] for gap in summary["interpolated_gaps"]] == ["left knee"]
    assert states(summary["warnings"][0], "--units rad")


def test_onsets_of_healthy_walking_follow_from_its_curves(capsys):
    assert main(["replay", "koopman@1.5", "--table", "treadmill_guided"]) == 0
    assert states(capsys.readouterr().out, "early_stance 0 %", "middle_stance 16 %")
    result = replay_log("koopman@1.5", table="treadmill_guided")
    onsets, strides = phase_onsets(result.phases[Side.LEFT]), stride_phases(result.phases[Side.LEFT])
    assert list(onsets) == [0, 1, 2, 3, 4] and all(len(values) == len(strides) for values in onsets.values())
    # Each switch, as a share of the stride that contains it.
    for (start, end, _), onset in zip(strides, onsets[3], strict=True):
        ticks = [
            item.tick for item in result.switches if item.side is Side.LEFT and item.target == "swing_flexion"
        ]
        assert start + onset / 100 * (end - start) == pytest.approx(next(t for t in ticks if t >= start))


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["koopman@1.5", "--cycle-time-s", "1"], ("koopman@1.5",)),
        (["koopman@1.5", "--max-gap-s", "nan"], ("max_gap", "nan")),
        (["koopman@1.5", "--time-unit", "h"], ("time_unit", "s or ms", "h")),
    ],
)
def test_impossible_options_are_refused_in_one_line(arguments, facts, capsys):
    assert main(["replay", *arguments]) == 2
    error = capsys.readouterr().err
    assert states(error, *facts) and error.count("\n") == 1
