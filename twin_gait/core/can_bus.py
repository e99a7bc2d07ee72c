"""A CAN bus between two ticks: queueing, arbitration, transmission, errors, loss, outages.

Times are whole picoseconds since the start of the run, so that there is no rounding, however long the run: 63
bits are 106 days. Random numbers are hashes of a counter (:func:`draw`).

A frame is queued at its *release*, with the values that its node sends in that tick; its *event*, from which
the response time counts, is earlier by the jitter. A mailbox holds one frame: a new value replaces one that
is still waiting, as in the transmit buffers that CAN controllers have for cyclic data. While the bus is free
the waiting frame with the lowest identifier is sent, and nothing interrupts it. A frame has arrived at the
end of its interframe space, 3 bits after its end, and its receiver can read it from the next tick on.

The error confinement of the CAN specification 2.0 is modelled by the counter of transmit errors, with bus-off
and recovery, which takes 128 times 11 bits, as on an idle bus: on a busy bus it would take longer. The
counter of receive errors, the passive error flag, and the 8 bits that a node then waits are not modelled.
"""

from dataclasses import dataclass, field

from twin_gait.core.can_frame import Header, frame_bits

NEVER = 1 << 60  # Time in [ps] that is never reached.
NO_INDEX = -1  # No frame on the wire, or all nodes of an outage.
FULL_SCALE = 1 << 32  # Full scale of shares and random numbers.
SILENCE, REBOOT, BUS_OFF = range(3)  # Kinds of outages.

_ERROR_BITS = 31  # Flags, delimiter and interframe space at most (Tindell and Burns 1994).
_ERROR_STEP, _HIGHEST_ERRORS = 8, 255
_RECOVERY_BITS = 128 * 11
_WORD = 0xFFFFFFFF


@dataclass(slots=True)
class Payload:
    """Data of a frame with the times to which they belong."""

    # Bytes 0 to 3 of the data and bytes 4 to 7, the first byte of a half in the lowest bits.
    halves: list[int] = field(default_factory=lambda: [0, 0])
    tick: int = 0  # Tick in which the data were queued.
    event: int = 0  # Event for which the data were queued, in [ps].


@dataclass(slots=True)
class Frame:
    """A cyclic frame: state at its sender, in its mailbox, and at its receiver."""

    header: Header  # Header with the length and CRC of the frame.
    sender: int  # Index of the node that sends it.
    receiver: int  # Index of the node that receives it.
    period: int  # Period of the sender's clock in [ps].
    jitter: int  # Longest time from event to release in [ps].
    key: int  # Key of the random numbers of the frame, 32 bits.
    event: int  # Next event in [ps].
    release: int  # Next release in [ps].
    # Data that the sender queues when the frame is released; the halves are written before.
    outgoing: Payload = field(default_factory=Payload)
    mailbox: Payload = field(default_factory=Payload)  # Data that wait, or were sent last.
    waiting: bool = False  # Whether data wait in the mailbox.
    received: Payload = field(default_factory=Payload)  # Data that arrived last.
    arrived: int = 0  # Tick from which the receiver can read them; 0 before the first arrival.
    drawn: int = 0  # Number of random numbers drawn.
    worst_response: int = 0  # Longest time from event to arrival in [ps].
    sent: int = 0  # Number of frames that the sender counts as sent.
    lost: int = 0  # Number of sent frames that did not arrive.
    replaced: int = 0  # Number of payloads that a newer one replaced before they were sent.
    destroyed: int = 0  # Number of transmissions that ended in an error frame.


@dataclass(slots=True)
class Node:
    """The CAN controller of the central unit or of a board."""

    transmit_errors: int = 0  # Transmit error counter (TEC): 8 more for an error, 1 less for a success.
    online_time: int = 0  # Time in [ps] from which the node is on the bus; in the past if it is.
    bus_offs: int = 0  # Number of times that the node went bus-off.


@dataclass(slots=True)
class OutageRecord:
    """Event that keeps a node, or all nodes, off the bus."""

    # ``SILENCE`` of a broken wire, during which a node keeps running and after which it continues;
    # ``REBOOT``, after which its clock restarts; ``BUS_OFF``, from which it recovers as from an error-induced
    # one.
    kind: int
    node: int  # Index of the node, or ``NOBODY`` for the silence of the whole bus.
    start: int  # Start in [ps].
    end: int  # End in [ps]; without meaning for ``BUS_OFF``.


@dataclass(slots=True)
class Bus:
    """State of the bus with its frames, nodes and outages."""

    tick: int  # Length of a tick in [ps].
    bit: int  # Length of a bit in [ps].
    error_share: int  # Share of transmissions that an error destroys, in units of 1 / ``EVERYTHING``.
    loss_share: int  # Share of sent frames that do not arrive, in units of 1 / ``EVERYTHING``.
    recovers: bool  # Whether a node that went bus-off recovers, or stays off.
    frames: list[Frame]  # Frames sorted by identifier, the lowest first.
    nodes: list[Node]  # The central unit and the boards.
    outages: list[OutageRecord]  # Outages sorted by their start; the last one never starts.
    next_outage: int = 0  # Index of the first outage that has not begun.
    free: int = 0  # Time in [ps] from which another frame may begin.
    current_frame: int = NO_INDEX  # Index of the frame that is being sent, or ``NOBODY``.
    current_payload: Payload = field(default_factory=Payload)  # Data of the frame that is being sent.
    corrupted: bool = False  # Whether an error destroys the frame that is being sent.
    busy: int = 0  # Total time in [ps] in which the bus was in use.


def mix_bits(number: int) -> int:
    """Mix the bits of a number of 32 bits so that each depends on all: Thomas Mueller's hash."""
    number = ((number >> 16) ^ number) * 0x45D9F3B & _WORD
    number = ((number >> 16) ^ number) * 0x45D9F3B & _WORD
    return (number >> 16) ^ number


def draw(frame: Frame) -> int:
    """Draw the next random number of a frame, 0 to ``EVERYTHING`` - 1: a hash of its key and its count."""
    frame.drawn += 1
    return mix_bits(mix_bits(frame.drawn & _WORD) ^ frame.key)


def is_release_due(bus: Bus, frame: Frame, tick: int) -> bool:
    """Check whether a frame is released in a tick, so that its data have to be written before."""
    return frame.release < (tick + 1) * bus.tick


def advance(bus: Bus, tick: int) -> None:
    """Simulate the bus from the start of a tick to the next; the data of due frames have been written."""
    end = (tick + 1) * bus.tick
    while bus.outages[bus.next_outage].start < end:
        outage = bus.outages[bus.next_outage]
        _transmit_until(bus, tick, outage.start)
        _start_outage(bus, outage)
        bus.next_outage += 1
    _transmit_until(bus, tick, end)


def _transmit_until(bus: Bus, tick: int, until: int) -> None:
    """Transmit waiting frames until a time in [ps]; a frame that ends exactly then has arrived."""
    while bus.free <= until:
        if bus.current_frame != NO_INDEX:
            _finish(bus, tick)
        elif bus.free == until:
            break
        else:
            _begin(bus, tick, until)
    for frame in bus.frames:
        while frame.release < until:
            _queue(frame, tick)


def _begin(bus: Bus, tick: int, until: int) -> None:
    """Start the transmission of the frame that wins the arbitration, or wait for the next event."""
    now, winner, following = bus.free, NO_INDEX, until
    for number in range(len(bus.frames)):
        frame = bus.frames[number]
        while frame.release <= now:
            _queue(frame, tick)
        following = min(following, frame.release)
        if frame.waiting and winner == NO_INDEX:
            back = bus.nodes[frame.sender].online_time
            if back > now:
                following = min(following, back)
            else:
                winner = number
    if winner == NO_INDEX:
        bus.free = following
    else:
        _send(bus, winner)


def _queue(frame: Frame, tick: int) -> None:
    if frame.waiting:
        frame.replaced += 1
    frame.waiting = True
    _copy(frame.outgoing, frame.mailbox)
    frame.mailbox.tick, frame.mailbox.event = tick, frame.event
    _schedule(frame, frame.event + frame.period)


def _copy(source: Payload, target: Payload) -> None:
    target.halves[0], target.halves[1] = source.halves[0], source.halves[1]
    target.tick, target.event = source.tick, source.event


def _schedule(frame: Frame, event: int) -> None:
    """Set the next event of a frame, and its release after that."""
    frame.event = frame.release = event
    if frame.jitter > 0:
        frame.release += frame.jitter * (draw(frame) >> 12) >> 20  # 20 random bits, so that the product fits.


def _send(bus: Bus, number: int) -> None:
    frame = bus.frames[number]
    bus.current_frame, frame.waiting, bus.corrupted = number, False, False
    _copy(frame.mailbox, bus.current_payload)
    bits = frame_bits(frame.header, bus.current_payload.halves)
    if bus.error_share > 0:
        drawn = draw(frame)
        if drawn < bus.error_share:  # The error occurs at a uniformly distributed bit.
            bus.corrupted = True
            bits = 1 + drawn * bits // bus.error_share + _ERROR_BITS
    bus.free += bits * bus.bit
    bus.busy += bits * bus.bit


def _finish(bus: Bus, tick: int) -> None:
    frame = bus.frames[bus.current_frame]
    sender = bus.nodes[frame.sender]
    bus.current_frame = NO_INDEX
    if bus.corrupted:
        _send_again(frame)
        sender.transmit_errors += _ERROR_STEP
        if sender.transmit_errors > _HIGHEST_ERRORS:
            _set_bus_off(bus, frame.sender, bus.free)
    else:
        frame.sent += 1
        sender.transmit_errors = max(sender.transmit_errors - 1, 0)
        _deliver(bus, frame, tick)


def _send_again(frame: Frame) -> None:
    """Queue a destroyed frame once more, unless newer data wait in its mailbox."""
    frame.destroyed += 1
    if frame.waiting:
        frame.replaced += 1
    frame.waiting = True


def _deliver(bus: Bus, frame: Frame, tick: int) -> None:
    """Deliver the frame on the wire, unless its receiver is off the bus or the frame is lost."""
    away = bus.nodes[frame.receiver].online_time > bus.free
    if away or (bus.loss_share > 0 and draw(frame) < bus.loss_share):
        frame.lost += 1
    else:
        _copy(bus.current_payload, frame.received)
        frame.arrived = tick + 1
        frame.worst_response = max(frame.worst_response, bus.free - bus.current_payload.event)


def _set_bus_off(bus: Bus, number: int, now: int) -> None:
    """Set a node bus-off, for the time of its recovery or permanently."""
    node = bus.nodes[number]
    node.bus_offs += 1
    back = max(node.online_time, now + _RECOVERY_BITS * bus.bit) if bus.recovers else NEVER
    _take_offline(bus, number, back)


def _take_offline(bus: Bus, number: int, back: int) -> None:
    """Take a node off the bus until a time; reset its error counter and discard its waiting frames."""
    node = bus.nodes[number]
    node.online_time, node.transmit_errors = back, 0
    for frame in bus.frames:
        if frame.sender == number:
            frame.waiting = False


def _start_outage(bus: Bus, outage: OutageRecord) -> None:
    everybody = outage.node == NO_INDEX
    if bus.current_frame != NO_INDEX:
        frame = bus.frames[bus.current_frame]
        if everybody or frame.sender == outage.node:
            _send_again(frame)
            bus.current_frame, bus.free = NO_INDEX, outage.start + _ERROR_BITS * bus.bit
    if everybody:
        bus.free = max(bus.free, outage.end)
    elif outage.kind == BUS_OFF:
        _set_bus_off(bus, outage.node, outage.start)
    elif outage.kind == REBOOT:
        _take_offline(bus, outage.node, outage.end)
        for frame in bus.frames:
            if frame.sender == outage.node:
                _schedule(frame, outage.end)  # The clock of the node restarts.
    else:
        node = bus.nodes[outage.node]
        node.online_time = max(node.online_time, outage.end)
