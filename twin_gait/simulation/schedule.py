"""Schedule of a tick: sensors, then monitor, decisions and commands, then drives, log and motion.

The part between sensors and drives is the schedule of the device
(:mod:`twin_gait.control.device_schedule`), with additional steps for network, faults and log.
"""

import math

from twin_gait.control import device_schedule as device
from twin_gait.control.gait_controller import run_supervisor
from twin_gait.control.joint_board import check_command, reject_command, write_measurement
from twin_gait.core.schedule import (
    BlockStep,
    feet,
    joints,
    legs,
    limbs,
    own_joints,
    replace_steps,
    scalar_branch,
    scalar_steps,
    wearer_legs,
    when,
)
from twin_gait.simulation import build_flags
from twin_gait.simulation.build_flags import N_CRUTCHES, PELVIS_INDEX, PITCH_INDEX, WEARER_OFFSET
from twin_gait.simulation.episode import COMPLETED, CRUTCH_LOST, DIVERGED, FELL, TIPPED, Episode
from twin_gait.simulation.executors import ScheduleNames, lane_driver, scalar_driver
from twin_gait.simulation.stages import (
    commands,
    drives,
    environment,
    motion,
    network,
    own_gait,
    phases,
    sensors,
)

SENSE = (
    environment.update_commands,  # belt, command to walk, request of a mode
    *replace_steps(
        device.MEASURE, {device.measure_position: (sensors.read_encoder, device.measure_position)}
    ),
    when("N_POINTS_PER_FOOT > 0", sensors.compute_contact_forces, feet(sensors.read_load)),
    when("PITCH_INDEX >= 0 and has_inertial_unit", sensors.measure_pitch),
    sensors.read_trunk,
)

RECEIVE = (
    when(
        "WITH_NETWORK and tick > 0",
        scalar_steps(network.reboot, joints(network.receive_measurement)),
        otherwise=(joints(write_measurement), when("N_POINTS_PER_FOOT > 0", legs(network.receive_foot_load))),
    ),
    network.receive_bus_voltage,
)

CONTROL = (
    device.MONITOR_DRIVES,
    *RECEIVE,
    *replace_steps(
        device.DECIDE,
        {
            run_supervisor: (run_supervisor, environment.withhold_step),
            device.apply_transition: (phases.note_switch, device.apply_transition),
            device.apply_posture: (phases.note_posture, device.apply_posture),
        },
    ),
    *replace_steps(
        device.COMMAND,
        {
            device.copy_setpoint_to_board: when(
                "WITH_NETWORK", network.receive_setpoint, otherwise=(device.copy_setpoint_to_board,)
            ),
            check_command: (when("WITH_FAULTS", commands.add_runaway_torque), check_command),
            # With a bus, which is slow, each board holds only its own joint.
            device.HOLD: when(
                "WITH_NETWORK", scalar_branch(device.is_implausible, reject_command), otherwise=(device.HOLD,)
            ),
            device.command_current: commands.set_drive,
        },
    ),
)

OWN_GAIT = (
    own_joints(own_gait.perceive_joint),
    wearer_legs(own_gait.perceive_leg),
    wearer_legs(own_gait.change_phase),
    own_joints(own_gait.blend_impedance),
)

ACT = (
    drives.begin_power,
    joints(drives.drive),
    drives.draw_power,
    when(
        "WITH_NETWORK",
        scalar_steps(joints(network.send_frames), network.carry_frames, joints(network.store_frames)),
    ),
    when("has_wearer_torques", limbs(environment.reset_external_torque)),
    joints(environment.push),
    when("has_wearer_torques", wearer_legs(environment.add_wearer_torques)),
    when("WITH_OWN_GAIT", scalar_steps(OWN_GAIT)),
    when("N_CRUTCHES > 0", scalar_steps(environment.update_arms)),
    when("WITH_SEAT", environment.place_chair),
    environment.lock_harness,
    when(
        "recording",
        BlockStep(motion.evaluate),
        joints(motion.sum_external_torque),
        when("N_POINTS_PER_FOOT > 0", feet(motion.sum_ground_forces)),
        motion.observe_energies,
        motion.write_log,
    ),
    drives.update_bus_voltage,
    BlockStep(motion.integrate),
)


def update_status(e: Episode) -> bool:
    """Write the status of an episode, and return whether the episode ends with this tick."""
    status = compute_status(e)
    e.status = status
    return status != COMPLETED


def compute_status(e: Episode) -> int:
    """Return the status of an episode: ``COMPLETED`` unless the wearer fell or the state diverged."""
    status = COMPLETED
    if PELVIS_INDEX >= 0 and e.q[PELVIS_INDEX + WEARER_OFFSET] < e.fall_height:
        status = FELL
    if PITCH_INDEX >= 0 and abs(e.q[PITCH_INDEX + WEARER_OFFSET]) > e.fall_pitch:
        status = TIPPED
    if N_CRUTCHES > 0:
        for number in range(N_CRUTCHES):
            if e.arms[number].length > e.max_reach:
                status = CRUTCH_LOST
    for i in range(len(e.q)):
        if not (math.isfinite(e.q[i]) and abs(e.v[i]) < e.diverged_velocity):
            status = DIVERGED
    return status


NAMES = ScheduleNames(
    arguments={
        "e": "{e}",
        "tick": "tick",
        "number": "number",
        "rates": "{e}.rates",
        "limits": "{e}.limits",
        "watching": "{e}.watching",
        "controller": "{e}.controller",
        "joint": "{e}.joints[number]",
        "board": "{e}.joints[number].board",
        "reading": "{e}.joints[number].reading",
        "leg": "{e}.controller.legs[number]",
        "measurement": "{e}.controller.joints[number].measurement",
    },
    counts={
        "joints": "len({e}.joints)",
        "legs": "len({e}.controller.legs)",
        "feet": "len({e}.feet)",
        "limbs": "len({e}.limbs)",
        "wearer_legs": "len({e}.feet)",
        "own_joints": "len({e}.own_gait.joints)",
    },
    fields={
        "tick": "tick",
        "decimation": "{e}.rates.decimation",
        "watching": "{e}.watching",
        "has_wearer_torques": "{e}.has_wearer_torques",
        "has_inertial_unit": "{e}.has_inertial_unit",
        "recording": "{e}.recording.on",
    },
    flags={**device.FLAGS, **build_flags.FLAGS},
)
sense = scalar_driver("sense", SENSE, NAMES)
control = scalar_driver("control", CONTROL, NAMES)
act = scalar_driver("act", ACT, NAMES, result=update_status)
# In a block each episode counts its own ticks, because environments for learning begin at different times.
LANE_NAMES = NAMES._replace(
    arguments={**NAMES.arguments, "tick": "tick - {e}.first_tick"}, of_block={"tick": "tick"}
)
# Replacements of the drivers in the loop over a block of episodes.
LANE_DRIVERS = {
    "sense": lane_driver("sense", SENSE, LANE_NAMES),
    "control": lane_driver(
        "control",
        replace_steps(CONTROL, {device.choose_transition: BlockStep(phases.choose_transitions)}),
        LANE_NAMES,
    ),
    "act": lane_driver("act", ACT, LANE_NAMES, result=update_status),
}


def run_ticks(e: Episode, first: int, end: int) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the wearer falls or the state diverges.

    ``e``: the episode, or a block of episodes in lockstep. Returns the number of ticks since the start;
    ``e.status`` has the status after them.
    """
    for tick in range(first, end):
        sense(e, tick)
        control(e, tick)
        if act(e, tick):
            return tick + 1
    return end
