"""Reference engine, which runs the steps of a tick as plain Python.

The steps and laws are those of the compiled engine. Pinocchio computes the dynamics, and state machines of
the package `transitions` choose the phases of the legs.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twin_gait.control.controller import wrap_checked_tick
from twin_gait.control.gait_controller import ControllerState
from twin_gait.core.guards import NO_TRANSITION
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.kernels.pinocchio_kernel import PinocchioKernel
from twin_gait.simulation.binding import is_package_function, kernel_functions, specialize
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.engine import SWITCHES, EpisodeEngine
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.record import find_float
from twin_gait.simulation.schedule import run_ticks
from twin_gait.simulation.simulation_setup import SimulationSetup


class ReferenceEngine(EpisodeEngine):
    """Engine that runs one simulation setup from start to end as plain Python.

    Attributes:
        episode: Record as a tree of plain objects, which the loop changes.
        machines: State machine of each leg.
    """

    chunk_ticks = 100

    def __init__(
        self, setup: SimulationSetup, kernel: Mapping[str, Callable[..., Any]] | None = None
    ) -> None:
        """Build the record and the state machines at tick 0.

        ``kernel``: functions of the dynamics by the names of :mod:`twin_gait.simulation.backend`, by
        default those of Pinocchio.
        """
        super().__init__(setup)
        _, self.episode, structure = assemble(setup)
        self.state = self.episode
        phases = setup.table.phase_names
        self.machines = [
            GaitStateMachine(setup.table, side, initial_phase=phases[leg.phase], program=setup.program)
            for side, leg in zip(setup.sides, self.episode.controller.legs, strict=True)
        ]
        self.switches = np.zeros(self.episode.recording.most_switches, SWITCHES).view(np.recarray)
        self._noise = setup.noise.tolist()
        kernel = PinocchioKernel(setup.world, setup.control_model).functions if kernel is None else kernel
        rows = (self.log_row, self.switch_row, self.noise_row)
        names = {**structure, **kernel, **kernel_functions(self.layout.writer, {})}
        names |= {item.__name__: item for item in (*rows, self.choose_transition)}
        for name, tick in setup.controller.tick_functions().items():
            names[name] = (
                tick
                if is_package_function(tick)
                else wrap_checked_tick(setup.controller.name, tick, find_float)
            )
        self._run_ticks = specialize(run_ticks, names)

    def run_ticks(self, first: int, end: int, rows: np.ndarray, first_row: int = 0) -> int:
        """Run ticks; see :meth:`EpisodeEngine.run_ticks`."""
        self._rows, self._first_row = rows, first_row
        return int(self._run_ticks(self.episode, first, end))

    # ------------------------------------------------------------------ functions that the steps are bound to

    def choose_transition(self, controller: ControllerState, number: int) -> None:
        """Choose the transition that the machine of a leg takes in this tick, or ``NO_TRANSITION``."""
        legs, machine = controller.legs, self.machines[number]
        tick = legs[number].entry_tick + legs[number].ticks
        other = legs[1 - number].start_phase if len(legs) == 2 else -1
        if legs[number].entry_tick != machine.entry_tick:  # the supervisor has set a posture
            machine.enter(machine.table.phase_names[legs[number].start_phase], legs[number].entry_tick)
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
