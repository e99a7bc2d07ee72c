"""Braces that bind the wearer to the device compliantly, and the largest step at which they are stable."""

import math
from dataclasses import replace

import numpy as np

from twin_gait.core.plant import Brace, Plant
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.environment import BraceParameters
from twin_gait.parameters.quantities import from_attributes
from twin_gait.vocabulary import JointName
from twin_gait.worlds.world import BracedModels, World, start_posture

# Motions without a force have the double eigenvalue 1, which is computed only to the square root of the
# rounding.
_ROUNDING = 1e-6


def brace_world(world: World, device: LegModel, wearer: LegModel, parameters: BraceParameters) -> World:
    """Separate device and wearer of a world and connect them by braces.

    Motors, friction, stops, orthosis and imposed motion stay with the device; the support and the feet go
    with the wearer. Both start in the posture of the world.
    """
    of_wearer, of_device = [Plant() for _ in world.plant], list(world.plant)
    for pelvis in (world.model.pelvis_index, world.model.forward_index, world.model.pitch_index):
        if pelvis is not None:
            of_device[pelvis], of_wearer[pelvis] = of_wearer[pelvis], of_device[pelvis]
    return replace(
        world,
        plant=(*of_device, *of_wearer),
        start_q=np.tile(world.start_q, 2),
        start_v=np.tile(world.start_v, 2),
        braces=BracedModels(device=device, wearer=wearer, braces=_braces(world.model, parameters)),
    )


def _braces(model: LegModel, parameters: BraceParameters) -> tuple[Brace, ...]:
    # Coordinates that are not joints have the brace of the pelvis.
    braces = [from_attributes(Brace, parameters.pelvis) for _ in range(model.nv)]
    pitches = model.pitch_index is not None
    if model.pitch_index is not None:
        braces[model.pitch_index] = from_attributes(Brace, parameters.trunk)
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            share = 1.0 if pitches and joint is JointName.HIP else 0.0
            brace = from_attributes(Brace, parameters.joint_brace(joint), pitch_share=share)
            braces[model.index(side, joint)] = brace
    return tuple(braces)


# ---------------------------------------------------------------------- the step


def is_step_stable(world: World, step: float, *, runge_kutta: bool) -> bool:
    r"""Check whether an integrator is stable for the braces and bristles of a world.

    Stable means that their oscillation does not grow. Braces, springs, viscous dampers and bristles that
    stick are linear; gravity, contact and the change of the inertias during the motion are neglected. For
    :math:`\dot x = A x`, a step h of the classical Runge-Kutta method gives
    :math:`\sum_{i=0}^{4} \frac{(hA)^i}{i!}\,x`; the semi-implicit Euler method changes the velocities first,
    then the positions with the new velocities.

    ``step`` in [s]. ``runge_kutta``: whether the integrator is Runge-Kutta instead of semi-implicit Euler.
    """
    model = world.model
    bent = start_posture(model, {side: {JointName.KNEE: 1.0} for side in model.sides}, 0.0)
    growths = (
        _largest_growth(step * _linear(world, q), runge_kutta) for q in (world.start_q[: model.nv], bent)
    )
    return max(growths) <= 1.0 + _ROUNDING


def _largest_growth(system: np.ndarray, runge_kutta: bool) -> float:
    """Compute the largest growth factor of a motion in a step; positions are first, then velocities."""
    same, half = np.eye(len(system)), len(system) // 2
    with np.errstate(over="ignore", invalid="ignore"):
        if runge_kutta:
            once = same
            for power in (4, 3, 2, 1):
                once = same + system @ once / power
        else:
            kick, drift = same.copy(), same.copy()
            kick[half:] += system[half:]
            drift[:half] += system[:half]
            once = drift @ kick
    return float(np.abs(np.linalg.eigvals(once)).max()) if np.isfinite(once).all() else math.inf


def _linear(world: World, q: np.ndarray) -> np.ndarray:
    """Linearize a world about a posture: return the matrix of its positions and velocities."""
    n = len(world.plant)
    inertia, masses = np.zeros((n, n)), [chain.mass_matrix(q) for chain in world.chains]
    for number, mass in enumerate(masses):
        block = slice(number * len(mass), (number + 1) * len(mass))
        inertia[block, block] = mass
    stiffness = np.diag([plant.spring.stiffness + plant.friction.bristle_stiffness for plant in world.plant])
    damping = np.diag([_damping(plant) for plant in world.plant])
    if world.braces is not None:
        coupling, braces = np.array([[1.0, -1.0], [-1.0, 1.0]]), world.braces.braces
        apart = np.eye(len(braces))  # changes of the braces with the coordinates
        if world.model.pitch_index is not None:
            apart[:, world.model.pitch_index] -= [brace.pitch_share for brace in braces]
        stiffness += np.kron(coupling, apart.T @ np.diag([brace.stiffness for brace in braces]) @ apart)
        damping += np.kron(coupling, apart.T @ np.diag([brace.damping for brace in braces]) @ apart)
    accelerations = -np.linalg.solve(inertia, np.hstack((stiffness, damping)))
    return np.vstack((np.hstack((np.zeros_like(inertia), np.eye(n))), accelerations))


def _damping(plant: Plant) -> float:
    """Add up the damping of spring, gear and bristles that stick, in [N·m·s/rad]."""
    friction = plant.friction
    return plant.spring.damping + friction.viscous_friction_forward + friction.bristle_damping
