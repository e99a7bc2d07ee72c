"""What a live session can change, as one frozen value, and the numbers that the loop gets from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters, Scaling
from twin_gait.live.protocol import Value
from twin_gait.network.messages import CODES
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.vocabulary import GaitPhase, JointName, Side

# The step that waits for a hand in manual mode begins where this phase ends.
HELD_PHASE = GaitPhase.LATE_STANCE


# What drives the joints: the gait table, or one of the three controls of the thesis's monitor (2.4).
MODES = WALK, FRICTION, TORQUE, IMPEDANCE = CODES["control"]


@dataclass(frozen=True)
class MonitorJoint:
    """What the monitor sets on one joint."""

    stiffness: float  # k in [N m] / [rad]
    damping: float  # b in [N m s] / [rad]
    equilibrium_angle: float  # θ0 in [rad]
    friction_compensation_gain: float  # g
    target_torque: float = field(default=0.0, kw_only=True)  # in [N m]

    def impedance(self, mode: str) -> JointImpedance:
        """The impedance that a mode asks for; friction and torque control have no spring and no damper."""
        springs = mode == IMPEDANCE
        return JointImpedance(
            stiffness=self.stiffness if springs else 0.0,
            damping=self.damping if springs else 0.0,
            equilibrium_angle=self.equilibrium_angle,
            friction_compensation_gain=self.friction_compensation_gain,
        )


MonitoredJoints = Mapping[tuple[Side, JointName], MonitorJoint]
LoopNumbers = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything that the controls of a live session set."""

    experiment: Experiment  # with the gait table, belt speed and support as they are now
    monitor: MonitoredJoints  # what the monitor sets, for every actuated joint
    mode: str = WALK  # what drives the joints, of ``MODES``
    manual: bool = False  # whether every step waits for a hand
    # values of the controls that have been set, by name, in their units; what none has set is the preset's
    changes: Mapping[str, Value] = field(default_factory=dict)

    @property
    def table(self) -> GaitTable:
        """The gait table, before scaling."""
        return self.experiment.table

    @property
    def driving(self) -> Experiment:
        """The experiment with the impedances that the mode puts in force."""
        if self.mode == WALK:
            return self.experiment
        return replace(self.experiment, table=monitored_table(self.table, self.monitor, self.mode))

    def target_torque(self, side: Side, joint: JointName) -> float:
        """Target torque of a joint in [N m]: the experiment's, or in torque control the monitor's."""
        if self.mode == TORQUE:
            return self.monitor[side, joint].target_torque
        return self.experiment.control.target_torque.get(joint, 0.0) if self.mode == WALK else 0.0


def monitored_table(table: GaitTable, monitor: MonitoredJoints, mode: str) -> GaitTable:
    """A table whose phases all have what the monitor sets."""
    sides = tuple(dict.fromkeys(side for side, _ in monitor))
    everywhere = {}
    for side in sides:
        joints = {name: monitor[side, JointName(name)].impedance(mode) for name in table.joints}
        everywhere[side] = dict.fromkeys(table.phases, PhaseParameters(joints=joints))
    own = everywhere if len(sides) > 1 else {}
    return replace(table, phases=everywhere[sides[0]], side_phases=own, scaling=Scaling())


def first_settings(experiment: Experiment) -> Settings:
    """Settings of a session that begins: those of the experiment.

    The monitor begins with what the first phase of the table has, so that a wearer who stands goes on
    standing in impedance control.
    """
    problem = build_problem(experiment)
    monitor = {}
    for number, joint in enumerate(problem.joints):
        leg, place = divmod(number, problem.joints_per_leg)
        first = COLUMNS_PER_JOINT * place
        row = problem.phase_rows[leg, 0, first : first + COLUMNS_PER_JOINT].tolist()
        target = experiment.control.target_torque.get(joint.joint, 0.0)
        monitor[joint.side, joint.joint] = MonitorJoint(*row, target_torque=target)
    return Settings(experiment=experiment, monitor=monitor)


def loop_numbers(settings: Settings) -> LoopNumbers:
    """Lay settings out as the loop takes them: numbers, table scaled and damping ratios resolved."""
    walk, walking = build_problem(settings.experiment), settings.mode == WALK
    driven = walk if walking else build_problem(settings.driving)
    world, pelvis = walk.world, walk.world.model.pelvis_index
    return {
        # k, b, θ0, G per joint and gravity share, by leg and phase
        "phase_rows": driven.phase_rows.tolist(),
        "comparisons": [asdict(comparison) for comparison in walk.program.comparisons],
        "target_torque": [settings.target_torque(item.side, item.joint) for item in walk.joints],  # [N m]
        # [m] / [s]; without a gait the belt would carry the feet away
        "belt_speed": world.belt.cruise if walking else 0.0,
        # [N]; None where no pelvis hangs
        "support_force": None if pelvis is None else world.plant[pelvis + world.wearer_shift].spring.force,
        "held_phase": walk.table.phase_index(HELD_PHASE) if settings.manual else None,  # waits for a hand
        "watching": walking,  # whether the monitor watches how long a leg stays in a phase
    }


@dataclass(frozen=True)
class Place:
    """Where a control of a joint reaches: into the table, or to what the monitor sets."""

    phase: str  # of gait; empty for the monitor
    joint: str  # of the leg
    side: Side | None  # of the phases that differ on this side; None for those that both sides share
    leg: Side  # that it reaches

    @property
    def prefix(self) -> str:
        """Name of the place, with which the names of its controls begin."""
        parts = (self.side, self.phase) if self.phase else ("monitor", self.side)
        return ".".join(filter(None, (*parts, self.joint)))

    def _phases(self, table: GaitTable) -> Mapping[str, PhaseParameters]:
        return table.phases if self.side is None else table.side_phases[self.side]

    def record(self, settings: Settings) -> Any:
        """The impedance there, or what the monitor has."""
        if not self.phase:
            return settings.monitor[self.side, self.joint]  # type: ignore[index]
        return self._phases(settings.table)[self.phase].joints[self.joint]

    def damping(self, problem: Problem) -> float:
        """Damping b in the table in [N m s] / [rad], its ratio resolved."""
        column = COLUMNS_PER_JOINT * problem.table.joints.index(self.joint) + DAMPING
        rows = problem.phase_rows[problem.sides.index(self.leg)]
        return float(rows[problem.table.phase_index(self.phase), column])

    def read(self, name: str, settings: Settings) -> Any:
        """A field of it."""
        return getattr(self.record(settings), name)

    def write(self, name: str, settings: Settings, value: float) -> Settings:
        """Settings with another value of a field of it."""
        record, ratio = self.record(settings), f"{name}_ratio"
        fields = {name: value} | ({ratio: None} if hasattr(record, ratio) else {})
        joint: Any = replace(record, **fields)
        table: GaitTable = settings.table
        if not self.phase:
            monitor: dict[Any, MonitorJoint] = {**settings.monitor, (self.side, self.joint): joint}
            return replace(settings, monitor=monitor)
        phases = self._phases(table)
        phase = phases[self.phase]
        changed = {**phases, self.phase: replace(phase, joints={**phase.joints, self.joint: joint})}
        if self.side is None:
            table = replace(table, phases=changed)
        else:
            table = replace(table, side_phases={**table.side_phases, self.side: changed})
        return replace(settings, experiment=replace(settings.experiment, table=table))


def places(table: GaitTable, sides: tuple[Side, ...]) -> Iterator[Place]:
    """All places of a table.

    ``sides``: legs that there are; phases that differ on one of them are places of their own. Yields the
    places in the order of phases and joints.
    """
    for phase in table.phases:
        own = [side for side in sides if phase in table.side_phases.get(side, {})]
        common = [side for side in sides if side not in own]
        for side, leg in (*((None, leg) for leg in common[:1]), *((side, side) for side in own)):
            for joint in table.joints:
                yield Place(phase, joint, side, leg)
