"""Reference engine, which runs the steps of a tick as plain Python.

The steps and laws are those of the compiled engine. Pinocchio computes the dynamics, and state machines of
the package `transitions` choose the phases of the legs.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twin_gait.control.controller import checked
from twin_gait.control.gait_controller import ControllerState
from twin_gait.core.guards import NO_TRANSITION
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.kernels.pinocchio import PinocchioKernel
from twin_gait.simulation.binding import bind, is_ours, kernel_functions
from twin_gait.simulation.compiled_engine import laid_out
from twin_gait.simulation.engine import SWITCHES, EpisodeEngine
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.record import float_in
from twin_gait.simulation.schedule import run_ticks


class ReferenceEngine(EpisodeEngine):
    """Engine that runs one simulation setup from start to end as plain Python.

    Attributes:
        episode: Record as a tree of plain objects, which the loop changes.
        machines: State machine of each leg.
    """

    chunk_ticks = 100

    def __init__(self, problem: Problem, kernel: Mapping[str, Callable[..., Any]] | None = None) -> None:
        """Build the record and the state machines at tick 0.

        ``kernel``: functions of the dynamics by the names of :mod:`twin_gait.simulation.interface`, by
        default those of Pinocchio.
        """
        super().__init__(problem)
        _, self.episode, structure = laid_out(problem)
        self.state = self.episode
        starts = problem.world.initial_phases
        self.machines = [
            GaitStateMachine(problem.table, side, initial_phase=starts[side], program=problem.program)
            for side in problem.sides
        ]
        self.switches = np.zeros(self.episode.recording.most_switches, SWITCHES).view(np.recarray)
        self._noise = problem.noise.tolist()
        kernel = PinocchioKernel(problem.world, problem.control_model).functions if kernel is None else kernel
        rows = (self.log_row, self.switch_row, self.noise_row)
        names = {**structure, **kernel, **kernel_functions(self.layout.writer, {})}
        names |= {item.__name__: item for item in (*rows, self.choose_transition)}
        for name, tick in problem.controller.functions().items():
            names[name] = tick if is_ours(tick) else checked(problem.controller.name, tick, float_in)
        self._run_ticks = bind(run_ticks, names)

    def run_ticks(self, first: int, end: int, rows: np.ndarray, first_row: int = 0) -> int:
        """Run ticks; see :meth:`EpisodeEngine.run_ticks`."""
        self._rows, self._first_row = rows, first_row
        return int(self._run_ticks(self.episode, first, end))

    # ------------------------------------------------------------------ functions that the steps are bound to

    def choose_transition(self, controller: ControllerState, number: int) -> None:
        """Choose the transition that the machine of a leg takes in this tick, or ``NO_TRANSITION``."""
        legs, machine = controller.legs, self.machines[number]
        tick = legs[number].entry_tick + legs[number].ticks
        other = legs[1 - number].before if len(legs) == 2 else -1
        if legs[number].entry_tick != machine.entry_tick:  # the supervisor has set a posture
            machine.enter(machine.table.phase_names[legs[number].before], legs[number].entry_tick)
        switch = machine.advance(tick, controller.signals, other)
        legs[number].chosen = NO_TRANSITION if switch is None else switch.transition

    def log_row(self, e: Episode, tick: int) -> Any:
        """Return the row of the log for a tick."""
        return self._rows[tick - self._first_row]

    def switch_row(self, e: Episode, number: int) -> Any:
        """Return the entry of the buffer for the switch with a number."""
        return self.switches[number]

    def noise_row(self, e: Episode, tick: int) -> Any:
        """Return the noise of a tick."""
        return self._noise[tick % len(self._noise)]
