"""Runs with a wearer who acts: what their torques are, what they do, and that both engines say so."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pandas as pd
import pytest
from errors import raises
from numpy.testing import assert_allclose, assert_array_equal
from table_builder import guard, phase, transition, two_phase_table

from twin_gait import RunStatus, load_experiment, simulate
from twin_gait.configuration.experiments import list_patients
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.core.wearer_torques import passive_hip_torque, passive_knee_torque
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.gait.guards import PhaseMembership, map_atoms
from twin_gait.gait.table import GaitTable
from twin_gait.measures.reference import normative_moment
from twin_gait.simulation.episode import HIP_ANGLE_STEP, MIN_HIP_ANGLE
from twin_gait.simulation.log import WORK_SOURCES
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.wearer import N_HIP_ANGLES, phase_spans
from twin_gait.vocabulary import JointName, Side

# A leg in the air, from its swing on, stepped in Python so that nothing is compiled.
BENCH = (
    "engine=pinocchio",
    "patient={mass_kg: 70, height_m: 1.75, sex: male, effort_delay_ms: 0}",
    "scenario.start_phase=swing_flexion",
    "duration_s=0.4",
)
STIFF = "patient.both={hip: {passive: 1}, knee: {passive: 1}}"
EAGER = "patient.both={hip: {effort: 0.8}, knee: {effort: 0.5, strength: 0.6}}"
SPASTIC = (
    "patient.both={hip: {stretch_reflex_gain_Nms_per_rad: 2}, knee: {stretch_reflex_gain_Nms_per_rad: 3}}"
)
ALL = (
    "patient.both={hip: {passive: 1, contracture_deg: 6, effort: 0.5},"
    " knee: {passive: 1.2, stretch_reflex_gain_Nms_per_rad: 2, "
    "stretch_reflex_threshold_deg_per_s: 30, effort: 0.5}}"
)
SAFE = "control.safety.enabled=false"  # a trip would end the motion that is looked at


def experiment(*settings: str) -> Experiment:
    return load_experiment("bench_leg", [*BENCH, *settings]).experiment


def bench(*settings: str) -> Run:
    return simulate(experiment(*settings))


def torque(log: pd.DataFrame, joint: str) -> np.ndarray:
    return log[f"right_{joint}_external_torque_Nm"].to_numpy()


def angles(log: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    return log["right_hip_angle_rad"].to_numpy(), log["right_knee_angle_rad"].to_numpy()


def same_log(first: Run, second: Run) -> None:
    pd.testing.assert_frame_equal(first.log, second.log, check_exact=True)


@pytest.fixture(scope="module")
def without() -> Run:
    """The same leg worn by mass alone."""
    return bench()


# ---------------------------------------------------------------- what acts


def test_passive_torque_in_the_log_is_the_law_at_the_posture_of_the_tick():
    log = bench(STIFF).log
    hip, knee = angles(log)
    expected = [passive_hip_torque(*pair) for pair in zip(hip, knee, strict=True)]
    assert_allclose(torque(log, "hip"), expected, rtol=1e-12)
    expected = [passive_knee_torque(*pair, 0.0) for pair in zip(hip, knee, strict=True)]
    assert_allclose(torque(log, "knee"), expected, rtol=1e-12)


def test_contracture_resists_as_if_the_joint_were_further_extended():
    log = bench("patient.right={hip: {passive: 1, contracture_deg: 8}, knee: {passive: 2}}").log
    hip, knee = angles(log)
    shifted = hip - np.radians(8.0)
    expected = [passive_hip_torque(*pair) for pair in zip(shifted, knee, strict=True)]
    assert_allclose(torque(log, "hip"), expected, rtol=1e-12)
    expected = [2.0 * passive_knee_torque(*pair, 0.0) for pair in zip(shifted, knee, strict=True)]
    assert_allclose(torque(log, "knee"), expected, rtol=1e-12)


def test_spastic_muscles_act_beyond_the_speed_of_the_catch_only():
    log = bench(SPASTIC).log
    speed = log["right_knee_velocity_rad_per_s"].to_numpy()
    assert np.abs(speed).max() > 1.5
    expected = -3.0 * np.sign(speed) * np.maximum(np.abs(speed) - 1.0, 0.0)
    assert_allclose(torque(log, "knee"), expected, rtol=1e-12, atol=1e-14)


def moments_of(config: Experiment) -> np.ndarray:
    """Normative moments by limb, phase and posture, without the rows that pad the phases."""
    return np.array([limb.moments for limb in build_setup(config).limbs])[:, : len(config.table.phases)]


@pytest.mark.parametrize("delay", [0, 1, 60])
def test_effort_is_looked_up_in_phase_and_posture_of_the_delay_before(delay):
    """By brute force: the table of the phase, interpolated by numpy at the hip angle that many ticks ago."""
    config = experiment(EAGER, f"patient.effort_delay_ms={delay}")
    moments = moments_of(config)
    log = simulate(config).log
    names = list(config.table.phase_names)
    phases = [names.index(name) for name in log["right_phase"]]
    postures = MIN_HIP_ANGLE + HIP_ANGLE_STEP * np.arange(N_HIP_ANGLES)
    for number, (joint, share) in enumerate((("hip", 0.8), ("knee", 0.5 * 0.6))):
        wanted = [
            share * np.interp(hip, postures, moments[number, phase])
            for hip, phase in zip(log["right_hip_angle_rad"], phases, strict=True)
        ]
        given = torque(log, joint)
        assert_array_equal(given[:delay], 0.0)
        assert_allclose(given[delay:], wanted[: len(log) - delay], rtol=1e-9, atol=1e-12)
        assert given[delay] != 0.0


def test_effort_is_the_effort_of_the_nearest_healthy_instant():
    """The reference at 0.5 km/h in swing flexion (62 to 75 % of the cycle), searched instant by instant."""
    from twin_gait.measures.reference import normative_moment, reference_curve

    config = experiment(EAGER)
    moments = moments_of(config)
    phase = list(config.table.phase_names).index("swing_flexion")
    instants = [62.0 + 0.26 * i for i in range(51)]
    hips = [float(reference_curve(JointName.HIP, p, speed=0.5 / 3.6, height=1.75)) for p in instants]
    for posture in (0, 13, 18, 25, 40):
        angle = np.radians(-30.0 + 2.0 * posture)
        nearest = min(range(51), key=lambda i: (abs(hips[i] - angle), i))
        expected = 70.0 * float(normative_moment("knee", np.array(instants[nearest])))
        assert moments[1, phase, posture] == pytest.approx(expected, rel=1e-9)


def test_leg_in_the_air_makes_no_stance_moment_and_a_supported_one_its_share():
    stance = slice(0, 3)
    assert not moments_of(experiment(EAGER))[:, stance].any()
    full, half = (
        moments_of(load_experiment("treadmill_guided", [EAGER, f"scenario.support.share={share}"]).experiment)
        for share in (0.0, 0.5)
    )
    assert full[:, stance].any()
    assert_allclose(half[:, stance], 0.5 * full[:, stance], rtol=1e-12)
    assert_array_equal(half[:, 3:], full[:, 3:])


def test_weakness_scales_the_effort():
    limbs = build_setup(experiment(EAGER)).limbs
    assert_allclose(
        [limb.condition.effort * limb.condition.strength for limb in limbs], [0.8, 0.3], rtol=1e-15
    )


# ---------------------------------------------------------------- nothing given, nothing changed


@pytest.mark.parametrize(
    "idle",
    [
        "patient.both={hip: {effort: 1, strength: 0}, knee: {effort: 0}}",
        "patient.both={knee: {stretch_reflex_gain_Nms_per_rad: 5, stretch_reflex_threshold_deg_per_s: 2800}}",
        "patient.left={hip: {passive: 1, effort: 1}, knee: {passive: 1}}",  # the other leg is on the stand
    ],
)
def test_wearer_without_torques_changes_no_bit(without, idle):
    same_log(bench(idle), without)


def test_muscles_without_strength_equal_passive_muscles_bit_for_bit():
    passive = bench(STIFF)
    weak = bench("patient.both={hip: {passive: 1, effort: 1, strength: 0}, knee: {passive: 1}}")
    same_log(passive, weak)


def test_effort_moves_the_leg(without):
    changed = bench(EAGER)
    assert np.abs(changed.log["right_hip_angle_rad"] - without.log["right_hip_angle_rad"]).max() > 0.01


# ---------------------------------------------------------------- draws


def test_noise_of_the_effort_is_drawn_from_the_seed():
    settings = (EAGER, "patient.effort_noise=0.2", "duration_s=0.1")
    first, again, other = (bench(*settings, f"seed={seed}") for seed in (3, 3, 4))
    same_log(first, again)
    assert (first.log["right_hip_external_torque_Nm"] != other.log["right_hip_external_torque_Nm"]).any()


def test_noise_of_the_effort_has_the_set_size_and_does_not_change_the_sensor_noise():
    noisy = ("sensors={ideal: false, angle_noise_deg: 0.02}", "duration_s=20", EAGER)
    quiet = build_setup(experiment(*noisy))
    loud = build_setup(experiment(*noisy, "patient.effort_noise=0.2"))
    sensors, drawn = np.hsplit(loud.noise, [len(loud.joints)])
    assert_array_equal(sensors, quiet.noise[:, : len(quiet.joints)])
    assert drawn.shape == (20_000, 2) and not quiet.noise[:, len(quiet.joints) :].any()
    # 40 000 draws: the mean within five of its deviations, the deviation within five of its own.
    assert abs(drawn.mean()) < 5.0 * 0.2 / np.sqrt(drawn.size)
    assert abs(drawn.std() - 0.2) < 5.0 * 0.2 / np.sqrt(2.0 * drawn.size)
    correlation = np.corrcoef(drawn.ravel(), sensors.ravel())[0, 1]
    assert abs(correlation) < 5.0 / np.sqrt(drawn.size)  # two streams, not one twice


# ---------------------------------------------------------------- energy, engines, sides


def test_energy_of_the_leg_changes_by_the_work_of_all_sources_with_an_active_wearer():
    run = bench(ALL, SAFE, "patient.effort_noise=0.1", "integration={method: rk4, step_ms: 0.25}")
    log = run.log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    work = log[[f"{name}_work_J" for name in WORK_SOURCES]].to_numpy().sum(axis=1)
    assert np.abs(log["external_work_J"]).max() > 0.5
    moved = np.abs(np.diff(energy)).sum()
    assert np.abs(energy - energy[0] - work).max() < 1e-7 * moved


def test_work_of_the_wearer_is_his_torque_times_the_angle_turned():
    """Torques are held over a tick, and Runge-Kutta adds speeds up to angles as it adds powers up to work."""
    log = bench(ALL, SAFE, "patient.effort_noise=0.1", "integration={method: rk4, step_ms: 0.5}").log
    work = np.zeros(len(log))
    for joint, angle in zip(("hip", "knee"), angles(log), strict=True):
        work[1:] += np.cumsum(torque(log, joint)[:-1] * np.diff(angle))
    assert_allclose(log["external_work_J"], work, rtol=0.0, atol=1e-9 * np.abs(work).max() + 1e-10)


def test_torques_of_the_wearer_and_of_pushes_add_up_to_the_external_torque():
    """Every row of the log."""
    log = bench(ALL, SAFE).log
    for joint in ("hip", "knee"):
        parts = [log[f"right_{joint}_{name}_torque_Nm"] for name in ("voluntary", "passive", "disturbance")]
        assert_allclose(sum(parts), torque(log, joint), rtol=0.0, atol=1e-12)
        assert all(np.abs(part).max() > 0.1 for part in parts[:2])


def test_stiff_and_spastic_joints_do_not_count_as_voluntary_effort():
    log = bench(STIFF, SPASTIC.replace("both", "right")).log
    assert not log.filter(regex="_voluntary_torque_Nm$").to_numpy().any()
    assert_allclose(torque(log, "knee"), log["right_knee_passive_torque_Nm"], rtol=0.0)


@pytest.mark.slow
def test_engines_agree_on_a_walk_with_an_active_wearer():
    """On the treadmill, ankles included: 0.3 s in all columns; every law of the wearer acts."""
    settings = [ALL, "patient.effort_delay_ms=40", "patient.effort_noise=0.1", "duration_s=0.3", "seed=5"]
    settings.append("patient.left.knee.effort=0.2")
    config = dataclasses.replace(
        load_experiment("treadmill_guided", settings).experiment,
        integration=Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3),
    )
    logs = [
        simulate(dataclasses.replace(config, engine=engine)).log.select_dtypes("number") for engine in Engine
    ]
    for side in Side:
        for joint in ("hip", "knee"):
            assert np.abs(logs[0][f"{side}_{joint}_external_torque_Nm"]).max() > 1.0
    assert list(logs[0]) == list(logs[1])
    scale = np.maximum(1.0, np.abs(logs[0].to_numpy()).max(axis=0))
    assert (np.abs(logs[0].to_numpy() - logs[1].to_numpy()) / scale).max() < 1e-9


@pytest.mark.slow
def test_condition_of_one_side_acts_on_that_side_alone():
    settings = ["patient.left={knee: {passive: 1}}", "duration_s=0.05"]
    log = simulate(load_experiment("treadmill_guided", settings).experiment).log
    acting = {name for name in log if name.endswith("external_torque_Nm") and (log[name] != 0.0).any()}
    assert acting == {"left_knee_external_torque_Nm"}


@pytest.mark.slow
def test_dorsiflexed_ankle_bends_the_knee():
    """The passive knee torque of the treadmill reckons with the ankle of the log, dorsiflexion positive."""
    settings = ["patient.both={knee: {passive: 1}}", "duration_s=0.2"]
    log = simulate(load_experiment("treadmill_guided", settings).experiment).log
    for side in Side:
        columns = [log[f"{side}_{joint}_angle_rad"] for joint in ("hip", "knee", "ankle")]
        expected = [passive_knee_torque(*posture) for posture in zip(*columns, strict=True)]
        assert_allclose(log[f"{side}_knee_external_torque_Nm"], expected, rtol=1e-12)
        assert np.abs(columns[2]).max() > 0.01


# ---------------------------------------------------------------- phases


def cyclic(*names: str, **changes: Any) -> GaitTable:
    """A table that goes through its phases in turn."""
    return two_phase_table(
        phases={name: phase() for name in names},
        transitions=tuple(
            transition(source, target, "hip.angle_deg > 0")
            for source, target in zip(names, (*names[1:], names[0]), strict=True)
        ),
        **changes,
    )


FIVE = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")
# In [%] of the cycle as Perry (1992) divides it.
CYCLES = {
    "five": (cyclic(*FIVE), [(0, 12), (12, 31), (31, 62), (62, 75), (75, 100)]),
    "pre-swing": (
        cyclic(*FIVE[:3], "pre_swing", *FIVE[3:]),
        [(0, 12), (12, 31), (31, 50), (50, 62), (62, 75), (75, 100)],
    ),
    "all of Perry": (
        cyclic(
            "loading_response",
            "mid_stance",
            "terminal_stance",
            "pre_swing",
            "initial_swing",
            "mid_swing",
            "terminal_swing",
        ),
        [(0, 12), (12, 31), (31, 50), (50, 62), (62, 75), (75, 87), (87, 100)],
    ),
    "a published machine of four": (load_gait_table("osl_walking"), [(0, 31), (31, 62), (62, 75), (75, 100)]),
    "two": (cyclic("stance", "swing"), [(0, 62), (62, 100)]),
    "more than have names": (
        cyclic("a", "b", "c", "d", "e", "f", "swing"),
        [(0, 12), (12, 21.5), (21.5, 31), (31, 40.5), (40.5, 50), (50, 62), (62, 100)],
    ),
    "begun in swing": (cyclic("swing", "landing", "pushing"), [(62, 100), (0, 31), (31, 62)]),
    "two strides in a cycle": (
        cyclic("stance", "swing", "other_stance", "other_pushing", "other_swing"),
        [(0, 62), (62, 100), (0, 31), (31, 62), (62, 100)],
    ),
    "start and stop": (
        load_gait_table("treadmill_start_stop"),
        [(0, 12), (12, 31), (31, 62), (62, 75), (75, 100), None, (62, 75)],
    ),
}


@pytest.mark.parametrize(("table", "expected"), CYCLES.values(), ids=CYCLES)
def test_phases_lie_in_healthy_walking_by_their_order(table, expected):
    spans = phase_spans(table)
    assert [spans.get(name) for name in table.phase_names] == expected


def with_pre_swing(table: GaitTable) -> GaitTable:
    """A table with the end of late stance as a sixth phase, entered when the other foot has landed."""
    names = list(table.phase_names)
    names.insert(3, "pre_swing")
    leaving = guard("other.phase in [early_stance, middle_stance]")
    return dataclasses.replace(
        table,
        phases={name: table.phases.get(name, table.phases["late_stance"]) for name in names},
        transitions=(
            transition("late_stance", "pre_swing", leaving),
            *(
                dataclasses.replace(item, source="pre_swing") if item.source == "late_stance" else item
                for item in table.transitions
            ),
        ),
        waivers=(),
    )


def with_one_stance_less(table: GaitTable) -> GaitTable:
    """A table of four phases: early stance is left for late stance."""
    merged = {"middle_stance": "early_stance"}
    phases = {name: item for name, item in table.phases.items() if name not in merged}
    names = tuple(phases)

    def merge_phases(atom):
        """Replace middle stance by early stance in a condition."""
        if not isinstance(atom, PhaseMembership):
            return atom
        return PhaseMembership(phases=tuple({merged.get(name, name): None for name in atom.phases}))

    return dataclasses.replace(
        table,
        phases=phases,
        transitions=tuple(
            dataclasses.replace(
                item, source=merged.get(item.source, item.source), guard=map_atoms(item.guard, merge_phases)
            )
            for item in table.transitions
            if item.target not in merged
        ),
        scaling=dataclasses.replace(table.scaling, stance_phases=names[:2]),
        cycles=(names,),
        waivers=(),
    )


@pytest.mark.parametrize("person", list_patients())
@pytest.mark.parametrize("change", [with_pre_swing, with_one_stance_less])
def test_every_person_acts_in_a_table_of_six_phases_and_of_four(change, person):
    """For a moment on the treadmill, by the moments that Winter has for what each phase stands for."""
    config = load_experiment(
        "treadmill_guided",
        [f"patient={person}", "engine=pinocchio", "duration_s=0.02", "patient.effort_delay_ms=0"],
    ).experiment
    table = change(config.table)
    scenario = dataclasses.replace(
        config.scenario, leading_phase="late_stance", trailing_phase="early_stance"
    )
    config = dataclasses.replace(config, table=table, scenario=scenario)
    moments = moments_of(config)
    active = any(item.effort for item in config.patient.conditions.values())
    assert moments.any() == active
    if active:
        for number, joint in enumerate(("hip", "knee")):
            for name, row in zip(table.phase_names, moments[number], strict=True):
                first, last = phase_spans(table)[name]
                share = 1.0 if table.is_swing(name) else 1.0 - config.scenario.support.share
                healthy = share * 70.0 * normative_moment(joint, np.linspace(first, last, 501))
                assert healthy.min() - 1e-9 <= row.min() < row.max() <= healthy.max() + 1e-9
    run = simulate(config)
    assert run.status is RunStatus.COMPLETED
    assert set(run.log["left_phase"]) <= set(table.phases)
    assert all(run.log[f"{side}_hip_external_torque_Nm"].abs().max() > 0.1 for side in Side)


def test_sixth_phase_leaves_the_moments_of_the_other_five():
    config = load_experiment("treadmill_guided", ["patient=healthy"]).experiment
    five = moments_of(config)
    six = moments_of(dataclasses.replace(config, table=with_pre_swing(config.table)))
    assert_array_equal(six[:, [0, 1, 4, 5]], five[:, [0, 1, 3, 4]])
    # What was nearest of all late stance is nearest in one of its parts, but for the grid of instants.
    parts = np.abs(six[:, 2:4] - five[:, [2]]).min(axis=1)
    instants = np.linspace(31.0, 62.0, 51)
    for joint, differences in zip(("hip", "knee") * 2, parts, strict=True):
        steps = 0.4 * 70.0 * np.abs(np.diff(normative_moment(joint, instants)))
        assert differences.max() <= steps.max()
    assert (six[:, 2] != six[:, 3]).any(axis=1).all()


def test_names_of_phases_do_not_matter():
    config = experiment(EAGER)
    phases = {f"my_{name}": item for name, item in config.table.phases.items()}
    names = dict(zip(config.table.phases, phases, strict=True))
    transitions = tuple(
        dataclasses.replace(item, source=names[item.source], target=names[item.target])
        for item in config.table.transitions
    )
    table = dataclasses.replace(config.table, phases=phases, transitions=transitions, cycles=(), waivers=())
    scenario = dataclasses.replace(config.scenario, initial_phase="my_swing_flexion")
    renamed = simulate(dataclasses.replace(config, table=table, scenario=scenario))
    for joint in ("hip", "knee"):
        assert_array_equal(torque(renamed.log, joint), torque(bench(EAGER).log, joint))


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize("names", [("swing_in", "swing_out"), ("one", "two")])
def test_effort_needs_a_stride(names):
    config = experiment(EAGER)
    table = cyclic(*names)
    scenario = dataclasses.replace(config.scenario, initial_phase=None)
    with raises(ParameterError, "patient.effort", *names, 0):
        simulate(dataclasses.replace(config, table=table, scenario=scenario))


def test_passive_wearer_needs_no_particular_phases():
    config = experiment(STIFF, "duration_s=0.02")
    assert simulate(config).status is RunStatus.COMPLETED
