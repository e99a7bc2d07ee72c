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
from twin_gait.exceptions import JobFailed as JobFailed  # which a caller of this catches
from twin_gait.exceptions import TwinGaitError
from twin_gait.studies.workers import Item, Result, Workers, WorkersLost

# Where an edit changes no result: everything else belongs to the version of a worker. An installed copy has a
# script that makes the meshes, in urdf; a checkout keeps it outside of the package.
SHOWN_ONLY = frozenset({"_version.py", "cli", "live", "viewer", "checking", "testing", "export", "urdf"})

# A cluster's worker may have several threads, and silencing the URDF parser redirects the process's
# standard error, which two of them would do to each other.
# A job may run jobs of its own in its process.
_ONE_AT_A_TIME = threading.RLock()

Progress = Callable[[int, int], None]
Stop = Callable[[], bool]
BlockFunction = Callable[[Sequence[Item]], Iterable[tuple[int, Result]]]


class Watch(TypedDict, total=False):
    """Who looks on while many items are worked on.

    Attributes:
        progress: Called with items done and in all.
        should_stop: Asked before each item; True lets those that run finish and ends the work.
        on_compile: Called if an engine has to be compiled first; of episodes only.
    """

    progress: Progress | None
    should_stop: Stop | None
    on_compile: Callable[[], None] | None


def run_jobs(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int | Workers = 1,
    **watch: Unpack[Watch],
) -> list[Result]:
    """Call a function with each of many items, on several processes or a cluster.

    The results do not depend on the workers. With several, the function must belong to a module that they can
    import (``functools.partial`` of one will do), items and results must be picklable, and a script must
    guard its own code by ``if __name__ == "__main__":``, because every worker imports it. What a lost worker
    of a cluster had under way is done again by others. Ctrl-C ends the workers and raises
    ``KeyboardInterrupt``; to keep what is done use ``should_stop``.

    Args:
        function: The function.
        items: Its arguments.
        workers: Processes, or :class:`Workers` that stay from one call to the next, maybe those of a cluster.
        **watch: ``progress`` and ``should_stop``, see :class:`Watch`.

    Returns:
        Results in the order of the items; of the first items only if it was stopped.

    Raises:
        JobFailed: If a call raised an error of this package, telling which.
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
    keep: Callable[[dict[int, Result]], None] | None = None,
    progress: Progress | None = None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> list[Result]:
    """:func:`run_jobs` with a function of up to ``block`` items at once.

    It gives position among them and result of each, in any order, and raises :class:`JobFailed` with the
    position of an item that failed. ``keep`` takes the results of a block as they come, by index of the item,
    also those before a failure; then none are returned.
    """
    del on_compile  # a matter of the function; named here, so that a slip in the name of another is an error
    total, done = len(items), 0
    results: dict[int, Result] = {}
    with nullcontext(workers) if isinstance(workers, Workers) else Workers(workers) as own:
        blocks = max(own.slots(), math.ceil(total / block))
        chunks = _chunks(items, max(1, math.ceil(total / blocks)), should_stop)
        with closing(own.as_they_come(partial(_do, function, sources_hash()), chunks)) as coming:
            for found, problem in coming:
                (keep or results.update)(found)
                if problem:
                    raise JobFailed(*problem)
                done += len(found)
                if progress is not None:
                    progress(done, total)
    return [results[index] for index in range(len(results))]


def _one_by_one(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[tuple[int, Result]]:
    """A function of one item as :func:`run_blocks` takes it."""
    for place, item in enumerate(items):
        try:
            yield place, function(item)
        except TwinGaitError as error:
            raise JobFailed(place, str(error)) from error


def _chunks(items: Sequence[Any], size: int, should_stop: Stop | None) -> Iterator[dict[int, Any]]:
    """Items by their index, taken when there is room for them: a sequence may make them one by one."""
    for first in range(0, len(items), size):
        if should_stop is not None and should_stop():
            return
        yield {place: items[place] for place in range(first, min(first + size, len(items)))}


def _do(
    function: BlockFunction[Any, Result], sources: str, chunk: dict[int, Any]
) -> tuple[dict[int, Result], tuple[int, str] | None]:
    """Do the items of a chunk, up to the first that fails, in whatever process.

    Gives the results by index of the item, and index and message of the one that failed.
    """
    if sources != sources_hash():
        raise WorkersLost("a worker has another version of twin_gait; install the same everywhere")
    results: dict[int, Result] = {}
    indices, problem = list(chunk), None
    with _ONE_AT_A_TIME:
        try:
            for place, result in function(list(chunk.values())):
                results[indices[place]] = result
        except JobFailed as error:  # a text, because not every exception can be pickled
            problem = (indices[error.index], error.problem)
    return results, problem


@lru_cache(maxsize=1)
def sources_hash() -> str:
    """SHA-256 over the sources that a result depends on, as they were when first asked for.

    Results of one table must come from one version of the laws, and a version number does not change while
    somebody edits them. What only shows results does not count.
    """
    root = Path(twin_gait.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(
        [*root.glob("**/*.py"), *root.glob("configuration/people/*.yaml"), *root.glob("studies/**/*.yaml")]
    ):
        place = path.relative_to(root)
        if place.parts[0] not in SHOWN_ONLY:
            digest.update(f"{place.as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()
