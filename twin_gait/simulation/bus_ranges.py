"""Which values of an experiment the messages of its CAN network cannot say."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.experiment.control import ControlParameters
from twin_gait.network.dbc import Message
from twin_gait.parameters import ImpedancePlace
from twin_gait.simulation.problem import ActuatedJoint, Problem

_SETPOINTS = {"stiffness": "Nm/rad", "damping": "Nms/rad", "equilibrium": "rad", "gain": ""}  # as in a row


class _Said(NamedTuple):
    """A value that has to go over the bus."""

    key: str
    value: float
    unit: str
    message: str
    signal: str

    def refusal(self, low: float, high: float) -> str:
        """Why it cannot be said in the range of its signal, and the way out."""
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{self.key}: {self.value:.6g}{unit} is outside {low:.6g} to {high:.6g}{unit}, the range of "
            f"{self.message}.{self.signal}; take a value within it, or a DBC file with a wider one"
        )


def values_out_of_range(problem: Problem, messages: Mapping[str, Message]) -> list[str]:
    """Values of an experiment that lie outside the ranges of the signals that carry them.

    Limits of torque and current with what the monitor trips at, damping of the hold, target torques, k, b, θ0
    and G of every phase as they are driven, and the ends of the joints.

    ``messages``: from :func:`twin_gait.network.dbc.load_messages`. Returns a line for each: key, value, range
    and the way out; none if the bus carries the experiment.
    """
    found: dict[str, str] = {}  # by key: two legs have one
    for item in _said(problem):
        low, high = messages[item.message].bounds(item.signal)
        if not low <= item.value <= high:
            found.setdefault(item.key, item.refusal(low, high))
    return list(found.values())


def _said(problem: Problem) -> Iterator[_Said]:
    for joint in problem.joints:
        yield from _limits(problem.experiment.control, joint)
        ends = problem.world.model.position_limits(joint.side, joint.joint)
        for end, angle in zip(("lower", "upper"), ends, strict=True):
            if math.isfinite(angle):  # one that turns without end has none
                key = f"URDF, {end} limit of the {joint.side} {joint.joint}"
                yield _Said(key, angle, "rad", f"{joint.side}_{joint.joint}_measurement", "angle")
    yield from _setpoints(problem)


def _limits(control: ControlParameters, joint: ActuatedJoint) -> Iterator[_Said]:
    setpoint, measurement = (f"{joint.side}_{joint.joint}_{kind}" for kind in ("setpoint", "measurement"))
    trip = control.safety.current_share * control.limits.current
    for sign in (1.0, -1.0):
        yield _Said("control.limits.torque_Nm", sign * control.limits.torque, "Nm", setpoint, "torque")
        key = "control.limits.current_A times control.safety.current_share"
        yield _Said(key, sign * trip, "A", measurement, "current")
    damping = control.safety.hold_damping
    yield _Said("control.safety.hold_damping_Nms_per_rad", damping, "Nms/rad", setpoint, "damping")
    target = control.target_torque.get(joint.joint, 0.0)
    yield _Said(f"control.target_torque_Nm.{joint.joint}", target, "Nm", setpoint, "torque")


def _setpoints(problem: Problem) -> Iterator[_Said]:
    """Of every phase, as the mode of the controller drives it; springs of the control unit stay there."""
    network = problem.experiment.network
    local = network is not None and network.impedance is ImpedancePlace.CCU
    for number, joint in enumerate(problem.joints):
        leg, place = divmod(number, problem.joints_per_leg)
        columns = problem.phase_rows[leg, :, place * COLUMNS_PER_JOINT : (place + 1) * COLUMNS_PER_JOINT]
        for phase, row in zip(problem.table.phase_names, columns.tolist(), strict=True):
            for (signal, unit), value in zip(_SETPOINTS.items(), row, strict=True):
                if local and signal in ("stiffness", "damping"):
                    continue
                key = f"table.phases.{phase}.{joint.joint}: {signal}"
                yield _Said(key, value, unit, f"{joint.side}_{joint.joint}_setpoint", signal)
