"""The scene of the viewer: meshes, arrows of the torques, ropes, trails, and what a page has to carry."""

import importlib.util
import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.leg_model import anthropometry
from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import build_model, packaged_urdf
from twin_gait.palette import PHASE_COLOURS
from twin_gait.parameters.wearer import SHANK_LENGTH, Patient
from twin_gait.viewer import arrows, body, environment, shapes
from twin_gait.viewer import scene as drawn_scene
from twin_gait.viewer.arrows import FULL_TORQUE
from twin_gait.viewer.body import ROPES
from twin_gait.viewer.commands import CommandBuffer, rgb
from twin_gait.viewer.environment import ROOT
from twin_gait.viewer.motion import LegMotion, Motion, PhaseSpells, read_motion
from twin_gait.viewer.scene import Scene, build_scene, build_urdf_scene
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.visuals import load_visuals
from twin_gait.vocabulary import Environment, GaitPhase, JointName, Side

PATIENT = Patient()
URDF_FOLDER = packaged_urdf("twin.urdf").parent
MESH_FILES = sorted((URDF_FOLDER / "meshes").glob("*.obj"))
PHASES = tuple(str(phase) for phase in GaitPhase)


# ---------------------------------------------------------------------------------- mesh files


def edges(faces: np.ndarray) -> Counter[tuple[int, int]]:
    """How often each edge is run along, in its direction."""
    return Counter((int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))


def welded(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that are at one place made one."""
    vertices, index = np.unique(np.round(shape.vertices, 6), axis=0, return_inverse=True)
    return vertices, index.reshape(-1)[shape.faces]


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    corners = vertices[faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(np.einsum("ij,ij->", vertices[faces[:, 0]], face_normals(vertices, faces))) / 6.0


@pytest.fixture(scope="module")
def script() -> Any:
    spec = importlib.util.spec_from_file_location("make_meshes", URDF_FOLDER / "make_meshes.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_mesh_files_equal_the_output_of_their_script(script: Any) -> None:
    made = script.texts()
    assert sorted(made) == [path.name for path in MESH_FILES]
    for path in MESH_FILES:
        assert made[path.name] == path.read_text(encoding="utf-8"), path.name


def test_the_viewer_scales_the_meshes_from_the_sizes_that_they_were_drawn_in(script: Any) -> None:
    assert (script.BODY_HEIGHT, script.BODY_MASS) == (body._DRAWN_HEIGHT, body._DRAWN_MASS)
    assert (script.BAR_HEIGHT, script.TORQUE_RADIUS) == (environment._MAST_HEIGHT, arrows._ARC_RADIUS)
    # The lengths of the body are those of the model's wearer of this height.
    drawn = (script.TRUNK, script.FOOT, script.FOREARM, script.LENGTHS["shank"])
    shares = (
        anthropometry.TRUNK_LENGTH,
        anthropometry.FOOT_LENGTH,
        anthropometry.FOREARM_LENGTH,
        SHANK_LENGTH,
    )
    np.testing.assert_allclose(drawn, np.multiply(shares, script.BODY_HEIGHT), atol=6e-4)
    mast = shapes.load_packaged_mesh("mast", np.eye(4)).vertices
    bar = mast[(np.abs(mast[:, 1]) > 0.18) & (np.abs(mast[:, 1]) < 0.2)]
    assert bar[:, 2].mean() == pytest.approx(script.BAR_HEIGHT, abs=1e-3)


@pytest.mark.parametrize("path", MESH_FILES, ids=lambda path: path.stem)
def test_mesh_is_closed_with_outward_normals(path: Path, tmp_path: Path) -> None:
    shape = shape_of_mesh(path, tmp_path)
    vertices, faces = welded(shape)
    along = edges(faces)
    # Each edge is run along once in either direction: no hole, no face turned round.
    assert set(along.values()) == {1}
    assert all((b, a) in along for a, b in along)
    assert signed_volume(vertices, faces) > 0.0
    turned_out = np.einsum("ij,ikj->ik", face_normals(vertices, faces), shape.normals[shape.faces])
    assert (turned_out > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1.0, atol=1e-6)


def shape_of_mesh(path: Path, folder: Path, scale: str = "1 1 1") -> Shape:
    """The one visual of a URDF that shows a mesh."""
    urdf, mesh = folder / "one.urdf", f'<mesh filename="{path}" scale="{scale}"/>'
    urdf.write_text(
        f'<robot name="one"><link name="a"><visual><geometry>{mesh}</geometry></visual></link></robot>'
    )
    (part,) = load_visuals(build_model(urdf), urdf)
    return part.shape


def test_meshes_are_small_and_all_are_used() -> None:
    assert sum(path.stat().st_size for path in MESH_FILES) < 900_000
    named = {
        Path(mesh.get("filename", "")).name
        for name in ("twin.urdf", "twin_leg.urdf")
        for mesh in ElementTree.parse(packaged_urdf(name)).getroot().iter("mesh")
    }
    drawn = {
        path.name
        for path in MESH_FILES
        if path.stem.startswith(("wearer_", "crutch", "mast", "motor_cap", "torque"))
    }
    assert named == {path.name for path in MESH_FILES} - drawn


@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf"])
def test_meshes_fit_the_lengths_of_the_urdf(name: str) -> None:
    """A shell ends above the joint below it; a sole lies where the foot touches the ground."""
    model = build_model(packaged_urdf(name))
    visuals = load_visuals(model, packaged_urdf(name))
    for part in visuals:
        if part.joint.endswith(("_hip", "_knee")):
            assert part.shape.vertices[:, 2].max() < 0.06
            assert part.shape.vertices[:, 2].min() > -0.5
        if part.joint.endswith("_ankle") and part.colour[0] < 0.13:
            heel = model.frames[model.getFrameId(part.joint.replace("ankle", "heel"))]
            assert part.shape.vertices[:, 2].min() == pytest.approx(heel.placement.translation[2], abs=1e-4)


@pytest.mark.parametrize("height", [1.50, 1.75, 1.95])
def test_soles_lie_where_heel_and_toe_of_the_wearer_are(height: float) -> None:
    model = load_experiment("treadmill_guided", [f"patient.height_m={height}"]).experiment.build_world().model
    (sole,) = (
        part.shape.vertices
        for part in load_visuals(model.model, model.urdf_path)
        if part.joint == "left_ankle" and part.colour[0] < 0.13
    )
    heel, toe = (
        model.model.frames[model.model.getFrameId(f"left_{end}")].placement.translation
        for end in ("heel", "toe")
    )
    assert sole[:, 2].min() == pytest.approx(heel[2], abs=1e-4)
    # The plate ends 2 mm inside its points, as it is drawn.
    assert (sole[:, 0].min(), sole[:, 0].max()) == pytest.approx((heel[0], toe[0]), abs=3e-3)


def test_a_copied_urdf_keeps_its_appearance_without_its_meshes(tmp_path: Path) -> None:
    copy = tmp_path / "mine.urdf"
    copy.write_text(packaged_urdf("twin_leg.urdf").read_text(encoding="utf-8"), encoding="utf-8")
    assert {"right_hip", "right_knee"} <= {part.joint for part in load_visuals(build_model(copy), copy)}


@pytest.mark.parametrize("scale", ["1 1 1", "1 -1 1", "-2 1 0.5"])
def test_a_mirrored_mesh_has_outward_normals(tmp_path: Path, scale: str) -> None:
    path = tmp_path / "corner.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    shape = shape_of_mesh(path, tmp_path, scale)
    size = np.prod([float(word) for word in scale.split()])
    assert signed_volume(shape.vertices, shape.faces) == pytest.approx(abs(size) / 6.0)
    turned_out = np.einsum(
        "ij,ikj->ik",
        face_normals(shape.vertices, shape.faces),
        shape.normals[shape.faces],
    )
    assert (turned_out > 0.0).all()


# ---------------------------------------------------------------------------------- shapes


def test_a_tube_encloses_the_volume_of_its_path() -> None:
    angle = np.linspace(0.0, 1.5 * math.pi, 200)
    path = np.column_stack((np.cos(angle), np.sin(angle), 0.3 * angle))
    tube = shapes.tube(path, 0.05, columns=40)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()  # Pappus: area times length of the axis
    assert signed_volume(tube.vertices, tube.faces) == pytest.approx(math.pi * 0.05**2 * length, rel=0.01)
    along = edges(welded(tube)[1])
    assert set(along.values()) == {1} and all((b, a) in along for a, b in along)
    turned_out = np.einsum("ij,ikj->ik", face_normals(tube.vertices, tube.faces), tube.normals[tube.faces])
    assert (turned_out > 0.0).all()


def test_creased_mesh_has_no_vertex_twice() -> None:
    ball = shapes.ball(0.1)
    creased = shapes.compute_normals(ball.vertices, ball.faces)
    rows = np.round(np.column_stack((creased.vertices, creased.normals)), 6)
    assert len(np.unique(rows, axis=0)) == len(rows) <= len(ball.vertices)


# ---------------------------------------------------------------------------------- torques


def test_arrow_turns_the_way_that_the_torque_turns() -> None:
    rng = np.random.default_rng(3)
    for number in (-6, -2, -1, 1, 3, 6):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        start = np.cross(axis, rng.standard_normal(3))
        start /= np.linalg.norm(start)
        arrow, _ = arrows.arc_arrow(number, 0.1, shapes.frame(axis, start))
        begins = np.linalg.norm(arrow.vertices - 0.1 * start, axis=1) < 0.009
        tail, tip = arrow.vertices[begins].mean(axis=0), tip_of(arrow)
        # The way from tail to tip round the axis, by angles that are unwound ring by ring.
        assert angle_about(axis, start, tail) == pytest.approx(0.0, abs=0.02)
        sweep = angle_about(axis, start, tip) % (math.copysign(2.0 * math.pi, number))
        assert sweep == pytest.approx(math.radians(270.0) * number / arrows.LEVELS, abs=0.12)


def tip_of(arrow: Shape) -> np.ndarray:
    """Apex of the cone, which the mesh of the arrow ends with."""
    return arrow.vertices[-1]


def angle_about(axis: np.ndarray, start: np.ndarray, point: np.ndarray) -> float:
    return math.atan2(float(point @ np.cross(axis, start)), float(point @ start))


def test_arrow_level_has_the_sign_of_the_torque_and_grows_with_its_size() -> None:
    levels = [arrows.level(torque) for torque in np.linspace(-90.0, 90.0, 361)]
    assert (np.diff(levels) >= 0).all()
    assert (min(levels), max(levels)) == (-arrows.LEVELS, arrows.LEVELS)
    for torque in (5.1, 20.0, 47.0, 60.0):
        assert arrows.level(torque) == -arrows.level(-torque) > 0
        # An arrow of a level stands for a torque within half a level of the real one.
        assert abs(arrows.level(torque) * 10.0 - torque) <= 5.0
    assert arrows.level(4.9) == arrows.level(math.nan) == 0


def meshes_of(recorder: CommandBuffer) -> dict[str, np.ndarray]:
    """Vertices of every object, as the page gets them."""
    found = {}
    for command in recorder.commands():
        if command["type"] == "set_object":
            data = command["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data
            found[command["path"]] = np.frombuffer(data, dtype=np.float32).reshape(-1, 3).astype(float)
    return found


def properties_of(recorder: CommandBuffer, name: str) -> dict[str, object]:
    return {c["path"]: c["value"] for c in recorder.commands() if c.get("property") == name}


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_positive_torque_shows_the_arrow_that_turns_with_a_growing_angle(
    worn_twin: LegModel, side: Side, joint: str
) -> None:
    """The tip of the arrow moves as the limb does when Pinocchio increases the angle."""
    recorder = CommandBuffer()
    scene = build_scene(recorder, worn_twin)
    arc = scene.arcs[side][joint]
    vertices = meshes_of(recorder)
    model, data = worn_twin.model, worn_twin.model.createData()
    name = worn_twin.legs[side].hip if joint == "hip" else worn_twin.legs[side].knee
    index = model.getJointId(name)
    for sign in (1.0, -1.0):
        shown = [path for (path, _), seen in arrows.arc_state(arc, sign * 0.3 * FULL_TORQUE).items() if seen]
        (path,) = shown
        arrow = vertices[path]
        base, tip = arrow[-30:-1].mean(axis=0), arrow[-1]
        # The arrow stands in the frame of the parent joint: carry its head along with the limb.
        moved = {}
        for angle in (0.0, 1e-4):
            q = pin.neutral(model)
            q[worn_twin.index(side, JointName(joint))] = angle
            pin.forwardKinematics(model, data, q)
            moved[angle] = data.liMi[index].copy()
        motion = moved[1e-4].act(moved[0.0].actInv(base)) - base
        assert sign * float(motion @ (tip - base)) > 0.0
        # It lies on the outer side of the motor, in a plane across the axis.
        outward = 1.0 if side is Side.LEFT else -1.0
        assert outward * (arrow[:, 1] - moved[0.0].translation[1]).min() > 0.02
        assert np.ptp(arrow[:, 1]) < 0.05


def test_arrows_are_hidden_until_a_torque_is_known(bench: LegModel) -> None:
    recorder = CommandBuffer()
    scene = build_scene(recorder, bench)
    visible = properties_of(recorder, "visible")
    paths = [path for arc in scene.arcs[Side.RIGHT].values() for path in arc.values()]
    assert len(paths) == 2 * 2 * arrows.LEVELS
    assert all(visible[path] is False for path in paths)
    for joint, torque in (("hip", 0.5 * FULL_TORQUE), ("knee", -FULL_TORQUE)):
        recorder.apply(arrows.arc_state(scene.arcs[Side.RIGHT][joint], torque))
    visible = properties_of(recorder, "visible")
    seen = {path for path in paths if visible[path]}
    assert seen == {
        scene.arcs[Side.RIGHT]["hip"][arrows.LEVELS // 2],
        scene.arcs[Side.RIGHT]["knee"][-arrows.LEVELS],
    }


# ---------------------------------------------------------------------------------- ropes


def world(scene: Scene, recorder: CommandBuffer, path: str) -> np.ndarray:
    """Transform of a place of the scene from the last commands alone, without the figure's own sums."""
    transform, at = np.eye(4), ""
    transforms = {c["path"]: np.array(c["matrix"]).reshape(4, 4).T for c in recorder.commands()
                  if c["type"] == "set_transform"}  # fmt: skip
    positions, turns, scales = (properties_of(recorder, name) for name in ("position", "quaternion", "scale"))
    for part in path.strip("/").split("/"):
        at = f"{at}/{part}"
        local = transforms.get(at, np.eye(4)).copy()
        if at in turns:
            x, y, z, w = turns[at]  # type: ignore[misc]
            local[:3, :3] = pin.Quaternion(w, x, y, z).matrix()
        if at in positions:
            local[:3, 3] = positions[at]
        if at in scales:
            local[:3, :3] = local[:3, :3] @ np.diag(scales[at])  # type: ignore[arg-type]
        transform = transform @ local
    return transform


@pytest.mark.parametrize("lift", [-0.05, 0.0, 0.08])
def test_ropes_hang_from_the_bar_and_meet_the_harness(worn_twin: LegModel, lift: float) -> None:
    recorder = CommandBuffer()
    scene = build_scene(recorder, worn_twin, patient=PATIENT)
    q = np.zeros(worn_twin.nv)
    assert worn_twin.pelvis_index is not None
    q[worn_twin.pelvis_index] = 0.93 + lift
    motion = Motion(np.zeros(1), q[None, :], {}, PHASES)
    recorder.apply(scene.state_at(motion, 0))
    vertices = meshes_of(recorder)
    straps_path = f"{scene.figure.paths['pelvis_vertical']}/wearer_harness"
    straps = on_stage(world(scene, recorder, straps_path), vertices[straps_path])
    mast = on_stage(world(scene, recorder, f"{environment.ROOT}/mast"), vertices[f"{environment.ROOT}/mast"])
    for number in range(2):
        placement = world(scene, recorder, f"{ROPES}/{number}")
        lower, upper = on_stage(placement, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
        # The straps are tubes of 7 mm radius, the bar of 16 mm.
        assert np.linalg.norm(straps - lower, axis=1).min() < 0.008
        assert np.linalg.norm(mast - upper, axis=1).min() < 0.05
        assert upper[2] > PATIENT.height > lower[2]
        # A rope does not bend or stretch its thickness.
        np.testing.assert_allclose(np.linalg.norm(placement[:3, :2], axis=0), 1.0, atol=1e-12)


def on_stage(placement: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ placement[:3, :3].T + placement[:3, 3]


def test_every_mesh_moves_with_the_joint_that_carries_it(
    worn_twin: LegModel, rng: np.random.Generator
) -> None:
    """What the commands put on the stage is where Pinocchio's forward kinematics puts the link."""
    recorder = CommandBuffer()
    scene = build_scene(recorder, worn_twin, patient=PATIENT)
    q = rng.uniform(-0.4, 0.9, worn_twin.nv)
    recorder.apply(scene.figure.posture(q))
    data = worn_twin.model.createData()
    pin.forwardKinematics(worn_twin.model, data, q)
    for joint, group in scene.figure.paths.items():
        if joint == "universe":
            continue
        for path in meshes_of(recorder):
            if path.rsplit("/", 1)[0] == group and "torque_" not in path:
                index = worn_twin.model.getJointId(joint)
                np.testing.assert_allclose(
                    world(scene, recorder, path), data.oMi[index].homogeneous, atol=1e-9, err_msg=path
                )


# ---------------------------------------------------------------------------------- belt and trail


@pytest.mark.parametrize("speed", [0.42, -0.3])
def test_belt_marks_travel_with_the_belt(speed: float) -> None:
    times = np.linspace(0.0, 3.0, 200)
    offsets = np.array([environment.belt_offset(time * speed) for time in times])
    gap = (offsets + speed * times) / environment.BELT_MARK_SPACING
    np.testing.assert_allclose(gap, np.round(gap), atol=1e-9)  # whole spacings apart: marks look alike
    assert offsets.min() > -environment.BELT_MARK_SPACING - 1e-12 and offsets.max() <= 0.0


def walk(model: LegModel, duration: float = 4.0, rate: float = 30.0) -> Motion:
    """Sines for angles, and the five phases in turn; not a gait."""
    times = np.arange(round(rate * duration) + 1) / rate
    q = np.zeros((len(times), model.nv))
    q[:, model.index(Side.RIGHT, JointName.HIP)] = 0.3 * np.sin(3.0 * times)
    if model.pelvis_index is not None:
        q[:, model.pelvis_index] = 0.95
    starts = np.arange(0.0, duration, 0.3)
    phases = PhaseSpells(starts, np.arange(len(starts)) % len(PHASES))
    leg = LegMotion(phases=phases, curves={})
    return Motion(times, q, {Side.RIGHT: leg}, PHASES)


def test_trail_is_the_path_of_the_sole_over_the_last_stride(worn_twin: LegModel) -> None:
    motion = walk(worn_twin)
    recorder = CommandBuffer()
    scene = build_scene(recorder, worn_twin)
    scene.draw_trails(motion)
    # Five phases of 0.3 s: the first stride that the motion has whole is from 1.5 to 3.0 s.
    (stride,) = scene.trails
    assert (stride.begin, stride.end) == (3.0, math.inf)
    for time, shown in ((0.0, False), (2.9, False), (3.1, True), (4.0, True)):
        frame = int(np.searchsorted(motion.times, time - 1e-9))
        assert scene.state_at(motion, frame)[stride.path, "visible"] is shown
    drawn = meshes_of(recorder)[stride.path]
    for frame in np.flatnonzero((motion.times >= 1.5) & (motion.times <= 3.0)):
        heel, toe = (worn_twin.frame_position(motion.q[frame], f"right_{end}") for end in ("heel", "toe"))
        sole = 0.5 * (heel + toe)
        assert sole[2] > drawn_scene.LOWEST_TRAIL  # the path was not lifted here
        # Within a radius of the tube, and what a chord between frames leaves out.
        assert np.linalg.norm(drawn - sole, axis=1).min() < 0.012


def test_trail_has_the_colours_of_the_phases(worn_twin: LegModel) -> None:
    motion = walk(worn_twin)
    spells = motion.legs[Side.RIGHT].phases
    assert spells is not None
    frames = np.flatnonzero((motion.times >= 1.5) & (motion.times <= 3.0))
    points = np.column_stack((motion.times[frames], np.zeros((len(frames), 2))))
    shape = drawn_scene.trail_shape(motion.times[frames], points, spells, PHASES)
    assert shape is not None and shape.colours is not None
    assert len(shape.colours) == len(shape.vertices)
    for (x, _, _), colour in zip(shape.vertices, shape.colours, strict=True):
        phase = GaitPhase(PHASES[spells.code_at(float(x))])  # x is the time here
        np.testing.assert_allclose(colour, rgb(PHASE_COLOURS[phase]))


def test_no_trail_without_movement(bench: LegModel) -> None:
    motion = walk(bench)
    scene = build_scene(CommandBuffer(), bench)
    still = replace(motion, q=np.zeros_like(motion.q))
    scene.draw_trails(still)
    assert scene.trails == []
    scene.draw_trails(motion)
    assert len(scene.trails) == 1


def test_after_the_last_path_that_is_kept_no_old_one_is_shown(
    bench: LegModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawn_scene, "MOST_STRIDES", 1)
    scene = build_scene(CommandBuffer(), bench)
    motion = walk(bench, duration=8.0)
    scene.draw_trails(motion)
    (stride,) = scene.trails
    assert (stride.begin, stride.end) == pytest.approx((3.0, 4.5))
    shown = [scene.state_at(motion, frame)[stride.path, "visible"] for frame in range(len(motion.times))]
    np.testing.assert_array_equal(shown, (motion.times >= stride.begin) & (motion.times < stride.end))


# ---------------------------------------------------------------------------------- the stage


def surface_of(recorder: CommandBuffer, path: str) -> dict[str, object]:
    (command,) = [c for c in recorder.commands() if c["type"] == "set_object" and c["path"] == path]
    return dict(command["object"]["materials"][0])


def test_the_scene_stays_below_its_size_limit(worn_twin: LegModel) -> None:
    """What makes a page slow without a graphics card: triangles, draw calls, gloss, shadows on everything."""
    recorder = CommandBuffer()
    scene = build_scene(recorder, worn_twin, patient=PATIENT)
    hidden = {path for path, seen in properties_of(recorder, "visible").items() if seen is False}
    drawn = [c for c in recorder.commands() if c["type"] == "set_object" and c["path"] not in hidden]
    triangles = sum(len(c["object"]["geometries"][0]["data"]["index"]["array"].data) // 12 for c in drawn)
    assert len(drawn) <= 50
    assert triangles < 30_000
    receive = properties_of(recorder, "receiveShadow")
    shaded = {c["path"] for c in drawn if receive.get(f"{c['path']}/<object>") is not False}
    ground = ("floor", "treadmill/frame", "treadmill/belt_surface", "treadmill/belt/marks")
    assert shaded == {f"{environment.ROOT}/{name}" for name in ground}
    assert surface_of(recorder, f"{scene.figure.paths['left_hip']}/wearer_thigh")["opacity"] < 1.0  # type: ignore[operator]


def test_bench_leg_does_not_touch_its_bench(bench: LegModel) -> None:
    recorder = CommandBuffer()
    build_scene(recorder, bench, environment=Environment.STAND)
    vertices = meshes_of(recorder)
    parts = {
        name: vertices[f"{ROOT}/bench/{name}"] for name in ("table_top", "table_frame", "vice", "weight")
    }
    for name, part in parts.items():
        # Cuffs reach 0.1 m behind the tube; jaws hold the bracket behind the motor.
        assert part[:, 1].min() > (0.10 if name != "vice" else 0.05), name
    top = parts["table_top"][:, 2].max()
    assert parts["weight"][:, 2].min() == pytest.approx(top, abs=1e-3)
    assert parts["vice"][:, 2].min() == pytest.approx(top, abs=1e-3)
    assert parts["table_frame"][:, 2].min() < -0.9  # hip to ankle: 0.85 m


def test_a_urdf_with_its_vertical_along_y_stands_upright(tmp_path: Path) -> None:
    urdf = tmp_path / "post.urdf"
    box = '<visual><geometry><box size="0.1 1.6 0.2"/></geometry></visual>'
    urdf.write_text(f'<robot name="post"><link name="a">{box}</link></robot>')
    views = [
        build_urdf_scene(CommandBuffer(), build_model(urdf), urdf, up_axis=axis).view for axis in ("z", "y")
    ]
    assert views[0].height == views[1].height
    recorder = CommandBuffer()
    scene = build_urdf_scene(recorder, build_model(urdf), urdf, up_axis="y")
    path, points = next((p, v) for p, v in meshes_of(recorder).items() if "visual" in p)
    assert np.ptp(on_stage(world(scene, recorder, path), points)[:, 2]) == pytest.approx(1.6)


def test_torques_of_a_log_reach_the_arrows(bench: LegModel) -> None:
    hip = {"right_hip_angle_rad": 0.1, "right_hip_motor_torque_Nm": [30.0, -30.0]}
    knee = {"right_knee_angle_rad": 0.2, "right_knee_motor_torque_Nm": 0.0}
    watched = {"safety_state": 0.0, "right_phase": pd.Categorical(["early_stance"] * 2)}
    log = pd.DataFrame({"time_s": [0.0, 0.1], **hip, **knee, **watched})
    motion = read_motion(log, bench)
    scene = build_scene(CommandBuffer(), bench)
    paths = scene.arcs[Side.RIGHT]["hip"]
    first, last = (scene.state_at(motion, frame) for frame in (0, len(motion.times) - 1))
    assert first[paths[3], "visible"] and not first[paths[-3], "visible"]
    assert last[paths[-3], "visible"] and not last[paths[3], "visible"]


def test_one_leg_of_another_urdf_gets_arrows_and_a_bench(tmp_path: Path) -> None:
    urdf = tmp_path / "bare.urdf"
    joint = (
        '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><axis xyz="0 0 {}"/>{}</joint>'
    )
    rest = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
    inertia = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
    body = f'<inertial><mass value="3"/>{inertia}</inertial>'
    links = f'<link name="p"/><link name="t">{body}</link><link name="s">{body}</link>'
    hip = joint.format("h", "p", "t", 1, rest)
    knee = joint.format("k", "t", "s", -1, '<origin xyz="0 -0.4 0"/>' + rest)
    urdf.write_text(f'<robot name="bare">{links}{hip}{knee}</robot>')
    recorder = CommandBuffer()
    model = LegModel(urdf, {Side.LEFT: LegJoints(hip="h", knee="k")}, up_axis="y")
    scene = build_scene(recorder, model, environment=Environment.STAND)
    assert set(scene.arcs[Side.LEFT]) == {"hip", "knee"}
    path = scene.arcs[Side.LEFT]["hip"][1]
    arrow = on_stage(world(scene, recorder, path), meshes_of(recorder)[path])
    assert arrow[:, 1].min() > 0.0  # left of the leg, in a scene whose vertical is z
    assert f"{environment.ROOT}/bench/vice" in meshes_of(recorder)


def test_a_urdf_without_visuals_gets_sticks_between_joints(tmp_path: Path) -> None:
    root = ElementTree.parse(packaged_urdf("twin.urdf")).getroot()
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    urdf = tmp_path / "bare.urdf"
    urdf.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    recorder = CommandBuffer()
    scene = build_urdf_scene(recorder, build_model(urdf), urdf)
    thigh = meshes_of(recorder)[f"{scene.figure.paths['left_hip']}/sticks"]
    assert thigh[:, 2].min() == pytest.approx(-0.42, abs=0.03)  # the knee is 0.42 m below the hip
    foot = meshes_of(recorder)[f"{scene.figure.paths['left_ankle']}/sticks"]
    np.testing.assert_allclose(foot[:, 0].max(), 0.17, atol=0.03)  # the toe's frame
    assert scene.view.height > 0.9


def test_belt_marks_stay_under_the_covers_of_its_ends_and_soles_on_the_belt() -> None:
    recorder = CommandBuffer()
    environment.draw_treadmill(recorder)
    drawn = meshes_of(recorder)
    marks, frame = (drawn[path][:, 0] for path in (f"{environment.BELT}/marks", f"{ROOT}/treadmill/frame"))
    # From an offset of one spacing backwards to none.
    assert marks.min() - environment.BELT_MARK_SPACING > frame.min() and marks.max() < frame.max()
    walked = simulate(load_experiment("treadmill_guided", ["duration_s=5"]).experiment)
    model = walked.experiment.build_world().model
    heights = [
        model.frame_position(q, contact)[2]
        for q in read_motion(walked.log, model).q
        for leg in model.legs.values()
        for contact in leg.contact_frames
    ]
    assert min(heights) < -0.01  # the ground of the model is soft
    assert min(heights) > drawn[f"{ROOT}/treadmill/belt_surface"][:, 2].max() - 5e-4
