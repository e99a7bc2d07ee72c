"""Parameters of the forces on the leg: belt, ground, stops, orthosis, support, braces, chair."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName, PelvisGuide, PelvisPitch, Side


@dataclass(frozen=True, kw_only=True)
class BeltProfile(quantities.Parameters):
    """A belt that starts and stops, and the walk command; see :mod:`twin_gait.core.belt`.

    Attributes:
        start: Time of the command to walk in [s].
        stop: Time of the command to stand in [s]; infinite for a walk without end.
        ramp: Time in which the belt reaches its speed, and comes to rest, in [s].
        delay: Time from either command until the belt follows it in [s].
    """

    start: Annotated[quantities.Time, quantities.NOT_NEGATIVE]
    stop: Annotated[quantities.Time, quantities.NON_NEGATIVE_OR_INFINITE] = math.inf
    ramp: Annotated[quantities.Time, quantities.POSITIVE]
    delay: Annotated[quantities.Time, quantities.NOT_NEGATIVE] = 0.0

    def __post_init__(self) -> None:
        """Check the ranges, and that the belt has reached its speed before it stops."""
        super().__post_init__()
        earliest = self.start + self.ramp
        require(self.stop >= earliest, "stop", f"start + ramp, {earliest:g} s, or later", self.stop)


COEFFICIENTS = quantities.Range(0.0, 5.0, reason="rubber on a dry floor has 1")
# The stops of the joint bench have 2e5 N·m/rad.
STOPS = quantities.Range(0.0, 1e7, reason="a steel pin of 1 cm² at 5 cm from the axis has 5e6 N·m/rad")
RELATIVE = quantities.Range(0.0, 10.0, reason="two of 0.25 keep a stiff body upright")


@dataclass(frozen=True, kw_only=True)
class ContactParameters(quantities.Parameters):
    """Foot contact at heel and toe; see :func:`twin_gait.core.contact.contact_normal_force`.

    Attributes:
        stiffness: Hertz stiffness of each heel in [N/m^1.5] (an assumption): a heel is compressed by 11
            mm under the 353 N of wearer and device that remain with 60 % support. A contact sphere of PredSim
            has 8.4e4 (1e6 N/m², radius 32 mm).
        dissipation: Dissipation c of Hunt and Crossley in [s/m]. OpenSim and PredSim have 2.0 in the same
            law. The default dissipates 47 % of the energy of a fall at 0.15 m/s; a heel pad dissipates 30 to
            48 % (Ker 1996, J Exp Biol 199:1501) and a prosthetic foot 34 to 53 %, 63 % in a walking shoe
            (Klute et al. 2004, J Rehabil Res Dev 41:535).
        forefoot_stiffness: Hertz stiffness of each forefoot in [N/m^1.5], or None if it is that of a heel.
        forefoot_dissipation: Dissipation of each forefoot in [s/m], or None if it is that of a heel.
        friction_coefficient: Coulomb coefficient of the sole on the belt.
        transition_velocity: Transition velocity of the regularised friction in [m/s].
    """

    stiffness: Annotated[quantities.HertzStiffness, quantities.POSITIVE] = 3.0e5
    dissipation: Annotated[quantities.LinearDissipation, quantities.NOT_NEGATIVE] = 2.5
    forefoot_stiffness: Annotated[quantities.HertzStiffness | None, quantities.POSITIVE] = None
    forefoot_dissipation: Annotated[quantities.LinearDissipation | None, quantities.NOT_NEGATIVE] = None
    friction_coefficient: Annotated[quantities.Ratio, COEFFICIENTS] = 0.8
    transition_velocity: Annotated[quantities.Speed, quantities.POSITIVE] = 0.05

    @property
    def forefoot(self) -> tuple[float, float]:
        """Stiffness in [N/m^1.5] and dissipation in [s/m] of each forefoot."""
        stiffness, dissipation = self.forefoot_stiffness, self.forefoot_dissipation
        return (
            self.stiffness if stiffness is None else stiffness,
            self.dissipation if dissipation is None else dissipation,
        )


# Sets of contact parameters by their words in files. ``calibrated`` has feet without shoes:
# - Heel stiffness: 569 N at 11.3 mm, the largest values of a mass of 5 kg that hit the heels of 16 adults at
#   0.93 m/s (11.6 g; Kinoshita et al. 1993, Int J Sports Med 14:312, found in the abstract).
# - Dissipation: 33 % of the energy of a fall at 0.15 m/s, as in a heel pad after a rest of 1 s (Ker 1996),
#   and 84 % at 0.93 m/s (Kinoshita et al.: 75 to 89 %).
# - Forefoot stiffness: 45.7 % of 15.2 mm, the compression of the tissue under the second metatarsal head in
#   walking (Cavanagh 1999, J Biomech 32:623, found in the abstract), under 687 N, the weight of 70 kg (an
#   assumption). Its dissipation is that of the heel (an assumption).
# The heel in a running shoe is softer than ``soft``: a shoe that takes 10.6 J up to 1.58 kN (Fuss et al.
# 2025, Bioengineering 12:467) has 7.3e5 in this law, and in series with the heel 2.0e5.
CONTACTS = {
    "soft": ContactParameters(),
    "calibrated": ContactParameters(
        stiffness=4.7e5, dissipation=1.5, forefoot_stiffness=1.2e6, forefoot_dissipation=1.5
    ),
}
Contact = Annotated[ContactParameters, quantities.NamedSets(CONTACTS)]


@dataclass(frozen=True, kw_only=True)
class StopParameters(quantities.Parameters):
    """Mechanical stops of the joints; their angles are the limits in the URDF.

    Attributes:
        stiffness: Stiffness of a stop in [N·m/rad].
        dissipation: Dissipation of a stop in [s/rad].
    """

    stiffness: Annotated[quantities.RotaryStiffness, STOPS]
    dissipation: Annotated[quantities.RotaryDissipation, quantities.NOT_NEGATIVE]


ANKLE_REST = quantities.Range(
    -math.radians(30.0), math.radians(30.0), words="-0.5236 to 0.5236 rad (30 deg either way)"
)


@dataclass(frozen=True, kw_only=True)
class AnkleParameters(quantities.Parameters):
    """Ankle-foot orthosis: a passive spring and damper about a fixed rest angle.

    Attributes:
        stiffness: Stiffness in [N·m/rad]. Thirteen commercial orthoses of carbon composite have 33 to 210
            (0.58 to 3.66 N·m/deg: Shuman and Russell Esposito 2022, J Biomech Eng 144:011004); that of TWIN
            is not published.
        relative_stiffness: Additional stiffness of an orthosis that is fitted to the wearer, divided by the
            weight of wearer and device times the height of the wearer. Two orthoses with 0.25 each keep a
            stiff body upright.
        damping: Damping in [N·m·s/rad] (an assumption for TWIN: at strides of 1.75 s its value dissipates
            a third of the energy that the spring stores, and in the air the foot does not oscillate, with ζ
            about 1.7).
        sides: Legs with an orthosis, or none if all legs have one.
        rest: Dorsiflexion in [rad] at which the spring is slack, within the stops of ±30°; 0 is a right angle
            of foot and shank.
    """

    stiffness: Annotated[quantities.RotaryStiffness, quantities.NOT_NEGATIVE]
    relative_stiffness: Annotated[quantities.Ratio, RELATIVE]
    damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE]
    rest: Annotated[quantities.Angle, ANKLE_REST]
    sides: tuple[Side, ...] = ()


ATTACHMENTS = quantities.Range(0.0, 0.4, reason="the shoulders are at 0.288")
LEVERS = quantities.Range(0.0, 0.3, reason="a bar of 0.6 m")
STRAP_DAMPINGS = quantities.Range(0.0, 1e4, reason="critical in the default straps has 4000")
STRAP_LEANS = quantities.Range(-0.5, 0.5, reason="a difference of 0.1 m between straps 0.2 m apart")
STRAPS = quantities.Range(0.0, 1e6, reason="a metre of polyester webbing has 1e5 N/m")


@dataclass(frozen=True, kw_only=True)
class SupportParameters(quantities.Parameters):
    """Body-weight support and guide of the treadmill.

    At a trip the rope locks: from then on the harness also supports a pelvis that sinks below its height at
    the trip, as a one-sided spring that only pulls upwards,
    :func:`twin_gait.core.contact.mechanical_stop_torque`.

    Attributes:
        share: Share of the weight of wearer and device that the support carries.
        damping: Damping of the vertical guide in [N·s/m].
        guide: Whether the pelvis is guided vertically, or a harness lets it move fore-aft as well.
        pitch: Pitch of a pelvis in a harness, see :class:`twin_gait.core.plant.Harness`: locked by the guide;
            soft, held by two straps in front of and behind the trunk; or free under one rope at its axis. In
            a Lokomat with 30 and 50 % support the pelvis of 18 healthy people tilted more than on a treadmill
            without it, and the trunk less (Swinnen et al. 2015, NeuroRehabilitation 36:81, abstract).
        forward_stiffness: Fore-aft stiffness of the harness in [N/m]; tethers let a pelvis move by some
            centimetres (an assumption).
        forward_damping: Fore-aft damping of the harness in [N·s/m]; about 0.4 of critical under 90 kg (an
            assumption).
        height: Height of the attachments of rope or straps above the hips, along the trunk, divided by the
            height of the wearer (an assumption). It is used only if the pelvis pitches, as are the next
            four.
        strap_lever: Distance in [m] of each strap from the axis of the trunk (an assumption: half the depth
            of a chest).
        strap_stiffness: Stiffness in [N/m] of each strap (an assumption: as the cuffs of the braces, because
            vest and tissue give more than the webbing).
        strap_damping: Damping in [N·s/m] of each strap (an assumption: a loss factor of 0.2 at a step per
            second).
        strap_lean: Pitch in [rad] at which both straps have the same tension, forwards positive. The
            therapist sets it by the lengths of the straps (an assumption: upright).
        lock_stiffness: Stiffness of the locked harness in [N/m]; 0 for one that does not lock. About a
            metre of rope that stretches by 5 % under 100 kg, the maximum that EN 1891 allows for a
            low-stretch rope.
        lock_dissipation: Dissipation of the locked harness in [s/m] (an assumption).
    """

    share: Annotated[quantities.Ratio, quantities.SHARE] = 0.6
    damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 90.0
    guide: PelvisGuide = PelvisGuide.HARNESS
    forward_stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE] = 1500.0
    forward_damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 300.0
    pitch: PelvisPitch = PelvisPitch.LOCKED
    height: Annotated[quantities.Ratio, ATTACHMENTS] = 0.25
    strap_lever: Annotated[quantities.Length, LEVERS] = 0.1
    strap_stiffness: Annotated[quantities.LinearStiffness, STRAPS] = 10.0e3
    strap_damping: Annotated[quantities.LinearDamping, STRAP_DAMPINGS] = 300.0
    strap_lean: Annotated[quantities.Angle, STRAP_LEANS] = 0.0
    lock_stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 20.0e3
    lock_dissipation: Annotated[quantities.LinearDissipation, quantities.NOT_NEGATIVE] = 2.0

    def __post_init__(self) -> None:
        """Check the ranges, and that the pelvis can move."""
        super().__post_init__()
        moving = self.guide in (PelvisGuide.VERTICAL, PelvisGuide.HARNESS)
        require(moving, "guide", "vertical or harness (a free trunk walks overground)", str(self.guide))
        pitches = self.pitch is PelvisPitch.LOCKED or self.guide is PelvisGuide.HARNESS
        require(pitches, "pitch", "locked in a vertical guide, or set guide to harness", str(self.pitch))

    @property
    def pelvis(self) -> PelvisGuide:
        """Guide of the pelvis, with its pitch."""
        return self.guide if self.pitch is PelvisPitch.LOCKED else PelvisGuide.STRAPS

    @property
    def strap_sine(self) -> float:
        """Sine of the pitch at which both straps have the same tension."""
        return math.sin(self.strap_lean)

    @property
    def lever(self) -> float:
        """Distance of each strap from the axis of the trunk in [m]; 0 without straps."""
        return self.strap_lever if self.pitch is PelvisPitch.SOFT else 0.0


@dataclass(frozen=True, kw_only=True)
class SpringDamper(quantities.Parameters):
    """A linear rotary spring and a damper in parallel.

    Attributes:
        stiffness: Stiffness in [N·m/rad].
        damping: Damping in [N·m·s/rad].
    """

    stiffness: Annotated[quantities.RotaryStiffness, quantities.POSITIVE]
    damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE]


@dataclass(frozen=True, kw_only=True)
class SlidingSpringDamper(quantities.Parameters):
    """A linear spring and a damper in parallel, for translation.

    Attributes:
        stiffness: Stiffness in [N/m].
        damping: Damping in [N·s/m].
    """

    stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE]
    damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE]


@dataclass(frozen=True, kw_only=True)
class BraceParameters(quantities.Parameters):
    """Braces that bind the wearer to the device: a spring and a damper between their coordinates.

    No measurement of this device is available, all sizes are assumptions: a cuff of 10 kN/m at 0.25 m from
    the hip and at 0.2 m from the knee gives some degrees of play at the torques of the motors; the foot is
    strapped to its plate, and belts hold the pelvis. The dampers give a wearer of 70 kg a third of critical
    damping, and the foot three quarters.

    Attributes:
        pelvis: Brace between the waist of the device and the pelvis, vertical and fore-aft.
        trunk: Brace between the waist of the device and a pelvis that pitches: a belt of 10 kN/m at 0.25 m
            above the hips, with a third of critical damping.
        hip: Brace of each hip; the cuff of a thigh. It acts on the elevation of the thigh, hip flexion minus
            pitch.
        knee: Brace of each knee.
        ankle: Brace of each ankle.
    """

    pelvis: SlidingSpringDamper = SlidingSpringDamper(stiffness=20e3, damping=400.0)
    trunk: SpringDamper = SpringDamper(stiffness=600.0, damping=45.0)
    hip: SpringDamper = SpringDamper(stiffness=600.0, damping=20.0)
    knee: SpringDamper = SpringDamper(stiffness=400.0, damping=8.0)
    ankle: SpringDamper = SpringDamper(stiffness=1000.0, damping=3.0)

    def joint_brace(self, joint: JointName) -> SpringDamper:
        """Return the brace of a joint."""
        brace: SpringDamper = getattr(self, joint)
        return brace


FRONTS = quantities.Range(-10.0, 1000.0, reason="a walk to it of an hour at 1 km/h")


@dataclass(frozen=True, kw_only=True)
class ChairParameters(quantities.Parameters):
    """A seat without a back; :mod:`twin_gait.core.plant` has the law. There is no contact with the shanks.

    Attributes:
        height: Height of the seat in [m]; 0.43 in a chair of OpenSim, typically 0.48 to 0.53 in wheelchairs.
        front: Position of the front edge in [m]; the hips begin at 0.
        standing_distance: Distance of the front edge behind the hips of a standing wearer, at which the
            chair is placed when the device announces that it will sit down, in [m] (an assumption).
        depth: Depth of the seat in [m].
        rounding: Distance behind an edge over which the stiffness increases to its full value, in [m] (an
            assumption).
        stiffness: Stiffness of the seated body in [N/m]: 5 Hz with a sprung mass of 45 kg, the mean of 60
            people (Fairley and Griffin 1989, J Biomech 22:81).
        dissipation: Dissipation in [s/m]; under 550 N it equals their damping ratio of 0.475, 1340 N·s/m.
        thigh_share: Share of the stiffness that belongs to the backs of the two thighs (an assumption).
        hip_height: Height of the hips above the uncompressed seat in [m]; 0.098 in the manikin of SAE J826.
        thigh_thickness: Distance from the axis of a thigh to its back at the contact with the seat, in [m]:
            half of the thickness of sitting men (0.16 to the top of the thigh, 0.135 to 0.185 from the 5th to
            the 95th percentile).
        thigh_position: Position of that contact, as a share of the way from hip to knee (an assumption).
        friction_coefficient: Coulomb coefficient (an assumption; models of sitting have 0.6 to 0.9).
        transition_velocity: Transition velocity of the regularised friction in [m/s] (an assumption).
    """

    height: Annotated[quantities.Length, quantities.Range(0.3, 0.7)] = 0.45
    front: Annotated[quantities.Length, FRONTS] = 0.25
    standing_distance: quantities.Length = 0.1
    depth: Annotated[quantities.Length, quantities.POSITIVE] = 0.4
    rounding: Annotated[quantities.Length, quantities.POSITIVE] = 0.03
    stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE] = 44.0e3
    dissipation: Annotated[quantities.LinearDissipation, quantities.NOT_NEGATIVE] = 2.4
    thigh_share: Annotated[quantities.Ratio, quantities.SHARE] = 0.3
    hip_height: Annotated[quantities.Length, quantities.POSITIVE] = 0.1
    thigh_thickness: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.08
    thigh_position: Annotated[quantities.Ratio, quantities.SHARE] = 0.5
    friction_coefficient: Annotated[quantities.Ratio, COEFFICIENTS] = 0.7
    transition_velocity: Annotated[quantities.Speed, quantities.POSITIVE] = 0.02
