"""A wearer's own gait: impedances by phase that move the joints without a drive.

Muscles act as springs and dampers whose stiffness, damping and equilibrium angle change with the phase of the
gait, as the virtual springs of a gait table do. They act without delay; the wearer notices angles and loads,
on which the phases depend, later.
"""

from dataclasses import dataclass

from twin_gait.core.control_tick import ImpedanceSetpoint
from twin_gait.core.estimation import DelayLine
from twin_gait.core.guards import GuardProgram
from twin_gait.core.impedance import impedance_torque


@dataclass(slots=True)
class OwnJoint:
    """State of a joint of the wearer in the wearer's own gait."""

    index: int  # Index of the joint in the coordinates of the device.
    highest_torque: float  # Largest torque of the muscles in [N·m]; 0 for a joint that a drive moves.
    setpoints: list[ImpedanceSetpoint]  # Impedance of every phase.
    blend_start: ImpedanceSetpoint  # Blended impedance at the last change of phase.
    blended: ImpedanceSetpoint  # Impedance of this tick.
    angle_line: DelayLine  # Delay line of the angle that the wearer perceives, in [rad].
    velocity_line: DelayLine  # Delay line of the velocity that the wearer perceives, in [rad/s].
    angle: float = 0.0  # Perceived angle in [rad].
    velocity: float = 0.0  # Perceived velocity in [rad/s].


@dataclass(slots=True)
class OwnLeg:
    """State of a leg of the wearer in the wearer's own gait."""

    phase: int  # Present phase.
    debounce: list[int]  # Consecutive ticks with a true guard, for each transition.
    blend_ticks: list[int]  # Blending time of the impedances of each phase in ticks.
    load_line: DelayLine  # Delay line of the load that the wearer perceives.
    load: float = 0.0  # Perceived load of the foot as a fraction of body weight.
    start_phase: int = 0  # Phase at the start of the tick.
    entry_tick: int = 0  # Tick in which the phase was entered.
    ticks: int = 0  # Number of ticks since the phase was entered.


@dataclass(slots=True)
class OwnGait:
    """State of the wearer's own gait."""

    joints: list[OwnJoint]  # Joints of the wearer's table, leg by leg.
    legs: list[OwnLeg]  # Legs of the wearer.
    program: GuardProgram  # Transitions of the wearer's table with their guards.
    signals: list[float]  # Signals that the guards read: of this leg, of the other leg, of the device.
    blend_law: int  # Law of the blending, one of the ``BLEND_*`` constants.
    first_noise: int  # Index of the noise of the first joint in a row of noise.
    torque: list[float]  # Last torques of the muscles on the coordinates in [N·m]; 0 without muscles.


def muscle_torque(joint: OwnJoint, angle: float, velocity: float) -> float:
    r"""Compute the torque in [N·m] of the muscles on a joint, positive in flexion.

    :math:`\tau = -\left[k\,(\theta - \theta_0) + b\,\omega\right]`, limited to the strength of the muscles.

    ``angle`` in [rad] and ``velocity`` in [rad/s] of the wearer's joint at the same instant.
    """
    setpoint = joint.blended
    torque = impedance_torque(angle, velocity, setpoint.stiffness, setpoint.damping, setpoint.equilibrium)
    return min(max(torque, -joint.highest_torque), joint.highest_torque)
