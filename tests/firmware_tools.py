"""Compilers and the emulator of the firmware's tests, and a unit small enough to know all about it."""

import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pytest

from twin_gait.core.elementary import sine_cosine
from twin_gait.exceptions import FirmwareError
from twin_gait.firmware import Unit, find_tool
from twin_gait.firmware.linked import LinkedUnit
from twin_gait.firmware.units import exoskeleton_step
from twin_gait.simulation.binding import bind, kernel_functions
from twin_gait.simulation.record import copied, dtype_of, entries

FIRMWARE_VARIABLE = "TWIN_GAIT_REQUIRE_FIRMWARE"
TARGET_TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
# A conversion out of range is undefined as well, and not among those of "undefined".
SANITIZE = ("-g", "-fsanitize=undefined,float-cast-overflow,address", "-fno-sanitize-recover=all")


def require_tools(*names: str) -> None:
    """Skip a test that lacks a program, or fail it where the programs are expected."""
    for name in names:
        try:
            find_tool(name)
        except FirmwareError as error:
            if os.environ.get(FIRMWARE_VARIABLE):
                pytest.fail(f"{FIRMWARE_VARIABLE} is set, but {error}")
            pytest.skip(str(error))


def symbols(objects: Sequence[Path]) -> Mapping[str, str]:
    """Names in object files or an image, and ``nm``'s letter for each: ``U`` is wanted from elsewhere."""
    command = [find_tool("arm-none-eabi-nm"), "--format=posix", *objects]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    fields = (line.split() for line in lines)
    return {words[0]: words[1] for words in fields if len(words) > 1}


def write_unit(
    folder: Path, *, inputs: str, outputs: str, state: str, step: str, name: str = "probe"
) -> Unit:
    """A unit in a folder that does not exist: fields of its records, and the body of its step."""
    folder.mkdir()
    records = zip(("Inputs", "Outputs", ""), (inputs, outputs, state), strict=True)
    title = name.capitalize()
    (folder / f"{name}.h").write_text(
        "#include <stdint.h>\n"
        + "".join(f"typedef struct {{ {fields} }} {title}{kind};\n" for kind, fields in records)
        + f"void {name}_init({title} *unit);\n"
        + f"void {name}_step({title} *unit, const {title}Inputs *in, {title}Outputs *out);\n"
    )
    source = folder / f"{name}.c"
    source.write_text(
        f'#include "{name}.h"\n'
        f"void {name}_init({title} *unit) {{ *unit = ({title}){{0}}; }}\n"
        f"void {name}_step({title} *unit, const {title}Inputs *in, {title}Outputs *out) {{ {step} }}\n"
    )
    return Unit(name, folder)


class PythonUnit:
    """The unit in Python, with the interface of one that runs elsewhere."""

    def __init__(self, linked: LinkedUnit) -> None:
        """Bind its step."""
        self._linked, names = (
            linked,
            {**linked.structure, **kernel_functions(linked.kernel, {"sine_cosine": sine_cosine})},
        )
        self._step: Callable[..., None] = bind(exoskeleton_step, names)
        self._dtype = dtype_of(linked.outputs)

    def __enter__(self) -> Self:
        """Set the unit to tick 0."""
        self._record, self._inputs = copied(self._linked.record), copied(self._linked.inputs)
        self._outputs = copied(self._linked.outputs)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left behind."""

    def exchange(self, inputs: np.ndarray) -> np.ndarray:
        """Run a tick for each row of inputs, records of double numbers; a row of outputs for each."""
        outputs = np.empty(len(inputs), self._dtype)
        for tick, row in enumerate(inputs):
            _fill(self._inputs, row)
            self._step(self._record, self._inputs, self._outputs)
            outputs[tick] = entries(self._outputs)  # copied: the lists in it are those of every tick
        return outputs


def _fill(record: Any, values: Any) -> None:
    """Give a record the values of NumPy's."""
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
