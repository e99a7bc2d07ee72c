"""Jobs on processes of this machine, lost ones replaced, or on a Dask cluster: results as they come.

A Dask scheduler and its workers run whatever anybody sends them who can reach their ports: keep them on the
loopback or on a private network. From this package they get plain numbers and texts, and give such back.
"""

import contextlib
import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import active_children, current_process, get_context, parent_process
from multiprocessing.connection import wait as wait_for_sentinels
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from twin_gait.exceptions import MissingOptionalDependency, ParameterError, TwinGaitError

# A process that dies takes what is under way with it; the third time it is no accident.
LOSSES_ALLOWED = 3
UNGUARDED = 113  # exit status of a worker that would start workers of its own
_UNGUARDED = (
    "every worker process runs this script from its beginning; put the script's own code under "
    "if __name__ == '__main__': (or take workers=1)"
)

Item = TypeVar("Item")
Result = TypeVar("Result")
CONNECTION_TIMEOUT = 10.0  # [s]
WORKER_TIMEOUT = 60.0  # [s]
# Chunks waiting at the scheduler for each that runs, so that no worker waits for this process.
AHEAD = 2


class WorkersLost(TwinGaitError):
    """Worker processes died again and again, or the cluster is gone."""


@dataclass
class _Attempt:
    """An item and how often it was lost."""

    item: Any
    losses: int = 0


class Processes:
    """Processes that start with the first item and stay from one call to the next; one is the caller itself.

    Spawned, not forked: forked children would share the BLAS and OpenMP threads of this process. And not
    threads, although the compiled loop releases the interpreter's lock: a quarter of an episode (laying the
    problem out, summing the run up) holds it, and silencing the URDF parser redirects standard error, which
    two threads do to each other. Starting up takes 2 s, once.
    """

    def __init__(self, workers: int) -> None:
        """Use so many processes."""
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None
        self._started = set[BaseProcess]()

    def slots(self) -> int:
        """How many items are worked on at a time."""
        return self._workers

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Result, None, None]:
        """Results of a function of a module in the order in which they come; items are taken one by one."""
        if self._workers == 1:
            yield from map(function, items)
            return
        fresh = (_Attempt(item) for item in items)
        lost: deque[_Attempt] = deque()
        while True:
            under_way: dict[Future[Result], _Attempt] = {}
            try:
                # Those that were lost come first.
                while attempt := lost.popleft() if lost else next(fresh, None):
                    self._submit(function, attempt, under_way, lost)
                    # One more than there are processes keeps all of them busy.
                    if len(under_way) > self._workers:
                        yield from _finished(under_way)
                while under_way:
                    yield from _finished(under_way)
                return
            except BrokenProcessPool:
                self.end()
                if any(process.exitcode == UNGUARDED for process in self._started):
                    raise WorkersLost(_UNGUARDED) from None
                yield from _sort_out(under_way, lost)
            finally:
                for future in under_way:
                    future.cancel()  # nobody waits for it if the caller has left

    def end(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def _submit(
        self, function: Any, attempt: _Attempt, under_way: dict[Future[Any], _Attempt], lost: deque[_Attempt]
    ) -> None:
        self._pool = self._pool or _new_pool(self._workers)
        # A process inherits what is blocked while it is started: Ctrl-C reaches every process of a terminal,
        # and one that is still importing would answer with a traceback.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            under_way[self._pool.submit(function, attempt.item)] = attempt
        except BrokenProcessPool:
            lost.append(attempt)
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        # Remembered, because a pool that broke no longer knows them.
        self._started.update(active_children())


def _new_pool(workers: int) -> ProcessPoolExecutor:
    if getattr(current_process(), "_inheriting", False):  # as multiprocessing itself asks before its trace
        os._exit(UNGUARDED)  # a worker that runs the script of its parent: the parent says so, once
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_begin_worker)


def _finished(under_way: dict[Future[Result], _Attempt]) -> Iterator[Result]:
    """Results that are there, as soon as there is one."""
    for future in wait(under_way, return_when=FIRST_COMPLETED).done:
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


class ClusterWorkers:
    """The workers of a Dask cluster. A chunk whose worker is lost is given to another by Dask itself."""

    def __init__(self, client: Any) -> None:
        """Use a connected client; see :func:`connected`."""
        self._client = client

    def slots(self) -> int:
        """How many items are worked on at a time; workers may come and go."""
        threads: dict[str, int] = self._client.nthreads()
        return max(1, sum(threads.values()))

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Result, None, None]:
        """See :meth:`twin_gait.studies.workers.Processes.run`."""
        under_way: dict[Any, Item] = {}
        try:
            for item in items:
                under_way[self._client.submit(function, item, pure=False)] = item
                if len(under_way) >= AHEAD * self.slots():
                    yield from _finished_there(under_way)
            while under_way:
                yield from _finished_there(under_way)
        except _lost_connection() as error:
            raise WorkersLost("the scheduler of the cluster is gone; start it and go on") from error
        finally:
            with contextlib.suppress(*_lost_connection()):
                self._client.cancel(list(under_way))


@contextlib.contextmanager
def connected(address: str) -> Iterator[ClusterWorkers]:
    """Connect to the workers of a scheduler, for example of ``tcp://127.0.0.1:8786``."""
    client = _client(address)
    try:
        with contextlib.suppress(TimeoutError):
            client.wait_for_workers(1, timeout=WORKER_TIMEOUT)
        if not client.nthreads():
            raise WorkersLost(f"{address}: no workers; start some with: dask worker {address} --nthreads 1")
        yield ClusterWorkers(client)
    finally:
        with contextlib.suppress(*_lost_connection()):
            client.close(timeout=CONNECTION_TIMEOUT)


def _client(address: str) -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingOptionalDependency("dask.distributed", "cluster", "--scheduler") from error
    # What goes wrong is told in one line; the library's own loggers would add a screen full.
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client  # its stubs leave it untyped
        return client(address, timeout=CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise ParameterError(
            f"--scheduler {address}: no Dask scheduler answers there ({reason}); give it as tcp://host:port"
        ) from error


def _lost_connection() -> tuple[type[BaseException], ...]:
    from concurrent.futures import CancelledError

    from distributed.comm.core import CommClosedError

    return (CommClosedError, CancelledError, OSError, TimeoutError)


def _finished_there(under_way: dict[Any, Item]) -> Iterator[Any]:
    """Results that are there, as soon as there is one."""
    import distributed

    wait: Any = distributed.wait
    for future in wait(list(under_way), return_when="FIRST_COMPLETED").done:
        error = future.exception()
        if error is not None:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
            raise WorkersLost(
                f"{under_way[future]}: the cluster gave up ({reason}); has every worker the same twin_gait "
                "installed, and memory enough?"
            )
        result = future.result()
        del under_way[future]
        yield result
