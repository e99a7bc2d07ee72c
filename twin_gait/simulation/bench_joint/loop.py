"""The loop of the joint bench as one module, compiled or as plain Python."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType

import numpy as np
import pandas as pd

from twin_gait.control import ControllerFunction
from twin_gait.core.control_tick import controller_torques
from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK
from twin_gait.scenario.bench_joint import BenchJoint, TorqueControl
from twin_gait.simulation.bench_joint import arrays, tick
from twin_gait.simulation.bench_joint.arrays import COLUMNS, DIVERGED, BenchArrays
from twin_gait.simulation.bench_joint.layout import BenchVariation, bench_arrays
from twin_gait.simulation.keeping import source_key, source_of
from twin_gait.simulation.loops import bound, kept_loop, loop_with
from twin_gait.simulation.module_text import one_module
from twin_gait.simulation.run import RunStatus

RunTicks = Callable[[BenchArrays, int, int, np.ndarray], int]
ROOMS = ("tick", "sensing", "command", "winding", "mechanics")  # modules that the loop is written in
_PACKAGE = __name__.rpartition(".")[0]


def plain_loop(law: ControllerFunction) -> RunTicks:
    """The loop as plain Python.

    Returns:
        Its ``run_ticks``.
    """
    if law is controller_torques:
        return tick.run_ticks
    module = ModuleType("twin_gait_bench_as_python")
    exec(compile(_text(), module.__name__, "exec"), module.__dict__)
    module.__dict__["controller_torques"] = law
    run_ticks: RunTicks = module.__dict__["run_ticks"]
    return run_ticks


def compiled_loop(law: ControllerFunction, on_compile: Callable[[], None] | None) -> RunTicks:
    """The loop, compiled and kept; with a law of the user's compiled for this process only.

    Returns:
        Its ``run_ticks``.
    """
    text = loop_text()
    if law is controller_torques:
        loop = kept_loop(source_key(text), lambda: text, on_compile)
    else:
        loop = loop_with(text, law, on_compile)

    def run_ticks(bench: BenchArrays, first: int, end: int, rows: np.ndarray) -> int:
        fields = bench._asdict()
        assert all(array.flags.c_contiguous and array.dtype == float for array in fields.values())
        sizes = np.array([len(array) for array in bench], dtype=np.int64)
        return bound(loop, bench.numbers, sizes, fields)(first, end, rows)

    return run_ticks


@lru_cache(maxsize=1)
def loop_text() -> str:
    """The loop as it is compiled, with addresses for arrays; its hash is part of the cache's key."""
    text = (
        _text().replace("import numpy as np\n", _PREAMBLE, 1).replace("def run_ticks(", "def run_bench(", 1)
    )
    # numba compiles at the first call, when all functions of the module exist, whatever their order.
    text = re.sub(r"^def ", "@_jit\ndef ", text, flags=re.MULTILINE)
    # What is imported from there is compiled too, and the text does not show whether it has changed.
    return (
        f"{text}\n\n{_entry()}# arrays: {hashlib.sha256(source_of(arrays.__name__).encode()).hexdigest()}\n"
    )


def _entry() -> str:
    """The function that is called from outside: it makes arrays of addresses and lengths."""
    loose = [name for name in BenchArrays._fields if name != "numbers"]
    addresses = ", ".join(f"{name}_address" for name in ("numbers", "sizes", *loose))
    values = [
        f"array_at(float_pointer({name}_address), (sizes[{place}],{_ROWS.get(name, '')}))"
        for place, name in enumerate(BenchArrays._fields)
    ]
    return f"""LOOSE_ARRAYS = {loose!r}


@_jit
def run_ticks({addresses}, first, end, rows_address):
    sizes = integer_pointer(sizes_address)
    bench = BenchArrays({", ".join(values)})
    return run_bench(bench, first, end, array_at(float_pointer(rows_address), (end, {len(arrays.COLUMNS)})))
"""


def _text() -> str:
    names = [f"{_PACKAGE}.{room}" for room in ROOMS]
    return one_module({name: source_of(name) for name in names})


# Numbers in a row of the arrays that have rows.
_ROWS = {"measured": " 3", "ring": " 1"}
_PREAMBLE = """import numba
import numpy as np

from twin_gait.simulation.pointers import array_at, float_pointer, integer_pointer

_jit = numba.njit(
    nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False
)
"""


CHUNK_TICKS = 5000  # between two looks at progress and interruption
# Columns of the thesis's log files, in this order; the others are what no bench can see.
LOG_COLUMNS = COLUMNS[:9]


@dataclass(frozen=True, eq=False)
class BenchRun:
    """What a test left behind.

    Attributes:
        test: The test.
        rows: Log, shape ``(n_ticks, n_columns)``.
        status: Completed, diverged or interrupted.
    """

    test: BenchJoint
    rows: np.ndarray
    status: RunStatus

    def column(self, name: str) -> np.ndarray:
        """A column by its name, shape ``(n_ticks,)``.

        Args:
            name: One of :data:`twin_gait.simulation.bench_joint.arrays.COLUMNS`.

        Returns:
            The values.

        Raises:
            ParameterError: If there is no such column.
        """
        if name not in COLUMNS:
            raise ParameterError(f"{name}: no such column; there are {', '.join(COLUMNS)}")
        return np.asarray(self.rows[:, COLUMNS.index(name)])

    def log(self, *, truth: bool = True) -> pd.DataFrame:
        """The log as a table.

        Args:
            truth: Also what no bench can see: friction, true motion, true current.

        Returns:
            One row per tick.
        """
        columns = COLUMNS if truth else LOG_COLUMNS
        return pd.DataFrame(self.rows[:, : len(columns)], columns=list(columns))


def simulate_bench(
    test: BenchJoint,
    *,
    seed: int = 0,
    variation: BenchVariation | None = None,
    compiled: bool = True,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> BenchRun:
    """Simulate a test.

    Args:
        test: The bench and what is done on it.
        seed: Of the noise of current and encoder.
        variation: What chance adds to this test.
        compiled: False runs the same loop as plain Python, some hundred times slower.
        progress: Called with ticks done and in all.
        should_stop: Asked between chunks; True ends the test there.
        on_compile: Called if the loop has to be compiled.

    Returns:
        The run.

    Raises:
        ParameterError: If parts of the test do not go together.
    """
    law = test.control.controller.law if isinstance(test.control, TorqueControl) else controller_torques
    run_ticks = compiled_loop(law, on_compile) if compiled else plain_loop(law)
    ticks = max(1, round(test.duration / TICK))
    bench = bench_arrays(test, ticks, seed, variation or BenchVariation())
    rows = np.zeros((ticks, len(COLUMNS)))
    done, status = 0, RunStatus.COMPLETED
    while done < ticks:
        if should_stop is not None and should_stop():
            status = RunStatus.INTERRUPTED
            break
        end = min(done + CHUNK_TICKS, ticks)
        reached = int(run_ticks(bench, done, end, rows))
        done = reached
        if progress is not None:
            progress(done, ticks)
        if bench.state[DIVERGED]:
            status = RunStatus.DIVERGED
        if reached < end or status is RunStatus.DIVERGED:
            break
    return BenchRun(test, rows[:done], status)
