"""Jobs on a Dask cluster.

A Dask scheduler and its workers run whatever anybody sends them who can reach their ports: keep them on the
loopback or on a private network. From this package they get plain numbers and texts, and give such back.
"""

import contextlib
import logging
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any

from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.studies.processes import Item, Result, WorkersLost

CONNECTION_TIMEOUT = 10.0  # [s]
WORKER_TIMEOUT = 60.0  # [s]
# Chunks waiting at the scheduler for each that runs, so that no worker waits for this process.
AHEAD = 2


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
        """See :meth:`twin_gait.studies.processes.Processes.run`."""
        under_way: dict[Any, Item] = {}
        try:
            for item in items:
                under_way[self._client.submit(function, item, pure=False)] = item
                if len(under_way) >= AHEAD * self.slots():
                    yield from _finished(under_way)
            while under_way:
                yield from _finished(under_way)
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


def _finished(under_way: dict[Any, Item]) -> Iterator[Any]:
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
