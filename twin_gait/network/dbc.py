"""Read the layout of all messages of a device from a DBC file, with cantools."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.core.can_codec import HALF_BITS, SignalLayout
from twin_gait.exceptions import MissingOptionalDependency, ParameterFileError
from twin_gait.files import read_bytes, shipped_file
from twin_gait.network.messages import CODES, ON_DEMAND, SETPOINT_SUFFIX, Signal, message_designs
from twin_gait.parameters.network import BOARDS

if TYPE_CHECKING:
    from cantools.database.can import Message as DbcMessage
    from cantools.database.can.signal import Signal as DbcSignal

PACKAGED_DBC = "twin.dbc"
DBC_ENCODING = "cp1252"  # That of cantools, too.
_WORD = 32  # Number of bits of a half of a frame.


@dataclass(frozen=True, kw_only=True)
class Message:
    """A frame of the network and its layout."""

    name: str  # Name, for example ``left_hip_setpoint``.
    identifier: int  # Identifier of 11 bits; the lowest pending one is sent first.
    length: int  # Length in bytes.
    cycle: float  # Period in [s]; 0 for a message that is sent on demand.
    # Layouts by name, in the order of :mod:`~twin_gait.network.messages`.
    signals: Mapping[str, SignalLayout]
    # Codes by the names of their values, for signals that have a table of values.
    codes: Mapping[str, Mapping[str, int]]

    @property
    def layout(self) -> list[SignalLayout]:
        """Layouts in the form that :func:`twin_gait.core.can_codec.pack_frame` takes."""
        return list(self.signals.values())

    def bounds(self, signal: str) -> tuple[float, float]:
        """Return the smallest and the largest number that a signal can represent, in its unit."""
        item = self.signals[signal]
        return item.lowest * item.scale + item.offset, item.highest * item.scale + item.offset


def find_dbc(path_or_name: str | Path) -> Path:
    """Resolve a path, or the bare name of the packaged file.

    Raises ParameterFileError if there is no such file.
    """
    path = Path(path_or_name).expanduser()
    ships = str(path_or_name) == PACKAGED_DBC
    found = path if path.is_file() else shipped_file(PACKAGED_DBC) if ships else None
    if found is None:
        expected = f"give a path, or {PACKAGED_DBC}, which is part of the package"
        raise ParameterFileError(path, "", f"there is no such DBC file; {expected}")
    return found


def load_messages(
    path_or_name: str | Path = PACKAGED_DBC, boards: Collection[str] | None = None
) -> dict[str, Message]:
    """Read the messages of a device from a DBC file.

    Args:
        path_or_name: Path of a file, or the name of the one that ships.
        boards: Boards whose messages are read; None for all boards with a setpoint in the file.

    Returns:
        Messages by name, the lowest identifier of :mod:`~twin_gait.network.messages` first. Other messages of
        the file are ignored.

    Raises:
        ParameterFileError: If a message or a signal is missing, or if the codec does not support its layout.
        MissingOptionalDependency: If cantools is not installed.
    """
    path = find_dbc(path_or_name)
    try:
        text = read_bytes(path).decode(DBC_ENCODING, errors="replace")
    except OSError as error:
        raise ParameterFileError(path, "", f"is not a DBC file ({error})") from error
    return parse_messages(text, path, boards)


def parse_messages(
    text: str, source: str | Path, boards: Collection[str] | None = None
) -> dict[str, Message]:
    """Read the messages of a device from the text of a DBC file, see :func:`load_messages`.

    ``source``: path or name for messages.
    """
    path = Path(source)
    found = {item.name: item for item in _messages_of(text, path)}
    if boards is None:
        boards = [board for board in BOARDS if f"{board}_{SETPOINT_SUFFIX}" in found]
    designs = message_designs(boards)
    for name in designs:
        problem = "there is no such message; add it, or leave network.dbc out for a generated layout"
        _require(name in found, path, name, problem)
    return {name: _message(path, found[name], design.signals) for name, design in designs.items()}


def _messages_of(text: str, path: Path) -> Iterable[DbcMessage]:
    try:
        import cantools
    except ImportError as error:
        raise MissingOptionalDependency("cantools", "can", "the CAN network") from error
    try:
        database = cantools.database.load_string(text, database_format="dbc")
    except (UnicodeDecodeError, cantools.Error) as error:
        raise ParameterFileError(path, "", f"is not a DBC file ({error})") from error
    return database.messages  # type: ignore[union-attr]  # A DBC file has no diagnostics.


def _message(path: Path, item: DbcMessage, design: Mapping[str, Signal]) -> Message:
    short = not item.is_extended_frame and not item.is_fd and item.length <= 8
    _require(short, path, item.name, "expected an identifier of 11 bits and 8 bytes at most")
    _require(item.cycle_time or item.name.endswith(ON_DEMAND), path, item.name, "expected a GenMsgCycleTime")
    known, codes = {signal.name: signal for signal in item.signals}, dict[str, dict[str, int]]()
    for name, unit in ((name, signal.unit) for name, signal in design.items()):
        key = f"{item.name}.{name}"
        _require(name in known, path, key, f"there is no such signal; expected one of {', '.join(known)}")
        has = known[name].unit or ""
        _require(has == unit, path, key, f"expected the unit {unit!r}, got {has!r}")
        codes[name] = {str(word): int(code) for code, word in (known[name].choices or {}).items()}
        for code, word in enumerate(CODES.get(name, ())):
            _require(codes[name].get(word) == code, path, key, f"expected {code} to mean {word}")
    return Message(
        name=item.name,
        identifier=item.frame_id,
        length=item.length,
        cycle=(item.cycle_time or 0) * 1e-3,
        signals={name: _signal(path, item.name, known[name]) for name in design},
        codes=codes,
    )


def _signal(path: Path, message: str, item: DbcSignal) -> SignalLayout:
    key = f"{message}.{item.name}"
    half, start = divmod(item.start, _WORD)
    plain = item.byte_order == "little_endian" and not item.is_float and not item.is_multiplexer
    _require(plain and not item.multiplexer_ids, path, key, "expected a plain integer in Intel's byte order")
    wide = f"expected to end before bit {HALF_BITS} of bytes {4 * half} to {4 * half + 3}"
    _require(start + item.length <= HALF_BITS, path, key, wide)
    top = 1 << (item.length - 1)
    least, most = (-top, top - 1) if item.is_signed else (0, 2 * top - 1)
    lowest = least if item.minimum is None else max(least, _code(item, item.minimum))
    highest = most if item.maximum is None else min(most, _code(item, item.maximum))
    spare = least if item.is_signed else most
    return SignalLayout(
        half=half,
        start=start,
        mask=2 * top - 1,
        sign=top if item.is_signed else 0,
        missing=0 if lowest <= spare <= highest else spare,  # Code 0 means no torque, or off.
        scale=float(item.scale),
        offset=float(item.offset),
        lowest=float(lowest),
        highest=float(highest),
    )


def _code(item: DbcSignal, bound: float) -> int:
    return round((bound - item.offset) / item.scale)


def _require(condition: Any, path: Path, key: str, problem: str) -> None:
    if not condition:
        raise ParameterFileError(path, key, problem)
