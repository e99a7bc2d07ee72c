"""The safety monitor: what boards and gait controller look at in a tick, and the trip on what they find."""

from twin_gait.control.gait_controller import has_cause, trip_on_causes, watch_leg, watch_supply
from twin_gait.control.joint_board import watch_drive
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import each, lanes


def watch_drives(e: Episode) -> None:
    """Let the monitor of each board look at its joint and at the drive's last tick."""
    for number in range(len(e.joints)):
        for one in lanes(e):
            watch_drive(one.joints[number].board, one.rates)


def watch(e: Episode, tick: int) -> None:
    """Let the gait controller look at what it has heard, and at its phases."""
    for one in lanes(e):
        watch_supply(one.controller)
    for number in range(len(e.controller.legs)):
        for one in lanes(e):
            watch_leg(one.controller, one.limits, number, tick)
    found = False
    for one in lanes(e):
        found |= has_cause(one.controller)
    if found:
        for one in each(e):
            trip_on_causes(one.controller, tick)
