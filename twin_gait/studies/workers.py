"""Jobs on processes of this machine or on a Dask cluster, with results as they are completed.

A Dask scheduler and its workers execute any code from anybody who can reach their ports: keep them on the
loopback interface or on a private network. This package sends them experiments and receives numbers and
texts.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import current_process, get_context, parent_process
from multiprocessing.connection import wait as wait_for_sentinels
from typing import Any, TypeVar

from twin_gait.exceptions import MissingOptionalDependency, ParameterError, TwinGaitError
from twin_gait.parameters.quantities import require

_DIED = (
    "a worker process ended unexpectedly; if memory is short, use fewer workers. Each worker imports the "
    "script: put its own code under if __name__ == '__main__': (or use workers=1)"
)

Item = TypeVar("Item")
Result = TypeVar("Result")
CONNECTION_TIMEOUT = 10.0  # [s]
WORKER_TIMEOUT = 60.0  # [s]
SUBMITTED_PER_SLOT = 2  # submitted items for each running one, so that no worker waits for this process


class WorkersLost(TwinGaitError):
    """Error: a worker process died, or the cluster is lost."""


class Workers:
    """Processes of this machine, or the workers of a Dask cluster, for several calls of ``run_jobs``.

    A context manager; processes start with the first job and end with the context. Workers end with a parent
    that is killed. One process means the calling process.

    Processes are spawned, not forked, because forked children would share the BLAS and OpenMP threads of this
    process. Threads are not used, although the compiled loop releases the interpreter's lock: a quarter of an
    episode (building the simulation setup, summarising the run) holds it, and silencing the URDF parser
    redirects standard error, so that two threads would interfere. Starting the processes takes 2 s, once.

    ``workers``: number of processes of this machine. ``cluster``: address of a Dask scheduler such as
    ``tcp://127.0.0.1:8786``, in place of processes. Raises ParameterError if the workers are below 1, or on
    entry if there is no scheduler at the address. Raises MissingOptionalDependency on entry, if
    dask.distributed is not installed. Raises WorkersLost on entry, if the cluster has no workers.
    """

    def __init__(self, workers: int = 1, cluster: str | None = None) -> None:
        """Store the kind of workers; nothing is started."""
        require(workers >= 1, "workers", "1 or more", workers)
        self._workers, self._cluster = workers, cluster
        self._client: Any = None  # client of the cluster, after the connection
        self._pool: Executor | None = None

    def __enter__(self) -> Workers:
        if self._cluster is not None:
            self._client = _connected(self._cluster)
            self._pool = self._client.get_executor(pure=False)
        return self

    def __exit__(self, *exception: Any) -> None:
        if self._client is None:
            self._end_processes()
            return
        with contextlib.suppress(Exception):  # the scheduler may have ended
            self._client.close(timeout=CONNECTION_TIMEOUT)

    def slots(self) -> int:
        """Return the number of jobs that run at a time; on a cluster it may change."""
        return self._workers if self._client is None else max(1, sum(self._client.nthreads().values()))

    def as_completed(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Generator[Result, None, None]:
        """Yield results in the order of completion; items are taken one by one when a slot is free."""
        if self._client is None and self._workers == 1:
            yield from map(function, items)
            return
        pending: set[Future[Result]] = set()
        try:
            for item in items:
                pending.add(self._submit(function, item))
                if len(pending) >= SUBMITTED_PER_SLOT * self.slots():
                    yield from _finished(pending)
            while pending:
                yield from _finished(pending)
        except BrokenProcessPool:
            self._end_processes()
            raise WorkersLost(_DIED) from None
        except Exception as error:  # any failure of the cluster; it repeats the items of lost workers itself
            if self._client is None or isinstance(error, TwinGaitError):
                raise
            reason = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
            raise WorkersLost(
                f"the cluster has stopped ({reason}); check that all workers have the same twin_gait and "
                "enough memory"
            ) from error
        finally:
            for future in pending:
                future.cancel()  # no longer needed if the caller has ended early

    def _submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        self._pool = self._pool or _new_pool(self._workers)
        # A new process inherits the mask of blocked signals. Ctrl-C reaches every process of a terminal,
        # and a process that is still importing would print a traceback.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(function, item)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _end_processes(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


def _new_pool(workers: int) -> ProcessPoolExecutor:
    if getattr(current_process(), "_inheriting", False):  # as multiprocessing checks it
        os._exit(1)  # a worker that runs the script of its parent; the parent reports it, once
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_begin_worker)


def _finished(pending: set[Future[Result]]) -> Iterator[Result]:
    """Yield the completed results, as soon as there is one."""
    for future in wait(pending, return_when=FIRST_COMPLETED).done:
        pending.remove(future)
        yield future.result()


def _begin_worker() -> None:
    """Ignore Ctrl-C in a worker, because the parent handles it, and end the worker with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """Wait for the end of the parent, then exit; a killed parent cannot end its workers itself."""
    parent = parent_process()
    assert parent is not None  # only workers call this
    wait_for_sentinels([parent.sentinel])
    os._exit(1)


def _connected(address: str) -> Any:
    """Connect to the workers of a scheduler; return Dask's client."""
    try:
        import distributed
    except ImportError as error:
        raise MissingOptionalDependency("dask.distributed", "cluster", "--scheduler") from error
    # An error is reported in one line; the loggers of the library would add many more.
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client: Any = distributed.Client(address, timeout=CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise ParameterError(
            f"--scheduler {address}: no Dask scheduler responds there ({reason}); give it as tcp://host:port"
        ) from error
    with contextlib.suppress(TimeoutError):
        client.wait_for_workers(1, timeout=WORKER_TIMEOUT)
    if not client.nthreads():
        client.close()
        start = f"dask worker {address} --nthreads 1"
        raise WorkersLost(f"{address}: there are no workers; start some with: {start}")
    return client
