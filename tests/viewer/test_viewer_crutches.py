"""A free trunk on crutches in the viewer: arms, crutches, walkway, chair, modes; recorded and live."""

import json
import zlib
from base64 import b64decode
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from synthetic_floor import SPEED, floor_walk

from twin_gait.leg_model.anthropometry import FOREARM_LENGTH, SHOULDER_HEIGHT, UPPER_ARM_LENGTH
from twin_gait.live.page import LiveScene
from twin_gait.live.telemetry import Block
from twin_gait.parameters.environment import ChairParameters
from twin_gait.runs.run_page import scene_options
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.viewer import environment
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.arrows import FORCE_ROOT, METRES_PER_NEWTON
from twin_gait.viewer.body import ROOT, ROPES, bent_elbow
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.environment import CHAIR, METRES, SEAT
from twin_gait.viewer.motion import MODE, Motion, read_motion
from twin_gait.viewer.scene import Scene, SceneOptions, SceneState, build_scene
from twin_gait.viewer.visuals import load_visuals
from twin_gait.vocabulary import Side

Drawn = tuple[Scene, CommandBuffer, Motion]
HEIGHT, MODES = 1.75, ("sitting", "walking")
SIZES = ChairParameters(height=0.46, depth=0.4)


@pytest.fixture(scope="module")
def walk() -> Run:
    """A walk of two seconds with a chair behind it, in two modes."""
    run = floor_walk(2.0)
    mode = (run.log["time_s"] >= 1.0).to_numpy(dtype=float)
    return replace(run, log=run.log.assign(**{SEAT: -0.2, MODE: mode}))


def scene_of(run: Run) -> tuple[Scene, CommandBuffer]:
    recorder = CommandBuffer()
    setting: SceneOptions = {**scene_options(run.experiment), "chair": SIZES if SEAT in run.log else None}
    return build_scene(recorder, run.experiment.build_world().model, **setting), recorder


@pytest.fixture(scope="module")
def drawn(walk: Run) -> Drawn:
    return *scene_of(walk), read_motion(walk.log, walk.experiment.build_world().model, frame_times=[0.4])


def end_of(state: SceneState, path: str, length: float) -> np.ndarray:
    """Point on the z axis of a group, by its position and quaternion alone."""
    x, y, z, w = state[path, "quaternion"]
    axis = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
    return np.asarray(state[path, "position"]) + length * axis


# ---------------------------------------------------------------------------------- the arm


@pytest.mark.parametrize("bend", [0.01, 0.4, 1.2, 2.0])
@pytest.mark.parametrize("turn", [-0.3, 0.0, 0.5])
def test_elbow_position_follows_from_the_angles(bend: float, turn: float) -> None:
    """Forwards from the angles of both links, back from the ends."""
    upper, lower = 0.33, 1.1
    shoulder = np.array([0.2, 1.4])
    elbow = shoulder + upper * np.array([np.sin(turn - bend), -np.cos(turn - bend)])
    tip = elbow + lower * np.array([np.sin(turn), -np.cos(turn)])
    np.testing.assert_allclose(bent_elbow(shoulder, tip, upper, lower), elbow, atol=1e-9)


def test_an_arm_that_does_not_reach_is_straight_and_its_crutch_keeps_its_length() -> None:
    elbow = bent_elbow(np.array([0.0, 1.5]), np.array([0.0, 0.0]), 0.3, 1.1)
    np.testing.assert_allclose(elbow, [0.0, 1.1], atol=1e-12)


def test_arms_extend_from_the_shoulders_to_the_tips_of_the_log(walk: Run, drawn: Drawn) -> None:
    scene, _, motion = drawn
    forearms = set()
    for frame in range(0, len(motion.times), 7):
        state, row = scene.state_at(motion, frame), walk.log.iloc[round(1000 * motion.times[frame])]
        lean, up = row["trunk_pitch_rad"], SHOULDER_HEIGHT * HEIGHT
        shoulder = (
            row["pelvis_forward_m"] + up * np.sin(lean),
            row["pelvis_height_m"] + up * np.cos(lean),
        )
        for side, left in ((Side.LEFT, 1.0), (Side.RIGHT, -1.0)):
            arm, forearm = f"{ROOT}/{side}_upper_arm", f"{ROOT}/{side}_forearm"
            np.testing.assert_allclose(np.array(state[arm, "position"])[[0, 2]], shoulder, atol=1e-9)
            elbow, tip = end_of(state, arm, state[arm, "scale"][2]), np.array(state[forearm, "position"])
            length = float(np.linalg.norm(elbow - tip))
            np.testing.assert_allclose(end_of(state, forearm, length), elbow, atol=1e-9)
            log = [row[f"{side}_crutch_forward_m"], row[f"{side}_crutch_height_m"]]
            np.testing.assert_allclose(tip[[0, 2]], log, atol=1e-9)
            assert left * tip[1] > left * state[arm, "position"][1] > 0.0  # beside the legs
            forearms.add(round(length, 9))
    assert len(forearms) == 1
    # From the tip 0.485 of the height to the wrist (Drillis and Contini), and the forearm; a little aslant.
    assert forearms.pop() == pytest.approx((0.485 + FOREARM_LENGTH) * HEIGHT, rel=0.01)
    assert UPPER_ARM_LENGTH + FOREARM_LENGTH == pytest.approx(0.332)


def test_the_force_of_the_log_is_drawn_next_to_the_crutch_tip(walk: Run, drawn: Drawn) -> None:
    scene, _, motion = drawn
    frame = int(np.argmax(walk.log["left_crutch_normal_force_N"].to_numpy()[:500:33]))
    state, row = scene.state_at(motion, frame), walk.log.iloc[round(1000 * motion.times[frame])]
    path = f"{FORCE_ROOT}/left_crutch"
    force = np.hypot(row["left_crutch_normal_force_N"], row["left_crutch_friction_force_N"])
    assert state[path, "visible"] is True
    assert state[path, "scale"][2] == pytest.approx(METRES_PER_NEWTON * force)
    assert state[path, "position"][0] == pytest.approx(row["left_crutch_forward_m"], abs=0.06)


# ---------------------------------------------------------------------------------- what is around


def test_pelvis_parts_of_the_urdf_are_attached_to_the_trunk_joint(walk: Run) -> None:
    model = walk.experiment.build_world().model
    assert model.trunk_joint == "pelvis_pitch"
    assert {"pelvis_pitch"} == {part.joint for part in load_visuals(model.model, model.urdf_path)
                                if part.joint.startswith(("pelvis", "universe"))}  # fmt: skip


def test_the_camera_follows_the_walk_and_the_distance_marks_stay(drawn: Drawn) -> None:
    scene, recorder, motion = drawn
    state = scene.state_at(motion, len(motion.times) - 1)
    way = SPEED * motion.times[-1]
    assert state["/meshcat", "position"] == pytest.approx([-way, 0.0, 0.0])
    assert state[environment.FLOOR, "position"][0] == pytest.approx(way)
    paths = {command["path"] for command in recorder.commands()}
    assert METRES in paths and not any("treadmill" in path for path in paths)


def test_a_harness_with_support_is_drawn_with_vertical_ropes(
    drawn: Drawn,
) -> None:
    _, bare, _ = drawn
    assert not any(ROPES in command["path"] for command in bare.commands())
    held = floor_walk(0.5, "scenario.harness.share=0.3")
    scene, _ = scene_of(held)
    motion = read_motion(held.log, held.experiment.build_world().model)
    state = scene.state_at(motion, len(motion.times) - 1)
    lower = state[f"{ROPES}/0", "position"]
    assert lower[0] > held.log["pelvis_forward_m"].iloc[-1]
    # Straight up.
    assert end_of(state, f"{ROPES}/0", 1.0)[:2] == pytest.approx(lower[:2], abs=1e-12)


def test_the_chair_is_drawn_at_the_front_edge_of_the_log(drawn: Drawn) -> None:
    scene, recorder, motion = drawn
    state = scene.state_at(motion, 0)
    assert state[CHAIR, "position"][0] == -0.2
    seat = next(c for c in recorder.commands() if c["path"] == f"{CHAIR}/seat")
    scale = next(
        c["value"] for c in recorder.commands() if c.get("property") == "scale" and c["path"] == CHAIR
    )
    buffer = seat["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data
    corners = np.frombuffer(buffer, dtype=np.float32).reshape(-1, 3) * scale
    assert corners[:, 2].max() == pytest.approx(SIZES.height, abs=1e-5)
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((-SIZES.depth, 0.0), abs=1e-5)


# ---------------------------------------------------------------------------------- pages and picture


def test_a_page_has_crutches_and_the_mode_of_every_moment(walk: Run) -> None:
    page = recorded_run(
        walk.log, walk.experiment.build_world().model, about={"title": "t", "modes": MODES},
        frames_per_second=30.0, **scene_options(walk.experiment),
    )  # fmt: skip
    frames: dict[str, Any] = json.loads(zlib.decompress(b64decode(page["frames"])))
    assert page["modes"] == ["Sitting", "Walking"]
    assert frames["modes"] == {"starts": [0.0, 1.0], "codes": [0, 1]}
    assert "crutch" in page["legs"][0]["shows"]
    values = frames["legs"][0]["series"]["crutch"]["values"]
    assert max(values) == pytest.approx(walk.log["left_crutch_normal_force_N"].max(), abs=0.01)


def test_a_live_scene_equals_the_recorded_scene(walk: Run, drawn: Drawn) -> None:
    scene, _, motion = drawn
    live = LiveScene(build_setup(walk.experiment))
    live._modes = MODES  # of the columns that the fixture has added to the log
    frame = int(np.searchsorted(motion.times, 0.4))
    live.show([Block(400, 401, {str(name): walk.log[name].to_numpy()[400:401] for name in walk.log}, "")])
    sent = {(c["path"], c["property"]): c["value"] for c in live.window.commands()
            if c["type"] == "set_property"}  # fmt: skip
    expected = scene.state_at(motion, frame)
    prefixes = (ROOT, environment.FLOOR, f"{FORCE_ROOT}/left_")
    shown = [key for key in expected if key[0].startswith(prefixes)]
    assert len(shown) > 12
    assert {key: sent[key] for key in shown} == {key: expected[key] for key in shown}
    assert live.window.commands()[-1]["sample"]["mode"] == 0 and live.mode == MODES[0]
    assert "crutch" in live.page["legs"][0]["shows"]
