"""Common interface of all worlds.

The engines read a :class:`World`: a model, the forces on it and its initial state. All other parts of the
program read the parameters of a world through the interface :class:`Scenario`, so that none of them depends
on a particular world.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from twin_gait.core.arms import Arm
from twin_gait.core.belt import Belt
from twin_gait.core.contact import Ground
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.plant import Brace, Harness, ImposedMotion, Plant, Seat, Spring, Trunk
from twin_gait.leg_model.anthropometry import ManufacturedSizes
from twin_gait.leg_model.attachments import Attachment
from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.environment import ContactParameters
from twin_gait.parameters.quantities import (
    POSITIVE,
    Angle,
    Inline,
    Mass,
    Parameters,
    Range,
    Ratio,
    UnitInKeys,
    declarations,
    from_attributes,
    require,
)
from twin_gait.vocabulary import Environment, JointName, PelvisGuide, Side
from twin_gait.worlds.arm_policy import ArmPolicy, Perception

FOOT_SHARES = Range(0.5, 1.0, reason="a foot touches the ground from its heel to its toes")


@dataclass(frozen=True, kw_only=True)
class LegSource(Parameters):
    """Source of the leg model.

    Attributes:
        urdf: Path of a URDF, or the name of a packaged one.
        legs: Joint names per side.
        fit_device: Whether to fit femur, tibia, waist and foot to the wearer.
        sizes: Sizes in which the device is made; none for a device that is made to measure, with the lengths
            of the wearer.
        heel_to_forefoot: Distance from the heel to the forefoot, the points of a foot that touch the ground,
            as a share of the length of the wearer's foot; the heel stays where it is. None leaves them as the
            URDF draws them, for `twin` and `body` 0.83 (an assumption). gait2d has 0.77 (0.21 m at 1.80 m);
            from the end of the heel to the ball of the foot it is 0.74 (ANSUR II: 194.75 of 263.03 mm, 6068
            soldiers).
        driven_sides: Legs of the device, or none if it has all legs of the URDF.
        attachment: Parts of the device on the segments of the wearer, in addition to the links of the URDF.
        up_axis: Vertical axis of the URDF, ``"z"`` or ``"y"``.
        heaviest_wearer: Largest mass of the wearers for whom the device is made, in [kg]; None if it is not
            known. A heavier wearer is simulated, with a note.
    """

    urdf: str
    legs: Annotated[Mapping[Side, LegJoints], Inline()] = field(default_factory=dict)
    fit_device: bool = True
    sizes: ManufacturedSizes | None = None
    heel_to_forefoot: Annotated[Ratio | None, FOOT_SHARES] = None
    driven_sides: tuple[Side, ...] = ()
    attachment: Attachment = field(default_factory=Attachment)
    up_axis: Literal["y", "z"] = "z"
    heaviest_wearer: Annotated[Mass | None, POSITIVE] = None

    def __post_init__(self) -> None:
        """Check that there is at least one leg."""
        super().__post_init__()
        require(bool(self.legs), "legs", "the joint names of left, right or both legs", "none")
        fitted = self.fit_device or self.heel_to_forefoot is None
        require(fitted, "heel_to_forefoot", "null for feet that are not fitted", self.heel_to_forefoot)
        ordered = tuple(side for side in self.legs if side in self.driven_sides)
        known = f"one or more of {', '.join(self.legs)}, in this order"
        require(self.driven_sides == ordered, "driven_sides", known, ", ".join(self.driven_sides))


@dataclass(frozen=True, kw_only=True)
class BracedModels:
    """Device and wearer as separate models, each with all coordinates, and the braces between them.

    Attributes:
        device: Model of links and rotors of the device.
        wearer: Model of the wearer's segments.
        braces: Brace between the two coordinates of each joint, in the order of the coordinates.
    """

    device: LegModel
    wearer: LegModel
    braces: tuple[Brace, ...]


@dataclass(frozen=True, kw_only=True)
class World:
    """Leg model in its surroundings, with all data that an engine needs to integrate it.

    The number n of coordinates is ``nv`` of the model. With braces it is twice ``nv``: the coordinates of the
    device are followed by those of the wearer.

    Attributes:
        model: Model of the legs; with braces, of device and wearer as one body.
        plant: Friction, stops, springs and forces on each of the n coordinates.
        belt: Speed profile of the treadmill; a belt at rest on the bench.
        contact: Contact parameters, or None without ground.
        slope: Angle by which the ground rises forwards, about the origin, in [rad].
        start_q: Coordinates at time 0, shape ``(n,)``.
        start_v: Velocities at time 0, shape ``(n,)``.
        initial_phases: Phase of each leg at time 0.
        support_force: Constant upward force on the pelvis in [N].
        lock_stiffness: Stiffness in [N/m] of the harness after a trip has locked it; 0 without a harness.
        lock_dissipation: Dissipation of the locked harness in [s/m].
        body_weight: Weight of wearer and device in [N].
        fall_height: Pelvis height in [m] below which the wearer has fallen.
        imposed_motion: Imposed motion of a joint of the device, or None.
        contact_frames: Frames of each leg that touch the ground.
        braces: Braces between wearer and device, or None if they are one body.
        trunk: Trunk of a wearer whose pelvis pitches, or None.
        arms: Arms that hold a crutch, by side; the coordinates of their tips follow all others.
        policy: Law by which the wearer uses the crutches, or None.
        perception: State of the wearer's delayed perception at time 0, or None.
        fall_pitch: Pitch of the trunk in [rad], beyond which the wearer has fallen.
        max_reach: Longest reach of arm and crutch in [m].
        seat: Seat of a chair, or None.
    """

    model: LegModel
    plant: tuple[Plant, ...]
    start_q: np.ndarray
    start_v: np.ndarray
    initial_phases: Mapping[Side, str | None]
    belt: Belt = field(default_factory=Belt)
    contact: ContactParameters | None = None
    slope: float = 0.0
    support_force: float = 0.0
    lock_stiffness: float = 0.0
    lock_dissipation: float = 0.0
    body_weight: float = 0.0
    fall_height: float = -math.inf
    imposed_motion: ImposedMotion | None = None
    contact_frames: Mapping[Side, tuple[str, ...]] = field(default_factory=dict)
    braces: BracedModels | None = None
    trunk: Trunk | None = None
    arms: tuple[Arm, ...] = ()
    policy: ArmPolicy | None = None
    perception: Perception | None = None
    fall_pitch: float = math.inf
    max_reach: float = math.inf
    seat: Seat | None = None

    @property
    def chains(self) -> tuple[LegModel, ...]:
        """Models in the order of their coordinates; feet and body-weight support belong to the last one."""
        return (self.model,) if self.braces is None else (self.braces.device, self.braces.wearer)

    def support(self, pelvis: int) -> Spring | Harness:
        """Return the part with the force of the body-weight support; ``pelvis``: index of its height."""
        return self.plant[pelvis + self.wearer_offset].spring if self.trunk is None else self.trunk.harness

    def ground(self) -> Ground:
        """Return the ground under the feet, with the belt at its cruise speed.

        Without contact parameters, the force of the ground is always zero.
        """
        if self.contact is None:
            return Ground()
        sine, cosine = sine_cosine(self.slope)
        stiffness, dissipation = self.contact.forefoot
        forefoot = {"forefoot_stiffness": stiffness, "forefoot_dissipation": dissipation}
        slope = {"slope_sine": sine, "slope_cosine": cosine}
        return from_attributes(Ground, self.contact, belt_speed=self.belt.cruise, **forefoot, **slope)

    @property
    def wearer_offset(self) -> int:
        """Offset from a coordinate of the device to the same one of the wearer; 0 if they are one body."""
        return 0 if self.braces is None else self.model.nv


def start_posture(
    model: LegModel, postures: Mapping[Side, Mapping[JointName, float]], ankle_rest: float
) -> np.ndarray:
    """Compute coordinates with each leg in a posture and the pelvis at 0.

    Args:
        model: Model of the legs.
        postures: Angles in [rad] of each leg by joint.
        ankle_rest: Angle in [rad] of an ankle that a posture does not contain.

    Returns:
        The coordinates, shape ``(nv,)``.
    """
    q = np.zeros(model.nv)
    for side, angles in postures.items():
        if model.legs[side].ankle is not None:
            q[model.index(side, JointName.ANKLE)] = ankle_rest
        for joint, angle in angles.items():
            q[model.index(side, joint)] = angle
    return q


Posture = Annotated[Mapping[JointName, Angle], UnitInKeys()]  # angles of the joints of a leg in [rad]


def posture_field(hip: float, knee: float) -> Any:
    """Declare a field for a posture of a leg, with angles of hip and knee in [deg] as default."""
    angles = {JointName.HIP: math.radians(hip), JointName.KNEE: math.radians(knee)}
    return field(default_factory=angles.copy)


# Names of the adjustments that tuning and comparison change.
BELT_SPEED, SUPPORT_SHARE = "belt_speed", "support_share"


@dataclass(frozen=True, kw_only=True)
class Walking:
    """Parameters of walking, in a world that has ground."""

    speed: float  # Speed over the ground in [m/s].
    support_share: float = 0.0  # Share of the weight of wearer and device that ropes carry.
    slope: float = 0.0  # Angle by which the ground rises forwards in [rad].
    contact: ContactParameters = field(default_factory=ContactParameters)  # Contact of heels and toes.
    # Speed profile of the ground; a belt at rest for ground that does not move.
    belt: Belt = field(default_factory=Belt)

    @property
    def carried_share(self) -> float:
        """Share of the weight that the legs carry."""
        return 1.0 - self.support_share


class Adjustment(NamedTuple):
    """Number of a world that a live session, a tuning or a comparison may change.

    During a walk, a change can have an effect only through belt speed, support force and scaled gait table.
    """

    name: str  # Name of the control in a live session.
    value: float  # Present value in SI.
    path: str  # Path of the number in the world, such as ``support.share``.
    label: str  # Label of the control in words.
    minimum: float  # Smallest value, in ``unit``.
    maximum: float  # Largest value, in ``unit``.
    step: float  # Step of the control, in ``unit``.
    help: str  # Explanation in one sentence.
    unit: str = ""  # Unit of the control.
    scale: float = 1.0  # SI value of one unit.

    @classmethod
    def create_support(cls, share: float, path: str, ropes: str) -> Self:
        """Create the adjustment of the body-weight support.

        ``share``: present share; ``path``: its path in the world; ``ropes``: the end of the help, such as
        "ropes carry".
        """
        return cls(
            name=SUPPORT_SHARE,
            value=share,
            path=path,
            label="body-weight support",
            minimum=0.0,
            maximum=1.0,
            step=0.01,
            help=f"Share of the weight of wearer and device that the {ropes}.",
        )


@dataclass(frozen=True, kw_only=True)
class Scenario(Parameters, ABC):
    """Parameters of a world: the abstract base class of all worlds.

    A new world is a frozen dataclass in a module of this package, or in another package under the entry point
    ``twin_gait.worlds``. The defaults of the attributes describe legs in the air: no ground, no adjustments,
    a walk command at all times.

    Attributes:
        kind: Name of the world in files.
        surroundings: Surroundings that the viewer draws around the figure.
    """

    surroundings: ClassVar[Environment] = Environment.FLOOR

    @property
    def step(self) -> float:
        """Default step of the compiled engine in [s]."""
        return 1e-3

    @property
    def braced_step(self) -> float:
        """Default step in [s] if braces hold the device, with a light foot."""
        return min(self.step, 0.1e-3)

    @property
    @abstractmethod
    def pelvis(self) -> PelvisGuide:
        """Guide of the pelvis."""

    @abstractmethod
    def build(self, model: LegModel, *, plant: tuple[Plant, ...], ankle_rest: float, gravity: float) -> World:
        """Build the world around a model of the legs.

        Args:
            model: Model of the legs, with the guide of the pelvis of this world.
            plant: Friction, stops and ankle springs of every coordinate, to which the world may add forces.
            ankle_rest: Angle in [rad] at which the orthosis gives no torque.
            gravity: Gravitational acceleration in [m/s²].

        Returns:
            The world.

        Raises:
            ParameterError: The model does not fit the world.
        """

    @abstractmethod
    def replace_postures(self, postures: Mapping[Side, Posture]) -> Self:
        """Return the same world with other initial postures of the legs."""

    @property
    def start_phases(self) -> dict[str, str | None]:
        """Phases in which the legs start, by the keys of the fields whose names end in ``_phase``."""
        fields = (item for item in declarations(type(self)) if item.name.endswith("_phase"))
        return {item.key: getattr(self, item.name) for item in fields}

    def replace_unknown_phases(self, phases: Sequence[str]) -> Self:
        """Return the world in which legs start in the first phase if their own is not in ``phases``."""
        fields = (item.name for item in declarations(type(self)) if item.name.endswith("_phase"))
        other = (name for name in fields if getattr(self, name) not in (None, *phases))
        return replace(self, **dict.fromkeys(other, phases[0]))

    def leading_side(self, sides: Sequence[Side]) -> Side:
        """Return the leg that starts its cycle at time 0; the other leg is half a cycle behind."""
        return sides[0]

    def remove_aids(self) -> Self | None:
        """Return the same world without aids in the hands, such as crutches; None if it has none."""
        return None

    @property
    def walking(self) -> Walking | None:
        """Parameters of walking on the ground; None for legs in the air."""
        return None

    @property
    def grounded(self) -> bool:
        """Whether there is ground under the feet; the feet then have load sensors."""
        return self.walking is not None

    @property
    def steady(self) -> tuple[float, float]:
        """Start and end in [s] of the time in which the legs are to walk evenly."""
        return (0.0, math.inf)

    @property
    def adjustments(self) -> tuple[Adjustment, ...]:
        """Adjustments of the world, in the order in which a page shows them."""
        return ()

    def has_adjustments(self, *names: str) -> bool:
        """Check whether the world has adjustments of all these names."""
        return {*names} <= {item.name for item in self.adjustments}

    def replace_adjustment(self, name: str, value: float) -> Self:
        """Return the same world with another value of an adjustment, in SI."""
        path = next(item.path for item in self.adjustments if item.name == name)
        changed: Self = _with_value(self, path, value)
        return changed


def _with_value(parameters: Any, path: str, value: float) -> Any:
    """Return parameters in which the value at a dotted path is replaced."""
    first, _, rest = path.partition(".")
    inner = _with_value(getattr(parameters, first), rest, value) if rest else value
    return replace(parameters, **{first: inner})
