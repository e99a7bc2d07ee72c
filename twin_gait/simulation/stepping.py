"""Run in compiled code that its caller advances in steps and changes between the steps.

The caller advances the walk by some ticks, changes the parameters of the phases, the belt or the support,
pushes a joint or injects a fault, and continues. A live session advances the run with a clock,
:mod:`twin_gait.simulation.scripted_engine` advances it from event to event. The rows of the log do not depend
on the number of ticks per call; without a change they are identical, bit for bit, to those of ``simulate``.
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
from twin_gait.simulation.initial_state import MOST_FAULTS
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.record import entries
from twin_gait.simulation.request_results import RequestResult, request_result
from twin_gait.simulation.run import RunStatus, log_table, run_events
from twin_gait.simulation.settings import LoopNumbers, numbers_of
from twin_gait.simulation.simulation_setup import NEVER, SimulationSetup, fault_records, phase_timeout_ticks
from twin_gait.worlds.faults import Fault, FaultKind

BELT_TICKS = 200  # Ticks in which the belt stops for a leg that waits, and in which it starts again.
WAIT_TICKS = 10  # Period in ticks of the check whether a leg waits.


class SteppedRun:
    """Walk in compiled code that its caller advances and changes.

    Attributes:
        setup: Simulation setup at the start of the walk.
        engine: Engine that runs the ticks.
        layout: Names and positions of the log's columns.
        tick: Number of ticks that have been run.
        numbers: Numbers that are in force or that fade in.
        injected: Faults that have been injected, with their times.
    """

    def __init__(
        self,
        setup: SimulationSetup,
        *,
        on_compile: Callable[[], None] | None = None,
        spare_faults: int | None = None,
    ) -> None:
        """Build the record and the loop of the walk without running a tick.

        ``setup``: from :func:`twin_gait.simulation.simulation_setup.build_setup`. ``on_compile``: called if
        the loop has to be compiled first, which takes 10 to 20 s. ``spare_faults``: number of faults that
        can be injected, ``MOST_FAULTS`` by default.
        """
        self.setup = setup
        self.layout = log_layout(setup)
        self.tick = 0
        experiment = setup.experiment
        number = MOST_FAULTS if spare_faults is None else spare_faults
        spare = (Fault(kind=FaultKind.SUPPLY_DIP, time=0.0),) * number
        padded = replace(experiment, faults=(*experiment.faults, *spare))
        self.engine = CompiledEngine(replace(setup, experiment=padded), on_compile=on_compile)
        self._episode = self.engine.episode
        if spare:
            starts = self._episode["faults"]["start_tick"]
            starts[len(experiment.faults) :] = NEVER
            self._episode["first_fault"] = starts.min()
        self._start = self.engine.store.copy()
        self._first_numbers: LoopNumbers = numbers_of(setup)
        self.numbers: LoopNumbers = self._first_numbers
        self._values = self._changeable()
        # Fade: values before it by name, its first tick, its length in ticks; None without a fade. Its parts
        # are values that JSON can encode.
        self._fade: tuple[dict[str, Any], int, int] | None = None
        self._push_ends = np.full(len(setup.joints), NEVER)
        self.injected: tuple[Fault, ...] = ()
        self._log: list[tuple[int, np.ndarray]] = []  # first tick and rows of every call
        self._belt_waits = False
        self._were_held = np.zeros(len(setup.sides), dtype=bool)  # legs in the held phase at the last check

    def _changeable(self) -> dict[str, np.ndarray]:
        """Return views of the numbers in the record of the episode that can fade, by name."""
        controller, model = self._episode["controller"], self.setup.world.model
        joints, phases = controller["joints"], len(self.setup.table.phases)
        setpoints = joints["setpoints"].view(float).reshape(len(joints), -1, COLUMNS_PER_JOINT)
        found = {
            "setpoints": setpoints[:, :phases],
            "gravity_shares": controller["legs"]["gravity_shares"][:, :phases],
            "target_torque": joints["target"],
            "belt_speed": self.engine.store["belt"]["cruise"],
        }
        if self.setup.world.trunk is not None:
            found["support_force"] = self.engine.store["trunk"]["harness"]["force"]
        elif model.pelvis_index is not None:  # the support acts on the wearer's pelvis
            pelvis = model.pelvis_index + self.setup.world.wearer_offset
            found["support_force"] = self._episode["plant"]["spring"]["force"][pelvis : pelvis + 1]
        return found

    @property
    def status(self) -> RunStatus:
        """Status of the walk; ``completed`` as long as it has not ended early."""
        return self.engine.status_after(self.tick)[0]

    @property
    def reason(self) -> str:
        """Reason for the end of the walk; empty before the end."""
        return self.engine.status_after(self.tick)[1]

    @property
    def trip(self) -> Trip | None:
        """Trip of the safety monitor, or None."""
        return self.engine.trip()

    @property
    def events(self) -> tuple[RunEvent, ...]:
        """Injected faults, trip, fall and divergence so far, in the order of time."""
        faults = (*self.setup.experiment.faults, *self.injected)
        return run_events(faults, self.trip, self.status, max(self.tick - 1, 0) * TICK)

    def advance(self, ticks: int) -> np.ndarray:
        """Run some ticks, fewer if the wearer falls or the state diverges earlier.

        Returns their rows of the log, shape ``(ticks, n_columns)`` in the order of the layout.
        """
        first = self.tick
        rows = np.zeros((ticks, len(self.layout.names)))
        self.advance_into(rows, first, first + ticks)
        self._log.append((first, rows[: self.tick - first]))
        return self._log[-1][1]

    def advance_into(self, rows: np.ndarray, first_row: int, end: int) -> None:
        """Run the ticks before ``end``, and write their rows into the log of the caller.

        ``rows``: shape ``(n, n_columns)``, changed in place; its first row belongs to tick ``first_row``.
        """
        while self.tick < end and self.status is RunStatus.COMPLETED:
            by_hand = self.numbers["held_phase"] is not None or self._belt_waits
            if by_hand and self.tick % WAIT_TICKS == 0:
                self._watch_steps()
            self._apply_fade()
            over = self._push_ends <= self.tick
            self._episode["joints"]["push"][over], self._push_ends[over] = 0.0, NEVER
            ticks = WAIT_TICKS - self.tick % WAIT_TICKS if by_hand else end - self.tick
            if self._fade is not None:
                ticks = 1
            until = min(end, self.tick + ticks, int(self._push_ends.min()))
            self.tick = self.engine.run_ticks(self.tick, until, rows, first_row)

    def _watch_steps(self) -> None:
        """Stop the belt while a leg waits for its step, and hold the next leg after a step."""
        held = self._legs_in_held_phase()
        if (self._were_held & ~held).any():
            self._hold()
        self._were_held = held
        waits = bool(self.waiting_legs())
        if waits != self._belt_waits:  # a moving belt would carry the leg away
            self._belt_waits = waits
            self._begin_fade(BELT_TICKS)

    def _begin_fade(self, ticks: int) -> None:
        self._fade = {name: values.tolist() for name, values in self._values.items()}, self.tick, ticks

    def _targets(self) -> dict[str, Any]:
        """Return the target values of the numbers that fade, by name."""
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
        # The controller reads the parameters of a phase only while it blends; later they are written here.
        self._finish_blending(self.tick - legs["entry_tick"] > lengths)

    def _finish_blending(self, chosen: np.ndarray) -> None:
        """Set the blended parameters of some legs to those of their phases.

        ``chosen``: whether a leg is one of them, shape ``(n_legs,)``.
        """
        controller = self._episode["controller"]
        joints = controller["joints"].reshape(len(chosen), -1)
        for leg, leg_joints, is_chosen in zip(controller["legs"], joints, chosen, strict=True):
            if is_chosen:
                leg_joints["blended"] = leg_joints["setpoints"][:, leg["phase"]]
                leg["gravity"] = leg["gravity_shares"][leg["phase"]]

    def _restart_blending(self) -> None:
        """Set the present parameters of every leg as the start of its blending."""
        joints, legs = self._episode["controller"]["joints"], self._episode["controller"]["legs"]
        joints["blend_start"], legs["gravity_start"] = joints["blended"], legs["gravity"]

    def rows(self, first: int = 0) -> np.ndarray:
        """Return the stored log from tick ``first`` on, shape ``(tick - first, n_columns)``."""
        parts = [rows[max(first - begin, 0) :] for begin, rows in self._log if begin + len(rows) > first]
        return np.concatenate([np.zeros((0, len(self.layout.names))), *parts])

    def discard_rows(self, before: int) -> None:
        """Free the memory of the rows before a tick, so that a long walk needs no more than a short one."""
        self._log = [(begin, rows) for begin, rows in self._log if begin + len(rows) > before]

    def switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Return the phase switches of the walk so far, from index ``first`` on."""
        return self.engine.phase_switches(first)

    def snapshot(self) -> dict[str, Any]:
        """Return a snapshot of the state as values for JSON; :meth:`restore` of the same setup reads it."""
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
        """Restore a snapshot of a run of the same setup; rows and switches before it are not available."""
        self.engine.store[:] = np.frombuffer(base64.b64decode(snapshot["record"]), self.engine.store.dtype)
        self.engine.point_at_rows()  # the addresses in the snapshot are not valid in this process
        self._episode["recording"]["n_switches"] = 0
        self.tick, self._log = snapshot["tick"], []
        self.numbers, self._belt_waits = snapshot["numbers"], snapshot["belt_waits"]
        self._fade = snapshot["fade"]
        self._push_ends[:] = snapshot["push_ends"]
        self._were_held[:] = snapshot["were_held"]

    def set(self, numbers: LoopNumbers, *, fade_ticks: int = FADE_TICKS) -> None:
        """Fade to other numbers along the minimum-jerk polynomial, in some ticks or, with 0, at once.

        ``numbers``: from :func:`~twin_gait.simulation.settings.numbers_of`; numbers that are already in force
        change nothing. Parameters of the phases fade in all phases at the same time, also in a phase whose
        blending is over; thresholds change at once. While a phase is held, the monitor does not check the
        timeout of a phase. In tick 0 without a fade, the walk starts with the numbers.
        """
        if numbers == self.numbers:
            return
        held, self.numbers = self.numbers["held_phase"], numbers
        given = [entries(CompiledComparison(**comparison)) for comparison in numbers["comparisons"]]
        program = self._episode["controller"]["program"]
        program["comparisons"][: len(given)] = given  # the list in the record is padded
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
        """Push joint number ``joint`` with a torque in [N·m] for some ticks, positive in flexion."""
        self._episode["joints"]["push"][joint] = torque
        self._push_ends[joint] = self.tick + ticks

    def inject(self, fault: Fault) -> None:
        """Inject a fault in the next tick; its own time is ignored.

        Raises ParameterError if the fault does not fit the experiment, or too many have been injected.
        """
        faults = self._episode["faults"]
        spare = np.flatnonzero(faults["start_tick"] == NEVER)
        if len(spare) == 0:
            problem = f"expected at most {MOST_FAULTS} injected faults in one walk; restart the walk"
            raise ParameterError(f"fault {fault}: {problem}")
        experiment = replace(self.setup.experiment, faults=(replace(fault, time=0.0),))
        (injected,) = fault_records(replace(self.setup, experiment=experiment))
        faults[spare[0]] = entries(replace(injected, start_tick=self.tick))
        self.injected += (replace(fault, time=self.tick * TICK),)
        self._episode["first_fault"] = faults["start_tick"].min()

    def request(self, name: str) -> RequestResult:
        """Send a request to the supervisor, run the next tick, which processes it, and return the result.

        ``name``: request of the table of modes. Raises ParameterError if too many requests are pending.
        """
        setup, modes, tick = self.setup, self.setup.experiment.modes, self.tick
        assert modes is not None  # without modes there are no requests
        requests, supervisor = self._episode["requests"], self._episode["controller"]["supervisor"]
        free = np.flatnonzero(requests["tick"] < tick)
        if len(free) == 0 or tick in requests["tick"]:
            problem = "earlier requests are pending; advance the walk by a tick and send it again"
            raise ParameterError(f"request {name}: {problem}")
        requests[free[0]] = tick, 1 + modes.requests.index(name)
        before, ticks = modes.phase_names[supervisor["mode"]], tick - int(supervisor["entry_tick"])
        self.advance(1)
        log = log_table(self.rows(tick - 1), self.layout, setup.table)
        weight = setup.world.body_weight
        found = request_result(log, len(log) - 1, before, ticks, modes, setup.table, weight)
        return found._replace(tick=tick)

    @property
    def _minimum_ticks(self) -> np.ndarray:
        """Shortest time of a leg in a phase in ticks, by phase."""
        padded = np.asarray(self._episode["controller"]["program"]["minimum_ticks"])
        return padded[: len(self.setup.table.phases)]

    def _legs_in_held_phase(self) -> np.ndarray:
        return np.asarray(self._episode["controller"]["legs"]["phase"] == self.numbers["held_phase"])

    def waiting_legs(self) -> tuple[int, ...]:
        """Return the numbers of the legs that are in the held phase although one of its exits is due."""
        controller = self._episode["controller"]
        legs, rules = controller["legs"], controller["program"]["transitions"]
        due = (rules["source"] == self.numbers["held_phase"]) & (legs["debounce"] >= rules["debounce_ticks"])
        return tuple(np.flatnonzero(self._legs_in_held_phase() & due.any(axis=1)).tolist())

    def release(self) -> None:
        """Release one leg from the held phase, now or as soon as an exit is due."""
        self._minimum_ticks[:] = self.setup.program.minimum_ticks

    def _hold(self) -> None:
        """Hold all legs in the held phase, or release all legs if there is no such phase."""
        self.release()
        if self.numbers["held_phase"] is not None:
            self._minimum_ticks[self.numbers["held_phase"]] = NEVER

    def _update_phase_timeout(self) -> None:
        limits, numbers = self._episode["limits"], self.numbers
        watched = numbers["watching"] and numbers["held_phase"] is None
        before, limit = limits["phase_ticks"], phase_timeout_ticks(self.setup) if watched else NEVER
        limits["phase_ticks"] = limit
        if before == NEVER and limit < NEVER:  # the present phase of every leg begins again
            self._episode["controller"]["legs"]["entry_tick"] = self.tick
            self._restart_blending()

    def stop(self) -> None:
        """Trip the safety monitor as the operator: from the next tick on the legs are held and lowered.

        As after any trip, the belt comes to rest and the harness locks; only :meth:`restart` ends the hold.
        """
        if self.trip is not None:
            return
        controller, boards = self._episode["controller"], self._episode["joints"]["board"]
        controller["joints"]["hold_angle"] = boards["encoder"]["angle"]
        trip = controller["trip"]
        trip["tick"], trip["cause"], trip["part"] = self.tick, OPERATOR_TRIP, -1

    def restart(self) -> None:
        """Reset the walk to tick 0 with the present numbers and without pushes and injected faults."""
        self.engine.store[:] = self._start
        self.tick, self._log, self.injected, self._belt_waits = 0, [], (), False
        self._push_ends[:], self._were_held[:], self._fade = NEVER, False, None
        numbers, self.numbers = self.numbers, self._first_numbers
        self.set(numbers, fade_ticks=0)
