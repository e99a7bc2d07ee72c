"""Live walk on a CAN bus: its frames at their cycle, and the commands of the thesis's board monitor (2.4).

One thread uses the bus. Frames are computed in blocks of 10 ms and sent one block later, each at its own time
in the clock of the walk. Commands become messages of the session, like those of the sliders of a page.
"""

from __future__ import annotations

import math
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

from twin_gait.core.can_codec import unpack_frame
from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.export.can import bus_frames, network_messages
from twin_gait.live.controls import QUANTITIES
from twin_gait.live.loop import PERIOD
from twin_gait.live.motor_link import MotorLink
from twin_gait.live.protocol import DoAction, Message, MessageRejected, SetControl, Value, one_line
from twin_gait.live.telemetry import Block, EventLog
from twin_gait.network.dbc import Message as BusMessage
from twin_gait.network.drives import MotorFrame
from twin_gait.network.messages import ON_DEMAND
from twin_gait.parameters.motor_bus import MotorProtocol
from twin_gait.parameters.network import NetworkParameters
from twin_gait.simulation.simulation_setup import SimulationSetup

if TYPE_CHECKING:
    import can


MODE = "mode"
USER = "CAN"
# Frames of udp_multicast stay on this machine.
OPTIONS: Mapping[str, Mapping[str, Any]] = {"udp_multicast": {"hop_limit": 0}}
FARTHEST = 3 * PERIOD  # [s], largest deviation of a frame from its time before the clock is set again
SEND_TIME = 1e-3  # [s], timeout of the driver for a frame
LISTENING = NetworkParameters.cycle  # [s], timeout for a frame of the monitor if no frame is due


Commands = dict[str, Value]  # values of controls in their units, by name


def decode_commands(message: BusMessage, data: bytes) -> Commands:
    """Decode a command of the monitor.

    Returns the commanded values by the name of the control; a signal without a number (NaN) is omitted.
    Raises MessageRejected if the frame has another length.
    """
    if len(data) != message.length:
        raise MessageRejected(f"{message.name}: expected {message.length} bytes, got {len(data)}")
    values = [math.nan] * len(message.signals)
    unpack_frame(message.layout, struct.unpack("<2I", data.ljust(8, b"\0")), values)
    signals = dict(zip(message.signals, values, strict=True))
    side, _, joint = message.name.removesuffix(ON_DEMAND).partition("_")
    commands: Commands = {}
    for quantity, shown in QUANTITIES.items():
        if not math.isnan(signals[quantity]):
            commands[f"monitor.{side}.{joint}.{quantity}"] = signals[quantity] / shown.scale
    names = {code: name for name, code in message.codes["control"].items()}
    return {**commands, MODE: names[int(signals["control"])]}


def open_bus(name: str) -> can.BusABC:
    """Open a bus of python-can.

    ``name``: ``INTERFACE:CHANNEL``, such as ``udp_multicast:239.74.163.2`` or ``socketcan:vcan0``; further
    settings of a driver (a bit rate) are in python-can's own configuration file. Raises ParameterError if
    there is no such interface, or if it cannot be opened. Raises MissingOptionalDependency if python-can is
    not installed.
    """
    try:
        import can
    except ImportError as error:
        raise MissingOptionalDependency("python-can", "can", "a CAN bus") from error
    interface, _, channel = name.partition(":")
    try:
        return can.Bus(channel, interface, **OPTIONS.get(interface, {}))
    except Exception as error:  # drivers raise errors of any type
        expected = "expected INTERFACE:CHANNEL, such as udp_multicast:239.74.163.2, with a channel that is up"
        raise ParameterError(f"CAN bus {name!r}: cannot be opened ({one_line(error)}); {expected}") from error


def leaves_machine(name: str) -> bool:
    """Return whether frames on a bus may reach devices other than this machine."""
    interface, _, channel = name.partition(":")
    return interface not in ("virtual", "udp_multicast") and not channel.startswith("vcan")


class CanLink:
    """Link of a live walk to a bus: it sends frames of the walk and receives commands."""

    def __init__(
        self, name: str, setup: SimulationSetup, event_log: EventLog, submit: Callable[[Message], Any]
    ) -> None:
        """Open the bus, and begin to send and to receive.

        ``name``: as in :func:`open_bus`; ``setup``: of the walk; ``event_log``: for notes on errors;
        ``submit``: function that accepts a message like those of a page.
        """
        # Drives of other makers; None if the frames are those of TWIN's boards.
        own = setup.experiment.plant.motor_bus.protocol is MotorProtocol.TWIN
        self._motors = None if own else MotorLink(setup.experiment, self._hold)
        self._messages = network_messages(setup.experiment) if own else {}
        on_demand = (item for item in self._messages.values() if item.name.endswith(ON_DEMAND))
        self._commands = {item.identifier: item for item in on_demand}  # commands of a monitor by identifier
        self._body_weight = setup.world.body_weight
        self._event_log, self._submit = event_log, submit
        self._blocks: deque[Block] = deque()
        self.add_block = self._blocks.append  # accepts a block of the walk; returns immediately
        # Times, and functions that return identifier and payload of the frames that are sent then.
        self._due: deque[tuple[float, Callable[[], list[MotorFrame]]]] = deque()
        self._last_sent = 0.0  # time of the last frames, in the time of this machine
        self._start = 0.0  # start of the walk in the time of this machine
        self._last_commands: dict[int, Commands] = {}
        self._unsent_commands: Commands = {}
        self._pending_results: list[Future[bool]] = []
        self._notes: set[str] = set()
        self._closed = threading.Event()
        self._bus = open_bus(name)
        self._thread = threading.Thread(target=self._run, name="CAN", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, and release the bus."""
        self._closed.set()
        self._thread.join()
        self._bus.shutdown()

    def _run(self) -> None:
        try:
            while not self._closed.is_set():
                self._send_and_receive()
                self._submit_commands()
            if self._motors is not None:
                self._send(self._motors.stop())
        except Exception:  # drivers raise errors of any type; the terminal shows the traceback
            self._note("the link to the CAN bus has ended, no frame is sent or received; restart the walk")
            raise

    def _send_and_receive(self) -> None:
        """Send the frames that are due, and wait for a received frame until the next one is due."""
        import can

        try:
            while self._blocks:
                self._schedule_frames(self._blocks.popleft())
            while self._due and self._due[0][0] <= time.monotonic():
                self._last_sent, frames = self._due.popleft()
                if self._motors and self._due and self._due[0][0] <= time.monotonic():
                    continue  # a newer setpoint for the drives is due as well
                self._send(frames())
            if self._motors and self._motors.running and time.monotonic() > self._last_sent + FARTHEST:
                self._send(self._motors.stop())
                self._note("the walk pauses or stalls: the drives are off until it goes on")
            wait = self._due[0][0] - time.monotonic() if self._due else LISTENING
            message = self._bus.recv(min(max(wait, 0.0), LISTENING))
            if message is not None:
                self._receive(message)
        except (can.CanError, OSError) as error:
            self._due.clear()  # set points that wait for the bus would come too late
            self._note(f"the CAN bus has failed, frames are lost: {one_line(error)}")
            self._closed.wait(PERIOD)

    def _send(self, frames: list[MotorFrame]) -> None:
        import can

        for identifier, data in frames:
            message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False, is_rx=False)
            self._bus.send(message, SEND_TIME)

    def _hold(self, fault: str) -> None:
        """Note the fault of a drive, and hold the legs."""
        text = f"{fault}; the legs are held, restart the walk after its repair"
        self._event_log.emit("note", text, user=USER)
        self._submit(DoAction(id=USER, user=USER, action="stop"))

    def _note(self, text: str) -> None:
        """Emit a note only once, because its cause may occur with every frame."""
        if text not in self._notes:
            self._notes.add(text)
            self._event_log.emit("note", text, user=USER)

    # ------------------------------------------------------------------ sending

    def _schedule_frames(self, block: Block) -> None:
        """Schedule the frames of a block."""
        cycles: list[tuple[float, Callable[[], list[MotorFrame]]]]
        if self._motors is not None:
            cycles = list(self._motors.schedule(block))
        else:
            weight, tripped = self._body_weight, block.tripped
            columns, messages = block.columns, self._messages
            frames = bus_frames(columns, messages, first=block.first, body_weight=weight, tripped=tripped)
            cycles = [(frame.time, partial(list, [MotorFrame(*frame[1:])])) for frame in frames]
        now = time.monotonic()
        # A block is ready at the start of its time or a little later; it is therefore sent one block later.
        if cycles and abs(self._start + cycles[0][0] - now - PERIOD) > FARTHEST:
            self._start = now + PERIOD - cycles[0][0]  # after a pause, a restart, a stall
        self._due.extend((self._start + tick, frames) for tick, frames in cycles)

    # ------------------------------------------------------------------ listening

    def _receive(self, message: can.Message) -> None:
        """Decode a frame, and store the commands that differ from those of the previous frame."""
        known = self._commands.get(message.arbitration_id)
        plain = message.is_rx and not (message.is_extended_id or message.is_error_frame)
        if self._motors is not None and plain:
            self._motors.receive(MotorFrame(message.arbitration_id, bytes(message.data)))
        if known is None or message.is_extended_id or message.is_error_frame:
            return
        try:
            commands = decode_commands(known, bytes(message.data))
        except MessageRejected as error:
            self._note(f"frame ignored: {error}")
            return
        before = self._last_commands.get(known.identifier, {})
        self._last_commands[known.identifier] = commands
        self._unsent_commands |= dict(commands.items() - before.items())

    def _submit_commands(self) -> None:
        """Submit the stored commands as soon as the previous ones have been answered."""
        if not self._unsent_commands or not all(result.done() for result in self._pending_results):
            return
        commands, self._unsent_commands = self._unsent_commands, {}
        ordered = sorted(commands, key=MODE.__eq__)  # the mode is last, after its initial values
        settings = [SetControl(id=USER, user=USER, control=name, value=commands[name]) for name in ordered]
        self._pending_results = [result for result in map(self._submit, settings) if result is not None]
