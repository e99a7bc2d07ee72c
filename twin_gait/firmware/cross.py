"""Compiler calls for a unit of the controller with its main loop, for the Cortex-M4F or this machine."""

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from twin_gait.exceptions import FirmwareError, MissingToolError

TARGET = Path(__file__).with_name("target")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion")
CORTEX_M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
INSTALL = "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
_PACKAGES = {"gcc": "gcc libc6-dev", "clang": "clang", "cppcheck": "cppcheck"}
_CAUSE = re.compile("error|undefined reference|overflowed")  # later lines are consequences of the first match


@dataclass(frozen=True)
class UnitSources:
    """C of a unit in a folder: ``<name>.c``, and ``<name>.h`` with its record, ``init`` and ``step``."""

    # Prefix of its functions, such as ``exoskeleton``; its records are then ``Exoskeleton``,
    # ``ExoskeletonInputs`` and ``ExoskeletonOutputs``.
    name: str
    folder: Path  # Folder of the two files.
    init: str = ""  # Prefix of ``init``, if it is not the name: ``joint_board_left_hip``.
    header: str = ""  # Header with record, ``init`` and ``step``, if it is not ``<name>.h``.

    @property
    def compiler_arguments(self) -> list[str]:
        """Arguments of the compiler for the unit: its names, and its source."""
        record = "".join(word.capitalize() for word in self.name.split("_"))
        names = [
            f"-DUNIT={self.name}",
            f"-DUNIT_RECORD={record}",
            f'-DUNIT_HEADER="{self.header or self.name + ".h"}"',
        ]
        names.append(f"-DUNIT_INIT={self.init or self.name}_init")
        return [*names, f"-I{self.folder}", f"{self.folder / self.name}.c"]


def find_tool(name: str) -> str:
    """Return the path of a program; raise MissingToolError with the way to install it."""
    path = shutil.which(name)
    if path is None:
        install = f"apt-get install {_PACKAGES[name]}" if name in _PACKAGES else INSTALL
        raise MissingToolError(f"{name} is not installed: {install}")
    return path


def build_object(unit: UnitSources, folder: Path) -> Path:
    """Compile a unit for the Cortex-M4F into an object file in an existing folder."""
    path = folder / f"{unit.name}.o"
    _run("arm-none-eabi-gcc", [*FLAGS, *CORTEX_M4F, *unit.compiler_arguments, "-c", "-o", path])
    return path


def build_image(unit: UnitSources, path: Path, *, flags: Sequence[str] = ()) -> Path:
    """Link a unit with main loop and start-up code of QEMU's mps2-an386 into an ELF file, without libm.

    Raises FirmwareError: there is no cross compiler, or it rejects a source.
    """
    harness = [TARGET / name for name in ("main.c", "cortex_m4.c", "clock.S")]
    script = ["-nostartfiles", "--specs=nano.specs", "-T", TARGET / "mps2_an386.ld"]
    words = [*FLAGS, *CORTEX_M4F, *flags, *script, *unit.compiler_arguments, *harness, "-o", path]
    _run("arm-none-eabi-gcc", words)
    return path


def build_host(unit: UnitSources, path: Path, *, compiler: str = "gcc", flags: Sequence[str] = ()) -> Path:
    """Link a unit with the same main loop into a program of this machine, by ``gcc`` or ``clang``."""
    _run(
        compiler, [*FLAGS, *flags, *unit.compiler_arguments, TARGET / "main.c", TARGET / "host.c", "-o", path]
    )
    return path


def compile_library(
    sources: Sequence[Path],
    *,
    compiler: str = "gcc",
    flags: Sequence[str] = (),
    libraries: Sequence[str] = (),
) -> Path:
    """Compile sources into a shared library of this machine, next to the first of them."""
    path = sources[0].with_suffix(".so")
    _run(compiler, [*FLAGS, "-shared", "-fPIC", *flags, *sources, *libraries, "-o", path])
    return path


def sizes(path: Path) -> tuple[int, int]:
    """Return the bytes of flash and RAM of an object file, without the records of its caller.

    Flash contains code, constants and the initial values of variables, as ``arm-none-eabi-size`` counts them.
    """
    text, data, bss = map(int, _run("arm-none-eabi-size", [path]).splitlines()[1].split()[:3])
    return text + data, data + bss


def _run(tool: str, words: Sequence[object]) -> str:
    command = [find_tool(tool), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode != 0:
        if "nano.specs" in done.stderr:
            raise MissingToolError(f"{tool}: the C library newlib is not installed: {INSTALL}")
        lines = [line.strip() for line in done.stderr.splitlines()] or [f"exit status {done.returncode}"]
        raise FirmwareError(f"{tool}: {next(filter(_CAUSE.search, lines), lines[0])}")
    return done.stdout
