"""Something before the lens for a while: a leaf that the rotors throw up, far too near to be sharp. It hides all."""

from __future__ import annotations

import cv2
import numpy as np

from app.config_world import OcclusionConfig
from drivers.simulator.textures import Plane
from drivers.simulator.world import Truth

REFLECTANCE = 0.09
REARM_M = 0.2
"""The camera has to have been so much higher before: a start beside the pad is no descent."""


class Occluder:
    """Hides the scene once, the first time that the camera sinks below a height over the pad.

    Args:
        config: Which height, and for how long.
        shape: (height, width) of the image.
    """

    def __init__(self, config: OcclusionConfig, shape: tuple[int, int]) -> None:
        self._config = config
        self._was_above = False
        self._since_s: float | None = None
        blotches = np.random.default_rng(41).uniform(0.6, 1.4, (4, 5)).astype(np.float32)
        smooth = cv2.resize(blotches, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
        self._light: Plane = (REFLECTANCE * smooth).astype(np.float32)

    def hides(self, truth: Truth) -> bool:
        """Whether it is before the lens now."""
        height_m = truth.pad.down_m - truth.pos[2]
        if self._since_s is None:
            self._was_above = self._was_above or height_m > self._config.below_m + REARM_M
            if self._was_above and height_m < self._config.below_m:
                self._since_s = truth.t_s
        return self._since_s is not None and truth.t_s - self._since_s < self._config.for_s

    def light(self) -> Plane:
        """What the camera sees of it, to be written on."""
        return self._light.copy()
