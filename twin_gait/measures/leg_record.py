"""The columns of one leg that gait measures read, taken out of a log once."""

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
import pandas as pd

from twin_gait.measures.foot_contact import FootContacts, find_foot_contacts, is_loaded
from twin_gait.measures.phases import phase_entries
from twin_gait.measures.strides import SKIPPED_STRIDES, stride_bounds
from twin_gait.vocabulary import JointName, Side


def wearer_column(columns: Container[str], side: Side, joint: JointName, quantity: str) -> str:
    """Column of the wearer's own motion, which is the gait: where they are one body with the device, its own.

    ``quantity``: ``angle_rad`` or ``velocity_rad_per_s``.
    """
    own = f"{side}_{joint}_wearer_{quantity}"
    return own if own in columns else f"{side}_{joint}_{quantity}"


def driven_joints(columns: Container[str], side: Side) -> tuple[JointName, ...]:
    """Joints of a leg that a log with these columns has the motors of, from proximal to distal."""
    return tuple(joint for joint in JointName if f"{side}_{joint}_motor_torque_Nm" in columns)


class LogColumns(Protocol):
    """Columns of a log by name, one value a tick: a table, or arrays."""

    def __len__(self) -> int:
        """Return the number of ticks."""

    def __contains__(self, name: object, /) -> bool:
        """Return whether there is a column."""

    def __getitem__(self, name: str, /) -> Any:
        """Return a column."""


def phase_indices(log: LogColumns, side: Side, phase_names: tuple[str, ...]) -> np.ndarray:
    """Return the phase of a leg at each tick as its index among some names."""
    phases = log[f"{side}_phase"]
    if isinstance(phases, np.ndarray):  # an engine writes indices
        return phases.astype(int)
    return np.asarray(pd.Categorical(phases, dtype=_phase_type(phase_names)).codes, dtype=int)


Spans = tuple[tuple[float, float], ...]  # first and last time in [s] of each
ALWAYS: Spans = ((0.0, math.inf),)


@dataclass(frozen=True, eq=False)
class LegRecord:
    """One leg over a run."""

    side: Side  # the leg
    tick: float  # sampling period in [s]
    phases: np.ndarray  # index of the phase, shape ``(n,)``
    # the wearer's at each actuated joint in [rad], shape ``(n,)`` each; the device's if asked for
    angles: Mapping[JointName, np.ndarray]
    normal_force: np.ndarray | None  # of the foot in [N], shape ``(n,)``, or None without ground
    clearance: np.ndarray | None  # of the foot in [m], shape ``(n,)``, or None without ground
    # from when to when in [s] the leg walks evenly, once or more; strides outside do not count
    steady: Spans = ALWAYS
    # whether the legs wait for somebody to ask for a step at each tick, shape ``(n,)``, or None if never
    waiting: np.ndarray | None = None

    @cached_property
    def clock(self) -> np.ndarray:
        """Ticks before each tick, and before the end, in which the leg did not wait; shape ``(n + 1,)``."""
        waiting = np.zeros(len(self.phases), dtype=bool) if self.waiting is None else self.waiting
        return np.append(0, np.cumsum(~waiting))

    @property
    def steady_ticks(self) -> list[slice]:
        """Ticks in which the leg walks evenly."""
        count = len(self.phases)
        ends = [[round(min(time / self.tick, count)) for time in span] for span in self.steady]
        return [slice(first, last) for first, last in ends]

    @cached_property
    def loaded(self) -> np.ndarray | None:
        """Whether the foot carries at each tick, or None without ground."""
        return None if self.normal_force is None else is_loaded(self.normal_force)

    @cached_property
    def contacts(self) -> FootContacts | None:
        """Contacts of the foot, or None without ground."""
        if self.normal_force is None:
            return None
        return find_foot_contacts(self.normal_force, self.tick, self.angles.get(JointName.HIP))

    @cached_property
    def entries(self) -> np.ndarray:
        """Ticks at which the first phase of the table begins, shape ``(n,)``."""
        return phase_entries(self.phases, 0)

    @property
    def stride_events(self) -> np.ndarray:
        """Ticks at which strides begin: heel strikes, or without ground entries into the first phase."""
        return self.entries if self.contacts is None else self.contacts.heel_strikes

    def strides(self, *, skip: int = SKIPPED_STRIDES) -> np.ndarray:
        """Strides by heel strike, or without ground by entry into the first phase.

        ``skip``: so many strides at the start do not count. Returns first tick of each stride and of the next
        one, shape ``(n_strides, 2)``.
        """
        return self._steady_strides(self.stride_events)[skip:]

    def strides_by_phase(self, *, skip: int = SKIPPED_STRIDES) -> np.ndarray:
        """Strides by entry into the first phase, on ground too.

        ``skip``: so many strides at the start do not count. Returns first tick of each stride and of the next
        one, shape ``(n_strides, 2)``.
        """
        return self._steady_strides(self.entries)[skip:]

    def _steady_strides(self, events: np.ndarray) -> np.ndarray:
        bounds = stride_bounds(events)
        even = np.zeros(len(bounds), dtype=bool)
        for first, last in self.steady:
            even |= (bounds[:, 0] >= first / self.tick) & (bounds[:, 1] <= last / self.tick)
        return bounds[even]


def leg_record(
    log: LogColumns,
    side: Side,
    phase_names: Sequence[str],
    tick: float,
    *,
    steady: Spans = ALWAYS,
    waiting: np.ndarray | None = None,
    device: bool = False,
) -> LegRecord:
    """Take one leg out of a log.

    ``phase_names``: phases of the table in order; ``steady`` from when to when in [s] the leg walks evenly;
    ``waiting``: whether it waits at each tick for somebody to ask for a step; ``device``: whether the angles
    are the device's where braces let the wearer move against it.
    """
    columns = () if device else log
    angles = {
        joint: np.asarray(log[wearer_column(columns, side, joint, "angle_rad")])
        for joint in driven_joints(log, side)
    }
    on_ground = f"{side}_foot_normal_force_N" in log
    return LegRecord(
        side=side,
        tick=tick,
        phases=phase_indices(log, side, tuple(phase_names)),
        angles=angles,
        normal_force=np.asarray(log[f"{side}_foot_normal_force_N"]) if on_ground else None,
        clearance=np.asarray(log[f"{side}_foot_clearance_m"]) if on_ground else None,
        steady=steady,
        waiting=waiting,
    )


@lru_cache(maxsize=16)  # pandas takes longer to look at the names than at the column
def _phase_type(names: tuple[str, ...]) -> pd.CategoricalDtype:
    return pd.CategoricalDtype(list(names))
