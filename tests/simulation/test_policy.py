"""Policies: the network against its formula, the setpoints that it changes, mistakes in its file, the C."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from errors import raises
from firmware_tools import TARGET_TOOLS, require_tools

from twin_gait import Run, load_experiment, simulate, summarise_run
from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.validation import packaged, read_yaml
from twin_gait.control.controllers.policy import compute_outputs
from twin_gait.control.policy_parameters import PolicyParameters
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.exoskeleton_unit import record_vectors
from twin_gait.firmware.project import print_project
from twin_gait.firmware.verification import VerificationBuild, count_differences, verify
from twin_gait.gait.signals import all_signal_names
from twin_gait.runs.record import save_run
from twin_gait.simulation.compiled_engine import assemble
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import override_experiment
from twin_gait.vocabulary import Outcome

PHASES = "early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension"
# As many inputs, hidden units and outputs as the shipped policy, so that they share a compiled loop.
INPUTS = (
    "hip.angle_deg / 30", "other.hip.angle_deg / 30", "knee.velocity_deg_per_s / 200",
    "time_in_phase_s / 0.5", "other.knee.angle_deg / 50", "knee.error_deg / 5", "last.knee.torque_Nm / 1",
    *(f"phase.{name} / 1" for name in PHASES),
)  # fmt: skip
BOUNDS = {
    "hip.torque_Nm": 12.0, "knee.torque_Nm": 8.0, "hip.stiffness_share": 0.3, "knee.equilibrium_deg": 4.0,
}  # fmt: skip
N_WEIGHTS = 13 * 12 + 13 * 4


def document(**changes: Any) -> dict[str, Any]:
    """Return the file of a policy with random weights, with some values changed."""
    weights = np.random.default_rng(3).normal(0.0, 0.6, N_WEIGHTS).round(4)
    outputs = [f"{name} * {bound}" for name, bound in BOUNDS.items()]
    given = {"inputs": list(INPUTS), "outputs": outputs, "hidden_units": 12, "weights": weights.tolist()}
    return given | changes


def experiment_with(folder: Path, *settings: str, **changes: Any) -> Experiment:
    """Return a walk on the treadmill with a policy from a file."""
    (folder / "random.yaml").write_text(dump_yaml(document(**changes)))
    policy = ["control.mode=policy", f"control.policy={folder / 'random.yaml'}"]
    return load_experiment("treadmill_guided", [*policy, *settings]).experiment


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return simulate(experiment_with(tmp_path_factory.mktemp("policy"), "duration_s=2.5"))


def test_the_reference_engine_agrees_with_the_compiled_one(tmp_path: Path) -> None:
    same = "duration_s=0.3", "integration={method: rk4, step_ms: 0.25}"
    logs = [
        simulate(experiment_with(tmp_path, *same, f"engine={engine}")).log.select_dtypes("number")
        for engine in ("compiled", "pinocchio")
    ]
    assert list(logs[0]) == list(logs[1]) and np.ptp(logs[0]["left_hip_target_torque_Nm"]) > 1.0
    np.testing.assert_allclose(logs[0].to_numpy(), logs[1].to_numpy(), rtol=0.0, atol=1e-9)


def softsign(values: np.ndarray) -> np.ndarray:
    return values / (1.0 + np.abs(values))


def expected_outputs(run: Run) -> np.ndarray:
    """Compute the outputs of both legs at the end of every control step from the log, by a plain formula."""
    policy, setup = run.experiment.control.policy, build_setup(run.experiment)
    assert policy is not None
    weights, split = np.array(policy.weights), 13 * 12
    hidden, final = weights[:split].reshape(12, 13), weights[split:].reshape(4, 13)
    healthy, length_before = setup.plan.reference, setup.plan.reference.cycle_ticks
    knee, legs = np.array(healthy.angles)[:, 1], ("left", "right")
    outputs = np.zeros((len(run.log) // 10, 2, 4))
    columns = {name: run.log[name].to_numpy() for name in run.log}
    for leg, (side, other) in enumerate((legs, legs[::-1])):
        names, angle = columns[f"{side}_phase"], columns[f"{side}_knee_measured_angle_rad"]
        error, total, start, length, entry, last = 0.0, 0.0, 0, length_before, 0, np.zeros(4)
        for tick in range(len(angle)):
            in_phase, changed = tick - entry, tick > 0 and names[tick] != names[tick - 1]
            entry = tick if changed else entry
            if changed and names[tick] == PHASES[0]:
                error, total = total / (tick - start), 0.0
                length, start = (tick - start if start else length), tick
            progress = (tick - start) / length + (healthy.starts[leg] if start == 0 else 0.0)
            total += abs(angle[tick] - np.interp(100.0 * (progress % 1.0), np.arange(101), knee))
            if (tick + 1) % 10 == 0:
                inputs = [
                    np.degrees(columns[f"{side}_hip_measured_angle_rad"][tick]) / 30.0,
                    np.degrees(columns[f"{other}_hip_measured_angle_rad"][tick]) / 30.0,
                    np.degrees(columns[f"{side}_knee_velocity_fast_rad_per_s"][tick]) / 200.0,
                    1e-3 * in_phase / 0.5,
                    np.degrees(columns[f"{other}_knee_measured_angle_rad"][tick]) / 50.0,
                    np.degrees(error) / 5.0,
                    last[1],
                    *(float(names[tick] == name) for name in PHASES),
                ]
                units = hidden[:, 0] + hidden[:, 1:] @ inputs
                last = final[:, 0] + final[:, 1:] @ (units / (1.0 + np.abs(units)))
                last = last / (1.0 + np.abs(last))
                outputs[tick // 10, leg] = last
    return outputs


def test_setpoints_follow_the_formula_of_the_network_with_a_limited_rate(walk: Run) -> None:
    log, computed, step = walk.log, expected_outputs(walk), 1e-3 / 0.05
    for leg, side in enumerate(("left", "right")):
        phases, applied = log[f"{side}_phase"].to_numpy(), np.zeros((len(log), 4))
        for tick in range(10, len(log)):
            change = computed[tick // 10 - 1, leg] - applied[tick - 1]
            applied[tick] = applied[tick - 1] + np.clip(change, -step, step)
        for index, joint in enumerate(("hip", "knee")):
            torque = log[f"{side}_{joint}_target_torque_Nm"].to_numpy()
            assert np.ptp(torque) > 1.0
            assert torque == pytest.approx(list(BOUNDS.values())[index] * applied[:, index], abs=1e-9)
        changed = np.flatnonzero(phases[1:] != phases[:-1]) + 1
        settled = np.array([tick - max([0, *changed[changed <= tick]]) > 200 for tick in range(len(log))])
        assert settled.sum() > 100
        rows = build_setup(walk.experiment).phase_rows[leg][[PHASES.index(name) for name in phases[settled]]]
        stiffness = rows[:, 0] * (1.0 + 0.3 * applied[settled, 2])  # of the hip
        assert log[f"{side}_hip_stiffness_Nm_per_rad"][settled].to_numpy() == pytest.approx(
            stiffness, rel=1e-9
        )
        angles = rows[:, 6] + np.radians(4.0) * applied[settled, 3]  # of the knee
        assert log[f"{side}_knee_equilibrium_rad"][settled].to_numpy() == pytest.approx(angles, abs=1e-9)


@pytest.mark.parametrize("reading", [np.nan, np.inf, -np.inf, 1e300])
def test_a_reading_that_is_no_angle_counts_as_zero_and_leaves_no_trace(
    tmp_path: Path, reading: float
) -> None:
    setup = build_setup(experiment_with(tmp_path, "duration_s=0.5"))
    _, episode, _ = assemble(setup)
    device, names = episode.controller, all_signal_names(setup.plan.joints)
    found = []
    for value in (0.0, reading):
        memory = deepcopy(device.memory)
        device.signals[:] = [0.0] * len(device.signals)
        device.signals[names.index("hip.angle_deg")] = value
        compute_outputs(memory, device, 1)
        found.append(list(memory.outputs))
    assert found[0] == found[1] and any(found[0])


def test_a_policy_of_zero_weights_is_the_table(tmp_path: Path) -> None:
    plain = simulate(load_experiment("treadmill_guided", ["duration_s=0.5"]).experiment)
    found = simulate(experiment_with(tmp_path, "duration_s=0.5", weights=[0.0] * N_WEIGHTS))
    assert found.log.equals(plain.log)


@pytest.mark.parametrize(
    ("changes", "facts"),
    [
        ({"weights": [0.0] * 207}, ("weights", "208", "207")),
        ({"weights": [0.0] * 207 + [float("nan")]}, ("weights[207]", "finite")),
        ({"weights": [0.0] * 207 + [2e3]}, ("weights[207]", "1000", "2000")),
        ({"inputs": ["hip.angle_deg / 30"] * 12}, ("inputs", "different")),
        ({"inputs": [*INPUTS[1:], "walk / 0"]}, ("inputs[11]", "walk / 0")),
        ({"inputs": [*INPUTS[1:], "walk * 2"]}, ("inputs[11]", "walk * 2")),
        ({"inputs": [*INPUTS[1:], "toe.angle_deg / 2"]}, ("inputs", "knee.angle_deg", "toe.angle_deg")),
        ({"inputs": [*INPUTS[1:], "phase.flight / 1"]}, ("inputs", "phase.NAME", "phase.flight")),
        (
            {"outputs": [f"{name} * 61" for name in BOUNDS]},
            ("outputs[2]", "hip.stiffness_share", "at most 1"),
        ),
        ({"outputs": ["knee.torque_Nm * 61"]}, ("weights", "169")),
        ({"outputs": ["toe.torque_Nm * 6"]}, ("outputs[0]", "hip, knee", "toe")),
        ({"outputs": ["hip.charm * 6"]}, ("outputs[0]", "torque_Nm", "charm")),
        ({"outputs": ["ankle.torque_Nm * 6"], "weights": [0.0] * 169}, ("control.policy", "ankle")),
        ({"outputs": ["knee.torque_Nm * 61"], "weights": [0.0] * 169}, ("policy.outputs", "60 N·m", "61")),
        ({"period_s": 0.0105}, ("period", "multiple of 0.001 s")),
        ({"speed": 1}, ("speed", "unknown key")),
        ({"schema_version": 99}, ("schema_version", "2", "99")),
    ],
)
def test_a_mistake_in_the_file_is_one_line(
    tmp_path: Path, changes: dict[str, Any], facts: tuple[str, ...]
) -> None:
    with raises(TwinGaitError, *facts):
        build_setup(experiment_with(tmp_path, **changes))


def test_a_missing_policy_is_named_with_the_shipped_ones() -> None:
    with raises(TwinGaitError, "control.policy", "missing"):
        load_experiment("treadmill_guided", ["control.mode=policy"])
    with raises(TwinGaitError, "control.policy", "nowhere", "low_effort", "assist_as_needed"):
        load_experiment("treadmill_guided", ["control.policy=nowhere"])


def test_a_device_with_one_leg_has_no_signals_of_the_other(tmp_path: Path) -> None:
    (tmp_path / "knee.yaml").write_text(
        dump_yaml(
            {
                "inputs": ["other.foot.load_bw / 1"],
                "outputs": ["knee.torque_Nm * 1"],
                "hidden_units": 1,
                "weights": [0.0] * 4,
            }
        )
    )
    settings = ["control.mode=policy", f"control.policy={tmp_path / 'knee.yaml'}"]
    with raises(ParameterError, "control.policy.inputs", "foot.load_bw", "other.foot.load_bw"):
        build_setup(load_experiment("knee_orthosis", settings).experiment)


def test_a_run_folder_has_the_policy_and_a_study_may_name_one(walk: Run, tmp_path: Path) -> None:
    folder = save_run(walk, tmp_path / "walk", pictures=False)
    again = load_experiment(folder).experiment
    assert isinstance(again.control.policy, PolicyParameters)
    assert again.control == walk.experiment.control
    assert len(read_yaml(folder / "experiment.yaml")["control"]["policy"]["weights"]) == N_WEIGHTS
    named = override_experiment(walk.experiment, {"control.policy": "low_effort"}).control.policy
    assert named is not None and named.name == "low_effort"


def test_the_monitor_trips_on_a_policy_as_on_any_controller(tmp_path: Path) -> None:
    weights = [0.0] * 13 * 12 + [*([1e3] + [0.0] * 12), *([1e3] + [0.0] * 12), *[0.0] * 26]
    outputs = ["hip.torque_Nm * 60", "knee.torque_Nm * 60", *(f"{k} * {v}" for k, v in [*BOUNDS.items()][2:])]
    run = simulate(experiment_with(tmp_path, "duration_s=2.5", weights=weights, outputs=outputs))
    assert run.trip is not None and run.verdict.outcome is Outcome.HELD


# ------------------------------------------------------------------ firmware


def test_the_c_has_fixed_arrays_and_equals_the_simulation_bit_for_bit(walk: Run, tmp_path: Path) -> None:
    require_tools("gcc")
    project = print_project(walk.experiment)
    text = project.program.files["exoskeleton.c"]
    assert f"memory_hidden_weights[{13 * 12}]" in text and f"memory_output_weights[{13 * 4}]" in text
    build = VerificationBuild(project, [record_vectors(walk.experiment)], project.write_sources(tmp_path))
    (found,) = build.outputs(build.host(double=True), double=True)
    assert len(found) == len(walk.log) and count_differences(found, build.expected[0]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["low_effort", "assist_as_needed"])
def test_20_s_of_the_shipped_policies_are_proven_and_fit_a_tick(name: str) -> None:
    require_tools("gcc", *TARGET_TOOLS)
    settings = ["control.mode=policy", f"control.policy={name}", "duration_s=20"]
    result = verify(load_experiment("treadmill_guided", settings).experiment)
    assert result["passed"] and all(check["passed"] for check in result["checks"])
    found = result["checks"][2]["found"]
    assert found["differing"] == 0 and 0 < found["instructions_worst"] < 12_000


# ------------------------------------------------------------------ the shipped policies


@pytest.mark.parametrize("name", ["low_effort", "assist_as_needed"])
def test_the_shipped_policies_are_those_of_the_gallery(name: str) -> None:
    results = Path(__file__).parents[2] / "examples" / "results" / "train_policies"
    assert packaged("policies")[name].read_text() == (results / f"{name}.yaml").read_text()


def test_low_effort_needs_less_torque_at_nearly_the_tracking_of_the_table() -> None:
    settings = ["duration_s=10", "seed=77", "patient.mass_kg=80"]
    policy = ["control.mode=policy", "control.policy=low_effort"]
    runs = [
        simulate(load_experiment("treadmill_guided", [*settings, *more]).experiment) for more in ([], policy)
    ]
    sides = [summarise_run(run)["sides"] for run in runs]
    efforts, errors = (
        [
            np.mean([value(side, joint) for side in found.values() for joint in ("hip", "knee")])
            for found in sides
        ]
        for value in (
            lambda side, joint: side["joints"][joint]["torque_rms_Nm"],
            lambda side, joint: side[f"rmse_{joint}_by_contact_deg"],
        )
    )
    # For wearers of 60 to 90 kg the mean error rises by 0.30° to 0.32° (hip 0.1°, knee 0.6°; see the page).
    assert efforts[1] < 0.95 * efforts[0] and errors[1] < errors[0] + 0.35
