"""A run that is advanced piece by piece and changed in between, in compiled code.

:func:`twin_gait.simulation.simulate` runs an experiment from start to end. Here the caller holds the clock:
they advance the walk by some ticks, look at the rows of the log, change the parameters of the phases, the
belt or the support, push the leg or inject a fault, and go on. Without a change the rows are those of
``simulate``, bit for bit.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin_gait.control import ControllerFunction, Trip
from twin_gait.core.belt import BELT_CRUISE
from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share
from twin_gait.core.faults import START_TICK
from twin_gait.core.guards import DEBOUNCE_TICKS, SOURCE
from twin_gait.core.plant import CONSTANT_FORCE, STOP_STIFFNESS
from twin_gait.core.safety import OPERATOR_TRIP
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.problem import Problem
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.measures.outcome import RunEvent, run_events
from twin_gait.scenario.faults import Fault, FaultKind
from twin_gait.simulation import episode_arrays
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.engine import EngineResult, log_layout, stopped_reason
from twin_gait.simulation.flat_episode import fields_of
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.watching import NEVER, fault_arrays, phase_time_out_ticks

FADE_TICKS = 300  # over which a change fades in where the caller says nothing
MOST_FAULTS = 16  # that can be injected into one walk
CHUNK_TICKS = 2000  # rows of the log that are made at a time
_UNCHANGING = {"inputs_noise", "inputs_effort_noise", "state_switches"}  # and long


def packed(array: np.ndarray) -> str:
    """An array as text that :func:`unpack` reads, bit for bit; its shape and type are for both to know."""
    return base64.b64encode(array.tobytes()).decode()


def unpack(text: str, array: np.ndarray) -> None:
    """Fill an array from the text of :func:`packed`."""
    array[...] = np.frombuffer(base64.b64decode(text), dtype=array.dtype).reshape(array.shape)


@dataclass
class _Fade:
    """An array on its way from one content to another, by the minimum-jerk law."""

    values: np.ndarray
    start: np.ndarray
    target: np.ndarray
    first: int
    ticks: int

    def reaches(self, tick: int) -> bool:
        """Write the values of a tick; True if the target is reached."""
        progress = 1.0 if self.ticks <= 0 else (tick - self.first + 1) / self.ticks
        share = blend_share(progress, BLEND_MINIMUM_JERK)
        if share >= 1.0:
            self.values[...] = self.target
        else:
            self.values[...] = blend_arrays(self.start, self.target, share)
        return share >= 1.0


def blend_arrays(old: np.ndarray, new: np.ndarray, share: float) -> np.ndarray:
    """Blend element by element, by the law of :func:`twin_gait.core.blending.blend`.

    Args:
        old: Values at the start of the blend, any shape.
        new: Values at its end, the same shape.

    Returns:
        The same shape.
    """
    return blend(old, new, share)  # type: ignore[arg-type,return-value]  # plain arithmetic takes arrays


class SteppedRun:
    """One walk in compiled code that its caller advances and changes.

    Attributes:
        problem: The experiment as arrays, as the walk began.
        layout: Names and positions of the log's columns.
        tick: Ticks that have been run.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        controller: ControllerFunction | None = None,
        on_compile: Callable[[], None] | None = None,
    ) -> None:
        """Lay the walk out; no tick is run.

        Args:
            problem: From :func:`twin_gait.experiment.problem.build_problem`.
            controller: Control law that takes the place of the thesis's; numba must be able to compile it.
            on_compile: Called if the loop has to be compiled first, which takes 10 to 20 s.
        """
        self.problem = problem
        self.layout = log_layout(problem)
        self.tick = 0
        self._engine = CompiledEngine(
            _with_spare_faults(problem), controller=controller, on_compile=on_compile
        )
        self._engine.warm_up()
        self._inputs, self._state = self._engine.episode.inputs, self._engine.episode.state
        # Not the switches: they are long, and nobody reads more of them than have been counted.
        changing = {name: array for name, array in self._state._asdict().items() if name != "switches"}
        self._start = {name: array.copy() for name, array in changing.items()}
        self._forget_faults()
        self._fades: dict[str, _Fade] = {}
        self._push_ends = np.full(len(problem.joints), -1, dtype=np.int64)
        self._watching = True
        self._held: int | None = None
        self._released_at: int | None = None
        self._chunks: dict[int, np.ndarray] = {}

    # ------------------------------------------------------------------ advancing

    @property
    def status(self) -> RunStatus:
        """How the walk stands; ``completed`` as long as nothing has ended it."""
        return self._engine.ending(self.tick)[0]

    @property
    def reason(self) -> str:
        """Why it has ended; empty before that."""
        return self._engine.ending(self.tick)[1]

    @property
    def tripped(self) -> bool:
        """Whether the legs are in the safe hold."""
        return bool(self._state.safety[episode_arrays.TRIP_TICK] >= 0)

    @property
    def trip(self) -> Trip | None:
        """What the safety monitor tripped on, or None."""
        return self._engine.trip()

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """Injected faults, trip, fall and divergence so far, in the order of time."""
        faults = (*self.problem.experiment.faults, *self._injected)
        return run_events(faults, self.trip, self.status, max(self.tick - 1, 0) * TICK)

    @property
    def q(self) -> np.ndarray:
        """Present coordinates of the rigid-body model in [rad] and [m], shape ``(n,)``; a copy.

        With braces, those of the device.
        """
        return self._state.q[: self.problem.world.model.nv].copy()

    def advance(self, ticks: int) -> np.ndarray:
        """Run some ticks, fewer if the wearer falls or the state diverges on the way.

        Returns:
            Rows of the log that they wrote, shape ``(ticks, n_columns)`` in the order of the layout.
        """
        first, end = self.tick, self.tick + ticks
        while self.tick < end and self.status is RunStatus.COMPLETED:
            self._apply_fades()
            self._end_pushes()
            self._run_to(min(end, self._next_change(end)))
            self._hold_again()
        return self.rows(first)

    def _run_to(self, end: int) -> None:
        chunk, row = divmod(self.tick, CHUNK_TICKS)
        if chunk not in self._chunks:
            self._chunks[chunk] = np.zeros((CHUNK_TICKS, len(self.layout.names)))
        self._inputs.integers[episode_arrays.FIRST_ROW] = chunk * CHUNK_TICKS
        end = min(end, self.tick + CHUNK_TICKS - row)
        self.tick = self._engine.run_ticks(self.tick, end, self._chunks[chunk])

    def _next_change(self, end: int) -> int:
        """Tick before which something has to be written into the arrays again."""
        if self._fades:
            return self.tick + 1
        pending = self._push_ends[self._push_ends > self.tick]
        return int(min(end, pending.min(initial=end)))

    def _apply_fades(self) -> None:
        done = [name for name, fade in self._fades.items() if fade.reaches(self.tick)]
        if "phase_rows" in self._fades:
            self._refresh_blended()
        for name in done:
            del self._fades[name]

    def _refresh_blended(self) -> None:
        """Legs whose own fade is over no longer read the parameters of their phase."""
        for leg in range(len(self.problem.sides)):
            if self.tick - self._state.entry_tick[leg] > self._inputs.integers[episode_arrays.BLEND_TICKS]:
                self._state.blended[leg] = self._inputs.phase_rows[leg, self._state.phase[leg]]

    def _end_pushes(self) -> None:
        over = (self._push_ends >= 0) & (self._push_ends <= self.tick)
        self._inputs.push[over] = 0.0
        self._push_ends[over] = -1

    def rows(self, first: int = 0) -> np.ndarray:
        """The log from a tick on.

        Returns:
            Shape ``(tick - first, n_columns)``.
        """
        chunk = first // CHUNK_TICKS
        begin, end = first - chunk * CHUNK_TICKS, self.tick - chunk * CHUNK_TICKS
        parts = [self._chunks[number] for number in range(chunk, -(-self.tick // CHUNK_TICKS))]
        if len(parts) == 1:
            return parts[0][begin:end]
        return np.concatenate([*parts, np.zeros((0, len(self.layout.names)))])[begin:end]

    def forget_rows(self, before: int) -> None:
        """Let the memory of old rows go; a walk of an hour then needs no more of it than one of seconds."""
        for number in [item for item in self._chunks if (item + 1) * CHUNK_TICKS <= before]:
            del self._chunks[number]

    def result(self, *, interrupted: bool = False) -> EngineResult:
        """The walk so far as an engine hands it back.

        Args:
            interrupted: Whether to mark it so, unless it has ended by itself.
        """
        status, reason = self._engine.ending(self.tick)
        if interrupted and status is RunStatus.COMPLETED:
            status, reason = RunStatus.INTERRUPTED, stopped_reason(self.tick)
        return EngineResult(self.rows(), self._engine.switches(), status, reason, self._engine.trip())

    def switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Switches of the phases so far."""
        return self._engine.switches(first)

    # ------------------------------------------------------------------ moments

    def moment(self) -> dict[str, Any]:
        """The present moment, from which another run of the same problem can go on: plain values for JSON."""
        return {
            "tick": self.tick,
            "arrays": {name: packed(array) for name, array in self._changing().items()},
            "fades": {
                name: [packed(fade.start), packed(fade.target), fade.first, fade.ticks]
                for name, fade in self._fades.items()
            },
            "push_ends": packed(self._push_ends),
            "watching": self._watching,
            "held": self._held,
            "released": self._released_at is not None,
        }

    def go_on_from(self, moment: Mapping[str, Any]) -> None:
        """Take over a moment of another run of the same problem; rows and switches before it are unknown."""
        for name, array in self._changing().items():
            unpack(moment["arrays"][name], array)
        self._state.counters[0] = 0  # of the switches
        unpack(moment["push_ends"], self._push_ends)
        self.tick, self._chunks, self._fades = moment["tick"], {}, {}
        self._watching, self._held = moment["watching"], moment["held"]
        self._released_at = 0 if moment["released"] else None
        for name, (start, target, first, ticks) in moment["fades"].items():
            values = self._values(name)
            fade = self._fades[name] = _Fade(values, values.copy(), values.copy(), first, ticks)
            unpack(start, fade.start)
            unpack(target, fade.target)

    def _changing(self) -> dict[str, np.ndarray]:
        """Arrays that time or a caller changes, by name."""
        fields = fields_of(self._engine.episode)
        return {name: array for name, array in fields.items() if name not in _UNCHANGING}

    # ------------------------------------------------------------------ changes

    def _values(self, name: str) -> np.ndarray:
        """What fades under a name."""
        inputs = self._inputs
        found: np.ndarray = inputs.phase_rows if name == "phase_rows" else inputs.target_torque
        if name == "belt_speed":
            found = inputs.belt[BELT_CRUISE : BELT_CRUISE + 1]
        if name == "support":
            assert self._hung is not None  # set_support_force() has looked
            found = inputs.plant_rows[self._hung, CONSTANT_FORCE : CONSTANT_FORCE + 1]
        return found

    def _fade(self, name: str, target: np.ndarray, ticks: int) -> None:
        values = self._values(name)
        shaped = np.array(np.broadcast_to(target, values.shape), dtype=float)
        self._fades[name] = _Fade(values, values.copy(), shaped, self.tick, ticks)

    def set_phase_rows(self, rows: np.ndarray, *, fade_ticks: int = FADE_TICKS) -> None:
        """Give the phases other k, b, θ0, G and gravity shares.

        They fade from the present ones by the minimum-jerk law, in all phases at once and also in a phase
        whose own fade is over.
        """
        self._fade("phase_rows", rows, fade_ticks)

    def set_comparisons(self, comparisons: np.ndarray) -> None:
        """Give the guards other thresholds, at once."""
        self._inputs.comparisons[...] = comparisons

    def set_target_torque(self, torque: np.ndarray, *, fade_ticks: int = FADE_TICKS) -> None:
        """Add other torques to the commands.

        Args:
            torque: In [N m], shape ``(n_joints,)``.
        """
        self._fade("target_torque", torque, fade_ticks)

    def set_belt_speed(self, speed: float, *, fade_ticks: int = FADE_TICKS) -> None:
        """Let the belt run at another speed; with a profile, between its ramps.

        Args:
            speed: In [m] / [s]; 0 stops it.
        """
        self._fade("belt_speed", np.array([speed]), fade_ticks)

    def set_support_force(self, force: float, *, fade_ticks: int = FADE_TICKS) -> None:
        """Let the support carry another weight.

        Args:
            force: In [N].

        Raises:
            ParameterError: If the pelvis hangs in no support.
        """
        if self._hung is None:
            raise ParameterError("support: the pelvis of this experiment is fixed; choose a treadmill")
        self._fade("support", np.array([force]), fade_ticks)

    @property
    def _hung(self) -> int | None:
        """The pelvis that hangs in the support, the wearer's, or None on a stand."""
        world = self.problem.world
        return None if world.model.pelvis_index is None else world.model.pelvis_index + world.wearer_shift

    def push(self, joint: int, torque: float, ticks: int) -> None:
        """Push a joint from outside with a constant torque.

        Args:
            joint: Position in ``problem.joints``.
            torque: In [N m], positive towards flexion.
            ticks: How long, 1 or more.
        """
        self._inputs.push[joint] = torque
        self._push_ends[joint] = self.tick + ticks

    def inject(self, fault: Fault) -> None:
        """Inject a fault in the next tick, whatever time it has.

        Raises:
            ParameterError: If the fault does not fit the experiment, or too many have been injected.
        """
        spare = np.flatnonzero(self._inputs.faults[:, START_TICK] == NEVER)
        if len(spare) == 0:
            raise ParameterError(f"fault {fault}: at most {MOST_FAULTS} in one walk; restart it")
        injected = replace(fault, time=0.0)
        arrays = fault_arrays(
            replace(self.problem, experiment=replace(self.problem.experiment, faults=(injected,)))
        )
        self._inputs.faults[spare[0]] = arrays.faults[0]
        self._inputs.faults[spare[0], START_TICK] = self.tick
        self._inputs.magnitudes[spare[0]] = arrays.magnitudes[0]
        self._injected.append(replace(fault, time=self.tick * TICK))
        self._note_first_fault()

    def _note_first_fault(self) -> None:
        self._inputs.integers[episode_arrays.FIRST_FAULT] = self._inputs.faults[:, START_TICK].min()

    def _forget_faults(self) -> None:
        """Leave the faults of the experiment alone; all others have not happened yet."""
        self._inputs.faults[len(self.problem.experiment.faults) :, START_TICK] = NEVER
        self._injected: list[Fault] = []
        self._note_first_fault()

    # ------------------------------------------------------------------ steps by hand

    def hold_phase(self, phase: int | None) -> None:
        """Let no leg leave a phase by itself, or let all of them go their way again.

        As long as a phase is held the monitor does not watch how long a leg stays.

        Args:
            phase: Index of the phase, or None.
        """
        self._inputs.minimum_ticks[:] = self.problem.program.minimum_ticks
        self._held, self._released_at = phase, None
        if phase is not None:
            self._inputs.minimum_ticks[phase] = NEVER
        self._note_phase_time_out()

    @property
    def held_phase(self) -> int | None:
        """The phase that no leg leaves by itself, or None."""
        return self._held

    def waiting(self) -> tuple[int, ...]:
        """Legs that stand in the held phase with an exit open."""
        if self._held is None or self._released_at is not None:
            return ()
        transitions = self._inputs.transitions
        debounce = self._state.debounce.reshape(len(self.problem.sides), -1)
        exits = transitions[:, SOURCE] == self._held
        due = exits & (debounce >= transitions[:, DEBOUNCE_TICKS])
        return tuple(
            leg
            for leg, phase in enumerate(self._state.phase.tolist())
            if phase == self._held and due[leg].any()
        )

    def release(self) -> None:
        """Let one leg leave the held phase, now or as soon as an exit opens."""
        if self._held is not None:
            self._inputs.minimum_ticks[self._held] = self.problem.program.minimum_ticks[self._held]
            self._released_at = int(self._state.counters[0])

    def _hold_again(self) -> None:
        """After the step that was let go the next one waits again."""
        if self._held is None or self._released_at is None:
            return
        last = min(int(self._state.counters[0]), len(self._state.switches))
        if self._held in self._state.switches[self._released_at : last, 2]:
            self.hold_phase(self._held)

    def watch_phases(self, watching: bool) -> None:
        """Let the monitor watch how long a leg stays in a phase, or not."""
        self._watching = watching
        self._note_phase_time_out()

    def _note_phase_time_out(self) -> None:
        before = self._inputs.integers[episode_arrays.PHASE_TIME_OUT_TICKS]
        limit = phase_time_out_ticks(self.problem) if self._watching and self._held is None else NEVER
        self._inputs.integers[episode_arrays.PHASE_TIME_OUT_TICKS] = limit
        if before == NEVER and limit < NEVER:
            self._enter_anew()

    def _enter_anew(self) -> None:
        """Begin the present phase of every leg again; its parameters fade in from the present ones."""
        self._state.entry_tick[:] = self.tick
        self._state.blend_start[...] = self._state.blended

    # ------------------------------------------------------------------ stop and start

    def stop(self) -> None:
        """Trip the monitor by hand: from the next tick on the legs are held and lowered.

        The belt comes to rest and the harness locks, as after any trip.

        Nothing but :meth:`restart` takes it back.
        """
        if self.tripped:
            return
        self._state.safety[episode_arrays.TRIP_TICK] = self.tick
        self._state.safety[episode_arrays.TRIP_CAUSE] = OPERATOR_TRIP
        self._state.safety[episode_arrays.TRIP_PLACE] = -1
        self._state.hold_angle[:] = self._state.measured[:, 0]

    def restart(self) -> None:
        """Go back to tick 0 with the present parameters; pushes and injected faults are forgotten."""
        for name in list(self._fades):
            self._fades[name].ticks = 0
        self._apply_fades()
        for name, start in self._start.items():
            getattr(self._state, name)[...] = start
        if self._hung is not None:
            self._inputs.plant_rows[self._hung, STOP_STIFFNESS] = 0.0  # the harness lets go
        for leg in range(len(self.problem.sides)):
            self._state.blended[leg] = self._inputs.phase_rows[leg, self._state.phase[leg]]
        self._state.blend_start[...] = self._state.blended
        self._push_ends[:] = 0
        self.tick, self._chunks = 0, {}
        self._end_pushes()
        self._forget_faults()
        self.hold_phase(self._held)


def _with_spare_faults(problem: Problem) -> Problem:
    """The problem with room for faults to come."""
    spare = (Fault(kind=FaultKind.SUPPLY_DIP, time=0.0),) * MOST_FAULTS
    experiment = replace(problem.experiment, faults=(*problem.experiment.faults, *spare))
    return replace(problem, experiment=experiment)
