"""The job runner: results in order whoever works, and one line when a worker dies."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Sequence
from functools import partial

import pytest
from errors import raises

from twin_gait.exceptions import ParameterError
from twin_gait.studies.jobs import JobError, run_blocks, run_jobs
from twin_gait.studies.workers import Workers, WorkersLost


def square(number: int) -> int:
    return number * number


def slow_first(number: int) -> int:
    time.sleep(0.3 if number == 0 else 0.0)
    return number


def refuse(least: int, number: int) -> int:
    if number < least:
        raise ParameterError(f"{number} is below {least}")
    return number


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


def backwards(items: Sequence[int]) -> Iterator[tuple[int, tuple[int, int]]]:
    """Of each item its square and how many it came with, the last one first."""
    for index, number in reversed(list(enumerate(items))):
        if number < 0:
            raise JobError(index, f"{number} is negative")
        yield index, (number * number, len(items))


@pytest.mark.parametrize("workers", [1, 2])
def test_blocks_come_in_the_order_of_their_items_and_progress_counts_these(workers):
    reported: list[tuple[int, int]] = []
    found = run_blocks(
        backwards,
        range(100),
        block=32,
        workers=workers,
        progress=lambda *counts: reported.append(counts),
    )
    assert found == [(number * number, 25) for number in range(100)]
    assert reported == [(done, 100) for done in (25, 50, 75, 100)]
    with raises(JobError, "job 70", "-7"):
        run_blocks(backwards, [*range(70), -7, *range(29)], block=32, workers=workers)


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
    with raises(JobError, "job 2", "3", "4") as error:
        run_jobs(partial(refuse, 4), [6, 5, 3], workers=workers)
    assert (error.value.index, error.value.problem) == (2, "3 is below 4")


def test_results_before_a_failure_can_be_kept():
    kept: dict[int, tuple[int, int]] = {}
    with raises(JobError, "job 1", "-3"):
        run_blocks(backwards, [6, -3, 5, 9], block=4, on_results=kept.update)
    assert kept == {2: (25, 4), 3: (81, 4)}


def test_worker_processes_are_reused_between_calls_and_end_with_their_context():
    with Workers(1) as alone:
        assert run_jobs(process_of, [0], workers=alone) == [os.getpid()]
    with Workers(2) as workers:
        first, later = (set(run_jobs(process_of, range(6), workers=workers)) for _ in range(2))
    assert first & later and os.getpid() not in first | later
    for process in first | later:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_a_worker_that_dies_ends_the_work_with_one_line():
    with Workers(2) as workers:
        with raises(WorkersLost, "worker", "workers=1") as error:
            run_jobs(die, [7, 8, 9], workers=workers)
        assert "\n" not in str(error.value)
        assert run_jobs(square, [2, 3], workers=workers) == [4, 9]  # with new processes


def test_a_misspelt_argument_is_an_error():
    with raises(TypeError, "worker"):
        run_jobs(str, [1], worker=2)


def test_zero_workers_are_refused():
    with raises(ParameterError, "workers", "1", "0"):
        run_jobs(square, [1], workers=0)
