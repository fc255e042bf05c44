"""The camera's sensor: from light to grey levels, with vignetting, lens blur, gain, noise and the response curve.

The response is the square root of the light, so that shot noise has one deviation at every grey level
(Anscombe 1948); `noise_dn` is that deviation.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from app.messages import Image
from drivers.simulator.textures import Plane

LENS_BLUR_PX = 0.55
TARGET = 0.125
"""Mean light after the gain, of full scale: a grey level of 90."""
GAIN_RANGE = (0.3, 12.0)
SETTLING = 0.08
"""Share of the error that the gain makes up in a frame."""
NOISE_MARGIN = 256


class Sensor:
    """Develops frames.

    Args:
        rays: (height, width, 3) directions of the pixels.
        noise_dn: Deviation of the noise in grey levels.
        seed: Of the noise.
    """

    def __init__(self, rays: Plane, noise_dn: float, seed: int) -> None:
        self._source = np.random.default_rng((seed, 31))
        height, width = rays.shape[:2]
        off_axis = np.arccos(np.clip(rays[..., 2], -1.0, 1.0))
        # Natural vignetting of a fast lens is milder than cos^4; past 85 degrees the image circle ends.
        falloff = 0.45 + 0.55 * np.clip(np.cos(off_axis), 0.0, 1.0) ** 2
        rim = np.clip((math.radians(100.0) - off_axis) / math.radians(10.0), 0.0, 1.0)
        self._vignette: Plane = (falloff * rim).astype(np.float32)
        self._noise: Plane = (
            noise_dn * self._source.standard_normal((height + NOISE_MARGIN, width + NOISE_MARGIN))
        ).astype(np.float32)
        self._gain: float | None = None
        self._work: Plane = np.empty((height, width), dtype=np.float32)

    def develop(self, light: Plane) -> Image:
        """(height, width) uint8 of the light (height, width), which is overwritten."""
        work = self._work
        cv2.multiply(light, self._vignette, dst=light)
        height, width = light.shape
        # Metered in the middle, as cameras do: the dark corners of a fisheye tell nothing.
        mean = float(cv2.mean(light[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4])[0])
        wanted = min(GAIN_RANGE[1], max(GAIN_RANGE[0], TARGET / max(mean, 1e-4)))
        self._gain = wanted if self._gain is None else self._gain * (wanted / self._gain) ** SETTLING
        cv2.GaussianBlur(light, (5, 5), LENS_BLUR_PX, dst=work)
        np.multiply(work, np.float32(self._gain * 255.0 * 255.0), out=work)
        cv2.sqrt(work, dst=work)
        row, column = (int(v) for v in self._source.integers(0, NOISE_MARGIN, 2))
        noise: NDArray[np.float32] = self._noise[row : row + height, column : column + width]
        if self._source.integers(2):
            cv2.add(work, noise, dst=work)
        else:
            cv2.subtract(work, noise, dst=work)
        np.clip(work, 0.0, 255.0, out=work)
        return np.asarray(cv2.convertScaleAbs(work), dtype=np.uint8)
