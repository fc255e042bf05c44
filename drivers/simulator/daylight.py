"""How bright the simulated day is at each moment, a shadow's edge, and the sun's mirror image in what is wet or glossy.

Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from app.config import LightConfig, PadMotionConfig
from app.config_world import ShadowConfig
from drivers.simulator.textures import Plane
from drivers.simulator.view import View

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


@dataclass(frozen=True, slots=True)
class ShadowEdge:
    """A building's shadow whose straight edge lies across the scene, where the pad starts.

    Attributes:
        place: North, east, of a point of the edge.
        toward: North, east, of unit length: which way the shadow lies.
        light: That is left in it.
        soft_m: Width of the edge.
        height_m: Of the plane that it is drawn on, over the ground: the pad's.
    """

    place: tuple[float, float]
    toward: tuple[float, float]
    light: float
    soft_m: float
    height_m: float

    def dim(self, light: Plane, view: View) -> None:
        """Take the light of what lies in the shadow."""
        above = view.height_m - self.height_m
        n, e = self.toward
        beside = n * (float(view.position[0]) - self.place[0]) + e * (float(view.position[1]) - self.place[1])
        per_m = above / self.soft_m
        covered = cv2.addWeighted(view.north, n * per_m, view.east, e * per_m, beside / self.soft_m + 0.5)
        left = 1.0 + (self.light - 1.0) * np.clip(np.asarray(covered, dtype=np.float32), 0.0, 1.0)
        light *= left


def shadow_edge(shadow: ShadowConfig, motion: PadMotionConfig) -> ShadowEdge:
    """The edge of a world's shadow."""
    way = math.radians(shadow.toward_deg)
    toward = (math.cos(way), math.sin(way))
    place = (motion.north_m + shadow.offset_m * toward[0], motion.east_m + shadow.offset_m * toward[1])
    return ShadowEdge(place, toward, shadow.light, shadow.soft_m, motion.height_m)
