"""What a record points at: rows of the log, of switches, of noise and of efforts, behind an address.

Compiled code finds them by the address, plain code as the engine hands them; see
:mod:`twin_gait.simulation.interface`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

UNIT_READINGS = 3  # of an inertial unit: gyroscope, accelerometer forwards and up


def noise_width(episode: np.dtype[Any]) -> int:
    """Entries of a row of sensor noise, by the dtype of the episode."""
    assert episode.names is not None
    return int(episode["joints"].shape[0]) + ("trunk_unit" in episode.names) * UNIT_READINGS


@dataclass(slots=True)
class Switch:
    """A change of phase.

    Attributes:
        tick: At which the new phase begins.
        leg: Which leg.
        source: Phase that was left.
        target: Phase that was entered.
        transition: Place in the table.
    """

    tick: int
    leg: int
    source: int
    target: int
    transition: int


@dataclass(slots=True)
class Efforts:
    """The wearer's efforts, which come with a delay; their rows are behind an address.

    Attributes:
        lowest_posture: First hip angle of the normative moments in [rad].
        posture_step: From one to the next in [rad].
        ring: Address of the efforts of the last ticks.
        n_ring: Their number.
        noise: Address of the share by which the effort strays, tick by tick.
        n_noise: Rows of it, taken in turn.
    """

    lowest_posture: float
    posture_step: float
    n_ring: int
    n_noise: int
    ring: int = 0
    noise: int = 0


@dataclass(slots=True)
class Recording:
    """Log, switches and sensor noise; their rows are behind an address.

    Attributes:
        on: Whether the log is written.
        log: Address of its first row.
        first_row: Tick of that row.
        switches: Address of the first switch.
        n_switches: That have happened.
        most_switches: That there is room for.
        noise: Address of what the sensors read in excess, tick by tick.
        n_noise: Rows of it, taken in turn.
    """

    on: bool
    most_switches: int
    n_noise: int
    log: int = 0
    first_row: int = 0
    switches: int = 0
    n_switches: int = 0
    noise: int = 0
