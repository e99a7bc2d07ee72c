"""Tests of the cross-compilation of units: linked symbols, sizes, and messages on failure."""

from __future__ import annotations

import numpy as np
import pytest
from errors import raises
from firmware_tools import TARGET_TOOLS, require_tools, symbols, write_unit

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.cross import build_host, build_image, build_object, find_tool, sizes
from twin_gait.firmware.emulator import Emulator


def unit_of(folder, step, **records):
    records = {"inputs": "float x;", "outputs": "float y;", "state": "float z;", **records}
    return write_unit(folder, step=f"(void)unit; {step}", **records)


@pytest.mark.parametrize("tool", [*TARGET_TOOLS, "gcc", "clang"])
def test_a_missing_tool_is_named_with_its_package(monkeypatch, tool):
    monkeypatch.setenv("PATH", "")
    with raises(FirmwareError, tool, "apt-get install") as caught:
        find_tool(tool)
    assert tool[:3] in str(caught.value).partition("apt-get install")[2]


def test_a_missing_library_of_the_compiler_is_reported(tmp_path, monkeypatch):
    compiler = tmp_path / "arm-none-eabi-gcc"
    compiler.write_text("#!/bin/sh\necho \"fatal error: cannot read spec file 'nano.specs'\" >&2; exit 1\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    with raises(FirmwareError, "arm-none-eabi-gcc", "newlib", "apt-get install", "libnewlib-arm-none-eabi"):
        build_image(unit_of(tmp_path / "unit", "out->y = in->x;"), tmp_path / "image.elf")


def test_single_precision_needs_no_library(tmp_path):
    require_tools(*TARGET_TOOLS)
    unit = unit_of(tmp_path / "unit", "out->y = in->x * 1.5f;")
    assert set(symbols([build_object(unit, tmp_path)])) == {"probe_init", "probe_step"}
    names = symbols([build_image(unit, tmp_path / "image.elf")])
    assert names["probe_step"] == "T"
    assert not [name for name in names if "alloc" in name or name.startswith("__aeabi_")]


def test_double_precision_shows_in_the_symbols(tmp_path):
    require_tools(*TARGET_TOOLS)
    unit = unit_of(tmp_path / "unit", "out->y = (float)((double)in->x * 1.1);")
    found = symbols([build_object(unit, tmp_path)])
    assert found["__aeabi_dmul"] == "U"
    assert "__aeabi_dmul" in symbols([build_image(unit, tmp_path / "image.elf")])


def test_the_mathematics_library_is_not_linked(tmp_path):
    require_tools(*TARGET_TOOLS)
    unit = unit_of(tmp_path / "unit", "extern float expf(float); out->y = expf(in->x);")
    with raises(FirmwareError, "probe.c", "expf"):
        build_image(unit, tmp_path / "image.elf")


def test_sizes_are_constants_in_flash_and_variables_in_ram(tmp_path):
    require_tools(*TARGET_TOOLS)
    index = "out->y = TABLE[(int32_t)in->x & 31];"
    table = "float TABLE[32] = {1.0f};"
    constant, variable = (
        sizes(build_object(unit_of(tmp_path / kind, f"static {kind} {table} {index}"), tmp_path))
        for kind in ("const", "volatile")
    )
    assert constant[1] == 0 and constant[0] > 128
    assert variable[1] == 128 and abs(variable[0] - constant[0]) < 32


def test_variables_have_their_initial_values(tmp_path):
    require_tools(*TARGET_TOOLS)
    table = "static volatile float table[4] = {3.0f, 4.0f, 5.0f}; static volatile float zero;"
    unit = unit_of(tmp_path / "unit", f"{table} out->y = table[(int32_t)in->x] + zero; zero += 1.0f;")
    with Emulator(build_image(unit, tmp_path / "image.elf")) as target:
        found = target.exchange(np.array([0, 1, 2, 3], "f4")).view("f4")
    np.testing.assert_array_equal(found.ravel(), [3.0, 5.0, 7.0, 3.0])


def test_code_too_large_for_the_board_is_refused(tmp_path):
    require_tools(*TARGET_TOOLS)
    unit = unit_of(tmp_path / "unit", "out->y = in->x;", state="float room[70000];")
    with raises(FirmwareError, "RAM") as caught:
        build_image(unit, tmp_path / "image.elf")
    assert "\n" not in str(caught.value)


def test_a_refused_source_is_named_with_its_line(tmp_path):
    require_tools("gcc")
    with raises(FirmwareError, "gcc", "probe.c:3", "nowhere"):
        build_host(unit_of(tmp_path / "unit", "out->y = nowhere;"), tmp_path / "probe")


@pytest.mark.parametrize(("flags", "square"), [((), 0.0), (("-ffp-contract=fast",), -(2.0**-26))])
def test_products_and_sums_are_rounded_apart(tmp_path, flags, square):
    """(1 + e)(1 - e) - 1 is 0 with two roundings, and -e² with the one of the fused instruction."""
    require_tools(*TARGET_TOOLS)
    unit = unit_of(tmp_path / "unit", "out->y = in->x * (2.0f - in->x) - 1.0f;")
    with Emulator(build_image(unit, tmp_path / "image.elf", flags=flags)) as target:
        assert target.exchange(np.array([1.0 + 2.0**-13], "f4")).view("f4") == square
