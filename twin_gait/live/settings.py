"""What a live session can change, as one frozen value, and the numbers that the loop gets from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters, Scaling
from twin_gait.live.protocol import Value
from twin_gait.network.messages import CODES
from twin_gait.parameters import quantities
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.vocabulary import GaitPhase, JointName, Side

# The step that waits for a hand in manual mode begins where this phase ends.
HELD_PHASE = GaitPhase.LATE_STANCE
# What drives the joints: the gait table, or one of the three controls of the thesis's monitor (2.4).
MODES = WALK, FRICTION, TORQUE, IMPEDANCE = CODES["control"]


@dataclass(frozen=True, kw_only=True)
class MonitorJoint(JointImpedance):
    """What the monitor sets on one joint.

    Attributes:
        target_torque: Added to the virtual spring, in [N m].
    """

    target_torque: quantities.Torque = 0.0


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
    """A table whose phases all have what the monitor sets.

    Friction and torque control have no spring and no damper.
    """
    sides = tuple(dict.fromkeys(side for side, _ in monitor))
    without = {} if mode == IMPEDANCE else {"stiffness": 0.0, "damping": 0.0}
    everywhere = {}
    for side in sides:
        joints = {name: replace(monitor[side, JointName(name)], **without) for name in table.joints}
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
        k, b, zero, gain = problem.phase_rows[leg, 0].tolist()[COLUMNS_PER_JOINT * place :][
            :COLUMNS_PER_JOINT
        ]
        monitor[joint.side, joint.joint] = MonitorJoint(
            stiffness=k, damping=b, equilibrium_angle=zero, friction_compensation_gain=gain,
            target_torque=experiment.control.target_torque.get(joint.joint, 0.0),
        )  # fmt: skip
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


class Place(NamedTuple):
    """Where the controls of a joint reach: into the table, or to what the monitor sets."""

    name: str  # with which those of its controls begin
    path: Sequence[Any]  # of the record in the settings: fields and keys
    joint: str  # of the leg
    side: Side | None  # of the phases that differ on this side, and of the monitor; None for what both share
    leg: Side  # that it reaches
    phase: str | None = None  # of gait; None for the monitor

    def record(self, settings: Settings) -> Any:
        """The impedance there."""
        found: Any = settings
        for step in self.path:
            found = found[step] if isinstance(found, Mapping) else getattr(found, step)
        return found

    def damping(self, problem: Problem) -> float:
        """Damping b in the table in [N m s] / [rad], its ratio resolved."""
        assert self.phase is not None  # it is in the table
        column = COLUMNS_PER_JOINT * problem.table.joints.index(self.joint) + DAMPING
        rows = problem.phase_rows[problem.sides.index(self.leg)]
        return float(rows[problem.table.phase_index(self.phase), column])

    def read(self, name: str, settings: Settings) -> Any:
        """A field of the record."""
        return getattr(self.record(settings), name)

    def write(self, name: str, settings: Settings, value: float) -> Settings:
        """Settings with another value of a field of the record."""
        fields = {name: value} | ({"damping_ratio": None} if name == "damping" else {})
        return replaced(settings, self.path, replace(self.record(settings), **fields))  # type: ignore[no-any-return]


def replaced(record: Any, path: Sequence[Any], value: Any) -> Any:
    """A record with another value deep inside of it, under fields and keys."""
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(record, Mapping):
        return {**record, step: replaced(record[step], rest, value)}
    return replace(record, **{step: replaced(getattr(record, step), rest, value)})


def places(settings: Settings, sides: tuple[Side, ...]) -> Iterator[Place]:
    """All places of the table, in the order of phases and joints, and of the monitor.

    ``sides``: legs that there are; phases that differ on one of them are places of their own.
    """
    table, at = settings.table, ("experiment", "table")
    for phase in table.phases:
        own = [side for side in sides if phase in table.side_phases.get(side, {})]
        common = [side for side in sides if side not in own]
        for joint in table.joints:
            rest = (phase, "joints", joint)
            if common:
                yield Place(f"{phase}.{joint}", (*at, "phases", *rest), joint, None, common[0], phase)
            for side in own:
                path = (*at, "side_phases", side, *rest)
                yield Place(f"{side}.{phase}.{joint}", path, joint, side, side, phase)
    for side, joint in settings.monitor:
        yield Place(f"monitor.{side}.{joint}", ("monitor", (side, joint)), joint, side, side)
