"""What all worlds have in common for the rest of the program, which knows none of them by name."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, NamedTuple, Self

from twin_gait.core.belt import Belt
from twin_gait.core.plant import Plant
from twin_gait.leg_model import LegModel
from twin_gait.parameters import ContactParameters
from twin_gait.parameters.quantities import Angle, Parameters, UnitInside
from twin_gait.vocabulary import JointName, PelvisGuide, Side, Surroundings
from twin_gait.worlds.world import World

Posture = Annotated[Mapping[JointName, Angle], UnitInside()]  # angles of the joints of a leg in [rad]


def starting_at(hip: float, knee: float) -> Any:
    """A field of a world that has angles of hip and knee in [deg] for a default."""
    angles = {JointName.HIP: math.radians(hip), JointName.KNEE: math.radians(knee)}
    return field(default_factory=angles.copy)


# Names of adjustments that tuning and comparing ask a world for.
BELT_SPEED, SUPPORT_SHARE = "belt_speed", "support_share"


@dataclass(frozen=True, kw_only=True)
class Walking:
    """Walking on ground, where a world has some."""

    speed: float  # Over the ground in [m] / [s].
    support_share: float = 0.0  # Share of the weight of wearer and device that ropes carry.
    slope: float = 0.0  # By which the ground rises forwards in [rad].
    contact: ContactParameters = field(default_factory=ContactParameters)  # Of heels and toes.
    # What sets the speed of the ground; one at rest for ground that stays.
    belt: Belt = field(default_factory=Belt)

    @property
    def carried_share(self) -> float:
        """Share of the weight that the legs carry."""
        return 1.0 - self.support_share


class Adjustment(NamedTuple):
    """A number of a world that others may set: a live session, a search for a table, another day.

    A walk that is under way takes over what follows of belt speed, support force and scaled gait table.
    """

    name: str  # Of the control in a live session.
    value: float  # Present value in SI.
    place: str  # Of the number in the world, such as ``support.share``.
    key: str  # In a file, below ``scenario``.
    label: str  # In words.
    least: float  # Least value, in ``unit``.
    largest: float  # Largest value, in ``unit``.
    step: float  # Of the control, in ``unit``.
    help: str  # One sentence.
    unit: str = ""  # Of the control.
    scale: float = 1.0  # SI value of one unit.

    @property
    def shown(self) -> float:
        """Present value in the unit."""
        return self.value / self.scale

    @classmethod
    def of_support(cls, share: float, place: str, ropes: str) -> Self:
        """Of the share of the weight that something carries, at a place in a world and in its file."""
        return cls(
            name=SUPPORT_SHARE,
            value=share,
            place=place,
            key=place,
            label="body-weight support",
            least=0.0,
            largest=1.0,
            step=0.01,
            help=f"Share of the weight of wearer and device that the {ropes}.",
        )


@dataclass(frozen=True, kw_only=True)
class Scenario(Parameters, ABC):
    """A world with its parameters: the abstract base of all worlds.

    A new world is a frozen dataclass of its own in a module of this package, or in another package under the
    entry point ``twin_gait.worlds``. What it leaves out is as for legs in the air: no ground, nothing to
    adjust, told to walk all the time.

    Attributes:
        kind: Name of the world in files.
        step: Of the compiled engine in [s] where none is asked for.
        surroundings: What is drawn around the figure.
    """

    step: ClassVar[float] = 1e-3
    surroundings: ClassVar[Surroundings] = Surroundings.FLOOR

    @property
    @abstractmethod
    def pelvis(self) -> PelvisGuide:
        """How the pelvis is held."""

    @abstractmethod
    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        """Put a model into the world.

        Args:
            model: The legs, with a pelvis that is held as the world has it.
            plant: Friction, stops and ankle springs of every coordinate; what else acts may be added.
            ankle_rest: Angle in [rad] at which the orthosis gives no torque.
            gravity: In [m] / [s²].

        Returns:
            The world.

        Raises:
            ParameterError: If the model does not fit.
        """

    @abstractmethod
    def starting_in(self, postures: Mapping[Side, Posture]) -> Self:
        """The same world with legs that start in other postures."""

    def leading_of(self, sides: Sequence[Side]) -> Side:
        """Leg with which a cycle begins; the other is half a cycle behind."""
        return sides[0]

    def without_aids(self) -> Self | None:
        """The same world for hands that hold nothing; None where they hold nothing anyway."""
        return None

    @property
    def walking(self) -> Walking | None:
        """How legs walk on the ground; None in the air."""
        return None

    @property
    def grounded(self) -> bool:
        """Whether feet meet ground, and sensors in them the load."""
        return self.walking is not None

    @property
    def steady(self) -> tuple[float, float]:
        """From when to when in [s] the legs are to walk evenly."""
        return (0.0, math.inf)

    @property
    def adjustments(self) -> tuple[Adjustment, ...]:
        """What may be set to another value, in the order in which a page shows it."""
        return ()

    def adjusts(self, *names: str) -> bool:
        """Whether there are adjustments of some names."""
        return {*names} <= {item.name for item in self.adjustments}

    def adjusted(self, name: str, value: float) -> Self:
        """The same world with another value of an adjustment, in SI."""
        place = next(item.place for item in self.adjustments if item.name == name)
        changed: Self = _with_value(self, place, value)
        return changed


def _with_value(parameters: Any, place: str, value: float) -> Any:
    first, _, rest = place.partition(".")
    inner = _with_value(getattr(parameters, first), rest, value) if rest else value
    return replace(parameters, **{first: inner})
