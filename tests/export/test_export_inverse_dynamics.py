"""Tests of the export to OpenSim: two other programs compute the torques of the log from its files."""

from __future__ import annotations

import importlib.util
import json
import math
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from errors import raises, states
from scipy.spatial.transform import Rotation

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.conventions import OPENSIM_GAIT2392, RAJAGOPAL
from twin_gait.exceptions import ParameterError
from twin_gait.export.inverse_dynamics import export_inverse_dynamics
from twin_gait.gait.table import TICK
from twin_gait.runs.log_files import read_log_table
from twin_gait.runs.record import read_stored_run
from twin_gait.vocabulary import JointName, Side

SECONDS = 4.0
# The splines and differences of the reference implementations know nothing of what was before the first row.
INSIDE = slice(20, -20)
MOMENT_TOLERANCE = 0.5  # [N·m], root mean square; issue
FORCE_TOLERANCE = 1.0  # [N], root mean square, of some 1000 N of weight


class Folder:
    """Exported files, read without the code that wrote them."""

    def __init__(self, folder, run):
        self.path, self.run = folder, run
        self.motion, self.moments = self.table("motion.mot"), self.table("joint_moments.sto")
        self.model, self.bodies = read_model(folder / "model.osim")

    def table(self, name):
        stored = read_log_table(self.path / name)
        return pd.DataFrame({column: stored.numbers(column) for column in stored.names})

    def states(self):
        """Return coordinates, velocities and accelerations of the model from the files, by differences."""
        q = np.zeros((len(self.motion), self.model.nq))
        for index in range(1, self.model.njoints):
            name = self.model.names[index]
            values = self.motion[name].to_numpy()
            q[:, index - 1] = values if name in ("pelvis_tx", "pelvis_ty") else np.radians(values)
        v = np.gradient(q, TICK, axis=0)
        a = np.zeros_like(q)
        a[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) / TICK**2
        return q, v, a

    def loads(self):
        """Force, point and torque of every external load by the body that it acts on."""
        data, found = self.table("external_loads.mot"), []
        for force in ElementTree.parse(self.path / "external_loads.xml").iter("ExternalForce"):
            read = {item.tag: item.text for item in force}
            assert read["force_expressed_in_body"] == read["point_expressed_in_body"] == "ground"
            columns = [
                data[[f"{read[f'{kind}_identifier']}{axis}" for axis in "xyz"]].to_numpy()
                for kind in ("force", "point", "torque")
            ]
            found.append((read["applied_to_body"], *columns))
        return found


def placement(frame):
    numbers = [[float(x) for x in frame.find(key).text.split()] for key in ("translation", "orientation")]
    return pin.SE3(Rotation.from_euler("XYZ", numbers[1]).as_matrix(), np.array(numbers[0]))


def read_model(path):
    """Return bodies and joints of an .osim file as a Pinocchio model, joints named after coordinates."""
    root = ElementTree.parse(path).getroot()
    model, carriers = pin.Model(), {"/ground": (0, pin.SE3.Identity())}
    model.gravity.linear = np.array([float(x) for x in root.find("Model/gravity").text.split()])
    masses = {body.get("name"): body for body in root.iter("Body")}
    for joint in root.find("Model/JointSet/objects"):
        frames = {item.get("name"): item for item in joint.iter("PhysicalOffsetFrame")}
        parent, child = (frames[joint.find(f"socket_{kind}_frame").text] for kind in ("parent", "child"))
        index, carrier = carriers[parent.find("socket_parent").text]
        placed = carrier * placement(parent)
        names = [item.get("name") for item in joint.iter("Coordinate")]
        moves = {name: pin.JointModelRZ() for name in names}
        if (
            joint.tag == "PlanarJoint"
        ):  # its coordinates in this order; the sliding ones come first in the chain
            tilt, forward, up = names
            moves = {forward: pin.JointModelPX(), up: pin.JointModelPY(), tilt: pin.JointModelRZ()}
        for name, move in moves.items():
            index = model.addJoint(index, move, placed, name)
            placed = pin.SE3.Identity()
        body_path = child.find("socket_parent").text
        carrier = placement(child).inverse()
        carriers[body_path] = index, carrier
        body = masses[body_path.removeprefix("/bodyset/")]
        mass, centre, moments = (
            np.array(body.find(key).text.split(), float) for key in ("mass", "mass_center", "inertia")
        )
        xx, yy, zz, xy, xz, yz = moments
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(index, pin.Inertia(float(mass[0]), centre, inertia), carrier)
    return model, {path.removeprefix("/bodyset/"): index for path, (index, _) in carriers.items()}


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    return exported_walk(tmp_path_factory, 0.0)


@pytest.fixture(scope="module")
def downhill(tmp_path_factory):
    return exported_walk(tmp_path_factory, -4.0)


@pytest.fixture(scope="module")
def powered_ankle(tmp_path_factory):
    """Return a walk whose ankle has a motor and an orthosis that is not slack."""
    return exported_walk(tmp_path_factory, 0.0, "treadmill_ankle", ["plant.ankle.stiffness_Nm_per_rad=20"])


def exported_walk(tmp_path_factory, slope, preset="treadmill_guided", more=()):
    folder = tmp_path_factory.mktemp("opensim")
    settings = [f"duration_s={SECONDS}", f"scenario.slope_deg={slope}"]
    run = simulate(load_experiment(preset, [*settings, *more]).experiment)
    assert run.trip is None
    export_inverse_dynamics(run, folder, OPENSIM_GAIT2392)
    return Folder(folder, run)


def rms(values):
    return float(np.sqrt(np.mean(np.square(np.asarray(values)[INSIDE]))))


def inverse_dynamics(folder):
    """Generalised forces at every coordinate from the files alone, shape (n, nv)."""
    model, data = folder.model, folder.model.createData()
    q, v, a = folder.states()
    loads, found = folder.loads(), np.zeros_like(q)
    for row in range(len(q)):
        pin.forwardKinematics(model, data, q[row])
        forces = pin.StdVec_Force()
        for _ in range(model.njoints):
            forces.append(pin.Force.Zero())
        for body, force, point, torque in loads:
            index = folder.bodies[body]
            wrench = pin.Force(force[row], torque[row] + np.cross(point[row], force[row]))
            forces[index] = forces[index] + data.oMi[index].actInv(wrench)
        found[row] = pin.rnea(model, data, q[row], v[row], a[row], forces)
    return pd.DataFrame(found, columns=list(model.names)[1:])


def torque_behind_gear(run, side, joint):
    """Return the joint torque of motor, friction, stop and wearer without the torque of the rotor."""
    name, log = f"{side}_{joint}", run.log
    motor = log[f"{name}_motor_torque_Nm"].rolling(2, min_periods=1).mean()  # held from tick to tick
    others = log[[f"{name}_{part}_torque_Nm" for part in ("friction", "stop", "external")]].sum(axis=1)
    rotor = run.experiment.plant.actuators[joint].armature
    return (motor + others).to_numpy() - rotor * np.gradient(log[f"{name}_velocity_rad_per_s"], TICK)


def test_inverse_dynamics_finds_the_muscles_of_joints_without_a_motor(tmp_path_factory):
    one_knee = exported_walk(tmp_path_factory, 0.0, "knee_orthosis")
    found, log = inverse_dynamics(one_knee), one_knee.run.log
    for side, joint in (
        (Side.LEFT, JointName.HIP),
        (Side.RIGHT, JointName.HIP),
        (Side.RIGHT, JointName.KNEE),
    ):
        coordinate = OPENSIM_GAIT2392.columns[side, joint]
        name, sign = f"{side}_{joint}", OPENSIM_GAIT2392.signs.get(joint, 1.0)
        expected = sign * sum(
            log[f"{name}_{part}_torque_Nm"].to_numpy() for part in ("own", "passive", "stop")
        )
        assert rms(expected) > 5.0
        assert rms(found[coordinate] - expected) < MOMENT_TOLERANCE
        assert rms(one_knee.moments[f"{coordinate}_moment"] - expected) < 1e-9


@pytest.mark.parametrize("way", ["walk", pytest.param("downhill", marks=pytest.mark.slow)])
def test_inverse_dynamics_of_the_files_finds_the_torques_of_the_log(way, request):
    walk = request.getfixturevalue(way)
    found = inverse_dynamics(walk)
    for side in Side:
        for joint in (JointName.HIP, JointName.KNEE):
            coordinate = OPENSIM_GAIT2392.columns[side, joint]
            expected = OPENSIM_GAIT2392.signs.get(joint, 1.0) * torque_behind_gear(walk.run, side, joint)
            assert rms(found[coordinate] - expected) < MOMENT_TOLERANCE < 0.1 * rms(expected)
            assert rms(walk.moments[f"{coordinate}_moment"] - expected) < 1e-9
        ankle = f"ankle_angle_{side[0]}"
        orthosis = walk.run.log[f"{side}_ankle_orthosis_torque_Nm"]
        assert rms(found[ankle] - walk.moments[f"{ankle}_moment"]) < MOMENT_TOLERANCE
        assert rms(walk.moments[f"{ankle}_moment"] - orthosis) < 1e-9  # no stop is touched
    for coordinate, tolerance in (
        ("pelvis_tx", FORCE_TOLERANCE),
        ("pelvis_ty", FORCE_TOLERANCE),
        ("pelvis_tilt", MOMENT_TOLERANCE),
    ):
        assert rms(found[coordinate]) < tolerance


def test_inverse_dynamics_finds_motor_and_orthosis_of_a_powered_ankle(powered_ankle):
    found, log = inverse_dynamics(powered_ankle), powered_ankle.run.log
    for side in Side:
        coordinate, orthosis = f"ankle_angle_{side[0]}", log[f"{side}_ankle_orthosis_torque_Nm"]
        expected = torque_behind_gear(powered_ankle.run, side, JointName.ANKLE) + orthosis
        assert rms(orthosis) > 1.0 < rms(expected - orthosis)
        assert rms(found[coordinate] - expected) < MOMENT_TOLERANCE
        assert rms(powered_ankle.moments[f"{coordinate}_moment"] - expected) < 1e-9


@pytest.mark.parametrize("way", ["walk", pytest.param("downhill", marks=pytest.mark.slow)])
def test_loads_and_weight_move_the_centre_of_mass(way, request):
    """Newton's second law for the whole body: nothing acts that is not in the files."""
    walk = request.getfixturevalue(way)
    model, data = walk.model, walk.model.createData()
    q, _, _ = walk.states()
    centre = np.array([pin.centerOfMass(model, data, row).copy() for row in q])
    mass = pin.computeTotalMass(model)
    assert mass == pytest.approx(walk.run.experiment.build_world().model.total_mass)
    acceleration = np.zeros_like(centre)
    acceleration[1:-1] = (centre[2:] - 2.0 * centre[1:-1] + centre[:-2]) / TICK**2
    outside = sum(force for _, force, _, _ in walk.loads()) + mass * model.gravity.linear
    left_over = outside - mass * acceleration
    assert rms(mass * acceleration[:, 1]) > 20.0 * FORCE_TOLERANCE  # there is something to balance
    for axis in (0, 1):
        assert rms(left_over[:, axis]) < FORCE_TOLERANCE
    assert np.abs(outside[:, 2]).max() == 0.0


def test_the_ground_carries_each_foot_within_its_sole(walk):
    log, data = walk.run.log, walk.table("external_loads.mot")
    world = walk.run.experiment.build_world()
    model, friction = world.model, world.contact.friction_coefficient
    for side in Side:
        name = f"ground_{side[0]}"
        assert np.abs(data[f"{name}_vy"] - log[f"{side}_foot_normal_force_N"]).max() < 1e-6
        assert np.abs(data[f"{name}_vx"] - log[f"{side}_foot_friction_force_N"]).max() < 1e-6
        loaded = np.flatnonzero(log[f"{side}_foot_normal_force_N"] > 20.0)[::50]
        for row in loaded:
            q = np.zeros(model.nv)
            for joint in JointName:
                q[model.index(side, joint)] = log[f"{side}_{joint}_angle_rad"].iloc[row]
            q[model.pelvis_index] = log["pelvis_height_m"].iloc[row]
            q[model.forward_index] = log["pelvis_forward_m"].iloc[row]
            heel, toe = (model.frame_position(q, frame) for frame in model.legs[side].contact_frames)
            x, z = data[f"{name}_px"].iloc[row], data[f"{name}_pz"].iloc[row]
            # Heel and toe are below the belt, where their friction turns what the belt carries.
            shift = friction * -log[f"{side}_foot_clearance_m"].iloc[row]
            assert heel[0] - shift <= x <= toe[0] + shift
            assert z == pytest.approx(-heel[1])  # z to the right, y to the left
        assert np.isfinite(data).all(axis=None)


@pytest.mark.slow
def test_on_a_slope_the_ground_acts_at_points_of_the_belt_and_by_the_columns_of_the_log(downhill):
    log, data, slope = downhill.run.log, downhill.table("external_loads.mot"), math.radians(-4.0)
    along, away = np.array([math.cos(slope), math.sin(slope)]), np.array([-math.sin(slope), math.cos(slope)])
    for side in Side:
        name = f"ground_{side[0]}"
        force, point = (data[[f"{name}_{kind}{axis}" for axis in "xy"]].to_numpy() for kind in "vp")
        assert np.abs(force @ away - log[f"{side}_foot_normal_force_N"]).max() < 1e-6
        assert np.abs(force @ along - log[f"{side}_foot_friction_force_N"]).max() < 1e-6
        assert np.abs(point @ away).max() < 1e-9
        assert np.ptp(point @ along) > 0.1


def test_the_harness_is_support_and_guide(walk):
    log, data = walk.run.log, walk.table("external_loads.mot")
    assert (data["harness_vy"] == log["support_force_N"]).all()
    assert (data["harness_vx"] == log["guide_force_N"]).all()
    assert (data["harness_torque_z"] == -log["guide_moment_Nm"]).all()
    assert (data["harness_py"] == log["pelvis_height_m"]).all()
    assert (walk.motion["pelvis_ty"] == log["pelvis_height_m"]).all()


def test_the_model_of_rajagopal_bends_its_knee_the_other_way(walk, tmp_path):
    export_inverse_dynamics(walk.run, tmp_path, RAJAGOPAL)
    other = Folder(tmp_path, walk.run)
    assert (other.moments["knee_angle_r_moment"] == -walk.moments["knee_angle_r_moment"]).all()
    found = inverse_dynamics(other)["knee_angle_r"]
    assert rms(found - other.moments["knee_angle_r_moment"]) < MOMENT_TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("device", [False, True])
def test_with_braces_the_bodies_are_the_wearers_or_the_devices(tmp_path, device):
    run = simulate(load_experiment("treadmill_guided", ["interface=brace", "duration_s=2"]).experiment)
    export_inverse_dynamics(run, tmp_path, OPENSIM_GAIT2392, device=device)
    folder = Folder(tmp_path, run)
    braces = run.experiment.build_world().braces
    chain = braces.device if device else braces.wearer
    assert pin.computeTotalMass(folder.model) == pytest.approx(chain.total_mass)
    found = inverse_dynamics(folder)
    assert rms(found["pelvis_ty"]) < FORCE_TOLERANCE
    for name in folder.moments.columns[1:]:
        assert rms(folder.moments[name] - found[name.removesuffix("_moment")]) < MOMENT_TOLERANCE, name


def test_friction_of_a_belt_stopped_by_a_trip_is_exported(tmp_path):
    fault = "faults=['encoder_freeze:left_knee@2s']"
    run = simulate(load_experiment("treadmill_guided", [fault, "duration_s=4"]).experiment)
    assert run.trip is not None and run.trip.time < 3.0
    export_inverse_dynamics(run, tmp_path, OPENSIM_GAIT2392)
    folder = Folder(tmp_path, run)
    found = inverse_dynamics(folder)
    for name in folder.moments.columns[1:]:
        assert rms(folder.moments[name] - found[name.removesuffix("_moment")]) < MOMENT_TOLERANCE, name


def test_a_bench_leg_has_no_external_loads(tmp_path):
    run = simulate(load_experiment("bench_leg", ["duration_s=1"]).experiment)
    export_inverse_dynamics(run, tmp_path, OPENSIM_GAIT2392)
    names = ["inverse_dynamics.xml", "joint_moments.sto", "model.osim", "motion.mot"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    folder = Folder(tmp_path, run)
    model, data = folder.model, folder.model.createData()
    q, v, a = folder.states()
    found = np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    for column, name in enumerate(list(model.names)[1:]):
        assert rms(found[:, column] - folder.moments[f"{name}_moment"]) < 0.1 * MOMENT_TOLERANCE


def test_a_log_of_one_row_is_refused(walk, tmp_path):
    short = replace(walk.run, log=walk.run.log.iloc[:1])
    with raises(ParameterError, "OpenSim", "1"):
        export_inverse_dynamics(short, tmp_path, OPENSIM_GAIT2392)
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------- the command, and OpenSim itself


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "walk"
    assert (
        main(["simulate", "treadmill_guided", "--duration", "3", "--out", str(folder), "--no-pictures"]) == 0
    )
    assert main(["export", str(folder), "--format", "opensim"]) == 0
    return folder


def test_the_command_makes_a_folder_and_replaces_only_its_own(exported, capsys, tmp_path):
    assert (exported / "opensim" / "model.osim").is_file()
    assert main(["export", str(exported), "--format", "opensim"]) == 2
    assert states(capsys.readouterr().err, exported / "opensim", "--out")
    assert main(["export", str(exported), "--format", "opensim", "--force"]) == 0
    assert main(["export", str(exported), "--format", "opensim", "--out", str(exported), "--force"]) == 2
    assert (exported / "summary.json").is_file()


def test_without_a_format_the_file_extension_selects_it(exported, tmp_path, capsys):
    assert main(["export", str(exported)]) == 0
    assert (exported / "log.csv").is_file()
    assert main(["export", str(exported), "--out", str(tmp_path / "walk.sto")]) == 0
    assert read_log_table(tmp_path / "walk.sto").unit == "rad"


RUN_TOOL = """
import json, sys, opensim
tool = opensim.InverseDynamicsTool("inverse_dynamics.xml")
model = opensim.Model("model.osim")
mass = model.getTotalMass(model.initSystem())
print(json.dumps({"done": tool.run(), "mass": mass}))
"""


@pytest.mark.skipif(importlib.util.find_spec("opensim") is None, reason="needs opensim: pip install opensim")
def test_opensim_finds_our_joint_moments(exported):
    folder = exported / "opensim"
    done = subprocess.run(
        [sys.executable, "-c", RUN_TOOL], cwd=folder, capture_output=True, text=True, check=True
    )
    output = json.loads(done.stdout.splitlines()[-1])
    whole = read_stored_run(exported).run.experiment.build_world().model.total_mass
    assert output["done"] and output["mass"] == pytest.approx(whole)
    tables = {}
    for name in ("inverse_dynamics.sto", "joint_moments.sto"):
        stored = read_log_table(folder / name)
        tables[name] = pd.DataFrame({column: stored.numbers(column) for column in stored.names})
    found, ours = tables["inverse_dynamics.sto"], tables["joint_moments.sto"]
    assert len(ours.columns) == 7 and len(found) == len(ours) == 3000
    for name in ours.columns[1:]:
        error = np.sqrt(np.mean(np.square(found[name] - ours[name])))
        assert error < MOMENT_TOLERANCE, name


def test_a_free_trunk_is_refused(tmp_path):
    """The OpenSim model has no arms, crutches or trunk pitch."""
    run = simulate(load_experiment("overground", ["duration_s=0.5"]).experiment)
    with raises(ParameterError, "overground", "--format mot"):
        export_inverse_dynamics(run, tmp_path, OPENSIM_GAIT2392)
    assert not list(tmp_path.iterdir())
