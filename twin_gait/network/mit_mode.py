"""MIT mode of the T-Motor (CubeMars) AK drives: an impedance in each frame, and a reply to it.

The layout is in ``motor_frames.yaml`` with its sources. It has not been tried on a drive.
"""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from twin_gait.exceptions import ParameterError
from twin_gait.network.drives import Drive, DriveReport, DriveSettings, MotorFrame, MotorSetpoint
from twin_gait.parameters.motor_bus import DriveModel
from twin_gait.yaml12 import load_data

MOTOR_FRAMES = load_data(Path(__file__).with_name("motor_frames.yaml"))
_MIT: dict[str, Any] = MOTOR_FRAMES["mit"]
_ENTER, _EXIT = (bytes.fromhex(_MIT[name]) for name in ("enter", "exit"))


class PackedNumber(NamedTuple):
    """A number in a frame as an unsigned integer c: :math:`x = x_0 + c (x_1 - x_0) / (2^n - 1)`."""

    name: str  # Name, for messages.
    bits: int  # Number n of bits.
    low: float  # Lowest number x_0.
    high: float  # Highest number x_1.

    def encode(self, value: float) -> int:
        """Return the nearest code; a number beyond the range has the code of its end."""
        most = (1 << self.bits) - 1
        share = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return math.floor(share * most + 0.5)

    def decode(self, code: int) -> float:
        """Return the number of a code."""
        return self.low + code * (self.high - self.low) / ((1 << self.bits) - 1)


def packed_numbers(kind: str, model: DriveModel) -> list[PackedNumber]:
    """Return the numbers of a ``command`` or a ``reply`` of a model of drive, in their order."""
    ranges = {**_MIT["ranges"], **{name: (-most, most) for name, most in _MIT["models"][model].items()}}
    return [PackedNumber(name, bits, *map(float, ranges[name])) for name, bits in _MIT[kind].items()]


def pack(numbers: Iterable[PackedNumber], values: Iterable[float]) -> bytes:
    """Pack numbers into bytes, the most significant bit first."""
    code, bits = 0, 0
    for number, value in zip(numbers, values, strict=True):
        code, bits = code << number.bits | number.encode(value), bits + number.bits
    return code.to_bytes(bits // 8, "big")


def unpack(numbers: Sequence[PackedNumber], data: bytes) -> list[float]:
    """Unpack numbers from bytes, the most significant bit first."""
    code, values = int.from_bytes(data, "big"), list[float]()
    for number in reversed(numbers):
        values.append(number.decode(code & (1 << number.bits) - 1))
        code >>= number.bits
    return values[::-1]


class MitDrive(Drive):
    r"""Drive in MIT mode, which computes :math:`k_p(\theta_d-\theta)+k_d(\omega_d-\omega)+\tau`.

    It receives k, θ0 and as much of the damping b as :math:`k_d` can represent. The feed-forward torque τ is
    the rest of the command: with the measured θ and ω of the setpoint, the sum is the whole torque within its
    limits. If a number is beyond its range, the frame contains the whole torque and no impedance.
    """

    def __init__(self, settings: DriveSettings, model: DriveModel) -> None:
        """Begin with a drive that is off; ``model`` determines the ranges.

        Raises ParameterError if the torque limit is beyond the range of the model.
        """
        super().__init__(settings)
        self._entered = False  # Whether the last frame that switches motor control has switched it on.
        self._command, self._reply = (packed_numbers(kind, model) for kind in ("command", "reply"))
        most, limit = self._command[-1].high, settings.torque_limit
        if limit > most:
            key = f"control.limits.{settings.board.partition('_')[2]}.torque_Nm"
            problem = f"expected at most {most:g} N·m, the range of {model} in MIT mode, got {limit:g} N·m"
            raise ParameterError(f"{key}: {problem}; lower it, or state another plant.motor_bus")

    def _frames(self, setpoint: MotorSetpoint) -> list[MotorFrame]:
        if not self.ready:
            self._entered = not self.fault
            return [MotorFrame(self.settings.node, _ENTER if self._entered else _EXIT)]
        kd = min(setpoint.damping, _MIT["ranges"]["damping"][1])
        spring = setpoint.stiffness * (setpoint.equilibrium - setpoint.angle)
        rest = setpoint.torque - spring + kd * setpoint.velocity
        values = setpoint.equilibrium, 0.0, setpoint.stiffness, kd, rest
        if not all(item.low <= value <= item.high for item, value in zip(self._command, values, strict=True)):
            values = 0.0, 0.0, 0.0, 0.0, setpoint.torque
        return [MotorFrame(self.settings.node, pack(self._command, values))]

    def _stop_frames(self) -> list[MotorFrame]:
        self._entered = False
        return [MotorFrame(self.settings.node, _EXIT)]

    def receive(self, frame: MotorFrame) -> None:
        """Process a reply: its first byte is the number of the drive, its identifier 0 or that number."""
        node, data = self.settings.node, frame.data
        if frame.identifier not in (0, node) or len(data) != _MIT["reply_bytes"] or data[0] != node:
            return
        self.ready = self._entered
        self._store(DriveReport(*unpack(self._reply, data[1:6])))
        if error := data[7]:
            known = dict(enumerate(_MIT["errors"]))
            self.fail(f"reports the error {known.get(error, error)}")
