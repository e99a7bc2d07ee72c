"""Tests of the operating modes: accepted and rejected requests of each mode; supervisor of the device."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from errors import raises, states
from table_builder import transition, two_phase_table

from twin_gait.configuration.gait_table_file import load_mode_table, packaged_mode_tables
from twin_gait.control.supervisor import (
    NO_POSTURE,
    NO_REQUEST,
    ModeCommand,
    Supervisor,
    choose_mode,
)
from twin_gait.exceptions import GaitTableError, MeasurementError, ParameterError
from twin_gait.gait.guards import MODE_VOCABULARY, AllOf, parse_guard
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.modes import Mode, TimedRequest, check_requests, parse_request, rejection_reason
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import TIME, find_signal, mode_signal_names, signal_names
from twin_gait.gait.table import Transition
from twin_gait.testing.cases import TransitionTest, transition_tests

TWIN = load_mode_table("twin")
STOP = {"stop": "stopping", "stand": "stopping"}
# Where a request leads to that is answered, after 5 s with all joints straight, the trunk upright and no leg
# in the air; the stages of a step after 1 s, since they end by themselves. All others are refused.
ANSWERED = {
    "sitting": {"stand": "sit_up"},
    "sit_up": {"sit": "sit_down", "stop": "sit_down"},
    "standing": {
        "sit": "sit_down",
        "walk": "walk_manual",
        "walk_automatic": "walk_automatic",
        "twin_care": "twin_care",
        "gravity": "gravity",
    },
    "walk_manual": {"step": "manual_step", **STOP},
    "manual_step": STOP,
    "walk_automatic": STOP,
    "automatic_step": STOP,
    "twin_care": STOP,
    "stopping": {},
    "gravity": {"stop": "standing", "stand": "standing"},
    "sit_down": {},
    "hold": {},
}
PAIRS = [(mode, request) for mode in TWIN.phases for request in TWIN.requests]


def named(signals: dict[str, float]) -> dict[str, float]:
    """Return signals by name from keywords; all others are 0."""
    given = {name.replace("__", "."): value for name, value in signals.items()}
    return {**dict.fromkeys(TWIN.signals, 0.0), **given}


def after(mode: str, request: str | None, ticks: int, **signals: float) -> str:
    """Return the mode after a request at a time since the entry of a mode."""
    machine = GaitStateMachine(TWIN, initial_phase=mode)
    machine.step(ticks, named(signals), request)
    return machine.phase


def ticks_in(mode: str) -> int:
    return 1000 if mode.endswith("_step") else 5000


def test_the_matrix_is_about_all_modes():
    assert list(ANSWERED) != [] and set(ANSWERED) == set(TWIN.phases) and len(PAIRS) == 96


@pytest.mark.parametrize(("mode", "request_"), PAIRS)
def test_every_request_in_every_mode_is_answered_or_refused(mode, request_):
    ticks = ticks_in(mode)
    assert after(mode, request_, ticks) == ANSWERED[mode].get(request_, mode)
    why = rejection_reason(TWIN, mode, request_, {}, ticks)
    if request_ in ANSWERED[mode]:
        assert why is None
    else:
        assert why is not None and states(why, mode, request_, *ANSWERED[mode])


def test_sitting_down_is_only_accepted_while_standing_or_before_rising():
    assert {item.source for item in TWIN.transitions if item.target == "sit_down"} == {"standing", "sit_up"}


def test_sitting_down_is_only_accepted_after_three_seconds_of_standing():
    assert after("standing", "sit", 2999) == "standing" and after("standing", "sit", 3000) == "sit_down"
    assert states(rejection_reason(TWIN, "standing", "sit", {}, 2999) or "", "standing", "2.999 s", "3 s")


def test_a_rejection_states_the_measured_values():
    bent = {"left.hip.angle_deg": 25.0, "right.knee.angle_deg": 60.0}
    why = rejection_reason(TWIN, "gravity", "stand", bent, 100)
    assert why is not None and states(why, "left.hip.angle_deg < 20", "25", "right.knee.angle_deg", "60")
    assert after("gravity", "stand", 100, left__hip__angle_deg=25.0) == "gravity"
    nothing = rejection_reason(TWIN, "walk_manual", "step", {"legs_in_swing": math.nan}, 1)
    assert nothing is not None and states(nothing, "request in [step] and legs_in_swing < 0.5", "nan")


def test_a_request_is_rejected_if_the_transition_would_happen_without_it():
    """A transition that is due without the request does not count as its execution."""
    supervisor = new_supervisor("sit_down")
    supervisor.request = code("stand")
    choose_mode(supervisor, 12000, False)
    assert name_of(supervisor) == "sitting" and supervisor.rejected == code("stand")


# ------------------------------------------------------------------ the supervisor of the device


def code(request: str | None) -> int:
    return NO_REQUEST if request is None else 1 + TWIN.requests.index(request)


def new_supervisor(mode: str = "sitting") -> Supervisor:
    return Supervisor(
        program=compile_guards(TWIN),
        modes=[ModeCommand(NO_POSTURE, float(item.walk), float(item.step)) for item in TWIN.phases.values()],
        hold=TWIN.phase_index("hold"),
        swing=0,
        signals=[0.0] * len(TWIN.signals),
        debounce=[0] * len(TWIN.transitions),
        mode=TWIN.phase_index(mode),
    )


def name_of(supervisor: Supervisor) -> str:
    return TWIN.phase_names[supervisor.mode]


def measure(supervisor: Supervisor, tick: int, **signals: float) -> None:
    time = 1e-3 * (tick - supervisor.entry_tick)
    supervisor.signals[:] = TWIN.to_si({**named(signals), TIME: time})


def lean(degrees: list[float], entered: int = 0) -> list[int]:
    """Return the ticks in which the automatic walk makes a step for a course of the trunk lean."""
    supervisor, steps = new_supervisor("walk_automatic"), []
    for tick, pitch in enumerate(degrees, start=1):
        measure(supervisor, tick, trunk__pitch_deg=pitch)
        choose_mode(supervisor, tick, False)
        if supervisor.entered:
            steps.append(tick)
            break
    return steps


def test_a_lean_has_to_pass_its_threshold_and_be_held():
    assert lean([9.0 + 1e-9] * 199) == [] and lean([9.0 + 1e-9] * 200) == [200]
    assert lean([9.0] * 1000) == [] and lean([9.0 - 1e-9] * 1000) == []


def test_an_interrupted_lean_restarts_its_hold_time():
    assert lean([10.0] * 199 + [9.0] + [10.0] * 200) == [400]
    assert lean([10.0] * 199 + [math.nan] + [10.0] * 199) == []


def test_an_unmeasured_signal_opens_no_guard():
    assert lean([math.nan] * 1000) == []
    supervisor = new_supervisor("walk_manual")
    measure(supervisor, 1, legs_in_swing=math.nan)
    supervisor.request = code("step")
    choose_mode(supervisor, 1, False)
    assert name_of(supervisor) == "walk_manual" and supervisor.rejected == code("step")
    with raises(MeasurementError, "supervisor", "trunk.pitch_deg", "nan"):
        GaitStateMachine(TWIN, initial_phase="walk_automatic").step(1, named({"trunk.pitch_deg": math.nan}))


@pytest.mark.parametrize("mode", TWIN.phase_names)
def test_a_trip_leads_to_a_permanent_hold(mode):
    supervisor = new_supervisor(mode)
    choose_mode(supervisor, 7, True)
    assert name_of(supervisor) == "hold" and supervisor.entry_tick == (0 if mode == "hold" else 7)
    for tick, request in enumerate(TWIN.requests, start=8):
        supervisor.request = code(request)
        choose_mode(supervisor, tick, True)
        assert name_of(supervisor) == "hold" and not supervisor.entered
        assert supervisor.rejected == code(request)


def test_the_supervisor_switches_like_the_machine_and_rejects_requests_without_effect():
    """Compare on random requests and measurements; the state machine uses the same evaluator."""
    rng, time = np.random.default_rng(5), TWIN.signals.index(TIME)
    supervisor, machine = new_supervisor(), GaitStateMachine(TWIN)
    visited, refused, anew = set(), 0, 1
    for tick in range(1, 200_000):
        # Rising takes six seconds without a request; a request to sit is accepted after three.
        often = {"sit_up": 1e-4, "standing": 5e-4}.get(machine.phase, 0.005)
        if tick == anew:  # held for a while, so that debounces may end
            anew += 7000 if machine.phase == "sit_up" else 600
            angle = rng.choice([0.0, 12.0, 80.0])
            signals = {name: angle for name in TWIN.signals if name.endswith("angle_deg")}
            signals |= {"trunk.pitch_deg": rng.choice([0.0, 10.0]), "legs_in_swing": rng.choice([0.0, 1.0])}
            values = TWIN.to_si(named(signals))
        request = str(rng.choice(TWIN.requests)) if rng.random() < often else None
        before, ticks = machine.phase, tick - machine.entry_tick
        values[time] = 1e-3 * ticks
        switch = machine.advance(tick, values, code(request) - 1)
        supervisor.signals[:] = values
        supervisor.request = code(request)
        choose_mode(supervisor, tick, False)
        assert name_of(supervisor) == machine.phase and supervisor.entered == (switch is not None)
        assert supervisor.entry_tick == machine.entry_tick
        if request is not None:
            answered = switch is not None and switch.cause == "requested"
            assert supervisor.rejected == (NO_REQUEST if answered else code(request))
            why = rejection_reason(TWIN, before, request, signals, ticks)
            assert (why is None) == answered or (switch is not None and why is None)
            refused += not answered
        visited.add(machine.phase)
    assert visited == set(TWIN.phases) - {"hold"} and refused > 50


# ------------------------------------------------------------------ tables


def test_signals_are_of_both_legs_by_their_sides():
    names = mode_signal_names(("hip", "knee"))
    legs = [f"{side}.{name}" for side in ("left", "right") for name in signal_names(("hip", "knee"))]
    assert names == (*legs, "time_in_phase_s", "trunk.pitch_deg", "legs_in_swing")
    assert {"left.knee.velocity_deg_per_s", "right.foot.load_bw", "left.time_in_phase_s"} < set(legs)
    assert find_signal("legs_in_swing").unit.name == "no unit"


@pytest.mark.parametrize("text", ["other.hip.angle_deg > 5", "walk > 0.5", "other.phase in [stand]"])
def test_signals_of_a_leg_are_not_accepted_in_modes(text):
    with pytest.raises(GaitTableError):
        guard = parse_guard(text, MODE_VOCABULARY)
        replace(
            TWIN,
            transitions=(*TWIN.transitions, replace(request_transition("sitting", "sit_up"), guard=guard)),
        )


@pytest.mark.parametrize("text", ["request in [walk]", "legs_in_swing < 1", "left.hip.angle_deg > 5"])
def test_signals_of_the_supervisor_are_not_accepted_in_a_leg(text):
    with pytest.raises(GaitTableError):
        two_phase_table(transition("stance", "swing", text))


def request_transition(source: str, target: str, debounce: int = 1) -> Transition:
    guard = parse_guard("request in [stand]", MODE_VOCABULARY)
    return Transition(
        source=source, target=target, cause="x", guard=AllOf(guards=(guard,)), debounce_ticks=debounce
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hold": "flying"}, ("hold", "flying")),
        ({"hold": "sitting"}, ("hold", "sitting")),
        ({"requests": ("stand", "stand")}, ("requests", "stand")),
        ({"requests": ("stand up",)}, ("stand up",)),
        ({"requests": ("walk",)}, ("stand", "walk")),
        (
            {"transitions": (*TWIN.transitions, request_transition("hold", "standing"))},
            ("transitions[24]", "hold"),
        ),
        (
            {"transitions": (*TWIN.transitions, request_transition("sitting", "sit_up", 5))},
            ("5 ms", "debounce_ms"),
        ),
        ({"transitions": (request_transition("sitting", "sit_up"),)}, ("sit_up",)),
        ({"phases": {**TWIN.phases, "lying": Mode()}}, ("lying",)),
    ],
)
def test_an_inconsistent_mode_table_is_refused(changes, message):
    with raises(GaitTableError, *message):
        replace(TWIN, **changes)


@cache
def kit(name: str) -> list[TransitionTest]:
    return transition_tests(load_mode_table(name))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in ("ekso", "rewalk")))
        for name in packaged_mode_tables()
    ],
)
def test_the_kit_covers_every_transition_of_the_shipped_modes(name):
    for test in kit(name):
        test.run()
    several = 8 * len(load_mode_table(name).transitions)
    assert len(kit(name)) > several and sum(test.undecided is not None for test in kit(name)) < 10


@pytest.mark.parametrize(
    ("cause", "change"),
    [
        ("lean", {"debounce_ticks": 199}),
        ("closed", {"debounce_ticks": 501}),
        ("requested", {"timeout_ticks": 2999}),
    ],
)
def test_the_kit_finds_a_machine_that_is_a_tick_early_or_late(cause, change):
    (name,) = change
    given = [item for item in TWIN.transitions if item.cause == cause]
    (wrong,) = (item for item in given if getattr(item, name) not in (None, 1))
    changed = (replace(item, **change) if item is wrong else item for item in TWIN.transitions)
    other = replace(TWIN, transitions=tuple(changed))
    failed, title = [], f"{wrong.source}→{wrong.target} ({cause})::"
    for test in (test for test in kit("twin") if test.name.startswith(title)):
        try:
            replace(test, machine=lambda phase: GaitStateMachine(other, initial_phase=phase)).run()
        except AssertionError:
            failed.append(test.name)
    assert failed


def test_requests_have_a_notation():
    assert parse_request(" walk@2.5s ") == TimedRequest("walk", 2500) == parse_request("walk@2.500s")
    assert str(TimedRequest("walk", 2500)) == "walk@2.5s"
    for text in ("walk", "walk@s", "walk@1.2.3s", "@1s", "walk@-1s"):
        with raises(ParameterError, "REQUEST@TIMEs"):
            parse_request(text)
    check_requests((TimedRequest("walk", 1), TimedRequest("walk", 2)), TWIN)
