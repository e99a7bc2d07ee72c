"""Tests that compiled code is loaded only from the user's own cache, and that a run needs no cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from errors import warns

from twin_gait.exceptions import RunDirectoryError
from twin_gait.simulation import code_cache
from twin_gait.simulation.code_cache import CACHE_VARIABLE, cache_folder, read_code, write_code

pytestmark = [pytest.mark.slow, pytest.mark.compile]

CODE = b"f\n" + bytes(range(256))


@pytest.fixture(autouse=True)
def cache_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Use a cache folder and a secret of this test only."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "cache"


def kept(folder: Path, name: str = "kept.loop") -> Path:
    folder.mkdir(exist_ok=True)
    write_code(folder / name, CODE)
    assert read_code(folder / name) == CODE
    return folder / name


def test_folder_and_secret_are_the_users_alone(cache_path: Path, tmp_path: Path) -> None:
    assert cache_folder() == cache_path
    kept(cache_path)
    secret = tmp_path / "data" / "twin_gait" / "cache.key"
    assert cache_path.stat().st_mode & 0o777 == 0o700
    assert secret.stat().st_mode & 0o777 == 0o600 and len(secret.read_bytes()) == code_cache.SECRET_BYTES


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_may_write_is_refused(cache_path: Path, mode: int) -> None:
    cache_path.mkdir()
    cache_path.chmod(mode)
    with warns(RuntimeWarning, "cache", "TWIN_GAIT_CACHE"):
        assert cache_folder() is None


def test_files_of_another_user_are_refused(cache_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, other = kept(cache_path), os.geteuid() + 1
    code_cache.private_folder.cache_clear()
    monkeypatch.setattr(os, "geteuid", lambda: other)
    with warns(RuntimeWarning, "cache", "TWIN_GAIT_CACHE"):
        assert cache_folder() is None
    assert read_code(path) is None


def test_a_file_that_others_may_write_and_a_link_are_refused(cache_path: Path) -> None:
    path = kept(cache_path)
    (cache_path / "link.loop").symlink_to(path)
    assert code_cache.read_private_file(cache_path / "link.loop") is None
    path.chmod(0o664)
    assert read_code(path) is None
    assert read_code(cache_path / "missing.loop") is None


@pytest.mark.parametrize(
    "change",
    [
        lambda whole: b"",
        lambda whole: b"no header",
        lambda whole: whole[:-1] + b"?",
        lambda whole: whole[: len(whole) // 2],
        lambda whole: whole + b"\nmore",
        lambda whole: b"0" * 64 + whole[64:],
        lambda whole: b"\xff" * 64 + whole[64:],
    ],
)
def test_a_file_that_was_changed_is_not_loaded(cache_path: Path, change: object) -> None:
    path = kept(cache_path)
    path.write_bytes(change(path.read_bytes()))  # type: ignore[operator]
    assert read_code(path) is None


def test_a_file_made_with_another_secret_or_put_in_place_of_another_is_not_loaded(
    cache_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = kept(cache_path)
    (cache_path / "other.loop").write_bytes(path.read_bytes())
    assert read_code(cache_path / "other.loop") is None
    monkeypatch.setattr(code_cache, "_secret", lambda folder: b"attacker" * 4)
    write_code(path, CODE)
    monkeypatch.undo()
    assert read_code(path) is None


def test_a_secret_readable_by_others_disables_the_cache(cache_path: Path, tmp_path: Path) -> None:
    path = kept(cache_path)
    (tmp_path / "data" / "twin_gait" / "cache.key").chmod(0o640)
    code_cache._secret.cache_clear()
    assert read_code(path) is None


def test_a_full_disk_does_not_stop_a_run(cache_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: bytes) -> None:
        raise RunDirectoryError(f"{path}: cannot be written (No space left on device)")

    cache_path.mkdir()
    monkeypatch.setattr(code_cache, "write_atomically", full)
    write_code(cache_path / "kept.loop", CODE)
    assert not any(cache_path.iterdir())


def test_a_user_without_a_home_has_no_cache(monkeypatch: pytest.MonkeyPatch, cache_path: Path) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in (CACHE_VARIABLE, "XDG_CACHE_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    assert cache_folder() is None
    assert code_cache.sign("name", b"") is None


RUN = """
import json, sys
from twin_gait import load_experiment, simulate
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.vocabulary import JointName
compilations = []
{program}
print(json.dumps([len(compilations), "numba" in sys.modules, last]))
"""
BENCH = """last = simulate_bench(
    bench_joint(JointName.KNEE, duration=0.1), on_compile=lambda: compilations.append(1)
).log.iloc[-1].tolist()"""


def run_in_a_process(program: str = BENCH) -> list[object]:
    result: list[object] = json.loads(
        subprocess.check_output([sys.executable, "-c", RUN.format(program=program)])
    )
    return result


def test_nothing_in_the_cache_folder_is_run(cache_path: Path, tmp_path: Path) -> None:
    """Regression: the cache once contained a module and pickles that were executed."""
    compiled, _, last = run_in_a_process()
    assert compiled == 1
    for path in cache_path.rglob("*"):
        if path.is_file():
            with path.open("a") as file:
                file.write(f"\nopen({str(tmp_path / 'harm')!r}, 'w')\n")
    assert run_in_a_process()[2] == last
    assert not (tmp_path / "harm").exists()
    assert [path.suffix for path in cache_path.rglob("*")] == [".loop"]


def test_the_bench_starts_again_without_the_compiler(cache_path: Path) -> None:
    first, again = run_in_a_process(), run_in_a_process()
    assert first[0] == 1
    assert again == [0, False, first[2]]


def test_a_cache_that_cannot_be_made_does_not_stop_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "file" / "cache"))
    compiled, compiler, last = run_in_a_process()
    assert (compiled, compiler) == (1, True) and last


PRINT_KEY = """
import json
from twin_gait.simulation.code_cache import source_key
print(json.dumps(source_key("loop")))
"""


def test_code_for_another_processor_is_kept_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environment variables of numba select the target processor, and the key depends on them."""
    keys = set()
    for options in (
        {},
        {"FEATURES": "+avx2,-avx512f"},
        {"NAME": "generic"},
        {"NAME": "haswell", "FEATURES": ""},
    ):
        for name in ("NAME", "FEATURES"):
            monkeypatch.delenv(f"NUMBA_CPU_{name}", raising=False)
        for name, value in options.items():
            monkeypatch.setenv(f"NUMBA_CPU_{name}", value)
        keys.add(json.loads(subprocess.check_output([sys.executable, "-c", PRINT_KEY])))
    assert len(keys) == 4
