"""The viewer shows a motor at the ankle, and nothing of one where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.gait.table import TICK
from twin_gait.live.page import LiveScene
from twin_gait.live.telemetry import Block
from twin_gait.measures.leg_record import driven_joints
from twin_gait.report.formatting import walk_table
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.arrows import arc_state
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.motion import leg_columns, leg_values
from twin_gait.viewer.scene import build_scene
from twin_gait.vocabulary import JointName, Side

WALK = "treadmill_ankle"
JOINTS = tuple(JointName)


@pytest.fixture(scope="module")
def walk() -> Run:
    return simulate(load_experiment(WALK, ["duration_s=3"]).experiment)


def test_curves_and_torques_of_the_ankle_equal_the_log(walk: Run) -> None:
    model = walk.experiment.build_world().model
    values = leg_values(walk.log, Side.LEFT)
    np.testing.assert_allclose(values["ankle"], np.degrees(walk.log["left_ankle_angle_rad"]))
    np.testing.assert_array_equal(values["ankle_impedance"], walk.log["left_ankle_impedance_torque_Nm"])
    page = recorded_run(walk.log, model, about={"title": "t"}, frames_per_second=10.0)
    used = [name for name, found in values.items() if found.any()]  # there is neither target nor inertia
    assert page["legs"][0]["shows"] == ["phase", *used]


def test_an_orthosis_has_no_curve_no_cover_and_no_arrow() -> None:
    run = simulate(load_experiment("treadmill_guided", ["duration_s=0.5"]).experiment)
    model = run.experiment.build_world().model
    assert "left_ankle_angle_rad" in run.log
    assert driven_joints(run.log, Side.LEFT) == (JointName.HIP, JointName.KNEE)
    assert not [name for name in leg_values(run.log, Side.LEFT) if name.startswith("ankle")]
    scene = build_scene(CommandBuffer(), model)
    assert set(scene.arcs[Side.LEFT]) == {"hip", "knee"} and len(scene.caps[Side.LEFT]) == 2


def test_a_motor_of_the_ankle_has_a_cap_and_arrows(walk: Run) -> None:
    model = walk.experiment.build_world().model
    scene = build_scene(CommandBuffer(), model, drives=JOINTS)
    joints = [joint for _, joint in model.legs[Side.RIGHT].items()]
    assert scene.caps[Side.RIGHT] == [f"{scene.figure.paths[joint]}/motor_cap" for joint in joints]
    assert set(scene.arcs[Side.RIGHT]) == set(JOINTS)
    state = arc_state(scene.arcs[Side.RIGHT]["ankle"], 30.0)
    assert sum(value for (_, name), value in state.items() if name == "visible") == 1


def blocks_of(run: Run, *spans: tuple[int, int]) -> list[Block]:
    columns = {str(name): run.log[name].to_numpy() for name in run.log}
    return [Block(first, end, {k: c[first:end] for k, c in columns.items()}, "") for first, end in spans]


def test_a_live_scene_follows_the_ankle(walk: Run) -> None:
    figure = LiveScene(build_setup(walk.experiment))
    assert figure.page["legs"][0]["shows"].count("ankle_torque") == 1
    figure.show(blocks_of(walk, (0, len(walk.log))))
    assert figure.phases == {side: walk.log[f"{side}_phase"].iloc[-1] for side in ("left", "right")}
    columns = leg_columns(walk.log, Side.LEFT)
    assert columns["ankle_torque"] == "left_ankle_motor_torque_Nm" and columns["force"] in walk.log


def test_live_curves_have_the_extremes_of_every_five_ticks(walk: Run) -> None:
    figure = LiveScene(build_setup(walk.experiment))
    figure.show(blocks_of(walk, *((first, first + 10) for first in range(0, 100, 10))))
    curve = figure.window.commands()[-1]["sample"]["curves"][0]["knee_torque"]
    drawn = [(round(t / TICK), v) for t, v in zip(curve["times"], curve["values"], strict=True)]
    for first in range(0, 100, 5):
        span = walk.log["left_knee_motor_torque_Nm"].to_numpy()[first : first + 5]
        found = [value for tick, value in drawn if first <= tick < first + 5]
        assert (min(found), max(found)) == (span.min(), span.max())


def test_the_table_of_the_walk_has_the_power_of_the_ankle_s_motor(walk: Run) -> None:
    long = simulate(load_experiment(WALK, ["duration_s=8"]).experiment)
    rows = [row[0] for row in walk_table(summarise_run(long))]
    assert [row for row in rows if row == "ankle motor power [W]"]
    run = simulate(load_experiment("treadmill_guided", ["duration_s=8"]).experiment)
    assert not [row[0] for row in walk_table(summarise_run(run)) if "ankle motor" in row[0]]
