"""Motion of the plant over any scalars: symbols of an algebra system, automatic differentiation, floats.

The function that the engine integrates is specialized with other elementary functions and branch-free laws;
nothing is written a second time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from twin_gait.core.contact import ContactState
from twin_gait.core.friction_models import sign_of
from twin_gait.core.plant import passed_torque
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble, kernel_names
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.simulation.stages.motion import compute_accelerations


class Motion(NamedTuple):
    """Motion at a state."""

    acceleration: list[Any]  # Of the n coordinates.
    points: list[ContactState]  # Forces on the points of the soles and their heights, foot by foot.


def equations_of_motion(
    problem: SimulationSetup, laws: Mapping[str, Callable[..., Any]]
) -> Callable[[Sequence[Any], Sequence[Any], Sequence[Any], Sequence[Any]], Motion]:
    """Return the function that the engine integrates, with some functions of ``twin_gait.core`` replaced.

    ``problem``: from ``build_setup``; without bristles, whose deflection is a state of its own, and without
    a motion imposed by time. ``laws``: functions by the names of those in ``core`` that they replace. Numbers
    need none; scalars that cannot be compared need ``sine_cosine``, ``exponential``, ``hyperbolic_tangent``
    and, for their branches, ``ground_contact_force`` and ``mechanical_stop_torque``.

    The function takes coordinates, velocities, motor torques and accelerations (n each), and returns the
    motion under friction, stops, springs, support, belt and gravity, at the belt's cruising speed and with
    the harness unlocked. Each gear loses with the sign of its load under the given accelerations, and
    ``sign_of`` among the laws may smooth it: the motion is that of the plant if the returned accelerations
    are the given ones.
    """
    bodies, episode, structure = assemble(problem)
    accepted = {"is_sign_wrong": lambda *load: False}
    evaluate = specialize(
        compute_accelerations, {**structure, **accepted, **laws, **kernel_names(bodies, laws)}
    )
    sign = laws.get("sign_of", sign_of)

    def motion(q: Sequence[Any], v: Sequence[Any], motor: Sequence[Any], a: Sequence[Any]) -> Motion:
        episode.q, episode.v, episode.motor, episode.a = list(q), list(v), list(motor), list(a)
        for plant, torque, rate in zip(episode.plant, motor, a, strict=True):
            plant.load_sign = sign(passed_torque(plant, torque, rate))
        evaluate(episode, 0.0, False)
        points = [ContactState(item.forward, item.upward, item.height) for item in episode.points]
        return Motion(list(episode.a), points)

    return motion
