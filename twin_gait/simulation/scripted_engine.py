"""Engine of experiments with events: the compiled loop, with changes between ticks as in a live session."""

from collections import deque
from dataclasses import replace

import numpy as np

from twin_gait.experiment.events import Change, Event, Push, Step, Stop
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.engine import EpisodeEngine
from twin_gait.simulation.keeping import OnCompile
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.settings import LoopNumbers, first_settings, loop_numbers, settings_after
from twin_gait.simulation.stepping import SteppedRun


class ScriptedEngine(EpisodeEngine):
    """Engine that runs one simulation setup from start to end, and executes the events of its experiment.

    The numbers of all changes are computed first, so that an invalid change raises an error before the first
    tick. The other engines run experiments without events.
    """

    chunk_ticks = CompiledEngine.chunk_ticks
    scripted = True

    def __init__(self, problem: Problem, *, on_compile: OnCompile = None) -> None:
        """Build the run and the numbers of all changes; see :class:`CompiledEngine` for the arguments."""
        super().__init__(problem)
        plain = replace(problem.experiment, events=())
        self.stepped = SteppedRun(replace(problem, experiment=plain), on_compile=on_compile, spare_faults=0)
        engine = self.stepped.engine
        self.episode, self.state, self.switches = engine.episode, engine.state, engine.switches
        names = (f"{item.side}_{item.joint}" for item in problem.joints)
        self._joints = {name: number for number, name in enumerate(names)}
        self._due: deque[tuple[Event, LoopNumbers]] = deque()
        settings = first_settings(plain)
        numbers: LoopNumbers = self.stepped.numbers
        for event in problem.experiment.events:
            if isinstance(event, Change) and event.changes:
                settings = settings_after(settings, event.changes)
                numbers = loop_numbers(settings)
            self._due.append((event, numbers))

    def run_ticks(self, first: int, end: int, rows: np.ndarray, first_row: int = 0) -> int:
        """Run ticks; see :meth:`EpisodeEngine.run_ticks`."""
        stepped = self.stepped
        while stepped.tick < end and stepped.status is RunStatus.COMPLETED:
            while self._due and self._due[0][0].tick <= stepped.tick:
                self._execute(*self._due.popleft())
            stepped.advance_into(rows, first_row, min(end, self._due[0][0].tick) if self._due else end)
        return stepped.tick

    def _execute(self, event: Event, numbers: LoopNumbers) -> None:
        match event:
            case Change():
                self.stepped.set(numbers, fade_ticks=event.fade_ticks)
            case Push():
                self.stepped.push(self._joints[event.joint], event.torque, event.duration_ticks)
            case Step():
                self.stepped.release()
            case Stop():
                self.stepped.stop()
