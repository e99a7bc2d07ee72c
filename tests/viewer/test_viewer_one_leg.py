"""Pages and figures of a device on one leg: the other leg is the wearer's own."""

import pytest

from twin_gait import Run, load_experiment, simulate
from twin_gait.live.page import LiveScene
from twin_gait.live.telemetry import Block
from twin_gait.report.run_figures import draw_currents
from twin_gait.runs.run_page import scene_options
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.page import PageTexts
from twin_gait.viewer.scene import build_scene
from twin_gait.vocabulary import HOLD, Side


@pytest.fixture(scope="module")
def walk() -> Run:
    return simulate(load_experiment("knee_orthosis", ["duration_s=3"]).experiment)


def test_live_scene_shows_the_phases_of_the_leg_without_a_device(walk: Run) -> None:
    figure = LiveScene(build_setup(walk.experiment))
    names = [entry["name"] for entry in figure.page["phases"]]
    assert names == [*dict.fromkeys((*walk.table.phase_names, *walk.leg_table(Side.RIGHT).phase_names)), HOLD]
    for end in (500, 1400):
        columns = {str(name): walk.log[name].to_numpy()[:end] for name in walk.log}
        figure.show([Block(0, end, columns, "")])
        sample = figure.window.commands()[-1]["sample"]
        shown = {
            leg["side"]: names[values["phase"]]
            for leg, values in zip(figure.page["legs"], sample["legs"], strict=True)
        }
        device, own = walk.log["left_phase"].iloc[end - 1], walk.log["right_own_phase"].iloc[end - 1]
        assert shown == {"left": device, "right": own}
        assert figure.phases == {"left": device}


def test_only_the_leg_of_the_device_has_motors_and_straps(walk: Run) -> None:
    scene = build_scene(
        CommandBuffer(), walk.experiment.build_world().model, **scene_options(walk.experiment)
    )
    assert {side: len(caps) for side, caps in scene.caps.items()} == {Side.LEFT: 1, Side.RIGHT: 0}
    straps = [path for path in map(str, scene._window.commands()) if "_strap" in path]
    assert straps and all("left_" in path and "right_" not in path for path in straps)


@pytest.mark.parametrize(("preset", "expected"), [("knee_orthosis", "torque"), ("bench_leg", "motor torque")])
def test_torques_of_muscles_are_not_called_those_of_motors(preset: str, expected: str) -> None:
    run = simulate(load_experiment(preset, ["duration_s=0.5"]).experiment)
    page = recorded_run(
        run.log, run.experiment.build_world().model, about=PageTexts(title=""), frames_per_second=5.0
    )
    assert page["labels"]["torque"]["name"] == expected
    assert LiveScene(build_setup(run.experiment)).page["labels"]["torque"]["name"] == expected


def test_figure_of_currents_has_a_labelled_panel_for_each_drive_only(walk: Run) -> None:
    (axes,) = draw_currents(walk).axes
    assert axes.get_title() == "left knee" and axes.get_ylabel()
    assert all(label.get_visible() for label in axes.get_yticklabels())
