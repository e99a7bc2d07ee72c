"""The job runner: many calls of one function, on processes of this machine or on a Dask cluster.

Sweeps, tuning, batches, fault campaigns and the studies of the gallery all use it.
"""

import hashlib
import math
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, nullcontext
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypedDict, Unpack

import twin_gait
from twin_gait.exceptions import JobError as JobError  # for callers, which catch it
from twin_gait.exceptions import TwinGaitError
from twin_gait.studies.workers import Item, Result, Workers, WorkersLost

# Modules whose changes do not affect results; all others are part of the version of a worker. An installed
# copy has a script in urdf that makes the meshes; a checkout keeps this script outside of the package.
DISPLAY_MODULES = frozenset({"_version.py", "cli", "live", "viewer", "checking", "testing", "export", "urdf"})

# Lock of a worker process. A worker of a cluster may have several threads, and silencing the URDF parser
# redirects the standard error of the process, so that two threads would interfere. The lock is reentrant,
# because a job may run jobs of its own in its process.
_PROCESS_LOCK = threading.RLock()

Progress = Callable[[int, int], None]
Stop = Callable[[], bool]
BlockFunction = Callable[[Sequence[Item]], Iterable[tuple[int, Result]]]


class WorkCallbacks(TypedDict, total=False):
    """Callbacks that follow the work on many items.

    Attributes:
        progress: Called with the number of finished items and the total.
        should_stop: Called before each item; if it returns True, running items are finished and the work
            ends.
        on_compile: Called if an engine has to be compiled first; only for episodes.
    """

    progress: Progress | None
    should_stop: Stop | None
    on_compile: Callable[[], None] | None


def run_jobs(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int | Workers = 1,
    **watch: Unpack[WorkCallbacks],
) -> list[Result]:
    """Call a function with each of many items, on several processes or a cluster.

    The results do not depend on the workers. With several workers, the function must belong to a module that
    they can import (``functools.partial`` of such a function is accepted), items and results must be
    picklable, and a script must guard its own code by ``if __name__ == "__main__":``, because every worker
    imports it. Items of a lost cluster worker are repeated by others. Ctrl-C ends the workers and raises
    ``KeyboardInterrupt``; to keep finished results, use ``should_stop``.

    Args:
        function: The function.
        items: Its arguments.
        workers: Number of processes, or :class:`Workers` that last for several calls, such as those of a
            cluster.
        **watch: ``progress`` and ``should_stop``, see :class:`WorkCallbacks`.

    Returns:
        Results in the order of the items; of the first items only if the work was stopped.

    Raises:
        JobError: If a call raised an error of this package; it names the item.
        ParameterError: If the workers are below 1.
        WorkersLost: If a process dies, or the cluster is lost.
    """
    return run_blocks(partial(_one_by_one, function), items, block=1, workers=workers, **watch)


def run_blocks(
    function: BlockFunction[Item, Result],
    items: Sequence[Item],
    *,
    block: int,
    workers: int | Workers = 1,
    on_results: Callable[[dict[int, Result]], None] | None = None,
    progress: Progress | None = None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> list[Result]:
    """Call a function with blocks of up to ``block`` items, otherwise like :func:`run_jobs`.

    The function yields the position in the block and the result of each item, in any order, and raises
    :class:`JobError` with the position of an item that failed. ``on_results`` receives the results of a
    block as soon as they are complete, by index of the item, including those before a failure; with
    ``on_results``, no results are returned.
    """
    del on_compile  # used by the function only; declared here so that a misspelt keyword is an error
    total, done = len(items), 0
    results: dict[int, Result] = {}
    with nullcontext(workers) if isinstance(workers, Workers) else Workers(workers) as pool:
        blocks = max(pool.slots(), math.ceil(total / block))
        chunks = _chunks(items, max(1, math.ceil(total / blocks)), should_stop)
        process_chunk = partial(_process_chunk, function, sources_hash())
        with closing(pool.as_completed(process_chunk, chunks)) as completed:
            for found, problem in completed:
                (on_results or results.update)(found)
                if problem:
                    raise JobError(*problem)
                done += len(found)
                if progress is not None:
                    progress(done, total)
    return [results[index] for index in range(len(results))]


def _one_by_one(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[tuple[int, Result]]:
    """Call a function of one item for each item of a block, as :func:`run_blocks` requires."""
    for index, item in enumerate(items):
        try:
            yield index, function(item)
        except TwinGaitError as error:
            raise JobError(index, str(error)) from error


def _chunks(items: Sequence[Any], size: int, should_stop: Stop | None) -> Iterator[dict[int, Any]]:
    """Yield chunks of items by their index, on demand: a sequence may create its items one by one."""
    for first in range(0, len(items), size):
        if should_stop is not None and should_stop():
            return
        yield {index: items[index] for index in range(first, min(first + size, len(items)))}


def _process_chunk(
    function: BlockFunction[Any, Result], sources: str, chunk: dict[int, Any]
) -> tuple[dict[int, Result], tuple[int, str] | None]:
    """Process the items of a chunk, up to the first that fails, in any process.

    Returns the results by index of the item, and index and message of the item that failed, or None.
    """
    if sources != sources_hash():
        raise WorkersLost("a worker has another version of twin_gait; install the same everywhere")
    results: dict[int, Result] = {}
    indices, problem = list(chunk), None
    with _PROCESS_LOCK:
        try:
            for position, result in function(list(chunk.values())):
                results[indices[position]] = result
        except JobError as error:  # a text, because not every exception can be pickled
            problem = (indices[error.index], error.problem)
    return results, problem


@lru_cache(maxsize=1)
def sources_hash() -> str:
    """Compute the SHA-256 of the sources that affect results, as they were at the first call.

    All results of one table must come from one version of the laws, and a version number does not change
    while a developer edits them. Modules that only display results are excluded.
    """
    root = Path(twin_gait.__file__).parent
    digest = hashlib.sha256()
    data = ("configuration/patients", "network", "simulation", "studies")
    sources = [*root.glob("**/*.py"), *(path for name in data for path in root.glob(f"{name}/**/*.yaml"))]
    for path in sorted(sources):
        relative = path.relative_to(root)
        if relative.parts[0] not in DISPLAY_MODULES:
            digest.update(f"{relative.as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()
