"""Crutches, and how a person uses them."""

import math
from dataclasses import dataclass
from typing import Annotated

from twin_gait.parameters import quantities

LEANS = quantities.Range(-0.5, 1.0, words="-0.5 to 1 rad (-29 to 57 deg)")
DELAYS = quantities.Range(0.0, 1.0, words="0 to 1 s")
CRUTCHES = quantities.Range(0.0, 5.0, above=True, reason="ten times a crutch of aluminium")
PUSHES = quantities.Range(0.0, 1.0, reason="the whole weight on each hand")


@dataclass(frozen=True, kw_only=True)
class CrutchParameters(quantities.Parameters):
    """Two forearm crutches and the arms that hold them.

    Attributes:
        mass: Of a crutch as it turns about the shoulder, in its tip, in [kg] (an assumption: crutches of
            aluminium have 0.45 to 0.65 kg, half way up; the arm counts with the trunk).
        length: Of straight arm and crutch over the height of the wearer: 0.485 to the grip at the wrist and
            0.332 from there to the shoulder (Drillis and Contini, in Winter 2009, fig. 4.1).
        slack: By which a hand may be farther from the shoulder before it lets go, in [m] (an assumption).
        straight_stiffness: Of a straight arm and the hand that holds on, in [N] / [m] (an assumption:
            shoulder girdle and wrist leave 5 to 15 kN/m of what the elbow has).
        tip_stiffness: Of the rubber tip against shear, in [N] / [m] (an assumption: it gives by a centimetre
            under 200 N). What stands rests, where regularised friction would creep.
        tip_damping: Likewise in [N s] / [m] (an assumption: half of critical for the mass of the crutch).
        push_limit: Largest force of an arm along the strut in [N] (an assumption: paraplegic men push as hard
            as others, Kotajarvi et al. 2002; half the weight on each hand is what lifting oneself asks for).
        pull_limit: With which it lifts a crutch in [N] (an assumption).
        moment_limit: Largest moment of a shoulder in [N m] (an assumption; men give 60 to 95 as a rule).
    """

    mass: Annotated[quantities.Mass, CRUTCHES] = 0.5
    length: Annotated[quantities.Ratio, quantities.Range(0.6, 1.1)] = 0.817
    slack: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.1
    straight_stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 5.0e3
    tip_stiffness: Annotated[quantities.LinearStiffness, quantities.POSITIVE] = 20.0e3
    tip_damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 100.0
    push_limit: Annotated[quantities.Force, quantities.NOT_NEGATIVE] = 400.0
    pull_limit: Annotated[quantities.Force, quantities.NOT_NEGATIVE] = 100.0
    moment_limit: Annotated[quantities.Torque, quantities.NOT_NEGATIVE] = 60.0


@dataclass(frozen=True, kw_only=True)
class ArmParameters(quantities.Parameters):
    """How a person uses two crutches; :mod:`twin_gait.worlds.arm_policy` has the law.

    All are assumptions that were found together with a gait, but for stiffness and damping, which lie within
    what loaded arms have (Tee et al. 2004; Perreault et al. 2001).

    Attributes:
        delay: From what is felt to what the muscles do in [s]; people in stance have 0.15 to 0.19 (Peterka
            2002).
        lean: Of the trunk that the person keeps in [rad].
        push: On each crutch, as a share of the weight of wearer and device.
        push_per_lean: More of it by how much farther the trunk leans, as a share per [rad].
        push_per_rate: And by how fast, as a share times [s] / [rad].
        turn: Moment of each shoulder in [N m] that draws the body forwards.
        stiffness: Of an arm that is loaded, along the strut, for a moment, in [N] / [m].
        damping: In [N s] / [m].
        turning_stiffness: Across the strut at its tip in [N] / [m].
        turning_damping: In [N s] / [m].
        swing_stiffness: Of an arm that carries its crutch, along and across, in [N] / [m].
        swing_damping: In [N s] / [m].
        yielding: Time constant in [s] with which loaded muscles follow what is slow.
        lift_ahead: Way of a tip in front of the shoulder at which it is lifted, in [m].
        reach: Angle from the vertical to which a crutch is swung, in [rad].
        clearance: By which arm and crutch are shortened for it, in [m].
        swing: Length of the swing in [s].
        planted: For so long at least a crutch stays, in [s].
        lowering: Speed at which it is put down in [m] / [s].
        touch: Load at which it is felt to stand in [N].
        chair_tilt: Of arms and crutches from the vertical to which they are swung for a chair, the tips
            behind the shoulders, in [rad].
        stand_reach: Angle from the vertical at which who stands has the crutches, in [rad].
        stand_slack: By which a tip may be away from there before it is brought there, in [m].
        still: For so long no leg has swung when somebody stands, in [s].
        chair_push: On each crutch while the person rises or sits down, as a share of the weight.
        chair_turn: Moment of each shoulder in [N m] that draws the body forwards meanwhile.
        risen_length: Of arm and crutch when the person has risen, over that of a straight arm.
        seated_length: When the person has sat down; likewise.
        chair_time: In which they come to that length, in [s].
        straightening: Speed at which they grow afterwards, until the hands feel no load, in [m] / [s].
    """

    delay: Annotated[quantities.Time, DELAYS] = 0.15
    lean: Annotated[quantities.Angle, LEANS] = 8.0 * quantities.DEGREE
    push: Annotated[quantities.Ratio, PUSHES] = 0.1
    push_per_lean: Annotated[quantities.PerAngle, quantities.NOT_NEGATIVE] = 0.7
    push_per_rate: Annotated[quantities.PerAngularVelocity, quantities.NOT_NEGATIVE] = 0.2
    turn: quantities.Torque = 5.0
    stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 4000.0
    damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 400.0
    turning_stiffness: Annotated[quantities.LinearStiffness, quantities.NOT_NEGATIVE] = 60.0
    turning_damping: Annotated[quantities.LinearDamping, quantities.NOT_NEGATIVE] = 12.0
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
    chair_tilt: Annotated[quantities.Angle, LEANS] = 10.0 * quantities.DEGREE
    stand_reach: Annotated[quantities.Angle, LEANS] = 18.0 * quantities.DEGREE
    stand_slack: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.1
    still: Annotated[quantities.Time, quantities.NOT_NEGATIVE] = 1.0
    chair_push: Annotated[quantities.Ratio, PUSHES] = 0.05
    chair_turn: quantities.Torque = 0.0
    risen_length: Annotated[quantities.Ratio, quantities.Range(0.4, 1.2)] = 0.98
    seated_length: Annotated[quantities.Ratio, quantities.Range(0.4, 1.2)] = 0.65
    chair_time: Annotated[quantities.Time, quantities.POSITIVE] = 2.0
    straightening: Annotated[quantities.Speed, quantities.NOT_NEGATIVE] = 0.05
