"""Colours that pictures and the viewer share.

They are those of Okabe and Ito (2008), which people with any common colour blindness can tell apart;
stance phases are cold and swing phases warm. Nothing heavy is imported here.
"""

from __future__ import annotations

from twin_gait.vocabulary import FIRST_SWING, HOLD, STAND, GaitPhase, JointName, Side

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
BLUISH_GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
REDDISH_PURPLE = "#CC79A7"
GREY = "#7F7F7F"
ALARM_COLOUR, ALARM_ON_DARK = "#B3002D", "#FF6B7F"  # of a hold, and of what led to it

PHASE_COLOURS: dict[GaitPhase, str] = {
    GaitPhase.EARLY_STANCE: BLUE,
    GaitPhase.MIDDLE_STANCE: SKY_BLUE,
    GaitPhase.LATE_STANCE: BLUISH_GREEN,
    GaitPhase.SWING_FLEXION: ORANGE,
    GaitPhase.SWING_EXTENSION: VERMILLION,
}
# Beside the five: standing is neither cold nor warm, the first swing is warm.
_OTHER_PHASES = {STAND: GREY, FIRST_SWING: YELLOW, HOLD: ALARM_COLOUR}
JOINT_COLOURS: dict[JointName, str] = {
    JointName.HIP: BLUE,
    JointName.KNEE: VERMILLION,
    JointName.ANKLE: BLUISH_GREEN,
}
SIDE_COLOURS: dict[Side, str] = {Side.LEFT: BLUE, Side.RIGHT: VERMILLION}
REFERENCE_COLOUR = REDDISH_PURPLE
LIMIT_COLOUR = GREY
# Faults, trips and falls, and nothing else.
EVENT_COLOUR = "#C1121F"
HELD_COLOUR = "#BFBFBF"
# Parts of the commanded torque, by the words of the log columns.
TORQUE_COLOURS: dict[str, str] = {
    "impedance": REDDISH_PURPLE,
    "friction_compensation": BLUISH_GREEN,
    "gravity_compensation": ORANGE,
    "inertia_compensation": SKY_BLUE,
    "target": BLUE,
}
# Sources of work, by the words of the log columns.
WORK_COLOURS: dict[str, str] = {
    "motor": BLUE,
    "friction": VERMILLION,
    "stop": YELLOW,
    "spring": BLUISH_GREEN,
    "contact": ORANGE,
    "patient": REDDISH_PURPLE,
    "brace": SKY_BLUE,
}

# For phases of a table that does not use the five names.
_FURTHER_COLOURS = (REDDISH_PURPLE, YELLOW, GREY, *reversed(PHASE_COLOURS.values()))


def phase_colour(phase: str, position: int = 0) -> str:
    """Colour of a phase, also of one that a user's table invented.

    Args:
        phase: Name of the phase.
        position: Position of the phase in its table, which picks the colour of an unknown name.

    Returns:
        Colour as ``#RRGGBB``.
    """
    known = {str(name): colour for name, colour in PHASE_COLOURS.items()} | _OTHER_PHASES
    return known.get(phase, _FURTHER_COLOURS[position % len(_FURTHER_COLOURS)])
