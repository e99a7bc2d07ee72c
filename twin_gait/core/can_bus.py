r"""A CAN bus between two ticks: queueing, arbitration, transmission, errors, loss, outages.

Times are whole picoseconds since the start of the run, so that nothing rounds, however long it lasts: 63 bits
are 106 days. What is random is a hash of a counter (:func:`draw`).

A frame is queued at its *release*, with what its node has to say in that tick; its *event*, from which the
response time counts, is earlier by the jitter. A mailbox holds one frame: a new value takes the place of one
that still waits, as in the transmit buffers that CAN controllers have for cyclic data. While the bus is free
the waiting frame with the lowest identifier is sent, and nothing interrupts it. A frame has arrived at the
end of its interframe space, 3 bits after its end, and its receiver has it from the next tick on.

Of the error confinement of the CAN specification 2.0 the counter of transmit errors is here, with bus-off and
recovery, which takes 128 times 11 bits, as on an idle bus: a busy one would take longer. The counter of
receive errors, the passive error flag, and the 8 bits that a node then waits are not.
"""

from dataclasses import dataclass, field

from twin_gait.core.can_frame import Header, frame_bits

NEVER = 1 << 60  # [ps]
NOBODY = -1  # no frame on the wire; all nodes of an outage
EVERYTHING = 1 << 32  # what shares and draws count in
SILENCE, REBOOT, BUS_OFF = range(3)  # kinds of outages

_ERROR_BITS = 31  # flags, delimiter and interframe space at most (Tindell and Burns 1994)
_ERROR_STEP, _HIGHEST_ERRORS = 8, 255
_RECOVERY_BITS = 128 * 11
_WORD = 0xFFFFFFFF


@dataclass(slots=True)
class Payload:
    """What a frame carries."""

    # Bytes 0 to 3 of the data and bytes 4 to 7, the first of them in the lowest bits.
    halves: list[int] = field(default_factory=lambda: [0, 0])
    tick: int = 0  # In which it was queued.
    event: int = 0  # For which it was queued, in [ps].


@dataclass(slots=True)
class Frame:
    """A cyclic frame: of its sender, in its mailbox, at its receiver."""

    header: Header  # Of its length and CRC.
    sender: int  # Node that sends it.
    receiver: int  # Node that it is for.
    period: int  # Of its sender's clock in [ps].
    jitter: int  # Longest time from event to release in [ps].
    key: int  # Of its draws, 32 bits.
    event: int  # Next one in [ps].
    release: int  # Next one in [ps].
    # What the sender queues when the frame is released; its halves are written before.
    outgoing: Payload = field(default_factory=Payload)
    mailbox: Payload = field(default_factory=Payload)  # What waits, or was sent last.
    waiting: bool = False  # Whether something waits.
    received: Payload = field(default_factory=Payload)  # What arrived last.
    arrived: int = 0  # Tick from which the receiver has it; 0 before anything came.
    drawn: int = 0  # How many numbers were drawn.
    worst_response: int = 0  # Longest time from event to arrival in [ps].
    sent: int = 0  # Frames that the sender believes it has sent.
    lost: int = 0  # Of these, those that did not arrive.
    replaced: int = 0  # Payloads that a newer one took the place of before they were sent.
    destroyed: int = 0  # Transmissions that ended in an error frame.


@dataclass(slots=True)
class Node:
    """The CAN controller of the central unit or of a board."""

    transmit_errors: int = 0  # Its counter (TEC): 8 more for an error, 1 less for a success.
    back: int = 0  # When it is back on the bus in [ps]; long ago if it is there.
    bus_offs: int = 0  # How often it went bus-off.


@dataclass(slots=True)
class Outage:
    """Something that keeps a node, or all of them, off the bus."""

    # ``SILENCE`` of a broken wire, which a node lives through and then goes on; ``REBOOT``, after which its
    # clock begins anew; ``BUS_OFF``, from which it recovers as from one of its own.
    kind: int
    node: int  # Which, or ``NOBODY`` in particular for the silence of the whole bus.
    start: int  # In [ps].
    end: int  # In [ps]; of no meaning for ``BUS_OFF``.


@dataclass(slots=True)
class Bus:
    """The bus with all that is on it."""

    tick: int  # Length of a tick in [ps].
    bit: int  # Length of a bit in [ps].
    error_share: int  # Of the transmissions, that an error destroys, of ``EVERYTHING``.
    loss_share: int  # Of the frames sent, that do not arrive, of ``EVERYTHING``.
    recovers: bool  # Whether a node that went bus-off waits for its recovery, or stays off.
    frames: list[Frame]  # By identifier, the lowest first.
    nodes: list[Node]  # The central unit and the boards.
    outages: list[Outage]  # By their start; the last one never starts.
    next_outage: int = 0  # The first one that has not begun.
    free: int = 0  # From when in [ps] another frame may begin.
    on_wire: int = NOBODY  # The frame that is being sent, or ``NOBODY``.
    wire: Payload = field(default_factory=Payload)  # What it carries.
    broken: bool = False  # Whether an error destroys it.
    busy: int = 0  # Time in [ps] in which the bus was in use.


def mixed(number: int) -> int:
    """Bits of a number of 32 bits so mixed that each depends on all: Thomas Mueller's hash."""
    number = ((number >> 16) ^ number) * 0x45D9F3B & _WORD
    number = ((number >> 16) ^ number) * 0x45D9F3B & _WORD
    return (number >> 16) ^ number


def draw(frame: Frame) -> int:
    """Next random number of a frame, 0 to ``EVERYTHING`` - 1: a hash of its key and its count."""
    frame.drawn += 1
    return mixed(mixed(frame.drawn & _WORD) ^ frame.key)


def is_due(bus: Bus, frame: Frame, tick: int) -> bool:
    """Whether a frame is released in a tick, so that what it carries is to be written before."""
    return frame.release < (tick + 1) * bus.tick


def advance(bus: Bus, tick: int) -> None:
    """All that happens on the bus from the start of a tick to the next; what is due has been written."""
    end = (tick + 1) * bus.tick
    while bus.outages[bus.next_outage].start < end:
        outage = bus.outages[bus.next_outage]
        _carry(bus, tick, outage.start)
        _break(bus, outage)
        bus.next_outage += 1
    _carry(bus, tick, end)


def _carry(bus: Bus, tick: int, until: int) -> None:
    """Send what there is to send; a frame that ends at the very end has arrived."""
    while bus.free <= until:
        if bus.on_wire != NOBODY:
            _finish(bus, tick)
        elif bus.free == until:
            break
        else:
            _begin(bus, tick, until)
    for frame in bus.frames:
        while frame.release < until:
            _queue(frame, tick)


def _begin(bus: Bus, tick: int, until: int) -> None:
    """Begin with the frame that wins the arbitration, or wait for what comes next."""
    now, winner, following = bus.free, NOBODY, until
    for number in range(len(bus.frames)):
        frame = bus.frames[number]
        while frame.release <= now:
            _queue(frame, tick)
        following = min(following, frame.release)
        if frame.waiting and winner == NOBODY:
            back = bus.nodes[frame.sender].back
            if back > now:
                following = min(following, back)
            else:
                winner = number
    if winner == NOBODY:
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
    """Set the next event of a frame, and when it is released after that."""
    frame.event = frame.release = event
    if frame.jitter > 0:
        frame.release += frame.jitter * (draw(frame) >> 12) >> 20  # 20 bits: the product has its room


def _send(bus: Bus, number: int) -> None:
    frame = bus.frames[number]
    bus.on_wire, frame.waiting, bus.broken = number, False, False
    _copy(frame.mailbox, bus.wire)
    bits = frame_bits(frame.header, bus.wire.halves)
    if bus.error_share > 0:
        drawn = draw(frame)
        if drawn < bus.error_share:  # at a bit that is as likely as any other
            bus.broken = True
            bits = 1 + drawn * bits // bus.error_share + _ERROR_BITS
    bus.free += bits * bus.bit
    bus.busy += bits * bus.bit


def _finish(bus: Bus, tick: int) -> None:
    frame = bus.frames[bus.on_wire]
    sender = bus.nodes[frame.sender]
    bus.on_wire = NOBODY
    if bus.broken:
        _send_again(frame)
        sender.transmit_errors += _ERROR_STEP
        if sender.transmit_errors > _HIGHEST_ERRORS:
            _go_off(bus, frame.sender, bus.free)
    else:
        frame.sent += 1
        sender.transmit_errors = max(sender.transmit_errors - 1, 0)
        _deliver(bus, frame, tick)


def _send_again(frame: Frame) -> None:
    """Let what was destroyed on the wire wait once more, unless something newer does."""
    frame.destroyed += 1
    if frame.waiting:
        frame.replaced += 1
    frame.waiting = True


def _deliver(bus: Bus, frame: Frame, tick: int) -> None:
    """Give its receiver what was on the wire, if it is there and the frame is not lost."""
    away = bus.nodes[frame.receiver].back > bus.free
    if away or (bus.loss_share > 0 and draw(frame) < bus.loss_share):
        frame.lost += 1
    else:
        _copy(bus.wire, frame.received)
        frame.arrived = tick + 1
        frame.worst_response = max(frame.worst_response, bus.free - bus.wire.event)


def _go_off(bus: Bus, number: int, now: int) -> None:
    """Let a node go bus-off, for the time of its recovery or for good."""
    node = bus.nodes[number]
    node.bus_offs += 1
    back = max(node.back, now + _RECOVERY_BITS * bus.bit) if bus.recovers else NEVER
    _leave(bus, number, back)


def _leave(bus: Bus, number: int, back: int) -> None:
    """Take a node off the bus; it forgets its errors, and what it had to send is given up."""
    node = bus.nodes[number]
    node.back, node.transmit_errors = back, 0
    for frame in bus.frames:
        if frame.sender == number:
            frame.waiting = False


def _break(bus: Bus, outage: Outage) -> None:
    everybody = outage.node == NOBODY
    if bus.on_wire != NOBODY:
        frame = bus.frames[bus.on_wire]
        if everybody or frame.sender == outage.node:
            _send_again(frame)
            bus.on_wire, bus.free = NOBODY, outage.start + _ERROR_BITS * bus.bit
    if everybody:
        bus.free = max(bus.free, outage.end)
    elif outage.kind == BUS_OFF:
        _go_off(bus, outage.node, outage.start)
    elif outage.kind == REBOOT:
        _leave(bus, outage.node, outage.end)
        for frame in bus.frames:
            if frame.sender == outage.node:
                _schedule(frame, outage.end)  # its clock begins anew
    else:
        node = bus.nodes[outage.node]
        node.back = max(node.back, outage.end)
