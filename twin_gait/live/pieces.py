"""A live walk in pieces: what the loop hands over every half second, and the walk that the pieces add up to.

The loop keeps nothing of a walk but its last rows. A piece is complete in itself: rows, switches, changes and
how the walk stands, so that the pieces up to any moment are the walk up to that moment.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twin_gait.control import Trip, TripCause
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.simulation.engine import EngineResult
from twin_gait.simulation.run import RunStatus
from twin_gait.vocabulary import JointName, Side


@dataclass(frozen=True)
class AppliedChange:
    """A change as the run folder lists it."""

    tick: int  # first tick with the change
    # who, what, value before and after, by column; a fault in its notation under ``fault``
    note: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Piece:
    """What a walk has added since the piece before."""

    rows: np.ndarray  # of the log, shape ``(n_ticks, n_columns)`` in the order of the layout
    switches: tuple[PhaseSwitch, ...] = ()  # of the phases
    changes: tuple[AppliedChange, ...] = ()  # that were applied
    # mapping of the gait table as it is now, or None if it has never been changed
    table: Mapping[str, Any] | None = None
    status: RunStatus = RunStatus.COMPLETED  # how the walk stands
    reason: str = ""  # why it has ended; empty before that
    trip: Trip | None = None  # what the safety monitor tripped on, or None
    wall_s: float = 0.0  # time since the start of the walk in [s], pauses included
    over: bool = False  # whether it is the last one

    def to_dict(self) -> dict[str, Any]:
        """Everything but the rows, as JSON takes it."""
        changes = [[item.tick, dict(item.note)] for item in self.changes]
        entries = {key: value for key, value in vars(self).items() if key != "rows"}
        return {**entries, "changes": changes, "status": str(self.status)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], rows: np.ndarray) -> Piece:
        """The piece of :meth:`to_dict` with its rows."""
        made: dict[str, Any] = {
            "switches": tuple(PhaseSwitch(item[0], Side(item[1]), *item[2:]) for item in data["switches"]),
            "changes": tuple(AppliedChange(tick, note) for tick, note in data["changes"]),
            "status": RunStatus(data["status"]),
            "trip": None if data["trip"] is None else _trip(*data["trip"]),
        }
        return cls(rows=rows, **{**data, **made})


def _trip(tick: int, cause: str, side: str | None, joint: str | None) -> Trip:
    place = None if side is None else Side(side), None if joint is None else JointName(joint)
    return Trip(tick, TripCause(cause), *place)


@dataclass
class Take:
    """One walk from its start to its end, with what was changed in it."""

    result: EngineResult  # as an engine hands it back
    changes: list[AppliedChange] = field(default_factory=list)  # in order
    # mapping of the gait table at the end, or None if it was not changed
    table: Mapping[str, Any] | None = None
    wall_s: float = 0.0  # time that it took in [s], pauses included


def take_of(pieces: Iterable[Piece], n_columns: int, longest: int) -> Take:
    """Put the pieces of a walk together.

    Returns the walk; one that nothing has ended before its time is marked as interrupted, with the reason.
    """
    rows: list[np.ndarray] = [np.zeros((0, n_columns))]
    switches: list[PhaseSwitch] = []
    changes: list[AppliedChange] = []
    last = Piece(rows=rows[0])
    for piece in pieces:
        rows.append(piece.rows)
        switches += piece.switches
        changes += piece.changes
        last = replace(piece, rows=rows[0])
    log = np.concatenate(rows)
    status, reason = last.status, last.reason
    if status is RunStatus.COMPLETED and len(log) < longest:
        status = RunStatus.INTERRUPTED
        how = "stopped at" if last.over else "the process of the walk died; it is kept up to"
        reason = f"{how} {len(log) * TICK:.3f} s"
    result = EngineResult(log, tuple(switches), status, reason, last.trip)
    return Take(result, changes, last.table, last.wall_s)
