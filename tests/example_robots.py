"""Robots of other projects, and the joint names of the TWIN models."""

import os
from importlib import metadata
from pathlib import Path
from typing import NoReturn

import pytest

from twin_gait.leg_model import LegJoints
from twin_gait.vocabulary import Side

ROBOTS_VARIABLE = "TWIN_GAIT_REQUIRE_ROBOTS"


def robot_urdf(name: str) -> Path:
    """Return the path of a URDF in the data package example-robot-data; skip the test without it."""
    try:
        recorded = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        _lack("example-robot-data (400 MB) is not installed: pip install 'twin-gait[robots]'")
    for item in recorded:
        if str(item).endswith(f"/robots/{name}"):
            return Path(str(item.locate()))
    _lack(f"this version of example-robot-data has no {name}")


def _lack(reason: str) -> NoReturn:
    """Skip a test, or fail it if the environment requires the robots."""
    if os.environ.get(ROBOTS_VARIABLE):
        pytest.fail(f"{ROBOTS_VARIABLE} is set, but {reason}")
    pytest.skip(reason)


# One joint of each kind with axes that are not coordinate axes; the range of the first joint excludes zero.
JOINTS = """<robot name="slides">
<link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/>
<joint name="turns" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="1 -2 3"/>
  <axis xyz="0 3 4"/><limit lower="0.5" upper="1.5" effort="1" velocity="1"/></joint>
<joint name="slides" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0" rpy="0 1 0.4"/>
  <axis xyz="1 0 0"/><limit lower="-0.1" upper="0.3" effort="1" velocity="1"/></joint>
<joint name="spins" type="continuous"><parent link="c"/><child link="d"/><origin xyz="0 0.3 0"/>
  <axis xyz="0 0 -1"/></joint>
<joint name="fixed" type="fixed"><parent link="d"/><child link="e"/></joint>
</robot>"""


def twin_joints(side: Side, *, foot: bool = True) -> LegJoints:
    """Return the names of a leg in the URDFs of this project; ``foot``: whether it has ankle and foot."""
    ankle, frames = (f"{side}_ankle", (f"{side}_heel", f"{side}_toe")) if foot else (None, ())
    return LegJoints(hip=f"{side}_hip", knee=f"{side}_knee", ankle=ankle, contact_frames=frames)
