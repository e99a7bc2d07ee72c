"""Whether a control can take a value."""

from __future__ import annotations

from twin_gait.live.protocol import Control, ControlKind, MessageRefused, Value


def checked(control: Control, value: Value) -> Value:
    """A value if the control can take it.

    Args:
        control: The control, or a field of an action.
        value: What was asked for.

    Raises:
        MessageRefused: If it is of the wrong kind or out of range.
    """
    if control.kind is ControlKind.SWITCH:
        return _of(control, value, isinstance(value, bool), "true or false")
    if control.kind is ControlKind.CHOICE:
        return _of(control, value, value in control.choices, " or ".join(map(repr, control.choices)))
    if control.kind is ControlKind.TEXT:
        return _of(control, value, isinstance(value, str), "a text")
    assert control.least is not None and control.largest is not None  # numbers have ranges
    number = isinstance(value, int | float) and not isinstance(value, bool)
    slack = 1e-9 * (control.largest - control.least)
    inside = number and control.least - slack <= float(value) <= control.largest + slack
    unit = f" {control.unit}" if control.unit else ""
    wanted = f"{control.least:.6g} to {control.largest:.6g}{unit}"
    return min(max(float(_of(control, value, inside, wanted)), control.least), control.largest)


def _of(control: Control, value: Value, fits: bool, wanted: str) -> Value:
    if not fits:
        shown = f"{value:.6g}" if isinstance(value, float) else repr(value)
        raise MessageRefused(f"{control.name}: expected {wanted}, got {shown}")
    return value
