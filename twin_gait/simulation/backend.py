"""What a loop is bound to beside the structure of an episode: a rigid-body kernel, and rows behind addresses.

The steps import these names; :mod:`twin_gait.simulation.binding` puts the real ones in their place.
"""

from collections.abc import Callable, Sequence

from twin_gait.core.contact import ContactState, Ground
from twin_gait.simulation.episode import Episode, Switch


def dynamics(
    q: list[float],
    v: list[float],
    torque: list[float],
    bodies: list[float],
    gravity: float,
    ground: Ground,
    a: list[float],
    points: list[ContactState],
) -> float:
    """Accelerations under joint torques and contact forces; ``a`` and ``points`` are changed in place.

    ``bodies``: masses, inertias, lengths and armature, from :func:`~twin_gait.kernels.generated.body_values`.
    Returns the power of the contact forces in [W].
    """
    raise NotImplementedError


def contact_forces(
    q: list[float], v: list[float], bodies: list[float], ground: Ground, points: list[ContactState]
) -> float:
    """Contact forces of a state; as :func:`dynamics` without the accelerations."""
    raise NotImplementedError


def observe(
    q: list[float],
    v: list[float],
    a: list[float],
    bodies: list[float],
    gravity: float,
    points: list[ContactState],
) -> tuple[float, float, float, float]:
    """Kinetic and potential energy in [J], force [N] and moment [N m] of the pelvis guides."""
    raise NotImplementedError


def vector_map(
    e: Episode,
    indices: tuple[int, ...],
    staged: bool,
    read: Callable[[Episode, int, bool], tuple[float, ...]],
    law: Callable[..., float],
    write: Callable[[Episode, int, float], None],
) -> None:
    """Apply a law of numbers in places that do not touch each other, as vectors in the loop of one episode.

    ``read``: from episode, place and ``staged``, whether the state is that of a stage of the integration, to
    the arguments of the law. ``write``: takes episode, place and result.
    """
    for place in indices:
        for one in vector_lanes(e):
            write(one, place, law(*read(one, place, staged)))


def episode_at(address: int) -> Episode:
    """The episode at an address."""
    raise NotImplementedError


def vector_lanes(e: Episode) -> tuple[Episode]:
    """The episodes that are run in lockstep, to be taken through a step together; a single one by itself."""
    return (e,)


def scalar_lanes(e: Episode) -> tuple[Episode]:
    """As :func:`lanes`, but one after the other: for what is rare, or different in each."""
    return (e,)


def log_row(e: object, tick: int) -> list[float]:
    """Row of the log for a tick."""
    raise NotImplementedError


def write_row(e: object, row: list[float]) -> None:
    """Write all columns of an episode (:mod:`twin_gait.simulation.log`) into a row of its log."""
    raise NotImplementedError


def switch_row(e: Episode, number: int) -> Switch:
    """Room for a switch."""
    raise NotImplementedError


def noise_row(e: object, tick: int) -> Sequence[float]:
    """What strays in a tick: what encoders read in excess in [rad], noise and offset, by joint.

    Behind them shares of the wearer's efforts, by limb, and of an inertial unit noise of gyroscope in [rad] /
    [s] and of accelerometer in [m] / [s²].
    """
    raise NotImplementedError
