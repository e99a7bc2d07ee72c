"""Comparisons of the installation check: errors that must be small, from public functions of twin_gait."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from crosscheck.closed_forms import pendulum_acceleration, pendulum_motion, pendulum_of

from twin_gait import Experiment, Run, load_experiment, simulate
from twin_gait.gait.table import TICK
from twin_gait.measures.effort import LARGEST_RESIDUAL, energy_balance
from twin_gait.parameters.drives import ActuatorParameters
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.simulation.log import state_columns
from twin_gait.studies.accuracy import step_error
from twin_gait.worlds.treadmill import RK4_LIMIT

LOSSY = ("plant.actuators.hip.gear_efficiency=0.85", "plant.actuators.knee.gear_efficiency=0.7")
N_STATES = 100
REPETITIONS = 50  # of the accelerations of a leg whose gears lose under load
SEED = 20240607
RESIDUAL_LIMIT = LARGEST_RESIDUAL  # of the energy balance of a run with a stable step
STEP_LIMIT = RK4_LIMIT  # of the step times the rate of a decay
DIFFERENCE = 1e-6  # of a coordinate in [m] or [rad], for the slope of a position
# A leg without friction, stops and motors, and without the inertia of its drives, let go from high up: it
# moves so fast that the error of an integrator stands out of rounding.
FREE_LEG = (
    "control.safety.enabled=false",
    "control.mode=transparent",
    "table.phases.early_stance.gravity_compensation=0",
    "control.limits.torque_Nm=1e-15",
    "plant.battery.voltage_V=120",  # the back-EMF of a fast leg stays below
    "plant.friction_ratio={hip: 0, knee: 0}",
    "plant.stops.stiffness_Nm_per_rad=0",
    "plant.actuators.hip={rotor_inertia_kgm2: 0, gear_inertia_kgm2: 0}",
    "plant.actuators.knee={rotor_inertia_kgm2: 0, gear_inertia_kgm2: 0}",
    "scenario.start={hip_deg: 100, knee_deg: 60}",
)


def random_states(n: int) -> Iterator[np.ndarray]:
    """Return coordinates, velocities and torques that cover the range of a leg, equal at every call."""
    generator = np.random.default_rng(SEED)
    for _ in range(N_STATES):
        yield generator.uniform([[-1.0], [-4.0], [-40.0]], [[1.5], [4.0], [40.0]], (3, n))


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest difference over the largest expected magnitude."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def dynamics_errors(experiment: Experiment) -> dict[str, float]:
    """Compute the differences of mass matrix, bias and accelerations from MuJoCo, which must be installed."""
    from crosscheck.mujoco_legs import coordinate_order, legs_dynamics, legs_of

    model = experiment.build_world().model
    legs = legs_of(experiment, model)
    order, errors = coordinate_order(legs, model), []
    for q, v, torque in random_states(model.nv):
        ours = (model.mass_matrix(q), model.nonlinear_effects(q, v), model.forward_dynamics(q, v, torque))
        theirs = legs_dynamics(legs, order, q, v, torque)
        errors.append([relative_error(*pair) for pair in zip(ours, theirs, strict=True)])
    worst = np.max(errors, axis=0).tolist()
    return dict(zip(("mass matrix", "bias", "accelerations"), worst, strict=True))


def pendulum_error() -> float:
    """Compute the difference between the accelerations of the bench leg and a double pendulum."""
    experiment = load_experiment("bench_leg").experiment
    model, pendulum = experiment.build_world().model, pendulum_of(experiment)
    return max(
        relative_error(model.forward_dynamics(*state), pendulum_acceleration(pendulum, *state))
        for state in random_states(model.nv)
    )


def free_leg(method: str, step_ms: float) -> tuple[Run, float]:
    """Simulate a second of the free leg; return it with its largest difference from the pendulum [rad]."""
    stepping = f"integration={{method: {method}, step_ms: {step_ms}}}"
    run = simulate(load_experiment("bench_leg", ["duration_s=1", *FREE_LEG, stepping]).experiment)
    angles = run.log[["right_hip_angle_rad", "right_knee_angle_rad"]].to_numpy().T
    exact = pendulum_motion(pendulum_of(run.experiment), angles[:, 0], run.log["time_s"].to_numpy())
    return run, float(np.abs(angles - exact[:2]).max())


def integrator_order(method: str) -> float:
    """Return the slope of the error of the free leg over the step on logarithmic axes."""
    steps = (1.0, 0.5, 0.25)
    errors = [free_leg(method, step)[1] for step in steps]
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def energy_drift(run: Run) -> float:
    """Return the change of the energy of a free leg over its largest kinetic energy."""
    energy = (run.log["kinetic_energy_J"] + run.log["potential_energy_J"]).to_numpy()
    return float(np.abs(energy - energy[0]).max() / run.log["kinetic_energy_J"].max())


def energy_residual(run: Run) -> float:
    """Return the unexplained change of energy of a run over the work of all sources."""
    energy = (run.log["kinetic_energy_J"] + run.log["potential_energy_J"]).to_numpy()
    return energy_balance(energy, run.log.filter(like="_work_J").to_numpy().T)["energy_residual_share"]


def step_rows(preset: str, duration: float) -> list[dict[str, str]]:
    """Return the errors of a run at several steps against a tenth of its default step as rows.

    The cost is the number of evaluations of the dynamics in a tick.
    """
    run = simulate(load_experiment(preset, [f"duration_s={duration}"]).experiment)
    found = step_error(run)
    return [
        {
            "preset": preset,
            "step": f"{1e3 * row['step_s']:g} ms" + (", default" if row["step_s"] == found["step_s"] else ""),
            "evaluations in a tick": f"{4.0 * TICK / row['step_s']:.0f}",
            "largest error of an angle": f"{np.degrees(row['largest_angle_error_rad']):.1e}°",
            "phases as in the reference": "all"
            if row["first_slip_s"] is None
            else f"until {row['first_slip_s']:.3f} s",
        }
        for row in found["steps"]
    ]


def random_walk(generator: np.random.Generator, *settings: str) -> Run:
    """Walk of three seconds of a random wearer at a random belt speed and support."""
    low, high = np.array([[40.0, 1.5, 1.0, 0.2], [110.0, 1.95, 2.4, 0.7]])
    mass, height, speed, share = generator.uniform(low, high).tolist()
    who = f"patient={{mass_kg: {mass}, height_m: {height}}}"
    where = (f"scenario.belt_speed_km_per_h={speed}", f"scenario.support.share={share}")
    return simulate(load_experiment("treadmill_guided", ["duration_s=3", who, *where, *settings]).experiment)


def largest_difference(run: Run, other: Run) -> float:
    """Largest difference of a hip or knee angle of two runs in [deg]."""
    names = [f"{side}_{joint}_angle_rad" for side in run.sides for joint in ("hip", "knee")]
    ticks = min(len(run.log), len(other.log))
    apart = run.log[names].to_numpy()[:ticks] - other.log[names].to_numpy()[:ticks]
    return float(np.degrees(np.abs(apart).max()))


def foot_friction_rate(run: Run) -> float:
    """Rate in [1/s] at which the slip of a foot decays at the load peak of a walk on the belt.

    It is the slope of the friction near rest, times the load, times the mobility of the heel or toe.
    """
    world, contact = run.experiment.build_world(), run.experiment.scenario.contact
    model = world.model
    angles = run.log[state_columns(model)[0]].to_numpy()
    rates = []
    for side in run.sides:
        load = run.log[f"{side}_foot_normal_force_N"].to_numpy()
        q = angles[load.argmax()]
        for frame in world.contact_frames[side]:
            nudges = DIFFERENCE * np.eye(len(q))
            ahead, behind = (
                [model.frame_position(q + sign * nudge, frame)[0] for nudge in nudges] for sign in (1, -1)
            )
            forward = (np.array(ahead) - np.array(behind)) / (2.0 * DIFFERENCE)
            mobility = forward @ np.linalg.solve(model.mass_matrix(q), forward)
            slope = contact.friction_coefficient / contact.transition_velocity
            rates.append(slope * load.max() * mobility)
    return float(max(rates))


def largest_friction_power(run: Run) -> float:
    """Return the largest power that friction adds to a moving joint in [W]."""
    torques = run.log.filter(regex="(hip|knee)_friction_torque_Nm$")
    rates = run.log[[name.replace("friction_torque_Nm", "velocity_rad_per_s") for name in torques]]
    return float((torques.to_numpy() * rates.to_numpy()).max())


def engine_difference(preset: str, duration: float) -> float:
    """Return the largest difference of an angle between engines in [rad]; infinite if switches differ."""
    settings = (f"duration_s={duration}", "sensors.ideal=true", "integration.method=semi_implicit_euler")
    ours, theirs = (
        simulate(
            load_experiment(preset, [*settings, "integration.step_ms=0.25", f"engine={name}"]).experiment
        )
        for name in ("compiled", "pinocchio")
    )
    if ours.switches != theirs.switches or not ours.switches:
        return float("inf")
    angles = [name for name in ours.log if name.endswith("_angle_rad") and "measured" not in name]
    return float(np.abs(ours.log[angles].to_numpy() - theirs.log[angles].to_numpy()).max())


def replay_difference(run: Run) -> float:
    """Return the largest difference of an angle [rad] if MuJoCo applies the logged torques of a bench leg.

    Friction and losses of the gear are typed in a second time; the run is by the semi-implicit Euler method,
    one step a tick.
    """
    from crosscheck.mujoco_legs import coordinate_order, legs_of, mujoco

    experiment, model = run.experiment, run.experiment.build_world().model
    legs = legs_of(experiment, model)
    data, order = mujoco.MjData(legs), coordinate_order(legs, model)
    joints = ("hip", "knee")
    columns = {
        quantity: run.log[[f"right_{joint}_{quantity}" for joint in joints]].to_numpy()
        for quantity in ("angle_rad", "velocity_rad_per_s", "motor_torque_Nm")
    }
    laws = [experiment.plant.true_friction()[joint] for joint in joints]
    gears = [experiment.plant.actuators[joint] for joint in joints]
    armature = np.array([gear.armature for gear in gears])
    data.qpos[order], data.qvel[order] = columns["angle_rad"][0], columns["velocity_rad_per_s"][0]
    worst = 0.0
    for angle, motor in zip(columns["angle_rad"], columns["motor_torque_Nm"], strict=True):
        worst = max(worst, float(np.abs(data.qpos[order] - angle).max()))
        rates = data.qvel[order]
        friction = [friction_torque(*given) for given in zip(rates, laws, strict=True)]
        # The losses depend on the acceleration: each repetition reduces the error by 1/η - 1 at least.
        for _ in range(REPETITIONS):
            loads = motor - armature * data.qacc[order]
            lost = [gear_loss(*given) for given in zip(rates, loads, laws, gears, strict=True)]
            data.qfrc_applied[order] = motor - friction - lost
            mujoco.mj_forward(legs, data)
        mujoco.mj_step(legs, data)
    return worst


def friction_torque(velocity: float, law: FrictionParameters) -> float:
    """Compute equation (3.1) of the thesis, written a second time on purpose, in [N·m] with the sign of ω."""
    ratio = velocity / law.breakaway_velocity
    stribeck = np.sqrt(2.0) * np.exp(0.5 - ratio**2) * ratio
    return float(
        (law.breakaway_torque - law.coulomb_friction) * stribeck
        + law.coulomb_friction * np.tanh(10.0 * ratio)
        + law.viscous_friction * velocity
    )


def gear_loss(velocity: float, load: float, law: FrictionParameters, gear: ActuatorParameters) -> float:
    """Compute the loss of a gear in [N·m]: output over load is η driving, 1 at rest, 1/η driven."""
    eta = gear.gear_efficiency
    drives = np.sign(load) * np.tanh(10.0 * velocity / abs(law.breakaway_velocity))
    return float(load * (drives**2 - 0.5 * drives * ((drives - 1.0) / eta + (drives + 1.0) * eta)))
