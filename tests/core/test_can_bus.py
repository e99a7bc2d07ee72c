"""The CAN bus: arbitration, timing, errors, loss and outages; plain Python and machine code alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.stats import binomtest, chisquare, kstest

from twin_gait.core import can_bus
from twin_gait.core.can_bus import (
    BUS_OFF,
    FULL_SCALE,
    NEVER,
    NO_INDEX,
    REBOOT,
    SILENCE,
    Bus,
    Frame,
    Node,
    OutageRecord,
    advance,
    draw,
    is_release_due,
    mix_bits,
)
from twin_gait.core.can_frame import frame_bits, new_header
from twin_gait.simulation.compiling import compile_loop, record_accessor
from twin_gait.simulation.record import to_array

TICK, BIT = 10**9, 10**6  # [ps]; 1 ms, and 1 Mbit/s
CCU = 0
US = 10**6


def frame(identifier: int, sender: int = CCU, receiver: int = 1, release: int = NEVER, **more: int) -> Frame:
    values = {"period": 2 * TICK, "jitter": 0, "key": mix_bits(identifier), **more}
    return Frame(
        new_header(identifier, 8), sender, receiver, values["period"], values["jitter"], values["key"],
        release, release,
    )  # fmt: skip


def bus_of(
    frames: Sequence[Frame], outages: Sequence[OutageRecord] = (), errors: float = 0.0, loss: float = 0.0,
    recovers: bool = True, nodes: int = 5,
) -> Bus:  # fmt: skip
    last = [OutageRecord(SILENCE, NO_INDEX, NEVER, NEVER) for _ in range(8 - len(outages))]
    shares = int(errors * FULL_SCALE), int(loss * FULL_SCALE)
    ordered = sorted(outages, key=lambda item: item.start)
    return Bus(TICK, BIT, *shares, recovers, list(frames), [Node() for _ in range(nodes)], [*ordered, *last])


def write(bus: Bus, tick: int) -> None:
    """Give all due frames unique bits."""
    for number in range(len(bus.frames)):
        item = bus.frames[number]
        if is_release_due(bus, item, tick):
            item.outgoing.halves[0] = mix_bits(2 * (8 * tick + number))
            item.outgoing.halves[1] = mix_bits(2 * (8 * tick + number) + 1)


def run(bus: Bus, ticks: int, first: int = 0) -> Bus:
    for tick in range(first, first + ticks):
        write(bus, tick)
        advance(bus, tick)
    return bus


def bits_of(item: Frame) -> int:
    return frame_bits(item.header, item.received.halves)


# ------------------------------------------------------------------ arbitration and time


def test_of_frames_released_together_the_lowest_identifier_is_sent_first() -> None:
    frames = [frame(number, release=0) for number in (3, 5, 260, 1000)]
    run(bus_of(frames), 1)
    lengths = [bits_of(item) for item in frames]
    assert [item.worst_response for item in frames] == [sum(lengths[: n + 1]) * BIT for n in range(4)]
    assert len(set(lengths)) > 1  # stuffed each for itself


def test_a_frame_on_the_wire_is_not_interrupted() -> None:
    late, early = frame(1, release=50 * US), frame(1500, release=49 * US)
    run(bus_of([late, early]), 1)
    assert early.worst_response == bits_of(early) * BIT
    assert late.worst_response == (bits_of(early) + bits_of(late)) * BIT - US


def test_a_received_value_was_queued_one_frame_before() -> None:
    item = frame(7, release=TICK // 2)
    bus = run(bus_of([item]), 1)
    expected = list(item.outgoing.halves)
    assert (item.received.halves, item.received.tick, item.arrived) == (expected, 0, 1)
    assert item.received.event == TICK // 2
    run(bus, 2, first=1)
    assert item.received.halves == item.outgoing.halves != expected
    assert (item.received.tick, item.arrived, item.sent) == (2, 3, 2)


def test_a_frame_that_ends_with_the_tick_has_arrived_and_one_a_picosecond_later_has_not() -> None:
    probe = frame(7, release=0)
    run(bus_of([probe]), 1)
    length = probe.worst_response
    for start, arrived in ((TICK - length, 1), (TICK - length + 1, 0)):
        item = frame(7, release=start)
        bus = bus_of([item])
        item.outgoing.halves[:] = probe.received.halves
        advance(bus, 0)
        assert item.arrived == arrived
        advance(bus, 1)
        assert item.arrived == 2 - arrived


def test_a_new_value_takes_the_place_of_one_that_still_waits() -> None:
    first, slow = frame(1, release=0, period=TICK), frame(2, release=0, period=TICK)
    bus = bus_of([first, slow])
    bus.bit = 6 * BIT  # 0.7 ms a frame: two of them do not fit in 1 ms
    run(bus, 20)
    assert first.replaced == 0
    assert slow.replaced == pytest.approx(20 - slow.sent, abs=1) and slow.replaced > 5
    # What arrives was queued in the tick in which it was sent or the one before.
    assert bus.frames[1].arrived - slow.received.tick <= 3


def test_it_makes_no_difference_how_time_is_cut_into_ticks() -> None:
    def frames() -> list[Frame]:
        return [frame(n, CCU, 1, 10 * n * US, period=2 * TICK + n) for n in range(1, 9)]

    coarse, fine = bus_of(frames()), bus_of(frames())
    fine.tick = TICK // 10
    for item in (*coarse.frames, *fine.frames):
        item.outgoing.halves[:] = 0x12345678, 0x0F0F0F0F
    for tick in range(40):
        advance(coarse, tick)
    for tick in range(400):
        advance(fine, tick)
    assert [item.worst_response for item in coarse.frames] == [item.worst_response for item in fine.frames]
    assert coarse.free == fine.free and coarse.busy == fine.busy


def test_a_drifting_clock_passes_through_the_whole_cycle() -> None:
    # 500 ppm: within 2000 cycles the board is a whole cycle late.
    ours, board = frame(1, release=0), frame(2, 1, CCU, 0, period=2 * TICK + TICK // 1000)
    bus, responses = bus_of([ours, board]), set()
    for tick in range(4100):
        write(bus, tick)
        advance(bus, tick)
        responses.add(board.received.event % (2 * TICK) * 4 // (2 * TICK))
    assert responses == {0, 1, 2, 3}
    assert board.sent == math.ceil(4100 / 2.001)


def test_jitter_spreads_the_releases_evenly() -> None:
    item = frame(1, release=0, jitter=TICK)
    bus, delays = bus_of([item]), []
    for tick in range(4000):
        write(bus, tick)
        advance(bus, tick)
        if item.arrived == tick + 1:
            delays.append(item.worst_response - bits_of(item) * BIT)
            item.worst_response = 0
    assert min(delays) >= 0 and max(delays) < TICK
    assert kstest(np.array(delays[1:]) / TICK, "uniform").pvalue > 0.01


# ------------------------------------------------------------------ draws


def test_draws_are_spread_evenly_and_do_not_depend_on_one_another() -> None:
    numbers = []
    for key in range(8):
        item = frame(key, key=mix_bits(key))
        numbers.append([draw(item) for _ in range(20_000)])
    table = np.array(numbers)
    counts = np.bincount((table >> 26).ravel(), minlength=64)
    assert chisquare(counts).pvalue > 0.01
    assert chisquare(np.bincount((table & 63).ravel(), minlength=64)).pvalue > 0.01
    centred = table / FULL_SCALE - 0.5
    largest = 4.5 * np.sqrt(1 / table.shape[1]) / 12
    between = np.cov(centred) - np.diag(np.diag(np.cov(centred)))
    assert np.abs(between).max() < largest
    assert np.abs(np.mean(centred[:, 1:] * centred[:, :-1], axis=1)).max() < largest


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_the_set_share_of_frames_is_lost(share: float) -> None:
    frames = [frame(number, CCU, 1, 0) for number in range(1, 5)]
    run(bus_of(frames, loss=share), 8000)
    sent, lost = sum(item.sent for item in frames), sum(item.lost for item in frames)
    assert sent == 16_000
    assert binomtest(lost, sent, share).pvalue > 0.01
    # The sender does not detect it.
    assert all(item.destroyed == 0 for item in frames)


def test_of_frames_that_wait_through_a_silence_the_last_is_kept() -> None:
    item = frame(1, release=0)
    bus = run(bus_of([item], [OutageRecord(SILENCE, NO_INDEX, 10 * TICK, NEVER)]), 40)
    assert item.arrived == 9
    assert bus.frames[0].replaced == 14  # every 2 ms from 12 ms on


# ------------------------------------------------------------------ errors


def test_a_destroyed_frame_is_sent_again_by_itself() -> None:
    frames = [frame(number, CCU, 1, 0) for number in range(1, 5)]
    run(bus_of(frames, errors=0.05), 4000)
    assert all(item.sent == 2000 and item.lost == item.replaced == 0 for item in frames)
    destroyed = sum(item.destroyed for item in frames)
    assert binomtest(destroyed, 8000 + destroyed, 0.05).pvalue > 0.01


def test_an_error_takes_part_of_the_frame_and_an_error_frame() -> None:
    item = frame(1, release=0)
    bus, times = bus_of([item], errors=1.0), []
    advance(bus, 0)
    length = frame_bits(item.header, item.mailbox.halves)
    start = bus.free - bus.busy
    assert start == 0 and item.sent == 0
    for _ in range(2000):
        bus = bus_of([frame(1, release=0, key=mix_bits(len(times)))], errors=1.0)
        can_bus._begin(bus, 0, TICK)
        times.append(bus.free // BIT - 31)
    assert min(times) >= 1 and max(times) <= length
    assert chisquare(np.bincount(times, minlength=length + 1)[1:]).pvalue > 0.01


def test_transmit_errors_count_eight_up_and_one_down_to_bus_off() -> None:
    item = frame(1, release=0)
    bus = bus_of([item], errors=1.0)
    counts = [0]
    while not bus.nodes[CCU].bus_offs:
        can_bus._begin(bus, 0, TICK) if bus.current_frame == NO_INDEX else can_bus._finish(bus, 0)
        counts.append(bus.nodes[CCU].transmit_errors)
    assert sorted(set(counts)) == list(range(0, 256, 8))  # off above 255, after the 32nd error
    assert item.destroyed == 32 and not item.waiting
    bus = run(bus_of([frame(1, release=0)]), 1)
    bus.nodes[CCU].transmit_errors = 10
    run(bus, 12, first=1)
    assert bus.nodes[CCU].transmit_errors == 4


def test_a_node_recovers_after_128_times_11_bits() -> None:
    off = 3 * TICK + 123_456_789
    item = frame(1, period=NEVER)
    bus = bus_of([item], [OutageRecord(BUS_OFF, CCU, off, 0)])
    back = off + 128 * 11 * BIT
    ticks = back // TICK
    run(bus, ticks)
    item.event = item.release = off + US
    run(bus, 3, first=ticks)
    assert item.received.event == off + US
    assert item.worst_response == back - off - US + bits_of(item) * BIT


def test_a_node_that_does_not_recover_stays_off() -> None:
    item, other = frame(1, CCU, 1, 0), frame(2, 2, 3, 0)
    bus = run(bus_of([item, other], [OutageRecord(BUS_OFF, CCU, 5 * TICK, 0)], recovers=False), 500)
    assert (item.sent, other.sent) == (3, 250)
    assert bus.nodes[CCU].bus_offs == 1


# ------------------------------------------------------------------ outages


def test_a_booting_node_neither_sends_nor_receives_and_restarts_its_cycle() -> None:
    ours, theirs = frame(1, CCU, 1, 0), frame(2, 1, CCU, 0)
    down, up = 10 * TICK + 5, 20 * TICK + 777
    bus = bus_of([ours, theirs], [OutageRecord(REBOOT, 1, down, up)])
    bus.nodes[1].transmit_errors = 100
    run(bus, 20)
    assert theirs.arrived == 9 and ours.arrived == 9 and ours.lost == 5
    assert bus.nodes[1].transmit_errors == 0
    run(bus, 10, first=20)
    assert theirs.received.event == up + 4 * 2 * TICK
    assert theirs.replaced == 0
    assert ours.arrived == 29


def test_a_node_that_boots_while_it_sends_leaves_an_error_frame() -> None:
    ours, theirs = frame(1, CCU, 1, 3 * US), frame(2, 1, CCU, 0)
    run(bus_of([ours, theirs], [OutageRecord(REBOOT, 1, 10 * US, NEVER)]), 1)
    assert theirs.destroyed == 1 and theirs.arrived == 0
    assert ours.lost == 1  # the other node does not receive it
    assert ours.worst_response == 0 and theirs.release == NEVER


def test_a_silent_bus_keeps_the_newest_values_until_it_is_back() -> None:
    frames = [frame(number, number % 2, 1 - number % 2, 0) for number in range(1, 5)]
    run(bus_of(frames, [OutageRecord(SILENCE, NO_INDEX, 4 * TICK + 50 * US, 13 * TICK)]), 13)
    assert all(item.arrived == 3 for item in frames)
    assert [item.destroyed for item in frames] == [1, 0, 0, 0]
    assert all(item.waiting and item.mailbox.tick == 12 for item in frames)


@pytest.mark.parametrize("side", ["sender", "receiver"])
def test_a_broken_branch_of_the_star_loses_its_frames(side: str) -> None:
    ours, other = frame(1, 1, CCU, 0), frame(2, 2, CCU, 0)
    broken = 1 if side == "sender" else CCU
    run(bus_of([ours, other], [OutageRecord(SILENCE, broken, 10 * TICK + TICK // 2, 21 * TICK)]), 40)
    assert ours.destroyed == 0
    if side == "sender":
        assert (ours.replaced, ours.lost, other.lost) == (4, 0, 0)
        # What waited is sent at once when the wire is whole again.
        assert ours.worst_response == TICK + bits_of_any(ours)
    else:
        assert (ours.replaced, ours.lost, other.lost) == (0, 5, 5)


def bits_of_any(item: Frame) -> int:
    return item.worst_response % TICK


# ------------------------------------------------------------------ Python and machine code


def record_here(address: int) -> Bus:
    raise NotImplementedError  # bound to what finds it


def run_at(address: int, first: int, end: int) -> int:
    bus = record_here(address)
    for tick in range(first, end):
        write(bus, tick)
        advance(bus, tick)
    return bus.busy


CASES: dict[str, Callable[[], Bus]] = {
    "plain": lambda: bus_of(star(0)),
    "drift, jitter, loss and errors": lambda: bus_of(star(70 * US, 50_000), errors=0.05, loss=0.1),
    "bus-off now and then": lambda: bus_of(star(20 * US), errors=0.25, loss=0.02),
    "bus-off for good": lambda: bus_of(star(20 * US), errors=0.25, recovers=False),
    "outages": lambda: bus_of(
        star(10 * US, 1000),
        [
            OutageRecord(REBOOT, 2, 50 * TICK + 12_345, 80 * TICK + 1),
            OutageRecord(BUS_OFF, 3, 90 * TICK + 50 * US, 0),
            OutageRecord(SILENCE, NO_INDEX, 100 * TICK + 250 * US, 120 * TICK),
            OutageRecord(SILENCE, 1, 150 * TICK, 170 * TICK),
        ],
    ),
}


def star(jitter: int, drift: int = 0) -> list[Frame]:
    """Return setpoint frames of the central unit to four boards, and their measurement frames."""
    boards = range(1, 5)
    setpoints = [frame(0x100 + board, CCU, board, 0, jitter=jitter) for board in boards]
    period = 2 * TICK
    return [
        *setpoints,
        *(frame(0x180 + b, b, CCU, b * 100 * US, jitter=jitter, period=period + b * drift) for b in boards),
    ]


@pytest.mark.compile
def test_plain_python_and_machine_code_agree_in_every_bit() -> None:
    entry = run_at
    entry.__module__ = can_bus.__name__  # only functions of the package are bound
    write.__module__ = can_bus.__name__
    loop = compile_loop(entry, {"record_here": record_accessor(to_array(bus_of(star(0))).dtype)})
    assert loop.code is not None  # needs nothing but the C library, and so can be kept
    for name, make in CASES.items():
        plain, compiled = make(), to_array(make())
        loop.function(compiled.ctypes.data, 0, 2000)
        run(plain, 2000)
        assert to_array(plain).tobytes() == compiled.tobytes(), name
        assert sum(item.sent for item in plain.frames) > 0
