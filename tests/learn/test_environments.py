"""Environments for learning: equal to simulate, to each other, and to Gymnasium's conventions."""

import subprocess
import sys
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from errors import raises

from twin_gait.configuration.experiments import LoadedExperiment, load_experiment
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.learn.actions import ImpedanceAction, PolicyAction, PositionAction, TableAction, TorqueAction
from twin_gait.learn.policy import policy_outputs, write_policy
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.simulator import simulate

gymnasium = pytest.importorskip("gymnasium", reason="extra learn")
from gymnasium.utils.env_checker import check_env  # noqa: E402  # after the check that it is installed

from twin_gait.learn import GaitEnv, VectorGaitEnv  # noqa: E402

STEP = 10  # ticks of a control step
# Ends of the names of states: a signal has the state after the tick, a row of the log the state before it.
STATES = "_angle_rad", "_velocity_rad_per_s", "_height_m", "_forward_m", "_velocity_m_per_s", "_voltage_V"
WEARERS = {"patient.mass_kg": (60.0, 90.0), "scenario.belt_speed_km_per_h": (1.2, 1.8)}


def drive(env: GaitEnv, actions: np.ndarray) -> list[tuple[Any, ...]]:
    """Return the results of some steps, without infos."""
    return [env.step(action)[:4] for action in actions]


def test_the_checker_of_gymnasium_accepts_the_environment() -> None:
    env = gymnasium.make("twin_gait/Treadmill-v0", duration_s=0.5, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*infinity", UserWarning)  # signals have no bounds
        check_env(env.unwrapped)
    picture = env.unwrapped.render()
    assert picture.shape == (480, 400, 3) and len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_without_action_an_episode_is_the_walk_of_simulate() -> None:
    env = GaitEnv(record=True, duration_s=0.6)
    env.reset(seed=4)
    *_, last = drive(env, np.zeros((59, 4)))
    assert last[2:] == (False, True)
    run = env.run
    walk = simulate(
        load_experiment("treadmill_guided", ["duration_s=0.6", f"seed={run.experiment.seed}"]).experiment
    )
    assert run.log.equals(walk.log)


def test_torques_are_the_target_torques_of_the_compiled_engine() -> None:
    env = GaitEnv(record=True, duration_s=0.4, action=TorqueAction(share=0.5))
    env.reset(seed=7)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (39, 4))
    drive(env, actions)
    run = env.run
    limits = [run.experiment.control.limits[joint].torque for joint in ("hip", "knee", "hip", "knee")]
    engine = CompiledEngine(build_setup(run.experiment))
    rows = np.zeros((400, len(engine.layout.names)))
    tick = engine.run_ticks(0, STEP, rows)
    for action in actions:
        engine.episode["controller"]["joints"]["target"] = 0.5 * np.array(limits) * action
        tick = engine.run_ticks(tick, tick + STEP, rows)
    assert len(run.log) == tick == 400
    for index, name in enumerate(engine.layout.names):
        if not name.endswith("_phase"):  # in the log of a run phases are names
            assert (run.log[name].to_numpy() == rows[:, index]).all(), name


def compare_with_single(options: Mapping[str, Any], count: int, steps: int) -> tuple[int, int]:
    """Compare a vector environment with single ones; return how many episodes fell and were cut."""
    vector, single = VectorGaitEnv(count, **options), GaitEnv(**options)
    generator = np.random.default_rng(0)
    size = vector.single_action_space.shape[0]
    actions = np.repeat(generator.uniform(-1.0, 1.0, (steps // STEP, count, size)), STEP, axis=0)
    first, _ = vector.reset(seed=5)
    results = [vector.step(action)[:4] for action in actions]
    for lane in range(count):
        observation, _ = single.reset(seed=5 + lane)
        assert (observation == first[lane]).all()
        over = False
        for action, found in zip(actions, results, strict=True):
            expected: tuple[Any, ...]
            expected = (single.reset()[0], 0.0, False, False) if over else single.step(action[lane])[:4]
            over = expected[2] or expected[3]
            assert (found[0][lane] == expected[0]).all()
            assert (found[1][lane], found[2][lane], found[3][lane]) == expected[1:]
    return int(np.sum([found[2] for found in results])), int(np.sum([found[3] for found in results]))


def test_a_vector_environment_equals_single_ones_across_episodes() -> None:
    options = {"duration_s": 0.3, "randomise": WEARERS, "action": TorqueAction(share=0.9)}
    _, truncated = compare_with_single(options, 16, 70)
    assert truncated == 32  # each lane ends two episodes


@pytest.mark.slow
def test_ten_thousand_random_steps_equal_single_environments() -> None:
    options = {"duration_s": 1.5, "randomise": WEARERS, "action": TorqueAction(share=0.9)}
    terminated, truncated = compare_with_single(options, 32, 320)
    assert terminated > 10 and truncated > 10


def test_ranges_of_an_action_do_not_depend_on_the_drawn_wearer() -> None:
    options = {"duration_s": 0.3, "randomise": WEARERS, "action": ImpedanceAction()}
    compare_with_single(options, 16, 20)


def test_a_loaded_experiment_takes_the_duration_and_an_ended_episode_no_step() -> None:
    env = GaitEnv(experiment=load_experiment("treadmill_guided"), duration_s=0.05, record=True)
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(np.zeros(4))
    env.reset(seed=1)
    assert [result[3] for result in drive(env, np.zeros((4, 4)))] == [False, False, False, True]
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(np.zeros(4))
    assert len(env.run.log) == 50


def test_few_environments_run_one_by_one_with_the_same_results() -> None:
    few, many = VectorGaitEnv(3, duration_s=0.3), VectorGaitEnv(32, duration_s=0.3)
    actions = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 32, 4))
    assert (few.reset(seed=1)[0] == many.reset(seed=1)[0][:3]).all()
    for action in actions:
        found, expected = few.step(action[:3]), many.step(action)
        assert (found[0] == expected[0][:3]).all() and (found[1] == expected[1][:3]).all()


def test_a_seed_gives_the_same_episode_in_another_process() -> None:
    code = (
        "import numpy as np; from twin_gait.learn import GaitEnv; "
        "env = GaitEnv(randomise={'patient.mass_kg': (60.0, 90.0)}); env.reset(seed=11); "
        "print(env.step(np.full(4, 0.3))[0].tobytes().hex())"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    env = GaitEnv(randomise={"patient.mass_kg": (60.0, 90.0)})
    env.reset(seed=11)
    assert env.step(np.full(4, 0.3))[0].tobytes().hex() == other.stdout.strip()
    env.reset(seed=12)
    assert env.step(np.full(4, 0.3))[0].tobytes().hex() != other.stdout.strip()


def test_every_signal_is_the_last_row_of_the_log_and_needs_no_log() -> None:
    envs = [GaitEnv(record=record, duration_s=0.5) for record in (True, False)]
    for env in envs:
        env.reset(seed=1)
        drive(env, np.full((25, 4), 0.4))
    recorded, plain = (env._group.signals for env in envs)
    row, compared = envs[0].run.log.iloc[-1], 0
    for name in envs[0].signal_names:
        assert recorded[name][0] == plain[name][0], name
        if name in row.index and not name.endswith("_phase"):
            is_state = name.endswith(STATES) and not name.endswith("_measured_angle_rad")
            assert is_state or plain[name][0] == row[name], name
            compared += not is_state
    assert compared > 60


def impedance_of(env: GaitEnv, name: str) -> np.ndarray:
    """Return a column of the log of the episode."""
    return env.run.log[name].to_numpy()


def test_an_impedance_action_replaces_the_table_at_once_in_every_phase() -> None:
    action = ImpedanceAction({"equilibrium_deg": (-10.0, 30.0)}, quantities=("equilibrium_deg",))
    env = GaitEnv(record=True, duration_s=0.5, action=action)
    env.reset(seed=1)
    plain = GaitEnv(record=True, duration_s=0.5)
    plain.reset(seed=1)
    drive(plain, np.zeros((1, 4)))
    drive(env, np.tile([-1.0, 1.0, 0.0, 0.5], (30, 1)))
    expected = {"left_hip": -10.0, "left_knee": 30.0, "right_hip": 10.0, "right_knee": 20.0}
    for joint, angle in expected.items():
        found = np.degrees(impedance_of(env, f"{joint}_equilibrium_rad"))
        assert found[STEP:] == pytest.approx(angle, abs=1e-12)
    stiffness = "left_knee_stiffness_Nm_per_rad"
    assert impedance_of(env, stiffness)[STEP] == impedance_of(plain, stiffness)[STEP]


def test_a_position_action_sets_the_same_spring_in_every_phase() -> None:
    action = PositionAction(150.0, 12.0, {"knee": (0.0, 60.0)})
    env = GaitEnv(record=True, duration_s=0.5, action=action)
    env.reset(seed=1)
    drive(env, np.zeros((20, 4)))
    assert (impedance_of(env, "left_knee_stiffness_Nm_per_rad")[STEP:] == 150.0).all()
    assert (impedance_of(env, "right_hip_damping_Nms_per_rad")[STEP:] == 12.0).all()
    assert np.degrees(impedance_of(env, "left_knee_equilibrium_rad")[STEP:]) == pytest.approx(30.0)


def test_a_table_action_acts_when_a_leg_enters_the_phase() -> None:
    changes = {"swing_flexion.knee.equilibrium_deg": 5.0}
    env = GaitEnv(record=True, duration_s=2.0, action=TableAction(changes, per_stride=False))
    plain = GaitEnv(record=True, duration_s=2.0)
    for each in (env, plain):
        each.reset(seed=1)
        drive(each, np.ones((150, 1)) if each is env else np.zeros((150, 4)))
    starts = {
        side: np.flatnonzero(env.run.log[f"{side}_phase"].to_numpy()[STEP:] == "swing_flexion")[0] + STEP
        for side in ("left", "right")
    }
    side, entered = min(starts.items(), key=lambda item: item[1])  # until then both walks are equal
    assert entered > STEP
    name = f"{side}_knee_equilibrium_rad"
    found, before = impedance_of(env, name), impedance_of(plain, name)
    assert (found[:entered] == before[:entered]).all()
    blending = env.run.table.blend_ticks(env.run.table.phases["swing_flexion"])
    progress = np.arange(1, 71) / blending
    assert progress[-1] < 1.0
    share = 10.0 * progress**3 - 15.0 * progress**4 + 6.0 * progress**5  # minimum jerk
    changed = np.degrees(found - before)[entered + 1 : entered + 71]
    assert changed == pytest.approx(5.0 * share, abs=1e-9)


def test_reward_terms_are_those_of_the_log() -> None:
    rewards = {"device_effort": 1.0, "smoothness": 1.0, "power": 1.0, "saturation": 2.0, "tracking": 1.0}
    env = GaitEnv(record=True, duration_s=0.5, rewards=rewards)
    env.reset(seed=1)
    info = [env.step(action)[4] for action in np.full((20, 4), 0.8)][-1]["reward_terms"]
    run = env.run
    now, before = run.log.iloc[-1], run.log.iloc[-1 - STEP]
    joints = {f"{side}_{joint}": joint for side in ("left", "right") for joint in ("hip", "knee")}
    limits = {name: run.experiment.control.limits[joint].torque for name, joint in joints.items()}
    shares = [now[f"{name}_motor_torque_Nm"] / limits[name] for name in joints]
    changes = [
        (now[f"{name}_motor_command_torque_Nm"] - before[f"{name}_motor_command_torque_Nm"]) / limits[name]
        for name in joints
    ]
    assert info["device_effort"] == pytest.approx(-np.mean(np.square(shares)), rel=1e-12)
    assert info["smoothness"] == pytest.approx(-np.mean(np.square(changes)), rel=1e-9)
    power = max(now["battery_power_W"], 0.0) / run.experiment.patient.mass
    assert info["power"] == pytest.approx(-power, rel=1e-12)
    beyond = [abs(now[f"{name}_motor_command_torque_Nm"]) > limits[name] for name in joints]
    assert info["saturation"] == -2.0 * np.mean(beyond)
    assert 0.0 < info["tracking"] <= 1.0


def test_tracking_compares_with_healthy_walking_at_the_time_in_the_stride() -> None:
    from twin_gait.measures.reference import reference_curve, reference_cycle_time

    env = GaitEnv(record=True, duration_s=4.0, rewards={"tracking": 1.0})
    env.reset(seed=1)
    reward = drive(env, np.zeros((330, 4)))[-1][1]
    run = env.run
    patient, speed = run.experiment.patient, run.experiment.scenario.walking.speed
    cycle, terms = reference_cycle_time(speed, patient.height), []
    for side in ("left", "right"):
        first = run.table.phase_names[0]
        phases = (run.log[f"{side}_phase"] == first).to_numpy()
        entry = np.flatnonzero(phases[1:] & ~phases[:-1])[-1] + 1
        percent = 100.0 * ((len(run.log) - entry) * 1e-3 / cycle % 1.0)
        for joint in ("hip", "knee"):
            healthy = reference_curve(joint, np.array([percent]), speed=speed, height=patient.height)[0]
            error = run.log[f"{side}_{joint}_measured_angle_rad"].iloc[-1] - healthy
            terms.append(1.0 / (1.0 + (np.degrees(error) / 10.0) ** 2))
    assert reward == pytest.approx(np.mean(terms), rel=2e-3)  # the cycle is whole ticks, with 101 samples


def test_a_fall_or_a_trip_terminates_with_its_reward() -> None:
    env = GaitEnv(action=TorqueAction(share=1.0), rewards={"fall": 10.0, "alive": 1.0}, duration_s=5.0)
    env.reset(seed=2)
    results = []
    while not results or not (results[-1][2] or results[-1][3]):
        results.append(env.step(np.array([1.0, -1.0, 1.0, -1.0])))
    assert results[-1][2] and results[-1][4]["outcome"] in ("fell", "held", "diverged")
    assert results[-1][1] == -10.0 and results[0][1] == 1.0


def test_own_observations_and_rewards_are_functions_of_the_signals() -> None:
    env = GaitEnv(
        duration_s=0.5,
        observations={"left_knee_angle_rad": 2.0, "sum": lambda signals: sum(signals.each("foot_load"))},
        rewards={"own": 3.0},
        own_rewards={"own": lambda signals: signals["left_foot_load"]},
    )
    env.reset(seed=1)
    observation, reward, *_ = env.step(np.zeros(4))
    signals = env._group.signals
    assert observation.shape == (2,)
    assert observation[0] == np.float32(2.0 * signals["left_knee_angle_rad"][0])
    assert reward == 3.0 * signals["left_foot_load"][0]


@pytest.mark.parametrize(
    ("options", "facts"),
    [
        ({"period_s": 0.0005}, ("period_s", "0.0005")),
        ({"rewards": {"speed": 1.0}}, ("rewards", "speed", "tracking")),
        ({"observations": {"left_knee_force_N": 1.0}}, ("left_knee_force_N",)),
        ({"reward": {}}, ("reward", "rewards")),
        ({"experiment": "bench_leg"}, ("wearer",)),
        ({"action": TableAction({"swing.knee.equilibrium_deg": 5.0})}, ("swing", "swing_flexion")),
        ({"action": ImpedanceAction({"stiffness": (1.0, 2.0)})}, ("stiffness", "stiffness_Nm_per_rad")),
        ({"randomise": {"patient.mass": (60.0, 90.0)}}, ("mass", "mass_kg")),
    ],
)
def test_a_wrong_option_is_rejected_by_its_name(options: Mapping[str, Any], facts: tuple[str, ...]) -> None:
    with raises(TwinGaitError, *facts):
        GaitEnv(**options)


def test_a_vector_environment_rejects_values_that_need_another_loop() -> None:
    vector = VectorGaitEnv(32, duration_s=0.3, randomise={"sensors.window": [5, 8]})
    with raises(ParameterError, "randomise", "gymnasium.make"):
        vector.reset(seed=1)


# ------------------------------------------------------------------ policies


def with_policy(name: str, *settings: str, silent: bool = False) -> LoadedExperiment:
    """Return a walk with a shipped policy; ``silent``: its weights are zero."""
    loaded = load_experiment("treadmill_guided", ["control.mode=policy", f"control.policy={name}", *settings])
    control = loaded.experiment.control
    if not silent or control.policy is None:
        return loaded
    policy = replace(control.policy, weights=(0.0,) * len(control.policy.weights))
    return replace(loaded, experiment=replace(loaded.experiment, control=replace(control, policy=policy)))


@pytest.mark.parametrize("name", ["low_effort", pytest.param("assist_as_needed", marks=pytest.mark.slow)])
def test_the_actions_of_a_policy_give_the_walk_of_its_control_mode(name: str) -> None:
    network = with_policy(name).experiment.control.policy
    env = GaitEnv(
        experiment=with_policy(name, "duration_s=4", silent=True),
        action=PolicyAction(), observations={"policy_input": 1.0}, dtype=np.float64, record=True,
    )  # fmt: skip
    assert network is not None
    observation, _ = env.reset(seed=3)
    over, largest = False, 0.0
    while not over:
        action = policy_outputs(network, observation[None])[0]
        observation, _, terminated, truncated, _ = env.step(action)
        over, largest = terminated or truncated, max(largest, np.abs(action).max())
    run = env.run
    walk = simulate(with_policy(name, "duration_s=4", f"seed={run.experiment.seed}").experiment)
    assert run.log.equals(walk.log) and len(walk.log) == 4000 and largest > 0.1


def test_outputs_of_many_weights_are_those_of_each() -> None:
    network = with_policy("low_effort").experiment.control.policy
    assert network is not None
    generator = np.random.default_rng(0)
    inputs, weights = generator.normal(size=(3, 24)), generator.normal(size=(3, len(network.weights)))
    found = policy_outputs(network, inputs, weights)
    for row, own, expected in zip(inputs, weights, found, strict=True):
        assert (policy_outputs(network, row[None], own) == expected).all()
    hidden, final = weights[0, :156].reshape(12, 13), weights[0, 156:].reshape(4, 13)
    units = hidden[:, 0] + hidden[:, 1:] @ inputs[0, 12:]
    outputs = final[:, 0] + final[:, 1:] @ (units / (1.0 + abs(units)))
    assert found[0, 4:] == pytest.approx(outputs / (1.0 + abs(outputs)), rel=1e-12)


def test_a_written_policy_is_read_again(tmp_path: Path) -> None:
    network = with_policy("assist_as_needed").experiment.control.policy
    assert network is not None
    write_policy(network, tmp_path / "own.yaml")
    again = with_policy(str(tmp_path / "own.yaml")).experiment.control.policy
    assert again == network


def test_a_policy_action_needs_a_policy() -> None:
    with raises(ParameterError, "PolicyAction", "control.mode policy"):
        GaitEnv(action=PolicyAction())
