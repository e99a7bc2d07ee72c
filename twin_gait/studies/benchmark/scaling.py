"""How the cost grows: forward dynamics with the number of joints, episodes with the size of a batch."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
import pinocchio as pin

from twin_gait.leg_model.bodies import export_bodies
from twin_gait.simulation.kernel import body_values, write_dynamics
from twin_gait.studies.benchmark.contestant import Session
from twin_gait.studies.benchmark.engines import BatchSession
from twin_gait.studies.benchmark.measurement import Entry, Timing, time_in_turn
from twin_gait.studies.benchmark.mujoco import RolloutSession
from twin_gait.studies.benchmark.subjects import cases_of
from twin_gait.studies.validation.mujoco_witness import _COMPILER, import_mujoco

JOINTS, QUICK_JOINTS = (2, 4, 7, 12, 20, 30), (2, 4, 7)
EPISODES, QUICK_EPISODES = (1, 10, 100, 1000), (1, 10, 100)
WORKERS = (1, 2)
CALLS = 2000  # evaluations of the dynamics in one run
EPISODE_TICKS = 1000
SEED = 20240607


def chain_urdf(joints: int) -> str:
    """A chain of equal links in a vertical plane, hanging from the world.

    Args:
        joints: Number of revolute joints.

    Returns:
        URDF.
    """
    link = (
        '<link name="link{0}"><inertial><origin xyz="0.01 0 -0.18"/><mass value="4"/>'
        '<inertia ixx="0.06" ixy="0" ixz="0.001" iyy="0.06" iyz="0" izz="0.01"/></inertial></link>'
    )
    joint = (
        '<joint name="joint{0}" type="revolute"><parent link="link{1}"/><child link="link{0}"/>'
        '<origin xyz="0 0 {2}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="100" velocity="10"/></joint>'
    )
    parts = ['<robot name="chain"><link name="link0"/>']
    for number in range(1, joints + 1):
        height = 0.0 if number == 1 else -0.4
        parts.append(link.format(number))
        parts.append(joint.format(number, number - 1, height))
    return "".join([*parts, "</robot>"])


class _State:
    """A fixed random state of a chain."""

    def __init__(self, joints: int) -> None:
        generator = np.random.default_rng(SEED)
        self.q, self.v = generator.uniform(-1.0, 1.0, joints), generator.uniform(-1.0, 1.0, joints)
        self.torque = generator.uniform(-5.0, 5.0, joints)


class KernelSession:
    """The kernel that this package writes for the chain, in a compiled loop."""

    def __init__(self, joints: int) -> None:
        """Write and compile the kernel.

        Args:
            joints: Length of the chain.
        """
        bodies = export_bodies(pin.buildModelFromXML(chain_urdf(joints)))
        names: dict[str, Any] = {"math": math}
        exec(compile(write_dynamics(bodies, (), "z"), "kernel", "exec"), names)
        dynamics = numba.njit(error_model="numpy")(names["dynamics"])
        no_ground, room = np.zeros(5), np.zeros((1, 3))
        self._values, self.acceleration = np.array(body_values(bodies)), np.zeros(joints)

        @numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
        def loop(q: Any, v: Any, torque: Any, values: Any, ground: Any, a: Any, points: Any, n: int) -> None:
            for _ in range(n):
                dynamics(q, v, torque, values, 9.81, ground, a, points)
                # A state that does not move would let the compiler evaluate it once.
                q[0] += 1e-300 * a[0]

        self._loop, self._rest = loop, (no_ground, self.acceleration, room)
        self.reset()
        self._loop(self._state.q, self._state.v, self._state.torque, self._values, *self._rest, 1)

    def reset(self) -> None:
        """Back to the state."""
        self._state = _State(len(self.acceleration))

    def run(self) -> None:
        """Evaluate."""
        state = self._state
        self._loop(state.q, state.v, state.torque, self._values, *self._rest, CALLS)

    def angles(self) -> np.ndarray | None:
        """No motion."""
        return None


class PinocchioSession:
    """``pin.aba`` called from Python."""

    def __init__(self, joints: int) -> None:
        """Build the model.

        Args:
            joints: Length of the chain.
        """
        self._model = pin.buildModelFromXML(chain_urdf(joints))
        self._data, self._state = self._model.createData(), _State(joints)
        self.acceleration = np.zeros(joints)

    def reset(self) -> None:
        """Nothing moves."""

    def run(self) -> None:
        """Evaluate."""
        model, data, state = self._model, self._data, self._state
        for _ in range(CALLS):
            self.acceleration = pin.aba(model, data, state.q, state.v, state.torque)

    def angles(self) -> np.ndarray | None:
        """No motion."""
        return None


class MujocoChainSession:
    """Bare steps of MuJoCo, which add an integration to every evaluation."""

    def __init__(self, joints: int) -> None:
        """Build the model with all that is not used off.

        Args:
            joints: Length of the chain.
        """
        self._mujoco = import_mujoco()
        text = chain_urdf(joints).replace("</robot>", f"{_COMPILER}</robot>")
        self._model = self._mujoco.MjModel.from_xml_string(text)
        bits = self._mujoco.mjtDisableBit
        self._model.opt.disableflags = int(bits.mjDSBL_CONSTRAINT) | int(bits.mjDSBL_CONTACT)
        self._model.opt.timestep = 1e-6
        self._data, self._start = self._mujoco.MjData(self._model), _State(joints)
        self.reset()

    def reset(self) -> None:
        """Back to the state."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = self._start.q, self._start.v
        self._data.qfrc_applied[:] = self._start.torque

    @property
    def acceleration(self) -> np.ndarray:
        """Of the start."""
        self.reset()
        self._mujoco.mj_forward(self._model, self._data)
        return np.array(self._data.qacc)

    def run(self) -> None:
        """Step."""
        self._mujoco.mj_step(self._model, self._data, nstep=CALLS)

    def angles(self) -> np.ndarray | None:
        """No motion that is compared."""
        return None


CHAINS: dict[str, Callable[[int], Any]] = {
    "kernel": KernelSession,
    "pin_aba": PinocchioSession,
    "mujoco_step": MujocoChainSession,
}


def scale_joints(
    sizes: Sequence[int], rounds: int, *, mujoco: bool, on_run: Callable[[], None] | None = None
) -> list[dict[str, Any]]:
    """Time one evaluation of the forward dynamics of chains.

    Args:
        sizes: Numbers of joints.
        rounds: Rounds that count.
        mujoco: Whether MuJoCo takes part.
        on_run: Called after every run.

    Returns:
        One row per size: joints and times by name.
    """
    kinds = {name: make for name, make in CHAINS.items() if mujoco or not name.startswith("mujoco")}
    rows = []
    for joints in sizes:
        entries = [Entry(name, make(joints), CALLS) for name, make in kinds.items()]
        times = time_in_turn(entries, rounds, on_run)
        rows.append({"joints": joints, "ns_per_evaluation": _documented(times)})
    return rows


def scale_batch(
    sizes: Sequence[int], rounds: int, *, mujoco: bool, on_run: Callable[[], None] | None = None
) -> list[dict[str, Any]]:
    """Time batches of short episodes of the bench leg on one and two threads.

    Args:
        sizes: Numbers of episodes.
        rounds: Rounds that count.
        mujoco: Whether MuJoCo takes part.
        on_run: Called after every run.

    Returns:
        One row per size and number of workers: times of one tick of one episode by name.
    """
    case = cases_of("bench_leg")[0]
    makers: dict[str, Callable[..., Session]] = {"batch": BatchSession}
    if mujoco:
        makers["mujoco_rollout"] = RolloutSession
    rows = []
    for episodes in sizes:
        for workers in WORKERS:
            entries = [
                Entry(
                    name,
                    make(case, EPISODE_TICKS, episodes=episodes, threads=workers),
                    EPISODE_TICKS * episodes,
                )
                for name, make in makers.items()
            ]
            times = time_in_turn(entries, rounds, on_run)
            rows.append({"episodes": episodes, "workers": workers, "ns_per_tick": _documented(times)})
    return rows


def _documented(times: dict[str, Timing]) -> dict[str, Any]:
    return {
        name: {"median": timing.median, "quartiles": list(timing.quartiles)} for name, timing in times.items()
    }
