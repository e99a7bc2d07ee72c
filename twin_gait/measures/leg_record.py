"""Record of one leg: the columns of a log that gait measures read, extracted once."""

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
import pandas as pd

from twin_gait.measures.foot_contact import FootContacts, find_foot_contacts, is_loaded
from twin_gait.measures.phases import phase_beginnings, phase_entries
from twin_gait.measures.strides import SKIPPED_STRIDES, stride_bounds
from twin_gait.vocabulary import JointName, Side


def wearer_column(columns: Container[str], side: Side, joint: JointName, quantity: str) -> str:
    """Return the name of the column of the wearer's own motion, which is the gait.

    Where wearer and device are one body, this is the column of the device's joint. ``quantity``:
    ``angle_rad`` or ``velocity_rad_per_s``.
    """
    column = f"{side}_{joint}_wearer_{quantity}"
    return column if column in columns else f"{side}_{joint}_{quantity}"


def driven_joints(columns: Container[str], side: Side) -> tuple[JointName, ...]:
    """Return the joints of a leg whose motors a log with these columns contains, from proximal to distal."""
    return tuple(joint for joint in JointName if f"{side}_{joint}_motor_torque_Nm" in columns)


def moved_joints(columns: Container[str], side: Side) -> tuple[JointName, ...]:
    """Return the joints of a leg that a drive or the wearer's own gait moves, from proximal to distal."""
    driven = driven_joints(columns, side)
    return tuple(
        joint for joint in JointName if joint in driven or f"{side}_{joint}_own_torque_Nm" in columns
    )


def phase_column(columns: Container[str], side: Side) -> str:
    """Return the column of a leg's phases: of the device or, without a device, of the wearer's own gait."""
    column = f"{side}_phase"
    return column if column in columns else f"{side}_own_phase"


class LogColumns(Protocol):
    """Columns of a log by name, one value a tick: a table or a mapping to arrays."""

    def __len__(self) -> int:
        """Return the number of ticks."""

    def __contains__(self, name: object, /) -> bool:
        """Return whether there is a column."""

    def __getitem__(self, name: str, /) -> Any:
        """Return a column."""


def phase_indices(log: LogColumns, side: Side, phase_names: tuple[str, ...]) -> np.ndarray:
    """Return the phase of a leg at each tick as its index in ``phase_names``, shape ``(n,)``.

    The phases are those of the device or, for a leg without a device, those of the wearer's own gait.
    """
    phases = log[phase_column(log, side)]
    if isinstance(phases, np.ndarray):  # an engine writes indices
        return phases.astype(int)
    return np.asarray(pd.Categorical(phases, dtype=_phase_type(phase_names)).codes, dtype=int)


Spans = tuple[tuple[float, float], ...]  # first and last time in [s] of each span
WHOLE_RUN: Spans = ((0.0, math.inf),)


@dataclass(frozen=True, eq=False)
class LegRecord:
    """Record of one leg over a run."""

    side: Side  # side of the leg
    tick: float  # sampling period in [s]
    phases: np.ndarray  # index of the phase, shape ``(n,)``
    # Angle in [rad] of each joint of the wearer that a drive or the wearer's own gait moves, shape ``(n,)``
    # each; of the device if requested.
    angles: Mapping[JointName, np.ndarray]
    normal_force: np.ndarray | None  # normal force on the foot in [N], shape ``(n,)``, or None without ground
    clearance: np.ndarray | None  # clearance of the foot in [m], shape ``(n,)``, or None without ground
    driven: tuple[JointName, ...] = ()  # joints with a drive, from proximal to distal
    # Start and end in [s] of each span in which the leg walks evenly; strides outside do not count.
    steady: Spans = WHOLE_RUN
    # Whether the legs wait for a step request at each tick, shape ``(n,)``, or None if they never wait.
    waiting: np.ndarray | None = None

    @cached_property
    def walking_ticks(self) -> np.ndarray:
        """Number of ticks before each tick, and before the end, in which the leg did not wait.

        Shape ``(n + 1,)``.
        """
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
        """Whether the foot carries load at each tick, or None without ground."""
        return None if self.normal_force is None else is_loaded(self.normal_force)

    @cached_property
    def contacts(self) -> FootContacts | None:
        """Contacts of the foot, or None without ground."""
        if self.normal_force is None:
            return None
        return find_foot_contacts(self.normal_force, self.tick, self.angles.get(JointName.HIP), self.loaded)

    @cached_property
    def _phase_beginnings(self) -> np.ndarray:
        return phase_beginnings(self.phases)

    def phase_entries(self, phase: int) -> np.ndarray:
        """Return the ticks at which a phase begins, shape ``(n,)``; tick 0 if the leg starts in it."""
        return phase_entries(self.phases, phase, self._phase_beginnings)

    def phase_sequence(self, span: slice) -> np.ndarray:
        """Return the phases of a span of ticks in their order, shape ``(n,)``, without their durations."""
        if span.start >= span.stop:
            return self.phases[:0]
        begun = self._phase_beginnings
        inside = begun[(begun > span.start) & (begun < span.stop)]
        return np.asarray(self.phases[np.append(span.start, inside)])

    @cached_property
    def first_phase_entries(self) -> np.ndarray:
        """Ticks at which the first phase of the table begins, shape ``(n,)``."""
        return self.phase_entries(0)

    @property
    def stride_events(self) -> np.ndarray:
        """Ticks at which strides begin: heel strikes, or entries into the first phase without ground."""
        return self.first_phase_entries if self.contacts is None else self.contacts.heel_strikes

    def strides(self, *, skip: int = SKIPPED_STRIDES) -> np.ndarray:
        """Return the strides by heel strike, or by entry into the first phase without ground.

        ``skip``: number of strides at the start that do not count. Returns the first tick of each stride and
        of the next one, shape ``(n_strides, 2)``.
        """
        return self._strides[skip:]

    def strides_by_phase(self, *, skip: int = SKIPPED_STRIDES) -> np.ndarray:
        """Return the strides by entry into the first phase, on ground too.

        ``skip``: number of strides at the start that do not count. Returns the first tick of each stride and
        of the next one, shape ``(n_strides, 2)``.
        """
        return self._strides_by_phase[skip:]

    @cached_property
    def _strides(self) -> np.ndarray:
        return self._steady_strides(self.stride_events)

    @cached_property
    def _strides_by_phase(self) -> np.ndarray:
        return self._steady_strides(self.first_phase_entries)

    def _steady_strides(self, events: np.ndarray) -> np.ndarray:
        """Return the strides between events that lie within one span of even walking."""
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
    steady: Spans = WHOLE_RUN,
    waiting: np.ndarray | None = None,
    device: bool = False,
) -> LegRecord:
    """Extract one leg from a log.

    ``phase_names``: phases of the table in order; ``steady``: start and end in [s] of each span in which the
    leg walks evenly; ``waiting``: whether the leg waits for a step request at each tick; ``device``: whether
    the angles are those of the device where braces let the wearer move relative to it.
    """
    columns = () if device else log
    angles = {
        joint: np.asarray(log[wearer_column(columns, side, joint, "angle_rad")])
        for joint in moved_joints(log, side)
    }
    on_ground = f"{side}_foot_normal_force_N" in log
    return LegRecord(
        side=side,
        tick=tick,
        phases=phase_indices(log, side, tuple(phase_names)),
        angles=angles,
        normal_force=np.asarray(log[f"{side}_foot_normal_force_N"]) if on_ground else None,
        clearance=np.asarray(log[f"{side}_foot_clearance_m"]) if on_ground else None,
        driven=driven_joints(log, side),
        steady=steady,
        waiting=waiting,
    )


@lru_cache(maxsize=16)  # pandas takes longer to check the names than to convert the column
def _phase_type(names: tuple[str, ...]) -> pd.CategoricalDtype:
    """Return the pandas type of a column of phase names."""
    return pd.CategoricalDtype(list(names))
