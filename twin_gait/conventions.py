"""Sign conventions of the field: names and signs of joint angles in other programs.

Inside this package hip flexion, knee flexion and ankle dorsiflexion are positive and angles are in [rad].
A convention converts to this definition and back, where files are read and written.
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
        name: Name on the command line.
        columns: Name of the column of each joint of each side; empty where the user chooses them.
        signs: Sign of each joint, 1 or -1; 1 for a joint that is missing.
        unit: Unit of columns that do not state theirs, ``rad`` or ``deg``; None if the user must specify it.
    """

    name: str
    columns: Mapping[tuple[Side, JointName], str] = field(default_factory=dict)
    signs: Mapping[JointName, float] = field(default_factory=dict)
    unit: str | None = None

    def convert_angle(self, joint: JointName, angle: np.ndarray) -> np.ndarray:
        """Convert an angle between that program and this package, in [rad] and any shape, either way."""
        return np.asarray(self.signs.get(joint, 1.0) * angle)


_OPENSIM_COLUMNS = {
    (side, joint): f"{name}_{str(side)[0]}"
    for side in Side
    for joint, name in zip(JointName, ("hip_flexion", "knee_angle", "ankle_angle"), strict=True)
}

# Convention of this package: flexion of hip and knee and dorsiflexion positive.
OWN_CONVENTION = Convention(
    name="twin_gait",
    columns={(side, joint): f"{side}_{joint}_angle_rad" for side in Side for joint in JointName},
)
# Convention of OpenSim's gait2392, gait2354 and gait10dof18musc: knee flexion negative.
OPENSIM_GAIT2392 = Convention(
    name="opensim_gait2392",
    columns=_OPENSIM_COLUMNS,
    signs={JointName.KNEE: -1.0},
)
# Convention of Rajagopal et al. (2016) in OpenSim: the names of gait2392, but knee flexion positive.
RAJAGOPAL = Convention(
    name="rajagopal",
    columns=_OPENSIM_COLUMNS,
)
# Convention of the Open-Source Leg: knee flexion and ankle dorsiflexion positive; its logger accepts any
# names.
OSL = Convention(name="osl", unit=RADIANS)
# ExoMotus X2 in CANOpenRobotController: left hip, left knee, right hip, right knee; knee flexion negative
# (0 to -120 deg).
CORC_X2 = Convention(
    name="corc_x2",
    columns={
        key: f"JointPositions_{number}"
        for number, key in enumerate(product(Side, (JointName.HIP, JointName.KNEE)), start=1)
    },
    signs={JointName.KNEE: -1.0},
    unit=RADIANS,
)
# Vicon Plug-in Gait: flexion of hip and knee and dorsiflexion positive (Plug-in Gait Reference Guide, "Lower
# body angles as output from Plug-in Gait"); angles without a unit are in degrees.
PLUG_IN_GAIT = Convention(
    name="plug_in_gait",
    columns={
        (side, joint): f"{str(side)[0].upper()}{joint.capitalize()}Angles"
        for side in Side
        for joint in JointName
    },
    unit=DEGREES,
)
CONVENTIONS = {
    item.name: item for item in (OWN_CONVENTION, OPENSIM_GAIT2392, RAJAGOPAL, OSL, CORC_X2, PLUG_IN_GAIT)
}


def find_convention(name: str) -> Convention:
    """Look up a convention by its name.

    Args:
        name: Name such as ``opensim_gait2392``.

    Raises:
        ParameterError: If there is no convention of that name.
    """
    if name not in CONVENTIONS:
        raise ParameterError(f"convention: expected one of {', '.join(CONVENTIONS)}, got {name!r}")
    return CONVENTIONS[name]
