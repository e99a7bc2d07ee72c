"""Drivers of schedules: order, groups, conditions, and what is refused; where loops over lanes are left."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from errors import raises

import twin_gait
from twin_gait import load_experiment
from twin_gait.control import device_schedule
from twin_gait.core.schedule import (
    BlockStep,
    joints,
    legs,
    replace_steps,
    scalar_branch,
    scalar_steps,
    vector_branch,
    when,
)
from twin_gait.simulation import build_flags, schedule
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.build_flags import compute_build_flags
from twin_gait.simulation.executors import ScheduleNames, lane_driver, scalar_driver
from twin_gait.simulation.simulation_setup import build_setup

NAMES = ScheduleNames(
    arguments={"e": "{e}", "tick": "tick", "number": "number", "leg": "{e}.legs[number]"},
    counts={"joints": "len({e}.joints)", "legs": "len({e}.legs)"},
    fields={"tick": "tick", "decimation": "{e}.decimation"},
    flags={"FAST": False, "COUNT": 0},
)


def first(e: Any, tick: int) -> None:
    e.trace.append(f"first {tick}")


def second(e: Any) -> None:
    e.trace.append("second")


def turn(e: Any, number: int) -> None:
    e.trace.append(f"turn {number}")


def swing(leg: Any) -> None:
    leg.swung += 1


def is_odd(e: Any) -> bool:
    return bool(e.name % 2)


def note(e: Any) -> None:
    e.trace.append("note")


def block(e: Any, number: int) -> None:
    e.trace.append(f"block {number}")


ALL = (
    first,
    joints(turn),
    when("FAST", second, otherwise=(legs(swing),)),
    when("COUNT > 0 and tick % decimation == 0", second),
    (note, vector_branch(is_odd, second), scalar_branch(is_odd, note)),
    scalar_steps(second, joints(turn)),
)


def episode(name: int) -> Any:
    return SimpleNamespace(
        name=name,
        trace=[],
        joints=[0, 1],
        legs=[SimpleNamespace(swung=0), SimpleNamespace(swung=0)],
        decimation=2,
    )


EXPECTED = ["first 4", "turn 0", "turn 1", "note", "second", "turn 0", "turn 1"]


def test_steps_run_in_their_order_over_their_parts():
    driver = scalar_driver("run", ALL, NAMES)
    even, odd = episode(0), episode(1)
    for e in (even, odd):
        driver(e, 4)
    assert even.trace == EXPECTED
    assert odd.trace == [*EXPECTED[:4], "second", "note", *EXPECTED[4:]]
    assert [leg.swung for leg in even.legs] == [1, 1]


@pytest.mark.parametrize(
    ("flags", "tick", "more"),
    [
        ({"FAST": True}, 4, ["second"]),
        ({"COUNT": 2}, 4, ["second"]),
        ({"COUNT": 2}, 3, []),
        ({"FAST": True, "COUNT": 1}, 6, ["second", "second"]),
    ],
)
def test_build_flags_are_specialized_and_shared_fields_are_read(flags, tick, more):
    e, driver = episode(0), scalar_driver("run", ALL, NAMES, module="twin_gait.driver_of_a_test")
    specialize(driver, flags)(e, tick)
    assert e.trace == [f"first {tick}", "turn 0", "turn 1", *more, *EXPECTED[3:]]


class Several:
    """A block of episodes in plain Python: it has the shared fields of the first one."""

    def __init__(self, *episodes: Any) -> None:
        self.episodes, self.trace = episodes, []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.episodes[0], name)


def in_plain_python(driver: Any) -> Any:
    driver.__globals__.update({name: lambda e: e.episodes for name in ("vector_lanes", "scalar_lanes")})
    return driver


def test_in_lanes_every_episode_runs_its_own_steps_and_some_run_for_all():
    alone, together = [episode(0), episode(1)], [episode(0), episode(1)]
    for e in alone:
        scalar_driver("run", ALL, NAMES)(e, 4)
    in_plain_python(lane_driver("run", ALL, NAMES))(Several(*together), 4)
    assert together[1].trace == alone[1].trace
    # The steps of ``some`` run for the even episode, too, because the odd one needs them.
    assert together[0].trace == [*EXPECTED[:4], "second", *EXPECTED[4:]]


def test_conditional_steps_run_for_no_lane_if_no_test_holds():
    together = [episode(0), episode(2)]
    in_plain_python(lane_driver("run", ALL, NAMES))(Several(*together), 4)
    assert [e.trace for e in together] == [EXPECTED, EXPECTED]


def test_the_result_holds_for_one_episode_or_for_any_of_a_block():
    alone = scalar_driver("run", (note,), NAMES, result=is_odd)
    assert [alone(episode(name), 0) for name in (0, 1)] == [False, True]
    driver = in_plain_python(lane_driver("run", (note,), NAMES, result=is_odd))
    assert driver(Several(episode(0), episode(1)), 0) and not driver(Several(episode(0), episode(2)), 0)


def test_neighbouring_steps_share_a_loop_over_the_lanes_also_under_build_flags():
    text = inspect.getsource(lane_driver("run", (first, when("FAST", second), note), NAMES))
    assert text.count("in vector_lanes(e)") == 1
    text = inspect.getsource(lane_driver("run", (first, when("tick > 0", second), note), NAMES))
    assert text.count("in vector_lanes(e)") == 3


def test_a_function_of_the_block_gets_the_block():
    together = Several(episode(0), episode(1))
    in_plain_python(lane_driver("run", (legs(BlockStep(block)),), NAMES))(together, 0)
    assert together.trace == ["block 0", "block 1"]
    assert [e.trace for e in together.episodes] == [[], []]


def test_steps_are_replaced_inside_of_groups_and_not_again_in_their_replacement():
    changed = replace_steps(ALL, {second: (note, second), turn: first})
    e = episode(1)
    scalar_driver("run", changed, NAMES)(e, 0)
    pair = ["note", "second"]
    assert e.trace == [*["first 0"] * 3, "note", *pair, "note", *pair, *["first 0"] * 2]
    assert ALL[1] == joints(turn)
    with raises(KeyError, "swing"):
        replace_steps((first, second), {swing: first})


def needs(e: Any, wheel: int) -> None: ...


def other_note(e: Any) -> None: ...


other_note.__name__ = "note"


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ((when("SLOW", first),), ("SLOW", "FAST", "COUNT", "tick")),
        ((when("FAST and angle > 0", first),), ("FAST and angle > 0", "angle", "FAST", "COUNT")),
        ((first, needs), ("needs", "wheel", "e, tick, number, leg")),
        ((note, other_note), ("note",)),
    ],
)
@pytest.mark.parametrize("made", [scalar_driver, lane_driver])
def test_undeclared_names_are_refused_when_the_schedule_is_built(made, steps, message):
    with raises(ValueError, *message):
        made("run", steps, NAMES)


def test_two_drivers_of_one_name_have_each_its_own_text():
    one, other = (scalar_driver("run", (step,), NAMES) for step in (note, second))
    assert "note(e)" in inspect.getsource(one) and "second(e)" in inspect.getsource(other)


# ------------------------------------------------------------------ the tick


def test_every_declared_flag_of_a_tick_is_set_for_an_experiment():
    problem = build_setup(load_experiment("treadmill_guided", []).experiment)
    found = compute_build_flags(problem, 4)
    assert build_flags.FLAGS.keys() | device_schedule.FLAGS.keys() <= found.keys()
    assert schedule.NAMES.flags == {**device_schedule.FLAGS, **build_flags.FLAGS}


def test_loops_over_lanes_are_left_in_the_integration_and_the_guards_alone():
    package = Path(twin_gait.__file__).parent
    found = {}
    for path in package.rglob("*.py"):
        count = len(
            re.findall(
                r"^ *for \w+ in (?:vector_lanes|scalar_lanes)\(",
                path.read_text(encoding="utf-8"),
                re.MULTILINE,
            )
        )
        if count:
            found[path.relative_to(package / "simulation").as_posix()] = count
    assert found.keys() == {"stages/motion.py", "stages/phases.py", "backend.py"}
    assert sum(found.values()) <= 25
