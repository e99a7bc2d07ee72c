"""Changed constants of printed C: whether the test of a project detects them, and the reason if it cannot.

Every number in the tables of a unit is changed alone: a real number by 1 %, or from 0 to 0.01 (to 1000 if it
is an initial value); a whole number and a code of the CAN codec by 1, which is subtracted from counts. The
tables of the unit are assigned at run time, so that one build serves all changes.
"""

import os
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

_NUMBER = re.compile(r"REAL\(([^)]+)\)|(?<![\w.])(\d+)(?![\w.(\]])|\bNAN\b|\btrue\b|\bfalse\b")
_TABLE = re.compile(r"^((?:static )?const \w+ (\w+)(?:\[(\d+)\])?)\s*=\s*(.*?);$", re.DOTALL | re.MULTILINE)
_FIELD = re.compile(r"\.(\w+) = [^=]*$")
_CODES = "lowest", "highest"  # Real numbers that are codes of the CAN codec.
_LAST = {"operation": 3, "blend_law": 2}  # The last choices: every larger number is taken as the same.
INITIAL = 1000.0  # In place of an initial 0; the filters of the monitor forget a small number.
POISON = "-12345"  # A whole number that no initial value is near to.
# Real numbers of which each shows, in one comparison or another, that it has been read.
POISONS = "NAN", "REAL(12345.0)", "REAL(-12345.0)"
_SECONDS = 20.0  # Longest time of a test; a changed constant may let it run without end.

NEVER_READ = "not read by the unit"
OVERWRITTEN = "initial value, overwritten before it is read"
NONE = "any number below 0 is none"
ONE_SIGNAL = "second signal of a comparison of one signal"
LAST_CHOICE = "every larger number is the same choice"
ONE_RESULT = "all and any of one result are the same"
EMPTY = "entry without bits"
ZERO = "product with a zero"
SHORTER = "time shorter than another that has to pass as well"
OUT_OF_REACH = "limit that a tighter limit keeps out of reach"
UNEXPLAINED = "not noticed"
NOTICED = "noticed"
REASONS = (
    *(NOTICED, NEVER_READ, OVERWRITTEN, NONE, ONE_SIGNAL, LAST_CHOICE, ONE_RESULT, EMPTY, ZERO, SHORTER),
    *(OUT_OF_REACH, UNEXPLAINED),
)


class Change(NamedTuple):
    """A constant in a table of a unit."""

    table: str  # Name of the table in C.
    field: str  # Name of the field; empty in a table of numbers.
    old: str  # Text of the number.
    new: str  # Text of the changed number.
    entry: str  # Text of the innermost braces around the number.
    index: int  # Place of the number in its table.


class Unit:
    """A unit of a printed project whose constants can be changed one by one."""

    def __init__(self, project: Path, name: str, build: Path) -> None:
        """Build the test of a project in a new folder, with double numbers; ``name``: of the unit."""
        self._files = [project / "vectors.csv", build / "excitation.csv"]
        self.text = (project / f"{name}.c").read_text(encoding="utf-8")
        self.changes = list[Change]()
        build.mkdir()
        self._program = build / "test"
        tables = list(_TABLE.finditer(self.text))
        before, rest = self.text[: tables[0].start()], _TABLE.sub(r"\1;", self.text[tables[0].start() :])
        self.code = rest
        self._read_bodies = {int(index) for index in re.findall(r"\bbodies\[(\d+)\]", rest)}
        lines = [line for table in tables for line in self._assigned(table)]
        setter = ["#include <stdlib.h>", "#include <string.h>", "static int changed_constant, poisoned;"]
        setter += ["#define OR(place, old, new, poison) \\"]
        setter += ["    (changed_constant != (place) ? (old) : poisoned < 0 ? (new) : (poison))"]
        setter += [f"static const double poisons[] = {{{', '.join(POISONS)}}};"]
        setter += ["__attribute__((constructor)) static void assign_tables(void)", "{"]
        setter += [
            '    changed_constant = atoi(getenv("CHANGED"));',
            '    poisoned = atoi(getenv("POISON"));',
        ]
        changed = build / f"{name}.c"
        changed.write_text("\n".join([before, rest, *setter, *lines, "}", ""]), encoding="utf-8")
        others = [path for path in sorted(project.glob("*.c")) if path.stem not in (name, "runner")]
        runner = (project / "runner.c").read_text(encoding="utf-8")
        units = re.findall(rf"case (\d+):\s+if \(restart\) {{\s+{name}\w*_init", runner)
        head, *rows = (project / "excitation.csv").read_text(encoding="utf-8").splitlines(keepends=True)
        own = [row for row in rows if row.split(",", 1)[0] in units]  # No other unit has these constants.
        self._files[1].write_text(head + "".join(own), encoding="utf-8")
        for counted in ("different += hash == expected ? 0 : 1;", "different += same ? 0 : 1;"):
            assert counted in runner  # The first difference is enough.
            runner = runner.replace(counted, f"{counted} if (different > 0) {{ exit(1); }}")
        (build / "runner.c").write_text(runner, encoding="utf-8")
        flags = ["-std=gnu99", "-O1", "-ffp-contract=off", "-DREAL_DOUBLE", f"-I{project}"]
        objects = []
        for path in [changed, build / "runner.c", *others]:
            made = build / f"{path.stem}.o"
            const = ["-Dconst="] if path == changed else []
            subprocess.run(["gcc", "-w", *flags, *const, "-c", path, "-o", made], check=True)
            objects.append(made)
        subprocess.run(["gcc", *objects, "-lm", "-o", self._program], check=True)

    def _assigned(self, table: re.Match[str]) -> Iterator[str]:
        """Yield C that assigns a table, and keep its constants."""
        declaration, name, count, contents = table.groups()
        before, largest = len(self.changes), int(max(self._numbers("end_node"), default=0))

        def alternative(found: re.Match[str]) -> str:
            old, field = found.group(), _FIELD.search(contents[: found.start()])
            key = field.group(1) if field else ""
            first, end = contents.rfind("{", 0, found.start()), contents.find("}", found.end())
            new, entry = _changed(found, name, key, largest), contents[first : end + 1]
            change = Change(name, key, old, new, entry, len(self.changes) - before)
            self.changes.append(change)
            if old in ("true", "false"):
                poison = change.new
            else:
                poison = "poisons[poisoned]" if found.group(1) or old == "NAN" else POISON
            return f"OR({len(self.changes)}, {old}, {change.new}, {poison})"

        assigned = _NUMBER.sub(alternative, contents)
        kind = declaration.split()[-2]
        if count:
            yield f"    memcpy({name}, ({kind}[{count}]){assigned}, sizeof {name});"
        elif assigned.startswith("{"):
            yield f"    {name} = ({kind}){assigned};"
        else:
            yield f"    {name} = {assigned};"

    def detects(self, number: int, poison: int = -1) -> bool:
        """Return whether the test fails with constant ``number``, from 1, changed; 0 changes none.

        ``poison``: index in ``POISONS`` of the number that replaces it; -1 for the changed number.
        """
        environment = {**os.environ, "CHANGED": str(number), "POISON": str(poison)}
        command = [self._program, *self._files]
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, timeout=_SECONDS, check=False
            )
        except subprocess.TimeoutExpired:
            return True
        return done.returncode != 0

    def reason(self, number: int) -> str:
        """Return why an undetected change has no effect; ``UNEXPLAINED`` if there is no reason."""
        change = self.changes[number - 1]
        if change.field and not re.search(rf"(?:->|\.){change.field}\b", self.code):
            return NEVER_READ
        poisons = range(len(POISONS)) if "_at_start" in change.table else ()
        if poisons and not any(self.detects(number, poison) for poison in poisons):
            return OVERWRITTEN
        if change.field in ("timeout_ticks", "tick") and f".{change.field} = -{change.old}" in change.entry:
            return NONE
        if change.field == "signal_b" and ".factor_b = REAL(0.0)" in change.entry:
            return ONE_SIGNAL
        if change.field == "operation" and ".operand = 1}" in change.entry and change.old == "2":
            return ONE_RESULT
        if change.field == "equilibrium" and ".stiffness = REAL(0.0), .damping = REAL(0.0)" in change.entry:
            return ZERO
        if change.old == str(_LAST.get(change.field)):
            return LAST_CHOICE
        if ".mask = 0," in change.entry:
            return EMPTY
        if change.table.endswith("_bodies") and change.index not in self._read_bodies:
            return NEVER_READ
        if change.field == "inertia_gain" or change.table.endswith("inertia_torque"):
            torques = [
                float(item.old[5:-1]) for item in self.changes if item.table.endswith("inertia_torque")
            ]
            return ZERO if not any(torques) and ".inertia_gain = REAL(0.0)" in self.text else UNEXPLAINED
        if change.field == "debounce_ticks" or change.table.endswith("minimum_ticks"):
            return SHORTER if self._is_shorter(change) else UNEXPLAINED
        if change.field == "current" and self._current_is_out_of_reach(change):
            return OUT_OF_REACH
        return UNEXPLAINED

    def _numbers(self, field: str, text: str = "") -> list[float]:
        """Return the numbers of a field in the tables, or in a part of their text."""
        found = re.findall(rf"\.{field} = (-?)(?:REAL\()?([\d.e+-]+)", text or self.text)
        return [float(sign + number) for sign, number in found]

    def _is_shorter(self, change: Change) -> bool:
        """Return whether the changed ticks pass before another time of the transition."""
        rules = list(zip(*map(self._numbers, ("source", "debounce_ticks")), strict=True))
        if change.field == "debounce_ticks":  # With a guard that is always open, of no results.
            (first,), (end,), (timeout,) = (
                self._numbers(name, change.entry) for name in ("first_node", "end_node", "timeout_ticks")
            )
            nodes = list(zip(*map(self._numbers, ("operation", "operand")), strict=True))
            return nodes[int(first) : int(end)] == [(2.0, 0.0)] and int(change.new) <= timeout
        # A leg that begins in a phase is in it for a tick less than one that enters it.
        begins = change.index in self._numbers("phase", self.text[self.text.index("_at_start") :])
        waits = [debounce for source, debounce in rules if source == change.index]
        return int(change.new) <= min(waits) - begins

    def _current_is_out_of_reach(self, change: Change) -> bool:
        """Return whether the largest torque of every motor needs less than the largest current."""
        (torque,), (current,) = (self._numbers(name, change.entry) for name in ("torque", "current"))
        motors = zip(*map(self._numbers, ("torque_constant", "gear_ratio")), strict=True)
        return all(torque / (constant * ratio) < current for constant, ratio in motors)


def _changed(found: re.Match[str], table: str, field: str, largest: int) -> str:
    """Return the text of a changed number; ``largest``: index that is one past the end of the nodes."""
    real, old = found.group(1), found.group()
    if real:
        value, zero = float(real), INITIAL if "_at_start" in table else 0.01
        larger = value + 1.0 if field in _CODES else value * 1.01 if value else zero
        return f"REAL({larger!r})"
    if old in ("NAN", "true", "false"):
        return {"NAN": "REAL(1.0)", "true": "false", "false": "true"}[old]
    less = field.startswith("n_") or field == "debounce" or (field == "end_node" and int(old) == largest)
    return str(int(old) + (-1 if less else 1))


def classified(unit: Unit, step: int = 1) -> tuple[Counter[str], list[Change]]:
    """Return the numbers of detected constants and of each reason, and the constants without a reason.

    ``step``: 1 for every constant, 2 for every second one.
    """
    assert not unit.detects(0), "the test of the project itself fails"

    def found(number: int) -> str:
        return NOTICED if unit.detects(number) else unit.reason(number)

    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(found, range(1, len(unit.changes) + 1, step)))
    pairs = zip(unit.changes[::step], results, strict=True)
    return Counter(results), [change for change, result in pairs if result == UNEXPLAINED]
