"""A run that is advanced piece by piece and changed in between, in compiled code.

A live session advances it against a clock, and :mod:`twin_gait.simulation.scripted_engine` from event to
event: the caller advances the walk by some ticks, changes the parameters of the phases, the belt or the
support, pushes the leg or injects a fault, and goes on. The rows do not depend on how many ticks are advanced
at a time; without a change they are those of ``simulate``, bit for bit.
"""

import base64
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from twin_gait.control.safety import Trip
from twin_gait.core.blending import BLEND_MINIMUM_JERK, blend, blend_share
from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.core.guards import CompiledComparison
from twin_gait.core.safety import OPERATOR_TRIP
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.events import FADE_TICKS
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.measures.outcome import RunEvent
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.record import entries
from twin_gait.simulation.request_results import RequestResult, request_result
from twin_gait.simulation.run import RunStatus, log_table, run_events
from twin_gait.simulation.settings import LoopNumbers, numbers_of
from twin_gait.simulation.simulation_setup import NEVER, SimulationSetup, fault_records, phase_timeout_ticks
from twin_gait.worlds.faults import Fault, FaultKind

BELT_TICKS = 200  # in which the belt stops for a leg that waits, and starts again
WAIT_TICKS = 10  # whether a leg waits is looked up in every tick that is a multiple of this
MOST_FAULTS = 16  # that can be injected into one walk


class SteppedRun:
    """One walk in compiled code that its caller advances and changes.

    Attributes:
        problem: The experiment as an engine needs it, as the walk began.
        engine: Engine that runs the ticks.
        layout: Names and positions of the log's columns.
        tick: Ticks that have been run.
        numbers: In force, or fading in.
        injected: Faults that have been injected, with their times.
    """

    def __init__(
        self,
        setup: SimulationSetup,
        *,
        on_compile: Callable[[], None] | None = None,
        spare_faults: int | None = None,
    ) -> None:
        """Lay the walk out; no tick is run.

        ``setup``: from :func:`~twin_gait.simulation.simulation_setup.build_setup`; ``on_compile``: called if
        the loop has to be compiled first, which takes 10 to 20 s; ``spare_faults``: number of faults that can be
        injected, ``MOST_FAULTS`` by default.
        """
        self.setup = setup
        self.layout = log_layout(setup)
        self.tick = 0
        experiment = setup.experiment
        number = MOST_FAULTS if spare_faults is None else spare_faults
        spare = (Fault(kind=FaultKind.SUPPLY_DIP, time=0.0),) * number
        roomy = replace(experiment, faults=(*experiment.faults, *spare))
        self.engine = CompiledEngine(replace(setup, experiment=roomy), on_compile=on_compile)
        self._episode = self.engine.episode
        if spare:
            starts = self._episode["faults"]["start_tick"]
            starts[len(experiment.faults) :] = NEVER
            self._episode["first_fault"] = starts.min()
        self._start = self.engine.store.copy()
        self._first_numbers: LoopNumbers = numbers_of(setup)
        self.numbers: LoopNumbers = self._first_numbers
        self._values = self._changeable()
        # Values before a fade by name, its first tick, its length; None without one. JSON takes it as it is.
        self._fade: tuple[dict[str, Any], int, int] | None = None
        self._push_ends = np.full(len(setup.joints), NEVER)
        self.injected: tuple[Fault, ...] = ()
        self._log: list[tuple[int, np.ndarray]] = []  # first tick and rows of every call
        self._belt_waits = False
        self._were_held = np.zeros(len(setup.sides), dtype=bool)  # legs in the held phase at the last look

    def _changeable(self) -> dict[str, np.ndarray]:
        """Where in the record the numbers stand that fade."""
        controller, model = self._episode["controller"], self.setup.world.model
        joints = controller["joints"]
        found = {
            "setpoints": joints["setpoints"].view(float).reshape(len(joints), -1, COLUMNS_PER_JOINT),
            "gravity_shares": controller["legs"]["gravity_shares"],
            "target_torque": joints["target"],
            "belt_speed": self.engine.store["belt"]["cruise"],
        }
        if model.pelvis_index is not None:  # the wearer's hangs in the support
            hung = model.pelvis_index + self.setup.world.wearer_offset
            found["support_force"] = self._episode["plant"]["spring"]["force"][hung : hung + 1]
        return found

    @property
    def status(self) -> RunStatus:
        """How the walk stands; ``completed`` as long as nothing has ended it."""
        return self.engine.status_after(self.tick)[0]

    @property
    def reason(self) -> str:
        """Why it has ended; empty before that."""
        return self.engine.status_after(self.tick)[1]

    @property
    def trip(self) -> Trip | None:
        """What the safety monitor tripped on, or None."""
        return self.engine.trip()

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """Injected faults, trip, fall and divergence so far, in the order of time."""
        faults = (*self.setup.experiment.faults, *self.injected)
        return run_events(faults, self.trip, self.status, max(self.tick - 1, 0) * TICK)

    def advance(self, ticks: int) -> np.ndarray:
        """Run some ticks, fewer if the wearer falls or the state diverges on the way.

        Returns rows of the log that they wrote, shape ``(ticks, n_columns)`` in the order of the layout.
        """
        first = self.tick
        rows = np.zeros((ticks, len(self.layout.names)))
        self.advance_into(rows, first, first + ticks)
        self._log.append((first, rows[: self.tick - first]))
        return self._log[-1][1]

    def advance_into(self, rows: np.ndarray, first_row: int, end: int) -> None:
        """Run the ticks before ``end``, and write them into the log of the caller.

        ``rows``: shape ``(n, n_columns)``, changed in place; its first row is that of tick ``first_row``.
        """
        while self.tick < end and self.status is RunStatus.COMPLETED:
            by_hand = self.numbers["held_phase"] is not None or self._belt_waits
            if by_hand and self.tick % WAIT_TICKS == 0:
                self._watch_steps()
            self._apply_fade()
            over = self._push_ends <= self.tick
            self._episode["joints"]["push"][over], self._push_ends[over] = 0.0, NEVER
            piece = WAIT_TICKS - self.tick % WAIT_TICKS if by_hand else end - self.tick
            if self._fade is not None:
                piece = 1
            until = min(end, self.tick + piece, int(self._push_ends.min()))
            self.tick = self.engine.run_ticks(self.tick, until, rows, first_row)

    def _watch_steps(self) -> None:
        """Stop the belt while a leg waits for its step, and let the next one wait after a step."""
        held = self._legs_in_held_phase()
        if (self._were_held & ~held).any():
            self._hold()
        self._were_held = held
        waits = bool(self.waiting_legs())
        if waits != self._belt_waits:  # it would carry the leg away
            self._belt_waits = waits
            self._begin_fade(BELT_TICKS)

    def _begin_fade(self, ticks: int) -> None:
        self._fade = {name: values.tolist() for name, values in self._values.items()}, self.tick, ticks

    def _targets(self) -> dict[str, Any]:
        """What the numbers ask of the values that fade, by name."""
        rows = np.array(self.numbers["phase_rows"])
        by_joint = rows[..., :-1].reshape(*rows.shape[:2], -1, COLUMNS_PER_JOINT).swapaxes(1, 2)
        return {
            **self.numbers,
            "setpoints": by_joint.reshape(self._values["setpoints"].shape),
            "gravity_shares": rows[..., -1],
            "belt_speed": 0.0 if self._belt_waits else self.numbers["belt_speed"],
        }

    def _apply_fade(self) -> None:
        if self._fade is None:
            return
        start, first, ticks = self._fade
        share = blend_share((self.tick - first + 1) / max(ticks, 1), BLEND_MINIMUM_JERK)
        target = self._targets()
        for name, values in self._values.items():
            old, new = np.array(start[name]), np.array(target[name])
            values[...] = blend(old, new, share) if share < 1.0 else new  # type: ignore[arg-type]
        if share == 1.0:
            self._fade = None
        legs = self._episode["controller"]["legs"]
        lengths = np.take_along_axis(legs["blend_ticks"], legs["phase"][:, None], axis=1)[:, 0]
        # A leg whose own fade is over no longer reads the parameters of its phase.
        self._finish_blending(self.tick - legs["entry_tick"] > lengths)

    def _finish_blending(self, chosen: np.ndarray) -> None:
        """Give the chosen legs the parameters of their phases."""
        controller = self._episode["controller"]
        joints = controller["joints"].reshape(len(chosen), -1)
        for leg, own, wanted in zip(controller["legs"], joints, chosen, strict=True):
            if wanted:
                own["blended"] = own["setpoints"][:, leg["phase"]]
                leg["gravity"] = leg["gravity_shares"][leg["phase"]]

    def _restart_blending(self) -> None:
        """Let every leg fade from its present parameters."""
        joints, legs = self._episode["controller"]["joints"], self._episode["controller"]["legs"]
        joints["blend_start"], legs["gravity_start"] = joints["blended"], legs["gravity"]

    def rows(self, first: int = 0) -> np.ndarray:
        """The log from a tick on that has not been forgotten, shape ``(tick - first, n_columns)``."""
        parts = [rows[max(first - begin, 0) :] for begin, rows in self._log if begin + len(rows) > first]
        return np.concatenate([np.zeros((0, len(self.layout.names))), *parts])

    def discard_rows(self, before: int) -> None:
        """Let the memory of old rows go; a walk of an hour then needs no more of it than one of seconds."""
        self._log = [(begin, rows) for begin, rows in self._log if begin + len(rows) > before]

    def switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Switches of the phases so far."""
        return self.engine.phase_switches(first)

    def snapshot(self) -> dict[str, Any]:
        """The present moment, from which another run of the same problem can go on: plain values for JSON."""
        return {
            "tick": self.tick,
            "record": base64.b64encode(self.engine.store.tobytes()).decode(),
            "numbers": self.numbers,
            "fade": self._fade,
            "push_ends": self._push_ends.tolist(),
            "belt_waits": self._belt_waits,
            "were_held": self._were_held.tolist(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a moment of another run of the same problem; rows and switches before it are unknown."""
        self.engine.store[:] = np.frombuffer(base64.b64decode(snapshot["record"]), self.engine.store.dtype)
        self.engine.point_at_rows()  # addresses are those of a process
        self._episode["recording"]["n_switches"] = 0
        self.tick, self._log = snapshot["tick"], []
        self.numbers, self._belt_waits = snapshot["numbers"], snapshot["belt_waits"]
        self._fade = snapshot["fade"]
        self._push_ends[:] = snapshot["push_ends"]
        self._were_held[:] = snapshot["were_held"]

    def set(self, numbers: LoopNumbers, *, fade_ticks: int = FADE_TICKS) -> None:
        """Let other numbers fade in by the minimum-jerk law, in some ticks or, with 0, at once.

        ``numbers`` as :func:`~twin_gait.simulation.settings.numbers_of` has them; those that are in force
        already change nothing. Parameters of the phases fade in all phases at once, also in one whose own
        fade is over; thresholds change at once. As long as a phase is held the monitor does not watch how
        long a leg stays. Without a fade in tick 0 the walk starts with them.
        """
        if numbers == self.numbers:
            return
        held, self.numbers = self.numbers["held_phase"], numbers
        given = [entries(CompiledComparison(**comparison)) for comparison in numbers["comparisons"]]
        program = self._episode["controller"]["program"]
        program["comparisons"][: len(given)] = given  # the record has room for more
        self._begin_fade(fade_ticks)
        if numbers["held_phase"] != held:
            self._were_held[:] = False
            self._hold()
        self._update_phase_timeout()
        if self.tick == fade_ticks == 0:
            self._apply_fade()
            self._finish_blending(np.ones(len(self.setup.sides)))
            self._restart_blending()

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
        experiment = replace(self.setup.experiment, faults=(replace(fault, time=0.0),))
        (injected,) = fault_records(replace(self.setup, experiment=experiment))
        faults[spare[0]] = entries(replace(injected, start_tick=self.tick))
        self.injected += (replace(fault, time=self.tick * TICK),)
        self._episode["first_fault"] = faults["start_tick"].min()

    def request(self, name: str) -> RequestResult:
        """Ask the supervisor for something, run the next tick, which hears it, and give its answer.

        ``name`` of a request that the modes know. Raises ParameterError if too many wait.
        """
        problem, modes, tick = self.setup, self.setup.experiment.modes, self.tick
        assert modes is not None  # else nothing is asked
        asked, supervisor = self._episode["requests"], self._episode["controller"]["supervisor"]
        free = np.flatnonzero(asked["tick"] < tick)
        if len(free) == 0 or tick in asked["tick"]:
            raise ParameterError(f"request {name}: others wait; let the time go on")
        asked[free[0]] = tick, 1 + modes.requests.index(name)
        before, ticks = modes.phase_names[supervisor["mode"]], tick - int(supervisor["entry_tick"])
        self.advance(1)
        log = log_table(self.rows(tick - 1), self.layout, problem.table)
        weight = problem.world.body_weight
        found = request_result(log, len(log) - 1, before, ticks, modes, problem.table, weight)
        return found._replace(tick=tick)

    @property
    def _minimum_ticks(self) -> np.ndarray:
        """How long a leg stays in a phase at least, by phase."""
        return np.asarray(self._episode["controller"]["program"]["minimum_ticks"])

    def _legs_in_held_phase(self) -> np.ndarray:
        return np.asarray(self._episode["controller"]["legs"]["phase"] == self.numbers["held_phase"])

    def waiting_legs(self) -> tuple[int, ...]:
        """Legs that stand in the held phase with an exit open."""
        controller = self._episode["controller"]
        legs, rules = controller["legs"], controller["program"]["transitions"]
        due = (rules["source"] == self.numbers["held_phase"]) & (legs["debounce"] >= rules["debounce_ticks"])
        return tuple(np.flatnonzero(self._legs_in_held_phase() & due.any(axis=1)).tolist())

    def release(self) -> None:
        """Let one leg leave the held phase, now or as soon as an exit opens."""
        self._minimum_ticks[:] = self.setup.program.minimum_ticks

    def _hold(self) -> None:
        """Let no leg leave the held phase, or all legs go their way if there is none."""
        self.release()
        if self.numbers["held_phase"] is not None:
            self._minimum_ticks[self.numbers["held_phase"]] = NEVER

    def _update_phase_timeout(self) -> None:
        limits, numbers = self._episode["limits"], self.numbers
        watched = numbers["watching"] and numbers["held_phase"] is None
        before, limit = limits["phase_ticks"], phase_timeout_ticks(self.setup) if watched else NEVER
        limits["phase_ticks"] = limit
        if before == NEVER and limit < NEVER:  # the present phase of every leg begins anew
            self._episode["controller"]["legs"]["entry_tick"] = self.tick
            self._restart_blending()

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
        """Go back to tick 0 with the present numbers; pushes and injected faults are forgotten."""
        self.engine.store[:] = self._start
        self.tick, self._log, self.injected, self._belt_waits = 0, [], (), False
        self._push_ends[:], self._were_held[:], self._fade = NEVER, False, None
        numbers, self.numbers = self.numbers, self._first_numbers
        self.set(numbers, fade_ticks=0)
