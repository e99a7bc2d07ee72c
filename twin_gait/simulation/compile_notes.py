"""Messages on compilations, with the reason for a compilation and the time that earlier compilations took.

A record is stored next to each loop in the code cache, with the build flags and the compile time of the loop.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import NamedTuple

MOST_WORDS = 5  # Longest list of build flags in a message.
_FLAG = re.compile(r"'([A-Z][A-Z0-9_]*)': (-?\d+|True|False|\([\d, ]*\))")
_OFF = {"False", "0", "-1", "()"}
_KINDS = {
    "run_ticks_at": "the engine",
    "in lanes": "the engine for many runs at once",
    "run_plant_part": "the plant for a controller of your own",
    "bench": "the joint bench",
}
# Build flags in words; any other flag is shown by its name.
_WORDS = {
    "WEARER_OFFSET": "braces",
    "WITH_SUPERVISOR": "modes",
    "WITH_NETWORK": "network",
    "WITH_CENTRAL_IMPEDANCE": "impedance over the network",
    "WITH_CONTROLLER": "control mode other than impedance",
    "WITH_OTHER_FRICTION_LAWS": "LuGre or asymmetric friction",
    "FRICTION_INDICES": "other joints with friction",
    "WITH_ANKLES": "ankles",
    "WITH_OWN_GAIT": "own gait of the wearer",
    "N_CRUTCHES": "crutches",
    "WITH_SEAT": "chair",
    "WITH_FAULTS": "faults",
    "WITH_DELAY": "delayed commands",
    "WITH_SLOPE": "slope",
    "WITH_INERTIA_COMPENSATION": "inertia compensation",
    "WITH_RK4": "Runge-Kutta integration",
    "PELVIS_INDEX": "moving pelvis",
    "FORWARD_INDEX": "fore-aft motion",
    "PITCH_INDEX": "free trunk",
    "N_POINTS_PER_FOOT": "ground contact",
}
_COUNTS = {
    ("N_LEGS", "1"): "one leg", ("N_LEGS", "2"): "two legs",
    ("N_JOINTS_PER_LEG", "1"): "one controlled joint per leg",
    ("N_JOINTS_PER_LEG", "2"): "two controlled joints per leg",
    ("N_JOINTS_PER_LEG", "3"): "three controlled joints per leg",
}  # fmt: skip


class LoopVariant(NamedTuple):
    """Kind of a loop and the build flags that it is compiled for, as text."""

    kind: str
    flags: Mapping[str, str]


class Compilation(NamedTuple):
    """Record of a compilation whose result is in the code cache."""

    kind: str
    flags: Mapping[str, str]
    sources: str  # Hash of all sources, packages and the processor.
    seconds: float  # Compile time in [s].

    def to_json(self) -> str:
        """Return the record as JSON."""
        return json.dumps(self._asdict())


def parse_variant(text: str) -> LoopVariant:
    """Return the kind and the build flags that are in the text that identifies a loop in the code cache."""
    kind = re.match(r"[a-z_ ]*", text)
    return LoopVariant(kind[0].strip() if kind else "", dict(_FLAG.findall(text)))


def read_records(contents: Iterable[bytes | None]) -> list[Compilation]:
    """Return the records among the contents of files; files without a record are left out."""
    found = []
    for content in contents:
        try:
            record = Compilation(**json.loads(content or b""))
            seconds = float(record.seconds)
            if 0.0 < seconds < float("inf") and isinstance(record.flags, dict):
                found.append(record._replace(seconds=seconds))
        except (ValueError, TypeError):
            continue
    return found


def compile_text(
    pattern: LoopVariant, sources: str, records: Sequence[Compilation], *, has_user_code: bool
) -> str:
    """Return the line that announces a compilation.

    Args:
        pattern: The loop that is compiled.
        sources: Hash of all sources, packages and the processor.
        records: Compilations whose results are in the code cache.
        has_user_code: Whether the loop contains functions of the user.

    Returns:
        A text with the kind of the loop, the reason for the compilation and the expected time, which is the
        median of earlier compilations of this kind.
    """
    alike = [item for item in records if item.kind == pattern.kind]
    current = [item for item in alike if item.sources == sources]
    if has_user_code:
        reason = "a controller of your own is compiled in each process"
    elif current:
        nearest = min(current, key=lambda item: len(_differing(pattern, item)))
        words = _differing(pattern, nearest) or ["model or log columns"]
        more = f" and {len(words) - MOST_WORDS} more" if len(words) > MOST_WORDS else ""
        reason = f"new combination: {', '.join(words[:MOST_WORDS])}{more}"
    elif alike:
        reason = "the program, a library or the processor has changed"
    else:
        reason = "first use on this machine"
    expected = f"; about {median(item.seconds for item in alike):.0f} s" if alike else ""
    return f"compiling {_KINDS.get(pattern.kind, 'a loop')} ({reason}{expected})"


def _differing(pattern: LoopVariant, other: Compilation) -> list[str]:
    """Return the build flags of a pattern that differ from those of a compilation, in words."""
    return [
        _flag_text(name, pattern.flags.get(name, "0"))
        for name in dict.fromkeys((*pattern.flags, *other.flags))
        if _value(pattern.flags, name) != _value(other.flags, name)
    ]


def _value(flags: Mapping[str, str], name: str) -> str:
    """Return the value of a flag; a flag that is off equals one that does not exist."""
    value = flags.get(name, "0")
    return "0" if value in _OFF else value


def _flag_text(name: str, value: str) -> str:
    if (name, value) in _COUNTS:
        return _COUNTS[name, value]
    word = _WORDS.get(name, name.lower().replace("_", " "))
    return f"no {word}" if value in _OFF else word
