"""Export of a log as MCAP with messages of Protobuf, which PlotJuggler, Foxglove and rerun open.

MCAP is specified at https://mcap.dev/spec, and its encoding of Protobuf at https://mcap.dev/spec/registry:
the schema of a channel is a FileDescriptorSet. Each part of the device, such as ``/left_knee``, is a channel
with one message a tick. A field has the name of its column without the part, with the unit at its end.
"""

import io
from collections.abc import Iterable, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName, Side

PACKAGE = "twin_gait"
WHOLE = "walk"  # channel of the columns that belong to no leg
NANOSECONDS = 1_000_000_000  # in a second
# Parts of the device, a longer name before its beginning.
_PARTS = (*(f"{side}_{part}" for side, part in product(Side, (*JointName, "foot", "arm"))), *Side)


def log_channels(names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return the columns of a log by channel, and by field of the channel."""
    channels: dict[str, dict[str, str]] = {}
    for name in names:
        part = next((part for part in _PARTS if name.startswith(f"{part}_")), WHOLE)
        channels.setdefault(part, {})[name.removeprefix(f"{part}_")] = name
    return channels


def export_mcap(log: pd.DataFrame, path: str | Path) -> None:
    """Write all columns of a log; the time of a message is that of its tick since the start of the run.

    Raises MissingOptionalDependency if the library is not installed.
    """
    try:
        from mcap_protobuf.writer import Writer
    except ImportError as error:
        raise MissingOptionalDependency("mcap-protobuf-support", "mcap", "an MCAP file") from error
    channels = log_channels(log.columns)
    kinds = _message_classes(
        {part: {field: log[name] for field, name in fields.items()} for part, fields in channels.items()}
    )
    rows = {
        part: zip(*(log[name].tolist() for name in fields.values()), strict=True)
        for part, fields in channels.items()
    }
    buffer = io.BytesIO()
    with Writer(buffer) as writer:
        for tick in range(len(log)):
            time = round(tick * TICK * NANOSECONDS)
            for part, fields in channels.items():
                message = kinds[part](**dict(zip(fields, next(rows[part]), strict=True)))
                writer.write_message(f"/{part}", message, log_time=time, publish_time=time)
    write_atomically(path, buffer.getvalue())


def _message_classes(channels: Mapping[str, Mapping[str, pd.Series]]) -> dict[str, Any]:
    """Return the message class of each channel, with one field for each column."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    field_type = descriptor_pb2.FieldDescriptorProto
    pool, classes = descriptor_pool.DescriptorPool(), {}
    for part, columns in channels.items():
        file = descriptor_pb2.FileDescriptorProto(
            name=f"{PACKAGE}/{part}.proto", package=PACKAGE, syntax="proto3"
        )
        message = file.message_type.add(name=part)
        for number, (name, column) in enumerate(columns.items(), start=1):
            kind = {"b": field_type.TYPE_BOOL, "i": field_type.TYPE_INT64, "f": field_type.TYPE_DOUBLE}.get(
                np.dtype(column.dtype).kind if isinstance(column.dtype, np.dtype) else "",
                field_type.TYPE_STRING,
            )
            message.field.add(name=name, number=number, type=kind, label=field_type.LABEL_OPTIONAL)
        pool.Add(file)
        classes[part] = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{part}"))
    return classes
