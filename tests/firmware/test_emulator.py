"""Tests of a unit on the Cortex-M4F in QEMU and on this machine: equal bits, instruction counts, cleanup."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from errors import raises
from firmware_tools import SANITIZE, TARGET_TOOLS, require_tools, write_unit

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.cross import UnitSources, build_host, build_image, build_object
from twin_gait.firmware.emulator import Emulator, HostUnit

HANG, FAULT, CONVERT = -1, -2, -3

# Arithmetic on two floats, a sum over time, and a command: turns of a loop, or a way to end badly.
STEP = """
    if (in->command == -1) { for (;;) { __asm volatile("nop"); } }
    if (in->command == -2) { out->sum = *(volatile float *)0x60000000; }
    if (in->command == -3) { unit->ticks = (int32_t)in->a; }
    for (int32_t i = 0; i < in->command; i++) { __asm volatile("nop"); }
    unit->ticks++;
    unit->total += 0.1f * (float)in->command;
    out->sum = in->a + in->b;
    out->difference = in->a - in->b;
    out->product = in->a * in->b;
    out->quotient = in->a / in->b;
    out->total = unit->total;
    out->less = in->a < in->b;
    out->ticks = unit->ticks;
"""
RESULTS = ("sum", "difference", "product", "quotient", "total")
INPUTS = np.dtype([("a", "f4"), ("b", "f4"), ("command", "i4")])
OUTPUTS = np.dtype([*((name, "f4") for name in RESULTS), ("less", "i4"), ("ticks", "i4")])


@pytest.fixture(scope="module")
def probe(tmp_path_factory) -> UnitSources:
    return write_unit(
        tmp_path_factory.mktemp("probe") / "unit",
        inputs="float a, b; int32_t command;",
        outputs=f"float {', '.join(RESULTS)}; int32_t less, ticks;",
        state="float total; int32_t ticks;",
        step=STEP,
    )


@pytest.fixture(scope="module")
def image(probe, tmp_path_factory) -> Path:
    require_tools(*TARGET_TOOLS)
    return build_image(probe, tmp_path_factory.mktemp("image") / "probe.elf", flags=["-Werror"])


@pytest.fixture(scope="module")
def program(probe, tmp_path_factory) -> Path:
    require_tools("gcc")
    return build_host(probe, tmp_path_factory.mktemp("host") / "probe", flags=["-Werror"])


def inputs_of(*commands: int) -> np.ndarray:
    rows = np.zeros(len(commands), INPUTS)
    rows["b"], rows["command"] = 1.0, commands
    return rows


def any_floats(rng: np.random.Generator, ticks: int) -> np.ndarray:
    """Floats of every kind: any bits, pairs of neighbours, subnormal numbers, and what is not finite."""
    bits = rng.integers(0, 1 << 32, (ticks, 2), dtype=np.uint32)
    near = rng.random(ticks) < 0.5
    bits[near, 1] = bits[near, 0] ^ (bits[near, 1] >> 7)
    bits[rng.random(ticks) < 0.1] &= np.uint32(0x81FFFFFF)  # subnormal, or the first normal ones
    rows = np.zeros(ticks, INPUTS)
    rows["a"], rows["b"] = bits.view("f4").T
    rows["command"] = rng.integers(0, 4, ticks)
    rows[:4] = [(np.nan, 1.0, 0), (np.inf, np.inf, 0), (0.0, -0.0, 0), (-np.inf, 0.0, 0)]
    return rows


def test_target_host_and_numpy_agree_bit_for_bit(image, program, rng):
    """Subnormal numbers are kept. A NaN is one on all; its sign and payload are the processor's own."""
    rows = any_floats(rng, 20_000)
    with Emulator(image) as target, HostUnit(program) as host:
        on_target, on_host = (unit.exchange(rows).view(OUTPUTS)[:, 0] for unit in (target, host))
    a, b = rows["a"], rows["b"]
    total = np.cumsum(np.float32(0.1) * rows["command"].astype("f4"), dtype="f4")
    with np.errstate(all="ignore"):
        expected = dict(zip(RESULTS, (a + b, a - b, a * b, a / b, total), strict=True))
    for name, values in expected.items():
        numbers = ~np.isnan(values)
        subnormal = numbers & (values != 0.0) & (np.abs(values) < np.finfo("f4").tiny)
        assert name == "total" or subnormal.sum() > 100
        for found in (on_target[name], on_host[name]):
            np.testing.assert_array_equal(found[numbers].view("u4"), values[numbers].view("u4"))
            assert np.isnan(found[~numbers]).all()
    for found in (on_target, on_host):
        np.testing.assert_array_equal(found["less"], a < b)
        np.testing.assert_array_equal(found["ticks"], np.arange(1, len(rows) + 1))


def test_one_by_one_and_together_are_the_same_walk(image, rng):
    rows = any_floats(rng, 300)
    with Emulator(image) as target:
        together = target.exchange(rows)
    with Emulator(image) as again:
        single = np.concatenate([again.exchange(row) for row in rows[:, np.newaxis]])
    np.testing.assert_array_equal(single, together)
    np.testing.assert_array_equal(again.instructions, target.instructions)
    assert again.stack_bytes == target.stack_bytes


def test_instructions_match_the_listing(tmp_path):
    """Without a branch, as many instructions run as the disassembler lists."""
    require_tools(*TARGET_TOOLS)
    polynomial = "float y = 0.0f;" + "y = y * in->x + unit->last;" * 37 + "out->y = y; unit->last = in->x;"
    unit = write_unit(
        tmp_path / "unit", inputs="float x;", outputs="float y;", state="float last;", step=polynomial
    )
    made = build_object(unit, tmp_path)
    words = ["arm-none-eabi-objdump", "--disassemble=probe_step", "--no-show-raw-insn", str(made)]
    listing = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    body = listing.partition("<probe_step>:\n")[2].partition("\tbx\tlr")[0]
    listed = len(body.splitlines())  # the last one is the return; constants lie behind it
    assert listed > 2 * 37  # a product and a sum each
    with Emulator(build_image(unit, tmp_path / "image.elf")) as target:
        target.exchange(np.linspace(0.0, 1.0, 50, dtype="f4"))
    assert set(target.instructions) == {listed}


def test_instructions_of_each_tick_are_exact(image):
    """A loop of n turns runs n times the instructions of one, also in long ticks and after a restart."""
    turns = np.concatenate([np.arange(1, 50), [100_000] * 600, np.arange(49, 0, -1)])
    with Emulator(image) as target:
        target.exchange(inputs_of(*turns))
    first, second = target.instructions[:2]
    np.testing.assert_array_equal(target.instructions, first + (turns - 1) * (second - first))
    assert target.instructions.sum() > 2**32 / 25.6


def test_stack_is_the_deepest(tmp_path):
    require_tools(*TARGET_TOOLS)
    step = "volatile int32_t room[200]; if (in->deep) { room[0] = 1; room[199] = 2; } out->y = in->deep;"
    unit = write_unit(
        tmp_path / "unit", inputs="int32_t deep;", outputs="int32_t y;", state="int32_t none;",
        step=f"{step} (void)unit;",
    )  # fmt: skip
    with Emulator(build_image(unit, tmp_path / "image.elf")) as target:
        target.exchange(np.array([0], "i4"))
        shallow = target.stack_bytes
        target.exchange(np.array([0, 1, 0], "i4"))
    assert shallow < 200 and 800 <= target.stack_bytes < 1000


def test_a_unit_that_hangs_is_stopped(image):
    with Emulator(image, timeout=2.0) as target:  # time enough to start on a machine that is busy
        pid = pid_of(target)
        with raises(FirmwareError, "2 s"):
            target.exchange(inputs_of(HANG))
        assert not exists(pid)


def test_a_fault_of_the_processor_is_reported(image):
    with Emulator(image) as target, raises(FirmwareError, "qemu-system-arm", "fault"):
        target.exchange(inputs_of(FAULT))


def test_a_wrong_image_is_refused_in_one_line(tmp_path):
    require_tools(*TARGET_TOOLS)
    (tmp_path / "image.elf").write_text("no image")
    with pytest.raises(FirmwareError) as caught, Emulator(tmp_path / "missing.elf"):
        pass
    assert "missing.elf" in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(FirmwareError), Emulator(tmp_path / "image.elf", timeout=1.0):
        pass


def test_inputs_of_another_size_are_refused(program):
    with HostUnit(program) as host, raises(FirmwareError, "12", "8"):
        host.exchange(np.zeros((1, 2), "f4"))


def test_a_full_stack_is_reported(tmp_path):
    require_tools(*TARGET_TOOLS)
    fill = "volatile int32_t room[1200]; for (int32_t i = 0; i < in->words; i++) { room[1199 - i] = i; }"
    unit = write_unit(
        tmp_path / "unit", inputs="int32_t words;", outputs="int32_t y;", state="int32_t none;",
        step=f"{fill} out->y = room[1199]; (void)unit;",
    )  # fmt: skip
    with Emulator(build_image(unit, tmp_path / "image.elf")) as target:
        target.exchange(np.array([900], "i4"))
        with raises(FirmwareError, "4 kB"):
            target.exchange(np.array([1200], "i4"))


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_nothing_is_left_when_the_block_is_left(image, error):
    with pytest.raises(error), Emulator(image) as target:
        target.exchange(inputs_of(0))
        pid = pid_of(target)
        raise error
    assert not exists(pid)


@pytest.mark.slow
def test_the_emulator_ends_when_its_owner_is_killed(image):
    code = (
        "import sys, time; from pathlib import Path; from twin_gait.firmware.emulator import Emulator\n"
        "with Emulator(Path(sys.argv[1])) as target: print(target.process.pid, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code, image], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        pid = int(owner.stdout.readline())
        assert exists(pid)
        owner.kill()
    end = time.monotonic() + 10.0
    while exists(pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert not exists(pid)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_undefined_behaviour_stops_the_unit(probe, tmp_path, compiler):
    require_tools(compiler)
    rows = inputs_of(CONVERT, CONVERT)
    rows["a"] = [1.5, 3e9]
    with HostUnit(
        build_host(probe, tmp_path / "probe", compiler=compiler, flags=[*SANITIZE, "-Werror"])
    ) as host:
        host.exchange(rows[:1])
        with raises(FirmwareError, "probe.c", "3e+09", "int"):
            host.exchange(rows[1:])


def pid_of(unit: HostUnit | Emulator) -> int:
    assert unit.process is not None
    return unit.process.pid


def exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # Whose parent has died may wait for the system to collect it.
    state = Path(f"/proc/{pid}/stat")
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"
