"""Tests of text tables of other programs: each layout is read, or refused with a suggestion."""

from __future__ import annotations

import codecs

import numpy as np
import pytest
from errors import raises

from twin_gait.exceptions import ParameterFileError
from twin_gait.runs.log_files import read_log_table, read_text_table

NUMBERS = np.array([[0.0, 1.5, -2.25], [0.01, 1.75, -2.5], [0.02, 2.0, -2.75]])
NAMES = ["time", "hip", "knee"]


def text_of(separator: str = ",", decimal: str = ".", end: str = "") -> str:
    rows = [NAMES, *([f"{value:g}".replace(".", decimal) for value in row] for row in NUMBERS)]
    return "".join(separator.join(row) + end + "\n" for row in rows)


PLAIN = text_of()
SEMICOLONS = text_of(";", ",")
LAYOUTS = {
    "comma": PLAIN,
    "decimal comma, whole numbers in the first row": SEMICOLONS.replace("0;1,5;-2,25", "0;1;-2"),
    "decimal comma and blanks": text_of(" ", ","),
    "decimal comma and tabs": text_of("\t", ","),
    "line with the separator": "sep=;\n" + SEMICOLONS,
    "line with the separator in quotes": '"sep=,"\n' + PLAIN,
    "rows that end in a comma": text_of(end=","),
    "rows of numbers that end in a comma": PLAIN.replace("\n", ",\n").replace("knee,", "knee"),
    "rows that end in a comma and a blank": text_of(", ", end=", "),
    "empty rows at the end": PLAIN + ",,\n\n,,\n",
    "preamble of other width": "Export;v2.1\nDate;2024-05-15\n\n" + SEMICOLONS,
    "preamble with numbers": "Rate;100\nMass;2.5\n" + text_of(";"),
    "preamble filled up to the width": "Export,v2.1,\nRate,100,\n" + PLAIN,
    "comment lines": "# one\n% two\n" + PLAIN.replace("0.01", "# three\n0.01"),
    "UTF-8 with its mark": "\ufeff" + PLAIN,
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_same_numbers(tmp_path, name):
    path = tmp_path / "a.csv"
    path.write_text(LAYOUTS[name], encoding="utf-8")
    table = read_text_table(path)
    columns = np.column_stack([table.numbers(column) for column in NAMES])
    expected = NUMBERS.copy()
    if "whole numbers" in name:
        expected[0] = [0.0, 1.0, -2.0]
    np.testing.assert_array_equal(columns, expected)


@pytest.mark.parametrize(
    ("mark", "encoding"),
    [
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
        (codecs.BOM_UTF32_LE, "utf-32-le"),
    ],
)
def test_the_byte_order_mark_selects_the_encoding(tmp_path, mark, encoding):
    path = tmp_path / "a.csv"
    path.write_bytes(mark + text_of("\t").encode(encoding))
    np.testing.assert_array_equal(read_log_table(path).numbers("hip"), NUMBERS[:, 1])


def test_a_number_sign_is_a_comment_at_the_start_of_a_line_only(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("time,", "Frame#,time,").replace("\n0", "\n7,0"))
    table = read_text_table(path)
    assert table.names == ("Frame#", "time", "hip", "knee")
    np.testing.assert_array_equal(table.numbers("knee"), NUMBERS[:, 2])


@pytest.mark.parametrize("units", ["s,deg,deg", "[s],[deg],[deg]", "(s), (deg), (deg)", ",deg,deg"])
def test_a_line_of_units_is_appended_to_the_names(tmp_path, units):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("knee\n", f"knee\n{units}\n"))
    for columns in ((), ("hip", "knee")):
        table = read_text_table(path, columns)
        assert table.names[1:] == ("hip [deg]", "knee [deg]")
        assert table.full_name("hip") == "hip [deg]"
        np.testing.assert_array_equal(table.numbers("hip [deg]"), NUMBERS[:, 1])


@pytest.mark.parametrize("mark", ["-1.#IND", "1.#QNAN0", "-1.#IND000", "NaN", "n/a", "-", ""])
def test_texts_for_missing_numbers_are_gaps(tmp_path, mark):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("1.75", mark))
    np.testing.assert_array_equal(read_text_table(path).numbers("hip", gaps=True), [1.5, np.nan, 2.0])


def test_a_decimal_comma_is_not_taken_for_a_mark_of_thousands(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text_of(";").replace("1.75", "1,750"))
    with raises(ParameterFileError, "hip", "row 2", "1,750"):
        read_text_table(path).numbers("hip")


def test_an_export_of_nexus_is_refused_with_the_lines_to_delete(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "Model Outputs\n100\n,,S:LHipAngles,,\nFrame,Sub Frame,X,Y,Z\n,,deg,deg,deg\n1,0,11,0,0\n"
    )
    with raises(ParameterFileError, "Vicon Nexus") as error:
        read_text_table(path)
    assert "\n" not in str(error.value)


STORAGE = "walk\nnRows=2\nnColumns=2\ninDegrees=no\nendheader\ntime\t{}\n0\t0.5\n0.01\t0.75\n"


@pytest.mark.parametrize(
    ("stated", "other", "found"), [("nRows=2", "nRows=120", 2), ("nColumns=2", "nColumns=40", 2)]
)
def test_a_header_of_opensim_that_does_not_fit_is_read_with_a_notice(tmp_path, stated, other, found):
    path = tmp_path / "a.sto"
    path.write_text(STORAGE.format("hip_flexion_r").replace(stated, other))
    table = read_log_table(path)
    assert table.notices == (f"the header says {other}, but the file has {found}",)
    assert table.numbers("hip_flexion_r").tolist() == [0.5, 0.75]


def test_a_moco_value_path_gives_its_coordinate(tmp_path):
    path = tmp_path / "a.sto"
    names = "/jointset/knee_r/knee_angle_r/value\t/jointset/knee_r/knee_angle_r/speed"
    path.write_text(STORAGE.format(names).replace("0.5", "0.5\t9").replace("0.75", "0.75\t9"))
    table = read_log_table(path)
    assert table.names == ("time", "knee_angle_r", "/jointset/knee_r/knee_angle_r/speed")
    assert table.numbers("knee_angle_r").tolist() == [0.5, 0.75]
