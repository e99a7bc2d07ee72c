"""The viewer: what it draws, the page it writes, the server it starts."""

import base64
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from errors import raises, warns
from example_robots import robot_urdf

import twin_gait.viewer
from twin_gait.exceptions import ViewerError
from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf import build_model, find_urdf
from twin_gait.leg_model.urdf_document import UrdfWarning
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.palette import PHASE_COLOURS
from twin_gait.parameters.wearer import Patient
from twin_gait.viewer import environment, shapes
from twin_gait.viewer.animation import _belt_track, recorded_run
from twin_gait.viewer.arrows import FORCE_ROOT, METRES_PER_NEWTON, arrow_state
from twin_gait.viewer.commands import CommandBuffer
from twin_gait.viewer.figure import ArticulatedFigure
from twin_gait.viewer.motion import FRAMES_PER_SECOND, read_motion
from twin_gait.viewer.page import recorded_page
from twin_gait.viewer.scene import build_scene, build_urdf_scene
from twin_gait.viewer.visuals import LinkPart, load_visuals
from twin_gait.vocabulary import GaitPhase, JointName, PelvisGuide, Side

PATIENT = Patient()
BELT_SPEED = 0.4
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
SOFTWARE_GL = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def synthetic_log(model: LegModel, duration: float, seed: int = 0) -> pd.DataFrame:
    """Synthetic joint angles (sines and a little noise), phases in turn, forces; not a gait."""
    noise = np.random.default_rng(seed)
    clock = np.arange(round(1000 * duration)) * 1e-3
    columns: dict[str, object] = {"time_s": clock}
    for index, side in enumerate(model.sides):
        for joint, centre, swing in (("hip", 0.2, 0.4), ("knee", 0.6, 0.5), ("ankle", 0.0, 0.2)):
            angle = centre + swing * np.sin(2.0 * math.pi * (0.71 * clock + 0.5 * index) + len(joint))
            columns[f"{side}_{joint}_angle_rad"] = angle + 1e-3 * noise.standard_normal(len(clock))
            columns[f"{side}_{joint}_motor_torque_Nm"] = 20.0 * np.cos(5.0 * clock + index)
        codes = (np.floor(clock / 0.17).astype(int) + 2 * index) % len(GaitPhase)
        columns[f"{side}_phase"] = pd.Categorical.from_codes(codes, categories=[str(p) for p in GaitPhase])
        columns[f"{side}_foot_normal_force_N"] = np.maximum(0.0, 400.0 * np.sin(4.0 * clock + 3.0 * index))
        columns[f"{side}_foot_cop_ratio"] = 0.5
        columns[f"{side}_foot_clearance_m"] = np.maximum(0.0, -0.02 * np.sin(4.0 * clock + 3.0 * index))
        columns[f"{side}_foot_friction_force_N"] = 30.0 * np.cos(4.0 * clock)
    columns["safety_state"], columns["belt_speed_m_per_s"] = 0.0, BELT_SPEED
    columns["pelvis_height_m"] = 0.93 + 0.01 * np.sin(9.0 * clock)
    return pd.DataFrame(columns)


def write_walk(
    path: Path, model: LegModel, duration: float = 0.5, title: str = "synthetic", **more: object
) -> Path:
    run = recorded_run(
        synthetic_log(model, duration),
        model,
        about={"title": title},
        frames_per_second=FRAMES_PER_SECOND,
        patient=PATIENT,
        **more,  # type: ignore[arg-type]
    )
    path.write_text(recorded_page([run]), encoding="utf-8")
    return path


def bare_urdf(folder: Path, visual: str = "", version: str = "1.0") -> Path:
    """Return a URDF of hip and knee, y up, with a given visual on the thigh."""
    inertia = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
    body = f'<inertial><mass value="3"/>{inertia}</inertial>'
    limit = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
    path = folder / "bare.urdf"
    path.write_text(
        f"""<robot name="bare" version="{version}"><link name="pelvis"/>
        <link name="thigh">{body}{visual}</link><link name="shank">{body}</link>
        <joint name="h" type="revolute"><parent link="pelvis"/><child link="thigh"/>
          <axis xyz="0 0 1"/>{limit}</joint>
        <joint name="k" type="revolute"><parent link="thigh"/><child link="shank"/>
          <origin xyz="0 -0.4 0"/><axis xyz="0 0 -1"/>{limit}</joint></robot>"""
    )
    return path


def drawn_paths(recorder: CommandBuffer) -> set[str]:
    return {command["path"] for command in recorder.commands() if command["type"] == "set_object"}


# ---------------------------------------------------------------------------------- shapes


def enclosed_volume(shape: shapes.Shape) -> float:
    a, b, c = (shape.vertices[shape.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (shapes.rounded_box((0.1, 0.2, 0.3), 0.0), 0.1 * 0.2 * 0.3),
        (shapes.cylinder(0.05, 0.2, bevel=0.0005), math.pi * 0.05**2 * 0.2),
        (shapes.ball(0.2), 4.0 / 3.0 * math.pi * 0.2**3),
        (shapes.revolve([(0.0, 0.0), (0.1, 0.0), (0.0, 0.3)], 32), math.pi * 0.1**2 * 0.3 / 3.0),
    ],
    ids=["box", "cylinder", "ball", "cone"],
)
def test_shapes_enclose_their_volume_with_outward_normals(shape: shapes.Shape, volume: float) -> None:
    # Facets lie inside the curved surface: at 32 facets a turn a ball loses 2 % of its volume.
    assert volume * 0.97 < enclosed_volume(shape) < volume * 1.001
    corners = shape.vertices[shape.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    whole = np.linalg.norm(flat, axis=1) > 1e-12
    assert (np.einsum("ij,ikj->ik", flat, shape.normals[shape.faces])[whole] > 0.0).all()


def test_creased_mesh_keeps_the_edges_of_a_corner_and_smooths_a_ball() -> None:
    wedge = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    corner = shapes.compute_normals(wedge, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2]]))
    assert {tuple(normal) for normal in corner.normals} == {(0, 0, -1), (0, -1, 0), (-1, 0, 0)}
    ball = shapes.ball(1.0)
    smooth = shapes.compute_normals(ball.vertices, ball.faces)
    outward = np.einsum("ij,ij->i", smooth.normals, smooth.vertices)
    assert outward.min() > math.cos(math.radians(3.0))


# ---------------------------------------------------------------------------------- figure


@pytest.mark.parametrize("height", [1.55, 1.75, 1.88])
def test_visuals_follow_the_fitted_segments(both_legs: dict[Side, LegJoints], height: float) -> None:
    model = LegModel("twin.urdf", both_legs, patient=Patient(height=height), pelvis=PelvisGuide.VERTICAL)
    visuals = load_visuals(model.model, model.urdf_path)
    # The shell ends a fixed share of the femur above the knee: 0.37 of 0.42 m in its mesh. What is lower
    # and has its colour is the hub of the motor.
    assert model.sizes is not None
    (part,) = (part for part in visuals if part.joint == "left_hip" and part.colour[0] > 0.9)
    heights = part.shape.vertices[:, 2]
    shell = heights[heights > -0.9 * model.sizes.femur].min()
    assert shell == pytest.approx(-0.37 / 0.42 * model.sizes.femur, abs=1e-6)


def test_nested_groups_compose_to_forward_kinematics(worn_twin: LegModel, rng: np.random.Generator) -> None:
    figure = ArticulatedFigure(CommandBuffer(), worn_twin.model)
    q = rng.uniform(-0.5, 1.0, worn_twin.nv)
    groups = figure.posture(q)
    data = worn_twin.model.createData()
    pin.forwardKinematics(worn_twin.model, data, q)
    for joint in ("left_ankle", "right_knee"):
        world = np.eye(4)
        path = figure.paths[joint]
        for prefix in dict.fromkeys(prefix for prefix, _ in groups):
            if path == prefix or path.startswith(f"{prefix}/"):
                position, (x, y, z, w) = groups[prefix, "position"], groups[prefix, "quaternion"]
                local = np.eye(4)
                local[:3, :3] = pin.Quaternion(w, x, y, z).matrix()
                local[:3, 3] = position
                world = world @ local
        np.testing.assert_allclose(world, data.oMi[worn_twin.model.getJointId(joint)].homogeneous, atol=1e-12)


def test_only_changed_objects_are_sent(worn_twin: LegModel) -> None:
    window = CommandBuffer()
    scene = build_scene(window, worn_twin)
    q = np.zeros(worn_twin.nv)
    window.apply(scene.figure.posture(q))
    window.changes()
    q[worn_twin.index(Side.LEFT, JointName.KNEE)] = 0.3
    window.apply(scene.figure.posture(q))
    sent = [key for key, _ in window.changes()]
    assert sent == [("set_property", scene.figure.paths["left_knee"], "quaternion")]


def test_a_leg_without_visuals_is_drawn_as_sticks_with_its_vertical_up(tmp_path: Path) -> None:
    legs = {Side.RIGHT: LegJoints(hip="h", knee="k")}
    model = LegModel(bare_urdf(tmp_path), legs, up_axis="y")
    recorder = CommandBuffer()
    scene = build_scene(recorder, model)
    assert {path.rsplit("/", 1)[-1] for path in drawn_paths(recorder)} >= {"sticks", "motor_cap"}
    # Hip flexed by 90 degrees: the thigh, 0.4 m long, points forward.
    scene.figure.move(np.array([math.pi / 2.0, 0.0]))
    knee = scene.figure.world_point("k")
    np.testing.assert_allclose(knee, [0.4, 0.0, 0.0], atol=1e-12)
    scene.figure.move(np.zeros(2))
    hanging = scene.figure.world_point("k")
    np.testing.assert_allclose(hanging, [0.0, 0.0, -0.4], atol=1e-12)


def test_spheres_meshes_and_missing_meshes_of_a_urdf(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "corner.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    visual = "".join(
        f"<visual><geometry>{geometry}</geometry></visual>"
        for geometry in (
            '<mesh filename="package://leg/meshes/corner.obj" scale="0.1 0.2 0.3"/>',
            '<mesh filename="meshes/absent.stl"/>',
            '<sphere radius="0.05"/>',
        )
    )
    urdf = bare_urdf(tmp_path, visual)
    model = LegModel(urdf, {Side.LEFT: LegJoints(hip="h", knee="k")}, up_axis="y")
    with warns(UserWarning, "meshes/absent.stl"):
        (part,) = load_visuals(model.model, urdf)
    assert part.joint == "h"
    np.testing.assert_allclose(part.shape.vertices.max(axis=0), [0.1, 0.2, 0.3])  # the mesh's corners
    np.testing.assert_allclose(part.shape.vertices.min(axis=0), [-0.05, -0.05, -0.05], atol=1e-9)  # sphere


# A red and a blue triangle beside a flat one, which readers leave out, on a moved node; one with a texture.
COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset>
<library_effects>{effects}</library_effects><library_materials>{materials}</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="15">0 0 0 1 0 0 0 1 0 0 0 1 2 2 2</float_array><technique_common>
<accessor source="#f" count="5" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>{parts}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n"><translate>0 0 5</translate>
<instance_geometry url="#g">
<bind_material><technique_common>{bindings}</technique_common></bind_material></instance_geometry></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
LOOKS = {
    "red": "<color>1 0 0 1</color>",
    "blue": "<color>0 0 0.5 1</color>",
    "wood": '<texture texture="t" texcoord="u"/>',
}
CORNERS = {"red": "0 1 2 0 0 1", "blue": "0 2 3 4 3 1", "wood": "0 1 4"}


def collada() -> str:
    def joined(text: str) -> str:
        return "".join(
            text.format(name=name, look=look, corners=CORNERS[name], count=len(CORNERS[name].split()) // 3)
            for name, look in LOOKS.items()
        )

    return COLLADA.format(
        effects=joined('<effect id="{name}-e"><profile_COMMON><technique sid="c"><lambert><diffuse>{look}'
                       "</diffuse></lambert></technique></profile_COMMON></effect>"),
        materials=joined('<material id="{name}-m"><instance_effect url="#{name}-e"/></material>'),
        parts=joined('<triangles material="{name}" count="{count}"><input semantic="VERTEX" source="#v" '
                     'offset="0"/><p>{corners}</p></triangles>'),
        bindings=joined('<instance_material symbol="{name}" target="#{name}-m"/>'),
    )  # fmt: skip


def test_a_visual_that_cannot_be_read_is_left_out_with_one_warning_and_the_others_are_drawn(
    tmp_path: Path,
) -> None:
    (tmp_path / "pointer.stl").write_text("version https://git-lfs.github.com/spec/v1\nsize 12345\n")
    (tmp_path / "broken.stl").write_text("solid nothing")
    shapes_of_file = (
        '<capsule length="0.3" radius="0.05"/>',
        '<mesh filename="pointer.stl"/>',
        '<mesh filename="broken.stl"/>',
        '<box size="0.1 x 0.1"/>',
        '<sphere radius="0.05"/>',
    )
    visual = "".join(f"<visual><geometry>{one}</geometry></visual>" for one in shapes_of_file)
    urdf = bare_urdf(tmp_path, visual)
    with pytest.warns(UrdfWarning) as issued:
        (part,) = load_visuals(build_model(urdf), urdf)
    np.testing.assert_allclose(np.ptp(part.shape.vertices, axis=0), 0.1, atol=1e-9)  # the sphere
    messages = "\n".join(str(item.message) for item in issued)
    assert len(issued) == 4
    for explained in (
        "a visual <capsule> cannot be read",
        "mesh pointer.stl is a Git LFS pointer (get the file with: git lfs",
        "broken.stl cannot be read (", "a visual <box> cannot be read (Unable to parse component [x]",
    ):  # fmt: skip
        assert explained in messages


def test_a_mesh_is_scaled_by_the_unit_of_its_collada_file(tmp_path: Path) -> None:
    text = collada().replace("<asset>", '<asset><unit name="centimeter" meter="0.01"/>')
    (tmp_path / "corner.dae").write_text(text)
    visual = '<visual><geometry><mesh filename="corner.dae" scale="1 2 1"/></geometry></visual>'
    urdf = bare_urdf(tmp_path, visual)
    parts = load_visuals(build_model(urdf), urdf)
    corners = np.concatenate([part.shape.vertices for part in parts])
    # Flat triangles with corners at 0 and 1 cm, doubled sideways, on a node 5 cm above the origin.
    np.testing.assert_allclose(corners.min(axis=0), [0.0, 0.0, 0.05], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), [0.01, 0.02, 0.05], atol=1e-9)


def test_the_first_of_two_materials_of_a_name_is_used(tmp_path: Path) -> None:
    grey = '<material name="grey"><color rgba="{0} {0} {0} 1"/></material>'
    visual = '<visual><geometry><sphere radius="0.05"/></geometry><material name="grey"/></visual>'
    urdf = bare_urdf(tmp_path, visual)
    first, second = grey.format(0.5), grey.format(0.6)
    urdf.write_text(re.sub(r"(<robot[^>]*>)", rf"\1{first}{second}", urdf.read_text(), count=1))
    (part,) = load_visuals(build_model(urdf), urdf)
    assert part.colour == (0.5, 0.5, 0.5, 1.0)


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        ("", {(1, 0, 0): 1, (0, 0, 0.5): 2, (0.9, 0.9, 0.9): 1}),  # as the mesh has them
        ('<material name="own"><color rgba="0 1 0 1"/></material>', {(0, 1, 0): 4}),
        ('<material name="lent"/>', {(0, 0.2, 0): 4}),  # stated once, for the whole robot
        ('<material name="bark"><texture filename="bark.png"/></material>',
         {(1, 0, 0): 1, (0, 0, 0.5): 2, (0.9, 0.9, 0.9): 1}),
    ],
)  # fmt: skip
def test_a_mesh_has_the_colours_of_the_urdf_or_its_own(material: str, expected: dict, tmp_path: Path) -> None:
    (tmp_path / "piece.dae").write_text(collada())
    visual = f'<visual><geometry><mesh filename="piece.dae"/></geometry>{material}</visual>'
    urdf = tmp_path / "piece.urdf"
    lent = '<material name="lent"><color rgba="0 0.2 0 1"/></material>'
    urdf.write_text(f'<robot name="piece">{lent}<link name="a">{visual}</link></robot>')
    parts = load_visuals(build_model(urdf), urdf)
    assert {part.colour[:3]: len(part.shape.faces) for part in parts} == expected
    for part in parts:
        if part.colour[:3] == (1, 0, 0):  # the right triangle has it
            np.testing.assert_allclose(part.shape.vertices.max(axis=0), [1.0, 1.0, 5.0])
            np.testing.assert_allclose(part.shape.vertices.min(axis=0), [0.0, 0.0, 5.0])


def test_the_colours_of_a_mesh_are_on_the_faces_of_its_file() -> None:
    urdf = robot_urdf("ur_description/urdf/ur5_robot.urdf")
    parts = load_visuals(build_model(urdf), urdf)
    blue = [part for part in parts if part.colour[2] > part.colour[0] + 0.1]
    assert {part.joint for part in blue} >= {"shoulder_pan_joint", "elbow_joint", "wrist_1_joint"}
    assert len({part.colour for part in parts}) >= 3
    # Only the lids of its joints are blue.
    assert sum(map(surface_of, blue)) < 0.4 * sum(map(surface_of, parts))


def surface_of(part: LinkPart) -> float:
    a, b, c = (part.shape.vertices[part.shape.faces[:, corner]] for corner in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("name", ["twin.urdf", "twin_leg.urdf"])
def test_any_urdf_can_be_drawn_and_framed(name: str) -> None:
    recorder = CommandBuffer()
    scene = build_urdf_scene(recorder, build_model(find_urdf(name)), find_urdf(name))
    assert len(drawn_paths(recorder)) > 5
    assert scene.view.height > 0.8  # the femur and tibia of the device are 0.85 m


# ---------------------------------------------------------------------------------- motion


def test_motion_takes_frames_from_the_log_and_keeps_every_switch(worn_twin: LegModel) -> None:
    log = synthetic_log(worn_twin, 1.0)
    motion = read_motion(log, worn_twin, frames_per_second=30.0)
    rows = np.round(1000.0 * motion.times).astype(int)
    knee = log["left_knee_angle_rad"].to_numpy()[rows]
    np.testing.assert_array_equal(motion.q[:, worn_twin.index(Side.LEFT, JointName.KNEE)], knee)
    assert np.diff(motion.times).max() <= 1.0 / 30.0 + 1e-3
    spells = motion.legs[Side.LEFT].phases
    assert spells is not None
    codes = log["left_phase"].cat.codes.to_numpy()
    np.testing.assert_array_equal([spells.code_at(t) for t in log["time_s"]], codes)


def test_rows_after_a_divergence_are_left_out(worn_twin: LegModel) -> None:
    log = synthetic_log(worn_twin, 0.2)
    log.loc[100:, "left_hip_angle_rad"] = np.nan
    assert read_motion(log, worn_twin).times[-1] == pytest.approx(0.099)
    log["left_hip_angle_rad"] = np.inf
    with raises(ViewerError, "log"):
        read_motion(log, worn_twin)


def test_a_log_of_another_model_is_refused(worn_twin: LegModel) -> None:
    log = synthetic_log(worn_twin, 0.1)
    with raises(ViewerError, "right_knee_angle_rad"):
        read_motion(log.drop(columns="right_knee_angle_rad"), worn_twin)


@pytest.mark.parametrize(("share", "frame"), [(0.0, "left_heel"), (1.0, "left_toe")])
def test_ground_force_acts_where_the_foot_presses(worn_twin: LegModel, share: float, frame: str) -> None:
    log = synthetic_log(worn_twin, 0.05).assign(left_foot_cop_ratio=share)
    motion, scene = read_motion(log, worn_twin), build_scene(CommandBuffer(), worn_twin)
    expected = worn_twin.frame_position(motion.q[0], frame)
    point = scene.state_at(motion, 0)[scene.arrows[Side.LEFT], "position"]
    np.testing.assert_allclose(point, [expected[0], expected[1], 0.0], atol=1e-12)


def test_on_a_slope_force_and_belt_are_drawn_in_its_axes(worn_twin: LegModel) -> None:
    """Both have the axes of the slope, and the force acts between heel and toe on the belt."""
    slope, recorder = 0.1, CommandBuffer()
    scene = build_scene(recorder, worn_twin, slope=slope)
    moves = {item["path"]: item["matrix"] for item in recorder.commands() if item["type"] == "set_transform"}
    for path in (environment.TREADMILL, FORCE_ROOT):
        pose = np.reshape(moves[path], (4, 4)).T  # column by column
        np.testing.assert_allclose(pose @ [1, 0, 0, 1], [np.cos(slope), 0, np.sin(slope), 1], atol=1e-12)
        np.testing.assert_allclose(pose @ [0, 0, 1, 1], [-np.sin(slope), 0, np.cos(slope), 1], atol=1e-12)
    log = synthetic_log(worn_twin, 0.02)
    log["left_hip_angle_rad"] = 0.5
    motion, frames = read_motion(log, worn_twin), worn_twin.legs[Side.LEFT].contact_frames
    ends = [worn_twin.frame_position(motion.q[0], frame) for frame in frames]
    along = [end[0] * np.cos(slope) + end[2] * np.sin(slope) for end in ends]
    x, _, z = scene.state_at(motion, 0)[scene.arrows[Side.LEFT], "position"]
    assert min(along) - 1e-12 <= x <= max(along) + 1e-12
    assert z == 0.0


def test_arrow_is_as_long_and_as_tilted_as_the_force(worn_twin: LegModel) -> None:
    scene = build_scene(CommandBuffer(), worn_twin)
    force = np.array([120.0, 350.0])
    state = {name: value for (_, name), value in
             arrow_state(scene.arrows[Side.LEFT], force, np.array([0.1, 0.2, 0.0])).items()}  # fmt: skip
    x, y, z, w = state["quaternion"]
    tip = pin.Quaternion(w, x, y, z).matrix() @ np.array([0.0, 0.0, state["scale"][2]])
    np.testing.assert_allclose(tip, METRES_PER_NEWTON * np.array([120.0, 0.0, 350.0]), atol=1e-12)
    assert state["visible"] is True
    lifted = arrow_state(scene.arrows[Side.LEFT], np.array([0.0, 5.0]), np.zeros(3))
    assert lifted[scene.arrows[Side.LEFT], "visible"] is False


def test_belt_marks_run_backwards_with_the_belt() -> None:
    track = _belt_track(np.full(2001, BELT_SPEED))
    at = np.linspace(0.0, 2.0, 400)
    offset = np.interp(at, track.times, track.values[:, 0])
    speed = np.diff(offset) / np.diff(at)
    # All but the few intervals that hold a jump move at the speed of the belt.
    assert np.median(np.abs(speed + BELT_SPEED)) < 1e-3
    assert np.mean(np.abs(speed + BELT_SPEED) < 0.01) > 0.95
    assert -environment.BELT_MARK_SPACING - 1e-9 <= offset.min() and offset.max() <= 1e-9


# ---------------------------------------------------------------------------------- page


class PageReader(HTMLParser):
    """Collects the addresses, the title and the scripts of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.policy = ""
        self.tags: list[str] = []
        self.title = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        named = dict(attrs)
        self.addresses += [named[key] or "" for key in ("src", "href", "action", "data") if key in named]
        if named.get("http-equiv") == "Content-Security-Policy":
            self.policy = named["content"] or ""

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] == "title" and not self.title:
            self.title = data


def read_page(path: Path) -> PageReader:
    reader = PageReader()
    reader.feed(path.read_text(encoding="utf-8"))
    return reader


def test_page_is_self_contained_and_must_not_load_anything(worn_twin: LegModel, tmp_path: Path) -> None:
    path = write_walk(tmp_path / "walk.html", worn_twin)
    page = read_page(path)
    assert [address for address in page.addresses if not address.startswith("data:")] == []
    assert "default-src 'none'" in page.policy
    assert "connect-src" not in page.policy and "http" not in page.policy
    written_by_us = (Path(twin_gait.viewer.__file__).parent / "page").glob("*")
    for source in written_by_us:
        assert not re.search(r"https?://|@import|\bimport\(", source.read_text(encoding="utf-8")), source


def test_page_of_twenty_seconds_stays_below_two_megabytes(worn_twin: LegModel, tmp_path: Path) -> None:
    path = write_walk(tmp_path / "walk.html", worn_twin, duration=20.0)
    assert path.stat().st_size < 2_000_000


def test_same_log_gives_the_same_bytes(worn_twin: LegModel, tmp_path: Path) -> None:
    first = write_walk(tmp_path / "a.html", worn_twin, duration=0.2)
    second = write_walk(tmp_path / "b.html", worn_twin, duration=0.2)
    assert first.read_bytes() == second.read_bytes()


def test_animation_comes_after_the_objects_it_moves(worn_twin: LegModel) -> None:
    recorder = CommandBuffer()
    recorder.send({"type": "set_animation", "path": "", "animations": [], "options": {}})
    build_scene(recorder, worn_twin, patient=PATIENT)
    kinds = [command["type"] for command in recorder.commands()]
    assert kinds[-1] == "set_animation"
    assert kinds.index("set_property") > max(i for i, kind in enumerate(kinds) if kind == "set_object")


HOSTILE = "</script><script>window.harm = 1</script><img src=x onerror='window.harm = 1'> & {{data}} \udcff"


def test_hostile_title_is_escaped(worn_twin: LegModel, tmp_path: Path) -> None:
    harmless = read_page(write_walk(tmp_path / "a.html", worn_twin, duration=0.1))
    written = write_walk(tmp_path / "b.html", worn_twin, duration=0.1, title=HOSTILE, subtitle=[HOSTILE])
    page = read_page(written)
    assert page.tags == harmless.tags
    assert page.title == HOSTILE.replace("\udcff", "\ufffd")


# Read in the browser at several instants: matrix of every joint group, colours, arrows, belt, texts;
# and once, all errors.
PROBE = """<script>
const trouble = [];
window.addEventListener("error", (event) => trouble.push(String(event.message)));
window.addEventListener("unhandledrejection", (event) => trouble.push(String(event.reason)));
for (const kind of ["error", "warn"]) console[kind] = (...words) => trouble.push(words.join(" "));
</script>"""
REPORT = """<script>
window.ready.then(() => {
  const requested = REQUESTED;
  const tree = (path) => twinGait.stage.viewer.scene_tree.find(path.split("/").filter((part) => part)).object;
  const look = () => {
    twinGait.stage.viewer.scene.updateMatrixWorld(true);
    const base = tree("/meshcat").matrixWorld.clone().invert();
    return {
      matrices: requested.joints.map((path) => base.clone().multiply(tree(path).matrixWorld).toArray()),
      colours: requested.covers.map((path) => tree(path + "/<object>").material.color.toArray()),
      arrows: requested.arrows.map((path) => [tree(path).visible, tree(path).scale.z]),
      belt: tree(requested.belt).position.x,
      read: document.querySelector(".read").innerText,
      clock: document.querySelector(".clock").textContent,
    };
  };
  const answer = {
    moments: [look(), ...requested.moments.map((time) => { player.show(time); return look(); })],
    title: document.querySelector(".title").textContent, harm: window.harm ?? null, trouble,
    fetched: performance.getEntriesByType("resource").map((entry) => entry.name) };
  const out = document.createElement("pre");
  out.id = "answer";
  out.textContent = btoa(unescape(encodeURIComponent(JSON.stringify(answer))));
  document.body.append(out);
});
</script>"""


def read_in_browser(page: Path, fragment: str, arguments: dict) -> dict:
    """Open a page from disk in headless Chromium and return what the probe finds."""
    text = page.read_text(encoding="utf-8").replace("<body>", f"<body>{PROBE}", 1)
    at = text.rindex("</body>")
    probed = page.with_name("probed.html")
    probed.write_text(
        text[:at] + REPORT.replace("REQUESTED", json.dumps(arguments)) + text[at:], encoding="utf-8"
    )
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        flags = ["--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking",
                 "--disable-component-update", "--disable-sync", f"--user-data-dir={profile}",
                 "--window-size=400,300", "--virtual-time-budget=10000", "--dump-dom"]  # fmt: skip
        done = subprocess.run(
            [str(CHROMIUM), *SOFTWARE_GL, *flags, f"{probed.as_uri()}{fragment}"],
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
    found = re.search(r'<pre id="answer">([^<]*)</pre>', done.stdout)
    assert found, done.stdout[-2000:]
    return dict(json.loads(base64.b64decode(found[1]).decode("utf-8")))


@needs_chromium
def test_browser_shows_the_positions_that_pinocchio_computes(worn_twin: LegModel, tmp_path: Path) -> None:
    page = write_walk(tmp_path / "walk.html", worn_twin, duration=0.5, title=HOSTILE)
    scene = build_scene(CommandBuffer(), worn_twin, patient=PATIENT)
    log = synthetic_log(worn_twin, 0.5)
    motion = read_motion(log, worn_twin)
    # The first frame after both arrows switched, and one after two phases have ended.
    frames = [int(np.argmin(np.abs(motion.times - moment))) for moment in (0.367, 0.034)]
    times = [float(motion.times[frame]) for frame in frames]
    joints = [name for name in scene.figure.paths if name != "universe"]
    arguments = {
        "joints": [scene.figure.paths[name] for name in joints],
        "covers": [scene.caps[side][0] for side in worn_twin.sides],
        "arrows": [scene.arrows[side] for side in worn_twin.sides],
        "belt": environment.BELT,
        "moments": times[1:],
    }
    answer = read_in_browser(page, f"#t={times[0]:.3f}", arguments)
    assert answer["trouble"] == []
    assert answer["fetched"] == []
    assert answer["harm"] is None
    assert answer["title"] == HOSTILE.replace("\udcff", "\ufffd")
    for frame, moment, shown in zip(frames, times, answer["moments"], strict=True):
        row = log.iloc[round(1000.0 * moment)]
        check_posture(worn_twin, motion.q[frame], joints, shown["matrices"])
        check_forces_and_colours(worn_twin, row, shown)
        travelled = shown["belt"] + BELT_SPEED * moment
        gap = travelled / environment.BELT_MARK_SPACING
        assert abs(gap - round(gap)) < 1e-2  # the marks are where the belt has carried them
        assert f"{math.degrees(row['right_knee_angle_rad']):.1f}°" in shown["read"]
        assert shown["clock"].startswith(f"{moment:.3f} s")


def check_posture(model: LegModel, q: np.ndarray, joints: list[str], matrices: list[list[float]]) -> None:
    data = model.model.createData()
    pin.forwardKinematics(model.model, data, q)
    for name, matrix in zip(joints, matrices, strict=True):
        expected = data.oMi[model.model.getJointId(name)].homogeneous
        np.testing.assert_allclose(np.array(matrix).reshape(4, 4).T, expected, atol=1e-4, err_msg=name)


def check_forces_and_colours(model: LegModel, row: pd.Series, shown: dict) -> None:
    switches = set()
    for side, colour, (visible, length) in zip(model.sides, shown["colours"], shown["arrows"], strict=True):
        expected = PHASE_COLOURS[GaitPhase(row[f"{side}_phase"])]
        channels = [int(expected[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        np.testing.assert_allclose(colour, channels, atol=1e-4)  # colours have four decimals
        force = math.hypot(row[f"{side}_foot_friction_force_N"], row[f"{side}_foot_normal_force_N"])
        assert visible == (row[f"{side}_foot_normal_force_N"] > CONTACT_FORCE)
        if visible:
            assert length == pytest.approx(METRES_PER_NEWTON * force, abs=1e-5)
        switches.add(visible)
    assert switches == {True, False}


# ---------------------------------------------------------------------------------- server


OPEN_PORTS = """
import os, sys
from pathlib import Path
for name in ("zmq", "IPython", "pyngrok"):
    sys.modules[name] = None  # importing it is an error
import asyncio
from twin_gait.viewer.server import SceneServer
from twin_gait.viewer.animation import urdf_page

async def main():
    server = SceneServer(urdf_page("twin.urdf"), first_port=0)
    own = {os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()}
    rows = [line.split() for table in ("tcp", "tcp6") for line in Path(f"/proc/net/{table}").open()]
    open_ports = [row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own]
    print(server.url.partition("?")[0].strip("/").rpartition(":")[2], *open_ports)
    await server.close()

asyncio.run(main())
assert "meshcat" not in sys.modules
"""


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs /proc of Linux")
def test_the_viewer_has_one_port_and_needs_neither_zmq_nor_a_tunnel() -> None:
    """Meshcat's own server has a port for commands that takes them from every user of the machine."""
    done = subprocess.run([sys.executable, "-c", OPEN_PORTS], capture_output=True, text=True, check=True)
    port, *listening = done.stdout.split()
    assert listening == [f"0100007F:{int(port):04X}"]  # 127.0.0.1, lowest byte first


# ---------------------------------------------------------------------------------- package


def test_a_finished_page_needs_neither_pinocchio_nor_meshcat() -> None:
    code = "import sys, twin_gait.viewer.page; sys.exit(bool({'pinocchio', 'meshcat'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
