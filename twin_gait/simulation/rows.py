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
    """A change of phase."""

    tick: int  # At which the new phase begins.
    leg: int  # Which leg.
    source: int  # Phase that was left.
    target: int  # Phase that was entered.
    transition: int  # Place in the table.


@dataclass(slots=True)
class Efforts:
    """The wearer's efforts, which come with a delay; their rows are behind an address."""

    lowest_posture: float  # First hip angle of the normative moments in [rad].
    posture_step: float  # From one to the next in [rad].
    n_ring: int  # Their number.
    n_noise: int  # Rows of it, taken in turn.
    ring: int = 0  # Address of the efforts of the last ticks.
    noise: int = 0  # Address of the share by which the effort strays, tick by tick.


@dataclass(slots=True)
class Recording:
    """Log, switches and sensor noise; their rows are behind an address."""

    on: bool  # Whether the log is written.
    most_switches: int  # That there is room for.
    n_noise: int  # Rows of it, taken in turn.
    log: int = 0  # Address of its first row.
    first_row: int = 0  # Tick of that row.
    switches: int = 0  # Address of the first switch.
    n_switches: int = 0  # That have happened.
    noise: int = 0  # Address of what the sensors read in excess, tick by tick.
