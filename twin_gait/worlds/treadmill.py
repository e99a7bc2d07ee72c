"""Both legs on a treadmill, pelvis guided vertically or in a soft harness, under body-weight support."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from twin_gait.core.belt import Belt, treadmill_speed, treadmill_travel
from twin_gait.leg_model import LegModel
from twin_gait.parameters import (
    ActuatorParameters,
    AnkleParameters,
    BeltProfile,
    ContactParameters,
    FrictionLaw,
    StopParameters,
    SupportParameters,
    require,
)
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.world import World, build_plant

_DEGREE = math.pi / 180.0
STEEPEST = math.radians(10.0)  # [rad]; treadmills rise to 15 % (8.5 deg) as a rule
# A drop of the pelvis by this share of the leg length (hip to sole) at the start counts as a fall.
FALL_SHARE = 0.75


@dataclass(frozen=True, kw_only=True)
class Treadmill:
    """Treadmill with body-weight support.

    The pelvis moves vertically, and in a harness fore-aft against a spring and a damper; guide or harness
    take the horizontal force and the pitching moment, and the log shows how much that is.

    Attributes:
        belt_speed: In [m] / [s]; 1.5 km/h is the device's target speed (thesis, table 2.1).
        belt: How the belt starts and stops, and when the legs are told to walk; None for a belt that runs
            evenly under legs that always walk.
        stop_ramp: Time in [s] in which a trip of the monitor or the operator's Stop brings the belt to rest
            (an assumption: device and treadmill share one stop circuit); infinite for a belt that runs on.
        slope: By which the belt rises forwards in [rad], about the point under the pelvis; negative downhill.
            Gravity, guide and support stay vertical.
        support: Body-weight support and guide.
        contact: Of heels and toes.
        leading: Leg that starts in front.
        leading_angles: Hip and knee of the leading leg at the start in [rad], on level ground; on a slope
            both legs are turned with it about the hips, so that they stand as they would there.
        trailing_angles: Hip and knee of the trailing leg in [rad].
        initial_phases: Phases at the start of the leading and the trailing leg.
    """

    belt_speed: float = 1.5 / 3.6
    belt: BeltProfile | None = None
    stop_ramp: float = 0.5
    slope: float = 0.0
    support: SupportParameters = field(default_factory=SupportParameters)
    contact: ContactParameters = field(default_factory=ContactParameters)
    leading: Side = Side.LEFT
    # Between two steps of the default walk; both feet reach the belt, and the first swings clear it.
    leading_angles: tuple[float, float] = (18.0 * _DEGREE, 10.0 * _DEGREE)
    trailing_angles: tuple[float, float] = (-8.0 * _DEGREE, 11.0 * _DEGREE)
    initial_phases: tuple[str, str] = ("early_stance", "late_stance")

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(
            math.isfinite(self.belt_speed) and 0.0 < self.belt_speed <= 2.0,
            "belt speed",
            "above 0 and at most 2 m/s (7.2 km/h)",
            self.belt_speed,
        )
        require(self.stop_ramp > 0.0, "stop_ramp", "a time above 0", self.stop_ramp)
        require(
            abs(self.slope) <= STEEPEST,
            "slope",
            f"{STEEPEST:.4f} rad (10 deg) at most, up or down",
            self.slope,
        )

    def _belt(self) -> Belt:
        belt = Belt(self.belt_speed, stop_ramp=self.stop_ramp)
        if self.belt is not None:
            belt.start, belt.stop = self.belt.start, self.belt.stop
            belt.ramp, belt.delay = self.belt.ramp, self.belt.delay
        return belt

    def belt_speed_at(self, time: float, trip_time: float = math.inf) -> float:
        """Speed of the belt at a time.

        Args:
            time: In [s].
            trip_time: Of the trip that brings the belt to rest, in [s]; infinite if there is none.

        Returns:
            Speed in [m] / [s], backwards positive.
        """
        return treadmill_speed(self._belt(), time, trip_time)

    def belt_travel(self, time: float, trip_time: float = math.inf) -> float:
        """Way that the belt has gone since time 0.

        Args:
            time: In [s].
            trip_time: As in :meth:`belt_speed_at`.

        Returns:
            Way in [m], backwards positive.
        """
        return treadmill_travel(self._belt(), time, trip_time)

    @property
    def steady(self) -> tuple[float, float]:
        """From when to when in [s] the belt runs evenly and the legs are told to walk."""
        belt = self.belt
        return (0.0, math.inf) if belt is None else (belt.start + belt.delay + belt.ramp, belt.stop)

    @property
    def pelvis(self) -> PelvisGuide:
        """How the pelvis is held."""
        return self.support.guide

    def build(
        self,
        model: LegModel,
        *,
        friction: Mapping[JointName, FrictionLaw],
        actuators: Mapping[JointName, ActuatorParameters],
        stops: StopParameters,
        ankle: AnkleParameters,
        gravity: float,
    ) -> World:
        """Put a model on the treadmill.

        Args:
            model: Both legs with a pelvis that moves.
            friction: True friction of the joints with a drive.
            actuators: Their motors and gears.
            stops: Mechanical stops.
            ankle: The orthosis.
            gravity: In [m] / [s²].

        Returns:
            The world.
        """
        require(len(model.legs) == 2, "legs", "two legs on a treadmill", len(model.legs))
        require(model.up_axis == "z", "up_axis", "z on a treadmill", model.up_axis)
        frames = {side: leg.contact_frames for side, leg in model.legs.items()}
        require(all(frames.values()), "contact_frames", "heel and toe frames on both feet", frames)
        weight = model.total_mass * gravity
        support_force = self.support.share * weight
        rows = build_plant(model, friction=friction, actuators=actuators, stops=stops, ankle=ankle)
        pelvis = model.pelvis_index
        assert pelvis is not None  # the pelvis of this scenario moves
        rows[pelvis].spring.damping, rows[pelvis].spring.force = self.support.damping, support_force
        if model.forward_index is not None:
            harness = rows[model.forward_index].spring
            harness.stiffness, harness.damping = self.support.forward_stiffness, self.support.forward_damping
        q = np.zeros(model.nv)
        phases: dict[Side, str | None] = {}
        for side in model.sides:
            leads = side is self.leading
            hip, knee = self.leading_angles if leads else self.trailing_angles
            q[model.index(side, JointName.HIP)] = hip + self.slope
            q[model.index(side, JointName.KNEE)] = knee
            if model.legs[side].ankle is not None:
                q[model.index(side, JointName.ANKLE)] = ankle.rest
            phases[side] = self.initial_phases[0 if leads else 1]
        q[pelvis] = _stand_on_both_feet(model, q, math.tan(self.slope))
        return World(
            model=model,
            plant=rows,
            start_q=q,
            start_v=np.zeros(model.nv),
            initial_phases=phases,
            belt=self._belt(),
            contact=self.contact,
            slope=self.slope,
            support_force=support_force,
            catch_stiffness=self.support.catch_stiffness,
            catch_dissipation=self.support.catch_dissipation,
            body_weight=weight,
            fall_height=FALL_SHARE * q[pelvis],
            contact_frames=frames,
        )


def _stand_on_both_feet(model: LegModel, q: np.ndarray, rise: float) -> float:
    """Bend the ankle of the foot that reaches lower until both feet stand on the belt.

    Args:
        rise: Of the belt, height over way.
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
    """Root of a function that is negative at one end and positive at the other.

    Written out because importing scipy.optimize takes longer than a compiled run.
    """
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        low, high = (middle, high) if rising(middle) < 0.0 else (low, middle)


def _lowest_point(model: LegModel, side: Side, q: np.ndarray, rise: float) -> float:
    """Least height of a foot over a belt through the origin, vertically."""
    points = (model.frame_position(q, name) for name in model.legs[side].contact_frames)
    return min(float(point[2] - rise * point[0]) for point in points)
