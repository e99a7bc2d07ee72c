"""Layout of the frames of a device: ranges of its signals, and the DBC file that states them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import ROUND_FLOOR, Decimal
from pathlib import Path

from twin_gait.network.messages import (
    MONITOR,
    SETPOINT_SUFFIX,
    MessageDesign,
    Signal,
    message_designs,
    ordered_boards,
)
from twin_gait.parameters.network import CCU
from twin_gait.templates import make_template_environment

# Ranges that signals must cover, by the node that measures or executes them and by the name of the signal:
# lowest and highest number, in the unit of the signal.
Ranges = Mapping[str, Mapping[str, tuple[float, float]]]


def cover(signal: Signal, low: float, high: float) -> Signal:
    """Return a signal whose range covers some numbers, with the same bits.

    An offset is lowered to a whole tenth of the unit. The step is multiplied by the smallest number of the
    series 1, 2, 5, 10, 20, … that suffices. A signal that covers the numbers is unchanged, and so is the side
    of a range whose bound is not finite.
    """
    lowest, highest = signal.bounds
    if math.isfinite(low) and Decimal(low) < lowest and not signal.signed:
        tenths = (Decimal(low) * 10).to_integral_value(ROUND_FLOOR)
        signal = replace(signal, offset=tenths / 10)
    needed = [Decimal(bound) for bound in (low, high) if math.isfinite(bound)]
    for factor in _series():
        wider = replace(signal, step=factor * signal.step)
        lowest, highest = wider.bounds
        if all(lowest <= bound <= highest for bound in needed):
            return wider
    raise AssertionError("the series has no end")


def _series() -> Iterator[Decimal]:
    """Yield the numbers 1, 2, 5, 10, 20 and so on."""
    power = Decimal(1)
    while True:
        yield from (power, 2 * power, 5 * power)
        power *= 10


def design_messages(ranges: Ranges, phases: Sequence[str] = ()) -> dict[str, MessageDesign]:
    """Return the messages of a device with ranges that suffice for it.

    Args:
        ranges: Ranges that the signals of each board, and of the battery, must cover. A device has the
            boards that are named; a signal that is not named keeps its usual range.
        phases: Phases of the gait table, which get codes in ``gait_state``.

    Returns:
        Messages by name, the lowest identifier first.
    """
    boards, messages = ordered_boards(ranges), {}
    for message, design in message_designs(boards, phases).items():
        node = next((board for board in boards if message.startswith(f"{board}_")), message)
        needed = ranges.get(node, {})
        signals = {
            key: cover(signal, *needed[key]) if key in needed else signal
            for key, signal in design.signals.items()
        }
        messages[message] = replace(design, signals=signals)
    return messages


def widened_signals(messages: Mapping[str, MessageDesign]) -> dict[str, Signal]:
    """Return the signals whose range is not the usual one, by message and signal, such as ``imu.pitch``."""
    boards = [name.removesuffix(f"_{SETPOINT_SUFFIX}") for name in messages if name.endswith(SETPOINT_SUFFIX)]
    usual = message_designs(boards)
    return {
        f"{message}.{key}": signal
        for message, design in messages.items()
        for key, signal in design.signals.items()
        if signal.bounds != usual[message].signals[key].bounds
    }


def write_dbc(name: str, messages: Mapping[str, MessageDesign]) -> str:
    """Write messages as the text of a DBC file; ``name``: name of the device."""
    environment = make_template_environment(Path(__file__).with_name("templates"), keep_trailing_newline=True)
    environment.filters["plain"] = _plain
    nodes = dict.fromkeys((CCU, *(design.sender for design in messages.values())))
    nodes.pop(MONITOR, None)
    content = {"name": _plain_text(name), "nodes": [*nodes, MONITOR], "messages": messages}
    return environment.get_template("device.dbc").render(content, in_order=_in_order)


def _in_order(design: MessageDesign) -> list[tuple[str, Signal]]:
    """Return the signals of a message by their first bits."""
    return sorted(design.signals.items(), key=lambda item: item[1].bit)


def _plain_text(name: str) -> str:
    """Return a name in ASCII without quotation marks, as in every tool that reads DBC files."""
    return name.encode("ascii", errors="replace").decode().replace('"', "'")


def _plain(number: Decimal) -> str:
    """Return a number without exponent and trailing zeros."""
    return f"{number.normalize():f}" if number else "0"
