"""Places of a gait table that controls reach."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters
from twin_gait.vocabulary import Side


@dataclass(frozen=True)
class Place:
    """Where in the table a control reaches.

    Attributes:
        phase: Of gait.
        joint: Of the leg.
        side: Of the phases that differ on this side; None for those that both sides share.
    """

    phase: str
    joint: str
    side: Side | None

    @property
    def prefix(self) -> str:
        """Name of the place, with which the names of its controls begin."""
        parts = (self.phase, self.joint) if self.side is None else (self.side, self.phase, self.joint)
        return ".".join(parts)

    def read(self, table: GaitTable) -> JointImpedance:
        """What a table has there."""
        phases = table.phases if self.side is None else table.side_phases[self.side]
        return phases[self.phase].joints[self.joint]

    def write(self, table: GaitTable, impedance: JointImpedance) -> GaitTable:
        """The table with another impedance there."""
        if self.side is None:
            return replace(table, phases={**table.phases, self.phase: self._changed(table.phases, impedance)})
        own = table.side_phases[self.side]
        own = {**own, self.phase: self._changed(own, impedance)}
        return replace(table, side_phases={**table.side_phases, self.side: own})

    def _changed(self, phases: Mapping[str, PhaseParameters], impedance: JointImpedance) -> PhaseParameters:
        phase = phases[self.phase]
        return replace(phase, joints={**phase.joints, self.joint: impedance})


def places(table: GaitTable, sides: tuple[Side, ...]) -> Iterator[Place]:
    """All places of a table.

    Args:
        table: The table.
        sides: Legs that there are; phases that differ on one of them are places of their own.

    Yields:
        The places in the order of phases and joints.
    """
    for phase in table.phases:
        own = [side for side in sides if phase in table.side_phases.get(side, {})]
        for side in (*([None] if len(own) < len(sides) else []), *own):
            for joint in table.joints:
                yield Place(phase, joint, side)
