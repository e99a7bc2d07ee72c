"""The row of a tick in the log."""

from twin_gait.control.gait_controller import SUPERVISED
from twin_gait.core.arms import Arm
from twin_gait.core.contact import LEAST_FORCE
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import (
    CRUTCHES,
    FORWARD,
    PASSIVE,
    PELVIS,
    PITCH,
    POINTS_PER_FOOT,
    POWERED_ANKLES,
    SEATED,
    SHIFT,
    lanes,
    log_row,
    observe,
)
from twin_gait.simulation.log import CrutchRow, JointRow, LogRow, PassiveRow
from twin_gait.simulation.rooms.motion import acceleration
from twin_gait.simulation.rooms.sensors import normal_force, point_force
from twin_gait.simulation.rooms.surroundings import energy_of_tips


def record(e: Episode, tick: int) -> None:
    """Write everything, at the state before integration."""
    acceleration(e, tick * e.rates.period, False)
    for number in range(len(e.joints)):
        for one in lanes(e):
            _record_joint(one, number, log_row(one, tick).joints[number])
    if PASSIVE:
        for number in range(len(e.passive)):
            for one in lanes(e):
                _record_passive(one, number, log_row(one, tick).passive[number])
    for number in range(len(e.controller.legs)):
        for one in lanes(e):
            _record_leg(one, number, log_row(one, tick))
    for one in lanes(e):
        _record_whole(one, log_row(one, tick))


def _record_whole(e: Episode, row: LogRow) -> None:
    kinetic, potential, force, moment = observe(e.q, e.v, e.a, e.bodies, e.gravity, e.points)
    if PELVIS >= 0:
        pelvis, hung = row.pelvis, e.plant[PELVIS + SHIFT]
        pelvis.pelvis_height = e.q[PELVIS]
        pelvis.pelvis_velocity = e.v[PELVIS]
        pelvis.support_force = hung.spring_torque + hung.stop_torque
        pelvis.guide_force = force
        pelvis.guide_moment = moment
    if FORWARD >= 0:
        row.forward.pelvis_forward = e.q[FORWARD]
        row.forward.pelvis_forward_velocity = e.v[FORWARD]
    if PITCH >= 0:
        row.trunk.trunk_pitch = e.q[PITCH]
        row.trunk.trunk_pitch_velocity = e.v[PITCH]
        row.trunk.measured_trunk_pitch = e.controller.common.trunk_pitch
    if CRUTCHES > 0:
        of_tips = energy_of_tips(e)
        kinetic += of_tips[0]
        potential += of_tips[1]
        for number in range(CRUTCHES):
            _record_crutch(e, e.arms[number], row.crutches[number])
    if SEATED:
        row.seat.seat_force = e.seat.normal
        row.seat.seat_friction_force = e.seat.friction
        row.seat.seat_forward = e.seat.forward
    row.bus_voltage = e.supply.bus_voltage
    row.battery_power = e.supply.power
    row.kinetic_energy = kinetic
    row.potential_energy = potential
    row.works.motor_work = e.works.motor_work
    row.works.friction_work = e.works.friction_work
    row.works.stop_work = e.works.stop_work
    row.works.spring_work = e.works.spring_work
    row.works.contact_work = e.works.contact_work
    row.works.patient_work = e.works.patient_work
    row.safety_state = 1.0 if e.controller.trip.tick >= 0 else 0.0
    row.trip_cause = float(e.controller.trip.cause)
    if SUPERVISED:
        supervisor = e.controller.supervisor
        row.supervisor.mode = float(supervisor.mode)
        row.supervisor.request = float(supervisor.request)
        row.supervisor.refused = float(supervisor.refused)
    if SHIFT > 0:
        _record_braces(e, row)


def _record_crutch(e: Episode, arm: Arm, out: CrutchRow) -> None:
    out.crutch_forward = e.q[arm.place]
    out.crutch_height = e.q[arm.place + 1]
    out.crutch_normal_force = arm.tip.upward
    out.crutch_friction_force = arm.tip.forward
    out.arm_push = arm.push
    out.shoulder_moment = arm.moment
    out.arm_power = arm.power


def _record_joint(e: Episode, number: int, out: JointRow) -> None:
    joint = e.joints[number]
    place, encoder, asked = joint.place, joint.board.encoder, joint.board.command
    out.angle = e.q[place]
    out.velocity = e.v[place]
    out.measured_angle = encoder.angle
    out.velocity_fast = encoder.velocity_fast
    out.velocity_slow = encoder.velocity_slow
    out.impedance_torque = asked.impedance
    out.friction_compensation_torque = asked.friction
    out.gravity_compensation_torque = asked.gravity
    out.inertia_compensation_torque = asked.inertia
    out.target_torque = asked.target
    out.motor_command_torque = asked.torque
    out.motor_torque = e.motor[place]
    out.friction_torque = e.plant[place].friction_torque
    out.stop_torque = e.plant[place].stop_torque
    imposed = e.imposed_motion.torque if e.imposed_motion.place == place else 0.0
    out.patient_torque = imposed + e.external[place]
    if SHIFT > 0:
        out.patient_torque += e.external[place + SHIFT]
    out.target_current = asked.target_current
    out.measured_current = joint.current
    out.stiffness = asked.stiffness
    out.damping = asked.damping
    out.equilibrium = asked.equilibrium
    out.friction_compensation_gain = asked.gain


def _record_passive(e: Episode, number: int, out: PassiveRow) -> None:
    place = e.passive[number]
    out.angle = e.q[place]
    out.velocity = e.v[place]
    out.orthosis_torque = e.plant[place].spring_torque


def _record_leg(e: Episode, number: int, row: LogRow) -> None:
    row.phases[number] = float(e.controller.legs[number].phase)
    if POWERED_ANKLES:
        row.orthoses[number].orthosis_torque = e.plant[e.ankles[number]].spring_torque
    if POINTS_PER_FOOT > 0:
        foot, first = row.feet[number], number * POINTS_PER_FOOT
        friction, pressed, lowest = 0.0, 0.0, e.points[first].height
        for place in range(first, first + POINTS_PER_FOOT):
            along, normal = point_force(e, place)
            friction += along
            pressed += normal * (place - first)
            lowest = min(lowest, e.points[place].height)
        foot.normal_force = normal_force(e, number)
        foot.friction_force = friction
        foot.clearance = lowest
        loaded = foot.normal_force > LEAST_FORCE and POINTS_PER_FOOT > 1
        foot.pressure_place = pressed / (foot.normal_force * (POINTS_PER_FOOT - 1)) if loaded else 0.0


def _record_braces(e: Episode, row: LogRow) -> None:
    """Write the wearer's own motion and the torque of the device on them; the pelvis comes last."""
    row.brace_work.brace_work = e.brace_work
    for number in range(len(row.braces)):
        place, out = e.braced[number], row.braces[number]
        out.wearer_angle = e.q[place + SHIFT]
        out.wearer_velocity = e.v[place + SHIFT]
        out.brace_torque = e.braces[place].torque
    if PELVIS >= 0:
        row.pelvis_brace.wearer_pelvis_height = e.q[PELVIS + SHIFT]
        row.pelvis_brace.wearer_pelvis_velocity = e.v[PELVIS + SHIFT]
        row.pelvis_brace.pelvis_brace_force = e.braces[PELVIS].torque
    if FORWARD >= 0:
        row.forward_brace.wearer_pelvis_forward = e.q[FORWARD + SHIFT]
        row.forward_brace.wearer_pelvis_forward_velocity = e.v[FORWARD + SHIFT]
        row.forward_brace.pelvis_forward_brace_force = e.braces[FORWARD].torque
