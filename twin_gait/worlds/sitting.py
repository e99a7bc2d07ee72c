"""How a wearer comes to sit on a chair at the start: by statics."""

import math
from dataclasses import dataclass

import numpy as np

from twin_gait.core.contact import contact_normal_force
from twin_gait.core.plant import Plant
from twin_gait.core.seat import Pad, Seat, seat_the_hips, seat_the_thigh
from twin_gait.core.trunk import pitching_moment
from twin_gait.leg_model import LegModel
from twin_gait.parameters import ChairParameters, ContactParameters, require
from twin_gait.parameters.quantities import taken_from
from twin_gait.vocabulary import JointName

MOST_ROUNDS, LARGEST_STEP = 60, 0.02  # [m] and [rad]
DIFFERENCE, BALANCED = 1e-7, 1e-6  # in [m] and [rad]; in [N] and [N m]


def seat_of(model: LegModel, chair: ChairParameters) -> Seat:
    """The seat of a chair and the pads of a wearer on it."""
    share, thigh = chair.thigh_share, _height(model, JointName.HIP) - _height(model, JointName.KNEE)
    return taken_from(
        Seat,
        chair,
        forward=chair.front,
        buttocks=Pad((1.0 - share) * chair.stiffness, chair.dissipation, chair.hip_height),
        thigh=Pad(
            0.5 * share * chair.stiffness, chair.dissipation, chair.thigh_thickness, chair.thigh_place * thigh
        ),
        hips=[model.index(side, JointName.HIP) for side in model.sides],
    )


def _height(model: LegModel, joint: JointName) -> float:
    """Height of a joint while the legs hang and the pelvis is at 0, in [m]."""
    return float(model.frame_position(np.zeros(model.nv), getattr(model.legs[model.sides[0]], joint))[2])


@dataclass(frozen=True)
class Sitting:
    """A wearer on a chair with motors that hold what they have to; the hands rest."""

    model: LegModel  # Of wearer and device.
    seat: Seat  # Under them.
    contact: ContactParameters  # Of the feet on the floor.
    plant: tuple[Plant, ...]  # For the springs of the ankles.
    lean: float  # Of the trunk in [rad].
    shank: float  # Angle from the vertical by which the shanks lean forward over the feet, in [rad].

    def posture(self) -> np.ndarray:
        """Coordinates in balance, with the hips at 0 forwards: shape ``(nv,)``.

        Height of the hips, elevation of the thighs and dorsiflexion are such that vertical force, moment
        about the hips and torque of the ankles come to nothing, by Newton's method.

        Raises ParameterError if there is no such posture, or a joint would be beyond its stop.
        """
        found = self._guess()
        for _ in range(MOST_ROUNDS):
            left = self._imbalance(found)
            if np.abs(left).max() < BALANCED:
                break
            steps = found + DIFFERENCE * np.eye(3)
            rates = np.array([self._imbalance(step) - left for step in steps]).T / DIFFERENCE
            found = found - np.clip(np.linalg.solve(rates, left), -LARGEST_STEP, LARGEST_STEP)
        balanced = np.abs(left).max() < 1e-3
        require(balanced, "scenario.start", "a chair on which lean and shanks balance", "none")
        q = self._coordinates(found)
        for joint in JointName:
            low, high = self.model.position_limits(self.model.sides[0], joint)
            angle = float(q[self.model.index(self.model.sides[0], joint)])
            require(low < angle < high, f"scenario.start: {joint}", f"{low:.2f} to {high:.2f} rad", angle)
        return q

    def _guess(self) -> np.ndarray:
        """Height of the hips, elevation of the thighs and dorsiflexion of a wearer with flat feet."""
        model = self.model
        hip, knee, ankle = (_height(model, joint) for joint in JointName)
        soles = model.legs[model.sides[0]].contact_frames
        sole = min(model.frame_position(np.zeros(model.nv), name)[2] for name in soles)
        height = self.seat.height + self.seat.buttocks.thickness
        rise = height - (knee - ankle) * math.cos(self.shank) - (ankle - sole)
        reaches = abs(rise) < hip - knee
        require(reaches, "scenario.chair.height", "a seat from which feet are on the floor", self.seat.height)
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
        """What is left: upward force in [N], pitching moment about the hips, torque of an ankle in [N m]."""
        model, seat, q = self.model, self.seat, self._coordinates(found)
        ankle = model.index(model.sides[0], JointName.ANKLE)
        spring = self.plant[ankle].spring
        assert model.pelvis_index is not None and model.pitch_index is not None  # it is free
        left = -model.gravity_torque(q)[[model.pelvis_index, model.pitch_index, ankle]]
        left[2] += spring.force - spring.stiffness * q[ankle]
        _, upward, _ = seat_the_hips(seat, 0.0, found[0], 0.0, 0.0, 0.0)
        left[0] += upward
        for side in model.sides:
            sine, cosine = math.sin(found[1]), math.cos(found[1])
            _, upward, lift = seat_the_thigh(seat, sine, cosine, 0.0, found[0], 0.0, 0.0, 0.0)
            left[:2] += upward, -lift
            axis = model.frame_position(q, str(model.legs[side].ankle))[0]
            for name in model.legs[side].contact_frames:
                ahead, _, height = model.frame_position(q, name)
                upward = contact_normal_force(-height, 0.0, self.contact.stiffness, 0.0)
                left[:2] += upward, pitching_moment(ahead, 0.0, 0.0, upward)
                if side is model.sides[0]:
                    left[2] += upward * (ahead - axis)
        return left
