"""How bright the simulated day is at each moment, and the sun's mirror image in what is wet or glossy. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.config import LightConfig
from drivers.simulator.textures import Plane

REACH = 5.0
"""The glare is drawn this many of its widths around its middle."""
WHITE = 0.78
"""Of the light, as much as white paper throws back (decals.WHITE): a glare of 1 adds this at its middle."""


def level_at(light: LightConfig, t_s: float) -> float:
    """The light's level at a time from the camera's first frame on. A change that takes time is even in stops."""
    level = light.level
    for change in light.changes:
        if t_s < change.at_s:
            break
        share = min(1.0, (t_s - change.at_s) / change.over_s) if change.over_s > 0.0 else 1.0
        level *= (change.level / level) ** share
    return level


@dataclass(frozen=True, slots=True)
class Glare:
    """The sun mirrored in level surfaces: where a pixel's ray, turned up, would meet the sun.

    Attributes:
        slope: North and east per metre down of the ray that does.
        strength: Light at the middle.
        width: Half width, in slope (a deviation of a Gaussian: the roughness of what mirrors).
    """

    slope: tuple[float, float]
    strength: float
    width: float

    def add(self, light: Plane, north: Plane, east: Plane) -> None:
        """Add it to the light of a view whose pixels look along these slopes."""
        away = ((north - np.float32(self.slope[0])) / self.width) ** 2
        away += ((east - np.float32(self.slope[1])) / self.width) ** 2
        near = away < REACH * REACH
        light[near] += np.float32(self.strength) * np.exp(-0.5 * away[near])


def glare_of(light: LightConfig, sun: tuple[float, float]) -> Glare | None:
    """The glare of a world, if it has one; sun: horizontal way to the sun over its height, north and east."""
    if light.glare <= 0.0:
        return None
    # An angle seen from the camera is a slope; off the vertical the slope grows with 1 / cos^2 of the angle.
    width = math.tan(math.radians(light.glare_width_deg)) * (1.0 + sun[0] ** 2 + sun[1] ** 2)
    return Glare(sun, WHITE * light.glare, width)
