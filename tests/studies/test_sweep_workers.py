"""Worker processes that die: what they had is done by others, unless it is what kills them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from twin_gait.studies.workers import LOSSES_ALLOWED, LocalRunner, StandingRunner, WorkersLost


def square(number: int) -> int:
    return number * number


def square_but_die_once(place: str) -> str:
    """Leave a mark and die; the next one finds the mark."""
    mark = Path(place)
    if mark.name == "fatal" and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return mark.name


def process_of(_: int) -> int:
    time.sleep(0.1)  # long enough for the second process to get some
    return os.getpid()


def die(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.parametrize("workers", [1, 2])
def test_every_item_gives_one_result(workers):
    assert sorted(LocalRunner(workers).run(square, range(20))) == sorted(n * n for n in range(20))


def test_items_of_a_worker_that_died_are_done_by_others(tmp_path):
    names = [f"{number}" for number in range(6)]
    names.insert(2, "fatal")
    results = list(LocalRunner(2).run(square_but_die_once, [str(tmp_path / name) for name in names]))
    assert sorted(results) == sorted(names)


def test_processes_stay_from_one_call_to_the_next_and_end_with_their_runner():
    with StandingRunner(1) as alone:
        assert set(alone.run(process_of, [0])) == {os.getpid()}
    with StandingRunner(2) as runner:
        first, later = (set(runner.run(process_of, range(6))) for _ in range(2))
    assert first & later and os.getpid() not in first | later
    for process in first | later:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_an_item_that_kills_its_workers_ends_the_work_with_one_line():
    with pytest.raises(WorkersLost, match=f"died {LOSSES_ALLOWED} times while 7 was under way") as error:
        list(LocalRunner(2).run(die, [7]))
    assert "\n" not in str(error.value)
