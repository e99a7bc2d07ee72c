"""Frames of a live walk for drives of other makers, see :mod:`twin_gait.network.drives`.

The walk is simulated and does not follow the drives: their reports are only checked. A drive that reports a
fault, is silent or leaves its range is noted, and the legs are held as after the stop of the operator.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.experiment.bus import device_boards, signal_ranges
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.live.telemetry import Block
from twin_gait.network import cia402
from twin_gait.network.drives import Drive, DriveSettings, MotorFrame, MotorSetpoint
from twin_gait.network.mit_mode import MitDrive
from twin_gait.parameters.motor_bus import MotorProtocol
from twin_gait.parameters.network import BOARDS, NetworkParameters

START_TIME = 2.0  # [s], time in which a drive has to become ready
# Columns of the log that a setpoint consists of.
_COLUMNS = {
    "stiffness": "stiffness_Nm_per_rad",
    "damping": "damping_Nms_per_rad",
    "equilibrium": "equilibrium_rad",
    "torque": "motor_command_torque_Nm",
    "angle": "measured_angle_rad",
    "velocity": "velocity_fast_rad_per_s",
}

Setpoints = dict[str, MotorSetpoint]  # by the name of the board


def make_drive(experiment: Experiment, board: str) -> Drive:
    """Create the drive of a board with the protocol of its device.

    Its number on the bus is that of the board from 1. Raises ParameterError if the device states no model for
    MIT mode, or a torque limit beyond its range.
    """
    bus, network = experiment.plant.motor_bus, experiment.network or NetworkParameters()
    joint = next(
        item for side, item in device_boards(experiment.leg, experiment.plant) if board == f"{side}_{item}"
    )
    settings = DriveSettings(
        board=board,
        node=1 + BOARDS.index(board),
        angles=signal_ranges(experiment.leg, experiment.plant, experiment.control)[board]["angle"],
        torque_limit=experiment.control.limits[joint].torque,
        gear_ratio=experiment.plant.actuators[joint].gear_ratio,
        start_cycles=round(START_TIME / network.cycle),
        silent_cycles=round(bus.timeout / network.cycle),
        silence_ms=round(1e3 * bus.timeout),
    )
    if bus.protocol is MotorProtocol.CIA402:
        return cia402.Cia402Drive(settings)
    if joint not in bus.models:
        raise ParameterError(
            f"plant.motor_bus.models.{joint}: is missing; MIT mode needs the model of the drive"
        )
    return MitDrive(settings, bus.models[joint])


class MotorLink:
    """The drives of a device in a live walk.

    Attributes:
        drives: Drives by the name of their boards.
        running: Whether a cycle was sent since the last stop.
    """

    def __init__(self, experiment: Experiment, report: Callable[[str], None]) -> None:
        """Begin with drives that are off; ``report``: called once with each fault in words."""
        self._experiment, self.running = experiment, False
        self._start()
        self._limits = {board: drive.settings.torque_limit for board, drive in self.drives.items()}
        cycle = (experiment.network or NetworkParameters()).cycle
        self._period, self._report = max(1, round(cycle / TICK)), report
        is_canopen = experiment.plant.motor_bus.protocol is MotorProtocol.CIA402
        self._shared = cia402.shared_frames() if is_canopen else []

    def _start(self) -> None:
        """Begin a walk with drives that are off and have no fault."""
        boards = [
            f"{side}_{joint}" for side, joint in device_boards(self._experiment.leg, self._experiment.plant)
        ]
        self.drives = {board: make_drive(self._experiment, board) for board in boards}
        self._noted: set[str] = set()

    def schedule(self, block: Block) -> Iterator[tuple[float, Callable[[], list[MotorFrame]]]]:
        """Yield the cycles of a block: their times since the start in [s], and functions of their frames."""
        if block.first == 0:
            self._start()
        for tick in range(-(-block.first // self._period) * self._period, block.end, self._period):
            yield tick * TICK, partial(self.cycle, self._setpoints(block, tick - block.first))

    def _setpoints(self, block: Block, row: int) -> Setpoints:
        found = {}
        for board, limit in self._limits.items():
            numbers = {name: float(block.columns[f"{board}_{end}"][row]) for name, end in _COLUMNS.items()}
            found[board] = MotorSetpoint(
                **{**numbers, "torque": float(np.clip(numbers["torque"], -limit, limit))}
            )
        return found

    def cycle(self, setpoints: Setpoints) -> list[MotorFrame]:
        """Return the frames of a cycle."""
        self.running = True
        frames = [frame for board, drive in self.drives.items() for frame in drive.cycle(setpoints[board])]
        self._note_faults()
        return [*frames, *self._shared]

    def receive(self, frame: MotorFrame) -> None:
        """Process a frame from the bus."""
        for drive in self.drives.values():
            drive.receive(frame)
        self._note_faults()

    def stop(self) -> list[MotorFrame]:
        """Return the frames that switch all drives off, because no cycle follows."""
        self.running = False
        return [frame for drive in self.drives.values() for frame in drive.stop()]

    def _note_faults(self) -> None:
        for board, drive in self.drives.items():
            if drive.fault and board not in self._noted:
                self._noted.add(board)
                self._report(drive.fault)
