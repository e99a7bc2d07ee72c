"""Labels of quantities for people: name, symbol, unit and display unit of each, from its key.

A key is a column of the log, a number of a summary or of a table of runs, or a path of a parameter, such as
``left_knee_angle_rad``, ``sides.left.walk.load_peak`` or ``scenario.belt_speed_m_per_s``. The key states the
unit. The name follows from the words of the key, unless ``labels.yaml`` declares another one. Sides, joints
and phases of the key come before the name.
"""

import itertools
import math
import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from twin_gait.vocabulary import JointName, Side
from twin_gait.yaml12 import load_data

NO_UNIT = "1"
# Units as text, by their spelling in keys, which joins them by ``_per_``.
_UNITS = {
    **{unit: unit for unit in "rad s ms m mm km h min N A V W Wh J kg Hz bit kbit ppm".split()},
    **{"deg": "°", "us": "µs", "s2": "s²", "s3": "s³", "m1p5": "m^1.5", "Nm": "N·m", "Nms": "N·m·s"},
    **{"Ns": "N·s", "kgm2": "kg·m²", "Ohm": "Ω", "percent": "%", "pct": "%", "years": "years"},
}
_UNIT = re.compile(r"_(?:({0})(?:_per_({0}))?|per_({0}))$".format("|".join(_UNITS)))
# Display units of all quantities with a unit, and factors from a unit to a display unit.
_SHOWN = {"rad": "°", "rad/s": "°/s", "N·m/rad": "N·m/°"}
_DEGREES = 180.0 / math.pi
_FACTORS = {
    **{("rad", "°"): _DEGREES, ("rad/s", "°/s"): _DEGREES, ("N·m/rad", "N·m/°"): 1.0 / _DEGREES},
    **{(NO_UNIT, "%"): 100.0, (NO_UNIT, "% of stride"): 100.0, ("m", "mm"): 1e3},
}
# Words of sections of a path; an empty one is left out.
_OMITTED = "sides joints walk scenario plant control sensors table phases conditions set free_trunk friction"
_SECTIONS = {
    **dict.fromkeys(_OMITTED.split(), ""),
    **{"errors": "error", "arms": "arm", "walk_reference": "healthy", "patient": "wearer", "stops": "stop"},
    **{"actuators": "motor", "interface": "brace", "friction_model": "model"},
}
_PARTS = ("motor", "brace", "stop", "model")  # sections whose words follow those of a place: left hip motor
_PLACES = (frozenset[str](), frozenset(Side), frozenset({*Side, *JointName, "foot"}))


@dataclass(frozen=True)
class Label:
    """Label of a quantity."""

    name: str  # Long name, such as ``left knee angle``.
    symbol: str = ""  # Symbol; empty if there is no common one.
    unit: str = NO_UNIT  # Unit of the values under the key.
    display_unit: str = NO_UNIT  # Unit in which people read the values.

    @property
    def factor(self) -> float:
        """Factor from a value under the key to the displayed value."""
        return _FACTORS.get((self.unit, self.display_unit), 1.0)

    def convert(self, value: float | None) -> float | None:
        """Convert a value under the key to the display unit; None stays None."""
        return None if value is None else self.factor * value

    @property
    def title(self) -> str:
        """Name with the display unit, for a table: ``stride time [s]``."""
        return self.name if self.display_unit == NO_UNIT else f"{self.name} [{self.display_unit}]"

    @property
    def axis(self) -> str:
        """Name with symbol and display unit, for an axis: ``left knee angle θ [°]``."""
        return replace(self, name=self.full_name).title

    @property
    def full_name(self) -> str:
        """Name with the symbol, if there is one."""
        return f"{self.name} {self.symbol}".strip()


def split_unit(key: str) -> tuple[str, str]:
    """Split a key into the words before its unit, and the unit as text, which may be empty."""
    found = _UNIT.search(key)
    if found is None:
        return key, ""
    above, below, inverse = (_UNITS.get(text or "") for text in found.groups())
    return key[: found.start()], "/".join(filter(None, (above or "1", below or inverse)))


def label_of(key: str) -> Label:
    """Return the label of a column of the log, a number of a summary, or a parameter at a path."""
    split = [split_unit(part) for part in re.split(r"[.\[\]]+", key) if part]
    parts = [text for part, _ in split[:-1] if (text := _SECTIONS.get(part, part))]
    parts += [_SECTIONS.get(part) or part for part, _ in split[-1:]]
    unit = next((unit for _, unit in reversed(split) if unit), NO_UNIT)
    if _PLACES[-1].issuperset(parts[-1].split("_")):  # an item of a mapping by joint: friction_ratio.hip
        parts = [parts[-1], *parts[:-1]]
    found, bare, location = parts[-1:], parts, list[str]()
    for start, words_of_places in itertools.product(range(len(parts)), _PLACES):
        bare, location = _without(parts, words_of_places)
        found = bare[start:]
        if "_".join(filter(None, found)) in _declared():
            break
    declared = _declared().get("_".join(filter(None, found)), {})
    unit = declared.get("unit", unit)
    usual = "%" if unit == NO_UNIT and parts[-1].endswith("share") else _SHOWN.get(unit, unit)
    words = [*_around(location, bare[: len(bare) - len(found)]), declared.get("name") or "_".join(found)]
    name = " ".join(filter(None, words)).replace("_", " ").strip()
    return Label(name, declared.get("symbol", ""), unit, declared.get("shown", usual))


def _without(parts: list[str], words_of_places: frozenset[str]) -> tuple[list[str], list[str]]:
    """Return parts of a key without the words of places, and these words in their order."""
    words = [part.split("_") for part in parts]
    bare = ["_".join(word for word in part if word not in words_of_places) for part in words]
    return bare, [word for part in words for word in part if word in words_of_places]


def _around(location: list[str], sections: list[str]) -> list[str]:
    """Return the words of places and sections in the order of a name: phase, place, part of the device."""
    named = [_declared().get(part, {}).get("name", part) for part in sections]
    parts = [part for part in named if part in _PARTS]
    return [*(part for part in named if part not in parts), *location, *parts]


@cache
def _declared() -> dict[str, dict[str, str]]:
    rows = load_data(Path(__file__).with_name("labels.yaml"))
    return {key: {"name": row} if isinstance(row, str) else row for key, row in rows.items()}
