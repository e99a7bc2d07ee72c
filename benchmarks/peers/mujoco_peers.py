"""MuJoCo as a peer: the same bodies, integrator and step, and everything off that is not used."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from crosscheck.mujoco_legs import compiled_legs, coordinate_order, legs_of, legs_spec
from mujoco.rollout import Rollout
from peers.callback import NativeCallback, PythonCallback
from peers.engines import BATCH_EPISODES, THREADS
from peers.scenarios import RK4, Case
from peers.timing import Implementation

from twin_gait.experiment.problem import Problem, build_problem
from twin_gait.leg_model.bodies import contact_points

# Springs that hold the legs up while nothing controls them, as stiff as a phase of stance.
HOLDING_STIFFNESS, HOLDING_DAMPING = 300.0, 30.0  # [N m] / [rad], [N m s] / [rad]
BELT_JOINT = "belt"
SOLE_RADIUS = 0.005  # [m] of the spheres at heel and toe
# MuJoCo knows no belt. A body that no leg can slow down runs backwards in its place.
BELT_MASS, BELT_HALF_LENGTH, BELT_HALF_WIDTH, BELT_HALF_HEIGHT = 1e6, 50.0, 2.0, 0.1  # [kg], [m]
UNUSED = ("EQUALITY", "FRICTIONLOSS", "LIMIT", "SENSOR", "CLAMPCTRL", "EULERDAMP", "ISLAND", "MIDPHASE")


def peer_model(case: Case, problem: Problem, *, controlled: bool) -> mujoco.MjModel:
    """MuJoCo's model of a case at its best.

    Args:
        case: The case.
        problem: Its problem.
        controlled: Whether a callback will control it. Without one, on the treadmill, springs hold the
            start posture on a belt at rest; with one the belt is a body that moves.
    """
    grounded = problem.world.contact is not None
    model = (
        _on_ground(problem, moving=controlled) if grounded else legs_of(case.experiment, problem.world.model)
    )
    unused = list(UNUSED)
    if not grounded:
        unused += ["CONTACT", "CONSTRAINT"]
    if not controlled:
        unused += ["ACTUATION"]  # MuJoCo asks its callback as part of actuation
    bits = [int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in unused]
    model.opt.disableflags = int(np.bitwise_or.reduce(bits))
    if case.integration.method is RK4:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    if grounded and not controlled:
        _hold(model, problem)
    return model


def _on_ground(problem: Problem, *, moving: bool) -> mujoco.MjModel:
    """Legs with a sphere at every heel and toe over a belt, or over a plane at rest, which is cheaper."""
    experiment, world = problem.experiment, problem.world
    assert world.contact is not None
    spec = legs_spec(world.model, experiment.patient, fit_device=experiment.leg.fit_device)
    for leg in world.model.legs.values():
        for point in contact_points(world.model.model, leg.contact_frames):
            # Its lowest point, with the foot level, is the heel or the toe.
            place = np.add(point.position, [0.0, 0.0, SOLE_RADIUS])
            spec.joint(leg.ankle).parent.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[SOLE_RADIUS, 0, 0],
                pos=place,
                mass=0.0,
                contype=1,
                conaffinity=0,
            )
    # Only soles touch the ground, and with the friction of the experiment.
    friction = [world.contact.friction_coefficient, 0.005, 0.0001]
    ground: dict[str, Any] = {"contype": 0, "conaffinity": 1, "friction": friction}
    if moving:
        _add_belt(spec, ground)
    else:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], **ground)
    armature = {joint: item.armature for joint, item in experiment.plant.actuators.items()}
    gravity, step = experiment.plant.gravity, experiment.stepping.step
    return compiled_legs(spec, world.model, armature, gravity=gravity, step=step)


def _add_belt(spec: mujoco.MjSpec, ground: dict[str, Any]) -> None:
    belt = spec.worldbody.add_body(name=BELT_JOINT, mass=BELT_MASS, inertia=[1.0, 1.0, 1.0])
    belt.explicitinertial = True
    belt.add_joint(name=BELT_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    belt.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[BELT_HALF_LENGTH, BELT_HALF_WIDTH, BELT_HALF_HEIGHT],
        pos=[0.0, 0.0, -BELT_HALF_HEIGHT],
        **ground,
    )


def _hold(model: mujoco.MjModel, problem: Problem) -> None:
    """Springs on every joint but the pelvis, which is a slide."""
    order = coordinate_order(model, problem.world.model)
    for place, angle in zip(order, problem.world.start_q.tolist(), strict=True):
        if model.jnt_type[place] == mujoco.mjtJoint.mjJNT_SLIDE:
            continue
        model.jnt_stiffness[place] = HOLDING_STIFFNESS
        model.dof_damping[place] = HOLDING_DAMPING
        model.qpos_spring[place] = angle


class BareSession:
    """``mj_step`` alone, all steps in one call of C.

    Attributes:
        controlled: Whether a callback controls the model.
    """

    controlled = False

    def __init__(self, case: Case, ticks: int) -> None:
        """Build the model; see :func:`peer_model`."""
        self.problem = build_problem(case.lasting(ticks))
        self.steps, self.evaluations = ticks * case.integration.substeps, case.evaluations
        self.model = peer_model(case, self.problem, controlled=self.controlled)
        self.data = mujoco.MjData(self.model)
        self.order = coordinate_order(self.model, self.problem.world.model)
        self.reset()

    def reset(self) -> None:
        """Put the state back to the start."""
        mujoco.mj_resetData(self.model, self.data)
        world = self.problem.world
        self.data.qpos[self.order], self.data.qvel[self.order] = world.start_q, world.start_v
        pelvis = world.model.pelvis_index
        if pelvis is not None:
            self.data.qfrc_applied[self.order[pelvis]] = world.support_force
        if self.model.nv > len(self.order):
            self.data.joint(BELT_JOINT).qvel[0] = -world.belt.cruise

    def run(self) -> None:
        """All steps in one call of C."""
        mujoco.mj_step(self.model, self.data, nstep=self.steps)

    def angles(self) -> np.ndarray | None:
        """A bare step is no closed loop."""
        return None


class ControlledSession(BareSession):
    """The control loop as a callback; still one call of C.

    Attributes:
        callback: Of the loop.
    """

    controlled = True
    callback: NativeCallback | PythonCallback | None = None

    def __init__(self, case: Case, ticks: int, *, native: bool) -> None:
        """Make the callback, as a native function or in Python."""
        super().__init__(case, ticks)
        shared = self.problem, self.order, self.evaluations, ticks
        self.callback = NativeCallback(*shared, self.data) if native else PythonCallback(*shared)

    def reset(self) -> None:
        """Put state and controller back to the start."""
        super().reset()
        if self.callback is not None:
            self.callback.reset()

    def run(self) -> None:
        """All steps in one call of C, which calls back."""
        mujoco.set_mjcb_control(self.callback.function)
        try:
            super().run()
        finally:
            mujoco.set_mjcb_control(None)

    def angles(self) -> np.ndarray | None:
        """Coordinates at every tick; None on the treadmill, where MuJoCo's contacts make another motion."""
        return self.callback.trace if self.problem.world.contact is None else None


class RolloutSession(BareSession):
    """``mujoco.rollout``: many open-loop episodes on threads."""

    def __init__(
        self, case: Case, ticks: int, *, episodes: int = BATCH_EPISODES, threads: int = THREADS
    ) -> None:
        """Make the pool and room for the states."""
        super().__init__(case, ticks)
        self._pool = Rollout(nthread=threads)
        self._workers = [mujoco.MjData(self.model) for _ in range(threads)]
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        size = mujoco.mj_stateSize(self.model, kind)
        start = np.zeros(size)
        mujoco.mj_getState(self.model, self.data, start, kind)
        self._starts = np.tile(start, (episodes, 1))
        self.states = np.ones((episodes, self.steps, size))

    def run(self) -> None:
        """Roll all episodes out."""
        self._pool.rollout(self.model, self._workers, self._starts, nstep=self.steps, state=self.states)


MUJOCO_PEERS = (
    Implementation("MuJoCo, bare", BareSession),
    Implementation("MuJoCo, native loop", lambda case, ticks: ControlledSession(case, ticks, native=True)),
    Implementation(
        "MuJoCo, Python loop",
        lambda case, ticks: ControlledSession(case, ticks, native=False),
        compiled=False,
    ),
    Implementation("MuJoCo rollout", RolloutSession, episodes=BATCH_EPISODES),
)
