"""Checks of laws that must hold whatever the numbers: energy, order of the integrators, passivity."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from twin_gait.configuration import load_experiment
from twin_gait.core.contact import ground_contact_force
from twin_gait.core.integrators import rk4_step, semi_implicit_euler_step
from twin_gait.core.plant import FRICTION, STOP, STOP_LOWER, STOP_UPPER, passive_torque
from twin_gait.leg_model import LegModel
from twin_gait.parameters import HARD_TORQUE_LIMIT, HIGHEST_LOAD_FRICTION, ContactParameters
from twin_gait.studies.validation.check import CheckPlan, Finding
from twin_gait.studies.validation.dynamics import Pendulum, State, pendulum_acceleration, pendulum_of
from twin_gait.vocabulary import MOTOR_JOINTS

START = (1.2, 0.3)  # hip and knee of the free leg at rest in [rad]: a swing of half a turn
FREE_DURATION, FREE_STEP = 5.0, 1e-3  # [s]
ORDER_DURATION = 0.5  # [s]
ORDER_STEPS = {"semi_implicit_euler": (400, 800, 1600), "rk4": (20, 40, 80)}
ORDERS = {"semi_implicit_euler": 1, "rk4": 4}

Advance = Callable[[np.ndarray, np.ndarray, float], None]


def _bench_model() -> LegModel:
    return load_experiment("bench_leg").experiment.build_world().model


def free_leg(model: LegModel, method: str) -> Advance:
    """One step of a leg without friction, motors and stops.

    Args:
        model: The leg.
        method: Key of ``ORDERS``.

    Returns:
        A function that changes coordinates and velocities in place.
    """
    nothing = np.zeros(model.nv)

    def fall(_: None, offset: float, weight: float, q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
        out[:] = model.forward_dynamics(q, v, nothing)

    def euler(q: np.ndarray, v: np.ndarray, step: float) -> None:
        semi_implicit_euler_step(fall, None, q, v, step, np.zeros(model.nv))

    def runge_kutta(q: np.ndarray, v: np.ndarray, step: float) -> None:
        rk4_step(fall, None, q, v, step, np.zeros((5, model.nv)))

    return runge_kutta if method == "rk4" else euler


# ---------------------------------------------------------------------- energy


def free_energy_drift() -> Finding:
    """Change of the energy of a free leg over its largest kinetic energy."""
    model = _bench_model()
    advance = free_leg(model, "rk4")
    q, v = np.array(START), np.zeros(model.nv)
    kinetic, total = [], []
    for _ in range(round(FREE_DURATION / FREE_STEP)):
        kinetic.append(model.kinetic_energy(q, v))
        total.append(kinetic[-1] + model.potential_energy(q))
        advance(q, v, FREE_STEP)
    drift = float(np.abs(np.array(total) - total[0]).max())
    return Finding(
        drift / max(kinetic), f"bench leg, {FREE_DURATION:g} s, up to {max(kinetic):.1f} J of motion"
    )


# ---------------------------------------------------------------------- order


def exact_motion(pendulum: Pendulum, duration: float) -> np.ndarray:
    """Angles and velocities of the free double pendulum, by scipy's method of eighth order.

    Args:
        pendulum: Its constants.
        duration: In [s].

    Returns:
        Shape ``(4,)``.
    """

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        q, v = state[:2], state[2:]
        return np.concatenate([v, pendulum_acceleration(pendulum, State(q, v, np.zeros(2)))])

    start = np.array([*START, 0.0, 0.0])
    solution = solve_ivp(slope, (0.0, duration), start, method="DOP853", rtol=1e-13, atol=1e-13)
    return np.asarray(solution.y[:, -1])


def order_error(method: str) -> Finding:
    """Difference of an integrator's order from the order that it is known for.

    Args:
        method: Key of ``ORDERS``.

    Returns:
        Magnitude of the difference between the slope of the error and the order.
    """
    experiment = load_experiment("bench_leg").experiment
    expected = exact_motion(pendulum_of(experiment), ORDER_DURATION)
    advance = free_leg(experiment.build_world().model, method)
    counts = np.array(ORDER_STEPS[method])
    errors = [np.abs(_state_after(advance, count) - expected).max() for count in counts]
    slope = float(-np.polyfit(np.log(counts), np.log(errors), 1)[0])
    return Finding(
        abs(slope - ORDERS[method]), f"slope {slope:.3f} for {', '.join(str(item) for item in counts)} steps"
    )


def _state_after(advance: Advance, steps: int) -> np.ndarray:
    q, v = np.array(START), np.zeros(2)
    for _ in range(steps):
        advance(q, v, ORDER_DURATION / steps)
    return np.concatenate([q, v])


# ---------------------------------------------------------------------- passivity


def friction_power() -> Finding:
    """Largest power that the friction of hip and knee gives to a moving joint."""
    experiment = load_experiment("bench_leg").experiment
    loaded = replace(experiment.plant, load_friction=dict.fromkeys(MOTOR_JOINTS, HIGHEST_LOAD_FRICTION))
    world = replace(experiment, plant=loaded).build_world()
    speeds = np.concatenate([np.geomspace(1e-9, 1e-3, 200), np.linspace(1e-3, 12.0, 6000)])
    powers = [
        passive_torque(0.0, velocity, load, *row)[FRICTION] * velocity
        for row in world.plant_rows.tolist()
        for load in (-HARD_TORQUE_LIMIT, 0.0, HARD_TORQUE_LIMIT)
        for velocity in [*speeds.tolist(), *(-speeds).tolist()]
    ]
    return Finding(
        max(powers), f"hip and knee, {len(powers)} velocities and loads up to {speeds[-1]:g} rad/s"
    )


def ground_pull() -> Finding:
    """Largest force by which the ground pulls at a sole, touches from afar or drives it beyond friction."""
    law = ContactParameters()
    heights = [*np.linspace(-0.05, 0.02, 71).tolist(), -1e-9, 1e-9]
    speeds = np.linspace(-3.0, 3.0, 61).tolist()
    belt, worst = 0.4, -np.inf
    cases = list(itertools.product(heights, speeds, speeds))
    for height, forward, upward in cases:
        friction, normal = ground_contact_force(
            height,
            forward,
            upward,
            belt,
            law.stiffness,
            law.dissipation,
            law.friction_coefficient,
            law.transition_velocity,
        )
        excess = abs(friction) - law.friction_coefficient * normal
        drives = np.sign(friction) * np.sign(forward + belt) * abs(friction)
        touches = abs(normal) + abs(friction) if height >= 0.0 else 0.0
        worst = max(worst, -normal, excess, drives, touches)
    return Finding(float(worst), f"{len(cases)} heights and velocities")


def stop_pull() -> Finding:
    """Largest torque by which a mechanical stop pulls a joint outwards, or acts before it is touched."""
    world = load_experiment("bench_leg").experiment.build_world()
    worst, count = -np.inf, 0
    for row in world.plant_rows.tolist():
        lower, upper = row[STOP_LOWER], row[STOP_UPPER]
        angles, speeds = np.linspace(lower - 0.2, upper + 0.2, 261), np.linspace(-12.0, 12.0, 121)
        for angle, velocity in itertools.product(angles.tolist(), speeds.tolist()):
            torque = passive_torque(angle, velocity, 0.0, *row)[STOP]
            outwards = torque if angle > upper else -torque if angle < lower else abs(torque)
            worst, count = max(worst, outwards), count + 1
    return Finding(float(worst), f"hip and knee, {count} angles and velocities")


LAW_CHECKS = (
    CheckPlan(
        name="free-energy",
        witness="conservation of energy",
        unit="1",
        # Runge-Kutta changes the energy of an oscillation by (ωh)⁶/72 in a step; nothing in the free leg is
        # faster than 10 rad/s: 7e-11 in 5000 steps.
        tolerance=1e-10,
        find=free_energy_drift,
    ),
    CheckPlan(
        name="order-semi-implicit-euler",
        witness="scipy DOP853, by hand",
        unit="1",
        # The next term of the error is smaller by the step over the time scale of the motion, here about
        # 1/1000. A method that lost its order is off by 1.
        tolerance=0.01,
        find=partial(order_error, "semi_implicit_euler"),
    ),
    CheckPlan(
        name="order-rk4",
        witness="scipy DOP853, by hand",
        unit="1",
        # As above with steps twenty times as long, which an error above scipy's 1e-13 needs.
        tolerance=0.1,
        find=partial(order_error, "rk4"),
    ),
    CheckPlan(name="friction-passive", witness="passivity", unit="W", tolerance=0.0, find=friction_power),
    CheckPlan(name="ground-never-pulls", witness="passivity", unit="N", tolerance=0.0, find=ground_pull),
    CheckPlan(name="stops-never-pull", witness="passivity", unit="N m", tolerance=0.0, find=stop_pull),
)
