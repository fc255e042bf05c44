"""How a frame travels from the simulator to the application: a header and grey pixels over a Unix stream socket.

There is no truth in it: a count, the time of mid-exposure on CLOCK_MONOTONIC, the exposure time, the size.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

_HEADER = struct.Struct("<4sIddII")
_MAGIC = b"ALF1"
HEADER_BYTES = _HEADER.size
SIDE_MAX_PX = 8192


@dataclass(frozen=True, slots=True)
class FrameHeader:
    """What comes before the pixels.

    Attributes:
        sequence: Counts up by one for each frame that the camera took.
        t_capture_s: Mid-exposure, CLOCK_MONOTONIC.
        exposure_s: Exposure time.
        width: Of the image, px.
        height: Of the image, px.
    """

    sequence: int
    t_capture_s: float
    exposure_s: float
    width: int
    height: int

    @property
    def image_bytes(self) -> int:
        """How many bytes of pixels follow."""
        return self.width * self.height

    def pack(self) -> bytes:
        """The header as it travels."""
        return _HEADER.pack(
            _MAGIC, self.sequence & 0xFFFFFFFF, self.t_capture_s, self.exposure_s, self.width, self.height
        )


def unpack(data: bytes) -> FrameHeader:
    """The header of a packet.

    Raises:
        ValueError: It is none.
    """
    magic, sequence, t_capture_s, exposure_s, width, height = _HEADER.unpack(data)
    if magic != _MAGIC or not 0 < width <= SIDE_MAX_PX or not 0 < height <= SIDE_MAX_PX:
        raise ValueError("not a frame of the simulator")
    return FrameHeader(sequence, t_capture_s, exposure_s, width, height)
