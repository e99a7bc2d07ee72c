"""Announcement of a compilation: reason, expected time from records, logger or callback."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from twin_gait.simulation import code_cache
from twin_gait.simulation.code_cache import (
    CACHE_VARIABLE,
    CompiledLoop,
    cached_loop,
    source_files,
    source_key,
)
from twin_gait.simulation.compile_notes import Compilation, compile_text, parse_variant, read_records

WALK = (
    "run_ticks_at ('dtype', {'N_LEGS': 2, 'WEARER_OFFSET': 0, 'WITH_SUPERVISOR': False, "
    "'FRICTION_INDICES': (0, 1), 'WITH_FAULTS': False})"
)
BRACES = WALK.replace("'WEARER_OFFSET': 0", "'WEARER_OFFSET': 7").replace(
    "'WITH_SUPERVISOR': False", "'WITH_SUPERVISOR': True"
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr(code_cache, "_loops", {})
    return tmp_path / "cache"


def make() -> CompiledLoop:
    return CompiledLoop(lambda *_: 0, b"name\ncode")


def logged(caplog: pytest.LogCaptureFixture) -> list[str]:
    found = [item.getMessage() for item in caplog.records if item.name == "twin_gait"]
    caplog.clear()
    return found


def test_each_compilation_is_logged_once_with_its_reason_and_the_measured_time(
    cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "twin_gait")
    for _ in range(2):
        cached_loop(source_key(WALK), make, None)
    assert logged(caplog) == ["compiling the engine (first use on this machine)"]
    (record,) = cache.glob("*.json")
    document = json.loads(record.read_text())
    assert 0.0 < document["seconds"] < 60.0 and document["flags"]["N_LEGS"] == "2"
    record.write_text(json.dumps({**document, "seconds": 12.4}))
    cached_loop(source_key(BRACES), make, None)
    assert logged(caplog) == ["compiling the engine (new combination: braces, modes; about 12 s)"]
    assert len(list(cache.glob("*.json"))) == len(list(cache.glob("*.loop"))) == 2


def test_a_callback_takes_the_place_of_the_log(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    seen: list[int] = []
    cached_loop(source_key(WALK), make, lambda: seen.append(1))
    assert seen == [1] and logged(caplog) == []


def test_a_compilation_that_fails_leaves_no_record(cache: Path) -> None:
    def fail() -> CompiledLoop:
        raise RuntimeError

    with pytest.raises(RuntimeError):
        cached_loop(source_key(WALK), fail, None)
    assert not list(cache.glob("*"))


def test_functions_of_the_user_are_neither_kept_nor_recorded(
    cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cached_loop(source_key(WALK), make, None, user_functions=(make,))
    assert logged(caplog) == ["compiling the engine (a controller of your own is compiled in each process)"]
    assert not list(cache.glob("*"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (BRACES, "new combination: braces, modes; about 10 s"),
        (WALK.replace("'WEARER_OFFSET': 0", "'WEARER_OFFSET': 7"), "new combination: braces; about 10 s"),
        (BRACES.replace("'N_LEGS': 2", "'N_LEGS': 1"), "new combination: one leg, braces, modes; about 10 s"),
        (WALK.replace("'WITH_FAULTS': False", "'NEW_FLAG': 1"), "new combination: new flag; about 10 s"),
        (WALK.replace("'dtype'", "'other'"), "new combination: model or log columns; about 10 s"),
        (WALK.replace("run_ticks_at", "in lanes"), "first use on this machine"),
    ],
)
def test_the_nearest_cached_loop_decides_the_listed_changes(text: str, expected: str) -> None:
    walk = parse_variant(WALK)
    stairs = {**walk.flags, "N_LEGS": "3", "WITH_SLOPE": "True", "WEARER_OFFSET": "9"}
    records = [
        Compilation("run_ticks_at", stairs, "now", 30.0),
        Compilation("run_ticks_at", walk.flags, "now", 8.0),
    ]
    records.append(Compilation("run_ticks_at", walk.flags, "old", 10.0))
    assert f"({expected})" in compile_text(parse_variant(text), "now", records, has_user_code=False)


def test_disabled_features_and_changed_sources_are_named() -> None:
    braces = Compilation("run_ticks_at", parse_variant(BRACES).flags, "now", 8.0)
    assert "no braces, no modes; about 8 s" in compile_text(
        parse_variant(WALK), "now", [braces], has_user_code=False
    )
    changed = compile_text(parse_variant(WALK), "later", [braces], has_user_code=False)
    assert changed == "compiling the engine (the program, a library or the processor has changed; about 8 s)"


@pytest.mark.parametrize(
    "content",
    [None, b"", b"[]", b"{}", b"\xff", b'{"kind": "a", "flags": {}, "sources": "", "seconds": "x"}',
     b'{"kind": "a", "flags": {}, "sources": "", "seconds": NaN}',
     b'{"kind": "a", "flags": [], "sources": "", "seconds": 1}'],
)  # fmt: skip
def test_an_invalid_cache_file_is_ignored(content: bytes | None) -> None:
    whole = Compilation("a", {}, "", 1.0)
    assert read_records([content, whole.to_json().encode()]) == [whole]


def test_the_key_of_a_loop_reads_the_declared_messages() -> None:
    names = {path.name for path in source_files()}
    assert {"messages.py", "messages.yaml", "signals.py", "executors.py"} <= names
