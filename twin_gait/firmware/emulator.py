"""A unit of the controller in a process of its own, fed tick by tick: a Cortex-M4F in QEMU, or this machine.

Inputs go down a pipe, outputs come back on another; QEMU has no network, and its image opens those two only.
"""

import contextlib
import os
import select
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.cross import find_tool

# A virtual clock that advances 1024 ns an instruction, QEMU's most: 25.6 counts of the board's timer.
_MACHINE = (
    "-M", "mps2-an386", "-nic", "none", "-display", "none", "-monitor", "none", "-serial", "none",
    "-semihosting-config", "enable=on,target=native", "-icount", "shift=10",
)  # fmt: skip
_CALIBRATION = np.array([1, 1_002, 100_002])  # instructions, clock.S
_GREETING = 3 + len(_CALIBRATION)  # words: sizes of inputs, outputs and record, then the calibration
_COST = 2  # words behind the outputs: counts of the clock, bytes of stack
_PIPE = 4096  # bytes that any pipe holds
# Exit status of cortex_m4.c.
_STATUS = {
    70: "the processor stopped at a fault, such as an address without memory",
    71: "4 kB of stack are full",
}


class UnitProcess:
    """A unit that waits for inputs, as a context manager: its process starts and ends with the block.

    Attributes:
        input_bytes: Size of the record of inputs.
        output_bytes: Size of the record of outputs.
        state_bytes: Size of the unit's own record, the RAM that its caller keeps for it.
    """

    def __init__(self, name: str, command: Sequence[object], timeout: float) -> None:
        """Keep name for messages, program and arguments, and the longest time in [s] without an answer."""
        self._name, self._command, self._timeout = name, [str(word) for word in command], timeout
        self._process: subprocess.Popen[bytes] | None = None
        self._costs: list[np.ndarray] = []
        self.input_bytes = self.output_bytes = self.state_bytes = 0

    def __enter__(self) -> Self:
        """Start the process; the unit is as its ``init`` leaves it."""
        # Ctrl-C is for us, who then end the process: a session of its own. Without us its input ends.
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            words = np.frombuffer(self._read(self._process, 4 * _GREETING), np.uint32)
            self.input_bytes, self.output_bytes, self.state_bytes = map(int, words[:3])
            self._calibrate(words[3:])
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process."""
        self._end()

    @property
    def pid(self) -> int | None:
        """Number of the process, or None where none runs."""
        return None if self._process is None else self._process.pid

    def exchange(self, inputs: np.ndarray) -> np.ndarray:
        """Run one tick: inputs as numbers of any type, ``input_bytes`` long; outputs as 4-byte words.

        Raises FirmwareError: inputs of another size, a process that has ended or does not answer.
        """
        return np.asarray(self.exchange_many(inputs[np.newaxis])[0])

    def exchange_many(self, inputs: np.ndarray) -> np.ndarray:
        """Run a tick for each row of inputs, none of which depends on an answer."""
        rows = np.ascontiguousarray(inputs)
        if rows.nbytes != len(rows) * self.input_bytes:
            size = rows.nbytes // max(len(rows), 1)
            raise FirmwareError(f"{self._name} takes inputs of {self.input_bytes} bytes a tick, got {size}")
        answer = self.output_bytes + 4 * _COST
        # As much as the pipes hold: else each side might wait for the other to read.
        ticks = max(1, _PIPE // max(self.input_bytes, answer))
        parts = [self._send(rows[first : first + ticks], answer) for first in range(0, len(rows), ticks)]
        words = np.frombuffer(b"".join(parts), np.uint32).reshape(len(rows), answer // 4)
        self._costs.append(words[:, -_COST:])
        return words[:, :-_COST].copy()

    def _send(self, rows: np.ndarray, answer: int) -> bytes:
        if self._process is None or self._process.stdin is None:
            raise FirmwareError(f"{self._name} does not run: use it in a with statement")
        with contextlib.suppress(BrokenPipeError):  # reading says why
            self._process.stdin.write(rows.tobytes())
            self._process.stdin.flush()
        return self._read(self._process, len(rows) * answer)

    def _read(self, process: subprocess.Popen[bytes], size: int) -> bytes:
        assert process.stdout is not None  # __enter__ asked for it
        poll = select.poll()
        poll.register(process.stdout, select.POLLIN)
        content = b""
        while len(content) < size:
            if not poll.poll(self._timeout * 1000.0):
                self._end()
                raise FirmwareError(f"{self._name} has not answered within {self._timeout:g} s")
            part = os.read(process.stdout.fileno(), size - len(content))
            if not part:
                raise FirmwareError(f"{self._name} has ended: {self._last_words(process)}")
            content += part
        return content

    def _last_words(self, process: subprocess.Popen[bytes]) -> str:
        assert process.stderr is not None  # __enter__ asked for it
        said = process.stderr.read().decode(errors="replace").splitlines()
        status = process.wait()
        self._end()
        if status in _STATUS:
            return _STATUS[status]
        return [*(line for line in said if "error" in line.lower()), *said[-1:], f"exit status {status}"][0]

    def _calibrate(self, counts: np.ndarray) -> None:
        """Take the clock's counts of steps of known length."""

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            with contextlib.suppress(BrokenPipeError), process:
                process.kill()


class HostUnit(UnitProcess):
    """A unit on this machine, built by :func:`~twin_gait.firmware.build_host`."""

    def __init__(self, program: Path, *, timeout: float = 10.0) -> None:
        """Keep the program; nothing starts before the ``with`` statement."""
        super().__init__(program.name, [program.resolve()], timeout)


class Emulator(UnitProcess):
    """A unit on an emulated Cortex-M4F, built by :func:`~twin_gait.firmware.build_image`.

    QEMU knows what instructions do and not how long they take: it tells instructions, never cycles.
    """

    def __init__(self, image: Path, *, timeout: float = 10.0) -> None:
        """Keep the image; nothing starts before the ``with`` statement. FirmwareError without QEMU."""
        command = [find_tool("qemu-system-arm"), *_MACHINE, "-kernel", image.resolve()]
        super().__init__("qemu-system-arm", command, timeout)
        self._shortest = self._rate = 0.0  # counts of the shortest step, and an instruction

    @property
    def instructions(self) -> np.ndarray:
        """Instructions of each call of ``step`` since the start, its return included; shape ``(ticks,)``."""
        counts = np.concatenate([np.empty((0, _COST)), *self._costs])[:, 0]
        return self._instructions(counts)

    @property
    def stack_bytes(self) -> int:
        """The deepest stack since the start, the main loop's frame of a few words included."""
        return max((int(costs[-1, 1]) for costs in self._costs), default=0)

    def _instructions(self, counts: np.ndarray) -> np.ndarray:
        longer = np.rint((counts - self._shortest) / self._rate)
        return np.asarray(longer + _CALIBRATION[0], np.int64)

    def _calibrate(self, counts: np.ndarray) -> None:
        shortest, _, longest = counts.astype(float)
        self._shortest = shortest
        self._rate = (longest - shortest) / (_CALIBRATION[2] - _CALIBRATION[0])
        # The middle one is the check; less than a few counts an instruction could not tell one from the next.
        if self._rate < 4.0 or (self._instructions(counts) != _CALIBRATION).any():
            raise FirmwareError(f"this version of {self._name} has a clock that does not follow instructions")
