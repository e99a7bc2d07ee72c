r"""Export of a run for OpenSim's InverseDynamicsTool: model, motion, external loads, set-up, joint moments.

The ground acts on each foot with one force at its centre of pressure,

.. math::

    x = -M_y / F_z, \qquad y = M_x / F_z

in the axes of the belt, where M is the moment about a point on the belt. The forces at heel and toe are
computed again by the law of the contact from the logged state. Support and guide of the pelvis are an
external load of their own, so that no residual force remains at the pelvis. The moments of joints with a
motor are the moments on the leg behind the gear: the torques of the log minus the torque that accelerates the
rotor, :math:`J_{rotor}\,\dot\omega`, because OpenSim has no body for the rotor.

With braces, the bodies are those of the wearer or of the device, and the moments include the braces. The log
has the sum of both guides, so that ``pelvis_tx_force`` and ``pelvis_tilt_moment`` of OpenSim are then the
loads of the guide.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from twin_gait.conventions import DEGREES, Convention
from twin_gait.core.contact import MIN_NORMAL_FORCE, ContactState
from twin_gait.core.plant import plant_torque
from twin_gait.exceptions import ParameterError
from twin_gait.export.motion import joint_angles, write_storage
from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK
from twin_gait.kernels.pinocchio_kernel import GroundContacts
from twin_gait.leg_model.bodies import BodyArrays, export_bodies
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.run import Run
from twin_gait.templates import make_template_environment
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.world import World

MODEL_FILE, MOTION_FILE, MOMENTS_FILE = "model.osim", "motion.mot", "joint_moments.sto"
LOADS_FILE, FORCES_FILE = "external_loads.xml", "external_loads.mot"
SETUP_FILE = "inverse_dynamics.xml"
PELVIS = "pelvis"
PELVIS_COORDINATES = ("pelvis_tilt", "pelvis_tx", "pelvis_ty")
_BODIES = {JointName.HIP: "thigh", JointName.KNEE: "shank", JointName.ANKLE: "foot"}


class ExternalLoad(NamedTuple):
    """Load of the environment on a body, in the axes of OpenSim."""

    name: str  # name of the load
    body: str  # body on which it acts
    force: np.ndarray  # in [N], shape ``(n, 3)``
    point: np.ndarray  # point of application in the world in [m], shape ``(n, 3)``
    torque: np.ndarray  # free torque in addition to the force in [N·m], shape ``(n, 3)``


def export_inverse_dynamics(
    run: Run, folder: str | Path, convention: Convention, *, device: bool = False
) -> None:
    """Write all files that OpenSim needs to compute the joint moments of a run.

    ``opensim-cmd run-tool inverse_dynamics.xml`` in the folder then writes ``inverse_dynamics.sto``, which
    can be compared with ``joint_moments.sto``.

    ``folder``: an existing, empty folder. ``convention``: names and signs of the coordinates. ``device``:
    whether bodies and motion are those of the device if braces connect the wearer to it. Raises
    ParameterError if the convention has no column names of its own, the log is too short, or the trunk is
    free.
    """
    if len(run.log) < 2:
        raise ParameterError(f"log: expected two rows or more for OpenSim, got {len(run.log)}")
    world, name = run.experiment.build_world(), run.experiment.name
    if world.model.pitch_index is not None:
        left_out = "a trunk that pitches, its arms and crutches are not in what OpenSim would be given"
        raise ParameterError(f"{name}: {left_out}; use --format mot for the joint angles")
    bodies = world.model
    if world.braces is not None:
        bodies = world.braces.device if device else world.braces.wearer
    time, pelvis = run.log["time_s"].to_numpy(dtype=float), _pelvis(run, world, device)
    loads = _external_loads(run, world, pelvis, device) if pelvis else []
    tables = {
        MOTION_FILE: {**joint_angles(run.log, convention, DEGREES, device=device), **pelvis},
        MOMENTS_FILE: {
            f"{convention.columns[key]}_moment": convention.signs.get(key[1], 1.0) * moment
            for key, moment in joint_moments(run, world, device=device).items()
        },
    }
    content = {"name": name, "gravity": run.experiment.plant.gravity, "time": time, "loads": loads}
    pages = [MODEL_FILE, SETUP_FILE]
    if loads:
        tables[FORCES_FILE] = _load_columns(loads)
        pages.append(LOADS_FILE)
    for file, columns in tables.items():
        in_degrees = file == MOTION_FILE
        write_storage(Path(folder) / file, {"time": time, **columns}, in_degrees=in_degrees)
    # The files have the format version that every OpenSim 4 reads.
    templates = make_template_environment(Path(__file__).with_name("templates"), autoescape=True)
    templates.filters["numbers"] = _numbers
    for file in pages:
        text = templates.get_template(file).render(content, bodies=_bodies(bodies, convention))
        write_atomically(Path(folder) / file, f"{text}\n")


def _external_loads(
    run: Run, world: World, pelvis: Mapping[str, np.ndarray], device: bool
) -> list[ExternalLoad]:
    """Compute the loads of ground, support and guide on the bodies that are written."""
    turn = _opensim_rotation(world.model.up_axis)
    loads = [_pelvis_load(run, world, pelvis, device)]
    if run.experiment.scenario.walking is not None and not (device and world.braces is not None):
        belt = turn @ _belt_axes(world)
        for side, wrench in _ground_wrenches(run, world).items():
            force, moment = wrench[:, :3], wrench[:, 3:]
            point = _centres_of_pressure(force, moment)
            free = moment - np.cross(point, force)
            parts = (item @ belt.T for item in (force, point, free))
            loads.append(ExternalLoad(f"ground_{str(side)[0]}", _body_name(side, JointName.ANKLE), *parts))
    return loads


def _belt_axes(world: World) -> np.ndarray:
    """Return the directions in the world along the belt, to the left and normal to the belt, as columns."""
    ground = world.ground()
    sine, cosine = ground.slope_sine, ground.slope_cosine
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def _ground_wrenches(run: Run, world: World) -> dict[Side, np.ndarray]:
    """Compute force and moment about the origin on each foot in the axes of the belt, shape ``(n, 6)``.

    The belt reaches the speed of a tick at once, as a motor does its torque. The acceleration at the tick
    therefore corresponds approximately to the mean force at both speeds.
    """
    contacts, ground, axes = GroundContacts(world), world.ground(), _belt_axes(world)
    points = [ContactState() for foot in contacts.feet.values() for _ in foot.points]
    columns = state_columns(world.model, wearer=world.braces is not None)
    q, v = (run.log[names].to_numpy(dtype=float) for names in columns)
    found = {side: np.zeros((len(q), 6)) for side in contacts.feet}
    speeds = run.log["belt_speed_m_per_s"].tolist()
    for tick, pair in enumerate(pairwise([speeds[0], *speeds])):
        for ground.belt_speed in set(pair):
            contacts.update(q[tick], v[tick], ground, points)
            for side, wrenches in found.items():
                wrench = (contacts.wrench(side).reshape(2, 3) @ axes).ravel()
                wrenches[tick] += wrench / len(set(pair))
    return found


def _centres_of_pressure(force: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Compute the points about which the moment of the ground has no horizontal part.

    In the air, the last point on the ground is repeated, or the next one if there is none.
    """
    loaded = force[:, 2] > MIN_NORMAL_FORCE
    point = np.full(force.shape, np.nan)
    point[loaded, 0] = -moment[loaded, 1] / force[loaded, 2]
    point[loaded, 1] = moment[loaded, 0] / force[loaded, 2]
    point[:, 2] = 0.0
    return np.asarray(pd.DataFrame(point).ffill().bfill().fillna(0.0).to_numpy())


def _pelvis_load(run: Run, world: World, pelvis: Mapping[str, np.ndarray], device: bool) -> ExternalLoad:
    log, zero = run.log, pd.Series(0.0, run.log.index)
    along, up, moment = log["guide_force_N"], log["support_force_N"], log["guide_moment_Nm"]
    if world.braces is not None:
        lifting, moment = log["pelvis_brace_force_N"], zero
        up = -lifting if device else up + lifting
        pushing = log.get("pelvis_forward_brace_force_N")
        along = zero if pushing is None else -pushing if device else along + pushing
    _, forward, height = pelvis.values()
    turn = _opensim_rotation(world.model.up_axis)
    rows = ((along, zero, up), (forward, zero, height), (zero, moment, zero))
    return ExternalLoad("harness", PELVIS, *(np.column_stack(parts) @ turn.T for parts in rows))


def _pelvis(run: Run, world: World, device: bool) -> dict[str, np.ndarray]:
    """Return tilt and position of the pelvis of the bodies that are written; empty if it is fixed."""
    model, still = world.model, np.zeros(len(run.log))
    if model.pelvis_index is None:
        return {}
    positions, _ = state_columns(model, wearer=world.braces is not None and not device)
    guides = (model.forward_index, model.pelvis_index)
    coordinates = (still if index is None else run.log[positions[index]].to_numpy() for index in guides)
    return dict(zip(PELVIS_COORDINATES, (still, *coordinates), strict=True))


def joint_moments(
    run: Run, world: World, *, device: bool = False
) -> dict[tuple[Side, JointName], np.ndarray]:
    """Compute the moments at all joints of the wearer or, with braces and ``device``, of the device.

    Returns the moments in [N·m] at every tick, positive in flexion and dorsiflexion, shape ``(n,)`` each.
    """
    moments = {}
    for side, joint in ((side, joint) for side, leg in world.model.legs.items() for joint, _ in leg.items()):
        driving, log = device_moment(run, world, side, joint), run.log
        brace = f"{side}_{joint}_brace_torque_Nm"
        if world.braces is not None and device:
            moment = driving - log[brace]
        else:
            wearers = _wearer_moment(run, f"{side}_{joint}")
            moment = wearers + (driving if world.braces is None else log[brace])
        moments[side, joint] = np.asarray(moment)
    return moments


def _wearer_moment(run: Run, name: str) -> Any:
    """Return the torque of the wearer and of pushes at a joint in [N·m], 0 without a column of one.

    A joint without a motor has columns of the own gait and of the passive moment instead of their sum.
    """
    log = run.log
    if f"{name}_external_torque_Nm" in log:
        return log[f"{name}_external_torque_Nm"]
    return log.get(f"{name}_own_torque_Nm", 0.0) + log.get(f"{name}_passive_torque_Nm", 0.0)


def device_moment(run: Run, world: World, side: Side, joint: JointName) -> np.ndarray:
    """Compute the moment of the device at a joint in [N·m].

    It is the sum of motor, friction, stop and orthosis minus the torque that accelerates the rotor; without a
    motor, the sum of orthosis and stop.
    """
    name, log = f"{side}_{joint}", run.log
    velocity = log[f"{name}_velocity_rad_per_s"].to_numpy()
    if f"{name}_motor_torque_Nm" not in log:
        # The log column of the orthosis excludes its stops.
        plant = world.plant[world.model.index(side, joint)]
        states = zip(log[f"{name}_angle_rad"].tolist(), velocity.tolist(), strict=True)
        return np.array([plant_torque(plant, 0.0, *state, 0.0) for state in states])
    # The logged motor torque acts from its tick on; an acceleration at a tick is the mean over both sides.
    motor = log[f"{name}_motor_torque_Nm"]
    held = 0.5 * (motor + motor.shift().fillna(motor))
    rotor = run.experiment.plant.actuators[joint].armature * np.gradient(velocity, TICK)
    passive = log[f"{name}_friction_torque_Nm"] + log[f"{name}_stop_torque_Nm"]
    return np.asarray(held + passive + log.get(f"{name}_orthosis_torque_Nm", 0.0) - rotor)


def _load_columns(loads: list[ExternalLoad]) -> dict[str, np.ndarray]:
    return {
        f"{load.name}_{kind}{axis}": values[:, column]
        for load in loads
        for kind, values in (("v", load.force), ("p", load.point), ("torque_", load.torque))
        for column, axis in enumerate("xyz")
    }


def _body_name(side: Side, joint: JointName) -> str:
    """Return the name of the body that a joint moves, such as ``shank_r``."""
    return f"{_BODIES[joint]}_{str(side)[0]}"


def _opensim_rotation(up_axis: str) -> np.ndarray:
    """Return the rotation from the axes of a URDF to those of OpenSim."""
    return np.eye(3) if up_axis == "y" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)


def _bodies(model: LegModel, convention: Convention) -> list[dict[str, Any]]:
    """Return the bodies of a planar model.

    Joints rotate about the lateral axis, and the pelvis moves in its plane. Rotors are not bodies: their
    inertia at the joints is left out. A pelvis that is fixed in the world is part of the ground.
    """
    bodies = export_bodies(model.model)
    names = [PELVIS] * len(bodies)
    coordinates: list[tuple[tuple[str, ...], float]] = [(PELVIS_COORDINATES, 1.0)] * len(bodies)
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            index = model.index(side, joint)
            names[index] = _body_name(side, joint)
            coordinates[index] = (convention.columns[side, joint],), convention.signs.get(joint, 1.0)
    turn, written = _opensim_rotation(model.up_axis), []
    for index, body in enumerate(bodies):
        if index != model.forward_index:  # the planar joint of the pelvis represents both guides
            grounded = body.parent < 0 or body.parent == model.forward_index
            parent = "/ground" if grounded else f"/bodyset/{names[body.parent]}"
            written.append(_body(body, names[index], parent, turn, *coordinates[index]))
    return written


def _body(
    body: BodyArrays, name: str, parent: str, turn: np.ndarray, coordinates: tuple[str, ...], sign: float
) -> dict[str, Any]:
    """Return a body and its joint, which rotates about the z axis of its frames on both bodies."""
    centre = turn @ np.array(body.first_moment) / body.mass
    about_origin = turn @ np.array(body.inertia) @ turn.T
    inertia = about_origin - body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    axis = np.array([0.0, 0.0, 1.0]) if body.prismatic else sign * turn @ np.array(body.axis)
    along = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])[0]
    placed = Rotation.from_matrix(turn @ np.array(body.rotation) @ turn.T)
    frames = (
        ("parent_offset", parent, turn @ np.array(body.position), placed * along),
        ("child_offset", f"/bodyset/{name}", np.zeros(3), along),
    )
    return {
        "name": name,
        "mass": repr(body.mass),
        "centre": centre,
        "inertia": inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        "joint": "PlanarJoint" if body.prismatic else "PinJoint",
        "coordinates": coordinates,
        "frames": [
            {
                "name": frame,
                "parent": path,
                "translation": translation,
                "angles": rotation.as_euler("XYZ"),
            }
            for frame, path, translation, rotation in frames
        ],
    }
