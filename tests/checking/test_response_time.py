"""Response times on a CAN bus: the published example, and the simulated bus in the worst case and others."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from errors import states

from twin_gait.checking.check import load_case
from twin_gait.checking.finding import Finding, Severity
from twin_gait.checking.network import (
    CyclicFrame,
    bus_load,
    bus_traffic,
    response_times,
    traffic_of,
)
from twin_gait.configuration.experiments import load_experiment
from twin_gait.core import can_bus
from twin_gait.core.can_bus import FULL_SCALE, NEVER, NO_INDEX, Bus, Frame, Node, OutageRecord, advance
from twin_gait.core.can_frame import Header, max_frame_bits, new_header
from twin_gait.network.bus import cyclic_messages, new_bus
from twin_gait.network.dbc import load_messages
from twin_gait.parameters.network import BOARDS, NetworkParameters

MS = 10**9  # [ps]
BIT = 10**6
# Messages A, B and C of Davis et al. (2007): 125 bits at 125 kbit/s.
EXAMPLE = [CyclicFrame(MS, 5 * MS // 2), CyclicFrame(MS, 7 * MS // 2), CyclicFrame(MS, 7 * MS // 2)]


# ------------------------------------------------------------------ the paper


def test_the_published_example_that_the_old_analysis_got_wrong() -> None:
    # The old analysis has 3 ms for C; its second instance takes 3.5 ms and misses its 3.25 ms.
    assert max_frame_bits(7) * 8 * BIT == MS
    assert response_times(EXAMPLE, 8 * BIT) == [2 * MS, 3 * MS, 7 * MS // 2]
    assert bus_load(EXAMPLE) == Fraction(34, 35)
    once = [*EXAMPLE[:2], EXAMPLE[2]._replace(period=NEVER)]
    assert response_times(once, 8 * BIT)[2] == 3 * MS


def test_without_others_a_frame_takes_its_jitter_and_itself() -> None:
    assert response_times([CyclicFrame(135, 2000, 40)], 1) == [175]


def test_a_full_bus_has_no_response_time_bound() -> None:
    frames = [CyclicFrame(500, 1000), CyclicFrame(500, 1000), CyclicFrame(1, 1000)]
    assert response_times(frames, 1) == [1000, None, None]


# ------------------------------------------------------------------ the simulated bus


@pytest.fixture
def longest_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set every frame on the wire to the length of the bound, which most identifiers cannot reach."""

    def longest(header: Header, halves: list[int]) -> int:
        return max_frame_bits(header.length)

    monkeypatch.setattr(can_bus, "frame_bits", longest)


def bus_of(frames: list[CyclicFrame], lengths: list[int], starts: list[int]) -> Bus:
    """Return frames of one node each with given first events; only the first event has jitter."""
    made = [
        Frame(new_header(number, lengths[number]), number, number, item.period, 0, 0, start, start)
        for number, (item, start) in enumerate(zip(frames, starts, strict=True))
    ]
    nodes, never = [Node() for _ in frames], OutageRecord(0, NO_INDEX, NEVER, NEVER)
    return Bus(MS, BIT, 0, 0, True, made, nodes, [never])


def random_set(random: np.random.Generator, jitter: float) -> tuple[list[CyclicFrame], list[int]]:
    """Return two to eight frames of any lengths that use 40 to 99 % of the bus and meet their deadlines."""
    while True:
        count = int(random.integers(2, 9))
        lengths = random.integers(0, 9, count).tolist()
        periods = (random.uniform(0.3, 1.0) * MS * random.uniform(1, 4, count)).astype(int).tolist()
        frames = [
            CyclicFrame(max_frame_bits(length) * BIT, period, int(random.uniform(0, jitter) * period))
            for length, period in zip(lengths, periods, strict=True)
        ]
        times = response_times(frames, BIT)
        in_time = all(time and time <= item.period for time, item in zip(times, frames, strict=True))
        if 0.4 < bus_load(frames) < 0.99 and in_time:
            return frames, lengths


def simulated_worst_case(frames: list[CyclicFrame], lengths: list[int], number: int) -> int:
    """Return the response time of a frame at the critical instant.

    It is queued together with all of higher priority, each as late as its jitter lets it, a picosecond after
    the longest one of lower priority has begun.
    """
    lower = range(number + 1, len(frames))
    bus = bus_of(frames, lengths, [10 * MS] * (number + 1) + [NEVER] * len(lower))
    if lower:
        longest = bus.frames[max(lower, key=lambda other: frames[other].transmission)]
        longest.event = longest.release = 10 * MS - 1
        longest.period = NEVER
    for other in range(number + 1):
        bus.frames[other].event -= frames[other].jitter
    for tick in range(70):
        advance(bus, tick)
    return bus.frames[number].worst_response


@pytest.mark.usefixtures("longest_frames")
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_simulated_response_at_the_critical_instant_equals_the_bound(jitter: float) -> None:
    random, compared, equal = np.random.default_rng(2007), 0, 0
    for _ in range(60):
        frames, lengths = random_set(random, jitter)
        for number in range(len(frames)):
            # What begins within a bit is simultaneous to real nodes; here it is within a picosecond, the head
            # start of the frame that blocks.
            head_start = 1 if number < len(frames) - 1 else 0
            exact, bound = (response_times(frames, bit)[number] for bit in (1 - head_start, BIT))
            assert exact is not None and bound is not None and exact <= bound
            assert simulated_worst_case(frames, lengths, number) == exact - head_start
            compared, equal = compared + 1, equal + (exact == bound)
    assert equal > 0.95 * compared > 200  # a bit is short


@pytest.mark.usefixtures("longest_frames")
def test_the_simulated_bus_has_the_published_response_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_bus, "frame_bits", lambda header, halves: 1000)
    assert [simulated_worst_case(EXAMPLE, [7, 7, 7], number) for number in range(3)] == [
        2 * MS - 1,
        3 * MS - 1,
        7 * MS // 2,
    ]


@pytest.mark.usefixtures("longest_frames")
def test_no_simulated_response_exceeds_the_bound() -> None:
    random, closest = np.random.default_rng(35), 0.0
    for _ in range(150):
        frames, lengths = random_set(random, 0.5)
        starts = [int(random.uniform(0, item.period)) for item in frames]
        bus = bus_of(frames, lengths, starts)
        for made, item in zip(bus.frames, frames, strict=True):
            made.jitter, made.key = item.jitter, int(random.integers(1 << 32))
        for tick in range(150):
            advance(bus, tick)
        for made, bound in zip(bus.frames, response_times(frames, BIT), strict=True):
            assert bound is not None and 0 < made.worst_response <= bound
            closest = max(closest, made.worst_response / bound)
    assert closest > 0.95


@pytest.mark.usefixtures("longest_frames")
def test_the_eight_frames_of_the_device_meet_their_bounds() -> None:
    network, messages = NetworkParameters(), cyclic_messages(load_messages(), BOARDS[:4])
    load, times = traffic_of(load_experiment("treadmill_guided", ["network=can"]).experiment)
    assert load == 0.54
    expected = [270, 405, 540, 675, 810, 945, 1080, 1080]  # 135 bits each, the last one is not blocked
    assert [round(1e6 * time) for time in times.values()] == expected
    for number in range(8):
        bus = new_bus(network, load_messages(), BOARDS[:4], 0, 1e-3)
        if number < 7:
            for made in bus.frames[: number + 1]:
                made.event = made.release = 1
            bus.frames[-1].period = NEVER
            for made in bus.frames[number + 1 : -1]:
                made.event = made.release = NEVER
        for tick in range(4):
            advance(bus, tick)
        bound = round(1e12 * times[messages[number].name])
        assert bus.frames[number].worst_response == bound - (number < 7)


def test_frames_with_their_own_stuff_bits_stay_below_the_bounds() -> None:
    network = NetworkParameters(jitter=2e-4, clock_drift={"left_hip": 1e-3})
    bus = new_bus(network, load_messages(), BOARDS[:4], 3, 1e-3)
    load, times = traffic_of(replace(load_experiment("treadmill_guided").experiment, network=network))
    random = np.random.default_rng(8)
    for tick in range(4000):
        for made in bus.frames:
            made.outgoing.halves[:] = random.integers(0, 1 << 31, 2).tolist()
        advance(bus, tick)
    assert bus.loss_share == 0 < FULL_SCALE
    for made, time in zip(bus.frames, times.values(), strict=True):
        assert made.lost == made.replaced == 0
        assert 0 < made.worst_response <= round(1e12 * time)
    assert 0.4 < bus.busy / (4000 * MS) < load


# ------------------------------------------------------------------ the rule


def rule(*settings: str, preset: str = "treadmill_guided") -> list[Finding]:
    return bus_traffic(load_case(None, preset, settings))


def test_an_ideal_bus_has_no_traffic() -> None:
    assert rule() == []


def test_the_default_bus_load_is_half_of_its_capacity() -> None:
    (note,) = rule("network=can")
    assert note.severity is Severity.NOTE
    assert "54%" in note.reason and "1.080 ms" in note.reason


def test_half_the_bit_rate_is_refused_with_suggestions_that_work() -> None:
    (error,) = rule("network.bit_rate_kbit_per_s=500")
    assert error.severity is Severity.ERROR
    assert "network.bit_rate_kbit_per_s 500" in error.reason and "108%" in error.reason
    assert states(error.suggestion, "network.bit_rate_kbit_per_s", "network.cycle_ms")
    assert rule("network.bit_rate_kbit_per_s=800")[0].severity is Severity.NOTE
    ways = ("network.bit_rate_kbit_per_s=500", "network.cycle_ms=3")
    assert rule(*ways)[0].severity is Severity.NOTE


def test_a_frame_that_may_come_too_late_is_refused() -> None:
    (error,) = rule("network={jitter_us: 1500}")
    assert error.severity is Severity.ERROR
    assert states(error.reason, "right_knee_measurement", "3.525 ms")


def test_a_bench_with_one_leg_has_half_the_frames() -> None:
    (note,) = rule("network=can", preset="bench_leg")
    assert "4 frames" in note.reason and "27%" in note.reason
