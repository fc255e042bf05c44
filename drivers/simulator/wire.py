"""How a frame travels from the simulator to the application: a header and grey pixels over a Unix stream socket.

There is no truth in it: a count, the time of mid-exposure on CLOCK_MONOTONIC, exposure time and gain, the size.
The other way travels how the camera shall expose.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.simulator.shutter import Exposure

_HEADER = struct.Struct("<4sIdddII")
_MAGIC = b"ALF2"
HEADER_BYTES = _HEADER.size
_ORDER = struct.Struct("<4sdd")
_ORDER_MAGIC = b"ALX1"
ORDER_BYTES = _ORDER.size
SIDE_MAX_PX = 8192


@dataclass(frozen=True, slots=True)
class FrameHeader:
    """What comes before the pixels.

    Attributes:
        sequence: Counts up by one for each frame that the camera took.
        t_capture_s: Mid-exposure, CLOCK_MONOTONIC.
        exposure_s: Exposure time.
        gain: Amplification.
        width: Of the image, px.
        height: Of the image, px.
    """

    sequence: int
    t_capture_s: float
    exposure_s: float
    gain: float
    width: int
    height: int

    @property
    def image_bytes(self) -> int:
        """How many bytes of pixels follow."""
        return self.width * self.height

    def pack(self) -> bytes:
        """The header as it travels."""
        return _HEADER.pack(
            _MAGIC, self.sequence & 0xFFFFFFFF, self.t_capture_s, self.exposure_s, self.gain, self.width, self.height
        )


def unpack(data: bytes) -> FrameHeader:
    """The header of a packet.

    Raises:
        ValueError: It is none.
    """
    magic, sequence, t_capture_s, exposure_s, gain, width, height = _HEADER.unpack(data)
    if magic != _MAGIC or not 0 < width <= SIDE_MAX_PX or not 0 < height <= SIDE_MAX_PX:
        raise ValueError("not a frame of the simulator")
    return FrameHeader(sequence, t_capture_s, exposure_s, gain, width, height)


def pack_order(exposure: Exposure | None) -> bytes:
    """How the camera shall expose, as it travels; None: by itself."""
    return _ORDER.pack(_ORDER_MAGIC, *((0.0, 0.0) if exposure is None else (exposure.exposure_s, exposure.gain)))


def unpack_order(data: bytes) -> Exposure | None:
    """How the camera shall expose; None: by itself.

    Raises:
        ValueError: It is no such packet.
    """
    magic, exposure_s, gain = _ORDER.unpack(data)
    if magic != _ORDER_MAGIC or not (0.0 <= exposure_s < 60.0 and 0.0 <= gain < 1e4):
        raise ValueError("not an exposure for the simulator")
    return Exposure(exposure_s, gain) if exposure_s > 0.0 and gain > 0.0 else None
