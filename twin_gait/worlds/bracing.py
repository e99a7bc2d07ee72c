"""The wearer bound to the device by braces instead of rigidly, and the step that carries what is stiff."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twin_gait.core.plant import Brace, Plant, free_coordinate
from twin_gait.leg_model import LegModel
from twin_gait.parameters import BraceParameters, SlidingSpringDamper, SpringDamper
from twin_gait.vocabulary import JointName
from twin_gait.worlds.world import Braces, World

RK4_ORDER = 4  # of the classical Runge-Kutta method, which is exact for a linear system up to this power
# Motions without a force have the eigenvalue 1 twice, which is computed to the root of the rounding only.
_ROUNDING = 1e-6


def brace_world(world: World, device: LegModel, wearer: LegModel, parameters: BraceParameters) -> World:
    """Take device and wearer of a world apart and bind them by braces.

    Motors, friction, stops, orthosis and imposed motion stay with the device; the support and the feet go
    with the wearer. Both start in the posture of the world.
    """
    of_wearer, of_device = [free_coordinate() for _ in world.plant], list(world.plant)
    for pelvis in (world.model.pelvis_index, world.model.forward_index):
        if pelvis is not None:
            of_device[pelvis], of_wearer[pelvis] = of_wearer[pelvis], of_device[pelvis]
    return replace(
        world,
        plant=(*of_device, *of_wearer),
        start_q=np.tile(world.start_q, 2),
        start_v=np.tile(world.start_v, 2),
        braces=Braces(device=device, wearer=wearer, braces=_braces(world.model, parameters)),
    )


def _braces(model: LegModel, parameters: BraceParameters) -> tuple[Brace, ...]:
    laws: dict[int, SpringDamper | SlidingSpringDamper] = dict.fromkeys(
        range(model.nv), parameters.pelvis
    )  # the pelvis is what is no joint
    for side, leg in model.legs.items():
        laws |= {model.index(side, joint): parameters.of(joint) for joint, _ in leg.items()}
    return tuple(Brace(laws[index].stiffness, laws[index].damping) for index in range(model.nv))


# ---------------------------------------------------------------------- the step

Step = Callable[[np.ndarray, float], np.ndarray]


def rk4_growth(system: np.ndarray, step: float) -> np.ndarray:
    r"""What one step h of the classical Runge-Kutta method makes of the state of :math:`\dot x = A x`.

    :math:`R = \sum_{i=0}^{4} \frac{(hA)^i}{i!}`, shape ``(m, m)``.
    """
    term = growth = np.eye(len(system))
    for power in range(1, RK4_ORDER + 1):
        term = term @ system * (step / power)
        growth = growth + term
    return growth


def semi_implicit_euler_growth(system: np.ndarray, step: float) -> np.ndarray:
    """As :func:`rk4_growth` of the semi-implicit Euler method; positions are first, then velocities."""
    half = len(system) // 2
    velocity = np.eye(len(system))[half:] + step * system[half:]
    position = np.eye(len(system))[:half] + step * velocity
    return np.vstack((position, velocity))


def carries(world: World, growth: Step, step: float) -> bool:
    """Whether an integrator carries braces and bristles of a world without letting their oscillation grow.

    Braces, springs, viscous dampers and bristles that stick are linear; gravity, contact and the change of
    the inertias on the way are not looked at.

    ``growth``: :func:`rk4_growth` or :func:`semi_implicit_euler_growth`. ``step``: in [s].
    """
    return all(
        _largest_growth(growth, _linear(world, q), step) <= 1.0 + _ROUNDING
        for q in (world.start_q[: world.model.nv], _bent(world))
    )


def _largest_growth(growth: Step, system: np.ndarray, step: float) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        once = growth(system, step)
    return float(np.abs(np.linalg.eigvals(once)).max()) if np.isfinite(once).all() else math.inf


def _bent(world: World) -> np.ndarray:
    q = np.zeros(world.model.nv)
    for side in world.model.sides:
        q[world.model.index(side, JointName.KNEE)] = 1.0
    return q


def _linear(world: World, q: np.ndarray) -> np.ndarray:
    """A world around a posture: the matrix of its positions and velocities."""
    n = len(world.plant)
    inertia, masses = np.zeros((n, n)), [chain.mass_matrix(q) for chain in world.chains]
    for number, mass in enumerate(masses):
        own = slice(number * len(mass), (number + 1) * len(mass))
        inertia[own, own] = mass
    stiffness = np.diag([plant.spring.stiffness + plant.friction.bristle_stiffness for plant in world.plant])
    damping = np.diag([_damping(plant) for plant in world.plant])
    if world.braces is not None:
        coupling, braces = np.array([[1.0, -1.0], [-1.0, 1.0]]), world.braces.braces
        stiffness += np.kron(coupling, np.diag([brace.stiffness for brace in braces]))
        damping += np.kron(coupling, np.diag([brace.damping for brace in braces]))
    accelerations = -np.linalg.solve(inertia, np.hstack((stiffness, damping)))
    return np.vstack((np.hstack((np.zeros_like(inertia), np.eye(n))), accelerations))


def _damping(plant: Plant) -> float:
    """Of spring, gear and bristles that stick, in [N m s] / [rad]."""
    friction = plant.friction
    return plant.spring.damping + friction.viscous_friction_forward + friction.bristle_damping
