"""Compilers and the emulator of the firmware's tests, and a unit small enough to know all about it."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.cross import UnitSources, find_tool

FIRMWARE_VARIABLE = "TWIN_GAIT_REQUIRE_FIRMWARE"
TARGET_TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
# A conversion out of range is undefined as well, and not among those of "undefined".
SANITIZE = ("-g", "-fsanitize=undefined,float-cast-overflow,address", "-fno-sanitize-recover=all")


def require_tools(*names: str) -> None:
    """Skip a test that lacks a program, or fail it where the programs are expected."""
    for name in names:
        try:
            find_tool(name)
        except FirmwareError as error:
            if os.environ.get(FIRMWARE_VARIABLE):
                pytest.fail(f"{FIRMWARE_VARIABLE} is set, but {error}")
            pytest.skip(str(error))


def symbols(objects: Sequence[Path]) -> Mapping[str, str]:
    """Names in object files or an image, and ``nm``'s letter for each: ``U`` is wanted from elsewhere."""
    command = [find_tool("arm-none-eabi-nm"), "--format=posix", *objects]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    fields = (line.split() for line in lines)
    return {words[0]: words[1] for words in fields if len(words) > 1}


def write_unit(
    folder: Path, *, inputs: str, outputs: str, state: str, step: str, name: str = "probe"
) -> UnitSources:
    """A unit in a folder that does not exist: fields of its records, and the body of its step."""
    folder.mkdir()
    records = zip(("Inputs", "Outputs", ""), (inputs, outputs, state), strict=True)
    title = name.capitalize()
    (folder / f"{name}.h").write_text(
        "#include <stdint.h>\n"
        + "".join(f"typedef struct {{ {fields} }} {title}{kind};\n" for kind, fields in records)
        + f"void {name}_init({title} *unit);\n"
        + f"void {name}_step({title} *unit, const {title}Inputs *in, {title}Outputs *out);\n"
    )
    source = folder / f"{name}.c"
    source.write_text(
        f'#include "{name}.h"\n'
        f"void {name}_init({title} *unit) {{ *unit = ({title}){{0}}; }}\n"
        f"void {name}_step({title} *unit, const {title}Inputs *in, {title}Outputs *out) {{ {step} }}\n"
    )
    return UnitSources(name, folder)
