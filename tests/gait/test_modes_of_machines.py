"""Tests of the modes of ReWalk and Ekso: requests in every mode, and the facts of the thesis's overview."""

from __future__ import annotations

import pytest
from errors import states

from twin_gait.configuration.gait_table_file import load_mode_table
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.modes import ModeTable, rejection_reason

REWALK, EKSO = load_mode_table("rewalk"), load_mode_table("ekso")
TO_STAND, TO_STOP = {"stand": "stopping"}, {"stop": "stopping"}
# Mode that an accepted request leads to in the tick after the entry of a mode, with all signals at 0; every
# other request is rejected.
ANSWERED = {
    "rewalk": {
        "sitting": {"sit_to_stand": "before_rising"},
        "before_rising": {"stand_to_sit": "sitting"},
        "sit_to_stand": {"stand_to_sit": "stand_to_sit"},
        "standing": {"walk": "walk", "stand_to_sit": "before_sitting"},
        "walk": TO_STAND,
        "step": TO_STAND,
        "swing": TO_STAND,
        "pause": TO_STAND,
        "stopping": {},
        "before_sitting": {"stand": "standing"},
        "stand_to_sit": {},
        "hold": {},
    },
    "ekso": {
        "sitting": {"stand": "standing_up"},
        "standing_up": {"sit": "sitting_down", "stop": "sitting_down"},
        "standing": {"sit": "sitting_down", "first_step": "first_step", "pro_step": "pro_step"},
        "first_step": {"pro_step": "pro_step", "step": "therapist_step", **TO_STOP},
        "therapist_step": TO_STOP,
        "pro_step": {"first_step": "first_step", **TO_STOP},
        "shifted_step": TO_STOP,
        "stopping": {},
        "sitting_down": {},
        "hold": {},
    },
}
TABLES = {"rewalk": REWALK, "ekso": EKSO}
CASES = [
    (name, mode, request)
    for name, table in TABLES.items()
    for mode in table.phases
    for request in table.requests
]


def after(table: ModeTable, mode: str, request: str | None, ticks: int, **signals: float) -> str:
    """Return the mode after one tick at a time since the entry of a mode; signals without a value are 0."""
    machine = GaitStateMachine(table, initial_phase=mode)
    given = {name.replace("__", "."): value for name, value in signals.items()}
    machine.step(ticks, {**dict.fromkeys(table.signals, 0.0), **given}, request)
    return machine.phase


def first_tick(table: ModeTable, mode: str, limit: int, **signals: float) -> tuple[int, str] | None:
    """Return the first tick in which constant signals change a mode, and the next mode."""
    machine = GaitStateMachine(table, initial_phase=mode)
    given = {name.replace("__", "."): value for name, value in signals.items()}
    for tick in range(1, limit + 1):
        machine.step(tick, {**dict.fromkeys(table.signals, 0.0), **given}, None)
        if machine.phase != mode:
            return tick, machine.phase
    return None


def test_the_matrix_has_all_modes():
    for name, table in TABLES.items():
        assert set(ANSWERED[name]) == set(table.phases)
    assert len(CASES) == 12 * 4 + 10 * 6


@pytest.mark.parametrize(("name", "mode", "request_"), CASES)
def test_every_request_is_accepted_or_rejected_with_a_reason(name, mode, request_):
    table, answered = TABLES[name], ANSWERED[name][mode]
    signals = (
        {"legs_in_swing": 1.0} if mode == "swing" else {}
    )  # without a leg in the air, swing ends by itself
    assert after(table, mode, request_, 1, **signals) == answered.get(request_, mode)
    why = rejection_reason(table, mode, request_, signals, 1)
    if request_ in answered:
        assert why is None
    else:
        assert why is not None and states(why, mode, request_, *answered)


# ------------------------------------------------------------------ facts of the thesis, section 1.2.1


@pytest.mark.parametrize(
    ("waiting", "motion"), [("before_rising", "sit_to_stand"), ("before_sitting", "stand_to_sit")]
)
def test_rewalk_waits_for_three_seconds_before_it_stands_up_or_sits_down(waiting, motion):
    assert first_tick(REWALK, waiting, 5000) == (3000, motion)
    sources = {item.source for item in REWALK.transitions if item.target == motion}
    assert sources <= {waiting, "sit_to_stand"}  # a wearer who does not rise is lowered again


def test_a_tilt_of_rewalk_starts_a_step_in_walk_and_none_in_stand():
    tilted = {"trunk__pitch_deg": 9.0 + 1e-9}
    assert first_tick(REWALK, "walk", 500, **tilted) == (200, "step")
    assert first_tick(REWALK, "walk", 500, trunk__pitch_deg=9.0) is None
    assert first_tick(REWALK, "walk", 500, **tilted, legs_in_swing=1.0) is None
    assert first_tick(REWALK, "standing", 5000, trunk__pitch_deg=40.0) is None


def test_rewalk_pauses_between_steps_however_far_the_trunk_is_tilted():
    tilted = {"trunk__pitch_deg": 40.0}
    assert first_tick(REWALK, "step", 5000, **tilted, legs_in_swing=1.0) == (1, "swing")
    assert first_tick(REWALK, "swing", 5000, **tilted, legs_in_swing=1.0) is None
    assert first_tick(REWALK, "swing", 5000, **tilted) == (1, "pause")
    assert first_tick(REWALK, "pause", 5000, **tilted) == (500, "walk")


def loads(side: str, ahead: float, more: float, **others: float) -> dict[str, float]:
    """Return a hip in front by an angle in [°], and a foot with more load in [body weights]."""
    return {f"{side}__hip__angle_deg": ahead, f"{side}__foot__load_bw": more, **others}


@pytest.mark.parametrize("side", ["left", "right"])
def test_weight_on_the_front_foot_starts_a_step_of_ekso(side):
    shifted = loads(side, 5.1, 0.31)
    assert first_tick(EKSO, "pro_step", 500, **shifted) == (100, "shifted_step")
    assert first_tick(EKSO, "pro_step", 500, **loads(side, 5.1, 0.3)) is None
    assert first_tick(EKSO, "pro_step", 500, **shifted, legs_in_swing=1.0) is None
    other = "right" if side == "left" else "left"
    behind = {f"{other}__hip__angle_deg": 20.0, f"{side}__foot__load_bw": 0.9}
    assert first_tick(EKSO, "pro_step", 500, **behind) is None  # the weight is on the foot behind


def test_a_lean_starts_only_the_first_step_of_ekso():
    assert first_tick(EKSO, "pro_step", 500, trunk__pitch_deg=9.1) == (200, "shifted_step")
    apart = {"trunk__pitch_deg": 40.0, "left__hip__angle_deg": 20.0}
    assert first_tick(EKSO, "pro_step", 500, **apart) is None


def test_only_the_therapist_starts_a_step_of_ekso_in_first_step():
    shifted = loads("left", 20.0, 0.9, trunk__pitch_deg=20.0)
    assert first_tick(EKSO, "first_step", 5000, **shifted) is None
    assert after(EKSO, "first_step", "step", 1, **shifted) == "therapist_step"
    assert after(EKSO, "first_step", "step", 1, legs_in_swing=1.0) == "first_step"
    assert after(EKSO, "pro_step", "step", 1) == "pro_step"
