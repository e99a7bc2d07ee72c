"""MuJoCo as a peer: the same bodies, integrator and step, with all unused features disabled."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import mujoco
import numpy as np
from crosscheck.mujoco_legs import compiled_legs, coordinate_order, legs_of, legs_spec
from mujoco.batch import Batch
from mujoco.rollout import Rollout
from peers.engines import ALL_CORES, THREADS
from peers.scenarios import RK4, Case
from peers.timing import Implementation

from twin_gait.leg_model.bodies import contact_points
from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

# Springs that hold the uncontrolled legs, with the stiffness of a phase of stance.
HOLDING_STIFFNESS, HOLDING_DAMPING = 300.0, 30.0  # [N·m/rad], [N·m·s/rad]
SOLE_RADIUS = 0.005  # [m] radius of the spheres at heel and toe
UNUSED = "ACTUATION CLAMPCTRL EQUALITY EULERDAMP FRICTIONLOSS ISLAND LIMIT MIDPHASE SENSOR".split()
UNUSED_IN_THE_AIR = "CONTACT CONSTRAINT SPRING DAMPER".split()


def disabling(names: Iterable[str]) -> int:
    """Return the bits of MuJoCo that disable the named features."""
    return sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in names)


def peer_model(case: Case, problem: SimulationSetup) -> mujoco.MjModel:
    """Return the fastest MuJoCo model of a case; springs hold the posture on a treadmill at rest."""
    grounded = problem.world.contact is not None
    model = _on_ground(problem) if grounded else legs_of(case.experiment, problem.world.model)
    model.opt.disableflags = disabling(UNUSED if grounded else UNUSED + UNUSED_IN_THE_AIR)
    if case.integration.method is RK4:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    if grounded:
        _hold(model, problem)
    return model


def _on_ground(problem: SimulationSetup) -> mujoco.MjModel:
    """Return the legs with a sphere at every heel and toe above a plane."""
    experiment, world = problem.experiment, problem.world
    assert world.contact is not None
    leg_source = experiment.leg
    spec = legs_spec(
        world.model, experiment.patient, fit_device=leg_source.fit_device, manufactured=leg_source.sizes
    )
    for leg in world.model.legs.values():
        for point in contact_points(world.model.model, leg.contact_frames):
            # The lowest point of the sphere of a level foot is the heel or the toe.
            position = np.add(point.position, [0.0, 0.0, SOLE_RADIUS])
            spec.joint(leg.ankle).parent.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[SOLE_RADIUS, 0, 0],
                pos=position,
                mass=0.0,
                contype=1,
                conaffinity=0,
            )
    # Only the soles touch the ground, with the friction of the experiment.
    friction = [world.contact.friction_coefficient, 0.005, 0.0001]
    ground: dict[str, Any] = {"contype": 0, "conaffinity": 1, "friction": friction}
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], **ground)
    armature = {joint: item.armature for joint, item in experiment.plant.actuators.items()}
    gravity, step = experiment.plant.gravity, experiment.resolved_integration.step
    return compiled_legs(spec, world.model, armature, gravity=gravity, step=step)


def _hold(model: mujoco.MjModel, problem: SimulationSetup) -> None:
    """Add springs to every joint except the pelvis, which is a slide."""
    order = coordinate_order(model, problem.world.model)
    for index, angle in zip(order, problem.world.start_q.tolist(), strict=True):
        if model.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE:
            continue
        model.jnt_stiffness[index] = HOLDING_STIFFNESS
        model.dof_damping[index] = HOLDING_DAMPING
        model.qpos_spring[index] = angle


class BareSession:
    """Session of ``mj_step`` alone, with all steps in one call of C."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Build the model; see :func:`peer_model`."""
        self.problem = build_setup(case.lasting(ticks))
        self.steps = ticks * case.integration.substeps
        self.model = peer_model(case, self.problem)
        self.data = mujoco.MjData(self.model)
        self.order = coordinate_order(self.model, self.problem.world.model)
        self.reset()

    def reset(self) -> None:
        """Reset the state to the start."""
        mujoco.mj_resetData(self.model, self.data)
        world = self.problem.world
        self.data.qpos[self.order], self.data.qvel[self.order] = world.start_q, world.start_v
        pelvis = world.model.pelvis_index
        if pelvis is not None:
            self.data.qfrc_applied[self.order[pelvis]] = world.support_force

    def run(self) -> None:
        """Run all steps in one call of C."""
        mujoco.mj_step(self.model, self.data, nstep=self.steps)

    def angles(self) -> np.ndarray | None:
        """Return None, because bare steps are no closed loop."""
        return None

    def last_position(self) -> np.ndarray:
        """Return the positions of MuJoCo at the end of a run of one episode."""
        return self.data.qpos


class RolloutSession(BareSession):
    """Session of ``mujoco.rollout``: many open-loop episodes on threads, with all states written.

    Attributes:
        states: Time, positions and velocities after every step, ``(episodes, n_steps, ...)``.
    """

    def __init__(self, case: Case, ticks: int, *, threads: int = 1, episodes: int = 0, **call: Any) -> None:
        """Create the pool and the buffer of states; ``call``: further arguments of the rollout."""
        super().__init__(case, ticks)
        episodes = episodes or WIDTH * threads
        self._pool = Rollout(nthread=threads)
        self._workers = [mujoco.MjData(self.model) for _ in range(max(threads, 1))]
        start = _state_of(self.model, self.data, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._starts = np.tile(start, (episodes, 1))
        self.states = np.ones((episodes, self.steps, len(start)))
        self._call = {"nstep": self.steps, "state": self.states, **call}
        if self.problem.world.model.pelvis_index is not None:  # a rollout resets forces that are no input
            self._call["control"] = np.tile(self.data.qfrc_applied, (episodes, self.steps, 1))
            self._call["control_spec"] = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)

    def run(self) -> None:
        """Run all episodes."""
        self._pool.rollout(self.model, self._workers, self._starts, **self._call)

    def last_position(self) -> np.ndarray:
        """Return the positions of the last episode at the end of a run."""
        return self.states[-1, -1, 1 : 1 + self.model.nq]


class StateBatchSession(BareSession):
    """Session of ``mujoco.batch``: like the rollout, but only with the last states.

    Attributes:
        batch: Batch with its states.
    """

    def __init__(self, case: Case, ticks: int) -> None:
        """Create the batch."""
        self.batch: Batch | None = None
        super().__init__(case, ticks)
        self.batch = Batch(self.model, WIDTH, nthread=1)

    def reset(self) -> None:
        """Reset all states to the start."""
        super().reset()
        if self.batch is not None:
            self.batch.state[:] = _state_of(self.model, self.data, mujoco.mjtState.mjSTATE_INTEGRATION)

    def run(self) -> None:
        """Run all steps of all episodes."""
        assert self.batch is not None
        self.batch.step(nstep=self.steps)

    def last_position(self) -> np.ndarray:
        """Return the positions of the last episode at the end of a run."""
        assert self.batch is not None
        return self.batch.qpos[-1]


def _state_of(model: mujoco.MjModel, data: mujoco.MjData, kind: mujoco.mjtState) -> np.ndarray:
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    return state


MUJOCO_PEERS = (
    Implementation("MuJoCo, bare", BareSession),
    Implementation("MuJoCo rollout", RolloutSession, WIDTH, "batch"),
    Implementation("MuJoCo batch", StateBatchSession, WIDTH, "batch"),
    Implementation(
        "MuJoCo rollout, all cores",
        partial(RolloutSession, threads=THREADS),
        WIDTH * THREADS,
        ALL_CORES,
    ),
)
