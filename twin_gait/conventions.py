"""Sign conventions of the field: what other programs call a joint angle, and which way they count it.

Inside this package hip flexion, knee flexion and ankle dorsiflexion are positive and angles are in [rad].
A convention leads into it and back; it sits at the edge, where files are read and written.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.vocabulary import JointName, Side

RADIANS, DEGREES = "rad", "deg"


@dataclass(frozen=True, kw_only=True)
class Convention:
    """Names and signs of joint angles in another program.

    Attributes:
        name: What it is called on the command line.
        columns: Name of the column of each joint of each side; empty where the user chooses them.
        signs: Of each joint, 1 or -1; 1 where it is not named.
        unit: Of columns that do not state theirs, ``rad`` or ``deg``; None if it must be asked for.
    """

    name: str
    columns: Mapping[tuple[Side, JointName], str] = field(default_factory=dict)
    signs: Mapping[JointName, float] = field(default_factory=dict)
    unit: str | None = None

    def turned(self, joint: JointName, angle: np.ndarray) -> np.ndarray:
        """An angle of that program, in [rad] and any shape, as this package counts it, or the other way."""
        return np.asarray(self.signs.get(joint, 1.0) * angle)


_OPENSIM_COLUMNS = {
    (side, joint): f"{name}_{str(side)[0]}"
    for side in Side
    for joint, name in zip(JointName, ("hip_flexion", "knee_angle", "ankle_angle"), strict=True)
}

# This package's own: flexion of hip and knee and dorsiflexion positive.
HOUSE = Convention(
    name="twin_gait",
    columns={(side, joint): f"{side}_{joint}_angle_rad" for side in Side for joint in JointName},
)
# OpenSim's gait2392, gait2354 and gait10dof18musc: knee flexion negative.
OPENSIM_GAIT2392 = Convention(
    name="opensim_gait2392",
    columns=_OPENSIM_COLUMNS,
    signs={JointName.KNEE: -1.0},
)
# Rajagopal et al. (2016) in OpenSim: the names of gait2392, but knee flexion positive.
RAJAGOPAL = Convention(
    name="rajagopal",
    columns=_OPENSIM_COLUMNS,
)
# Open-Source Leg: knee flexion and ankle dorsiflexion positive; its logger takes any names.
OSL = Convention(name="osl", unit=RADIANS)
# ExoMotus X2 in CANOpenRobotController: left hip, left knee, right hip, right knee; knee flexion negative
# (0 to -120 deg).
CORC_X2 = Convention(
    name="corc_x2",
    columns={
        place: f"JointPositions_{number}"
        for number, place in enumerate(product(Side, (JointName.HIP, JointName.KNEE)), start=1)
    },
    signs={JointName.KNEE: -1.0},
    unit=RADIANS,
)
CONVENTIONS = {item.name: item for item in (HOUSE, OPENSIM_GAIT2392, RAJAGOPAL, OSL, CORC_X2)}


def find_convention(name: str) -> Convention:
    """Look a convention up.

    Args:
        name: For example ``opensim_gait2392``.

    Raises:
        ParameterError: If there is none of that name.
    """
    if name not in CONVENTIONS:
        raise ParameterError(f"convention: no {name!r}; there are {', '.join(CONVENTIONS)}")
    return CONVENTIONS[name]
