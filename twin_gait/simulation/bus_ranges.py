"""Which values of an experiment the messages of its CAN network cannot say."""

from collections.abc import Iterator, Mapping

from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.network.dbc import Message
from twin_gait.parameters import ImpedancePlace
from twin_gait.simulation.problem import Problem

_SETPOINTS = {"stiffness": "Nm/rad", "damping": "Nms/rad", "equilibrium": "rad", "gain": ""}  # as in a row


def values_out_of_range(problem: Problem, messages: Mapping[str, Message]) -> list[str]:
    """Values of an experiment that lie outside the ranges of the signals that carry them.

    Limits of torque and current with what the monitor trips at, damping of the hold, target torques, k, b,
    θ0 and G of every phase as they are driven.

    ``messages``: from :func:`twin_gait.network.dbc.load_messages`. Returns a line for each: key, value, range
    and the way out; none if the bus carries the experiment.
    """
    found: dict[str, str] = {}  # by key: two legs have one
    for number, joint in enumerate(problem.joints):
        for key, value, unit, kind, signal in _said(problem, number):
            message = f"{joint.side}_{joint.joint}_{kind}"
            low, high = messages[message].bounds(signal)
            if not low <= value <= high:
                unit = f" {unit}".rstrip()
                found.setdefault(
                    key,
                    f"{key}: {value:.6g}{unit} is outside {low:.6g} to {high:.6g}{unit}, the range of "
                    f"{message}.{signal}; take a value within it, or a DBC file with a wider one",
                )
    return list(found.values())


def _said(problem: Problem, number: int) -> Iterator[tuple[str, float, str, str, str]]:
    """What the bus has to say of a joint: key, value, unit, kind of message and signal.

    Springs of the control unit stay there.
    """
    joint, control, network = problem.joints[number], problem.experiment.control, problem.experiment.network
    trip = control.safety.current_share * control.limits.current
    for sign in (1.0, -1.0):
        yield "control.limits.torque_Nm", sign * control.limits.torque, "Nm", "setpoint", "torque"
        key = "control.limits.current_A times control.safety.current_share"
        yield key, sign * trip, "A", "measurement", "current"
    damping = control.safety.hold_damping
    yield "control.safety.hold_damping_Nms_per_rad", damping, "Nms/rad", "setpoint", "damping"
    target = control.target_torque.get(joint.joint, 0.0)
    yield f"control.target_torque_Nm.{joint.joint}", target, "Nm", "setpoint", "torque"
    local = network is not None and network.impedance is ImpedancePlace.CCU
    leg, place = divmod(number, problem.joints_per_leg)
    columns = problem.phase_rows[leg, :, place * COLUMNS_PER_JOINT : (place + 1) * COLUMNS_PER_JOINT]
    for phase, row in zip(problem.table.phase_names, columns.tolist(), strict=True):
        for (signal, unit), value in zip(_SETPOINTS.items(), row, strict=True):
            if not (local and signal in ("stiffness", "damping")):
                yield f"table.phases.{phase}.{joint.joint}: {signal}", value, unit, "setpoint", signal
