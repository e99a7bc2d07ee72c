"""The job runner: results in order whoever works; what a lost worker had is done by others."""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from twin_gait.exceptions import ParameterError
from twin_gait.studies import JobFailed, Workers, WorkersLost, run_jobs
from twin_gait.studies.jobs import MOST_IN_CHUNK, portions
from twin_gait.studies.processes import LOSSES_ALLOWED


def square(number: int) -> int:
    return number * number


def slow_first(number: int) -> int:
    time.sleep(0.3 if number == 0 else 0.0)
    return number


def refuse(least: int, number: int) -> int:
    if number < least:
        raise ParameterError(f"{number} is below {least}")
    return number


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
def test_results_come_in_the_order_of_the_items(workers):
    assert run_jobs(square, range(20), workers=workers) == [number * number for number in range(20)]
    assert run_jobs(slow_first, range(6), workers=workers) == list(range(6))
    assert run_jobs(square, [], workers=workers) == []


def test_the_first_item_may_be_done_here_and_progress_counts_all():
    told: list[tuple[int, int]] = []
    progress = lambda *counts: told.append(counts)  # noqa: E731
    found = run_jobs(process_of, range(4), workers=2, first=process_of, progress=progress)
    assert found[0] == os.getpid() and os.getpid() not in found[1:]
    assert told == [(done, 4) for done in range(1, 5)]


@pytest.mark.parametrize("workers", [1, 2])
def test_stopped_work_gives_the_results_of_the_first_items(workers):
    done: list[int] = []
    found = run_jobs(
        square,
        range(100),
        workers=workers,
        progress=lambda number, total: done.append(number),
        should_stop=lambda: len(done) >= 5,
    )
    assert 5 <= len(found) <= 8
    assert found == [number * number for number in range(len(found))]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_fails_is_named_with_its_index(workers):
    with pytest.raises(JobFailed, match="job 2: 3 is below 4") as error:
        run_jobs(partial(refuse, 4), [6, 5, 3], workers=workers)
    assert (error.value.index, error.value.problem) == (2, "3 is below 4")


def test_a_portion_keeps_what_came_before_the_failure():
    with Workers() as workers:
        found = list(portions(partial(refuse, 4), [6, 5, 3], 3, workers, chunk_seconds=10.0, first=square))
    assert [item.results for item in found] == [{0: 36}, {1: 5}, {}]
    assert found[-1].problem == (2, "3 is below 4")


def test_chunks_grow_to_their_seconds_and_shrink_towards_the_end():
    with Workers() as workers:
        sizes = [
            len(item.results) for item in portions(square, range(5000), 5000, workers, chunk_seconds=60.0)
        ]
    assert sizes[0] == 1 and max(sizes) == MOST_IN_CHUNK and sizes[-1] == 1 and sum(sizes) == 5000


def test_items_of_a_worker_that_died_are_done_by_others(tmp_path):
    names = [f"{number}" for number in range(6)]
    names.insert(2, "fatal")
    assert run_jobs(square_but_die_once, [str(tmp_path / name) for name in names], workers=2) == names


def test_processes_stay_from_one_call_to_the_next_and_end_with_their_context():
    with Workers(1) as alone:
        assert run_jobs(process_of, [0], workers=alone) == [os.getpid()]
    with Workers(2) as workers:
        first, later = (set(run_jobs(process_of, range(6), workers=workers)) for _ in range(2))
    assert first & later and os.getpid() not in first | later
    for process in first | later:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_an_item_that_kills_its_workers_ends_the_work_with_one_line():
    with Workers(2) as workers:
        with pytest.raises(WorkersLost, match=f"died {LOSSES_ALLOWED} times while 7 was under way") as error:
            run_jobs(die, [7], workers=workers)
        assert "\n" not in str(error.value)
        assert run_jobs(square, [2, 3], workers=workers) == [4, 9]  # with new processes


def test_no_workers_are_refused():
    with pytest.raises(ParameterError, match="workers: expected 1 or more, got 0"):
        run_jobs(square, [1], workers=0)
