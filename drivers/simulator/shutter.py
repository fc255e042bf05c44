"""What the simulated camera has been told of its exposure, and when that takes effect.

A sensor is told some frames ahead: picamera2 takes about its number of buffers and three more (its issue 1278). The
delay here is counted in frames too. Told from one thread, asked from another.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

from app.messages import ExposureLimits, Image

LIMITS = ExposureLimits(exposure_min_s=20e-6, exposure_max_s=30e-3, gain_min=1.0, gain_max=16.0)
"""Of the simulated sensor: the gain is that of common ones, the longest exposure fits in 30 frames a second."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """How a frame is exposed.

    Attributes:
        exposure_s: Exposure time.
        gain: Amplification.
    """

    exposure_s: float
    gain: float

    def within(self, limits: ExposureLimits) -> Exposure:
        """What comes nearest within the limits."""
        return Exposure(
            min(limits.exposure_max_s, max(limits.exposure_min_s, self.exposure_s)),
            min(limits.gain_max, max(limits.gain_min, self.gain)),
        )


@dataclass(frozen=True, slots=True)
class Shot:
    """A developed frame.

    Attributes:
        image: (height, width) uint8.
        exposure: How it was exposed.
    """

    image: Image
    exposure: Exposure


class Shutter:
    """Keeps what the camera is told.

    Args:
        delay_frames: Frames that are still exposed as before.
    """

    def __init__(self, delay_frames: int) -> None:
        self._lock = threading.Lock()
        self._wanted: Exposure | None = None
        self._waiting: deque[Exposure | None] = deque([None] * delay_frames)

    def tell(self, exposure: Exposure | None) -> None:
        """Expose so; None: by itself."""
        with self._lock:
            self._wanted = None if exposure is None else exposure.within(LIMITS)

    def next(self) -> Exposure | None:
        """How the next frame is exposed; None: as the sensor thinks best."""
        with self._lock:
            self._waiting.append(self._wanted)
            return self._waiting.popleft()
