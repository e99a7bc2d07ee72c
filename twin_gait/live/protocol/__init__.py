"""What a page says to the simulation and what it hears back, as plain values.

Everything that comes from a page is JSON text and becomes one of two messages, or a refusal. Everything that
goes to a page is a mapping with a ``kind``:

* ``state``: the panel: all controls and actions with ranges, units and present values;
* ``frame``: one moment of the walk, some thirty times a second; the newest is the one that counts;
* ``event``: what became of a message, or what the simulation did by itself; none of them is dropped.
"""

from twin_gait.live.protocol.from_page import (
    LARGEST_MESSAGE,
    LONGEST_NAME,
    LONGEST_TEXT,
    MOST_VALUES,
    Action,
    DoAction,
    Message,
    MessageRefused,
    SetControl,
    Value,
    id_of,
    message_from,
    read_message,
)
from twin_gait.live.protocol.to_page import (
    PROTOCOL_VERSION,
    ActionSpec,
    Control,
    ControlKind,
    DeadlineStatistics,
    Event,
    Frame,
    Response,
    State,
    dump,
)

__all__ = [
    "LARGEST_MESSAGE",
    "LONGEST_NAME",
    "LONGEST_TEXT",
    "MOST_VALUES",
    "PROTOCOL_VERSION",
    "Action",
    "ActionSpec",
    "Control",
    "ControlKind",
    "DeadlineStatistics",
    "DoAction",
    "Event",
    "Frame",
    "Message",
    "MessageRefused",
    "Response",
    "SetControl",
    "State",
    "Value",
    "dump",
    "id_of",
    "message_from",
    "read_message",
]
