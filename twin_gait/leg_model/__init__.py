"""Rigid bodies: the URDF, the wearer's segments, and the one room that knows Pinocchio."""

from twin_gait.leg_model.joints import PELVIS_JOINT, Bodies, LegJoints, PelvisGuide
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import packaged_urdf
from twin_gait.leg_model.wearer import DeviceSizes, device_sizes

__all__ = [
    "PELVIS_JOINT",
    "Bodies",
    "DeviceSizes",
    "LegJoints",
    "LegModel",
    "PelvisGuide",
    "device_sizes",
    "packaged_urdf",
]
