"""Tests of every cause of a trip: tick, bound, and priority."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from errors import raises

from twin_gait import load_experiment
from twin_gait.control import device_schedule as device
from twin_gait.control.joint_board import BoardState
from twin_gait.core import safety
from twin_gait.core.safety import NO_TRIP
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import CompiledEngine, assemble
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.executors import scalar_driver
from twin_gait.simulation.record import deep_copy, dtype_of, to_array
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.schedule import NAMES, RECEIVE
from twin_gait.simulation.simulation_setup import build_setup

JOINT, LEG = 2, 1  # right hip and right leg of the treadmill: none is the first
EULER = "integration={method: semi_implicit_euler, step_ms: 0.25}"


class Case(NamedTuple):
    """Bound of the monitor and a function that exceeds it.

    Attributes:
        put: Writes a value to the field that the monitor reads.
        bound: Largest or smallest value without a trip.
        ticks: Number of ticks for which the bound may be exceeded.
        place: As in the trip.
        side: Direction of the values that exceed the bound.
    """

    put: Callable[[Episode, float], None]
    bound: Callable[[Episode], float]
    ticks: Callable[[Episode], int]
    place: int = JOINT
    side: float = math.inf

    def beyond(self, e: Episode) -> float:
        """Return the first value that exceeds the bound."""
        return math.nextafter(self.bound(e), self.side)


def watched_joint(e: Episode) -> BoardState:
    return e.joints[JOINT].board


def jump(e: Episode, amount: float) -> None:
    watched_joint(e).encoder.last_angle, watched_joint(e).encoder.angle = 0.0, amount


def residual(e: Episode, amount: float) -> None:
    watched_joint(e).bounds.model_gain, watched_joint(e).monitor.residual = 0.0, amount


def speed(e: Episode, amount: float) -> None:
    watched_joint(e).bounds.stop_distance_factor, watched_joint(e).encoder.velocity_fast = 0.0, amount


def angle(e: Episode, amount: float) -> None:
    watched_joint(e).encoder.last_angle = watched_joint(e).encoder.angle = amount


def heat(e: Episode, amount: float) -> None:
    bounds = watched_joint(e).bounds
    bounds.heating, bounds.cooling, watched_joint(e).monitor.heat = 0.0, 0.0, amount


def deviation(e: Episode, amount: float) -> None:
    watched_joint(e).bounds.command_gain, watched_joint(e).monitor.command_deviation = 0.0, amount


def command(e: Episode, amount: float) -> None:
    """Set a setpoint that agrees with the command."""
    board = watched_joint(e)
    board.monitor.last_command = board.setpoint.target = amount


def still_load(e: Episode, amount: float) -> None:
    """Freeze the load while the encoder of the moving hip is valid."""
    jump(e, 1e-3)
    e.feet[LEG].load = e.controller.legs[LEG].load = 0.4
    watched_joint(e).monitor.motor_speed = amount


def remembered(name: str) -> Callable[[Episode, float], None]:
    return lambda e, amount: setattr(watched_joint(e).monitor, name, amount)


def of_bounds(name: str) -> Callable[[Episode], Any]:
    return lambda e: getattr(watched_joint(e).bounds, name)


def at_once(e: Episode) -> int:
    return 1


JOINT_CASES = {
    "JUMP": Case(jump, of_bounds("angle_step"), at_once),
    "FROZEN": Case(remembered("motor_speed"), of_bounds("frozen_speed"), of_bounds("frozen_ticks")),
    "MODEL": Case(residual, of_bounds("model_deviation"), at_once),
    "SPEED": Case(speed, of_bounds("highest_speed"), at_once),
    "RANGE": Case(angle, of_bounds("upper"), at_once),
    "TORQUE": Case(command, of_bounds("highest_torque"), of_bounds("torque_ticks")),
    "CURRENT": Case(remembered("motor_current"), of_bounds("highest_current"), at_once),
    "HEAT": Case(heat, lambda e: 1.0, at_once),
    "SETPOINT": Case(deviation, of_bounds("command_deviation"), at_once),
    "DRIVE": Case(remembered("current_deviation"), of_bounds("drive_deviation"), of_bounds("drive_ticks")),
}
OTHER_CASES = {
    "LOAD": Case(still_load, of_bounds("frozen_speed"), lambda e: e.limits.frozen_load_ticks, 4 + LEG),
    "SUPPLY": Case(
        lambda e, amount: setattr(e.supply, "bus_voltage", amount),
        lambda e: e.controller.supply.least_voltage,
        lambda e: e.controller.supply.low_ticks,
        -1,
        -math.inf,
    ),
}
CASES = {
    **JOINT_CASES,
    **OTHER_CASES,
    "RANGE below": Case(angle, of_bounds("lower"), at_once, side=-math.inf),
    "MISSING": Case(angle, lambda e: 0.1, at_once, side=math.nan),
}


def code(name: str) -> int:
    found: int = getattr(safety, f"{name.split()[0]}_TRIP")
    return found


@pytest.fixture(scope="module")
def treadmill():
    return build_setup(load_experiment("treadmill_guided", ["duration_s=0.2", EULER]).experiment)


@pytest.fixture(scope="module")
def laid(treadmill):
    """Return episode and build flags of the treadmill, standing still with valid measurements."""
    _, e, structure = assemble(treadmill)
    for joint in e.joints:
        joint.board.encoder.angle = joint.board.encoder.last_angle = 0.1
    return e, structure


watched = scalar_driver("watched", (device.MONITOR_DRIVES, *RECEIVE, device.MONITOR), NAMES)
control = scalar_driver("control", device.COMMAND, NAMES)


@pytest.fixture(scope="module")
def look(laid):
    """Return the monitor in plain Python."""
    return specialize(watched, laid[1])


@pytest.fixture
def e(laid):
    return deep_copy(laid[0])


def broken_for(e: Episode, look: Callable[..., None], case: Case, ticks: int, amount: float) -> None:
    """Apply a value for some ticks; quantities that the bound accumulates do not grow meanwhile."""
    first = 100
    for tick in range(first, first + ticks):
        joint = watched_joint(e)
        joint.monitor.residual = joint.monitor.heat = 0.0
        case.put(e, amount)
        look(e, tick)


def kept(e: Episode) -> tuple[int, int, int]:
    return e.controller.trip.tick, e.controller.trip.cause, e.controller.trip.part


def test_cases_cover_every_cause_of_the_monitor():
    names = {name.removesuffix("_TRIP") for name in vars(safety) if name.endswith("_TRIP")}
    elsewhere = {"NO", "OPERATOR", "COMMAND", "PHASE", "BUS"}  # have tests of their own
    assert {name.split()[0] for name in CASES} == names - elsewhere


@pytest.mark.parametrize("name", CASES)
def test_a_value_on_the_bound_never_trips(e, look, name):
    case = CASES[name]
    broken_for(e, look, case, 3 * case.ticks(e), case.bound(e))
    assert kept(e) == (-1, NO_TRIP, 0)


@pytest.mark.parametrize("name", CASES)
def test_the_first_value_beyond_the_bound_trips_after_its_time(e, look, name):
    case = CASES[name]
    needed, amount = case.ticks(e), case.beyond(e)
    broken_for(e, look, case, needed - 1, amount)
    assert kept(e) == (-1, NO_TRIP, 0)
    broken_for(e, look, case, 1, amount)
    assert kept(e) == (100, code(name), case.place)
    cut_off = [joint.board.command.drive_off for joint in e.joints]
    assert cut_off == [name == "DRIVE" and n == JOINT for n in range(4)]
    assert [joint.hold_angle for joint in e.controller.joints] == [
        joint.board.encoder.last_angle for joint in e.joints
    ]


@pytest.mark.parametrize("name", ["FROZEN", "TORQUE", "DRIVE", "LOAD", "SUPPLY"])
def test_a_single_tick_within_the_bound_resets_the_time(e, look, name):
    case = CASES[name]
    needed, amount = case.ticks(e), case.beyond(e)
    assert needed > 1
    for _ in range(2):
        broken_for(e, look, case, needed - 1, amount)
        broken_for(e, look, case, 1, case.bound(e))
    assert e.controller.trip.tick < 0


def test_an_unloaded_foot_or_a_changing_load_is_not_a_frozen_load(e, look):
    case = CASES["LOAD"]
    for loads in ((0.0, 0.0), (0.4, 0.4 + 1e-12)):

        def put(e: Episode, amount: float, loads: tuple[float, float] = loads) -> None:
            still_load(e, amount)
            e.feet[LEG].load, e.controller.legs[LEG].load = loads

        broken_for(e, look, case._replace(put=put), 3 * case.ticks(e), case.beyond(e))
    assert e.controller.trip.tick < 0


def test_a_phase_times_out_one_tick_after_its_maximum_time(e, look):
    e.limits.phase_ticks = 50
    e.controller.legs[0].entry_tick, e.controller.legs[1].entry_tick = 30, 20
    for tick in range(20, 71):
        look(e, tick)
    assert e.controller.trip.tick < 0
    look(e, 71)
    assert kept(e) == (71, safety.PHASE_TRIP, 4 + 1)


def test_a_leg_commanded_to_stand_does_not_time_out(e, look):
    e.limits.phase_ticks, e.controller.last_stand_tick = 50, 100
    look(e, 150)
    assert e.controller.trip.tick < 0
    look(e, 151)
    assert kept(e) == (151, safety.PHASE_TRIP, 4 + 0)


def test_a_command_that_follows_its_setpoint_does_not_deviate(e, look):
    """This holds for all terms of the setpoint and all measurements."""
    board = watched_joint(e)
    setpoint, encoder = board.setpoint, board.encoder
    setpoint.stiffness, setpoint.damping, setpoint.equilibrium, setpoint.gain = 200.0, 40.0, -0.2, 0.5
    setpoint.gravity, setpoint.inertia, setpoint.target = 7.0, -2.0, 5.0
    encoder.velocity_fast, board.model_friction = 0.3, 4.0
    board.monitor.last_command = -(200.0 * (0.1 + 0.2) + 40.0 * 0.3) + 0.5 * 4.0 + 7.0 - 2.0 + 5.0
    look(e, 100)
    assert board.monitor.command_deviation == pytest.approx(0.0, abs=1e-12)
    encoder.last_angle = encoder.angle = 0.1 + 0.05  # a change of the spring's torque by 10 N·m
    look(e, 101)
    assert board.monitor.command_deviation == pytest.approx(10.0 * board.bounds.command_gain)


def test_a_command_that_deviates_from_its_setpoint_trips_after_the_filter_delay(e, look):
    board = watched_joint(e)
    bound, gain = board.bounds.command_deviation, board.bounds.command_gain
    board.monitor.last_command = -2.0 * bound
    needed = math.ceil(math.log(0.5) / math.log(1.0 - gain))  # of a first-order filter, to half of a step
    for tick in range(100, 100 + needed - 1):
        look(e, tick)
    assert e.controller.trip.tick < 0
    look(e, 100 + needed - 1)
    assert kept(e) == (100 + needed - 1, safety.SETPOINT_TRIP, JOINT)


def test_a_held_joint_has_no_set_point_to_deviate_from(e, look):
    board = watched_joint(e)
    board.setpoint.held, board.monitor.last_command = True, 50.0
    for tick in range(100, 200):
        look(e, tick)
    assert board.monitor.command_deviation == 0.0 and e.controller.trip.tick < 0


# ------------------------------------------------------------------ several in one tick


def nearly(e: Episode) -> None:
    """Set all time counters of all joints and legs to one tick before their trip."""
    for joint in e.joints:
        joint.board.monitor.frozen_streak = joint.board.bounds.frozen_ticks - 1
        joint.board.monitor.torque_streak = joint.board.bounds.torque_ticks - 1
        joint.board.monitor.drive_streak = joint.board.bounds.drive_ticks - 1
    for leg in e.controller.legs:
        leg.load_streak = e.limits.frozen_load_ticks - 1
    e.controller.supply.low_streak = e.controller.supply.low_ticks - 1


@pytest.mark.parametrize("first", ["MISSING", *JOINT_CASES])
def test_the_first_listed_of_several_causes_on_a_joint_is_kept(e, look, first):
    nearly(e)
    names = list(JOINT_CASES)
    later = names[names.index(first) + 1 :] if first in names else names
    for name in reversed([first, *later]):
        CASES[name].put(e, CASES[name].beyond(e))
    look(e, 100)
    assert kept(e) == (100, code(first), JOINT)
    # The drive is cut off whatever was found first.
    assert [joint.board.command.drive_off for joint in e.joints] == [number == JOINT for number in range(4)]


def ignore_command(e: Episode, number: int) -> None:
    e.joints[number].board.monitor.current_deviation = -2.0 * e.joints[number].board.bounds.drive_deviation


def test_of_several_joints_the_first_is_kept_and_every_broken_drive_cut_off(e, look):
    nearly(e)
    ignore_command(e, 1)
    ignore_command(e, 3)
    jump(e, 1.0)
    look(e, 100)
    assert kept(e) == (100, safety.DRIVE_TRIP, 1)
    assert [joint.board.command.drive_off for joint in e.joints] == [False, True, False, True]


def exceed_phase_time(e: Episode, leg: int) -> None:
    e.limits.phase_ticks = 50
    e.controller.legs[leg].entry_tick = 100 - 51
    e.controller.legs[1 - leg].entry_tick = 100


def freeze_load(e: Episode, leg: int) -> None:
    hip = e.joints[2 * leg]
    hip.board.encoder.angle = hip.board.encoder.last_angle + 1e-3
    hip.board.monitor.motor_speed = 2.0 * hip.board.bounds.frozen_speed
    e.feet[leg].load = e.controller.legs[leg].load = 0.4


def lower_bus_voltage(e: Episode) -> None:
    e.supply.bus_voltage = 0.5 * e.controller.supply.least_voltage


IN_ORDER = [
    (lambda e: ignore_command(e, 3), "DRIVE", 3),
    (lambda e: exceed_phase_time(e, 1), "PHASE", 4 + 1),
    (lambda e: freeze_load(e, 1), "LOAD", 4 + 1),
    (lower_bus_voltage, "SUPPLY", -1),
]


@pytest.mark.parametrize("first", range(len(IN_ORDER)), ids=[name for _, name, _ in IN_ORDER])
def test_joints_are_checked_before_legs_and_the_phase_before_the_foot(e, look, first):
    nearly(e)
    for put, _, _ in IN_ORDER[first:]:
        put(e)
    look(e, 100)
    _, name, part = IN_ORDER[first]
    assert kept(e) == (100, code(name), part)


def test_a_later_cause_only_cuts_off_a_broken_drive(e, look):
    nearly(e)
    lower_bus_voltage(e)
    look(e, 100)
    held = [joint.hold_angle for joint in e.controller.joints]
    assert kept(e) == (100, safety.SUPPLY_TRIP, -1) and held == [0.1] * 4
    angle(e, 0.2)
    ignore_command(e, 0)
    for tick in range(101, 101 + e.joints[0].board.bounds.drive_ticks):
        assert not e.joints[0].board.command.drive_off
        look(e, tick)
    assert [joint.board.command.drive_off for joint in e.joints] == [True, False, False, False]
    assert kept(e) == (100, safety.SUPPLY_TRIP, -1)
    assert [joint.hold_angle for joint in e.controller.joints] == held


# ------------------------------------------------------------------ the command


@pytest.fixture(scope="module")
def tick_setpoints(laid):
    """Return the step of commands, trips and drives of a tick, joint by joint."""
    return specialize(control, laid[1])


def slacken(e: Episode) -> None:
    """Set all terms of the command to zero except the target."""
    for joint in e.controller.joints:
        joint.blended.stiffness = joint.blended.damping = joint.blended.gain = joint.target = 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_command_trips_at_the_first_value_beyond_its_bound(e, tick_setpoints, sign):
    slacken(e)
    highest = e.joints[JOINT].board.bounds.highest_command
    e.controller.joints[JOINT].target = sign * highest
    tick_setpoints(e, 99)
    assert e.controller.trip.tick < 0 and e.joints[JOINT].board.command.torque == sign * highest
    e.controller.joints[JOINT].target = sign * math.nextafter(highest, math.inf)
    tick_setpoints(e, 100)
    assert kept(e) == (100, safety.COMMAND_TRIP, JOINT)


def test_a_nan_command_trips_only_with_a_monitor(e, tick_setpoints):
    slacken(e)
    e.controller.joints[JOINT].target = math.nan
    alone = deep_copy(e)
    alone.watching = False
    tick_setpoints(alone, 100)
    assert alone.controller.trip.tick < 0 and math.isnan(alone.joints[JOINT].board.command.torque)
    tick_setpoints(e, 100)
    assert kept(e) == (100, safety.COMMAND_TRIP, JOINT)
    assert e.joints[JOINT].board.command.torque == 0.0


def test_the_first_of_two_wrong_commands_is_kept(e, tick_setpoints):
    slacken(e)
    for number in (1, 3):
        e.controller.joints[number].target = math.inf
    tick_setpoints(e, 100)
    assert kept(e) == (100, safety.COMMAND_TRIP, 1)
    assert [joint.board.command.cause for joint in e.joints] == [0, safety.COMMAND_TRIP, 0, 0]


def test_in_the_tick_of_a_wrong_command_earlier_joints_walk_and_later_joints_are_held(e, tick_setpoints):
    slacken(e)
    for number, joint in enumerate(e.controller.joints):
        joint.target = 3.0 + number
        e.joints[number].board.monitor.motor_speed = 0.2
        e.controller.model.gravity_torque[joint.model_index] = 10.0 + number
    e.controller.joints[1].target = math.nan
    tick_setpoints(e, 100)
    braked = -e.limits.hold_damping * 0.2
    # The weight of the joint itself is carried from the next tick on: this one began as one of a walk.
    assert [joint.board.command.torque for joint in e.joints] == [3.0, braked, braked + 12.0, braked + 13.0]
    speeds = [joint.board.monitor.motor_speed for joint in e.joints]
    tick_setpoints(e, 101)
    share = 1.0 - 1 / e.limits.lowering_ticks
    for number, (joint, found) in enumerate(zip(e.joints, speeds, strict=True)):
        assert joint.board.command.torque == -e.limits.hold_damping * found + share * (10.0 + number)


def test_after_a_trip_the_controller_is_not_called(e, laid):
    def never(*measured: float) -> float:
        raise AssertionError("called in the hold")

    control_step = specialize(control, {**laid[1], "impedance_torque": never})
    with raises(AssertionError, "hold"):
        control_step(e, 100)
    e.controller.trip.tick, e.controller.trip.cause, e.controller.trip.part = 100, safety.SUPPLY_TRIP, -1
    control_step(e, 101)
    assert kept(e) == (100, safety.SUPPLY_TRIP, -1)
    assert [joint.board.command.torque for joint in e.joints] == [0.0] * 4


# ------------------------------------------------------------------ compiled


@pytest.mark.compile
def test_compiled_the_monitor_leaves_the_same_record_in_every_case(laid, look):
    """In the tick of the trip and in the next one, number for number."""
    from twin_gait.simulation.compiling import compile_loop, record_accessor

    sample, structure = laid
    episode_at = record_accessor(dtype_of(sample))

    def look_at(address: int, tick: int, end: int) -> int:
        watched(episode_at(address), tick)
        return 0

    loop = compile_loop(look_at, structure).function

    def both(e: Episode, tick: int) -> None:
        store = to_array(e)
        look(e, tick)
        loop(store.ctypes.data, tick, tick + 1)
        assert repr(store.tolist()) == repr(to_array(e).tolist())

    for case in CASES.values():
        e = deep_copy(sample)
        nearly(e)
        broken_for(e, both, case, 2, case.beyond(e))
        assert e.controller.trip.tick >= 0
    for first in range(len(IN_ORDER)):
        e = deep_copy(sample)
        nearly(e)
        for put, _, _ in IN_ORDER[first:]:
            put(e)
        both(e, 100)
        assert e.controller.trip.tick == 100


def test_both_engines_hold_in_the_tick_of_a_wrong_command(treadmill):
    """The command of the second joint is too large in tick 30."""
    reference, compiled = ReferenceEngine(treadmill), CompiledEngine(treadmill)
    theirs, ours = (np.zeros((60, len(reference.layout.names))) for _ in range(2))
    reference.run_ticks(0, 30, theirs)
    compiled.run_ticks(0, 30, ours)
    reference.episode.controller.joints[1].target = 1e5
    compiled.episode["controller"]["joints"]["target"][1] = 1e5
    reference.run_ticks(30, 60, theirs)
    compiled.run_ticks(30, 60, ours)
    assert kept(reference.episode) == (30, safety.COMMAND_TRIP, 1)
    assert tuple(compiled.episode["controller"]["trip"].tolist()) == (30, safety.COMMAND_TRIP, 1)
    np.testing.assert_allclose(ours, theirs, atol=1e-9, rtol=1e-9)
    names = reference.layout.names
    hip, knee = (names.index(f"left_{joint}_stiffness_Nm_per_rad") for joint in ("hip", "knee"))
    assert ours[30, hip] > 0.0 and not ours[30, knee]
    assert not ours[31:, [hip, knee]].any()
