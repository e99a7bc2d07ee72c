"""What the terminal says while an engine is compiled."""

from __future__ import annotations

import io
import sys
import threading
import time

import pytest

from twin_gait.cli.terminal import USUAL_COMPILATION, compilation_clock, compilation_line, watched

PATIENCE = 20.0  # [s]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def clocks() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if "compilation_clock" in repr(thread._target)]


def test_a_terminal_says_how_long_it_takes_until_the_first_progress(monkeypatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    with watched("simulating", "tick", lambda: False) as watch:
        watch["on_compile"]()
        (clock,) = clocks()
        deadline = time.monotonic() + PATIENCE
        while " s of about" not in sys.stderr.getvalue() and time.monotonic() < deadline:
            time.sleep(0.05)
        watch["progress"](0, 10)
        assert not clock.is_alive()
        watch["on_compile"]()  # a second model
        assert len(clocks()) == 1
    assert clocks() == []
    said = sys.stderr.getvalue()
    assert said.count("compiling the engine for this model") == 2 and " s of about 15 [" in said


def test_a_pipe_gets_one_line(monkeypatch, capsys) -> None:
    with compilation_clock() as (start, _):
        start()
        assert clocks() == []
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and "10 to 20 s" in captured.err


@pytest.mark.parametrize(
    ("passed", "line"),
    [
        (0.4, "   0 s of about 15 [#...................]"),
        (USUAL_COMPILATION / 2, "   8 s of about 15 [##########..........]"),
        (USUAL_COMPILATION, "  15 s of about 15 [####################]"),
        (31.0, "  31 s, longer than the usual 15 s: the machine is slow or busy"),
    ],
)
def test_the_line_counts_up_and_admits_that_it_was_wrong(passed: float, line: str) -> None:
    assert compilation_line(passed) == line
