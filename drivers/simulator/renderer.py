"""What the camera sees: ground, the pad, the van that carries it and the shadows, through the lens, for a short
exposure.

Written from geometry alone: each pixel's direction is turned into the world and cut with the horizontal planes of the
scene, nearest plane last. Light is linear; sensor.py makes grey levels of it. Nothing here knows the time: the same
truth and seed give the same frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from app.config import CameraConfig, LensConfig, WorldConfig
from app.frames import BODY_FROM_CAM_DOWN, rotation_from_euler, rotation_from_quaternion
from app.landmark import Landmark
from app.messages import Image
from drivers.simulator.decals import Decal, outline
from drivers.simulator.lens import Lens
from drivers.simulator.print import board_shadow, paint_layer, print_layers
from drivers.simulator.scene import drone_shadow, lane_mark
from drivers.simulator.sensor import Sensor
from drivers.simulator.textures import LAND_M, PATCH_M, SEAM_PX, TILE_M, TILE_PX, Plane, ground
from drivers.simulator.van import SIDE, Van, build_van
from drivers.simulator.world import Truth

Array = NDArray[np.float64]

CARRIER_FROM_M = 0.3
"""A pad this high stands on a van's roof; a lower one lies on the ground."""
HORIZON = 0.02
"""Cosine from the vertical at which the ground ends in haze."""
SKY = 0.45
BLUR_STEP_PX = 1.6
"""Motion in the exposure that takes another sub-exposure: less is lost in the lens's own blur."""
SUB_EXPOSURES_MAX = 4
COARSE = 4
"""Patches and haze are worked out on every fourth pixel."""
SAMPLES_MAX = 130_000
"""Supersampling of a decal stays under this many samples."""
PATCH_TURN_RAD = 0.58
LAND_TURN_RAD = -0.37
"""The ground's tiles lie in different directions."""


@dataclass(slots=True)
class _View:
    """The camera in one sub-exposure.

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


def _combine(planes: tuple[Plane, ...], weights: Array, out: Plane) -> None:
    """The weighted sum of three planes."""
    cv2.addWeighted(planes[0], float(weights[0]), planes[1], float(weights[1]), 0.0, dst=out)
    cv2.scaleAdd(planes[2], float(weights[2]), out, dst=out)


def _enlarge(plane: Plane, factor: int) -> Plane:
    """A plane at factor times the samples, pixel areas kept in place."""
    return np.asarray(cv2.resize(plane, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _sample(texture: Plane, u: MatLike, v: MatLike, factor: int) -> Plane:
    """The texture at (u, v), averaged over factor x factor samples a pixel; 0 outside of it."""
    drawn = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    if factor > 1:
        size = (drawn.shape[1] // factor, drawn.shape[0] // factor)
        drawn = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA)
    return np.asarray(drawn, dtype=np.float32)


class Renderer:
    """Draws frames.

    Args:
        world: Ground, sun, noise, exposure; its seed makes textures and noise.
        landmark: On the pad.
        lens: The lens.
        camera: How it is mounted on the vehicle.
    """

    def __init__(self, world: WorldConfig, landmark: Landmark, lens: LensConfig, camera: CameraConfig) -> None:
        self._lens = Lens(lens)
        rays = self._lens.rays()
        self._rays = tuple(np.ascontiguousarray(rays[..., k]) for k in range(3))
        self._angle = self._lens.pixel_angle(rays)
        self._sensor = Sensor(rays, world.noise_dn, world.seed)
        self._ground = ground(world.ground, 1 + world.seed % 4)
        self._exposure_s = world.exposure_ms / 1e3
        self._mount_m = np.array(camera.position_body_m, dtype=np.float64)
        self._body_from_cam = (
            rotation_from_euler(
                math.radians(camera.mount_roll_deg),
                math.radians(camera.mount_pitch_deg),
                math.radians(camera.mount_yaw_deg),
            )
            @ BODY_FROM_CAM_DOWN
        )
        reach = 1.0 / math.tan(math.radians(world.sun_elevation_deg))
        azimuth = math.radians(world.sun_azimuth_deg)
        self._sun = (reach * math.cos(azimuth), reach * math.sin(azimuth))
        turn = azimuth - math.radians(world.motion.heading_deg)
        sun_on_pad = (reach * math.cos(turn), reach * math.sin(turn))
        self._layers = print_layers(landmark)
        self._board_shadow = board_shadow(landmark, *sun_on_pad)
        motion = world.motion
        self._van: Van | None = None
        if motion.height_m >= CARRIER_FROM_M:
            self._van = build_van(motion.height_m, motion.deck_m, sun_on_pad, world.seed % 4)
        self._lane = lane_mark() if world.ground == "asphalt" else None
        self._lane_origin = (motion.north_m, motion.east_m, math.radians(motion.heading_deg))
        self._drone = drone_shadow()
        height, width = self._lens.height, self._lens.width
        self._planes = tuple(np.empty((height, width), dtype=np.float32) for _ in range(7))

    # ---------------------------------------------------------------------------------------------------- one frame
    def render(self, truth: Truth) -> Image:
        """(height, width) uint8 grey, exposed about the instant of the truth."""
        count = self._sub_exposures(truth)
        if count == 1:
            light = self._draw(self._view(truth, 0.0))
        else:
            light = np.zeros_like(self._planes[0])
            for k in range(count):
                shift_s = ((k + 0.5) / count - 0.5) * self._exposure_s
                cv2.accumulate(self._draw(self._view(truth, shift_s)), light)
            light *= np.float32(1.0 / count)
        return self._sensor.develop(light)

    def _sub_exposures(self, truth: Truth) -> int:
        """How many instants the exposure is made of, by how far the image moves in it."""
        p, q, r = truth.rates
        height = max(0.1, -truth.pos[2])
        pad = truth.pad
        over_ground = math.hypot(truth.vel[0], truth.vel[1]) / height
        over_pad = math.hypot(truth.vel[0] - pad.vel_north_m_s, truth.vel[1] - pad.vel_east_m_s)
        over_pad /= max(0.1, pad.down_m - truth.pos[2])
        speed = math.hypot(p, q) + 0.5 * abs(r) + max(over_ground, over_pad)
        moved_px = speed * self._lens.focal_px * self._exposure_s
        return max(1, min(SUB_EXPOSURES_MAX, math.ceil(moved_px / BLUR_STEP_PX)))

    def _view(self, truth: Truth, shift_s: float) -> _View:
        """The camera a little before or after the instant of the truth."""
        rotation = rotation_from_quaternion(np.array(truth.q))
        position = np.array(truth.pos) + shift_s * np.array(truth.vel)
        p, q, r = (shift_s * rate for rate in truth.rates)
        turned: Array = rotation @ np.array([[1.0, -r, q], [r, 1.0, -p], [-q, p, 1.0]])
        world_from_cam: Array = turned @ self._body_from_cam
        north, east, down = self._planes[:3]
        for plane, row in zip((north, east, down), world_from_cam, strict=True):
            _combine(self._rays, row, plane)
        np.maximum(down, np.float32(HORIZON), out=down)
        cv2.divide(north, down, dst=north)
        cv2.divide(east, down, dst=east)
        pad = truth.pad
        moved = (pad.north_m + shift_s * pad.vel_north_m_s, pad.east_m + shift_s * pad.vel_east_m_s)
        shifted = Truth(
            truth.t_s + shift_s,
            (float(position[0]), float(position[1]), float(position[2])),
            truth.vel,
            truth.q,
            truth.rates,
            type(pad)(*moved, pad.down_m, pad.vel_north_m_s, pad.vel_east_m_s, pad.heading_rad, pad.deck_half_m),
        )
        return _View(position + turned @ self._mount_m, world_from_cam, north, east, shifted)

    def _draw(self, view: _View) -> Plane:
        """Light of one instant, (height, width)."""
        pad = view.truth.pad
        place = (pad.north_m, pad.east_m, pad.heading_rad)
        zone = self._layers[0].rim_m
        if self._fills_view(view, zone, -pad.down_m):
            light = self._planes[3]
            light.fill(0.0)
        elif self._van is not None and self._fills_view(view, self._van.panels[-1].picture.rim_m * 0.9, -pad.down_m):
            light = self._planes[3]
            light.fill(0.0)
            self._lay(light, view, self._van.panels[-1].picture, place, -pad.down_m)
        else:
            light = self._draw_surroundings(view)
        self._lay(light, view, self._board_shadow, place, -pad.down_m)
        self._draw_landmark(light, view)
        self._draw_drone_shadow(light, view, -pad.down_m)
        return light

    def _draw_surroundings(self, view: _View) -> Plane:
        """All but the board: ground and sky, the lane's line, the van and what it shades."""
        pad = view.truth.pad
        place = (pad.north_m, pad.east_m, pad.heading_rad)
        light = self._draw_ground(view)
        if self._lane is not None:
            self._draw_lane(light, view, self._lane)
        if self._van is not None:
            shadow = self._van.shadow
            self._lay(light, view, shadow.picture, place, shadow.height_m)
            self._draw_drone_shadow(light, view, 0.0)
            self._draw_sides(light, view, self._van)
            for panel in self._van.panels:
                self._lay(light, view, panel.picture, place, panel.height_m)
        return light

    def _fills_view(self, view: _View, rim_m: Array, height_m: float) -> bool:
        """Whether the picture's border lies inside a convex rim (forward, right) about the pad: nothing else shows."""
        above = -height_m - float(view.position[2])
        if above < 0.02:
            return False
        pad = view.truth.pad
        c, s = math.cos(pad.heading_rad), math.sin(pad.heading_rad)
        forward0, right0 = pad.offset_m(float(view.position[0]), float(view.position[1]))
        border = (slice(None, None, self._lens.height - 1), slice(None, None, 16))
        side = (slice(None, None, 16), slice(None, None, self._lens.width - 1))
        low, high = 0.98 * rim_m.min(axis=0), 0.98 * rim_m.max(axis=0)
        for part in (border, side):
            north, east = above * view.north[part], above * view.east[part]
            forward, right = forward0 + c * north + s * east, right0 - s * north + c * east
            if forward.min() < low[0] or forward.max() > high[0] or right.min() < low[1] or right.max() > high[1]:
                return False
        return True

    # -------------------------------------------------------------------------------------------------- the ground
    def _draw_ground(self, view: _View) -> Plane:
        """The ground to the horizon, and the sky above it."""
        textures = self._ground
        height = max(0.02, -float(view.position[2]))
        texel = height / self._lens.focal_px
        level = 2.0 * math.log2(max(texel, 1e-6) / (TILE_M / TILE_PX))
        fine = textures.fine[max(0, min(len(textures.fine) - 1, round(level)))]
        light, u, v = self._planes[3:6]
        self._uv((view.north, view.east), (u, v), view.position, height, (TILE_M, fine.shape[0] - SEAM_PX, 0.0))
        cv2.remap(fine, u, v, cv2.INTER_LINEAR, dst=light, borderMode=cv2.BORDER_REPLICATE)
        coarse = tuple(
            np.ascontiguousarray(plane[COARSE // 2 :: COARSE, COARSE // 2 :: COARSE])
            for plane in (view.north, view.east)
        )
        broad = np.full(coarse[0].shape, textures.reflectance, dtype=np.float32)
        at = (np.empty_like(broad), np.empty_like(broad))
        for tile, size_m, turn in ((textures.patches, PATCH_M, PATCH_TURN_RAD), (textures.land, LAND_M, LAND_TURN_RAD)):
            self._uv(coarse, at, view.position, height, (size_m, tile.shape[0] - SEAM_PX, turn))
            drawn = cv2.remap(tile, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            broad *= np.asarray(drawn, dtype=np.float32)
        # Where a pixel covers several texels the detail has to fade into its mean: the far ground under a slant.
        stretch = 1.0 + coarse[0] ** 2 + coarse[1] ** 2
        detail = np.clip(2.6 / stretch, 0.0, 1.0).astype(np.float32)
        haze = np.clip((stretch - 600.0) / 1400.0, 0.0, 1.0).astype(np.float32)
        gain = broad * detail * (1.0 - haze)
        lift = broad * (1.0 - detail) * (1.0 - haze) + SKY * haze
        size = (self._lens.width, self._lens.height)
        cv2.multiply(light, cv2.resize(gain, size, interpolation=cv2.INTER_LINEAR), dst=light)
        if float(lift.max()) > 0.0:
            cv2.add(light, cv2.resize(lift, size, interpolation=cv2.INTER_LINEAR), dst=light)
        return light

    @staticmethod
    def _uv(
        slopes: tuple[Plane, ...],
        out: tuple[Plane, Plane],
        position: Array,
        height: float,
        tile: tuple[float, int, float],
    ) -> None:
        """Texture coordinates of a square tile (size in m and px, turn) under directions."""
        size_m, size_px, turn = tile
        c, s = math.cos(turn), math.sin(turn)
        north, east = float(position[0]), float(position[1])
        scale = size_px / size_m
        k = height * scale
        # Whole tiles are taken off: 32 bits don't hold a long way at a small texel.
        u0 = ((c * north + s * east) * scale) % size_px - 0.5
        v0 = ((-s * north + c * east) * scale) % size_px - 0.5
        for plane, a, b, shift in ((out[0], c * k, s * k, u0), (out[1], -s * k, c * k, v0)):
            # Folded into the tile here: OpenCV's own wrapping takes a slow path for every pixel outside.
            cv2.addWeighted(slopes[0], a / size_px, slopes[1], b / size_px, shift / size_px, dst=plane)
            plane -= np.floor(plane)
            plane *= np.float32(size_px)

    # --------------------------------------------------------------------------------------------------- the decals
    def _lay(
        self, light: Plane, view: _View, picture: Decal, place: tuple[float, float, float], height_m: float
    ) -> None:
        """Lay a decal over the light; place: north, east and heading of its frame."""
        north, east, heading = place
        above = -height_m - float(view.position[2])
        if above < 0.02:
            return
        c, s = math.cos(heading), math.sin(heading)
        rim = picture.rim_m @ np.array([[c, s], [-s, c]]) + (north, east)
        box = self._box(view, rim, -height_m)
        if box is None:
            return
        u0, v0, u1, v1 = box
        factor = max(1, min(4, math.isqrt(SAMPLES_MAX // ((u1 - u0) * (v1 - v0)))))
        # Decal coordinates of a pixel are affine in its slopes: scale by the height, move, turn, to texels.
        wanted = above / self._lens.focal_px / factor
        finest = math.floor(math.log2(max(wanted / picture.texel_m, 1e-6)) + 0.35)
        level = max(0, min(len(picture.alphas) - 1, finest))
        texel = picture.texel_m * 2**level
        dn, de = float(view.position[0]) - north, float(view.position[1]) - east
        u_shift = (-s * dn + c * de - picture.left_m) / texel - 0.5
        v_shift = (picture.front_m - c * dn - s * de) / texel - 0.5
        k = above / texel
        slopes = [plane[v0:v1, u0:u1] for plane in (view.north, view.east)]
        if factor > 1:
            slopes = [_enlarge(plane, factor) for plane in slopes]
        u = cv2.addWeighted(slopes[0], -s * k, slopes[1], c * k, u_shift)
        v = cv2.addWeighted(slopes[0], -c * k, slopes[1], -s * k, v_shift)
        under = light[v0:v1, u0:u1]
        alpha = _sample(picture.alphas[level], u, v, factor)
        under *= np.float32(1.0) - alpha
        if picture.values:
            under += _sample(picture.values[level], u, v, factor)

    def _draw_landmark(self, light: Plane, view: _View) -> None:
        """The board and the contours on it."""
        pad = view.truth.pad
        above = pad.down_m - float(view.position[2])
        if above < 0.02:
            return
        c, s = math.cos(pad.heading_rad), math.sin(pad.heading_rad)
        forward, right = pad.offset_m(float(view.position[0]), float(view.position[1]))
        scale = np.array([[above * c, above * s, forward], [-above * s, above * c, right]])
        whole: tuple[int, int] | None = None
        per_pixel = np.empty((0, 0), dtype=np.float32)
        for layer in self._layers:
            rim = layer.rim_m @ np.array([[c, s], [-s, c]]) + (pad.north_m, pad.east_m)
            box = self._box(view, rim, pad.down_m)
            if box is None:
                return  # the contours inside are out of sight too
            u0, v0, u1, v1 = box
            north, east = view.north[v0:v1, u0:u1], view.east[v0:v1, u0:u1]
            if whole is None:
                whole = (u0, v0)
                per_pixel = self._per_pixel(north, east, self._angle[v0:v1, u0:u1], above)
            du, dv = max(0, u0 - whole[0]), max(0, v0 - whole[1])
            piece = per_pixel[dv : dv + v1 - v0, du : du + u1 - u0]
            paint_layer(light[v0:v1, u0:u1], layer, (north, east), scale, piece)

    @staticmethod
    def _per_pixel(north: Plane, east: Plane, angle: Plane, above: float) -> Plane:
        """One over what a pixel measures on a plane: its angle's side grows by (1 + slope^2)^(3/4) under a slant."""
        stretch = cv2.multiply(north, north)
        cv2.add(stretch, cv2.multiply(east, east), dst=stretch)
        np.add(stretch, np.float32(1.0), out=stretch)
        cv2.sqrt(stretch, dst=stretch)
        root = cv2.sqrt(stretch)
        cv2.multiply(stretch, root, dst=stretch)
        cv2.multiply(stretch, angle, dst=stretch)
        return np.asarray(cv2.divide(1.0 / above, stretch), dtype=np.float32)

    def _box(self, view: _View, rim: Array, down: float) -> tuple[int, int, int, int] | None:
        """(u0, v0, u1, v1), half open, that an outline (n, 2) at a depth may cover in the image; None: nothing."""
        points = np.empty((len(rim), 3))
        points[:, :2], points[:, 2] = rim, down
        pixels = self._lens.project((points - view.position) @ view.world_from_cam)
        width, height = self._lens.width, self._lens.height
        seen = ~np.isnan(pixels[:, 0])
        if not seen.any():
            return None
        low, high = np.nanmin(pixels, axis=0), np.nanmax(pixels, axis=0)
        if not seen.all():
            # Part of the rim is out of the lens's sight: the pixels of the rest bound nothing.
            low, high = np.zeros(2), np.array([width, height], dtype=np.float64)
        # A side bends between its points by a distorted lens: two pixels more, and a share of the size.
        margin = 2.0 + 0.02 * float((high - low).max())
        u0, v0 = max(0, math.floor(low[0] - margin)), max(0, math.floor(low[1] - margin))
        u1, v1 = min(width, math.ceil(high[0] + margin) + 1), min(height, math.ceil(high[1] + margin) + 1)
        return None if u1 <= u0 or v1 <= v0 else (u0, v0, u1, v1)

    def _draw_sides(self, light: Plane, view: _View, van: Van) -> None:
        """Fill the van's sides: the hull of its outline on the road and under the roof, as the camera sees them."""
        pad = view.truth.pad
        top = van.body_height_m * 0.98
        if -float(view.position[2]) < top + 0.1:
            return
        c, s = math.cos(pad.heading_rad), math.sin(pad.heading_rad)
        body = van.body @ np.array([[c, s], [-s, c]]) + (pad.north_m, pad.east_m) - view.position[:2]
        # In the plane of slopes straight lines stay straight, so the hull is taken there. The bonnet is lower.
        flat = [body / (-level - float(view.position[2])) for level in (0.12, 0.55 * top, top)]
        flat[2] = flat[2][2:]
        hull = cv2.convexHull(np.vstack(flat).astype(np.float32))[:, 0, :].astype(np.float64)
        edges = outline(hull)
        pixels = self._lens.project(np.column_stack([edges, np.ones(len(edges))]) @ view.world_from_cam)
        if np.isnan(pixels).any():
            return
        mask = np.zeros(light.shape, dtype=np.uint8)
        cv2.fillPoly(mask, [np.round(pixels * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
        u0, v0 = (max(0, math.floor(x) - 2) for x in pixels.min(axis=0))
        u1, v1 = (math.ceil(x) + 3 for x in pixels.max(axis=0))
        if u1 <= u0 or v1 <= v0:
            return
        alpha = mask[v0:v1, u0:u1].astype(np.float32) / np.float32(255.0)
        under = light[v0:v1, u0:u1]
        under += alpha * (np.float32(SIDE) - under)

    def _draw_drone_shadow(self, light: Plane, view: _View, height_m: float) -> None:
        """The vehicle's own shadow on a plane: where the sun, the vehicle and the plane line up."""
        north, east, down = view.truth.pos
        above = -height_m - down
        if above < 0.05:
            return
        w, x, y, z = view.truth.q
        yaw = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        at = (north - self._sun[0] * above, east - self._sun[1] * above)
        if height_m > 0.0:
            forward, right = view.truth.pad.offset_m(*at)
            if max(abs(forward) / 2.0, abs(right)) > 1.0:
                return  # it falls past the roof
        sharp, soft = self._drone
        self._lay(light, view, sharp if above < 1.5 else soft, (at[0], at[1], yaw), height_m)

    def _draw_lane(self, light: Plane, view: _View, mark: Decal) -> None:
        """Dashes of the lane's line near the camera, to the left of the way that the pad drives."""
        north, east, heading = self._lane_origin
        c, s = math.cos(heading), math.sin(heading)
        along = c * (float(view.position[0]) - north) + s * (float(view.position[1]) - east)
        reach = 3.0 * max(1.0, -float(view.position[2]))
        for k in range(math.ceil((along - reach) / 9.0), math.floor((along + reach) / 9.0) + 1):
            x, y = 9.0 * k, -2.2
            self._lay(light, view, mark, (north + c * x - s * y, east + s * x + c * y, heading), 0.0)
