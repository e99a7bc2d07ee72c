"""The reference walk: path of position tracking, or measure of the tracking error."""

from __future__ import annotations

from twin_gait.control.gait_controller import JOINTS_PER_LEG
from twin_gait.core.assistance import adapted_assistance, cycle_place
from twin_gait.simulation.episode import Episode


def follow(e: Episode, tick: int) -> None:
    """Move the equilibrium angles along the path, and let the dampers move with it."""
    angles, cycle = e.path.angles, e.path.cycle_ticks
    spacing = cycle * e.rates.period / (len(angles) - 1)
    for number, leg in enumerate(e.controller.legs):
        before, share = cycle_place(leg.path_start + tick / cycle, len(angles))
        for position in range(JOINTS_PER_LEG):
            joint = e.controller.joints[number * JOINTS_PER_LEG + position]
            start = angles[before][position]
            change = angles[before + 1][position] - start
            joint.blended.equilibrium = start + share * change
            joint.lead = joint.blended.damping * change / spacing


def track(e: Episode, tick: int) -> None:
    """Sum up the tracking error, and adapt the assistance level at the end of a stride."""
    for number in range(len(e.controller.legs)):
        leg = e.controller.legs[number]
        if tick > 0 and leg.phase == 0 and leg.entry_tick == tick:
            _end_stride(e, number, tick)
        _add_errors(e, number, tick)


def _add_errors(e: Episode, number: int, tick: int) -> None:
    """Add the tracking errors of this tick to those of a leg's stride."""
    leg, angles = e.controller.legs[number], e.path.angles
    progress = (tick - leg.stride_start) / leg.stride_ticks
    if leg.stride_start == 0:
        progress += leg.path_start
    before, share = cycle_place(progress, len(angles))
    for position in range(JOINTS_PER_LEG):
        joint = e.controller.joints[number * JOINTS_PER_LEG + position]
        start = angles[before][position]
        wanted = start + share * (angles[before + 1][position] - start)
        joint.tracking += abs(joint.measurement.angle - wanted)


def _end_stride(e: Episode, number: int, tick: int) -> None:
    """Adapt the assistance level of one leg to the errors of the stride that has ended."""
    leg = e.controller.legs[number]
    duration = tick - leg.stride_start
    for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
        joint = e.controller.joints[place]
        joint.assistance = adapted_assistance(e.path.adaptation, joint.assistance, joint.tracking / duration)
        joint.tracking = 0.0
    if leg.stride_start > 0:  # the first stride may have begun half-way
        leg.stride_ticks = duration
    leg.stride_start = tick
