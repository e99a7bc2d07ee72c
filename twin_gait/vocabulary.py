"""Terms of the field that all packages share: phases of gait, joints, sides."""

from enum import StrEnum


class GaitPhase(StrEnum):
    """Phase of the gait cycle, in the order in which a leg passes through them.

    The five phases are those of the thesis (section 5.1), after Sup et al. (2009).
    """

    EARLY_STANCE = "early_stance"
    MIDDLE_STANCE = "middle_stance"
    LATE_STANCE = "late_stance"
    SWING_FLEXION = "swing_flexion"
    SWING_EXTENSION = "swing_extension"


# Phases in addition to the five of the cycle: standing still, and the swing that begins a walk.
STAND, FIRST_SWING = "stand", "first_swing"
# Pre-swing, the end of late stance as a phase of its own, from the other foot's contact to toe-off (Perry
# 1992): the only phase of stance that is called a swing.
PRE_SWING = "pre_swing"
# Phases on a chair: sitting, leaning forward to rise, rising, straightening; standing until the crutches are
# behind, and sitting down.
SIT, LEAN, RISE, STRAIGHTEN, REACH_BACK, LOWER = "sit", "lean", "rise", "straighten", "reach_back", "lower"
HOLD = "hold"  # name that is shown instead of a phase after a trip of the safety monitor


class CodedEnum(StrEnum):
    """Enumeration of words whose code is their position."""

    @property
    def code(self) -> int:
        """Number in a record and in the log."""
        return list(type(self)).index(self)


class JointName(StrEnum):
    """Joint of the leg. Hip and knee flexion and ankle dorsiflexion are positive."""

    HIP = "hip"
    KNEE = "knee"
    ANKLE = "ankle"


class Side(StrEnum):
    """Side of the body."""

    LEFT = "left"
    RIGHT = "right"


class Outcome(StrEnum):
    """Outcome of a run, determined by :mod:`twin_gait.measures.outcome`."""

    WALKED = "walked"
    TOO_SHORT = "too short to judge"
    STALLED = "stalled"
    HUNG = "hung"
    HELD = "held"
    FELL = "fell"
    DIVERGED = "diverged"


class Sex(StrEnum):
    """Sex of the wearer, for the anthropometric tables."""

    FEMALE = "female"
    MALE = "male"


class SegmentModel(StrEnum):
    """Table of the masses, centres of mass and radii of gyration of the wearer's segments."""

    DE_LEVA = "de_leva"
    WINTER = "winter"


class PelvisGuide(StrEnum):
    """Guide of the pelvis: fixed, or free to move vertically, fore-aft in a harness, and with pitch.

    The pelvis pitches in straps (``STRAPS``), or freely with a trunk that only the wearer balances.
    """

    FIXED = "fixed"
    VERTICAL = "vertical"
    HARNESS = "harness"
    STRAPS = "straps"
    FREE = "free"


class PelvisPitch(StrEnum):
    """Pitch of a pelvis in a harness: locked, held by two straps, or free under one rope."""

    LOCKED = "locked"
    SOFT = "soft"
    FREE = "free"


class Environment(StrEnum):
    """Surroundings that are drawn around a figure."""

    TREADMILL = "treadmill"
    WALKWAY = "walkway"
    STAND = "stand"
    FLOOR = "floor"
