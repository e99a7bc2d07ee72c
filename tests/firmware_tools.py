"""Compilers and emulator for the tests of the firmware, and a writer of small units."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware import Unit, find_tool

FIRMWARE_VARIABLE = "TWIN_GAIT_REQUIRE_FIRMWARE"
TARGET_TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
# A conversion out of range is also undefined behaviour, but not part of the group "undefined".
SANITIZE = ("-g", "-fsanitize=undefined,float-cast-overflow,address", "-fno-sanitize-recover=all")


def require_tools(*names: str) -> None:
    """Skip a test that lacks a program, or fail it if the environment requires the programs."""
    for name in names:
        try:
            find_tool(name)
        except FirmwareError as error:
            if os.environ.get(FIRMWARE_VARIABLE):
                pytest.fail(f"{FIRMWARE_VARIABLE} is set, but {error}")
            pytest.skip(str(error))


def symbols(objects: Sequence[Path]) -> Mapping[str, str]:
    """Return the names in object files or an image with their letter of ``nm``; ``U``: undefined there."""
    command = [find_tool("arm-none-eabi-nm"), "--format=posix", *objects]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    fields = (line.split() for line in lines)
    return {words[0]: words[1] for words in fields if len(words) > 1}


def write_unit(
    folder: Path, *, inputs: str, outputs: str, state: str, step: str, name: str = "probe"
) -> Unit:
    """Write a unit to a new folder, with the fields of its records and the body of its step."""
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
    return Unit(name, folder)
