"""Tests of the bus of an experiment: senders, receivers, times and random draws of the frames."""

from __future__ import annotations

import pytest

from twin_gait.core import can_bus
from twin_gait.core.can_bus import FULL_SCALE, NEVER, NO_INDEX, Bus, advance, draw
from twin_gait.network.bus import cyclic_messages, new_bus, nodes_of, picoseconds
from twin_gait.network.dbc import load_messages
from twin_gait.parameters.network import BOARDS, NetworkParameters, OutageKind, parse_outage

MS, TICK = 10**9, 1e-3
TWIN = BOARDS[:4]
NODES = nodes_of(TWIN)


def bus_of(network: NetworkParameters, seed: int = 0, boards: tuple[str, ...] = TWIN) -> Bus:
    return new_bus(network, load_messages(), boards, seed, TICK)


def test_each_board_has_a_frame_from_the_central_unit_and_one_to_it() -> None:
    messages, bus = cyclic_messages(load_messages(), TWIN), bus_of(NetworkParameters())
    assert [m.identifier for m in messages] == sorted(m.identifier for m in messages)
    pairs = [(NODES[frame.sender], NODES[frame.receiver]) for frame in bus.frames]
    expected = {("ccu", board) for board in TWIN} | {(board, "ccu") for board in TWIN}
    assert set(pairs) == expected and len(pairs) == 8
    assert (bus.tick, bus.bit) == (MS, MS // 1000)
    assert {frame.period for frame in bus.frames} == {2 * MS}


def test_one_leg_has_half_the_frames() -> None:
    assert len(bus_of(NetworkParameters(), boards=TWIN[2:]).frames) == 4


def test_frames_have_the_phase_and_drift_of_their_sender() -> None:
    network = NetworkParameters(phase={"left_knee": 3e-4}, clock_drift={"left_knee": 1e-4})
    for frame in bus_of(network).frames:
        moved = NODES[frame.sender] == "left_knee"
        assert frame.event == frame.release == (300 * MS // 1000 if moved else 0)
        assert frame.period == (round(2 * MS / 1.0001) if moved else 2 * MS)


def test_no_two_frames_and_no_two_seeds_have_the_same_draws() -> None:
    drawn = [
        tuple(draw(frame) for _ in range(4))
        for seed in (0, 1, 1 << 40)
        for frame in bus_of(NetworkParameters(), seed).frames
    ]
    assert len(set(drawn)) == 24
    first = [draw(frame) for frame in bus_of(NetworkParameters(), 7).frames]
    assert first == [draw(frame) for frame in bus_of(NetworkParameters(), 7).frames]


def test_shares_are_converted_to_draw_thresholds() -> None:
    bus = bus_of(NetworkParameters(loss=0.25, error_share=1.0))
    assert (bus.loss_share, bus.error_share) == (FULL_SCALE // 4, FULL_SCALE)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 20])
def test_outages_are_in_order_and_end_with_a_sentinel(count: int) -> None:
    texts = [f"reboot:left_hip@{1 + number * 7 % 10}s=0.1s" for number in range(count)]
    bus = bus_of(NetworkParameters(outages=tuple(map(parse_outage, texts))))
    starts = [outage.start for outage in bus.outages]
    assert starts == sorted(starts)
    assert starts.count(NEVER) >= 1 and len(starts) % 8 == 0
    assert len(starts) - starts.count(NEVER) == count


def test_outages_have_the_configured_kind() -> None:
    outages = tuple(map(parse_outage, ("silence@1s=2s", "reboot:ccu@2s", "bus_off:right_knee@3s")))
    bus = bus_of(NetworkParameters(outages=outages))
    rows = [(item.kind, item.node, item.start, item.end) for item in bus.outages[:3]]
    assert rows == [
        (can_bus.SILENCE, NO_INDEX, 1000 * MS, 3000 * MS),
        (can_bus.REBOOT, 0, 2000 * MS, NEVER),
        (can_bus.BUS_OFF, 4, 3000 * MS, NEVER),
    ]
    assert [kind.code for kind in OutageKind] == [can_bus.SILENCE, can_bus.REBOOT, can_bus.BUS_OFF]


def test_every_frame_arrives_once_in_a_cycle() -> None:
    bus = bus_of(NetworkParameters())
    for tick in range(100):
        advance(bus, tick)
    # The last one queued at 98 ms ends at 99 ms or a little before.
    assert [frame.sent for frame in bus.frames] == [50] * 8
    assert all(frame.lost == frame.replaced == 0 for frame in bus.frames)


def test_times_are_whole_picoseconds() -> None:
    assert picoseconds(1e-6) == 1_000_000
    assert picoseconds(float("inf")) == NEVER
