"""Chains of any number of links, to see how the cost of forward dynamics grows."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pinocchio as pin

from twin_gait.leg_model.bodies import export_bodies
from twin_gait.simulation.compiling import register_core
from twin_gait.simulation.kernel import body_values, write_dynamics

CALLS = 2000  # evaluations of the dynamics in one run
SEED = 20240607
# MuJoCo would else merge links and mend inertias that it finds odd.
COMPILER = (
    '<mujoco><compiler fusestatic="false" balanceinertia="false" boundmass="0" boundinertia="0"/></mujoco>'
)


def chain_urdf(joints: int, more: str = "") -> str:
    """Equal links in a vertical plane, hanging from the world, with more elements after them."""
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
    return "".join([*parts, more, "</robot>"])


class Chain:
    """A chain in a fixed random state; what evaluates its dynamics is left to others."""

    def __init__(self, joints: int) -> None:
        """Draw the state."""
        self.joints = joints
        self.reset()

    def reset(self) -> None:
        """Back to the state."""
        generator = np.random.default_rng(SEED)
        self.q, self.v = generator.uniform(-1.0, 1.0, (2, self.joints))
        self.torque = generator.uniform(-5.0, 5.0, self.joints)

    def angles(self) -> np.ndarray | None:
        """No motion that is compared."""
        return None


class KernelChain(Chain):
    """The kernel that this package writes for the chain, in a compiled loop."""

    def __init__(self, joints: int) -> None:
        """Write and compile the kernel; a long chain's calls the loops of core."""
        register_core()
        bodies = export_bodies(pin.buildModelFromXML(chain_urdf(joints)))
        names: dict[str, Any] = {"math": math}
        exec(compile(write_dynamics(bodies, (), "z"), "kernel", "exec"), names)
        dynamics = numba.njit(error_model="numpy")(names["dynamics"])
        no_ground, room = np.zeros(5), np.zeros((1, 3))
        self._values, self.acceleration = np.array(body_values(bodies)), np.zeros(joints)

        @numba.njit(error_model="numpy")
        def loop(q: Any, v: Any, torque: Any, values: Any, ground: Any, a: Any, points: Any, n: int) -> None:
            for _ in range(n):
                dynamics(q, v, torque, values, 9.81, ground, a, points)
                # A state that does not move would let the compiler evaluate it once.
                q[0] += 1e-300 * a[0]

        self._loop, self._rest = loop, (no_ground, self.acceleration, room)
        super().__init__(joints)
        self._loop(self.q, self.v, self.torque, self._values, *self._rest, 1)

    def run(self) -> None:
        """Evaluate."""
        self._loop(self.q, self.v, self.torque, self._values, *self._rest, CALLS)


class PinocchioChain(Chain):
    """``pin.aba`` called from Python."""

    def __init__(self, joints: int) -> None:
        """Build the model."""
        self._model = pin.buildModelFromXML(chain_urdf(joints))
        self._data = self._model.createData()
        super().__init__(joints)

    def run(self) -> None:
        """Evaluate."""
        for _ in range(CALLS):
            self.acceleration = pin.aba(self._model, self._data, self.q, self.v, self.torque)


class MujocoChain(Chain):
    """Bare steps of MuJoCo, which add an integration to every evaluation."""

    def __init__(self, joints: int) -> None:
        """Build the model with all that is not used off."""
        import mujoco

        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_string(chain_urdf(joints, COMPILER))
        bits = mujoco.mjtDisableBit
        self._model.opt.disableflags = int(bits.mjDSBL_CONSTRAINT) | int(bits.mjDSBL_CONTACT)
        self._model.opt.timestep = 1e-6
        self._data = mujoco.MjData(self._model)
        super().__init__(joints)

    def reset(self) -> None:
        """Back to the state."""
        super().reset()
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:], self._data.qfrc_applied[:] = self.q, self.v, self.torque

    @property
    def acceleration(self) -> np.ndarray:
        """Of the start."""
        self.reset()
        self._mujoco.mj_forward(self._model, self._data)
        return np.array(self._data.qacc)

    def run(self) -> None:
        """Step."""
        self._mujoco.mj_step(self._model, self._data, nstep=CALLS)


CHAINS: dict[str, Callable[[int], Any]] = {
    "kernel": KernelChain,
    "pin.aba": PinocchioChain,
    "mj_step": MujocoChain,
}
