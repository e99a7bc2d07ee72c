"""Colours of figures and the viewer.

Each colour has one meaning: phases, sides, joints, parts of a torque and events share no colour with anything
else, in the light and in the dark theme. The phases have colours of Okabe and Ito (2008); stance is cold and
swing warm. The colours of a group can be distinguished with any common colour blindness. The plain names are
for figures with a legend of their own. This module imports nothing heavy.
"""

from twin_gait.vocabulary import FIRST_SWING, HOLD, STAND, GaitPhase, JointName, Side

__all__ = [
    "BLACK", "BLUE", "BLUISH_GREEN", "EVENT_COLOUR", "GREY", "JOINT_COLOURS", "ORANGE", "PHASE_COLOURS",
    "REDDISH_PURPLE", "REFERENCE_COLOUR", "SIDE_COLOURS", "SKY_BLUE", "VERMILLION", "YELLOW", "phase_colour",
]  # fmt: skip

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
BLUISH_GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
REDDISH_PURPLE = "#CC79A7"
GREY = "#7F7F7F"

PHASE_COLOURS: dict[str, str] = {
    GaitPhase.EARLY_STANCE: BLUE,
    GaitPhase.MIDDLE_STANCE: SKY_BLUE,
    GaitPhase.LATE_STANCE: BLUISH_GREEN,
    GaitPhase.SWING_FLEXION: ORANGE,
    GaitPhase.SWING_EXTENSION: VERMILLION,
}
# Colour of faults, trips and falls only.
EVENT_COLOUR = "#C1121F"
HELD_COLOUR = "#BFBFBF"
EVENT_ON_DARK = "#FF6B7F"
# Other phases: standing is neither cold nor warm, the first swing is warm; a hold is not a phase of gait.
_OTHER_PHASES = {STAND: "#6E6E6E", FIRST_SWING: YELLOW, HOLD: EVENT_COLOUR}
JOINT_COLOURS: dict[JointName, str] = {
    JointName.HIP: "#0B2A5B",
    JointName.KNEE: "#A83250",
    JointName.ANKLE: "#87A96B",
}
SIDE_COLOURS: dict[Side, str] = {Side.LEFT: "#5128B0", Side.RIGHT: "#7B4B10"}
SIDE_COLOURS_ON_DARK: dict[Side, str] = {Side.LEFT: "#B8A6FF", Side.RIGHT: "#E6C79C"}
REFERENCE_COLOUR = "#7A0177"
LIMIT_COLOUR = "#979797"
GROUND_FORCE_COLOUR = REDDISH_PURPLE
# Colours of the arrows of motor torques.
FLEXION_COLOUR, EXTENSION_COLOUR = "#6E9A00", "#B5179E"
# Parts of the commanded torque, by the words of the log columns.
TORQUE_COLOURS: dict[str, str] = {
    "impedance": "#9A6BF0",
    "friction_compensation": "#3FA7A3",
    "gravity_compensation": "#A0785A",
    "inertia_compensation": "#6C7FA8",
    "target": "#A9B331",
}
# Colours of phases of a table that does not use the five names, which the own gait of its wearer may use.
_FURTHER_COLOURS = ("#F4B183", "#A9D8C8", "#C9B8E8", "#C5E384", "#F5A3C7", *reversed(PHASE_COLOURS.values()))


def phase_colour(phase: str, position: int = 0) -> str:
    """Return the colour of a phase, also of one that only a user's table has.

    Args:
        phase: Name of the phase.
        position: Position of the phase in its table, which selects the colour of an unknown name.

    Returns:
        Colour as ``#RRGGBB``.
    """
    return (PHASE_COLOURS | _OTHER_PHASES).get(phase, _FURTHER_COLOURS[position % len(_FURTHER_COLOURS)])
