"""The motion of the plant over any scalars: those of an algebra system, of automatic differentiation, floats.

What an engine integrates is bound here to other elementary functions and to laws without branches; nothing is
written a second time.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from twin_gait.core.contact import Point
from twin_gait.kernels.generated import SIDE_BY_SIDE, write_kernel
from twin_gait.simulation.binding import bind, kernel_functions
from twin_gait.simulation.compiled_engine import laid_out
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.rooms.motion import acceleration


class Motion(NamedTuple):
    """What acts at a state."""

    acceleration: list[Any]  # Of the n coordinates.
    points: list[Point]  # Forces on the points of the soles and their heights, foot by foot.


def equations_of_motion(
    problem: Problem, laws: Mapping[str, Callable[..., Any]]
) -> Callable[[Sequence[Any], Sequence[Any], Sequence[Any], Sequence[Any]], Motion]:
    """What the engine integrates, with some functions of ``core`` replaced.

    ``problem``: from :func:`~twin_gait.simulation.problem.build_problem`; without bristles, whose
    deflection is a state of its own, and without a motion imposed by time. ``laws``: functions by the names
    of those in ``core`` that they take the place of. Numbers need none; scalars that cannot be compared need
    ``sine_cosine``, ``exponential``, ``hyperbolic_tangent`` and, for their branches, ``ground_contact_force``
    and ``mechanical_stop_torque``. Returns from coordinates, velocities, motor torques and accelerations (n
    each) to the motion under friction, stops, springs, support, belt and gravity, at the belt's cruising
    speed and with the harness unlocked. Of the accelerations the losses of the gears take what turns the
    rotors (:func:`twin_gait.core.plant.gear_load`): the motion is the plant's where it has the same ones.
    """
    kernel, episode, structure = laid_out(problem)
    called = {item.name: laws.get(item.name, item.function) for item in SIDE_BY_SIDE}
    names = {**structure, **laws, **kernel_functions(write_kernel(kernel), called)}
    room = bind(acceleration, names)

    def motion(q: Sequence[Any], v: Sequence[Any], motor: Sequence[Any], a: Sequence[Any]) -> Motion:
        episode.q, episode.v, episode.motor, episode.a = list(q), list(v), list(motor), list(a)
        room(episode, 0.0, False)
        points = [Point(item.forward, item.upward, item.height) for item in episode.points]
        return Motion(list(episode.a), points)

    return motion
