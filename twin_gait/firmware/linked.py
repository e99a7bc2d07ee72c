"""The controller of an experiment as one unit without a bus."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from twin_gait.control.joint_board import Command
from twin_gait.core.guards import GuardProgram
from twin_gait.firmware import units
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import TIME
from twin_gait.gait.table import TICK
from twin_gait.kernels.generated import write_control_gravity, write_control_inertia, write_side_by_side
from twin_gait.simulation.compiled_engine import laid_out
from twin_gait.simulation.problem import Problem


@dataclass(frozen=True)
class LinkedUnit:
    """All that the unit of an experiment is printed from, or bound to."""

    record: units.Exoskeleton  # at tick 0
    inputs: units.ExoskeletonInputs  # of a tick; only their shape is of meaning
    outputs: units.ExoskeletonOutputs  # likewise
    structure: Mapping[str, Any]  # constants and functions of the controller that it is bound to
    kernel: str  # source of the functions of the controller's model


def linked_unit(problem: Problem) -> LinkedUnit:
    """The unit of a problem; angles come to it as counts times the angle of a count."""
    bodies, episode, structure = laid_out(problem, record=False)
    boards = [joint.board for joint in episode.joints]
    for board in boards:
        board.encoder.resolution = 0.0
    controller = episode.controller
    trim(problem.program, controller.program, [leg.debounce for leg in controller.legs])
    part_ticks(controller.program, problem.table.signals)
    if problem.experiment.modes is not None:
        modes = replace(problem.experiment.modes, joints=problem.table.joints)
        trim(compile_guards(modes), controller.supervisor.program, [controller.supervisor.debounce])
        part_ticks(controller.supervisor.program, modes.signals)
    joints, legs = len(boards), len(episode.controller.legs)
    settings = units.Settings(episode.rates, episode.limits, episode.watching)
    inputs = units.ExoskeletonInputs(
        [units.JointBoardInputs() for _ in range(joints)], units.Surroundings([0.0] * legs)
    )
    outputs = units.ExoskeletonOutputs(
        [Command() for _ in range(joints)], units.Decision([0] * legs, [0] * legs)
    )
    texts = [write_control_gravity(bodies.control_bodies, bodies.up_axis)]
    if structure["INERTIA_WANTED"]:
        texts.append(write_control_inertia(bodies.control_bodies))
    kernel = "\n\n".join([*write_side_by_side("".join(texts)), *texts])
    names = {**structure, **problem.controller.functions()}
    return LinkedUnit(units.Exoskeleton(settings, boards, episode.controller), inputs, outputs, names, kernel)


def trim(program: GuardProgram, room: GuardProgram, debounces: Sequence[list[int]]) -> None:
    """Take out, in place, the empty entries with which tables of like size share a compiled loop."""
    count = max(1, len(program.transitions))
    del room.transitions[count:]
    del room.nodes[max(1, len(program.nodes)) :]
    del room.comparisons[max(1, len(program.comparisons)) :]
    for debounce in debounces:
        del debounce[count:]


def part_ticks(program: GuardProgram, signals: Sequence[str]) -> None:
    """Move, in place, thresholds on the time in a phase half-way to the next tick, which changes no result.

    A time of whole ticks that meets its threshold exactly in double numbers need not do so in float.
    """
    for comparison in program.comparisons:
        if comparison.factor_b == 0.0 and signals[comparison.signal_a].endswith(TIME):
            ticks = round(comparison.threshold / TICK)
            ticks -= ticks * TICK > comparison.threshold
            comparison.threshold = (ticks + 0.5) * TICK
