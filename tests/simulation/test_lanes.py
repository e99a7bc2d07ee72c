"""Tests of blocks in lockstep: each lane equals its single run bit for bit, and every loop is vector code.

Those that are made of experiments by :func:`simulate_blocks` are in test_together.py.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numba
import numpy as np
import pytest
from llvmlite import ir
from log_rows import log_matrix, run_result
from numba.core.errors import NumbaError

from twin_gait import load_experiment
from twin_gait.control.controller import Controller
from twin_gait.simulation import compiled_engine, compiling, lane_engine
from twin_gait.simulation import lanes as simulation_lanes
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.block import SHARED, WIDTH, interleave, number_index, shared_words
from twin_gait.simulation.compiled_engine import CompiledEngine, loop_names, run_ticks_at
from twin_gait.simulation.compiling import BIT_FUNCTIONS, compile_loop, compiler_settings, jit
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, LaneEngine, block_key
from twin_gait.simulation.lanes import LanePipeline, lane_names
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.schedule import LANE_DRIVERS
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.simulation.views import LanesView

EULER = "integration={method: semi_implicit_euler, step_ms: %s}"
RK4 = "integration={method: rk4, step_ms: %s}"
NOISE = ("sensors.ideal=false", "sensors.angle_noise_rad=1e-5")
BENCH = ("bench_leg", EULER % 1)
# ------------------------------------------------------------------ unlike episodes


@lru_cache(maxsize=2 * WIDTH)
def unlike_problem(number: int, preset: str, *settings: str) -> SimulationSetup:
    """Return a setup with individual wearer, battery, noise, duration, fall, fault and bound."""
    rng = np.random.default_rng(number)
    walking, faulty = preset != "bench_leg", any(item.startswith("faults") for item in settings)
    own = [
        f"duration_s={rng.uniform(0.2, 2.0):.3f}",
        f"seed={number}",
        f"plant.battery.internal_resistance_Ohm={rng.uniform(0.1, 0.3)}",
        f"plant.actuators.knee.gear_efficiency={rng.uniform(0.7, 1.0)}",
        f"plant.electronics={{constant_power_W: {rng.uniform(0, 20)}, regeneration: {rng.uniform(0, 1)}}}",
    ]
    if walking or any(item.startswith("patient") for item in settings):
        own += [f"patient.mass_kg={rng.uniform(50, 100)}", f"patient.height_m={rng.uniform(1.6, 1.9)}"]
    if walking:
        own.append(f"scenario.contact.forefoot_stiffness_N_per_m1p5={1e5 * (2 + number % 7)}")
    if preset == "overground":
        own.append(f"scenario.arms.shoulder_moment_Nm={rng.uniform(0.0, 10.0)}")
    elif walking and number % 6 == 4:  # falls
        own += ["scenario.support.share=0", "scenario.support.lock_stiffness_N_per_m=0"]
        own += ["table.phases.middle_stance.knee.stiffness_Nm_per_deg=0.01"]
    if number % 6 == 1:  # trips
        own.append(f"control.safety.phase_timeout_s={rng.uniform(0.05, 0.4):.3f}")
    if faulty:
        kind = ("encoder_missing", "encoder_drift", "motor_dead", "supply_dip")[number % 4]
        target = "" if kind == "supply_dip" else f":right_{('hip', 'knee')[number % 2]}"
        own.append(f"faults=['{kind}{target}@{rng.uniform(0.001, 0.19):.3f}s']")
        own.append(f"control.delay_ms={1 + number % 10}")
        own.append(f"sensors.offset.right.hip_deg={rng.uniform(-3.0, 3.0)}")
        if walking:
            own.append(f"scenario.slope_deg={rng.uniform(-5.0, 5.0)}")
    return build_setup(load_experiment(preset, [*settings, *own]).experiment)


def unlike(number: int, preset: str, *settings: str, record: bool = True) -> CompiledEngine:
    """Return an episode with individual parameters, table and ending."""
    rng = np.random.default_rng(number)
    engine = CompiledEngine(unlike_problem(number, preset, *settings))
    engine.episode["recording"]["on"] = record
    setpoints = engine.episode["controller"]["joints"]["setpoints"]
    for name in ("stiffness", "damping", "equilibrium"):
        setpoints[name] *= 1.0 + 0.05 * rng.uniform(-1.0, 1.0, setpoints[name].shape)
    if number % 6 == 2:  # commands NaN
        setpoints["equilibrium"][-1, number % 4] = np.nan
    if number % 6 == 3:  # ends as soon as a joint is quick
        engine.episode["diverged_velocity"] = rng.uniform(0.5, 2.0)
    if number % 6 == 5:  # the state becomes infinite, then undefined
        engine.episode["plant"]["stop"]["stiffness"][0] = 1e12
        engine.episode["plant"]["stop"]["upper"][0] = engine.episode["q"][0] + rng.uniform(-0.001, 0.1)
    return engine


def assert_same(ours: Run, theirs: Run, columns: Sequence[int] | None = None) -> None:
    first, second = log_matrix(ours), log_matrix(theirs)
    second = second if columns is None else second[:, list(columns)]
    assert run_result(ours) == run_result(theirs)
    assert first.shape == second.shape
    np.testing.assert_array_equal(*(np.ascontiguousarray(item).view(np.int64) for item in (first, second)))


@pytest.fixture(scope="module")
def alone() -> dict[int, Run]:
    """Return the single runs of the different episodes of the bench."""
    return {number: unlike(number, *BENCH).run() for number in range(WIDTH)}


ORDERS = {
    "as they come": range(WIDTH),
    "the other way round": range(WIDTH)[::-1],
    "any order": np.random.default_rng(0).permutation(WIDTH).tolist(),
    "fewer than lanes": [3, 9, 27, 1, 14, 0, 5, 22, 31, 17, 12, 8],
    "too few for lanes": [4, 2, 9],
    "the same one often": [6] * 7 + [1] * 5 + [6] * 4,
    "one": [5],
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
def test_a_lane_equals_its_single_run_in_any_block(alone, order):
    results = LaneEngine([unlike(number, *BENCH) for number in order]).run()
    for number, result in zip(order, results, strict=True):
        assert_same(result, alone[number])


def test_test_episodes_differ(alone):
    results = list(alone.values())
    assert {result.status for result in results} == {RunStatus.COMPLETED, RunStatus.DIVERGED}
    assert len({result.trip.tick for result in results if result.trip is not None}) > 4
    assert len({len(result.log) for result in results}) > 0.9 * WIDTH
    assert len({result.switches for result in results}) > 0.5 * WIDTH
    assert len({result.trip.cause for result in results if result.trip is not None}) > 1


@pytest.mark.parametrize("fewest", [1, MIN_BLOCK_SIZE + 1, WIDTH, WIDTH + 1])
def test_the_time_at_which_remaining_lanes_continue_alone_changes_nothing(alone, fewest, monkeypatch):
    monkeypatch.setattr(lane_engine, "MIN_BLOCK_SIZE", fewest)
    results = LaneEngine([unlike(number, *BENCH) for number in range(WIDTH)]).run()
    for number, result in enumerate(results):
        assert_same(result, alone[number])


@pytest.mark.parametrize("columns", [[], [0], [7, 3, 11], list(range(20))], ids=len)
def test_a_log_of_chosen_columns_has_the_requested_order(alone, columns):
    results = LaneEngine([unlike(number, *BENCH) for number in range(14)]).run(columns)
    for number, result in enumerate(results):
        assert_same(result, alone[number], columns)


def test_without_a_log_the_other_results_are_equal(alone):
    engines = [unlike(number, *BENCH, record=False) for number in range(12)]
    for number, result in enumerate(LaneEngine(engines).run()):
        assert run_result(result) == run_result(alone[number])
        assert result.log.shape == (0, alone[number].log.shape[1])


def test_every_engine_has_the_last_state_of_its_own_run():
    """All fields agree except signals of the guards, which freeze after a trip only if no lane walks."""
    ours, theirs = ([unlike(number, *BENCH) for number in range(16)] for _ in range(2))
    LaneEngine(ours).run()
    for engine, other in zip(ours, theirs, strict=True):
        other.run()
        for name in ("status", "q", "v", "a", "joints", "plant", "supply", "work"):
            assert engine.episode[name].tobytes() == other.episode[name].tobytes(), name
        for name in ("trip", "joints", "supply"):
            ours_has, theirs_has = (item.episode["controller"][name].tobytes() for item in (engine, other))
            assert ours_has == theirs_has, name
        assert engine.switches.tobytes() == other.switches.tobytes()


# Several things at once, because each takes half a minute to compile, alone and in lanes.
STRUCTURES: dict[str, tuple[str, ...]] = {
    "a bench that follows a path, with an imposed motion": (
        "bench_leg",
        RK4 % 1,
        "control.mode=position",
        "scenario.imposed_motion={joint: knee, amplitude_deg: 20, frequency_Hz: 0.5, release_s: 0.9}",
    ),
    "a treadmill, RK4, and a wearer that acts": (
        "treadmill_guided",
        RK4 % 0.25,
        "patient=stroke_left",
        "patient.effort_noise=0.2",
        *NOISE,
    ),
    "braces, and a trunk in straps": (
        "treadmill_guided",
        EULER % 0.1,
        "interface=brace",
        "scenario.support.pitch=soft",
        *NOISE,
    ),
    "faults, commands late, slopes, adaptive assistance and inertia compensation": (
        "treadmill_guided",
        EULER % 0.25,
        "faults=['motor_dead:left_hip@1s']",
        "control.assistance={hip: 0.7, knee: 0.8, adaptive: true}",
        "control.inertia_compensation=0.3",
    ),
    "a free trunk by its inertial unit, on crutches": (
        "overground",
        EULER % 0.25,
        "scenario.arms={planted_s: 0.05, lift_ahead_m: 0.5}",
        "scenario.harness={share: 0.2, damping_Ns_per_m: 90}",
        *NOISE,
    ),
    "start and stop": (
        "treadmill_start_stop",
        EULER % 0.25,
        "scenario.belt={start_s: 0.2, stop_s: 1.2, ramp_s: 0.3, delay_s: 0.1}",
    ),
}


@pytest.mark.slow
@pytest.mark.compile
@pytest.mark.parametrize("name", STRUCTURES)
def test_lanes_of_every_build_equal_their_single_runs(name, monkeypatch):
    monkeypatch.setattr(lane_engine, "MIN_BLOCK_SIZE", 2)
    ours, theirs = ([unlike(number, *STRUCTURES[name]) for number in range(18)] for _ in range(2))
    for result, engine in zip(LaneEngine(ours).run(), theirs, strict=True):
        assert_same(result, engine.run())


# ------------------------------------------------------------------ which episodes share a block


@pytest.fixture
def uncompiled(monkeypatch):
    """Engines without a loop."""
    monkeypatch.setattr(compiled_engine, "load_or_compile_loop", lambda *arguments: None)
    return lambda *arguments: CompiledEngine(build_setup(load_experiment(*arguments).experiment))


class Own(Controller):
    """A controller that does nothing."""

    @staticmethod
    def tick(memory, device, tick, period):  # type: ignore[no-untyped-def]
        pass


def test_powers_and_a_controller_of_the_users_run_alone(uncompiled):
    assert block_key(uncompiled("bench_leg", [])) is not None
    lugre = "plant.friction.knee={law: lugre, coulomb_friction_Nm: 3, bristle_stiffness_Nm_per_rad: 900}"
    assert block_key(uncompiled("bench_leg", [lugre])) is None
    problem = build_setup(load_experiment("bench_leg", []).experiment, Own())
    assert block_key(CompiledEngine(problem)) is None


def numbers_of(dtype: np.dtype[Any], owner: str = "episode", first: int = 0) -> Iterator[tuple[str, int]]:
    """Yield the name of every number, prefixed by its record, and its position."""
    assert dtype.fields is not None
    for name, (kind, offset, *_) in dtype.fields.items():
        for position in range(first + offset, first + offset + kind.itemsize, kind.base.itemsize):
            if kind.base.fields is None:
                yield f"{owner}.{name}", position // 8
            else:
                yield from numbers_of(kind.base, name, position)


def test_every_shared_field_exists_and_is_equal_in_all_lanes_of_a_block(uncompiled):
    engine = uncompiled("treadmill_guided", [])
    shared, kind, found = shared_words(engine.store.dtype), block_key(engine), set()
    words = engine.store.view(np.int64)
    for name, position in numbers_of(engine.store.dtype):
        words[position] ^= 1
        assert shared[position] == (name in SHARED), name
        assert (block_key(engine) != kind) == (name in SHARED), name
        words[position] ^= 1
        found.add(name)
    assert found >= SHARED and block_key(engine) == kind


RUNS: dict[str, tuple[str, ...]] = {
    "bench_leg": ("bench_leg",),
    "bench_leg, trip": ("bench_leg", "control.safety.phase_timeout_s=0.2"),
    "treadmill_guided": ("treadmill_guided",),
    "treadmill, trip": ("treadmill_guided", "control.safety.phase_timeout_s=0.2"),
    "treadmill_start_stop": ("treadmill_start_stop", "scenario.belt.start_s=0.2"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if "start_stop" in name else []) for name in RUNS]
)
def test_no_tick_changes_a_field_that_lanes_share(name):
    preset, *settings = RUNS[name]
    problem = build_setup(load_experiment(preset, [*settings, "duration_s=1.5"]).experiment)
    engine = CompiledEngine(problem)
    rows = np.zeros((1500, len(engine.layout.names)))
    engine.run_ticks(0, 1, rows)
    words, shared = engine.store.view(np.int64), shared_words(engine.store.dtype)
    before = words.copy()
    engine.run_ticks(1, 1500, rows)
    assert np.array_equal(words[shared], before[shared])
    assert (words[~shared] != before[~shared]).mean() > 0.05
    assert (engine.trip() is not None) == ("trip" in name)


def test_a_block_stores_numbers_of_all_lanes_contiguously_and_pads_with_copies(uncompiled):
    engines = [uncompiled("treadmill_guided", [f"patient.mass_kg={mass}"]) for mass in (60, 70, 80)]
    block = interleave([engine.store for engine in engines])
    dtype = engines[0].store.dtype
    assert block.shape == (dtype.itemsize // 8, WIDTH) and block.flags.c_contiguous
    weights = block[number_index(dtype, "episode.body_weight")].view(float)
    assert weights[:3].tolist() == [engine.episode["body_weight"] for engine in engines]
    assert weights[3:].tolist() == [weights[0]] * (WIDTH - 3)
    phases = block[number_index(dtype, "limits.phase_ticks")]
    assert set(phases.tolist()) == {int(engines[0].episode["limits"]["phase_ticks"])}
    first = block[number_index(dtype, "trip.tick")]
    assert set(first.tolist()) == {-1}


# ------------------------------------------------------------------ what a room may do

JOINT = np.dtype([("index", "i8"), ("x", "f8"), ("y", "f8")], align=True)
TOY = np.dtype(
    [
        ("step", "f8"),
        ("q", "f8", 4),
        ("a", "f8", 4),
        ("table", "f8", (3, 4)),
        ("joints", JOINT, 3),
        ("limbs", JOINT, 3),
    ],
    align=True,
)


def episode_at(address: int) -> Any: ...
def vector_lanes(e: Any) -> Any: ...
def scalar_lanes(e: Any) -> Any: ...
def entry(e: Any) -> Any: ...


def enter_at(address: int, first: int, end: int) -> int:
    entry(episode_at(address))
    return end


def reads_a_number(e: Any) -> Any:
    return e.joints[1].x


def reads_an_entry(e: Any) -> Any:
    return e.q[1]


def goes_through_entries(e: Any) -> Any:
    total = 0.0
    for angle in e.q:
        total += angle
    return total


def goes_through_records(e: Any) -> Any:
    total = 0.0
    for joint in e.joints:
        total += joint.x
    return total


def reads_an_entry_of_a_list_of_lists(e: Any) -> Any:
    return e.table[1][2]


def writes_a_number(e: Any) -> Any:
    e.joints[1].x = 1.0


def writes_an_entry(e: Any) -> Any:
    e.q[1] = 1.0


def writes_a_shared_number(e: Any) -> Any:
    for one in vector_lanes(e):
        one.joints[1].index = 2


def writes_a_shared_number_of_the_episode(e: Any) -> Any:
    for one in vector_lanes(e):
        one.step = 2.0


def copies_a_record(e: Any) -> Any:
    for one in vector_lanes(e):
        one.joints[1] = one.joints[0]


def copies_a_list(e: Any) -> Any:
    for one in vector_lanes(e):
        one.a = one.q


def takes_a_lane_for_the_block(e: Any) -> Any:
    for one in vector_lanes(e):
        for other in vector_lanes(one):
            other.q[0] = 0.0


REFUSED = [
    reads_a_number,
    reads_an_entry,
    goes_through_entries,
    goes_through_records,
    reads_an_entry_of_a_list_of_lists,
    writes_a_number,
    writes_an_entry,
    writes_a_shared_number,
    writes_a_shared_number_of_the_episode,
    copies_a_record,
    copies_a_list,
    takes_a_lane_for_the_block,
]


def reads_what_is_shared(e: Any) -> Any:
    return e.step * e.joints[1].index * len(e.q)


def needs_separate_groups(e: Any) -> Any:
    """Run two loops, of which the second uses indices unknown to LLVM.

    That its passes share no memory stands in the mark of its accesses alone. Where that is the first loop's,
    one lane's write may be the next one's read.
    """
    for number in range(len(e.joints)):
        for one in vector_lanes(e):
            one.joints[number].x *= 0.5
        for one in vector_lanes(e):
            first_index, index = one.joints[0].index, one.joints[number].index
            one.q[index] = one.q[first_index] + e.step * one.joints[number].x


def chooses(e: Any) -> Any:
    """Conditions, minima and a flag over all lanes."""
    for number in range(len(e.q)):
        found = False
        for one in vector_lanes(e):
            one.a[number] = one.q[number] - 1.0 if one.q[number] < -1.0 else min(one.q[number], 0.5)
            found |= one.q[number] > 1.5
        if found:
            for one in scalar_lanes(e):
                if one.q[number] > 1.5:
                    one.joints[0].y = one.q[number] / one.step


def has_a_long_body(e: Any) -> Any:
    """Run a loop that ends in a jump over more than 255 instructions, which the bytecode writes in two."""
    for one in vector_lanes(e):
        one.a[0] = one.q[0] * 0.5 + one.q[1]
        one.a[1] = one.q[1] * 0.5 + one.a[0]
        one.joints[0].x = one.joints[0].x * 0.5 + one.a[1]
        one.joints[1].x = one.joints[1].x * 0.5 + one.joints[0].x
        one.joints[0].y = one.joints[0].y * 0.5 + one.joints[1].x
        one.joints[1].y = one.joints[1].y * 0.5 + one.joints[0].y
        one.q[0] = one.q[0] * 0.5 + one.joints[1].y
        one.q[1] = one.q[1] * 0.5 + one.q[0]
        one.a[0] = one.a[0] * 0.5 + one.q[1]
        one.a[1] = one.a[1] * 0.5 + one.a[0]


def stays_scalar(e: Any) -> Any:
    """Run an inner loop whose number of turns differs between lanes."""
    for one in vector_lanes(e):
        while one.q[0] > 1.0:
            one.q[0] *= 0.5


VECTORS = [needs_separate_groups, chooses, has_a_long_body]

for _function in (enter_at, *REFUSED, *VECTORS, reads_what_is_shared, stays_scalar):
    _function.__module__ = "twin_gait.module_of_a_test"  # only functions of this package are bound


def compiled(function: Callable[[Any], Any]) -> Any:
    """Return a stage compiled for lanes by numba."""
    names = {**BIT_FUNCTIONS, **lane_names(TOY, 1, 1), "entry": function}
    loop = specialize(
        enter_at,
        names,
        lambda item: jit(item, inline=item.__name__ != enter_at.__name__, pipeline=LanePipeline),
    )
    signature = (numba.intp,) * 3
    with compiler_settings(LanePipeline):
        loop.compile(signature)
    return loop.overloads[signature]


@pytest.mark.parametrize("function", REFUSED, ids=lambda item: item.__name__)
def test_a_stage_must_not_mix_lanes(function):
    with pytest.raises((NumbaError, AssertionError)):
        compiled(function)


def test_a_stage_may_read_shared_fields():
    assert compiled(reads_what_is_shared).signature.return_type == numba.int64


@pytest.fixture
def insisting(monkeypatch):
    """LLVM reports scalar loops on the standard error; nothing is compiled yet."""
    plain = simulation_lanes._Marking._mark

    def mark(self, header, latches, over):
        plain(self, header, latches, over)
        if isinstance(over, LanesView) and over.count:
            wanted = self.module.add_metadata(["llvm.loop.vectorize.enable", ir.IntType(1)(1)])
            latches[0].terminator.metadata["llvm.loop"].operands += (wanted,)

    monkeypatch.setattr(simulation_lanes._Marking, "_mark", mark)
    monkeypatch.setattr(compiling, "_made", {})


def test_users_get_no_warning_about_a_scalar_loop(capfd):
    compiled(stays_scalar)
    assert "loop not vectorized" not in capfd.readouterr().err


def test_tests_get_a_warning_about_a_scalar_loop(insisting, capfd):
    compiled(stays_scalar)
    assert "loop not vectorized" in capfd.readouterr().err


def in_plain_python(function: Callable[[Any], Any], block: np.ndarray) -> np.ndarray:
    """Apply a stage to a block, episode by episode."""
    bound = specialize(function, {"vector_lanes": lambda e: (e,), "scalar_lanes": lambda e: (e,)})
    episodes = np.ascontiguousarray(block.T).view(TOY).reshape(WIDTH).view(np.recarray)
    for episode in episodes:
        bound(episode)
    return np.ascontiguousarray(episodes.view(np.int64).reshape(WIDTH, -1).T)


SCALAR = re.compile(r"= f(?:add|sub|mul|div) double")
VECTOR = re.compile(r"= f(?:add|sub|mul|div) <\d+ x double>")


@pytest.mark.parametrize("function", VECTORS, ids=lambda item: item.__name__)
def test_a_loop_over_lanes_is_vector_code_with_correct_results(function, capfd):
    code = str(compiled(function).library._final_module)
    assert VECTOR.search(code) and capfd.readouterr().err == ""
    # What is done one lane after the other stays scalar.
    assert set(SCALAR.findall(code)) == ({"= fdiv double"} if function is chooses else set())
    rng = np.random.default_rng(1)
    block = rng.uniform(-2.0, 2.0, (TOY.itemsize // 8, WIDTH)).view(np.int64)
    first = number_index(TOY, "joints.index")
    for joint in range(3):
        block[first + 3 * joint] = (2, 0, 1)[joint]
    block[number_index(TOY, "episode.step")] = np.array(0.25).view(np.int64)
    names = {**lane_names(TOY, 1, 1), "entry": function}
    expected = in_plain_python(function, block)
    compile_loop(enter_at, names, pipeline=LanePipeline).function(block.ctypes.data, 0, 1)
    assert np.array_equal(block, expected)


# ------------------------------------------------------------------ whole loops


def bench_and_treadmill() -> dict[str, SimulationSetup]:
    return {
        "bench": build_setup(load_experiment("bench_leg", [EULER % 1]).experiment),
        "treadmill_guided": build_setup(load_experiment("treadmill_guided", [RK4 % 0.25, *NOISE]).experiment),
    }


@pytest.mark.slow
@pytest.mark.compile
@pytest.mark.parametrize("name", ["bench", "treadmill_guided"])
def test_no_loop_over_lanes_stays_scalar(name, uncompiled, insisting, capfd):
    engine = CompiledEngine(bench_and_treadmill()[name])
    rows = len(engine.layout.names), engine.noise.shape[1]
    names = {**loop_names(engine), **LANE_DRIVERS, **lane_names(engine.store.dtype, *rows)}
    compile_loop(run_ticks_at, names, pipeline=LanePipeline)
    assert capfd.readouterr().err == ""
