"""Steps of the wearer's own gait: perception, phases, and impedances of the joints without a drive."""

from twin_gait.control.gait_controller import (
    ANGLE,
    LOAD,
    PER_JOINT,
    PER_LEG,
    STEP,
    TIME_IN_PHASE,
    TRUNK_PITCH,
    VELOCITY,
    WALK,
)
from twin_gait.core.blending import blend_share
from twin_gait.core.control_tick import blend_setpoint, copy_setpoint
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.core.own_gait import muscle_torque
from twin_gait.simulation.backend import noise_row
from twin_gait.simulation.build_flags import WEARER_OFFSET
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.stages.sensors import normal_force, trunk_pitch


def perceive_joint(e: Episode, number: int, tick: int) -> None:
    """Compute angle and velocity of a joint as the wearer perceives them: late, the angle with noise."""
    joint = e.own_gait.joints[number]
    index = joint.index + WEARER_OFFSET
    noise = noise_row(e, tick)[e.own_gait.first_noise + number]
    joint.angle = delayed_sample(joint.angle_line, tick, e.q[index] + noise)
    joint.velocity = delayed_sample(joint.velocity_line, tick, e.v[index])


def perceive_leg(e: Episode, number: int, tick: int) -> None:
    """Compute the delayed load of a foot that the wearer perceives, and store the phase of the leg."""
    leg = e.own_gait.legs[number]
    leg.load = delayed_sample(leg.load_line, tick, normal_force(e, number) / e.body_weight)
    leg.start_phase = leg.phase
    leg.ticks = tick - leg.entry_tick


def change_phase(e: Episode, number: int, tick: int) -> None:
    """Enter the next phase of a leg if one of the exits of its phase is due."""
    own = e.own_gait
    leg = own.legs[number]
    joints_per_leg = len(own.joints) // len(own.legs)
    # Signals of this leg, then those of the other leg, then those of the whole body.
    signals_per_leg = PER_JOINT * joints_per_leg + PER_LEG
    body = 2 * signals_per_leg
    other_phase = -1
    _write_leg(e, number, 0)
    if len(own.legs) == 2:
        _write_leg(e, 1 - number, signals_per_leg)
        other_phase = own.legs[1 - number].start_phase
    own.signals[body + TRUNK_PITCH] = trunk_pitch(e)
    own.signals[body + WALK] = e.controller.device_signals.walk
    own.signals[body + STEP] = e.controller.device_signals.step
    chosen = next_transition(own.program, leg.start_phase, leg.ticks, own.signals, other_phase, leg.debounce)
    if chosen != NO_TRANSITION:
        leg.phase = own.program.transitions[chosen].target
        leg.entry_tick = tick
        for index in range(len(leg.debounce)):
            leg.debounce[index] = 0
        for index in range(number * joints_per_leg, (number + 1) * joints_per_leg):
            copy_setpoint(own.joints[index].blended, own.joints[index].blend_start)


def blend_impedance(e: Episode, number: int, tick: int) -> None:
    """Blend the impedance of a joint towards that of the phase of its leg, until the blending is complete."""
    own = e.own_gait
    joint, leg = own.joints[number], own.legs[number * len(own.legs) // len(own.joints)]
    ticks, since = leg.blend_ticks[leg.phase], tick - leg.entry_tick
    if since <= ticks:
        share = blend_share(1.0 if ticks <= 0 else since / ticks, own.blend_law)
        blend_setpoint(joint.blend_start, joint.setpoints[leg.phase], share, joint.blended)


def add_muscle_torques(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the torques of the muscles to the torques of the wearer's joints."""
    own = e.own_gait
    for number in range(len(own.joints)):
        joint = own.joints[number]
        index = joint.index + WEARER_OFFSET
        own.torque[index] = muscle_torque(joint, q[index], v[index])
        e.torque[index] += own.torque[index]


def _write_leg(e: Episode, number: int, first: int) -> None:
    """Write the perceived signals of a leg into the list of signals, from the index ``first`` on."""
    own = e.own_gait
    count = len(own.joints) // len(own.legs)
    for position in range(count):
        joint = own.joints[number * count + position]
        own.signals[first + PER_JOINT * position + ANGLE] = joint.angle
        own.signals[first + PER_JOINT * position + VELOCITY] = joint.velocity
    behind = first + PER_JOINT * count
    own.signals[behind + LOAD] = own.legs[number].load
    own.signals[behind + TIME_IN_PHASE] = own.legs[number].ticks * e.rates.period
