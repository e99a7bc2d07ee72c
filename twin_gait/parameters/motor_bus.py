"""Protocol of the drives of a device on a real CAN bus."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait.parameters import quantities
from twin_gait.vocabulary import JointName


class MotorProtocol(StrEnum):
    """Frames that a live walk exchanges with the drives."""

    TWIN = "twin"  # Frames of TWIN's boards, or of a DBC file.
    MIT = "mit"  # MIT mode of the T-Motor (CubeMars) AK drives.
    CIA402 = "cia402"  # CANopen drives of the profile CiA 402 in cyclic synchronous torque mode.


class DriveModel(StrEnum):
    """Drive with MIT mode, whose ranges are in ``network/motor_frames.yaml``."""

    AK10_9 = "AK10-9"
    AK60_6 = "AK60-6"
    AK70_10 = "AK70-10"
    AK80_6 = "AK80-6"
    AK80_9 = "AK80-9"
    AK80_64 = "AK80-64"


@dataclass(frozen=True, kw_only=True)
class MotorBusParameters(quantities.Parameters):
    """Protocol of the drives; a simulation does not depend on it.

    Attributes:
        protocol: Frames that a live walk exchanges with the drives.
        timeout: Time without a report of a drive in [s], after which it counts as silent.
        models: Model of the drive of each joint, for the ranges of ``mit``.
    """

    protocol: MotorProtocol
    timeout: Annotated[quantities.Time, quantities.POSITIVE]
    models: Mapping[JointName, DriveModel] = field(default_factory=dict)
