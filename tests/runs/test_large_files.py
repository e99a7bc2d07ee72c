"""Files that unpack to more than any log of a walk are refused before they are read, in one line."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from errors import states

from twin_gait import files
from twin_gait.cli import main
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.experiment import LONGEST_RUN
from twin_gait.gait.table import TICK
from twin_gait.identification.reading import read_log
from twin_gait.runs.log_files import read_log_table
from twin_gait.runs.record import read_stored_run


@pytest.fixture(scope="module")
def bomb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write some kilobytes that unpack to twice the maximum number of rows."""
    path = tmp_path_factory.mktemp("bomb") / "log.parquet"
    zeros = pa.table({"time_s": np.zeros(2 * files.MOST_ROWS, dtype=np.int8)})
    pq.write_table(zeros, path, compression="zstd")
    assert path.stat().st_size < 100_000
    return path


def refused(read: object, path: Path) -> str:
    started = time.monotonic()
    with pytest.raises(ParameterFileError) as caught:
        read(path)  # type: ignore[operator]
    assert time.monotonic() - started < 5.0
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_small_file_that_unpacks_to_too_many_rows_is_refused(
    bomb: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pq, "read_table", lambda path: pytest.fail("was read"))
    assert "20000000 rows" in refused(read_log_table, bomb)


def test_a_run_whose_log_is_too_large_is_refused(tmp_path: Path, bomb: Path) -> None:
    out = tmp_path / "run"
    assert main(["simulate", "bench_leg", "--duration", "0.1", "--no-pictures", "--out", str(out)]) == 0
    (out / "log.parquet").write_bytes(bomb.read_bytes())
    assert "20000000 rows" in refused(read_stored_run, out)


def test_many_columns_count_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pq.write_table(pa.table({name: np.zeros(50) for name in "abc"}), tmp_path / "a.parquet")
    (tmp_path / "a.csv").write_text("a,b,c\n" + 50 * "1,2,3\n")
    for name in ("a.parquet", "a.csv"):
        assert len(read_log_table(tmp_path / name).names) == 3
    monkeypatch.setattr(files, "MOST_CELLS", 149)
    for name in ("a.parquet", "a.csv"):
        assert states(refused(read_log_table, tmp_path / name), "50", "3")


def test_the_longest_run_can_be_read_again() -> None:
    widest = 170  # columns of a walk with braces on six joints, rounded up
    files.require_table_size(Path("log.parquet"), round(LONGEST_RUN / TICK), widest)


@pytest.mark.parametrize("name", ["long.csv", "long.mot"])
@pytest.mark.parametrize("text", [",".join(["1"] * 2_000_000), "time,hip\n0,1\n" + "1," * 2_000_000 + "\n"])
def test_a_line_of_four_megabytes_is_handled_in_time(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    assert "characters" in refused(read_log_table, tmp_path / name)


def test_a_text_that_is_too_long_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (tmp_path / "log.csv").open("wb") as file:
        file.truncate(files.MOST_TEXT + 1)  # a hole, which takes no disk
    assert "divide the file" in refused(read_log_table, tmp_path / "log.csv")


@pytest.mark.parametrize("before", ["", "# mass_kg: 2.5\n"])
def test_identify_refuses_a_line_of_four_megabytes(tmp_path: Path, before: str) -> None:
    (tmp_path / "log.csv").write_text(before + ",".join(["velocity"] * 500_000) + "\n1,2\n")
    assert "too long" in refused(read_log, tmp_path / "log.csv")


def test_identify_refuses_too_many_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "log.csv").write_text("velocity,friction_torque\n" + "1,2\n" * 50)
    assert len(read_log(tmp_path / "log.csv")) == 50
    monkeypatch.setattr(files, "MOST_ROWS", 30)
    assert "50 rows" in refused(read_log, tmp_path / "log.csv")


def test_parquet_is_read_without_a_second_copy_of_it(tmp_path):
    phases = pd.Categorical(["swing", "stance"])
    names = {"b.c": [1.0, None], "b": [{"c": 1}, {"c": 2}], "phase": phases, "n": [1, 2]}
    expected = pd.DataFrame(names)
    expected.to_parquet(tmp_path / "log.parquet")
    before = pa.total_allocated_bytes()
    found = files.read_parquet(tmp_path / "log.parquet")
    pd.testing.assert_frame_equal(found[["b.c", "phase", "n"]], expected[["b.c", "phase", "n"]])
    assert list(found) == list(names)
    wide = pd.DataFrame(np.ones((1000, 50))).rename(columns=str)
    files.write_parquet(tmp_path / "log.parquet", wide)
    found = files.read_parquet(tmp_path / "log.parquet")
    assert found.equals(wide)
    assert pa.total_allocated_bytes() - before < found.memory_usage().sum() / 10
