"""Backend of a loop: the functions of a rigid-body kernel, and access to the rows of log and noise.

The steps import these names; :mod:`twin_gait.simulation.binding` replaces them by those of a kernel and of
the memory of a run.
"""

from collections.abc import Callable, Sequence
from typing import Any

from twin_gait.core.contact import ContactState, Ground
from twin_gait.simulation.episode import Episode, Switch


def dynamics(
    q: list[float],
    v: list[float],
    torque: list[float],
    rotors: list[float],
    bodies: list[float],
    gravity: float,
    ground: Ground,
    a: list[float],
    points: list[ContactState],
) -> float:
    """Compute accelerations under joint torques and contact forces, and change ``a`` and ``points`` in place.

    ``rotors``: inertias of the rotors at the joints in [kg·m²]; they replace those of the bodies, and are not
    read where a body has none. ``bodies``: masses, inertias, lengths and armature, from
    :func:`~twin_gait.kernels.generated.body_values`. Returns the power of the contact forces in [W].
    """
    raise NotImplementedError


def contact_forces(
    q: list[float], v: list[float], bodies: list[float], ground: Ground, points: list[ContactState]
) -> float:
    """Compute the contact forces of a state, as :func:`dynamics` without the accelerations."""
    raise NotImplementedError


def observe(
    q: list[float],
    v: list[float],
    a: list[float],
    bodies: list[float],
    gravity: float,
    points: list[ContactState],
) -> tuple[float, float, float, float]:
    """Compute kinetic and potential energy in [J], force in [N] and moment in [N·m] of the pelvis guides."""
    raise NotImplementedError


def vector_map(
    e: Episode,
    indices: tuple[int, ...],
    staged: bool,
    read: Callable[[Episode, int, bool], tuple[float, ...]],
    law: Callable[..., Any],
    write: Callable[[Episode, int, Any], None],
) -> None:
    """Apply a law at several places, in vectors if the loop runs a single episode.

    ``read``: returns the arguments of the law from episode, index and ``staged``, which is whether the state
    is that of a stage of the integration. ``law``: returns a number or a tuple of numbers. ``write``: stores
    the result and takes episode, index and result.
    """
    for index in indices:
        for one in vector_lanes(e):
            write(one, index, law(*read(one, index, staged)))


def episode_at(address: int) -> Episode:
    """Return the record of the episode at an address."""
    raise NotImplementedError


def vector_lanes(e: Episode) -> tuple[Episode]:
    """Yield the episodes that run in lockstep, for a step of all at once; a single episode yields itself."""
    return (e,)


def scalar_lanes(e: Episode) -> tuple[Episode]:
    """Yield the episodes one after the other, for branches that are rare or differ between episodes."""
    return (e,)


def log_row(e: object, tick: int) -> list[float]:
    """Return the row of the log for a tick, to be written."""
    raise NotImplementedError


def write_row(e: object, row: list[float]) -> None:
    """Write all columns of an episode (:mod:`twin_gait.simulation.log`) into a row of its log."""
    raise NotImplementedError


def switch_row(e: Episode, number: int) -> Switch:
    """Return the record of a switch of a leg, to be written."""
    raise NotImplementedError


def noise_row(e: object, tick: int) -> Sequence[float]:
    """Return the random numbers of a tick.

    These are the errors of the encoders in [rad], noise and offset, by joint; the shares of the wearer's
    efforts, by limb; and if the trunk is free the noise of a gyroscope in [rad/s] and of an accelerometer
    in [m/s²].
    """
    raise NotImplementedError
