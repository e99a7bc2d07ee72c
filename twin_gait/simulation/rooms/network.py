"""What boards, soles and gait controller tell each other in a tick."""

from __future__ import annotations

from twin_gait.control.gait_controller import hear_load
from twin_gait.control.joint_board import report
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import POINTS_PER_FOOT, lanes


def tell(e: Episode) -> None:
    """Let the gait controller hear of joints, feet and supply."""
    for number in range(len(e.joints)):
        for one in lanes(e):
            report(one.joints[number].board, one.controller.joints[number].measurement)
    if POINTS_PER_FOOT > 0:
        for number in range(len(e.soles)):
            for one in lanes(e):
                hear_load(one.controller, number, one.soles[number].load)
    for one in lanes(e):
        one.controller.supply.voltage = one.supply.bus_voltage
