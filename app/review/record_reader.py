"""Reading a flight record: what was written under each topic, in the order in which it was written.

A record whose writer was killed ends without an index, in the middle of a chunk: it is read as far as it goes.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from app.errors import RecorderError
from app.messages import Frame

_FRAME_SCHEMA_NAME = "foxglove.CompressedImage"


class Recorded(NamedTuple):
    """One message of a record.

    Attributes:
        topic: Where it was written.
        t_s: Its time on the monotonic clock of that flight.
        kind: Name of the message's class: "VehicleState", "Frame".
        message: A Frame, or the message's fields: arrays as lists, enums by value, NaN as None.
    """

    topic: str
    t_s: float
    kind: str
    message: dict[str, Any] | Frame


def read_record(path: Path, *, images: bool = True) -> Iterator[Recorded]:
    """The messages of a flight record.

    Args:
        path: Of the record.
        images: Frames too; they are most of a record, and of the time that it takes to read one.

    Raises:
        RecorderError: There is no such file, it is no MCAP file, or it is damaged before its end.
    """
    try:
        stream = path.open("rb")
    except OSError as fault:
        raise RecorderError(f"{path}: can't be read ({fault.strerror})", "give a flight record (.mcap)") from None
    with stream:
        if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise RecorderError(f"{path}: not an MCAP file", "give a flight record (.mcap)")
        stream.seek(0)
        try:
            yield from _messages(StreamReader(stream, validate_crcs=True), images)
        except (McapError, ZstdError, struct.error, ValueError, KeyError) as fault:
            if stream.read(1) == b"":
                return  # cut off in the middle of what its writer wrote last
            raise RecorderError(f"{path}: damaged ({fault})", "give another record") from None


def _messages(reader: StreamReader, images: bool) -> Iterator[Recorded]:
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    for record in reader.records:
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = (record.topic, schemas[record.schema_id])
        elif isinstance(record, Message):
            topic, schema = channels[record.channel_id]
            if schema == _FRAME_SCHEMA_NAME:
                if images:
                    yield Recorded(topic, record.log_time / 1e9, "Frame", _frame(json.loads(record.data)))
            else:
                fields = json.loads(record.data)
                yield Recorded(topic, record.log_time / 1e9, schema.rpartition(".")[2], fields)


def _frame(fields: dict[str, Any]) -> Frame:
    try:
        jpeg = np.frombuffer(base64.b64decode(fields["data"]), dtype=np.uint8)
    except binascii.Error as fault:
        raise ValueError(f"an image that is no base64: {fault}") from None
    image = cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError("an image that is no JPEG")
    return Frame(
        t_capture_s=float(fields["t_capture_s"]),
        sequence=int(fields["sequence"]),
        image=image.astype(np.uint8, copy=False),
        exposure_s=fields["exposure_s"],
        name=str(fields["name"]),
        gain=fields.get("gain"),  # records of before the gain was kept have none
    )
