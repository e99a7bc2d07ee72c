"""Schedule of a tick: sensors, then monitor, decisions and commands, then drives, log and motion.

The part between sensors and drives is the schedule of the device
(:mod:`twin_gait.control.device_schedule`), with additional steps for network, faults and log.
"""

import math

from twin_gait.control import device_schedule as device
from twin_gait.control.joint_board import check, refuse, report
from twin_gait.core.schedule import Block, joints, legs, limbs, one_by_one, rare, replaced, soles, when
from twin_gait.simulation import structure
from twin_gait.simulation.episode import COMPLETED, DIVERGED, FELL, LET_GO, TIPPED, Episode
from twin_gait.simulation.executors import Names, lane_driver, scalar_driver
from twin_gait.simulation.stages import commands, drives, motion, network, phases, sensors, surroundings
from twin_gait.simulation.structure import CRUTCHES, PELVIS, PITCH, SHIFT

SENSE = (
    surroundings.command,  # belt, command to walk, request of a mode
    *replaced(device.MEASURE, {device.measure_position: (sensors.read_encoder, device.measure_position)}),
    when("POINTS_PER_FOOT > 0", sensors.press_soles, soles(sensors.read_load)),
    when("INERTIAL", sensors.measure_pitch),
    sensors.read_trunk,
)

HEAR = (
    when(
        "NETWORKED and tick > 0",
        one_by_one(network.reboot, joints(network.hear_measurement)),
        otherwise=(joints(report), when("POINTS_PER_FOOT > 0", soles(network.hear_sole))),
    ),
    network.hear_supply,
)

THINK = (
    device.WATCH_DRIVES,
    *HEAR,
    *replaced(
        device.DECIDE,
        {
            device.take_transition: (phases.note_switch, device.take_transition),
            device.take_posture: (phases.note_posture, device.take_posture),
        },
    ),
    *replaced(
        device.COMMAND,
        {
            device.take_demand: when("NETWORKED", network.hear_setpoint, otherwise=(device.take_demand,)),
            check: (when("FAULTY", commands.run_away), check),
            # With a bus, which is slow, each board holds only its own joint.
            device.HOLD: when("NETWORKED", rare(device.is_implausible, refuse), otherwise=(device.HOLD,)),
            device.command_current: commands.set_drive,
        },
    ),
)

ACT = (
    drives.begin_power,
    joints(drives.drive),
    drives.draw_power,
    when(
        "NETWORKED",
        one_by_one(joints(network.send_frames), network.carry_frames, joints(network.keep_frames)),
    ),
    when("WEARER", limbs(surroundings.free_limb)),
    joints(surroundings.push),
    when("WEARER", legs(surroundings.push_leg)),
    when("CRUTCHES > 0", one_by_one(surroundings.use_crutches)),
    when("SEATED", surroundings.place_chair),
    surroundings.catch,
    when(
        "recording",
        Block(motion.evaluate),
        joints(motion.sum_up_outside),
        when("POINTS_PER_FOOT > 0", soles(motion.stand)),
        motion.observe_energies,
        motion.write_log,
    ),
    drives.sag,
    Block(motion.integrate),
)


def has_ended(e: Episode) -> bool:
    """Write the status of an episode, and return whether the episode ends with this tick."""
    status = status_of(e)
    e.status = status
    return status != COMPLETED


def status_of(e: Episode) -> int:
    """Return the status of an episode: ``COMPLETED`` unless the wearer fell or the state diverged."""
    status = COMPLETED
    if PELVIS >= 0 and e.q[PELVIS + SHIFT] < e.fall_height:
        status = FELL
    if PITCH >= 0 and abs(e.q[PITCH]) > e.fall_pitch:
        status = TIPPED
    if CRUTCHES > 0:
        for number in range(CRUTCHES):
            if e.arms[number].length > e.longest_reach:
                status = LET_GO
    for i in range(len(e.q)):
        if not (math.isfinite(e.q[i]) and abs(e.v[i]) < e.diverged_velocity):
            status = DIVERGED
    return status


NAMES = Names(
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
        "soles": "len({e}.soles)",
        "limbs": "len({e}.limbs)",
    },
    fields={
        "tick": "tick",
        "decimation": "{e}.rates.decimation",
        "watching": "{e}.watching",
        "recording": "{e}.recording.on",
    },
    flags={**device.FLAGS, **structure.FLAGS},
)
sense = scalar_driver("sense", SENSE, NAMES)
think = scalar_driver("think", THINK, NAMES)
act = scalar_driver("act", ACT, NAMES, result=has_ended)
# Replacements of the drivers in the loop over a block of episodes.
IN_LANES = {
    "sense": lane_driver("sense", SENSE, NAMES),
    "think": lane_driver(
        "think", replaced(THINK, {device.choose_transition: Block(phases.choose_in_lanes)}), NAMES
    ),
    "act": lane_driver("act", ACT, NAMES, result=has_ended),
}


def run_ticks(e: Episode, first: int, end: int) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the wearer falls or the state diverges.

    ``e``: the episode, or a block of episodes in lockstep. Returns the number of ticks since the start;
    ``e.status`` has the status after them.
    """
    for tick in range(first, end):
        sense(e, tick)
        think(e, tick)
        if act(e, tick):
            return tick + 1
    return end
