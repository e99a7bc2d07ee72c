"""Messages between the nodes of a device and their signals: identifiers, bits, steps and units.

The topology is the star of the thesis (2.1.2): central control unit, a board at each motor, battery and
inertial unit, and the monitor (2.4) of the operator. The thesis prints neither bit rate nor layout: every
identifier, bit, step and range is an assumption. :mod:`twin_gait.network.layout` widens ranges for a device
and writes the DBC file.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal

from twin_gait.parameters.network import BOARDS, CCU
from twin_gait.vocabulary import Side

COUNTS = 4  # Number of values of the counter of a frame, which has two bits.
BOARD = "board"  # Placeholder for the name of a board in senders and receivers.
MONITOR = "monitor"  # Program of the operator.

# Codes that programs on both ends of the bus share.
CODES: Mapping[str, tuple[str, ...]] = {
    "state": ("off", "hold", "run"),
    "control": ("walk", "friction_control", "torque_control", "impedance_control"),
}
# Causes of a trip in the order of their codes, those of :class:`twin_gait.control.safety.TripCause`.
_CAUSES = (
    "none encoder_missing encoder_jump encoder_frozen encoder_against_model joint_speed joint_range command "
    "torque current winding_heat drive phase_timeout foot_load_frozen supply operator bus_timeout "
    "command_against_setpoint"
).split()
# Phases with a code; a phase of another name is sent as ``other``.
_PHASES = (
    "early_stance middle_stance late_stance swing_flexion swing_extension pre_swing stand first_swing "
    "closing_swing_flexion closing_swing_extension sit lean rise"
).split()
_OTHER_PHASES = {14: "hold", 15: "other"}


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Signal of a message: an integer code in its bits, and the number that the code stands for.

    The number is :math:`x = s c + x_0` with the code c, the step s and the offset x_0. A range leaves out one
    code, which means that there is no number: all ones, or the lowest code of a signed signal.
    """

    bit: int  # First bit, counted over the eight bytes of the frame.
    bits: int  # Number of bits.
    unit: str = ""  # Unit, as in the DBC file.
    signed: bool = False  # Whether codes are signed.
    step: Decimal = Decimal(1)  # Step s, in the unit.
    offset: Decimal = Decimal(0)  # Offset x_0, in the unit.
    last: int | None = None  # Highest code, if it is not the highest one that a range may have.
    names: Mapping[int, str] = field(default_factory=dict)  # Names of codes.
    comment: str = ""  # Meaning, for the DBC file.

    @property
    def codes(self) -> tuple[int, int]:
        """Lowest and highest code of the range."""
        if self.signed:
            most = 2 ** (self.bits - 1) - 1
            return -most, most
        return 0, 2**self.bits - 2 if self.last is None else self.last

    @property
    def bounds(self) -> tuple[Decimal, Decimal]:
        """Smallest and largest number of the range, in the unit."""
        low, high = self.codes
        return low * self.step + self.offset, high * self.step + self.offset


def _number(
    bit: int, bits: int, unit: str, step: str, comment: str, *, signed: bool = False, offset: str = "0"
) -> Signal:
    """Return a signal that is a number in a unit."""
    return Signal(
        bit=bit, bits=bits, unit=unit, signed=signed, step=Decimal(step), offset=Decimal(offset),
        comment=comment,
    )  # fmt: skip


def _named(bit: int, bits: int, names: Mapping[int, str], comment: str, *, last: int | None = None) -> Signal:
    """Return a signal whose codes have names, or count."""
    highest = 2**bits - 1 if last is None else last
    return Signal(bit=bit, bits=bits, last=highest, names=names, comment=comment)


def _counter(bit: int) -> Signal:
    return _named(bit, 2, {}, "Counts the frames of this message, so that a lost frame is detected")


_IMPEDANCE = {
    "stiffness": _number(32, 13, "Nm/rad", "0.125", "Stiffness k of the impedance"),
    "damping": _number(45, 11, "Nms/rad", "0.1", "Damping b of the impedance"),
    "equilibrium": _number(0, 14, "rad", "0.0002", "Equilibrium angle theta0", offset="-0.8"),
    "gain": _number(56, 7, "", "0.01", "Gain G of the friction compensation"),
    "torque": _number(
        14, 13, "Nm", "0.025",
        "Torque that the board adds to the impedance: gravity compensation, inertia compensation and target "
        "torque; if the ccu computes the impedance, the whole torque except friction compensation",
        signed=True,
    ),
}  # fmt: skip
# Signals in the order in which the codec receives the numbers.
SETPOINT = _IMPEDANCE | {
    "state": _named(27, 2, dict(enumerate(CODES["state"])), "State of the board", last=2),
    "counter": _counter(29),
}
COMMAND = _IMPEDANCE | {
    "control": _named(27, 2, dict(enumerate(CODES["control"])), "Control of all joints"),
    "counter": _counter(29),
}
MEASUREMENT = {
    "angle": _number(0, 19, "rad", "0.000006", "Joint angle", offset="-0.8"),
    "velocity": _number(32, 13, "rad/s", "0.002", "Fast estimate of the joint velocity", signed=True),
    "current": _number(45, 11, "A", "0.02", "Measured current of the motor", signed=True),
    "foot_load": _number(
        19, 12, "bw", "0.0005",
        "Load of the sole sensor in body weights, which is wired to the lowest board of a leg (an "
        "assumption); 0 from other boards",
    ),
    "trip_cause": _named(
        56, 5, dict(enumerate(_CAUSES)),
        "Cause of a trip that this board detected; bus_timeout: it received no setpoint and holds its joint",
    ),
    "counter": _counter(61),
}  # fmt: skip
BATTERY = {
    "voltage": _number(0, 13, "V", "0.01", "Voltage of the bus of the drives"),
    "power": _number(
        13, 14, "W", "0.25", "Power from the battery; negative if motors charge it", signed=True
    ),
}
IMU = {
    "pitch": _number(0, 15, "rad", "0.0002", "Pitch of the trunk", signed=True),
    "pitch_rate": _number(15, 15, "rad/s", "0.001", "Angular rate of the pitch", signed=True),
}
# The names of the phases are those of :func:`phase_codes`. A device of one leg sends ``other`` for the leg
# that it does not have.
GAIT_STATE = {
    **{
        f"{side}_phase": _named(4 * number, 4, {}, f"Phase of the {side} leg")
        for number, side in enumerate(Side)
    },
    "safety_state": _named(8, 1, {0: "watching", 1: "hold"}, "State of the safety monitor"),
    "trip_cause": _named(9, 5, dict(enumerate(_CAUSES)), "Cause of the trip of the device"),
    "time": _number(32, 31, "s", "0.001", "Time since the start"),
}


@dataclass(frozen=True, kw_only=True)
class MessageDesign:
    """Message of the bus before its layout is written; identifiers are priorities, the lowest first."""

    identifier: int  # Identifier of 11 bits.
    sender: str  # Node that sends the message.
    receivers: tuple[str, ...]  # Nodes that receive it.
    signals: Mapping[str, Signal]  # Signals by name, in the order of the codec.
    length: int = 8  # Length in bytes.
    cycle: int = 0  # Period in [ms]; 0 for a message that is sent on demand.
    comment: str = ""  # Meaning, for the DBC file.


ON_DEMAND = "_command"  # Suffix of the names of messages that have no cycle.
SETPOINT_SUFFIX, MEASUREMENT_SUFFIX = "setpoint", "measurement"  # The two cyclic messages of a board.
# Messages of each board, by the suffix of their names; the number of the board is added to the identifier.
BOARD_MESSAGES = {
    SETPOINT_SUFFIX: MessageDesign(
        identifier=0x100, sender=CCU, receivers=(BOARD, MONITOR), signals=SETPOINT, cycle=2
    ),
    MEASUREMENT_SUFFIX: MessageDesign(
        identifier=0x180, sender=BOARD, receivers=(CCU, MONITOR), signals=MEASUREMENT, cycle=2
    ),
    ON_DEMAND.lstrip("_"): MessageDesign(
        identifier=0x300,
        sender=MONITOR,
        receivers=(CCU,),
        signals=COMMAND,
        comment="Settings of the monitor (thesis 2.4) for a joint; control applies to all joints",
    ),
}
DEVICE_MESSAGES = {
    "battery": MessageDesign(
        identifier=0x201, sender="battery", receivers=(CCU, MONITOR), signals=BATTERY, length=4, cycle=10
    ),
    "imu": MessageDesign(
        identifier=0x202,
        sender="imu",
        receivers=(CCU, MONITOR),
        signals=IMU,
        length=4,
        cycle=10,
        comment="Inertial unit of the trunk; simulated as 0 if a guide or a harness holds the trunk upright",
    ),
    "gait_state": MessageDesign(
        identifier=0x281,
        sender=CCU,
        receivers=(MONITOR,),
        signals=GAIT_STATE,
        cycle=10,
        comment="State for observers; no board acts on it",
    ),
}


def ordered_boards(boards: Collection[str]) -> list[str]:
    """Return boards in the order of their numbers on the bus."""
    return [board for board in BOARDS if board in boards]


def phase_codes(phases: Sequence[str]) -> dict[int, str]:
    """Return the phases of a leg by their codes in ``gait_state``.

    A phase has the same code in every layout. Own phases of a gait table have the codes of phases that the
    table lacks, in order, as far as there are any; the rest is sent as ``other``.
    """
    used = {code: name for code, name in enumerate(_PHASES) if name in phases}
    own = [name for name in phases if name not in (*_PHASES, *_OTHER_PHASES.values())]
    if not own:
        used = dict(enumerate(_PHASES))
    free = [code for code in range(min(_OTHER_PHASES)) if code not in used]
    return dict(sorted((used | dict(zip(free, own, strict=False)) | _OTHER_PHASES).items()))


def message_designs(boards: Collection[str], phases: Sequence[str] = ()) -> dict[str, MessageDesign]:
    """Return the messages of a device with some boards, by name, the lowest identifier first.

    A board has the same number, and its messages the same identifiers, in every device. ``phases``: phases of
    the gait table, which get codes in ``gait_state``.
    """
    found: dict[str, MessageDesign] = {}
    for board in ordered_boards(boards):
        for suffix, design in BOARD_MESSAGES.items():
            found[f"{board}_{suffix}"] = replace(
                design,
                identifier=design.identifier + 1 + BOARDS.index(board),
                sender=board if design.sender == BOARD else design.sender,
                receivers=tuple(board if name == BOARD else name for name in design.receivers),
            )
    codes, state = phase_codes(phases), DEVICE_MESSAGES["gait_state"]
    named = {f"{side}_phase": replace(state.signals[f"{side}_phase"], names=codes) for side in Side}
    found |= DEVICE_MESSAGES | {"gait_state": replace(state, signals={**state.signals, **named})}
    return dict(sorted(found.items(), key=lambda item: item[1].identifier))
