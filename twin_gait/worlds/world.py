"""What every world has in common: a model, what acts on it, and where it starts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from twin_gait.core.arm_policy import ArmPolicy, Sense
from twin_gait.core.arms import Arm
from twin_gait.core.belt import Belt
from twin_gait.core.contact import Ground
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.plant import Brace, ImposedMotion, Plant
from twin_gait.core.seat import Seat
from twin_gait.core.trunk import Trunk
from twin_gait.leg_model import LegJoints, LegModel
from twin_gait.parameters import ContactParameters, require
from twin_gait.parameters.quantities import Inline, Parameters, taken_from
from twin_gait.vocabulary import JointName, Side


@dataclass(frozen=True, kw_only=True)
class LegSource(Parameters):
    """Where the leg model comes from.

    Attributes:
        urdf: Path of a URDF, or the name of a packaged one.
        legs: Joint names per side.
        fit_device: Whether to fit femur, tibia, waist and foot to the wearer.
        up_axis: Vertical axis of the URDF, ``"z"`` or ``"y"``.
    """

    urdf: str = "twin.urdf"
    legs: Annotated[Mapping[Side, LegJoints], Inline()] = field(default_factory=dict)
    fit_device: bool = True
    up_axis: Literal["y", "z"] = "z"

    def __post_init__(self) -> None:
        """Check that there is a leg."""
        super().__post_init__()
        require(bool(self.legs), "legs", "the joint names of left, right or both legs", "none")


@dataclass(frozen=True, kw_only=True)
class Braces:
    """Device and wearer apart, each with the coordinates of the whole, and what binds them.

    Attributes:
        device: Links and rotors of the device.
        wearer: Segments of the wearer.
        braces: Between each coordinate of the two.
    """

    device: LegModel
    wearer: LegModel
    braces: tuple[Brace, ...]


@dataclass(frozen=True, kw_only=True)
class World:
    """A leg model in its surroundings, ready to be integrated.

    With braces the coordinates are those of the device, then those of the wearer: n is twice ``nv``.

    Attributes:
        model: The plant; with braces, device and wearer as if they were one.
        plant: What acts on each of the n coordinates by itself.
        belt: What sets the speed of the treadmill; one at rest on the bench.
        contact: Contact parameters, or None without ground.
        slope: By which the ground rises forwards, about the origin, in [rad].
        start_q: Coordinates at time 0, shape ``(n,)``.
        start_v: Velocities at time 0, shape ``(n,)``.
        initial_phases: Phase of each leg at time 0.
        support_force: Constant upward force on the pelvis in [N].
        catch_stiffness: In [N] / [m] of the harness that locks at a trip; 0 for none.
        catch_dissipation: Of that harness in [s] / [m].
        body_weight: Weight of the wearer and device in [N].
        fall_height: Pelvis height in [m] below which the wearer has fallen.
        imposed_motion: Imposed motion of a joint of the device, or None.
        braces: What binds the wearer to the device, or None if they are one.
        trunk: Of a wearer whose pelvis is free, or None.
        arms: That hold a crutch, by side; the coordinates of their tips follow all others.
        policy: How the wearer uses them, or None.
        sense: What the wearer feels, or None.
        fall_pitch: Of the trunk, beyond which the wearer has fallen, in [rad].
        longest_reach: Of arm and crutch in [m].
        seat: Of a chair, or None.
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
    catch_stiffness: float = 0.0
    catch_dissipation: float = 0.0
    body_weight: float = 0.0
    fall_height: float = -math.inf
    imposed_motion: ImposedMotion | None = None
    contact_frames: Mapping[Side, tuple[str, ...]] = field(default_factory=dict)
    braces: Braces | None = None
    trunk: Trunk | None = None
    arms: tuple[Arm, ...] = ()
    policy: ArmPolicy | None = None
    sense: Sense | None = None
    fall_pitch: float = math.inf
    longest_reach: float = math.inf
    seat: Seat | None = None

    @property
    def chains(self) -> tuple[LegModel, ...]:
        """Models whose coordinates follow one another; feet and support are those of the last."""
        return (self.model,) if self.braces is None else (self.braces.device, self.braces.wearer)

    def ground(self) -> Ground:
        """The ground under the feet with an even belt; without one it never gives a force."""
        if self.contact is None:
            return Ground()
        sine, cosine = sine_cosine(self.slope)
        return taken_from(
            Ground, self.contact, belt_speed=self.belt.cruise, slope_sine=sine, slope_cosine=cosine
        )

    @property
    def wearer_shift(self) -> int:
        """How far behind a coordinate of the device that of the wearer stands; 0 if they are one."""
        return 0 if self.braces is None else self.model.nv


def start_posture(
    model: LegModel, postures: Mapping[Side, Mapping[JointName, float]], ankle_rest: float
) -> np.ndarray:
    """Coordinates with each leg in a posture, its ankle at rest unless that says more, and the pelvis at 0.

    Args:
        postures: Angles in [rad].
        ankle_rest: In [rad].

    Returns:
        Shape ``(nv,)``.
    """
    q = np.zeros(model.nv)
    for side, angles in postures.items():
        if model.legs[side].ankle is not None:
            q[model.index(side, JointName.ANKLE)] = ankle_rest
        for joint, angle in angles.items():
            q[model.index(side, joint)] = angle
    return q
