"""Any URDF as one page: its scene, and a slider for every joint that turns or slides."""

import math
from pathlib import Path
from typing import Any

import pinocchio as pin

from twin_gait.leg_model.urdf import build_model, find_urdf
from twin_gait.viewer.commands import Recorder
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.page import packed, page_data, recorded_page
from twin_gait.viewer.staging import build_urdf_scene

# A range wider than this is no limit: continuous joints, and files that leave the limits out.
_WIDEST_TURN, _WIDEST_WAY = 4.0 * math.pi, 10.0  # [rad], [m]
_FREE_TURN, _FREE_WAY = math.pi, 1.0  # either way of a joint without limits, in [rad], [m]


def urdf_page(path: str | Path, *, up_axis: str = "z") -> str:
    """A page that shows a URDF and holds everything it needs.

    Every joint is at zero, or at the limit that is nearest to it. ``path``: the file, or the name of a
    packaged one; ``up_axis``: ``"x"``, ``"y"`` or ``"z"``: the vertical of the URDF. Raises ModelError if the
    URDF cannot be read. Raises ViewerError if a mesh cannot be read.
    """
    urdf = find_urdf(path)
    model = build_model(urdf)
    recorder = Recorder()
    scene = build_urdf_scene(recorder, model, urdf, up_axis=up_axis)
    page = page_data(
        mode="model", title=urdf.name, subtitle=counted(model), missing_meshes=scene.missing_meshes,
        view=scene.view, phases=[], legs=[], arrows=False, joints=joint_entries(scene.figure),
        scene=packed(recorder.packed()),
    )  # fmt: skip
    return recorded_page([page], mode="model")


def counted(model: pin.Model) -> str:
    """How many joints and degrees of freedom a model has, in words."""
    return f"{model.njoints - 1} joints, {model.nv} degrees of freedom"


def joint_entries(figure: Figure) -> list[dict[str, Any]]:
    """What a slider needs to know of each joint that turns about or slides along one axis.

    Returns name, place in the scene, ``slides``, axis in the frame of the joint, position in [m] and
    quaternion (x, y, z, w) at zero, and range in [rad] or [m], which is ``free`` if the file has no limits.
    """
    model = figure.model
    rest = figure.posture(pin.neutral(model))
    entries = []
    for index in range(1, model.njoints):
        joint, name = model.joints[index], str(model.names[index])
        if joint.nq != 1:  # planar and floating ones
            continue
        slides = joint.shortname().startswith("JointModelP")
        lower, upper = (
            float(limit[joint.idx_q]) for limit in (model.lowerPositionLimit, model.upperPositionLimit)
        )
        free = not 0.0 < upper - lower <= (_WIDEST_WAY if slides else _WIDEST_TURN)
        if free:
            upper = _FREE_WAY if slides else _FREE_TURN
            lower = -upper
        position, quaternion = rest[figure.paths[name]]
        entries.append(
            {"name": name, "path": figure.paths[name], "slides": slides, "axis": figure.axis(name).tolist(),
             "position": position, "quaternion": quaternion, "lower": lower, "upper": upper, "free": free}
        )  # fmt: skip
    return entries
