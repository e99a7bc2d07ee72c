"""Logs as files: formats, names, units, signs, and everything that can be wrong with them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.conventions import CORC_X2, OPENSIM_GAIT2392, OSL, RAJAGOPAL, find_convention
from twin_gait.exceptions import ParameterError, ParameterFileError, TwinGaitError
from twin_gait.replay.recording import LogFormat, read_recording
from twin_gait.replay.samples import Recording
from twin_gait.runs.log_files import read_log_table
from twin_gait.vocabulary import JointName, Side

HIP, KNEE, ANKLE = JointName.HIP, JointName.KNEE, JointName.ANKLE
TIME = np.array([0.0, 0.001, 0.002])

# First rows of Gait2392_Simbody/Tutorial1/normal.mot in opensim-models, with its stray tabs and empty lines.
OPENSIM_TEXT = """normal_gait\t\t\t
version=1\t\t
nRows=3\t\t
nColumns=6\t\t
inDegrees=yes\t\t
endheader\t\t
time\tpelvis_tilt\thip_flexion_r\tknee_angle_r\tankle_angle_r\tknee_angle_l\t\t\t
0\t-1.87\t24.61\t-3.94\t-1.7\t-8.2\t\t\t
0.02\t-1.81\t24.45\t-6.66\t-3.25\t-11.29\t\t\t
0.04\t-1.71\t24.13\t-9.45\t-4.68\t-15.19\t\t\t
\t\t\t\t\t
"""
# The older header, of the inverse kinematics of the same model: no unit, and a name that occurs twice.
SIMM_TEXT = """first trial
nRows=2
nColumns=4

# SIMM Motion File Header:
name first trial
datacolumns 4
datarows 2
otherdata 1
range 0.500000 0.516000
endheader
time\tknee_angle_r\tground_force_vy\tground_force_vy
0.5\t-19.88552911\t1.0\t2.0
0.516\t-13.65755478\t1.0\t2.0
"""
CSV_TEXT = "t,hip_l,kn_l,state\n0,10,5,stance\n0.001,11,6,stance\n0.002,12,7,swing\n"
CSV_GAP = CSV_TEXT.partition("0,")[0] + "".join(f"0.0{n},10,5,a\n" for n in range(6)) + "0.45,10,5,a\n"
CSV_COLUMNS = {"time": "t", "left_hip_angle": "hip_l", "left_knee_angle": "kn_l", "left_phase": "state"}


def write(tmp_path, name: str, text: str):
    path = tmp_path / name
    path.write_text(text)
    return path


def degrees(recording: Recording, side: Side, joint: JointName) -> list[float]:
    return np.degrees(recording.angles[side, joint]).tolist()


# ---------------------------------------------------------------------- formats


def test_a_motion_of_opensim_is_read_with_its_unit_and_the_sign_of_its_model(tmp_path):
    path = write(tmp_path, "normal.mot", OPENSIM_TEXT)
    recording = read_recording(path, LogFormat(convention=OPENSIM_GAIT2392))
    assert recording.n_ticks == 41
    assert recording.sides == (Side.LEFT, Side.RIGHT)
    assert degrees(recording, Side.RIGHT, HIP)[::20] == pytest.approx([24.61, 24.45, 24.13])
    assert degrees(recording, Side.RIGHT, KNEE)[::20] == pytest.approx([3.94, 6.66, 9.45])
    assert degrees(recording, Side.RIGHT, ANKLE)[::20] == pytest.approx([-1.7, -3.25, -4.68])
    assert degrees(recording, Side.LEFT, KNEE)[::20] == pytest.approx([8.2, 11.29, 15.19])


def test_the_header_selects_degrees_or_radians(tmp_path):
    text = OPENSIM_TEXT.replace("inDegrees=yes", "inDegrees=no").replace("-3.94", "-0.0394")
    table = read_log_table(write(tmp_path, "radians.mot", text))
    assert table.unit == "rad"
    assert table.names[3] == "knee_angle_r" and table.numbers("knee_angle_r")[0] == -0.0394
    assert read_log_table(write(tmp_path, "degrees.mot", OPENSIM_TEXT)).unit == "deg"
    assert read_log_table(write(tmp_path, "simm.mot", SIMM_TEXT)).unit is None


def test_the_older_header_needs_a_unit_and_a_doubled_name_does_no_harm(tmp_path):
    path = write(tmp_path, "ik.mot", SIMM_TEXT)
    with raises(ParameterFileError, "knee_angle_r", "--units"):
        read_recording(path, LogFormat(convention=OPENSIM_GAIT2392))
    recording = read_recording(path, LogFormat(convention=OPENSIM_GAIT2392, units="deg"))
    assert recording.start == 0.5
    assert degrees(recording, Side.RIGHT, KNEE)[0] == pytest.approx(19.88552911)
    loads = {"right_foot_normal_force": "ground_force_vy"}
    with raises(ParameterFileError, "ground_force_vy", 2):
        read_recording(path, LogFormat(convention=OPENSIM_GAIT2392, units="deg", columns=loads))


def test_a_csv_with_names_of_its_own(tmp_path):
    recording = read_recording(
        write(tmp_path, "log.csv", CSV_TEXT), LogFormat(columns=CSV_COLUMNS, units="deg")
    )
    assert degrees(recording, Side.LEFT, HIP) == pytest.approx([10, 11, 12])
    assert recording.phases[Side.LEFT].tolist() == ["stance", "stance", "swing"]
    assert recording.sides == (Side.LEFT,)


@pytest.mark.parametrize("separator", [";", "\t", ", "])
def test_a_csv_with_another_separator_and_comments(tmp_path, separator):
    text = "# recorded on a Tuesday\n" + CSV_TEXT.replace(",", separator)
    recording = read_recording(write(tmp_path, "log.csv", text), LogFormat(columns=CSV_COLUMNS, units="deg"))
    assert degrees(recording, Side.LEFT, KNEE) == pytest.approx([5, 6, 7])


def test_a_parquet_log_gives_the_measured_angles_to_the_last_bit(tmp_path, rng):
    true, measured = rng.uniform(-0.5, 0.5, size=(2, 3))
    frame = pd.DataFrame(
        {
            "time_s": TIME,
            "right_hip_angle_rad": true,
            "right_hip_measured_angle_rad": measured,
            "right_foot_normal_force_N": [700.0, 650.0, 0.0],
        }
    )
    frame.to_parquet(tmp_path / "log.parquet")
    frame.to_csv(tmp_path / "log.csv", index=False)
    for name in ("log.parquet", "log.csv"):
        recording = read_recording(tmp_path / name)
        assert (recording.angles[Side.RIGHT, HIP] == measured).all()
        assert recording.loads[Side.RIGHT].tolist() == [700.0, 650.0, 0.0]


@pytest.mark.parametrize(
    ("column", "columns_option"),
    [("measured_trunk_pitch_rad", {}), ("pelvis_deg", {"trunk_pitch": "pelvis_deg"})],
)
def test_the_pitch_of_the_trunk_is_read_in_either_unit(tmp_path, column, columns_option):
    text = f"time_s,left_hip_angle_rad,{column}\n0,0.5,0.1\n0.002,0.5,0.3\n"
    columns = (
        {"time": "time_s", "left_hip_angle": "left_hip_angle_rad", **columns_option} if columns_option else {}
    )
    recording = read_recording(write(tmp_path, "log.csv", text), LogFormat(columns=columns))
    expected = np.array([0.1, 0.2, 0.3])
    found = recording.device["trunk.pitch_deg"]
    np.testing.assert_allclose(found, np.radians(expected) if columns_option else expected)


def test_names_that_end_in_deg_are_degrees(tmp_path):
    text = "time_s,left_hip_angle_deg\n0,30\n0.001,30\n"
    path = write(tmp_path, "log.csv", text)
    for units in (None, "rad"):
        recording = read_recording(path, LogFormat(units=units))
        assert degrees(recording, Side.LEFT, HIP) == pytest.approx([30, 30])


def test_the_x2_has_columns_of_its_own_and_the_open_source_leg_has_not(tmp_path):
    # The header as its logger writes it, with a blank behind each comma.
    text = (
        "time, JointPositions_1, JointPositions_2, JointPositions_3, JointPositions_4\n"
        "0, 0.5, -1.2, -0.1, -0.2\n0.01, 0.5, -1.2, -0.1, -0.2\n"
    )
    path = write(tmp_path, "x2.csv", text)
    recording = read_recording(path, LogFormat(convention=CORC_X2))
    found = [recording.angles[side, joint][0] for side in Side for joint in (HIP, KNEE)]
    assert found == pytest.approx([0.5, 1.2, -0.1, 0.2])
    with raises(ParameterFileError, "osl", "--columns"):
        read_recording(path, LogFormat(convention=OSL))
    columns = {"right_knee_angle": "JointPositions_1"}
    recording = read_recording(path, LogFormat(convention=OSL, columns=columns))
    assert recording.angles[Side.RIGHT, KNEE][0] == pytest.approx(0.5)


# ---------------------------------------------------------------------- mistakes

IN_DEGREES = LogFormat(columns=CSV_COLUMNS, units="deg")
CSV_MISTAKES = {
    "empty": ("", ("log.csv",)),
    "header only": ("t,hip_l,kn_l,state\n", ("time", "0")),
    "one row": ("t,hip_l,kn_l,state\n0,1,2,a\n", ("time", "1")),
    "no such column": (CSV_TEXT.replace("kn_l", "knee"), ("kn_l", "hip_l", "t", "knee")),
    "column twice": ("t,hip_l,kn_l,state,hip_l\n0,1,2,a,1\n0.001,1,2,a,1\n", ("hip_l", "2")),
    "a word": (CSV_TEXT.replace("11", "eleven"), ("hip_l", "row 2", "eleven")),
    "rows that are missing": (CSV_GAP, ("time", "0.4 s", "0.05 s", "row 6")),
    "a gap": (
        CSV_GAP.replace("0.05,10", "0.05,").replace("0.45", "0.149"),
        ("left hip", "0.109 s", "0.04 s"),
    ),
    "no value": (CSV_TEXT.replace("10,", "nan,").replace("11,", ","), ("left hip", "1")),
    "infinity": (CSV_TEXT.replace("11", "1e999"), ("row 2", "1e999")),
    "long row": (CSV_TEXT + "0.003,1,2,a,b,c\n", ("4", "line 5", "6")),
    "time backwards": (
        CSV_TEXT.replace("0.002", "0.0005"),
        ("time", "0.0005 s", "0.001 s", "row 3"),
    ),
    "time repeated": (CSV_TEXT.replace("0.002", "0.001"), ("time", "0.001 s", "row 3")),
    "milliseconds": (CSV_TEXT.replace("0.002", "4e6"), ("time", "4e+06 s", "0.001", "3600")),
    "nanoseconds": (CSV_TEXT.replace("0.002", "1.7e18"), ("time", "1.7e+18 s", "0.001", "3600")),
    "too short": (
        CSV_TEXT.replace("0.001", "0.0001").replace("0.002", "0.0002"),
        ("time", "0.0002 s", "0.001", "3600"),
    ),
    "radians as degrees": (CSV_TEXT.replace("12", "1200"), ("left hip", "1200 deg")),
    "knee backwards": (CSV_TEXT.replace(",7,", ",-60,"), ("left knee", "60 deg")),
}


@pytest.mark.parametrize(("text", "message"), CSV_MISTAKES.values(), ids=CSV_MISTAKES)
def test_a_mistake_in_a_csv_is_one_line_with_the_file_and_the_column(tmp_path, text, message):
    path = write(tmp_path, "log.csv", text)
    with raises(ParameterFileError, *message) as caught:
        read_recording(path, IN_DEGREES)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


STORAGE_MISTAKES = {
    "no header": ("time\thip\n0\t1\n", ("endheader",)),
    "no names": ("a\nendheader\n\n", ("log.sto",)),
    "unit": (OPENSIM_TEXT.replace("yes", "maybe"), ("inDegrees", "yes", "no", "maybe")),
    "short line": (OPENSIM_TEXT.replace("\t-15.19", ""), ("row 3", "6")),
    "word": (
        OPENSIM_TEXT.replace("-6.66", "bent"),
        ("knee_angle_r", "row 2", "bent"),
    ),
    "no time": (OPENSIM_TEXT.replace("time\t", "clock\t"), ("time",)),
}


@pytest.mark.parametrize(("text", "message"), STORAGE_MISTAKES.values(), ids=STORAGE_MISTAKES)
def test_a_mistake_in_a_motion_file_is_one_line_with_the_file_and_the_place(tmp_path, text, message):
    path = write(tmp_path, "log.sto", text)
    with raises(ParameterFileError, *message) as caught:
        read_recording(path, LogFormat(convention=OPENSIM_GAIT2392))
    assert str(caught.value).startswith(f"{path}: ")


def test_opensim_files_require_the_model_and_a_wrong_model_is_detected(tmp_path):
    path = write(tmp_path, "normal.mot", OPENSIM_TEXT.replace("-15.19", "-58.25"))
    with raises(ParameterFileError, "--convention opensim_gait2392", "rajagopal"):
        read_recording(path)
    with raises(ParameterFileError, "left knee", "58 deg"):
        read_recording(path, LogFormat(convention=RAJAGOPAL))


def test_unknown_column_names_suggest_columns_and_conventions_options(tmp_path):
    with raises(ParameterFileError, "left_hip_angle_rad", "--columns"):
        read_recording(write(tmp_path, "log.csv", CSV_TEXT), LogFormat(columns={"time": "t"}))


def test_files_without_a_log_are_refused(tmp_path):
    with raises(ParameterFileError, "nowhere.csv"):
        read_recording(tmp_path / "nowhere.csv")
    with raises(ParameterFileError, "log.xlsx", ".parquet", ".csv", ".mot", ".sto"):
        read_recording(write(tmp_path, "log.xlsx", "x"))
    (tmp_path / "log.csv").write_bytes(b"\xff\xfe\x00")
    with raises(ParameterFileError, "log.csv", "UTF-16", "UTF-8"):
        read_recording(tmp_path / "log.csv")
    with raises(ParameterFileError, "log.parquet", "parquet"):
        read_recording(write(tmp_path, "log.parquet", "PAR1 but no more"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"columns": {"left_elbow_angle": "x"}}, ("columns", "left_elbow_angle", "time", "left_hip_angle")),
        ({"units": "grad"}, ("rad", "deg", "grad")),
    ],
)
def test_a_wrong_format_is_refused(changes, message):
    with raises(ParameterError, *message):
        LogFormat(**changes)


# ---------------------------------------------------------------------- anything at all

FORMATS = [
    LogFormat(),
    IN_DEGREES,
    LogFormat(convention=find_convention("opensim_gait2392"), units="deg"),
    LogFormat(convention=CORC_X2),
]


def assert_read_or_refused(path, log_format: LogFormat) -> None:
    try:
        recording = read_recording(path, log_format)
    except TwinGaitError as error:
        assert len(str(error).splitlines()) == 1
    else:
        assert recording.n_ticks >= 2
        assert all(np.isfinite(values).all() for values in recording.angles.values())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzzed")


@given(
    content=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "ignore")),
    ending=st.sampled_from(["csv", "mot", "sto", "parquet"]),
    log_format=st.sampled_from(FORMATS),
)
def test_any_bytes_are_read_or_refused_in_one_line(folder, content, ending, log_format):
    path = folder / f"log.{ending}"
    path.write_bytes(content)
    assert_read_or_refused(path, log_format)


@given(
    text=st.sampled_from([("csv", CSV_TEXT), ("mot", OPENSIM_TEXT), ("sto", SIMM_TEXT)]),
    cuts=st.lists(
        st.tuples(
            st.integers(0, 400),
            st.integers(0, 6),
            st.text("0123456789.,;-+eE\t\n\r =\"'#ainfNx\x00é", max_size=5),
        ),
        min_size=1,
        max_size=5,
    ),
    log_format=st.sampled_from(FORMATS),
)
def test_a_damaged_log_is_read_or_refused_in_one_line(folder, text, cuts, log_format):
    ending, content = text
    for position, length, replacement in cuts:
        start = position % (len(content) + 1)
        content = content[:start] + replacement + content[start + length :]
    path = folder / f"damaged.{ending}"
    path.write_text(content, newline="")
    assert_read_or_refused(path, log_format)


@given(length=st.integers(0, 1000), position=st.integers(0, 2000), byte=st.integers(0, 255))
def test_a_damaged_parquet_log_is_read_or_refused_in_one_line(folder, length, position, byte):
    frame = pd.DataFrame({"time_s": TIME, "left_hip_angle_rad": TIME})
    whole = bytearray(frame.to_parquet())
    whole[position % len(whole)] = byte
    path = folder / "damaged.parquet"
    path.write_bytes(whole[: len(whole) - length] if length % 2 else whole)
    assert_read_or_refused(path, LogFormat())
