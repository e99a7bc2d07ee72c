"""Work spread over processes of this machine: results as they come, lost processes replaced."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, current_process, get_context, parent_process
from multiprocessing.connection import wait as wait_for_sentinels
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, TypeVar

from twin_gait.exceptions import TwinGaitError

# A process that dies takes what is under way with it; the third time it is no accident.
LOSSES_ALLOWED = 3
UNGUARDED = 113  # exit status of a worker that would start workers of its own
_UNGUARDED = (
    "every worker process runs this script from its beginning; put the script's own code under "
    "if __name__ == '__main__': (or take workers=1)"
)

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkersLost(TwinGaitError):
    """Worker processes died again and again, or the cluster is gone."""


class Runner(Protocol):
    """Something that works items off, here or elsewhere."""

    def slots(self) -> int:
        """How many items are worked on at a time."""
        ...

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Result, None, None]:
        """Give the results of a function of a module, in the order in which they come.

        Args:
            function: The function.
            items: Its arguments, taken one by one when there is room.

        Yields:
            One result for each item.

        Raises:
            WorkersLost: If an item was lost with its worker too often.
        """
        ...


@dataclass(frozen=True)
class LocalRunner:
    """Processes of this machine; a single worker is the calling process.

    Attributes:
        workers: How many.
    """

    workers: int = 1

    def slots(self) -> int:
        """How many items are worked on at a time."""
        return self.workers

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Result, None, None]:
        """See :meth:`Runner.run`."""
        if self.workers == 1:
            for item in items:
                yield function(item)
        else:
            with StandingRunner(self.workers) as standing:
                yield from standing.run(function, items)


class StandingRunner:
    """Processes of this machine that stay from one call to the next, for work in many short portions.

    A context manager; the processes start with the first portion and end with it. A single worker is the
    calling process.
    """

    def __init__(self, workers: int = 1) -> None:
        """Use so many processes."""
        self._workers = workers
        self._processes: ProcessPoolExecutor | None = None
        self._started = set[BaseProcess]()

    def __enter__(self) -> StandingRunner:
        """Begin."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the processes."""
        self._end()

    def slots(self) -> int:
        """How many items are worked on at a time."""
        return self._workers

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Result, None, None]:
        """See :meth:`Runner.run`."""
        if self._workers == 1:
            yield from LocalRunner().run(function, items)
            return
        fresh = (_Attempt(item) for item in items)
        lost: deque[_Attempt] = deque()
        while True:
            under_way: dict[Future[Result], _Attempt] = {}
            try:
                self._processes = self._processes or _pool(self._workers)
                attempts = _lost_first(lost, fresh)
                submit = partial(self._submit, self._processes, function, under_way, lost)
                yield from _work_off(submit, attempts, under_way, self._workers)
                return
            except BrokenProcessPool:
                self._end()
                if any(process.exitcode == UNGUARDED for process in self._started):
                    raise WorkersLost(_UNGUARDED) from None
                yield from _sort_out(under_way, lost)
            finally:
                for future in under_way:
                    future.cancel()  # nobody waits for it if the caller has left

    def _submit(self, *arguments: Any) -> None:
        """Hand an item over, and remember who works here: a pool that broke no longer knows."""
        _submit(*arguments)
        self._started.update(active_children())

    def _end(self) -> None:
        if self._processes is not None:
            self._processes.shutdown(cancel_futures=True)
            self._processes = None


@dataclass
class _Attempt:
    """An item and how often it was lost."""

    item: Any
    losses: int = 0


def _work_off(
    submit: Callable[[_Attempt], None],
    attempts: Iterable[_Attempt],
    under_way: dict[Future[Result], _Attempt],
    workers: int,
) -> Iterator[Result]:
    """Results as they come, until a process dies; no more under way than keeps every process busy."""
    for attempt in attempts:
        submit(attempt)
        if len(under_way) > workers:
            yield from _finished(under_way)
    while under_way:
        yield from _finished(under_way)


def _pool(workers: int) -> ProcessPoolExecutor:
    if getattr(current_process(), "_inheriting", False):  # as multiprocessing itself asks before its trace
        os._exit(UNGUARDED)  # a worker that runs the script of its parent: the parent says so, once
    # Forked children would share the BLAS and OpenMP threads of this process; spawned ones do not.
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_begin_worker)


def _lost_first(lost: deque[_Attempt], fresh: Iterator[_Attempt]) -> Iterator[_Attempt]:
    while lost:
        yield lost.popleft()
    # Not "yield from": leaving this generator would close the other one.
    for attempt in fresh:  # noqa: UP028
        yield attempt


def _submit(
    pool: ProcessPoolExecutor,
    function: Callable[[Item], Result],
    under_way: dict[Future[Result], _Attempt],
    lost: deque[_Attempt],
    attempt: _Attempt,
) -> None:
    # A process inherits what is blocked while it is started: Ctrl-C reaches every process of a terminal, and
    # one that is still importing would answer with a traceback.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        under_way[pool.submit(function, attempt.item)] = attempt
    except BrokenProcessPool:
        lost.append(attempt)
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _finished(under_way: dict[Future[Result], _Attempt]) -> Iterator[Result]:
    """Results that are there, as soon as there is one."""
    done, _ = wait(under_way, return_when=FIRST_COMPLETED)
    for future in done:
        result = future.result()
        del under_way[future]
        yield result


def _sort_out(under_way: dict[Future[Result], _Attempt], lost: deque[_Attempt]) -> Iterator[Result]:
    """After a process has died: the results that came before, and the rest back into the queue."""
    for future, attempt in under_way.items():
        if future.exception() is None:
            yield future.result()
            continue
        attempt.losses += 1
        if attempt.losses >= LOSSES_ALLOWED:
            raise WorkersLost(
                f"a worker process died {attempt.losses} times while {attempt.item} was under way; "
                "is memory short? try fewer workers"
            )
        lost.append(attempt)


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent, which alone knows what to do about it, and do not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    """A parent that is killed cannot tell its workers, which would wait for ever."""
    parent = parent_process()
    assert parent is not None  # only workers come here
    wait_for_sentinels([parent.sentinel])
    os._exit(1)
