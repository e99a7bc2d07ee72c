"""Drives that tests emulate: written from the documents, with bit operations of their own."""

from __future__ import annotations

from dataclasses import dataclass, field

ENTER, EXIT = b"\xff" * 7 + b"\xfc", b"\xff" * 7 + b"\xfd"
# Highest speed [rad/s] and torque [N·m] of the models in TMotorCANControl (mit_can.py, MIT_Params), which
# gives the AK60-6 50 rad/s where the manual gives 45.
PUBLISHED = {
    "AK80-9": (50.0, 18.0), "AK10-9": (50.0, 65.0), "AK60-6": (45.0, 15.0),
    "AK70-10": (50.0, 25.0), "AK80-6": (76.0, 12.0), "AK80-64": (8.0, 144.0),
}  # fmt: skip


@dataclass
class AkDrive:
    """AK drive in MIT mode: bytes as the tables on page 49 of the manual name them.

    Attributes:
        commands: Position, speed, Kp, Kd and torque of every frame that it received in motor control.
    """

    node: int
    model: str
    angle: float = 0.2  # [rad]
    velocity: float = 0.0  # [rad/s]
    torque: float = 0.0  # [N·m]
    error: int = 0
    silent: bool = False
    on: bool = False
    entered: int = 0
    commands: list[tuple[float, ...]] = field(default_factory=list)

    def receive(self, identifier: int, data: bytes) -> list[tuple[int, bytes]]:
        """Process a frame; return the frames of the answer."""
        if identifier != self.node or self.silent:
            return []
        speed, torque = PUBLISHED[self.model]
        if data == ENTER:
            self.on, self.entered = True, self.entered + 1
        elif data == EXIT:
            self.on = False
        elif self.on:
            high_speed, low_nibbles = data[2], data[3]
            position = data[0] * 256 + data[1]
            v = high_speed * 16 + low_nibbles // 16
            kp = (low_nibbles % 16) * 256 + data[4]
            kd = data[5] * 16 + data[6] // 16
            t = (data[6] % 16) * 256 + data[7]
            self.commands.append(
                (
                    position * 25.0 / 65535 - 12.5,
                    v * 2 * speed / 4095 - speed,
                    kp * 500.0 / 4095,
                    kd * 5.0 / 4095,
                    t * 2 * torque / 4095 - torque,
                )
            )
        position = round((self.angle + 12.5) * 65535 / 25.0)
        v = round((self.velocity + speed) * 4095 / (2 * speed))
        t = round((self.torque + torque) * 4095 / (2 * torque))
        reply = bytes(
            [
                self.node,
                position // 256,
                position % 256,
                v // 16,
                (v % 16) * 16 + t // 256,
                t % 256,
                30,
                self.error,
            ]
        )
        return [(0, reply)]
