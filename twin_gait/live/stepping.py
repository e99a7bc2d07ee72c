"""A run that is advanced piece by piece and changed in between, in compiled code.

:func:`twin_gait.simulation.simulate` runs an experiment from start to end. Here the caller holds the clock:
they advance the walk by some ticks, look at the rows of the log, change the parameters of the phases, the
belt or the support, push the leg or inject a fault, and go on. Without a change the rows are those of
``simulate``, bit for bit.
"""

import base64
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twin_gait.control import Trip
from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.core.guards import Comparison
from twin_gait.core.safety import OPERATOR_TRIP
from twin_gait.exceptions import ParameterError
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.live.fading import Fade, arrive, fade_anew
from twin_gait.live.settings import LoopNumbers
from twin_gait.measures.outcome import RunEvent
from twin_gait.simulation.answers import Answer, answer_at
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.problem import NEVER, Problem, fault_records, phase_time_out_ticks
from twin_gait.simulation.record import entries
from twin_gait.simulation.run import RunStatus, log_table, run_events
from twin_gait.worlds.faults import Fault, FaultKind

FADE_TICKS = 300  # over which a change fades in where the caller says nothing
BELT_TICKS = 200  # in which the belt stops for a leg that waits, and starts again
WAIT_TICKS = 10  # between two looks at whether a leg waits
MOST_FAULTS = 16  # that can be injected into one walk


class SteppedRun:
    """One walk in compiled code that its caller advances and changes.

    Attributes:
        problem: The experiment as an engine needs it, as the walk began.
        layout: Names and positions of the log's columns.
        tick: Ticks that have been run.
        held_phase: The phase that no leg leaves by itself, or None.
        injected: Faults that have been injected, with their times.
    """

    def __init__(self, problem: Problem, *, on_compile: Callable[[], None] | None = None) -> None:
        """Lay the walk out; no tick is run.

        ``problem`` from :func:`twin_gait.simulation.problem.build_problem`; ``on_compile``: called if the
        loop has to be compiled first, which takes 10 to 20 s.
        """
        self.problem = problem
        self.layout = log_layout(problem)
        self.tick = 0
        experiment = problem.experiment
        spare = (Fault(kind=FaultKind.SUPPLY_DIP, time=0.0),) * MOST_FAULTS
        roomy = replace(experiment, faults=(*experiment.faults, *spare))
        self._engine = CompiledEngine(replace(problem, experiment=roomy), on_compile=on_compile)
        self._episode = self._engine.episode
        starts = self._episode["faults"]["start_tick"]
        starts[len(experiment.faults) :] = NEVER
        self._episode["first_fault"] = starts.min()
        self._start = self._engine.store.copy()
        self._values = self._changeable()
        self._fades: dict[str, Fade] = {}
        self._push_ends = np.full(len(problem.joints), NEVER)
        self.injected: tuple[Fault, ...] = ()
        self._log: list[tuple[int, np.ndarray]] = []  # first tick and rows of every call
        self.held_phase: int | None = None
        self._watching = True
        self._belt_speed, self._belt_waits = float(problem.world.belt.cruise), False

    def _changeable(self) -> dict[str, np.ndarray]:
        """What a caller may give other values for good, by name: what a restart keeps."""
        controller, model = self._episode["controller"], self.problem.world.model
        joints = controller["joints"]
        found = {
            "setpoints": joints["setpoints"].view(float).reshape(len(joints), -1, COLUMNS_PER_JOINT),
            "gravity_shares": controller["legs"]["gravity_shares"],
            "target_torque": joints["target"],
            "belt_speed": self._engine.store["belt"]["cruise"],
            "comparisons": controller["program"]["comparisons"],
        }
        if model.pelvis_index is not None:  # the wearer's hangs in the support
            hung = model.pelvis_index + self.problem.world.wearer_shift
            found["support_force"] = self._episode["plant"]["spring"]["force"][hung : hung + 1]
        return found

    @property
    def status(self) -> RunStatus:
        """How the walk stands; ``completed`` as long as nothing has ended it."""
        return self._engine.ending(self.tick)[0]

    @property
    def reason(self) -> str:
        """Why it has ended; empty before that."""
        return self._engine.ending(self.tick)[1]

    @property
    def trip(self) -> Trip | None:
        """What the safety monitor tripped on, or None."""
        return self._engine.trip()

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """Injected faults, trip, fall and divergence so far, in the order of time."""
        faults = (*self.problem.experiment.faults, *self.injected)
        return run_events(faults, self.trip, self.status, max(self.tick - 1, 0) * TICK)

    def advance(self, ticks: int) -> np.ndarray:
        """Run some ticks, fewer if the wearer falls or the state diverges on the way.

        Returns rows of the log that they wrote, shape ``(ticks, n_columns)`` in the order of the layout.
        """
        first, end = self.tick, self.tick + ticks
        rows = np.zeros((ticks, len(self.layout.names)))
        while self.tick < end and self.status is RunStatus.COMPLETED:
            self._let_belt_wait()
            self._apply_fades()
            over = self._push_ends <= self.tick
            self._episode["joints"]["push"][over], self._push_ends[over] = 0.0, NEVER
            piece = ticks if self.held_phase is None else WAIT_TICKS
            if self._fades or self._released:
                piece = 1
            until = min(end, self.tick + piece, int(self._push_ends.min()))
            there = self._legs_in_held_phase()
            self.tick = self._engine.run_ticks(self.tick, until, rows, first)
            if self._released and (there & ~self._legs_in_held_phase()).any():
                self.hold_phase(self.held_phase)  # after the step that was let go the next one waits again
        self._log.append((first, rows[: self.tick - first]))
        return self._log[-1][1]

    def _let_belt_wait(self) -> None:
        """Let the belt stand while a leg waits for its step: it would carry the leg away."""
        waits = bool(self.waiting())
        if waits != self._belt_waits:
            self._belt_waits = waits
            self.fade("belt_speed", 0.0 if waits else self._belt_speed, BELT_TICKS)

    def _apply_fades(self) -> None:
        going = {
            name: fade for name, fade in self._fades.items() if fade.write(self.tick, self._values[name])
        }
        if "setpoints" in self._fades:
            legs = self._episode["controller"]["legs"]
            lengths = np.take_along_axis(legs["blend_ticks"], legs["phase"][:, None], axis=1)[:, 0]
            # A leg whose own fade is over no longer reads the parameters of its phase.
            arrive(self._episode, self.tick - legs["entry_tick"] > lengths)
        self._fades = going

    def rows(self, first: int = 0) -> np.ndarray:
        """The log from a tick on that has not been forgotten, shape ``(tick - first, n_columns)``."""
        parts = [rows[max(first - begin, 0) :] for begin, rows in self._log if begin + len(rows) > first]
        return np.concatenate([np.zeros((0, len(self.layout.names))), *parts])

    def forget_rows(self, before: int) -> None:
        """Let the memory of old rows go; a walk of an hour then needs no more of it than one of seconds."""
        self._log = [(begin, rows) for begin, rows in self._log if begin + len(rows) > before]

    def switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Switches of the phases so far."""
        return self._engine.phase_switches(first)

    def moment(self) -> dict[str, Any]:
        """The present moment, from which another run of the same problem can go on: plain values for JSON."""
        return {
            "tick": self.tick,
            "record": base64.b64encode(self._engine.store.tobytes()).decode(),
            "fades": dict(self._fades),
            "push_ends": self._push_ends.tolist(),
            "watching": self._watching,
            "held": self.held_phase,
            "belt": (self._belt_speed, self._belt_waits),
        }

    def go_on_from(self, moment: Mapping[str, Any]) -> None:
        """Take over a moment of another run of the same problem; rows and switches before it are unknown."""
        self._engine.store[:] = np.frombuffer(base64.b64decode(moment["record"]), self._engine.store.dtype)
        self._engine.point_at_rows()  # addresses are those of a process
        self._episode["recording"]["n_switches"] = 0
        self._fades = {name: Fade(*fade) for name, fade in moment["fades"].items()}
        self._push_ends[:] = moment["push_ends"]
        self.tick, self._log = moment["tick"], []
        self._watching, self.held_phase = moment["watching"], moment["held"]
        self._belt_speed, self._belt_waits = moment["belt"]

    def fade(self, name: str, target: ArrayLike, ticks: int = FADE_TICKS) -> None:
        """Let numbers fade to others by the minimum-jerk law, in some ticks or, with 0, at once.

        ``name``: ``target_torque`` in [N m], added to the commands, shape ``(n_joints,)``; ``belt_speed`` in
        [m] / [s], 0 to stop, with a profile that between its ramps; ``support_force`` in [N], where the
        pelvis hangs in one.
        """
        values = self._values[name]
        shaped = np.broadcast_to(target, values.shape).tolist()
        self._fades[name] = Fade(values.tolist(), shaped, self.tick, ticks)

    def set_phase_rows(self, rows: np.ndarray, *, fade_ticks: int = FADE_TICKS) -> None:
        """Give the phases other k, b, θ0, G and gravity shares, shaped as ``problem.phase_rows``.

        They fade by the minimum-jerk law, in all phases at once, also in one whose own fade is over.
        """
        by_joint = rows[..., :-1].reshape(*rows.shape[:2], -1, COLUMNS_PER_JOINT).swapaxes(1, 2)
        self.fade("setpoints", by_joint.reshape(self._values["setpoints"].shape), fade_ticks)
        self.fade("gravity_shares", rows[..., -1], fade_ticks)

    def set(self, numbers: LoopNumbers) -> None:
        """Let new settings fade in; thresholds change at once."""
        self.set_phase_rows(np.array(numbers["phase_rows"]))
        given = [entries(Comparison(**comparison)) for comparison in numbers["comparisons"]]
        self._values["comparisons"][: len(given)] = given  # the record has room for more
        self.fade("target_torque", numbers["target_torque"])
        if numbers["support_force"] is not None:
            self.fade("support_force", numbers["support_force"])
        self._belt_speed = numbers["belt_speed"]
        if not self._belt_waits:
            self.fade("belt_speed", self._belt_speed)
        self._watching = numbers["watching"]
        if numbers["held_phase"] == self.held_phase:
            self._note_phase_time_out()
        else:
            self.hold_phase(numbers["held_phase"])

    def push(self, joint: int, torque: float, ticks: int) -> None:
        """Push a joint of ``problem.joints`` for some ticks, in [N m], positive towards flexion."""
        self._episode["joints"]["push"][joint] = torque
        self._push_ends[joint] = self.tick + ticks

    def inject(self, fault: Fault) -> None:
        """Inject a fault in the next tick, whatever time it has.

        Raises ParameterError if the fault does not fit the experiment, or too many have been injected.
        """
        faults = self._episode["faults"]
        spare = np.flatnonzero(faults["start_tick"] == NEVER)
        if len(spare) == 0:
            raise ParameterError(f"fault {fault}: at most {MOST_FAULTS} in one walk; restart it")
        experiment = replace(self.problem.experiment, faults=(replace(fault, time=0.0),))
        (injected,) = fault_records(replace(self.problem, experiment=experiment))
        faults[spare[0]] = entries(replace(injected, start_tick=self.tick))
        self.injected += (replace(fault, time=self.tick * TICK),)
        self._episode["first_fault"] = faults["start_tick"].min()

    def request(self, name: str) -> Answer:
        """Ask the supervisor for something, run the next tick, which hears it, and give its answer.

        Raises ParameterError if there are no modes, they know no such request, or too many wait.
        """
        problem, modes, tick = self.problem, self.problem.experiment.modes, self.tick
        if modes is None or name not in modes.requests:
            known = "nothing" if modes is None else ", ".join(modes.requests)
            raise ParameterError(f"request {name!r}: the modes answer {known}")
        asked, supervisor = self._episode["requests"], self._episode["controller"]["supervisor"]
        free = np.flatnonzero(asked["tick"] < tick)
        if len(free) == 0 or tick in asked["tick"]:
            raise ParameterError(f"request {name}: others wait; let the time go on")
        asked[free[0]] = tick, 1 + modes.requests.index(name)
        before, ticks = modes.phase_names[supervisor["mode"]], tick - int(supervisor["entry_tick"])
        self.advance(1)
        log = log_table(self.rows(tick - 1), self.layout, problem.table)
        weight = problem.world.body_weight
        found = answer_at(log, len(log) - 1, before, ticks, modes, problem.table, weight)
        return found._replace(tick=tick)

    def hold_phase(self, phase: int | None) -> None:
        """Let no leg leave a phase, by index, or with None let all of them go their way again.

        As long as a phase is held the monitor does not watch how long a leg stays.
        """
        self.held_phase = phase
        self.release()
        if phase is not None:
            self._episode["controller"]["program"]["minimum_ticks"][phase] = NEVER
        self._note_phase_time_out()

    @property
    def _released(self) -> bool:
        """Whether a leg may leave the held phase."""
        minimum = self._episode["controller"]["program"]["minimum_ticks"]
        return self.held_phase is not None and bool(minimum[self.held_phase] != NEVER)

    def _legs_in_held_phase(self) -> np.ndarray:
        return np.asarray(self._episode["controller"]["legs"]["phase"] == self.held_phase)

    def waiting(self) -> tuple[int, ...]:
        """Legs that stand in the held phase with an exit open."""
        if self.held_phase is None or self._released:
            return ()
        controller = self._episode["controller"]
        legs, rules = controller["legs"], controller["program"]["transitions"]
        due = (rules["source"] == self.held_phase) & (legs["debounce"] >= rules["debounce_ticks"])
        return tuple(np.flatnonzero(self._legs_in_held_phase() & due.any(axis=1)).tolist())

    def release(self) -> None:
        """Let one leg leave the held phase, now or as soon as an exit opens."""
        minimum = self._episode["controller"]["program"]["minimum_ticks"]
        minimum[:] = self.problem.program.minimum_ticks

    def _note_phase_time_out(self) -> None:
        limits = self._episode["limits"]
        before = limits["phase_ticks"]
        limit = phase_time_out_ticks(self.problem) if self._watching and self.held_phase is None else NEVER
        limits["phase_ticks"] = limit
        if before == NEVER and limit < NEVER:  # the present phase of every leg begins anew
            self._episode["controller"]["legs"]["entry_tick"] = self.tick
            fade_anew(self._episode)

    def stop(self) -> None:
        """Trip the monitor by hand: from the next tick on the legs are held and lowered.

        As after any trip the belt comes to rest and the harness locks; only :meth:`restart` takes it back.
        """
        if self.trip is not None:
            return
        controller, boards = self._episode["controller"], self._episode["joints"]["board"]
        controller["joints"]["hold_angle"] = boards["encoder"]["angle"]
        trip = controller["trip"]
        trip["tick"], trip["cause"], trip["part"] = self.tick, OPERATOR_TRIP, -1

    def restart(self) -> None:
        """Go back to tick 0 with the present parameters; pushes and injected faults are forgotten."""
        kept = {name: values.copy() for name, values in self._values.items()}
        self._engine.store[:] = self._start
        for name, values in self._values.items():
            values[...] = self._fades[name].target if name in self._fades else kept[name]
        if self._belt_waits:
            self._values["belt_speed"][...], self._belt_waits = self._belt_speed, False
        arrive(self._episode, np.ones(len(self.problem.sides)))
        fade_anew(self._episode)
        self.tick, self._log, self.injected, self._fades = 0, [], (), {}
        self._push_ends[:] = NEVER
        self.hold_phase(self.held_phase)
