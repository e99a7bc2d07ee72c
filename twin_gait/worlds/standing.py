"""Postures at the start in which the legs are in balance on the ground."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self, TypeAlias

import numpy as np

from twin_gait.core.contact import contact_normal_force
from twin_gait.core.plant import (
    Pad,
    Plant,
    Seat,
    pitching_moment,
    seat_force_on_buttocks,
    seat_force_on_thigh,
)
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.environment import ChairParameters, ContactParameters
from twin_gait.parameters.quantities import SHARE, Angle, Range, Ratio, from_attributes, require
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.world import Posture, Scenario, World

# Share of the height of the pelvis at the start, below which the wearer has fallen.
FALL_SHARE = 0.75
FallShare: TypeAlias = Annotated[Ratio, SHARE]
# Lean of the trunk in [rad], in either direction, beyond which the wearer has fallen.
FALL_LEAN = math.radians(60.0)
FallLean: TypeAlias = Annotated[Angle, Range(0.0, math.pi, exclusive_minimum=True, reason="upside down")]
# Constants of Newton's method: steps in [m] and [rad], forces in [N] and [N·m].
MOST_ROUNDS, LARGEST_STEP, DIFFERENCE, BALANCED = 60, 0.02, 1e-7, 1e-6
# Most steps of the method of false position, its remainder in [m], and half the width of its bracket in
# [rad], in which the height of a foot changes by much more than by rounding.
MOST_SECANTS, LEVEL, BRACKET = 12, 1e-13, 1e-11


class SplitStance(Scenario):
    """World in which two legs start on the ground, one in front of the other.

    The following declarations are fields that such a world has.
    """

    leading: Side  # Leg that starts in front.
    leading_angles: Posture  # Angles of its joints at the start in [rad].
    trailing_angles: Posture  # Angles of the joints of the other leg at the start in [rad].
    leading_phase: str  # Phase of the leading leg at the start.
    trailing_phase: str  # Phase of the other leg at the start.

    contact: ContactParameters  # Contact parameters of heels and toes.
    fall_height_share: (
        float  # Share of the height of the pelvis at the start, below which the wearer has fallen.
    )

    def leading_side(self, sides: Sequence[Side]) -> Side:
        """Return the leg that starts in front."""
        return self.leading

    def replace_postures(self, postures: Mapping[Side, Posture]) -> Self:
        """Return the same world with legs that start in other postures.

        Legs that are not given, and joints that are not given of a leg, start as before.
        """
        leading, trailing = dict(self.leading_angles), dict(self.trailing_angles)
        for side, angles in postures.items():
            (leading if side is self.leading else trailing).update(angles)
        changed = {"leading_angles": leading, "trailing_angles": trailing}
        return replace(self, **changed)

    def postures(self, slope: float = 0.0) -> dict[Side, Posture]:
        """Return the start angles of both legs, turned about the hips by the slope of the ground in [rad]."""
        found: dict[Side, Posture] = {}
        for side in Side:
            angles = self.leading_angles if side is self.leading else self.trailing_angles
            found[side] = {**angles, JointName.HIP: angles.get(JointName.HIP, 0.0) + slope}
        return found

    @property
    def phases(self) -> dict[Side, str]:
        """Phases of both legs at the start."""
        return {side: self.leading_phase if side is self.leading else self.trailing_phase for side in Side}

    def require_feet(self, model: LegModel, ground: str) -> None:
        """Raise ParameterError unless a model has two legs with heels and toes and z upwards."""
        require(len(model.legs) == 2, "legs", f"two legs on {ground}", len(model.legs))
        require(model.up_axis == "z", "up_axis", f"z on {ground}", model.up_axis)
        for side, leg in model.legs.items():
            require(bool(leg.contact_frames), f"leg.{side}.contact_frames", f"heel and toe on {ground}", ())

    def build_standing_world(
        self, model: LegModel, plant: tuple[Plant, ...], q: np.ndarray, ropes: Any, weight: float, **more: Any
    ) -> World:
        """Build a world with both legs on the ground.

        ``ropes``: parameters of body-weight support, with the share of the ``weight`` in [N] that they carry,
        and the properties of a rope that locks at a trip. ``more``: further attributes of the world.
        """
        return from_attributes(
            World,
            ropes,
            model=model,
            plant=plant,
            start_q=q,
            start_v=np.zeros(model.nv),
            initial_phases=self.phases,
            contact=self.contact,
            contact_frames={side: leg.contact_frames for side, leg in model.legs.items()},
            support_force=ropes.share * weight,
            body_weight=weight,
            **more,
        )


def level_feet(model: LegModel, q: np.ndarray, rise: float) -> float:
    """Bend the ankle of the foot that reaches lower until both feet are on the ground.

    ``q``: coordinates with the hips in the origin, shape ``(nv,)``; the ankle is changed in place. ``rise``:
    slope of the ground, height divided by distance. Returns the height of the hips in [m].
    """
    reach = {side: _lowest_point(model, side, q, rise) for side in model.sides}
    lower, higher = sorted(model.sides, key=lambda side: reach[side])
    if model.legs[lower].ankle is None:
        return -reach[lower]
    ankle = model.index(lower, JointName.ANKLE)
    rest = float(q[ankle])
    limit = model.position_limits(lower, JointName.ANKLE)[1]

    def gap(angle: float) -> float:
        bent = q.copy()
        bent[ankle] = angle
        return _lowest_point(model, lower, bent, rise) - reach[higher]

    # Dorsiflexion lifts the toe; if even the stop does not level the feet, one starts in the air.
    q[ankle] = _bisect(gap, rest, limit) if gap(rest) < 0.0 < gap(limit) else rest
    return -min(_lowest_point(model, side, q, rise) for side in model.sides)


def _bisect(rising: Callable[[float], float], low: float, high: float) -> float:
    """Find the root of a function that is negative at ``low`` and positive at ``high`` by bisection.

    The method is implemented here because importing scipy.optimize takes longer than a compiled run. A middle
    outside of a narrow bracket of the root needs no evaluation; the result is the same.
    """
    below, above = _narrow_bracket(rising, low, high)
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        is_below = middle <= below or (middle < above and rising(middle) < 0.0)
        low, high = (middle, high) if is_below else (low, middle)


def _narrow_bracket(rising: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Narrow a bracket of a root by the method of false position with the Illinois rule."""
    value_low, value_high, value = rising(low), rising(high), 0.0
    for _ in range(MOST_SECANTS):
        root = low - value_low * (high - low) / (value_high - value_low)
        before, value = value, rising(root)
        if abs(value) < LEVEL:
            below, above = root - BRACKET, root + BRACKET
            return (below, above) if rising(below) < 0.0 < rising(above) else (low, high)
        weight = 0.5 if before * value > 0.0 else 1.0  # of the end that stays twice
        if value < 0.0:
            low, value_low, value_high = root, value, weight * value_high
        else:
            high, value_low, value_high = root, weight * value_low, value
    return low, high


def _lowest_point(model: LegModel, side: Side, q: np.ndarray, rise: float) -> float:
    """Compute the least vertical height of a foot over ground through the origin."""
    lowest = math.inf
    for point in model.frame_positions(q, model.legs[side].contact_frames):
        ahead, _, height = point.tolist()
        lowest = min(lowest, height - rise * ahead)
    return lowest


def new_seat(model: LegModel, chair: ChairParameters) -> Seat:
    """Return the seat of a chair and the pads of a wearer on it."""
    share, thigh = chair.thigh_share, _height(model, JointName.HIP) - _height(model, JointName.KNEE)
    return from_attributes(
        Seat,
        chair,
        front_edge=chair.front,
        buttocks=Pad((1.0 - share) * chair.stiffness, chair.dissipation, chair.hip_height),
        thigh=Pad(
            0.5 * share * chair.stiffness,
            chair.dissipation,
            chair.thigh_thickness,
            chair.thigh_position * thigh,
        ),
        hips=[model.index(side, JointName.HIP) for side in model.sides],
    )


def _height(model: LegModel, joint: JointName) -> float:
    """Return the height of a joint while the legs hang and the pelvis is at 0, in [m]."""
    return float(model.frame_position(np.zeros(model.nv), getattr(model.legs[model.sides[0]], joint))[2])


@dataclass(frozen=True)
class SeatedBalance:
    """Wearer on a chair whose motors hold the posture and whose hands rest."""

    model: LegModel  # Model of wearer and device.
    seat: Seat  # Seat under the wearer.
    contact: ContactParameters  # Contact parameters of the feet on the floor.
    plant: tuple[Plant, ...]  # Plant of each coordinate, for the springs of the ankles.
    lean: float  # Lean of the trunk in [rad].
    shank: float  # Angle from the vertical by which the shanks lean forward over the feet, in [rad].

    def solve_posture(self) -> np.ndarray:
        """Compute the coordinates in balance, with the hips at 0 forwards: shape ``(nv,)``.

        Height of the hips, elevation of the thighs and dorsiflexion are such that vertical force, moment
        about the hips and torque of the ankles vanish, by Newton's method.

        Raises ParameterError if there is no such posture, or if a joint would be beyond its stop.
        """
        found = self._guess()
        for _ in range(MOST_ROUNDS):
            left = self._imbalance(found)
            if np.abs(left).max() < BALANCED:
                break
            steps = found + DIFFERENCE * np.eye(3)
            rates = np.array([self._imbalance(step) - left for step in steps]).T / DIFFERENCE
            if np.linalg.matrix_rank(rates) < len(rates):
                break  # the seat is not under the wearer, or carries nothing
            found = found - np.clip(np.linalg.solve(rates, left), -LARGEST_STEP, LARGEST_STEP)
        balanced = np.abs(left).max() < 1e-3
        require(balanced, "scenario.chair", "a seat on which the wearer is in balance", "none")
        q = self._coordinates(found)
        for joint in JointName:
            low, high = self.model.position_limits(self.model.sides[0], joint)
            angle = float(q[self.model.index(self.model.sides[0], joint)])
            require(low < angle < high, f"scenario.start: {joint}", f"{low:.2f} to {high:.2f} rad", angle)
        return q

    def _guess(self) -> np.ndarray:
        """Guess height of the hips, elevation of the thighs and dorsiflexion of a wearer with flat feet."""
        model = self.model
        hip, knee, ankle = (_height(model, joint) for joint in JointName)
        soles = model.legs[model.sides[0]].contact_frames
        sole = min(model.frame_position(np.zeros(model.nv), name)[2] for name in soles)
        height = self.seat.height + self.seat.buttocks.thickness
        rise = height - (knee - ankle) * math.cos(self.shank) - (ankle - sole)
        reaches = abs(rise) < hip - knee
        expected = "a height at which the feet are on the floor"
        require(reaches, "scenario.chair.height", expected, self.seat.height)
        return np.array([height - 0.01, math.acos(rise / (hip - knee)), self.shank])

    def _coordinates(self, found: np.ndarray) -> np.ndarray:
        model, (height, elevation, dorsiflexion) = self.model, found
        q = np.zeros(model.nv)
        q[model.pelvis_index], q[model.pitch_index] = height, self.lean
        for side in model.sides:
            q[model.index(side, JointName.HIP)] = elevation + self.lean
            q[model.index(side, JointName.KNEE)] = elevation + self.shank
            q[model.index(side, JointName.ANKLE)] = dorsiflexion
        return q

    def _imbalance(self, found: np.ndarray) -> np.ndarray:
        """Compute the remaining upward force in [N], moment about the hips and ankle torque in [N·m]."""
        model, seat, q = self.model, self.seat, self._coordinates(found)
        ankle = model.index(model.sides[0], JointName.ANKLE)
        spring = self.plant[ankle].spring
        assert model.pelvis_index is not None and model.pitch_index is not None  # the pelvis is free
        left = -model.gravity_torque(q)[[model.pelvis_index, model.pitch_index, ankle]]
        left[2] += spring.force - spring.stiffness * q[ankle]
        _, upward, _ = seat_force_on_buttocks(seat, 0.0, found[0], 0.0, 0.0, 0.0)
        left[0] += upward
        for side in model.sides:
            sine, cosine = math.sin(found[1]), math.cos(found[1])
            _, upward, lift = seat_force_on_thigh(seat, sine, cosine, 0.0, found[0], 0.0, 0.0, 0.0)
            left[:2] += upward, -lift
            axis = model.frame_position(q, str(model.legs[side].ankle))[0]
            for number, name in enumerate(model.legs[side].contact_frames):
                ahead, _, height = model.frame_position(q, name)
                stiffness = self.contact.forefoot[0] if number > 0 else self.contact.stiffness
                upward = contact_normal_force(-height, 0.0, stiffness, 0.0)
                left[:2] += upward, pitching_moment(ahead, 0.0, 0.0, upward)
                if side is model.sides[0]:
                    left[2] += upward * (ahead - axis)
        return left
