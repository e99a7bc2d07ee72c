"""What the safety monitor is set to, and faults, as an episode has them."""

import numpy as np

from twin_gait.core.faults import Fault
from twin_gait.core.safety import Bounds
from twin_gait.gait.table import TICK
from twin_gait.parameters.quantities import taken_from
from twin_gait.simulation.problem import ActuatedJoint, Problem
from twin_gait.worlds.faults import Fault as InjectedFault
from twin_gait.worlds.faults import FaultKind

NEVER = int(np.iinfo(np.int64).max)


def fault_records(problem: Problem) -> list[Fault]:
    """Faults of an experiment as :mod:`twin_gait.core.faults` reads them."""
    return [
        Fault(fault.kind.code, _place(problem, fault), ticks(fault.time), float(fault.strength))
        for fault in problem.experiment.faults
    ]


def _place(problem: Problem, fault: InjectedFault) -> int:
    if fault.side is None:
        return -1
    if fault.kind is FaultKind.FOOT_LOAD_STUCK:
        return problem.sides.index(fault.side)
    places = [(joint.side, joint.joint) for joint in problem.joints]
    return places.index((fault.side, fault.joint))  # type: ignore[arg-type]  # checked by the fault


def ticks(time: float) -> int:
    """Whole ticks of a time in [s], one at least but for 0."""
    return 0 if time == 0.0 else max(1, round(time / TICK))


def phase_time_out_ticks(problem: Problem) -> int:
    """Longest time in a phase; no limit where the table drives nothing, or has no way out of a phase."""
    control = problem.experiment.control
    if not problem.controller.by_phases or not problem.table.transitions:
        return NEVER
    return ticks(control.safety.phase_time_out)


def watch_bounds(problem: Problem, joint: ActuatedJoint) -> Bounds:
    """Bounds of the monitor for a joint."""
    control, model = problem.experiment.control, problem.control_model
    settings, motor = control.safety, problem.actuator(joint)
    lower, upper = model.position_limits(joint.side, joint.joint)
    continuous = motor.continuous_torque / (motor.torque_constant * motor.gear_ratio)
    cooling = min(1.0, TICK / settings.thermal_time_constant)
    resistance = motor.resistance + problem.experiment.plant.electronics.inverter_resistance
    fastest = float(model.model.velocityLimit[joint.control_coordinate])  # 0 in a URDF that leaves it open
    return taken_from(
        Bounds,
        settings,
        lower=lower,
        upper=upper,
        highest_speed=settings.speed_share * (fastest if fastest > 0.0 else np.inf),
        stop_distance_factor=0.5 / settings.stopping_deceleration,
        frozen_ticks=ticks(settings.frozen_time),
        model_gain=min(1.0, TICK / settings.model_time_constant),
        highest_torque=control.limits.torque,
        torque_ticks=ticks(settings.torque_time),
        highest_current=settings.current_share * control.limits.current,
        heating=cooling / (continuous * continuous),
        cooling=cooling,
        drive_ticks=ticks(settings.drive_time),
        emf_constant=motor.torque_constant * motor.gear_ratio,
        model_resistance=settings.model_resistance_ratio * resistance,
    )
