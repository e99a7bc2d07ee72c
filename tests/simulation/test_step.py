"""Default step of a walk on the belt: stable for the friction of the feet, and reported if it is not."""

from dataclasses import replace

from twin_gait import load_experiment, simulate, simulate_batch
from twin_gait.experiment.experiment import Integration, IntegrationMethod
from twin_gait.measures.effort import LARGEST_RESIDUAL
from twin_gait.report.formatting import unstable_step_note
from twin_gait.runs.summary import energy_summary

# Heavy, short, fast and with little support: at 0.25 ms the friction of its feet is unstable.
HEAVY = (
    "duration_s=2",
    "patient={mass_kg: 101, height_m: 1.51}",
    "scenario.belt_speed_km_per_h=1.9",
    "scenario.support.share=0.2",
)


def test_default_step_of_a_heavy_wearer_is_stable() -> None:
    run = simulate(load_experiment("treadmill_guided", HEAVY).experiment)
    summary = energy_summary(run)
    assert summary["step_s"] == 0.125e-3
    assert summary["energy_residual_share"] < LARGEST_RESIDUAL
    assert summary["step_stable"] is True and unstable_step_note(summary) == ""


def test_larger_step_of_a_heavy_wearer_is_reported_as_unstable() -> None:
    run = simulate(load_experiment("treadmill_guided", [*HEAVY, "integration.step_ms=0.25"]).experiment)
    summary = energy_summary(run)
    assert summary["energy_residual_share"] > 1e-3
    assert summary["step_stable"] is False
    note = unstable_step_note(summary)
    assert "0.25 ms" in note and "integration.step_ms=0.125" in note


def test_step_of_the_euler_method_is_not_judged() -> None:
    experiment = load_experiment("bench_leg", ["duration_s=1"]).experiment
    euler = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=1e-3)
    assert energy_summary(simulate(replace(experiment, integration=euler)))["step_stable"] is None


def test_rows_of_a_batch_say_which_steps_are_unstable() -> None:
    experiment = load_experiment("treadmill_guided", HEAVY).experiment
    rows = simulate_batch(experiment, [{}, {"integration.step_ms": 0.25}])
    assert rows["step_stable"].tolist() == [True, False]
