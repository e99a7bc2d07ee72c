"""A unit of the controller in a process of its own, tick by tick: a Cortex-M4F in QEMU, or this machine.

One pipe transmits the inputs, another one the outputs; QEMU has no network, and its image opens only these
two.
"""

import contextlib
import os
import select
from collections.abc import Sequence
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Self

import numpy as np

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.cross import find_tool

# A virtual clock that advances 1024 ns per instruction, QEMU's maximum: 25.6 counts of the board's timer.
_MACHINE = (
    "-M", "mps2-an386", "-nic", "none", "-display", "none", "-monitor", "none", "-serial", "none",
    "-semihosting-config", "enable=on,target=native", "-icount", "shift=10",
)  # fmt: skip
_CALIBRATION = np.array([1, 1_002, 100_002])  # lengths of the calibration steps of clock.S, in instructions
_GREETING = 3 + len(_CALIBRATION)  # words: sizes of inputs, outputs and record, then the calibration
_COST = 2  # number of words after the outputs: counts of the clock, bytes of stack
_PIPE = 4096  # bytes that fit into any pipe
# Meaning of the exit status of cortex_m4.c.
_STATUS = {
    70: "the processor stopped at a fault, such as an invalid address",
    71: "the stack of 4 kB overflowed",
}


class UnitProcess:
    """A unit that waits for inputs, as a context manager: its process starts and ends with the block.

    Attributes:
        process: The process of the unit, or None.
    """

    def __init__(self, name: str, command: Sequence[object], timeout: float) -> None:
        """Store the name for messages, the command, and the longest time in [s] until an answer."""
        self._name, self._command, self._timeout = name, list(map(str, command)), timeout
        self.process: Popen[bytes] | None = None
        self._input_bytes = self._answer_words = 0
        self._calibration = np.zeros(len(_CALIBRATION))  # clock counts for steps of known length
        self._costs = [np.empty((0, _COST), np.uint32)]

    def __enter__(self) -> Self:
        """Start the process; the unit is in the state after its ``init``."""
        # The unit has a session of its own, so that Ctrl-C reaches only this process, which then ends it.
        # If this process ends, the input of the unit ends.
        process = Popen(self._command, stdin=PIPE, stdout=PIPE, stderr=PIPE, start_new_session=True)
        self.process = process
        with contextlib.ExitStack() as unless_it_greets:
            unless_it_greets.callback(self._end)
            words = np.frombuffer(self._read(process, 4 * _GREETING), np.uint32)
            unless_it_greets.pop_all()
        self._input_bytes, self._answer_words = int(words[0]), int(words[1]) // 4 + _COST
        self._calibration = words[3:].astype(float)
        return self

    def __exit__(self, *reason: object) -> None:
        """End the process."""
        self._end()

    def exchange(self, inputs: np.ndarray) -> np.ndarray:
        """Run a tick for each row of inputs, records of any type; return rows of outputs as 4-byte words.

        Raises FirmwareError: inputs of another size, a process that has ended or does not answer.
        """
        rows = np.ascontiguousarray(inputs)
        if rows.nbytes != len(rows) * self._input_bytes:
            size = rows.nbytes // max(len(rows), 1)
            expected = f"expected inputs of {self._input_bytes} bytes per tick, got {size}"
            raise FirmwareError(f"{self._name}: {expected}")
        process, answers = self.process, list[bytes]()
        if process is None or process.stdin is None:
            raise FirmwareError(f"{self._name}: a unit can only be used in a with statement")
        # Send at most as much as fits into the pipes: otherwise each side might wait for the other to read.
        ticks = max(1, _PIPE // max(self._input_bytes, 4 * self._answer_words))
        for part in (rows[first : first + ticks] for first in range(0, len(rows), ticks)):
            with contextlib.suppress(BrokenPipeError):  # reading reports the reason
                process.stdin.write(part.tobytes())
                process.stdin.flush()
            answers.append(self._read(process, 4 * len(part) * self._answer_words))
        words = np.frombuffer(b"".join(answers), np.uint32).reshape(len(rows), self._answer_words)
        self._costs.append(words[:, -_COST:])
        return words[:, :-_COST].copy()

    def _read(self, process: Popen[bytes], size: int) -> bytes:
        assert process.stdout is not None  # __enter__ opens it
        content = b""
        while len(content) < size:
            if not select.select([process.stdout], [], [], self._timeout)[0]:
                self._end()
                raise FirmwareError(f"{self._name} has not responded within {self._timeout:g} s")
            part = os.read(process.stdout.fileno(), size - len(content))
            if not part:
                raise FirmwareError(f"{self._name} has ended: {self._failure_text(process)}")
            content += part
        return content

    def _failure_text(self, process: Popen[bytes]) -> str:
        assert process.stderr is not None  # __enter__ opens it
        errors = process.stderr.read().decode(errors="replace").splitlines()
        status = process.wait()
        self._end()
        if status in _STATUS:
            return _STATUS[status]
        first_errors = [line for line in errors if "error" in line.lower()]
        return [*first_errors, *errors[-1:], f"exit status {status}"][0]

    def _end(self) -> None:
        process, self.process = self.process, None
        if process is not None:
            with contextlib.suppress(BrokenPipeError), process:
                process.kill()


class HostUnit(UnitProcess):
    """A unit on this machine, built by :func:`~twin_gait.firmware.cross.build_host`."""

    def __init__(self, program: Path, *, timeout: float = 10.0) -> None:
        """Store the program; nothing starts before the ``with`` statement."""
        super().__init__(program.name, [program.resolve()], timeout)


class Emulator(UnitProcess):
    """A unit on an emulated Cortex-M4F, built by :func:`~twin_gait.firmware.cross.build_image`.

    QEMU emulates the effects of instructions but not their duration: it counts instructions, not cycles.
    """

    def __init__(self, image: Path, *, timeout: float = 10.0) -> None:
        """Store the image; nothing starts before the ``with`` statement. FirmwareError without QEMU."""
        command = [find_tool("qemu-system-arm"), *_MACHINE, "-kernel", image.resolve()]
        super().__init__("qemu-system-arm", command, timeout)

    @property
    def instructions(self) -> np.ndarray:
        """Instructions of each call of ``step`` since the start, its return included; shape ``(ticks,)``.

        Raises FirmwareError: the clock does not follow the instructions, as a step of known length shows.
        """
        shortest, _, longest = self._calibration
        rate = (longest - shortest) / (_CALIBRATION[2] - _CALIBRATION[0])  # counts per instruction
        counts = np.concatenate([self._calibration, np.concatenate(self._costs)[:, 0]])
        found = np.rint((counts - shortest) / rate) + _CALIBRATION[0]
        # Adjacent numbers could not be distinguished with less than a few counts per instruction.
        if rate < 4.0 or (found[: len(_CALIBRATION)] != _CALIBRATION).any():
            problem = f"the clock of this version of {self._name} does not count instructions"
            raise FirmwareError(f"{problem}; install another version")
        return np.asarray(found[len(_CALIBRATION) :], np.int64)

    @property
    def stack_bytes(self) -> int:
        """The deepest stack since the start, including the frame of the main loop of a few words."""
        return int(np.concatenate(self._costs)[:, 1].max(initial=0))
