"""The camera in the scene: where it is, along which direction each pixel looks, what of the image an outline covers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import cv2
import numpy as np
from numpy.typing import NDArray

from app.config import CameraConfig, LensConfig
from app.frames import BODY_FROM_CAM_DOWN, rotation_from_euler, rotation_from_quaternion
from drivers.simulator.lens import Lens
from drivers.simulator.textures import Plane
from drivers.simulator.world import Truth

Array = NDArray[np.float64]
Box = tuple[int, int, int, int]
"""(u0, v0, u1, v1), half open."""

HORIZON = 0.02
"""Cosine from the vertical at which the ground ends in haze."""
CLOSEST_M = 0.02
"""Nothing nearer than this under the camera is drawn."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a flat thing lies: the origin and heading of its frame (forward, right), its height, and its tilt.

    Attributes:
        north_m: Of its origin.
        east_m: Of its origin.
        heading_rad: Of its forward axis.
        height_m: Of its origin over the ground.
        axes: (3, 3) rows: its forward, right and down axis, each north, east, down; None: it lies level.
    """

    north_m: float
    east_m: float
    heading_rad: float
    height_m: float
    axes: Array | None = None

    def world(self, points_m: Array) -> Array:
        """(n, 3) north, east, down of points (n, 2) forward, right."""
        origin = (self.north_m, self.east_m, -self.height_m)
        if self.axes is not None:
            tilted: Array = points_m @ self.axes[:2] + origin
            return tilted
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        result: Array = points_m @ np.array([[c, s, 0.0], [-s, c, 0.0]]) + origin
        return result

    def over(self, height_m: float) -> Place:
        """The same at another height over the ground, along its down axis."""
        if self.axes is None:
            return replace(self, height_m=height_m)
        rise = height_m - self.height_m
        north, east = self.axes[2][:2] * -rise
        return replace(self, north_m=self.north_m + north, east_m=self.east_m + east, height_m=height_m)


@dataclass(frozen=True, slots=True)
class View:
    """The camera at one instant.

    Attributes:
        position: (3,) north, east, down of the optical centre.
        world_from_cam: (3, 3).
        north: (height, width) metres north per metre down, along each pixel's direction.
        east: The same to the east.
        truth: Where everything else is.
    """

    position: Array
    world_from_cam: Array
    north: Plane
    east: Plane
    truth: Truth

    @property
    def height_m(self) -> float:
        """Of the optical centre over the ground."""
        return -float(self.position[2])

    @property
    def pad_place(self) -> Place:
        """The pad's frame, at its height."""
        pad = self.truth.pad
        axes = None if pad.is_level else np.array(pad.axes)
        return Place(pad.north_m, pad.east_m, pad.heading_rad, -pad.down_m, axes)

    def on_plane(self, place: Place) -> Array:
        """(3, 3): forward and right in a place's frame are the first two rows of this @ (north slope, east slope, 1) of
        a pixel, over the third; the third is (0, 0, 1) where the place lies level.
        """
        above = self.height_m - place.height_m
        c, s = math.cos(place.heading_rad), math.sin(place.heading_rad)
        dn, de = float(self.position[0]) - place.north_m, float(self.position[1]) - place.east_m
        if place.axes is not None:
            # The ray cam + t r meets the plane at t = h / (N r), h being the distance along the plane's normal N.
            normal = place.axes[2]
            away = np.array([dn, de, -above])
            h = -float(normal @ away)
            rows = [h * axis + float(axis @ away) * normal for axis in place.axes[:2]]
            return np.array([*rows, normal])
        return np.array(
            [
                [above * c, above * s, c * dn + s * de],
                [-above * s, above * c, c * de - s * dn],
                [0.0, 0.0, 1.0],
            ]
        )

    def distance_m(self, place: Place) -> float:
        """Of the optical centre from a place's plane, along its normal."""
        above = self.height_m - place.height_m
        if place.axes is None:
            return above
        dn, de = float(self.position[0]) - place.north_m, float(self.position[1]) - place.east_m
        return -float(place.axes[2] @ (dn, de, -above))


def _combine(planes: tuple[Plane, ...], weights: Array, out: Plane) -> None:
    """The weighted sum of three planes."""
    cv2.addWeighted(planes[0], float(weights[0]), planes[1], float(weights[1]), 0.0, dst=out)
    cv2.scaleAdd(planes[2], float(weights[2]), out, dst=out)


def _shifted(truth: Truth, shift_s: float) -> Truth:
    """The truth a little before or after its instant; the vehicle's attitude and what its pad has of speed stay."""
    pad = truth.pad
    n, e, d = (at + shift_s * speed for at, speed in zip(truth.pos, truth.vel, strict=True))
    moved = replace(
        pad,
        north_m=pad.north_m + shift_s * pad.vel_north_m_s,
        east_m=pad.east_m + shift_s * pad.vel_east_m_s,
        down_m=pad.down_m + shift_s * pad.vel_down_m_s,
        heading_rad=pad.heading_rad + shift_s * pad.heading_rate_rad_s,
        roll_rad=pad.roll_rad + shift_s * pad.roll_rate_rad_s,
        pitch_rad=pad.pitch_rad + shift_s * pad.pitch_rate_rad_s,
    )
    return Truth(truth.t_s + shift_s, (n, e, d), truth.vel, truth.q, truth.rates, moved)


class Camera:
    """A lens on a vehicle.

    Args:
        lens: The lens.
        mount: How it is mounted.

    Attributes:
        lens: The lens.
        rays: (height, width, 3) directions of the pixels in the camera's axes.
        pixel_angle: (height, width) side of each pixel's solid angle, rad.
    """

    def __init__(self, lens: LensConfig, mount: CameraConfig) -> None:
        self.lens = Lens(lens)
        self.rays = self.lens.rays()
        self.pixel_angle = self.lens.pixel_angle(self.rays)
        self._rays = tuple(np.ascontiguousarray(self.rays[..., k]) for k in range(3))
        self._position_body_m = np.array(mount.position_body_m, dtype=np.float64)
        self._body_from_cam = (
            rotation_from_euler(
                math.radians(mount.mount_roll_deg),
                math.radians(mount.mount_pitch_deg),
                math.radians(mount.mount_yaw_deg),
            )
            @ BODY_FROM_CAM_DOWN
        )
        self._planes = tuple(np.empty((self.lens.height, self.lens.width), dtype=np.float32) for _ in range(3))

    def look(self, truth: Truth, shift_s: float = 0.0) -> View:
        """The view a little before or after an instant. It is valid until the next: the planes are used again."""
        position = np.array(truth.pos) + shift_s * np.array(truth.vel)
        world_from_body = rotation_from_quaternion(np.array(truth.q))
        if shift_s != 0.0:
            p, q, r = (shift_s * rate for rate in truth.rates)
            world_from_body = world_from_body @ np.array([[1.0, -r, q], [r, 1.0, -p], [-q, p, 1.0]])
        world_from_cam: Array = world_from_body @ self._body_from_cam
        north, east, down = self._planes
        for plane, row in zip(self._planes, world_from_cam, strict=True):
            _combine(self._rays, row, plane)
        np.clip(down, HORIZON, 2.0, out=down)
        cv2.divide(north, down, dst=north)
        cv2.divide(east, down, dst=east)
        shifted = truth if shift_s == 0.0 else _shifted(truth, shift_s)
        return View(position + world_from_body @ self._position_body_m, world_from_cam, north, east, shifted)

    def box(self, view: View, rim_m: Array, place: Place) -> Box | None:
        """What of the image an outline (n, 2) forward, right may cover; None: nothing."""
        return self.boxes(view, (rim_m,), place)[0]

    def boxes(self, view: View, rims_m: Sequence[Array], place: Place) -> list[Box | None]:
        """What of the image each of some outlines (n, 2) forward, right in one place may cover; None: nothing."""
        if view.distance_m(place) < CLOSEST_M:
            return [None] * len(rims_m)
        rims = rims_m[0] if len(rims_m) == 1 else np.concatenate(rims_m)
        pixels = self.lens.project((place.world(rims) - view.position) @ view.world_from_cam)
        starts = [0, *accumulate(len(rim) for rim in rims_m[:-1])]
        lows, highs = np.minimum.reduceat(pixels, starts).tolist(), np.maximum.reduceat(pixels, starts).tolist()
        found: list[Box | None] = []
        for start, rim, low, high in zip(starts, rims_m, lows, highs, strict=True):
            if not math.isnan(low[0]):
                found.append(self._around(*low, *high))
            elif np.isnan(pixels[start : start + len(rim), 0]).all():
                found.append(None)
            else:
                # Part of the rim is out of the lens's sight: the pixels of the rest bound nothing.
                found.append((0, 0, self.lens.width, self.lens.height))
        return found

    def _around(self, left: float, top: float, right: float, bottom: float) -> Box | None:
        """What of the image lies about pixels within these."""
        # A side bends between its points by a distorted lens: two pixels more, and a share of the size.
        margin = 2.0 + 0.02 * max(right - left, bottom - top)
        u0, v0 = max(0, math.floor(left - margin)), max(0, math.floor(top - margin))
        u1 = min(self.lens.width, math.ceil(right + margin) + 1)
        v1 = min(self.lens.height, math.ceil(bottom + margin) + 1)
        return None if u1 <= u0 or v1 <= v0 else (u0, v0, u1, v1)

    def is_filled(self, view: View, rim_m: Array, place: Place) -> bool:
        """Whether the image's border lies inside the rectangle about a rim: nothing but what it bounds shows."""
        if view.distance_m(place) < CLOSEST_M:
            return False
        scale = view.on_plane(place)
        low, high = 0.98 * rim_m.min(axis=0), 0.98 * rim_m.max(axis=0)
        for part in (
            (slice(None, None, self.lens.height - 1), slice(None, None, 16)),
            (slice(None, None, 16), slice(None, None, self.lens.width - 1)),
        ):
            north, east = view.north[part], view.east[part]
            depth = scale[2][0] * north + scale[2][1] * east + scale[2][2]
            for row, least, most in zip(scale[:2], low, high, strict=True):
                along = (row[0] * north + row[1] * east + row[2]) / depth
                if along.min() < least or along.max() > most:
                    return False
        return True
