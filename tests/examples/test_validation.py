"""The witnesses for users: they pass, they can fail, and the command says so."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from twin_gait import load_experiment
from twin_gait.cli import main
from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.experiment import Engine
from twin_gait.studies.validation import dynamics as validation_dynamics
from twin_gait.studies.validation import laws as validation_laws
from twin_gait.studies.validation import mujoco_witness
from twin_gait.studies.validation import runs as validation_runs
from twin_gait.studies.validation.check import Check, CheckPlan, Finding
from twin_gait.studies.validation.validation import (
    CHECKS,
    all_passed,
    checks_document,
    chosen_checks,
    draw_checks,
    validate,
)


@pytest.fixture(scope="module")
def judged() -> dict[str, Check]:
    return {check.name: check for check in validate()}


@pytest.mark.parametrize("name", [plan.name for plan in CHECKS])
def test_check_passes(judged, name):
    check = judged[name]
    if check.passed is None:
        pytest.skip(check.note)
    assert check.passed, check
    assert check.figure <= check.tolerance


def test_names_are_unique():
    assert len({plan.name for plan in CHECKS}) == len(CHECKS)


# ---------------------------------------------------------------------- each check can fail


def with_wrong_gravity(original):
    return lambda experiment: original(experiment)._replace(gravity=9.80665)


def with_a_heavier_wearer(original):
    """Ten grams more."""

    def witness_model(experiment, model):
        if experiment.patient is None:
            return original(experiment, model)
        patient = replace(experiment.patient, mass=experiment.patient.mass + 0.01)
        return original(replace(experiment, patient=patient), model)

    return witness_model


def with_a_longer_thigh(original):
    """The knee of MuJoCo's bench leg sits a tenth of a millimetre lower."""

    def witness_model(experiment, model):
        witness = original(experiment, model)
        witness.body("right_shank").pos[2] -= 1e-4
        return witness

    return witness_model


def with_rounded_values(original):
    return lambda *arguments: np.array(original(*arguments)) * (1.0 + 1e-8)


def of_first_order(original):
    """Explicit Euler under the name of Runge-Kutta."""

    def step(acceleration, context, q, v, step, work):
        acceleration(context, 0.0, 1.0, q, v, work[2])
        q += step * v
        v += step * work[2]

    return step


def of_order_zero(original):
    """A semi-implicit Euler step that is a little too long does not converge."""
    return lambda acceleration, context, q, v, step, a: original(acceleration, context, q, v, 1.01 * step, a)


def that_drives(original):
    """Friction, stop and spring with the wrong sign."""
    return lambda *arguments: tuple(-torque for torque in original(*arguments))


def that_pulls(original):
    """The belt holds on to a sole that leaves fast."""

    def force(height, forward, upward, *parameters):
        along, up = original(height, forward, upward, *parameters)
        return along, up - 1e-3 if upward > 2.9 and height < 0.0 else up

    return force


def with_other_engines(original):
    """A compiled engine in a field of gravity that is off by 1e-6 of itself."""

    def simulate(experiment):
        if experiment.engine is Engine.COMPILED:
            gravity = experiment.plant.gravity * (1.0 + 1e-6)
            experiment = replace(experiment, plant=replace(experiment.plant, gravity=gravity))
        return original(experiment)

    return simulate


def with_more_friction(original):
    return lambda velocity, law: 1.0001 * original(velocity, law)


def without_friction(original):
    return tuple(source for source in original if source != "friction")


Spoil = Callable[[object], object]
SPOILT: list[tuple[str, object, str, Spoil]] = [
    ("bench-double-pendulum", validation_dynamics, "pendulum_of", with_wrong_gravity),
    ("order-semi-implicit-euler", validation_laws, "pendulum_of", with_wrong_gravity),
    ("twin-mass-matrix", validation_dynamics, "witness_model", with_a_heavier_wearer),
    ("twin-bias", validation_dynamics, "witness_model", with_a_heavier_wearer),
    ("twin-acceleration", validation_dynamics, "witness_model", with_a_heavier_wearer),
    ("bench-mass-matrix", validation_dynamics, "witness_model", with_a_longer_thigh),
    ("bench-bias", validation_dynamics, "witness_model", with_a_longer_thigh),
    ("bench-acceleration", validation_dynamics, "witness_model", with_a_longer_thigh),
    ("twin-kernel", validation_dynamics, "body_values", with_rounded_values),
    ("bench-kernel", validation_dynamics, "body_values", with_rounded_values),
    ("free-energy", validation_laws, "rk4_step", of_first_order),
    ("order-rk4", validation_laws, "rk4_step", of_first_order),
    ("order-semi-implicit-euler", validation_laws, "semi_implicit_euler_step", of_order_zero),
    ("friction-passive", validation_laws, "passive_torque", that_drives),
    ("stops-never-pull", validation_laws, "passive_torque", that_drives),
    ("ground-never-pulls", validation_laws, "ground_contact_force", that_pulls),
    ("engines-bench", validation_runs, "simulate", with_other_engines),
    ("closed-loop", mujoco_witness, "witness_friction", with_more_friction),
    ("energy-balance", validation_runs, "WORK_SOURCES", without_friction),
]


@pytest.mark.parametrize(
    ("name", "module", "law", "spoil"),
    SPOILT,
    ids=[f"{name}-{spoil.__name__}" for name, _, _, spoil in SPOILT],
)
def test_check_notices_a_wrong_law(monkeypatch, name, module, law, spoil):
    monkeypatch.setattr(module, law, spoil(getattr(module, law)))
    (check,) = validate(chosen_checks([name]))
    if check.passed is None:
        pytest.skip(check.note)
    assert check.passed is False, check


def test_every_check_but_the_second_pair_of_engines_is_made_to_fail():
    assert {plan.name for plan in CHECKS} - {name for name, *_ in SPOILT} == {"engines-treadmill"}


@pytest.mark.parametrize(
    ("finding", "passed"),
    [
        (Finding(0.5, ""), True),
        (Finding(1.0, ""), True),
        (Finding(1.0001, ""), False),
        (Finding(0.5, "", sound=False), False),
        (Finding(math.nan, ""), False),
        (Finding(-math.inf, ""), False),
    ],
)
def test_verdict(finding, passed):
    plan = CheckPlan(name="a", witness="b", unit="m", tolerance=1.0, find=lambda: finding)
    assert plan.run().passed is passed


def test_engines_with_other_switches_fail_whatever_the_angles(monkeypatch):
    """The angles are equal; only the list of switches lacks its last entry."""

    def simulate(experiment):
        run = original(experiment)
        return replace(run, switches=run.switches[:-1]) if experiment.engine is Engine.COMPILED else run

    original = validation_runs.simulate
    monkeypatch.setattr(validation_runs, "simulate", simulate)
    (check,) = validate(chosen_checks(["engines-bench"]))
    assert check.figure <= check.tolerance
    assert check.passed is False
    assert "DIFFERENT switches" in check.note


# ---------------------------------------------------------------------- closed form


def test_witness_of_two_links_keeps_its_energy_by_itself():
    """The closed form is right on its own: energy, with the numbers of the URDF, stays as it moves."""
    pendulum = validation_dynamics.pendulum_of(load_experiment("bench_leg").experiment)

    def energy(state: np.ndarray) -> float:
        hip, knee, hip_rate, knee_rate = state
        shank, armature = hip - knee, 3.342
        thigh_motion = 0.5 * (0.0615533 + 3.2 * 0.315**2) * hip_rate**2
        shank_rate, turn = hip_rate - knee_rate, 0.5 * 0.0351719 * (hip_rate - knee_rate) ** 2
        along = 0.42 * hip_rate * math.cos(hip) + 0.273421 * shank_rate * math.cos(shank)
        up = 0.42 * hip_rate * math.sin(hip) + 0.273421 * shank_rate * math.sin(shank)
        heights = 3.2 * 0.315 * math.cos(hip) + 1.9 * (0.42 * math.cos(hip) + 0.273421 * math.cos(shank))
        drives = 0.5 * armature * (hip_rate**2 + knee_rate**2)
        return thigh_motion + turn + 0.5 * 1.9 * (along**2 + up**2) + drives - 9.81 * heights

    start = np.array([*validation_laws.START, 0.0, 0.0])
    ends = [validation_laws.exact_motion(pendulum, duration) for duration in (0.3, 0.7, 1.5)]
    assert np.abs(ends[-1] - start).max() > 0.5
    np.testing.assert_allclose([energy(end) for end in ends], energy(start), rtol=1e-10)


# ---------------------------------------------------------------------- the command


@pytest.fixture
def without_mujoco(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)  # an import of it raises ImportError now


def test_without_mujoco_its_checks_are_skipped_and_nothing_fails(without_mujoco, capsys):
    assert main(["validate", "--only", "twin-bias", "--only", "closed-loop", "--only", "bench-kernel"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["twin-bias", "bench-kernel", "closed-loop"]
    for line in (lines[1], lines[3]):
        assert "skipped: pip install 'twin-gait[test]'" in line
    assert "passed" in lines[2]
    assert lines[-1] == "1 passed, 0 failed, 2 skipped"


def test_a_mujoco_that_is_too_old_is_skipped_too(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", SimpleNamespace(__version__="3.2.7"))
    (check,) = validate(chosen_checks(["bench-bias"]))
    assert check.passed is None
    with pytest.raises(MissingOptionalDependency, match=r"needs mujoco 3\.3 or newer"):
        mujoco_witness.import_mujoco()


def test_all_that_needs_mujoco_is_skipped_without_it(without_mujoco):
    names = [plan.name for plan in CHECKS if "MuJoCo" in plan.witness]
    assert len(names) == 7
    checks = validate(chosen_checks(names))
    assert [check.passed for check in checks] == [None] * 7
    assert [check.figure for check in checks] == [None] * 7
    assert all_passed(checks)


def test_command_writes_json_and_refuses_to_replace_it(tmp_path, capsys):
    out = tmp_path / "checks.json"
    command = ["validate", "--only", "bench-kernel", "--only", "friction-passive", "--json", str(out)]
    assert main(command) == 0
    document = json.loads(out.read_text())
    assert document["passed"] is True
    assert {"twin_gait", "pinocchio", "numpy"} <= set(document["versions"])
    first, second = document["checks"]
    assert (first["name"], first["unit"], first["passed"]) == ("bench-kernel", "1", True)
    assert 0.0 <= first["figure"] <= first["tolerance"]
    assert (second["name"], second["unit"], second["tolerance"]) == ("friction-passive", "W", 0.0)
    capsys.readouterr()
    out.write_text("mine")
    assert main(command) == 2
    assert "exists" in capsys.readouterr().err
    assert out.read_text() == "mine"
    assert main([*command, "--force"]) == 0
    assert json.loads(out.read_text()) == document
    assert [path.name for path in tmp_path.iterdir()] == ["checks.json"]


def test_a_failed_check_ends_with_1_and_still_writes(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        validation_dynamics, "pendulum_of", with_wrong_gravity(validation_dynamics.pendulum_of)
    )
    out = tmp_path / "checks.json"
    assert main(["validate", "--only", "bench-double-pendulum", "--json", str(out)]) == 1
    printed = capsys.readouterr().out
    assert "FAILED" in printed
    assert printed.splitlines()[-1] == "0 passed, 1 failed"
    assert json.loads(out.read_text())["passed"] is False


def test_unknown_check_ends_with_2_and_lists_those_there_are(capsys):
    assert main(["validate", "--only", "nonsense"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'nonsense'" in line
    assert all(plan.name in line for plan in CHECKS)
    with pytest.raises(ParameterError):
        chosen_checks(["bench-kernel", "nonsense"])


def test_nothing_is_drawn_in_a_pipe(capsys):
    assert main(["validate", "--only", "bench-kernel"]) == 0
    assert capsys.readouterr().err == ""


def test_progress_counts_to_the_end():
    seen = []
    plans = chosen_checks(["bench-kernel", "friction-passive"])
    validate(plans, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(0, 2), (1, 2), (2, 2)]


def test_table_is_aligned_and_survives_figures_that_are_no_numbers():
    checks = [
        Check("a", "somebody", math.nan, "rad", 1e-9, False, "lost"),
        Check("longer", "b", 0.0, "1", 0.0, True, "fine"),
        Check("c", "b", None, "N m", 0.5, None, "skipped: way out"),
    ]
    header, *rows, total = draw_checks(checks).splitlines()
    place = header.index("verdict")
    assert [row[place:].split()[0] for row in rows] == ["FAILED", "passed", "-"]
    assert "nan rad" in rows[0]
    assert total == "1 passed, 1 failed, 1 skipped"
    document = checks_document(checks)
    assert [item["figure"] for item in document["checks"]] == [None, 0.0, None]
    json.dumps(document, allow_nan=False)
