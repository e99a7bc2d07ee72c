"""A unit of the firmware in Python: the functions from which it is printed, bound as in the simulation."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from twin_gait.core.elementary import sine_cosine
from twin_gait.simulation.binding import bind, kernel_functions
from twin_gait.simulation.record import copied, dtype_of, entries


@dataclass(frozen=True, eq=False)
class UnitSample:
    """A unit at tick 0, with its step and samples of the records that it exchanges."""

    name: str  # Name of the unit and of its files, such as ``joint_board``.
    init: str  # Prefix of its ``init`` function, such as ``joint_board_left_hip``.
    step: Callable[..., None]  # Function of a tick, as it is printed.
    record: Any  # State at tick 0.
    inputs: Any  # Inputs of a tick; only their shape has a meaning.
    outputs: Any  # Outputs of a tick, likewise.


class PythonUnit:
    """A unit in Python, with the interface of one that runs in another process."""

    def __init__(self, sample: UnitSample, structure: Mapping[str, Any], kernel: str) -> None:
        """Bind the step of a unit to the constants and to the source of the kernel of its firmware."""
        functions = kernel_functions(kernel, {"sine_cosine": sine_cosine})
        self._sample, self._dtype = sample, dtype_of(sample.outputs)
        self._step: Callable[..., None] = bind(sample.step, {**structure, **functions})

    def __enter__(self) -> Self:
        """Set the unit to tick 0."""
        sample = self._sample
        self._record, self._inputs, self._outputs = map(
            copied, (sample.record, sample.inputs, sample.outputs)
        )
        return self

    def __exit__(self, *reason: object) -> None:
        """Leave nothing behind."""

    def exchange(self, inputs: np.ndarray) -> np.ndarray:
        """Run a tick for each row of inputs, records of double numbers; return a row of outputs for each."""
        outputs = np.empty(len(inputs), self._dtype)
        for tick, row in enumerate(inputs):
            _fill(self._inputs, row)
            self._step(self._record, self._inputs, self._outputs)
            outputs[tick] = entries(self._outputs)  # A copy, because the lists are the same in every tick.
        return outputs


def _fill(record: Any, values: Any) -> None:
    """Copy the values of a NumPy record into a record."""
    for name in values.dtype.names:
        value, entry = values[name], getattr(record, name)
        if not isinstance(entry, list):
            if value.dtype.names is None:
                setattr(record, name, value.item())
            else:
                _fill(entry, value)
        elif value.dtype.names is None:
            entry[:] = value.tolist()
        else:
            for item, part in zip(entry, value, strict=True):
                _fill(item, part)
