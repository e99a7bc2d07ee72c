"""Messages between the nodes of a device and their signals: identifiers, bits, steps and units.

The topology is the star of the thesis (2.1.2): central control unit, a board at each motor, battery and
inertial unit, and the monitor (2.4) of the operator. The thesis prints neither bit rate nor layout: every
identifier, bit, step and range is an assumption. :mod:`twin_gait.network.layout` widens ranges for a device
and writes the DBC file.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from twin_gait.parameters.network import BOARDS
from twin_gait.vocabulary import Side
from twin_gait.yaml12 import load_data

COUNTS = 4  # Number of values of the counter of a frame, which has two bits.
BOARD = "board"  # Placeholder for the name of a board in senders and receivers.
MONITOR = "monitor"  # Program of the operator.


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


def _signal(row: Mapping[str, Any]) -> Signal:
    """Return a declared signal."""
    names = row.get("names", {})
    exact = {key: Decimal(row[key]) for key in ("step", "offset") if key in row}
    return Signal(**{**row, **exact, "names": dict(enumerate(names)) if isinstance(names, list) else names})


_DECLARED = load_data(Path(__file__).with_suffix(".yaml"))
# Codes that programs on both ends of the bus share.
CODES: Mapping[str, tuple[str, ...]] = {kind: tuple(names) for kind, names in _DECLARED["codes"].items()}
_SIGNALS = {
    group: {name: _signal(row) for name, row in rows.items()} for group, rows in _DECLARED["signals"].items()
}


def _designs(kind: str) -> dict[str, MessageDesign]:
    """Return the declared messages of a kind, with the signals of the groups that they name."""
    found = {}
    for name, row in _DECLARED[kind].items():
        signals = {key: signal for group in row["signals"] for key, signal in _SIGNALS[group].items()}
        found[name] = MessageDesign(**{**row, "receivers": tuple(row["receivers"]), "signals": signals})
    return found


BOARD_MESSAGES, DEVICE_MESSAGES = _designs("board_messages"), _designs("device_messages")
SETPOINT, MEASUREMENT = (BOARD_MESSAGES[kind].signals for kind in (SETPOINT_SUFFIX, MEASUREMENT_SUFFIX))
_RESERVED = "hold", "other"  # Phases whose codes no own phase of a table takes.
_CODES = DEVICE_MESSAGES["gait_state"].signals["left_phase"].names
_PHASES = {code: name for code, name in _CODES.items() if name not in _RESERVED}
_OTHER_PHASES = {code: name for code, name in _CODES.items() if name in _RESERVED}


def ordered_boards(boards: Collection[str]) -> list[str]:
    """Return boards in the order of their numbers on the bus."""
    return [board for board in BOARDS if board in boards]


def phase_codes(phases: Sequence[str]) -> dict[int, str]:
    """Return the phases of a leg by their codes in ``gait_state``.

    A phase has the same code in every layout. Own phases of a gait table have the codes of phases that the
    table lacks, in order, as far as there are any; the rest is sent as ``other``.
    """
    used = {code: name for code, name in _PHASES.items() if name in phases}
    own = [name for name in phases if name not in _CODES.values()]
    if not own:
        used = dict(_PHASES)
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
