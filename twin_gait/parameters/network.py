"""Parameters of the CAN bus between the central unit and the boards of the joints."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait.exceptions import ParameterError
from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import CodedEnum, JointName, Side

CCU = "ccu"  # The central control unit.
# Names of the boards that a device may have, one for each joint. The position of a board is its number on the
# bus, which determines the identifiers of its messages in every device; ankles follow hips and knees.
BOARDS = tuple(
    f"{side}_{joint}"
    for joints in ((JointName.HIP, JointName.KNEE), (JointName.ANKLE,))
    for side in Side
    for joint in joints
)
NODES = (CCU, *BOARDS)  # All nodes that a bus may have.

BIT_RATES = quantities.Range(10e3, 1e6, words="10000 to 1e+06 bit/s, the range of CAN 2.0")
CYCLES = quantities.Range(1e-3, 0.1, words="0.001 to 0.1 s")  # The shortest one is a tick of the boards.
DRIFTS = quantities.Range(-0.01, 0.01, words="at most 0.01, with either sign")
DELAYS = quantities.Range(0.0, 0.1, words="0 s to 0.1 s in whole milliseconds")
_SECONDS = r"(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)"
_SHAPE = re.compile(rf"([a-z_]+)(?::([a-z_]+))?@{_SECONDS}s(?:={_SECONDS}(m?)s)?")


class ImpedanceLocation(StrEnum):
    """Location where virtual springs and dampers are computed."""

    BOARD = "board"  # On the board of the joint, from its own angle; the bus transmits k, b, θ0, G.
    CCU = "ccu"  # In the central unit, from measurements received over the bus, which transmits torques.


class OutageKind(CodedEnum):
    """Kind of an outage of a node; ``code`` is its number in :mod:`twin_gait.core.can_bus`."""

    SILENCE = "silence"  # A broken wire: of the branch of a node, or of the bus.
    REBOOT = "reboot"  # The node is off for a time, loses its state, and restarts its cycle.
    BUS_OFF = "bus_off"  # The CAN controller of the node takes itself off the bus.


@dataclass(frozen=True, kw_only=True)
class Outage:
    """Time in which a node is off the bus."""

    kind: OutageKind  # Kind of the outage.
    time: float  # Start in [s].
    node: str | None = None  # Name of the node, one of :data:`NODES`; None if all nodes are silent.
    # Duration in [s], infinite for a permanent outage; without meaning for ``bus_off``, after which a node
    # recovers according to the parameters of the network.
    duration: float = math.inf

    def __post_init__(self) -> None:
        """Check that kind, node and duration are consistent."""
        quantities.NOT_NEGATIVE.require("time", self.time)
        whole = self.node is None and self.kind is OutageKind.SILENCE
        known = f"one of {', '.join(NODES)}"
        require(whole or self.node in NODES, f"node of {self.kind}", known, self.node)
        require(self.duration > 0.0, f"duration of {self.kind}", "a time above 0", self.duration)
        endless = self.kind is not OutageKind.BUS_OFF or math.isinf(self.duration)
        none = "no duration, because bus_off_recovery sets it"
        require(endless, "duration of bus_off", none, self.duration)

    def __str__(self) -> str:
        """Write the outage in its notation, which :func:`parse_outage` reads."""
        node = f":{self.node}" if self.node else ""
        lasting = f"={self.duration!r}s" if math.isfinite(self.duration) else ""
        return f"{self.kind}{node}@{self.time!r}s{lasting}"


def parse_outage(text: str) -> Outage:
    """Parse an outage in its notation, ``KIND:NODE@TIMEs=DURATIONs``.

    ``reboot:left_knee@4.2s=0.3s``, ``silence@5s=200ms`` of the whole bus, ``silence:ccu@5s`` without end,
    ``bus_off:right_hip@3s``.

    Raises ParameterError if it cannot be parsed.
    """
    match = _SHAPE.fullmatch(text.strip())
    if match is None or match[1] not in list(OutageKind):
        expected = f"expected KIND:NODE@TIMEs=DURATIONs, kinds are {', '.join(OutageKind)}"
        raise ParameterError(f"outage {text!r}: {expected}; for example reboot:left_knee@4.2s=0.3s")
    kind, node, time, duration, milli = match.groups()
    lasting = math.inf if duration is None else float(duration) * (1e-3 if milli else 1.0)
    try:
        return Outage(kind=OutageKind(kind), time=float(time), node=node, duration=lasting)
    except ParameterError as error:
        raise ParameterError(f"outage {text!r}: {error}") from error


@dataclass(frozen=True, kw_only=True)
class NetworkParameters(quantities.Parameters):
    """The CAN bus of the star; the thesis (2.1.2) gives CAN and 500 Hz, but neither bit rate nor layout.

    All values except the cycle are assumptions; the defaults are a healthy bus.

    Attributes:
        bit_rate: Bit rate in [bit/s]. The eight frames of four boards in a cycle of 2 ms take half of
            1 Mbit/s, the maximum of CAN 2.0, and more than 500 kbit/s.
        dbc: File with the layout of the frames, or ``twin.dbc``, which is part of the package; empty for the
            layout that is generated for the boards and limits of the device.
        cycle: Period of setpoints and measurements in [s].
        phase: Delay of the cycle of a board relative to that of the central unit in [s], by its name.
        clock_drift: Relative error of the clock of a board, positive if it is fast, by its name; 1e-6 is a
            millionth.
        jitter: Longest time from the instant at which a frame is due until its node queues it, in [s];
            uniformly distributed.
        delay: Additional delay of every frame, due to gateways and drivers on its way, in [s], whole
            milliseconds.
        loss: Share of the sent frames that do not arrive, as with a buffer overrun.
        error_share: Share of the transmissions that an error destroys; they are repeated automatically.
        bus_off_recovery: Whether a node that went bus-off returns after the time of 128 times 11 bits.
        impedance: Location where the virtual springs are computed.
        board_timeout: Timeout in [s] of the messages of the central unit at a board, after which the board
            holds its joint.
        ccu_timeout: Timeout in [s] of the messages of a board at the central unit, after which it trips.
        outages: Outages of nodes or the bus.
    """

    bit_rate: Annotated[quantities.BitRate, BIT_RATES] = 1e6
    dbc: str = ""
    cycle: Annotated[quantities.Time, CYCLES] = 2e-3
    phase: Annotated[Mapping[str, quantities.ShortTime], quantities.AllowedKeys(BOARDS)] = field(
        default_factory=dict
    )
    clock_drift: Annotated[Mapping[str, quantities.Drift], DRIFTS, quantities.AllowedKeys(BOARDS)] = field(
        default_factory=dict
    )
    jitter: quantities.ShortTime = 0.0
    delay: Annotated[quantities.Time, DELAYS] = 0.0
    loss: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    error_share: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    bus_off_recovery: bool = True
    impedance: ImpedanceLocation = ImpedanceLocation.BOARD
    board_timeout: Annotated[quantities.Time, quantities.POSITIVE] = 0.02
    ccu_timeout: Annotated[quantities.Time, quantities.POSITIVE] = 0.02
    outages: Annotated[tuple[Outage, ...], quantities.Notation(parse_outage)] = ()

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        within = f"0 s to the cycle, {self.cycle:g} s"
        for board, phase in self.phase.items():
            require(0.0 <= phase < self.cycle, f"phase of {board}", within, phase)
        require(0.0 <= self.jitter <= self.cycle, "jitter", within, self.jitter)
        whole = abs(self.delay * 1e3 - round(self.delay * 1e3)) < 1e-9
        require(whole, "delay", DELAYS.expected, self.delay)

    def require_fit(self, sides: Collection[Side], joints: Sequence[JointName], duration: float) -> None:
        """Check the network against the legs, the controlled joints and the duration of a run in [s].

        Every named board has to exist, and every outage has to begin before the end of the run.
        """
        there = (CCU, *(f"{side}_{joint}" for side in sides for joint in joints))
        for key in ("phase", "clock_drift"):
            for board in getattr(self, key):
                require(board in there, f"network {key}", f"boards {', '.join(there[1:])}", board)
        for outage in self.outages:
            name, nodes = f"network outage {outage}", f"a node of {', '.join(there)}"
            require(outage.node is None or outage.node in there, name, nodes, outage.node)
            before = f"a time before the end at {duration:g} s"
            require(outage.time < duration, name, before, outage.time)
