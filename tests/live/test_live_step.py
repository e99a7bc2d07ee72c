"""Step of a live session, in which the adjustments of the world may change."""

from pathlib import Path

from twin_gait import load_experiment
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.live.session import choose_step


def test_live_step_is_stable_at_every_setting_of_the_adjustments() -> None:
    loaded = load_experiment("treadmill_guided")
    chosen = choose_step(loaded)
    assert loaded.experiment.resolved_integration.step == 0.25e-3
    # Without support and on a faster belt, the friction of the feet needs a smaller step.
    assert chosen.experiment.resolved_integration.step == 0.125e-3
    assert experiment_from_mapping(chosen.document, "document", Path()) == chosen.experiment


def test_live_step_of_the_user_is_kept() -> None:
    loaded = load_experiment("treadmill_guided", ["integration.step_ms=0.25"])
    assert choose_step(loaded) is loaded


def test_live_step_without_adjustments_is_the_default() -> None:
    assert choose_step(load_experiment("bench_leg")).experiment.resolved_integration.step == 1e-3
