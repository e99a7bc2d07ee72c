"""A treadmill of MuJoCo's own making: its contacts and its solver under the same legs."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin_gait.experiment import Experiment
from twin_gait.leg_model.bodies import contact_points
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.scenario import World
from twin_gait.studies.validation.mujoco_witness import (
    _COMPILER,
    _put_on,
    coordinate_order,
    import_mujoco,
    witness_model,
)

BELT_JOINT = "belt"
SOLE_RADIUS = 0.005  # [m] of the spheres at heel and toe
# MuJoCo knows no belt. A body that no leg can slow down runs backwards in its place.
BELT_MASS, BELT_HALF_LENGTH, BELT_HALF_WIDTH, BELT_HALF_HEIGHT = 1e6, 50.0, 2.0, 0.1  # [kg], [m]


def treadmill_model(experiment: Experiment, world: World, *, moving: bool) -> Any:
    """Legs with spheres at heels and toes over a belt.

    Args:
        experiment: On the treadmill.
        world: Its world.
        moving: Whether the belt is a body that runs, or a plane at rest, which is cheaper.

    Returns:
        The ``MjModel``.
    """
    mujoco = import_mujoco()
    spec = _legs(mujoco, experiment, world)
    _add_soles(mujoco, spec, world)
    if moving:
        _add_belt(mujoco, spec, _ground(world))
    else:
        plane = mujoco.mjtGeom.mjGEOM_PLANE
        spec.worldbody.add_geom(type=plane, size=[0, 0, 1], **_ground(world))
    model = spec.compile()
    _set_up_like(model, witness_model(experiment, world.model), world)
    return model


def _legs(mujoco: Any, experiment: Experiment, world: World) -> Any:
    """Bodies of the witness, before they are compiled."""
    assert experiment.patient is not None  # the preset has a wearer
    text = world.model.urdf_path.read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", f"{_COMPILER}</robot>"))
    spec.worldbody.first_body().add_joint(
        name=PELVIS_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0]
    )
    _put_on(spec, experiment.patient, world.model, fit_device=experiment.leg.fit_device)
    return spec


def _add_soles(mujoco: Any, spec: Any, world: World) -> None:
    """A small sphere whose lowest point, with the foot level, is the heel or the toe."""
    for leg in world.model.legs.values():
        assert leg.ankle is not None  # a treadmill needs feet
        foot = spec.joint(leg.ankle).parent
        for point in contact_points(world.model.model, leg.contact_frames):
            foot.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[SOLE_RADIUS, 0, 0],
                pos=np.add(point.position, [0.0, 0.0, SOLE_RADIUS]),
                mass=0.0,
                contype=1,
                conaffinity=0,
            )


def _ground(world: World) -> dict[str, Any]:
    """Only soles touch the ground, and with the friction of the experiment."""
    assert world.contact is not None  # on the treadmill
    return {"contype": 0, "conaffinity": 1, "friction": [world.contact.friction_coefficient, 0.005, 0.0001]}


def _add_belt(mujoco: Any, spec: Any, ground: dict[str, Any]) -> None:
    belt = spec.worldbody.add_body(name=BELT_JOINT, mass=BELT_MASS, inertia=[1.0, 1.0, 1.0])
    belt.explicitinertial = True
    belt.add_joint(name=BELT_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    belt.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[BELT_HALF_LENGTH, BELT_HALF_WIDTH, BELT_HALF_HEIGHT],
        pos=[0.0, 0.0, -BELT_HALF_HEIGHT],
        **ground,
    )


def _set_up_like(model: Any, witness: Any, world: World) -> None:
    """Step, gravity and drives of the witness; no damping or friction of MuJoCo's own."""
    model.opt.timestep, model.opt.integrator = witness.opt.timestep, witness.opt.integrator
    model.opt.gravity[:] = witness.opt.gravity
    ours, theirs = coordinate_order(model, world.model), coordinate_order(witness, world.model)
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.dof_armature[:] = 0.0
    model.dof_armature[ours] = witness.dof_armature[theirs]
