"""A unit of the firmware in Python: the functions from which it is printed, bound as in the simulation."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured

from twin_gait.core.elementary import sine_cosine
from twin_gait.simulation.binding import kernel_functions, specialize
from twin_gait.simulation.record import deep_copy, dtype_of

_TYPES = {"f": float, "i": int, "b": bool}  # Python's types by the kinds of NumPy's.


@dataclass(frozen=True, eq=False)
class UnitSample:
    """A unit at tick 0, with its step and samples of the records that it exchanges."""

    name: str  # Name of the unit and of its files, such as ``joint_board``.
    init: str  # Prefix of its ``init`` function, such as ``joint_board_left_hip``.
    step: Callable[..., None]  # Function of a tick, as it is printed.
    record: Any  # State at tick 0.
    inputs: Any  # Inputs of a tick; only their shape has a meaning.
    outputs: Any  # Outputs of a tick; only their shape has a meaning.


class PythonUnit:
    """A unit in Python, with the interface of one that runs in another process."""

    def __init__(self, sample: UnitSample, build_flags: Mapping[str, Any], kernel: str) -> None:
        """Bind the step of a unit to the constants and to the source of the kernel of its firmware."""
        functions = kernel_functions(kernel, {"sine_cosine": sine_cosine})
        self._sample, self._dtype = sample, dtype_of(sample.outputs)
        self._step: Callable[..., None] = specialize(sample.step, {**build_flags, **functions})

    def __enter__(self) -> Self:
        """Set the unit to tick 0."""
        sample = self._sample
        self._record, self._inputs, self._outputs = map(
            deep_copy, (sample.record, sample.inputs, sample.outputs)
        )
        return self

    def __exit__(self, *reason: object) -> None:
        """Do nothing."""

    def exchange(self, inputs: np.ndarray) -> np.ndarray:
        """Run a tick for each row of inputs, records of double numbers; return a row of outputs for each."""
        given, taken = list(_places(self._inputs, inputs.dtype)), list(_places(self._outputs, self._dtype))
        numbers, answers = structured_to_unstructured(inputs, float).tolist(), list[list[float]]()
        for row in numbers:
            for (record, name, kind), value in zip(given, row, strict=True):
                if isinstance(record, list):
                    record[name] = kind(value)
                else:
                    setattr(record, name, kind(value))
            self._step(self._record, self._inputs, self._outputs)
            answers.append(
                [item[name] if isinstance(item, list) else getattr(item, name) for item, name, _ in taken]
            )
        flat = np.array(answers, float).reshape(len(inputs), len(taken))
        return unstructured_to_structured(flat, self._dtype, casting="unsafe")


def _places(record: Any, dtype: np.dtype[Any]) -> Iterator[tuple[Any, Any, type]]:
    """Yield the numbers of a record in the order of a layout: record or list, name or index, and type."""
    for field in dtype.names or ():
        kind, value = dtype[field].base, getattr(record, field)
        keys: Any = range(len(value)) if isinstance(value, list) else [field]
        for key in keys:
            owner, entry = (value, value[key]) if isinstance(value, list) else (record, value)
            if kind.names is None:
                yield owner, key, _TYPES[kind.kind]
            else:
                yield from _places(entry, kind)
