"""Which column of a log holds what: the names that quantities go by, and the units that are understood."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from twin_gait.exceptions import ParameterError, ParameterFileError


class Quantity(StrEnum):
    """A column that the identification can use."""

    TIME = "time"
    ANGLE = "angle"
    VELOCITY = "velocity"
    FRICTION_TORQUE = "friction_torque"
    LOAD_TORQUE = "load_torque"
    TARGET_CURRENT = "target_current"
    MEASURED_CURRENT = "measured_current"
    TEMPERATURE = "temperature"
    MASS = "mass"


_ANGLE_UNITS = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0, "turn": 2.0 * math.pi}
_TORQUE_UNITS = {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}
_CURRENT_UNITS = {"A": 1.0, "mA": 1e-3}
# Factor to SI by the way a unit is written.
UNITS: Mapping[Quantity, Mapping[str, float]] = {
    Quantity.TIME: {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0},
    Quantity.ANGLE: _ANGLE_UNITS,
    Quantity.VELOCITY: {
        **{f"{name}/s": factor for name, factor in _ANGLE_UNITS.items()},
        "rpm": 2.0 * math.pi / 60.0,
        "rev/s": 2.0 * math.pi,
    },
    Quantity.FRICTION_TORQUE: _TORQUE_UNITS,
    Quantity.LOAD_TORQUE: _TORQUE_UNITS,
    Quantity.TARGET_CURRENT: _CURRENT_UNITS,
    Quantity.MEASURED_CURRENT: _CURRENT_UNITS,
    Quantity.TEMPERATURE: {"degC": 1.0, "°C": 1.0, "C": 1.0},
    Quantity.MASS: {"kg": 1.0, "g": 1e-3},
}
# Names without their unit, lower case, best first.
KNOWN_NAMES: Mapping[Quantity, tuple[str, ...]] = {
    Quantity.TIME: ("time", "t", "timestamp"),
    Quantity.ANGLE: ("position", "angle", "theta", "q"),
    Quantity.VELOCITY: ("velocity", "omega", "speed", "dq", "qd"),
    Quantity.FRICTION_TORQUE: ("friction_torque", "torque_friction", "t_fr", "tau_f"),
    Quantity.LOAD_TORQUE: ("load_torque", "torque_load"),
    Quantity.TARGET_CURRENT: ("target_current", "current_target"),
    Quantity.MEASURED_CURRENT: ("measured_current", "current_measured", "current"),
    Quantity.TEMPERATURE: ("temperature", "temp"),
    Quantity.MASS: ("mass", "weight"),
}

LISTED = 12  # columns that a message names
_SHORT_UNIT, _NO_UNIT = 3, ("-", "1", "SI", "raw")
_BRACKETED = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]$")


def _split_unit(column: str, quantity: Quantity) -> tuple[str, str | None]:
    """Name and unit of a column that states it: ``velocity [deg/s]`` or ``velocity_deg_per_s``."""
    text = column.strip()
    bracketed = _BRACKETED.match(text)
    if bracketed:
        return bracketed["name"], known_unit(bracketed["unit"], quantity)
    for unit in sorted(UNITS[quantity], key=len, reverse=True):
        ending = "_" + unit.replace("/", "_per_")
        if text.endswith(ending):
            return text[: -len(ending)], unit
    return text, None


def _unknown_unit(column: str, quantity: Quantity) -> str | None:
    """A unit that a column's name states and that none here is: a ratio, or a short word in brackets."""
    bracketed = _BRACKETED.match(column.strip())
    text = bracketed["unit"].strip() if bracketed else ""
    rate = re.search(r"_([A-Za-z]+_per_[A-Za-z]+)$", column.strip())
    if rate and known_unit(rate[1], quantity) is None:
        return rate[1]
    alike = "/" in text or (0 < len(text) <= _SHORT_UNIT and text not in _NO_UNIT)
    return text if alike and known_unit(text, quantity) is None else None


def known_unit(text: str, quantity: Quantity) -> str | None:
    """A unit in the way it is written here, or None if it is none of the quantity."""
    wanted = text.strip().replace(" ", "").replace("·", "").replace("_per_", "/")
    wanted = {"N*m": "Nm", "N.m": "Nm", "sec": "s", "1/min": "rpm"}.get(wanted, wanted)
    return wanted if wanted in UNITS[quantity] else None


def _factor_of(unit: str, quantity: Quantity) -> float:
    """Factor from a unit to SI."""
    known = known_unit(unit, quantity)
    if known is None:
        raise ParameterError(f"units: no unit {unit!r} of {quantity}; there are {', '.join(UNITS[quantity])}")
    return UNITS[quantity][known]


@dataclass(frozen=True, kw_only=True)
class LogColumns:
    """Which column holds what."""

    # column of a quantity; a minus before it turns the sign
    names: Mapping[Quantity, str] = field(default_factory=dict)
    # unit of a quantity, where the column does not state it; SI without one
    units: Mapping[Quantity, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for quantity, unit in self.units.items():
            _factor_of(unit, quantity)


def places_of(
    path: Path, names: tuple[str, ...], columns: LogColumns
) -> dict[Quantity, tuple[int, float, str | None]]:
    """Position, sign and unit of the column of each quantity."""
    places: dict[Quantity, tuple[int, float, str | None]] = {}
    for quantity in Quantity:
        asked = columns.names.get(quantity)
        if asked is not None:
            sign = -1.0 if asked.startswith("-") and asked not in names else 1.0
            name = asked if sign > 0.0 else asked[1:].strip()
            place = _position(path, names, name)
        else:
            sign, found = 1.0, _known_column(names, quantity)
            if found is None:
                continue
            place = found
        twice = next((other for other, (held, _, _) in places.items() if held == place), None)
        if twice is not None:
            raise ParameterFileError(path, names[place], f"is given for {twice} and {quantity}")
        places[quantity] = (place, sign, _unit(path, names[place], quantity, columns))
    return places


def _position(path: Path, names: tuple[str, ...], name: str) -> int:
    known = [place for place, known in enumerate(names) if known == name]
    known = known or [place for place, known in enumerate(names) if known.split("[")[0].strip() == name]
    if not known:
        shown = ", ".join(names[:LISTED]) + (" …" if len(names) > LISTED else "")
        raise ParameterFileError(path, name, f"no such column; there are {shown}")
    if len(known) > 1:
        raise ParameterFileError(path, name, f"{len(known)} columns have this name")
    return known[0]


def _known_column(names: tuple[str, ...], quantity: Quantity) -> int | None:
    plain = [_split_unit(name, quantity)[0].strip().lower().replace(" ", "_") for name in names]
    for known in KNOWN_NAMES[quantity]:
        if plain.count(known) == 1:
            place = plain.index(known)
            optional = quantity not in (Quantity.VELOCITY, Quantity.FRICTION_TORQUE)
            return None if optional and _unknown_unit(names[place], quantity) else place
    return None


def _unit(path: Path, column: str, quantity: Quantity, columns: LogColumns) -> str | None:
    """Unit of a column: what its name says, else what the user says, else SI."""
    stated, given = _split_unit(column, quantity)[1], columns.units.get(quantity)
    strange = _unknown_unit(column, quantity)
    if strange is not None and given is None:
        raise ParameterFileError(
            path,
            column,
            f"no unit {strange!r} of {quantity} is known; give one of {', '.join(UNITS[quantity])} with "
            f"--units {quantity}=…",
        )
    if stated is not None and given is not None and _factor_of(given, quantity) != UNITS[quantity][stated]:
        raise ParameterFileError(
            path, column, f"is in {stated} by its name; leave --units {quantity}={given} out"
        )
    if stated is None and given is not None:
        return next(name for name, factor in UNITS[quantity].items() if factor == _factor_of(given, quantity))
    return stated
