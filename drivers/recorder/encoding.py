"""Messages as JSON with a schema: any frozen dataclass of numbers, enums, arrays and dataclasses. Pure."""

from __future__ import annotations

import base64
import dataclasses
import functools
import json
import math
import types
import typing
from collections.abc import Mapping
from enum import Enum
from typing import Any

import cv2
import numpy as np

from app.messages import Frame, Image

FRAME_SCHEMA_NAME = "foxglove.CompressedImage"
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
FRAME_SCHEMA: dict[str, Any] = {
    "title": FRAME_SCHEMA_NAME,
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "data": {"type": "string", "contentEncoding": "base64"},
        "format": {"type": "string"},
        "sequence": {"type": "integer"},
        "t_capture_s": {"type": "number"},
        "exposure_s": {"type": ["number", "null"]},
        "gain": {"type": ["number", "null"]},
        "name": {"type": "string"},
    },
}
"""Foxglove's well-known schema, by which its Studio shows the image, and what else a Frame holds."""


def plain(value: Any) -> Any:
    """A value as JSON has it: a dataclass as an object, an array as nested lists, an enum by its value, NaN as null."""
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, np.ndarray):
        finite = value.dtype.kind != "f" or bool(np.isfinite(value).all())
        return value.tolist() if finite else [plain(item) for item in value]
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    return [plain(item) for item in value]


def encode(message: Any) -> bytes:
    """A message as JSON.

    Raises:
        TypeError: It holds something that isn't data.
    """
    return json.dumps(plain(message), allow_nan=False, separators=(",", ":")).encode()


def encode_frame(frame: Frame, jpeg_quality: int) -> bytes:
    """A frame as JSON of FRAME_SCHEMA, its image as a JPEG.

    Raises:
        ValueError: The image can't be compressed.
    """
    ok, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    if not ok:
        raise ValueError(f"frame {frame.sequence} can't be compressed")
    sec, nsec = divmod(nanoseconds(frame.t_capture_s), 10**9)
    return json.dumps(
        {
            "timestamp": {"sec": sec, "nsec": nsec},
            "frame_id": "cam",
            "data": base64.b64encode(jpeg.tobytes()).decode("ascii"),
            "format": "jpeg",
            "sequence": frame.sequence,
            "t_capture_s": frame.t_capture_s,
            "exposure_s": frame.exposure_s,
            "gain": frame.gain,
            "name": frame.name,
        },
        separators=(",", ":"),
    ).encode()


def nanoseconds(t_s: float) -> int:
    """A time as MCAP has it: whole nanoseconds from 0 on."""
    return max(0, round(t_s * 1e9))


@functools.cache
def schema_of(kind: type) -> bytes:
    """JSON schema of a dataclass, as JSON; of Frame, Foxglove's."""
    return json.dumps(FRAME_SCHEMA if kind is Frame else {"title": kind.__name__, **_schema(kind)}).encode()


def _schema(kind: Any) -> dict[str, Any]:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return {"anyOf": [_schema(choice) for choice in arguments]}
    if kind in _ARRAYS or origin is np.ndarray or kind is np.ndarray:
        return {"type": "array", "items": {}}
    if origin in (tuple, list):
        inner = [a for a in arguments if a is not Ellipsis]
        return {"type": "array", "items": _schema(inner[0]) if inner else {}}
    if isinstance(kind, type) and issubclass(kind, Enum):
        return {"enum": [member.value for member in kind]}
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return {"type": "object", "properties": {f.name: _schema(hints[f.name]) for f in dataclasses.fields(kind)}}
    return {"type": _JSON_TYPES[kind]} if kind in _JSON_TYPES else {}


_ARRAYS: tuple[Any, ...] = (Image,)
_JSON_TYPES: dict[Any, str] = {
    float: "number",
    int: "integer",
    bool: "boolean",
    str: "string",
    type(None): "null",
    dict: "object",
}
