"""MuJoCo as contestants: the same bodies, integrator and step, and everything off that is not used."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from twin_gait.experiment import IntegrationMethod
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.studies.benchmark.contestant import Contestant
from twin_gait.studies.benchmark.engines import BATCH_EPISODES, THREADS
from twin_gait.studies.benchmark.native import controller_record, native_callback
from twin_gait.studies.benchmark.plain import PlainController, PlainPlant
from twin_gait.studies.benchmark.subjects import Case
from twin_gait.studies.benchmark.treadmill import BELT_JOINT, treadmill_model
from twin_gait.studies.validation.mujoco_witness import EXTRA, coordinate_order, import_mujoco, witness_model

RK4_STAGES = 4
# Springs that hold the legs up while nothing controls them, as stiff as a phase of stance.
HOLDING_STIFFNESS, HOLDING_DAMPING = 300.0, 30.0  # [N m] / [rad], [N m s] / [rad]


def contestant_model(case: Case, problem: Problem, *, controlled: bool) -> Any:
    """MuJoCo's model of a case at its best.

    Args:
        case: The case.
        problem: Its problem.
        controlled: Whether a callback will control it. Without one, on the treadmill, springs hold the
            start posture on a belt at rest; with one the belt is a body that moves.

    Returns:
        The ``MjModel``.
    """
    mujoco = import_mujoco()
    grounded = problem.world.contact is not None
    if grounded:
        model = treadmill_model(case.experiment, problem.world, moving=controlled)
    else:
        model = witness_model(case.experiment, problem.world.model)
    unused = ["EQUALITY", "FRICTIONLOSS", "LIMIT", "SENSOR", "CLAMPCTRL", "EULERDAMP", "ISLAND", "MIDPHASE"]
    if not grounded:
        unused += ["CONTACT", "CONSTRAINT"]
    if not controlled:
        # MuJoCo asks its callback as part of actuation.
        unused += ["ACTUATION"]
    bits = [int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in unused]
    model.opt.disableflags = int(np.bitwise_or.reduce(bits))
    if case.integration.method is IntegrationMethod.RK4:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    if grounded and not controlled:
        _hold(model, problem)
    return model


def _hold(model: Any, problem: Problem) -> None:
    """Springs on every joint but the pelvis, which is a slide."""
    mujoco = import_mujoco()
    order = coordinate_order(model, problem.world.model)
    for place, angle in zip(order, problem.world.start_q.tolist(), strict=True):
        if model.jnt_type[place] == mujoco.mjtJoint.mjJNT_SLIDE:
            continue
        model.jnt_stiffness[place] = HOLDING_STIFFNESS
        model.dof_damping[place] = HOLDING_DAMPING
        model.qpos_spring[place] = angle


class MujocoSession:
    """A model of MuJoCo with its start."""

    def __init__(self, case: Case, ticks: int, *, controlled: bool = False) -> None:
        """Build the model.

        Args:
            case: The case.
            ticks: Length of a run.
            controlled: See :func:`contestant_model`.
        """
        self.mujoco = import_mujoco()
        self.problem = build_problem(case.lasting(ticks))
        self.ticks, self.steps = ticks, ticks * case.integration.substeps
        self.rk4 = case.integration.method is IntegrationMethod.RK4
        self.evaluations = case.integration.substeps * (RK4_STAGES if self.rk4 else 1)
        self.model = contestant_model(case, self.problem, controlled=controlled)
        self.data = self.mujoco.MjData(self.model)
        self.order = coordinate_order(self.model, self.problem.world.model)
        self.reset()

    def reset(self) -> None:
        """Put the state back to the start."""
        self.mujoco.mj_resetData(self.model, self.data)
        world = self.problem.world
        self.data.qpos[self.order], self.data.qvel[self.order] = world.start_q, world.start_v
        pelvis = world.model.pelvis_index
        if pelvis is not None:
            self.data.qfrc_applied[self.order[pelvis]] = world.support_force
        if self.model.nv > len(self.order):
            self.data.joint(BELT_JOINT).qvel[0] = -world.belt_speed

    def run(self) -> None:
        """All steps in one call of C."""
        self.mujoco.mj_step(self.model, self.data, nstep=self.steps)

    def angles(self) -> np.ndarray | None:
        """A bare step is no closed loop."""
        return None


class NativeSession(MujocoSession):
    """The control loop as a native callback; still one call of C."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Compile the callback.

        Args:
            case: The case.
            ticks: Length of a run.
        """
        super().__init__(case, ticks, controlled=True)
        self._start = controller_record(self.problem, ticks)
        self._record = self._start.copy()
        data = self.data
        addresses = tuple(array.ctypes.data for array in (data.qpos, data.qvel, data.qfrc_applied))
        self._callback = native_callback(self.problem, self._record, self.order, addresses, self.evaluations)

    def reset(self) -> None:
        """Put state and controller back to the start."""
        super().reset()
        if hasattr(self, "_record"):
            trace = self._record["trace"]
            self._record[:] = self._start
            trace[:] = 0.0

    def run(self) -> None:
        """All steps in one call of C."""
        self.mujoco.set_mjcb_control(self._callback)
        try:
            super().run()
        finally:
            self.mujoco.set_mjcb_control(None)

    def angles(self) -> np.ndarray | None:
        """Coordinates at every tick; None on the treadmill, where MuJoCo's contacts make another motion."""
        return np.array(self._record["trace"][0]) if self.problem.world.contact is None else None


class PythonSession(MujocoSession):
    """The controller of the plain script as a Python callback."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Make room for the record.

        Args:
            case: The case.
            ticks: Length of a run.
        """
        self._trace = np.zeros((ticks, 0))
        super().__init__(case, ticks, controlled=True)
        self._trace = np.zeros((ticks, self.problem.world.model.nv))

    def reset(self) -> None:
        """Put state and controller back to the start."""
        super().reset()
        self._controller, self._plant = PlainController(self.problem), PlainPlant(self.problem)
        self._calls, self._motor = 0, np.zeros(len(self.order))

    def run(self) -> None:
        """All steps in one call, which calls back."""
        self.mujoco.set_mjcb_control(self._control)
        try:
            super().run()
        finally:
            self.mujoco.set_mjcb_control(None)

    def _control(self, model: Any, data: Any) -> None:
        q, v = data.qpos[self.order], data.qvel[self.order]
        if self._calls % self.evaluations == 0:
            tick = self._calls // self.evaluations
            self._trace[tick] = q
            self._motor = self._controller.torque(tick, q, v)
        self._calls += 1
        data.qfrc_applied[self.order] = self._motor + self._plant.passive_torque(q, v)

    def angles(self) -> np.ndarray | None:
        """Coordinates at every tick; None on the treadmill, where MuJoCo's contacts make another motion."""
        return self._trace if self.problem.world.contact is None else None


class RolloutSession(MujocoSession):
    """``mujoco.rollout``: many open-loop episodes on threads."""

    def __init__(
        self, case: Case, ticks: int, *, episodes: int = BATCH_EPISODES, threads: int = THREADS
    ) -> None:
        """Make the pool and room for the states.

        Args:
            case: The case.
            ticks: Length of every episode.
            episodes: How many.
            threads: How many work at once.
        """
        super().__init__(case, ticks)
        self._pool = importlib.import_module("mujoco.rollout").Rollout(nthread=threads)
        self._workers = [self.mujoco.MjData(self.model) for _ in range(threads)]
        kind = self.mujoco.mjtState.mjSTATE_FULLPHYSICS
        size = self.mujoco.mj_stateSize(self.model, kind)
        start = np.zeros(size)
        self.mujoco.mj_getState(self.model, self.data, start, kind)
        self._starts = np.tile(start, (episodes, 1))
        self._states = np.ones((episodes, self.steps, size))

    def run(self) -> None:
        """Roll all episodes out."""
        self._pool.rollout(self.model, self._workers, self._starts, nstep=self.steps, state=self._states)


MUJOCO_CONTESTANTS = (
    Contestant("mujoco_bare", "MuJoCo, bare mj_step(nstep) in one call of C", MujocoSession, needs=EXTRA),
    Contestant("mujoco_native", "MuJoCo, control loop as a native callback", NativeSession, needs=EXTRA),
    Contestant(
        "mujoco_python",
        "MuJoCo, plain script's controller as a Python callback",
        PythonSession,
        compiled=False,
        needs=EXTRA,
    ),
    Contestant(
        "mujoco_rollout",
        f"MuJoCo rollout, {BATCH_EPISODES} open-loop episodes on {THREADS} threads",
        RolloutSession,
        episodes=BATCH_EPISODES,
        needs=EXTRA,
    ),
)
