"""Mutants of printed C: one constant of a table or of a macro changed in each."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_NUMBER = re.compile(r"REAL\(([^)]+)\)|(?<![\w.])(\d+)(?![\w.(])")
_TABLE = re.compile(r"^(?:static )?const (\w+) (\w+)(?:\[\d+\])? *=.*?;$", re.DOTALL | re.MULTILINE)
_FIELD = re.compile(r"\.(\w+) = [^=]*$")


class Mutant(NamedTuple):
    """A constant of a file of C, and the text of the file in which it is another one."""

    name: str  # Table, field and value before.
    text: str


def mutants(source: str) -> Iterator[Mutant]:
    """Yield a mutant for each number in the tables of a file: a real larger by 1 %, an integer by 1."""
    for table in _TABLE.finditer(source):
        for found in _NUMBER.finditer(source, table.start() + table.group().index("="), table.end()):
            real, whole = found.groups()
            value = float(real) * 1.01 if real and float(real) else 0.01
            changed = f"REAL({value!r})" if real else str(int(whole) + 1)
            field = _FIELD.search(source[table.start() : found.start()])
            name = f"{table.group(2)}.{field.group(1) if field else ''} {real or whole}"
            yield Mutant(name, source[: found.start()] + changed + source[found.end() :])


class Project(NamedTuple):
    """A printed project with the objects of all files but the one that is changed."""

    folder: Path
    unit: str  # Name of the file that is changed, without its end.

    def prepare(self) -> None:
        """Compile all other files."""
        for path in self.folder.glob("*.c"):
            if path.stem != self.unit:
                self._compile(path)

    def notices(self, mutant: Mutant) -> bool:
        """Return whether the test of the project, with double numbers, fails for a mutant."""
        path = self.folder / "build" / f"{self.unit}.c"
        path.write_text(mutant.text)
        self._compile(path)
        program = self.folder / "build" / "mutant"
        objects = sorted((self.folder / "build").glob("*.o"))
        subprocess.run(["gcc", *objects, "-lm", "-o", program], check=True)
        files = [self.folder / name for name in ("vectors.csv", "excitation.csv")]
        done = subprocess.run([program, *files], stdout=subprocess.DEVNULL, check=False)
        return done.returncode != 0

    def _compile(self, path: Path) -> None:
        (self.folder / "build").mkdir(exist_ok=True)
        flags = ["-std=c99", "-O1", "-ffp-contract=off", "-DREAL_DOUBLE", f"-I{self.folder}"]
        made = self.folder / "build" / f"{path.stem}.o"
        subprocess.run(["gcc", *flags, "-c", path, "-o", made], check=True)


def copied_project(folder: Path, copy: Path, unit: str) -> Project:
    """Copy a printed project, and compile what a mutant of a unit does not change."""
    shutil.copytree(folder, copy)
    project = Project(copy, unit)
    project.prepare()
    return project
