"""Parameters of crutches, and of how a person uses them."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from twin_gait.parameters import quantities

LEAN_ANGLES = quantities.Range(-0.5, 1.0, words="-0.5 to 1 rad (-29 to 57 deg)")
DELAYS = quantities.Range(0.0, 1.0, words="0 to 1 s")
CRUTCHES = quantities.Range(0.0, 5.0, exclusive_minimum=True, reason="the mass of ten aluminium crutches")
Pattern = Literal["as_needed", "four_point", "two_point"]
PATTERNS: tuple[str, ...] = get_args(Pattern)
PUSHES = quantities.Range(0.0, 1.0, reason="the whole weight on each hand")


@dataclass(frozen=True, kw_only=True)
class CrutchParameters(quantities.Parameters):
    """Two forearm crutches and the arms that hold them.

    Attributes:
        mass: Mass of a crutch in [kg] (an assumption: crutches of aluminium have 0.45 to 0.65 kg).
        centre_of_mass: Distance of the crutch's centre of mass from its tip in [m]; 0 for a point mass at the
            tip. Half way up a crutch of 1.1 m are 0.55 m (an assumption).
        inertia: Moment of inertia about the centre of mass in [kg·m²]; 0 for a point mass. A rod of 0.5 kg
            and 1.1 m has 0.05; the arm that turns with it adds 0.5 about the shoulder, computed for 70 kg
            from Winter 2009, table 4.1. The mass of the arm itself counts with the trunk.
        length: Length of straight arm and crutch as a share of the height of the wearer: 0.485 to the grip at
            the wrist and 0.332 from there to the shoulder (Drillis and Contini, in Winter 2009, fig. 4.1).
        tip_aside: Lateral distance of a tip from the outer side of the foot in [m], for the margin in the
            frontal plane only (recalled: 6 inches, the usual instruction).
        slack: Distance beyond that length at which the hand lets go, in [m] (an assumption).
        straight_stiffness: Stiffness of a straight arm and the hand that holds on, in [N/m] (an
            assumption: shoulder girdle and wrist reduce the stiffness of the elbow to 5 to 15 kN/m).
        tip_stiffness: Shear stiffness of the rubber tip in [N/m] (an assumption: it yields by a
            centimetre under 200 N). With it a planted tip rests, whereas it would creep with regularised
            friction.
        tip_damping: Shear damping of the rubber tip in [N·s/m] (an assumption: half of critical for the
            mass of the crutch).
        push_limit: Largest force of an arm along the strut in [N] (an assumption: paraplegic men push as hard
            as others, Kotajarvi et al. 2002; lifting oneself requires half the weight on each hand).
        pull_limit: Largest force with which the muscles of an arm lift a crutch in [N] (an assumption).
        tension_limit: Largest tension of an arm in [N], also of a straight one; the hand yields to a larger
            one. Infinity for a hand that always holds on, so that only the muscles are limited.
        moment_limit: Largest moment of a shoulder in [N·m] (an assumption; men typically reach 60 to 95).
    """

    mass: Annotated[quantities.Mass, CRUTCHES] = 0.5
    centre_of_mass: Annotated[
        quantities.Length, quantities.Range(0.0, 1.5, reason="the length of arm and crutch")
    ] = 0.0
    inertia: Annotated[quantities.Inertia, quantities.NOT_NEGATIVE] = 0.0
    length: Annotated[quantities.Ratio, quantities.Range(0.6, 1.1)] = 0.817
    tip_aside: Annotated[quantities.Length, quantities.Range(0.0, 1.0)] = 0.15
    slack: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.1
    straight_stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 5.0e3
    tip_stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE] = 20.0e3
    tip_damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 100.0
    push_limit: Annotated[quantities.Force, quantities.NOT_NEGATIVE] = 400.0
    pull_limit: Annotated[quantities.Force, quantities.NOT_NEGATIVE] = 100.0
    tension_limit: Annotated[quantities.Force, quantities.NON_NEGATIVE_OR_INFINITE] = math.inf
    moment_limit: Annotated[quantities.Torque, quantities.NOT_NEGATIVE] = 60.0


@dataclass(frozen=True, kw_only=True)
class ArmParameters(quantities.Parameters):
    """Control law of a person with two crutches; :mod:`twin_gait.worlds.arm_policy` defines it.

    All values are assumptions that were found together with a gait, except stiffness and damping, which are
    within the range of loaded arms (Tee et al. 2004; Perreault et al. 2001).

    Attributes:
        pattern: Order of crutches and feet: ``as_needed`` lifts a tip that has come near, ``four_point``
            moves a crutch before each step of the opposite leg, ``two_point`` moves it together with the leg.
        announce_load: Load on each crutch from which the person announces a step, with another pattern than
            ``as_needed``, in [N].
        delay: Delay from perception to the action of the muscles in [s]; people in stance have 0.15 to 0.19
            (Peterka 2002).
        lean: Lean of the trunk that the person maintains in [rad].
        axial_force: Push on each crutch, as a share of the weight of wearer and device.
        min_axial_force: Least push on each crutch in front, as a share of the weight.
        axial_force_per_lean: Increase of the push with additional lean of the trunk, as a share of the
            weight per [rad].
        axial_force_per_lean_rate: Increase of the push with the rate of the lean, as a share of the weight
            times [s/rad].
        shoulder_moment: Moment of each shoulder in [N·m] that pulls the body forwards.
        stiffness: Short-term stiffness of a loaded arm along the strut in [N/m].
        damping: Damping of a loaded arm along the strut in [N·s/m].
        transverse_stiffness: Stiffness of a loaded arm across the strut, at its tip, in [N/m].
        transverse_damping: Damping of a loaded arm across the strut, at its tip, in [N·s/m].
        swing_stiffness: Stiffness of an arm that carries its crutch, along and across, in [N/m].
        swing_damping: Damping of an arm that carries its crutch, along and across, in [N·s/m].
        yielding: Time constant in [s] with which loaded muscles adapt to slow changes of length and angle.
        lift_ahead: Distance of a tip in front of the shoulder below which it is lifted, in [m].
        reach: Angle from the vertical to which a crutch is swung, in [rad].
        clearance: Length by which arm and crutch are shortened for the swing, in [m].
        swing: Duration of the swing in [s].
        planted: Minimum time for which a crutch stays planted, in [s].
        lowering: Speed at which a crutch is put down in [m/s].
        touch: Load from which the contact of a crutch is felt in [N].
        chair_tilt: Angle of arms and crutches from the vertical to which they are swung for a chair, with the
            tips behind the shoulders, in [rad].
        stand_reach: Angle of the crutches from the vertical while the person stands, in [rad].
        stand_slack: Distance of a tip from that position above which the crutch is moved there, in [m].
        still: Time without a swing of a leg after which the person counts as standing, in [s].
        chair_axial_force: Push on each crutch while the person rises or sits down, as a share of the weight.
        chair_shoulder_moment: Moment of each shoulder in [N·m] that pulls the body forwards while the person
            rises or sits down.
        risen_length: Length of arm and crutch when the person has risen, as a share of that of a straight
            arm.
        seated_length: Length of arm and crutch when the person has sat down, as a share of that of a straight
            arm.
        chair_time: Time in which they reach that length, in [s].
        straightening: Speed at which they lengthen afterwards, until the hands feel no load, in [m/s].
    """

    pattern: Pattern = "as_needed"
    announce_load: Annotated[quantities.Force, quantities.NOT_NEGATIVE] = 20.0
    delay: Annotated[quantities.Time, DELAYS] = 0.15
    lean: Annotated[quantities.Angle, LEAN_ANGLES] = 8.0 * quantities.DEGREE
    axial_force: Annotated[quantities.Ratio, PUSHES] = 0.1
    min_axial_force: Annotated[quantities.Ratio, PUSHES] = 0.0
    axial_force_per_lean: Annotated[quantities.PerAngle, quantities.NOT_NEGATIVE] = 0.7
    axial_force_per_lean_rate: Annotated[quantities.PerAngularVelocity, quantities.NOT_NEGATIVE] = 0.2
    shoulder_moment: quantities.Torque = 5.0
    stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 4000.0
    damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 400.0
    transverse_stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 60.0
    transverse_damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 12.0
    swing_stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE] = 300.0
    swing_damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 20.0
    yielding: Annotated[quantities.Time, quantities.POSITIVE] = 0.4
    lift_ahead: quantities.Length = 0.15
    reach: Annotated[quantities.Angle, quantities.Range(0.0, math.radians(60.0))] = 20.0 * quantities.DEGREE
    clearance: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.06
    swing: Annotated[quantities.Time, quantities.POSITIVE] = 0.4
    planted: Annotated[quantities.Time, quantities.NOT_NEGATIVE] = 0.2
    lowering: Annotated[quantities.Speed, quantities.POSITIVE] = 0.25
    touch: Annotated[quantities.Force, quantities.POSITIVE] = 15.0
    chair_tilt: Annotated[quantities.Angle, LEAN_ANGLES] = 10.0 * quantities.DEGREE
    stand_reach: Annotated[quantities.Angle, LEAN_ANGLES] = 18.0 * quantities.DEGREE
    stand_slack: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.1
    still: Annotated[quantities.Time, quantities.NOT_NEGATIVE] = 1.0
    chair_axial_force: Annotated[quantities.Ratio, PUSHES] = 0.05
    chair_shoulder_moment: quantities.Torque = 0.0
    risen_length: Annotated[quantities.Ratio, quantities.Range(0.4, 1.2)] = 0.98
    seated_length: Annotated[quantities.Ratio, quantities.Range(0.4, 1.2)] = 0.65
    chair_time: Annotated[quantities.Time, quantities.POSITIVE] = 2.0
    straightening: Annotated[quantities.Speed, quantities.NOT_NEGATIVE] = 0.05
