"""While an engine is compiled, the reference engine says what the run will come to."""

from __future__ import annotations

import io
import multiprocessing
import os
import sys
import time

import pytest

from twin_gait import load_experiment
from twin_gait.cli.preview import preview, preview_lines
from twin_gait.experiment import Experiment

PATIENCE = 60.0  # [s]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def experiment() -> Experiment:
    return load_experiment("bench_leg", ["duration_s=0.2"]).experiment


def test_a_terminal_is_told_how_the_run_ends(experiment, monkeypatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with preview(experiment) as start:
        assert multiprocessing.active_children() == []
        start()
        deadline = time.monotonic() + PATIENCE
        while "meanwhile" not in sys.stderr.getvalue() and time.monotonic() < deadline:
            time.sleep(0.05)
    assert multiprocessing.active_children() == []
    first = preview_lines(experiment)[0].partition(" s in ")[0]
    assert first.startswith("meanwhile, by the reference engine: ") and first.endswith("0.2")
    assert first in sys.stderr.getvalue()


def test_it_ends_with_the_run_and_says_nothing_afterwards(experiment, monkeypatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with preview(experiment) as start:
        start()
        assert len(multiprocessing.active_children()) == 1
    assert multiprocessing.active_children() == [] and sys.stderr.getvalue() == ""


@pytest.mark.parametrize(("terminal", "processors"), [(Terminal(), 1), (io.StringIO(), 2)])
def test_nothing_is_started_in_a_pipe_or_on_one_processor(
    terminal, processors, experiment, monkeypatch
) -> None:
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    with preview(experiment) as start:
        start()
        assert multiprocessing.active_children() == []
