"""Many small jobs spread over processes (the package's own runner takes over when it is there)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any


def run_jobs(function: Callable[[Any], Any], items: Sequence[Any], *, workers: int = 1) -> list[Any]:
    """Call a function of a module with each item; results come in order."""
    if workers == 1:
        return [function(item) for item in items]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(function, items, chunksize=max(1, len(items) // (20 * workers))))
