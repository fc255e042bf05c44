"""The camera's sensor: from light to grey levels, with vignetting, lens blur, exposure, noise and the response curve.

The response is the square root of the light, so that shot noise has one deviation at every grey level
(Anscombe 1948); `noise_dn` is that deviation at gain 1. At the same grey level a gain of g has seen 1 / g of the light,
and its noise is sqrt(g) times as large. While nobody tells the exposure, its time is fixed and the gain is automatic.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from app.messages import Image
from drivers.simulator.shutter import Exposure, Shot
from drivers.simulator.textures import Plane

LENS_BLUR_PX, BLUR_TAPS = 0.55, 3
"""Of this blur a pixel two away gets a thousandth of the light."""
FULL_SCALE_S = 0.4e-3
"""Exposure at gain 1 that brings a surface which throws back all of noon's light just to saturation: white paper is
well exposed at 0.3 ms, as with common small sensors behind an f/2 lens."""
TARGET = 0.125
"""Mean light after the automatic gain, of full scale: a grey level of 90."""
AUTO_RANGE = (0.3, 64.0)
"""What exposure time and automatic gain come to together, in FULL_SCALE_S."""
SETTLING = 0.08
"""Share of the error that the automatic gain makes up in a frame."""
NOISE_MARGIN = 256


class Sensor:
    """Develops frames.

    Args:
        rays: (height, width, 3) directions of the pixels.
        noise_dn: Deviation of the noise in grey levels, at gain 1.
        seed: Of the noise.
        auto_exposure_s: Exposure time while nobody tells it.
    """

    def __init__(self, rays: Plane, noise_dn: float, seed: int, auto_exposure_s: float) -> None:
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
        self._blur = cv2.getGaussianKernel(BLUR_TAPS, LENS_BLUR_PX)
        self._auto_exposure_s = auto_exposure_s
        self._auto: float | None = None
        self._work: Plane = np.empty((height, width), dtype=np.float32)

    def exposure_s(self, told: Exposure | None) -> float:
        """Exposure time of a frame that is told this."""
        return self._auto_exposure_s if told is None else told.exposure_s

    def develop(self, light: Plane, level: float = 1.0, told: Exposure | None = None) -> Shot:
        """A frame of the light (height, width), which is overwritten.

        Args:
            light: What the scene throws back, of noon's light, over the exposure time.
            level: Of the daylight.
            told: How to expose; None: by itself.
        """
        work = self._work
        cv2.multiply(light, self._vignette, dst=light)
        total = self._automatic(light, level)
        if told is None:
            exposure = Exposure(self._auto_exposure_s, total * FULL_SCALE_S / self._auto_exposure_s)
        else:
            exposure, total = told, told.exposure_s * told.gain / FULL_SCALE_S
        # The lens's blur and the exposure in one: what both directions' taps sum to is the scale.
        taps = math.sqrt(level * total) * 255.0 * self._blur
        cv2.sepFilter2D(light, cv2.CV_32F, taps, taps, dst=work)
        cv2.sqrt(work, dst=work)
        return Shot(self._with_noise(work, exposure.gain), exposure)

    def _automatic(self, light: Plane, level: float) -> float:
        """What the automatic exposure comes to, in FULL_SCALE_S; it goes on settling while it isn't used."""
        height, width = light.shape
        # Metered in the middle, as cameras do: the dark corners of a fisheye tell nothing.
        mean = level * float(cv2.mean(light[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4])[0])
        wanted = min(AUTO_RANGE[1], max(AUTO_RANGE[0], TARGET / max(mean, 1e-6)))
        self._auto = wanted if self._auto is None else self._auto * (wanted / self._auto) ** SETTLING
        return self._auto

    def _with_noise(self, work: Plane, gain: float) -> Image:
        """Grey levels with noise, rounded and held within 8 bits; work (height, width) is overwritten."""
        height, width = work.shape
        row, column = (int(v) for v in self._source.integers(0, NOISE_MARGIN, 2))
        noise: NDArray[np.float32] = self._noise[row : row + height, column : column + width]
        sign = 1.0 if self._source.integers(2) else -1.0
        strength = sign * math.sqrt(max(1.0, gain))
        cv2.scaleAdd(noise, strength, work, dst=work)
        # OpenCV's own step to grey levels takes the magnitude; a sum that ends in grey levels takes twice as long.
        np.clip(work, 0.0, 255.0, out=work)
        return np.asarray(cv2.convertScaleAbs(work), dtype=np.uint8)
