"""Gait table: impedances of each phase, and transitions between phases, as data.

It contains the only copy of every threshold: state machine, engines, replay, checks, diagrams and tests read
it. Angles are in [rad] and times in ticks of 1 ms; :mod:`twin_gait.configuration` converts them to the units
of a YAML file and back.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Annotated, ClassVar

from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import LEG_VOCABULARY, AllOf, Atom, Guard, GuardVocabulary, atoms
from twin_gait.gait.signals import LEFT, OTHER, RIGHT, find_signal
from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import PRE_SWING, CodedEnum, Side

TICK = 1e-3  # Control period of the firmware in [s] (thesis, section 2.1.2).
MAX_TICKS = 3_600_000  # Longest time in a table in ticks: an hour, the longest run.
TICKS = quantities.Range(1, MAX_TICKS, words=f"1 to {MAX_TICKS} (an hour, the longest run)")
DURATIONS = quantities.integer_range(0, MAX_TICKS, "an hour, the longest run")
ALWAYS_TRUE = AllOf(guards=())  # Guard of a transition that depends on time alone.
BLENDING_TICKS = quantities.integer_range(0, 10_000, "10 s, longer than any phase of gait")
MAX_PHASES = 62  # A membership of the other leg's phase is a bit mask in a signed 64-bit integer.


def raise_if(condition: object, text: str) -> None:
    """Raise a GaitTableError with a text if a condition is true."""
    if condition:
        raise GaitTableError(text)


class BlendingLaw(CodedEnum):
    """Law of the blending; ``code``: number of the law in :mod:`twin_gait.core.blending`."""

    NONE = "none"
    LINEAR = "linear"
    MINIMUM_JERK = "minimum_jerk"


@dataclass(frozen=True, kw_only=True)
class Blending(quantities.Parameters):
    """Blending of k, b, θ0, G and the gravity share when a phase is entered.

    Attributes:
        law: Share of the new parameters over time: a step, a line or the minimum-jerk polynomial.
        duration_ticks: Length of the blending in ticks.
    """

    law: BlendingLaw = BlendingLaw.MINIMUM_JERK
    duration_ticks: Annotated[int, BLENDING_TICKS, quantities.Key("duration_ms")] = 60


# A virtual spring acts through the gear, which is a spring itself (CSF-25 at low torque).
STIFFNESSES = quantities.Range(0.0, 3.1e4, reason="the stiffness of the gear in series, 541 N·m/deg")
MASSES = quantities.Range(1.0, 200.0, reason="the heaviest wearer with device and load")
SPEEDS = quantities.Range(0.01, 10.0, reason="slower speeds are no walk")
HEIGHTS = quantities.Range(0.5, 2.5, reason="the height of a person")
EXPONENTS = quantities.Range(-3.0, 3.0)
RATIOS = quantities.Range(
    0.0,
    10.0,
    exclusive_minimum=True,
    reason="a joint without damping oscillates; if that is intended: damping_Nms_per_rad: 0",
)


@dataclass(frozen=True, kw_only=True)
class JointImpedance(quantities.Parameters):
    """Impedance of one joint in one phase, with torque −[k (θ − θ0) + b ω].

    Exactly one of damping and damping ratio is given.

    Attributes:
        stiffness: Stiffness k in [N·m/rad].
        equilibrium_angle: Equilibrium angle θ0 in [rad].
        friction_compensation_gain: Gain G of the friction compensation, 0 to 1.
        damping: Damping b in [N·m·s/rad], or None.
        damping_ratio: Damping ratio ζ, or None; b = 2 ζ √(k I) is resolved when the experiment is built.
    """

    stiffness: Annotated[quantities.RotaryStiffness, STIFFNESSES]
    equilibrium_angle: Annotated[quantities.Angle, quantities.Key("equilibrium")]
    friction_compensation_gain: Annotated[quantities.Ratio, quantities.SHARE]
    damping: Annotated[quantities.RotaryDamping | None, quantities.NOT_NEGATIVE] = None
    damping_ratio: Annotated[quantities.Ratio | None, RATIOS] = None

    def __post_init__(self) -> None:
        """Check the ranges, and that exactly one of damping and damping ratio is given."""
        super().__post_init__()
        one = (self.damping is None) != (self.damping_ratio is None)
        given = f"damping {self.damping}, damping_ratio {self.damping_ratio}"
        require(one, "damping", "exactly one of damping and damping_ratio", given)


@dataclass(frozen=True, kw_only=True)
class StateParameters(quantities.Parameters):
    """Common parameters of every phase of a state machine.

    Attributes:
        minimum_ticks: Minimum duration in ticks; no transition leaves the phase earlier.
    """

    minimum_ticks: Annotated[int, DURATIONS, quantities.Key("minimum_duration_ms")] = 0


@dataclass(frozen=True, kw_only=True)
class PhaseParameters(StateParameters):
    """Parameters of one phase of gait.

    Attributes:
        joints: Impedance per joint name.
        gravity_compensation: Share of the leg's gravity torque that is compensated.
        blending_ticks: Length of the blending into the phase in ticks; None for the length in the table.
    """

    joints: Annotated[Mapping[str, JointImpedance], quantities.CustomSerialized(), quantities.Inline()]
    gravity_compensation: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    blending_ticks: Annotated[int | None, BLENDING_TICKS, quantities.Key("blending_ms")] = None


class DrivenBy(StrEnum):
    """Cause of the motion of a leg towards an exit."""

    JOINT = "joint"
    """Balance of impedance, gravity and friction of the joint itself."""
    CONTACT = "contact"
    """Force of the ground or belt, or motion of the other leg or of a joint that the wearer moves."""


@dataclass(frozen=True, kw_only=True)
class Transition(quantities.Parameters):
    """One entry of the transition list.

    Attributes:
        source: Phase that is left.
        target: Phase that is entered.
        cause: Reason for the transition, in one word; recorded with every switch.
        guard: Condition; an empty ``AllOf`` for a pure timeout.
        debounce_ticks: Number of consecutive ticks for which the guard must be true; the transition is taken
            in the last of them.
        timeout_ticks: Time in the phase in ticks, before which the transition is not taken, or None. Without
            a guard, the transition is a timeout.
        driven_by: Cause of the leg's motion towards this exit; used by checks only.
    """

    source: Annotated[str, quantities.Key("from")]
    target: Annotated[str, quantities.Key("to")]
    cause: str
    guard: Annotated[Guard, quantities.CustomSerialized()] = ALWAYS_TRUE
    debounce_ticks: Annotated[int, TICKS, quantities.Key("debounce_ms")] = 1
    timeout_ticks: Annotated[int | None, TICKS, quantities.CustomSerialized()] = None
    driven_by: DrivenBy = DrivenBy.JOINT

    def __post_init__(self) -> None:
        """Check the ranges, and that there is a condition."""
        super().__post_init__()
        name = f"{self.source} → {self.target} ({self.cause})"
        empty = self.timeout_ticks is None and self.guard == ALWAYS_TRUE
        raise_if(empty, f"transition {name}: has no condition; give all, any or after_s")

    @property
    def is_timeout(self) -> bool:
        """Whether the transition depends on the time in the phase alone."""
        return self.timeout_ticks is not None and self.guard == ALWAYS_TRUE

    @cached_property
    def atoms(self) -> tuple[Atom, ...]:
        """Comparisons and memberships of the guard."""
        return tuple(atoms(self.guard))


@dataclass(frozen=True, kw_only=True)
class Scaling(quantities.Parameters):
    """Laws that adapt a table to wearer, support and speed; each is off if its reference is None.

    :func:`twin_gait.gait.scaling.scale_table` applies them and states their equations.

    Attributes:
        carried_mass: Reference of the carried mass in [kg].
        carried_mass_exponent: Exponent α; with 1 the leg yields as far as with the reference load.
        stance_phases: Phases whose stiffness scales with the carried mass.
        speed: Reference of the belt speed in [m/s].
        speed_exponent: Exponent β; above 0 the steps are shorter on a slower belt.
        height: Reference of the wearer's height in [m].
        height_exponent: Exponent γ; with -1 longer legs make steps of the same length.
        hip_centre: Centre θ_c of the hip's excursion in [rad].
    """

    carried_mass: Annotated[quantities.Mass | None, MASSES] = None
    carried_mass_exponent: Annotated[quantities.Ratio, EXPONENTS] = 1.0
    stance_phases: tuple[str, ...] = ()
    speed: Annotated[quantities.Speed | None, SPEEDS] = None
    speed_exponent: Annotated[quantities.Ratio, EXPONENTS] = 0.0
    height: Annotated[quantities.Length | None, HEIGHTS] = None
    height_exponent: Annotated[quantities.Ratio, EXPONENTS] = 0.0
    hip_centre: quantities.Angle = 0.0


@dataclass(frozen=True, kw_only=True)
class Waiver(quantities.Parameters):
    """Acceptance of a warning of the check for a table, with a reason.

    Attributes:
        rule: Id of the rule.
        reason: Reason why the warning is no mistake of the table.
        phase: Phase to which the waiver is limited; None for all.
        transition: Cause of the transitions to which the waiver is limited; None for all.
    """

    rule: str
    reason: str
    phase: str | None = None
    transition: str | None = None


@dataclass(frozen=True, kw_only=True)
class StateTable:
    """State machine of a leg or of the supervisor, as data: its phases and the transitions between them."""

    name: str  # Name of the table.
    joints: tuple[str, ...]  # Names of the joints, in the order of the parameter arrays.
    # Phases by name, in the order of the cycle; the machine starts in the first one.
    phases: Mapping[str, StateParameters]
    # Transitions in order of priority: of those that are due, the first one in the list is taken.
    transitions: tuple[Transition, ...]
    description: str = ""  # Purpose of the table and sources of its numbers.
    waivers: tuple[Waiver, ...] = ()  # Warnings of the check that are accepted for the table.

    vocabulary: ClassVar[GuardVocabulary] = LEG_VOCABULARY  # Vocabulary of its guards.
    kind: ClassVar[str] = "phase"  # Name of a state in messages; with an s, the key of a file.

    def __post_init__(self) -> None:
        """Check that the table is complete and consistent; :mod:`twin_gait.checking` checks its logic."""
        for name in self.joints:
            # A signal is named joint.quantity, with the prefix "other.", "left." or "right." for another leg.
            odd = not re.fullmatch(r"[A-Za-z_]\w*", name) or f"{name}." in (OTHER, LEFT, RIGHT)
            raise_if(odd, f"joints: expected a name of letters, digits and '_', got {name!r}")
        some = len(set(self.joints)) == len(self.joints) > 0
        given = ", ".join(self.joints) or "none"
        raise_if(not some, f"joints: expected one or more names, each only once, got {given}")
        count = len(self.phases)
        raise_if(not 0 < count <= MAX_PHASES, f"{self.kind}s: expected 1 to {MAX_PHASES}, got {count}")
        self._check_phases()
        for index, transition in enumerate(self.transitions):
            self._check_transition(f"transitions[{index}] ({transition.cause})", transition)

    def _check_phases(self) -> None:
        """Check that the settings of the phases are consistent."""

    def _check_known(self, location: str, *phases: str) -> None:
        for phase in phases:
            if phase not in self.phases:
                known = ", ".join(self.phases)
                problem = f"there is no {self.kind} {phase!r}; expected one of {known}"
                raise GaitTableError(f"{location}: {problem}")

    def _check_transition(self, location: str, item: Transition) -> None:
        self._check_known(location, item.source, item.target)
        problem = f"{location}: leads from {item.source} to itself; expected two different {self.kind}s"
        raise_if(item.source == item.target, problem)
        for atom in item.atoms:
            problem = self.vocabulary.find_problem(atom, self.joints, self.members)
            if problem:
                raise GaitTableError(f"{location}: guard '{atom}': {problem}")
        after, minimum = item.timeout_ticks or MAX_TICKS, self.phases[item.source].minimum_ticks
        early = f"after_s {after * TICK:g} is below the minimum_duration_ms {minimum} of {item.source}"
        raise_if(after < minimum, f"{location}: {early}")

    @cached_property
    def phase_names(self) -> tuple[str, ...]:
        """Names of the phases in the order of the cycle."""
        return tuple(self.phases)

    def phase_index(self, phase: str) -> int:
        """Return the index of a phase in :attr:`phase_names`; raise GaitTableError for an unknown phase."""
        self._check_known("phase", phase)
        return self.phase_names.index(phase)

    @property
    def signals(self) -> tuple[str, ...]:
        """All signals that the guards may read; their indices are those in the guard program."""
        return self.vocabulary.signals(self.joints)

    @cached_property
    def members(self) -> tuple[str, ...]:
        """Names that a guard may test for membership: phases of the other leg, or requests."""
        return self.phase_names

    def member_index(self, name: str | None) -> int:
        """Return the index of a name in :attr:`members`, or -1 for None.

        Raises GaitTableError if the name is unknown.
        """
        unknown = name is not None and name not in self.members
        expected = f"expected one of {', '.join(self.members) or 'none'}"
        raise_if(unknown, f"there is no {self.vocabulary.member} {name!r}; {expected}")
        return -1 if name is None else self.members.index(name)

    def to_si(self, signals: Mapping[str, float]) -> list[float]:
        """Convert signals from the units of a table to a list in SI, in the order of :attr:`signals`.

        Signals that are missing in the argument have their initial values.
        """
        declared = {name: find_signal(name) for name in self.signals}
        values = ((signals.get(name), item) for name, item in declared.items())
        return [item.initial_value if value is None else item.unit.factor * value for value, item in values]

    @property
    def externally_entered(self) -> tuple[str, ...]:
        """Phases that are entered by an external command, and may also be left by one."""
        return ()


@dataclass(frozen=True, kw_only=True)
class GaitTable(StateTable):
    """Impedances of each phase and transitions between phases, with blending and scaling."""

    phases: Mapping[str, PhaseParameters]  # Parameters of each phase, in the order of the cycle.
    blending: Blending = field(default_factory=Blending)  # Blending of the parameters at a phase switch.
    # Parameters that differ on one side (hemiparesis).
    side_phases: Mapping[Side, Mapping[str, PhaseParameters]] = field(default_factory=dict)
    scaling: Scaling = field(default_factory=Scaling)  # Laws that scale the table.
    # Intended cycles of phases; empty if the cycle consists of all phases in their order.
    cycles: tuple[tuple[str, ...], ...] = ()
    postures: tuple[str, ...] = ()  # Phases that a supervisor may command for both legs.

    def _check_phases(self) -> None:
        named = {"scaling.stance_phases": self.scaling.stance_phases, "postures": self.postures}
        named |= {f"cycles[{index}]": cycle for index, cycle in enumerate(self.cycles)}
        named |= {f"sides.{side}": tuple(phases) for side, phases in self.side_phases.items()}
        for location, phases in named.items():
            self._check_known(location, *phases)
        for index, cycle in enumerate(self.cycles):
            short = len(set(cycle)) < max(2, len(cycle))
            raise_if(short, f"cycles[{index}]: expected two or more different phases, got {', '.join(cycle)}")
        joints = ", ".join(self.joints)
        for side in (self.phases, *self.side_phases.values()):
            for phase, parameters in side.items():
                given = ", ".join(parameters.joints) or "none"
                problem = f"phases.{phase}: expected one impedance for each of {joints}, got {given}"
                raise_if(set(parameters.joints) != set(self.joints), problem)

    @property
    def externally_entered(self) -> tuple[str, ...]:
        """Phases that are entered by an external command, and may also be left by one."""
        return self.postures

    def is_swing(self, phase: str) -> bool:
        """Check whether a phase is a swing phase, by its name and by the stance phases in ``scaling``."""
        return "swing" in phase.lower() and phase not in (PRE_SWING, *self.scaling.stance_phases)

    def blend_ticks(self, phase: PhaseParameters) -> int:
        """Return the length of the blending into a phase in ticks; 0 if its parameters change in a step."""
        if self.blending.law is BlendingLaw.NONE:
            return 0
        return self.blending.duration_ticks if phase.blending_ticks is None else phase.blending_ticks

    def phases_of(self, side: Side) -> Mapping[str, PhaseParameters]:
        """Return the parameters of all phases on one side; those in :attr:`side_phases` take precedence."""
        return {**self.phases, **self.side_phases.get(side, {})}
