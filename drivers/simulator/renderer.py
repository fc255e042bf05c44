"""What the camera sees: ground, the pad, the van that carries it and the shadows, through the lens, for a short
exposure.

Written from geometry alone: each pixel's direction is turned into the world and cut with the horizontal planes of the
scene, nearest plane last. Light is linear; sensor.py makes grey levels of it. Nothing here knows the time but by the
truth that it is given: the same truths and seed give the same frames.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from app.config import CameraConfig, LensConfig, WorldConfig
from app.landmark import Landmark
from app.messages import Image
from drivers.simulator.boat import SIDE as BOAT_SIDE
from drivers.simulator.boat import Boat, build_boat
from drivers.simulator.daylight import glare_of, level_at, shadow_edge
from drivers.simulator.decals import Decal
from drivers.simulator.landscape import Landscape
from drivers.simulator.occluder import Occluder
from drivers.simulator.painting import fill_hull, lay, lay_print
from drivers.simulator.print import board_shadow, print_layers
from drivers.simulator.prints_beside import decoy_layers, decoy_place
from drivers.simulator.scene import LANE_OFFSET_M, LANE_PERIOD_M, drone_shadow, lane_mark
from drivers.simulator.sensor import Sensor
from drivers.simulator.shutter import Exposure, Shot
from drivers.simulator.textures import Plane
from drivers.simulator.van import SIDE, Van, build_van
from drivers.simulator.view import Camera, Place, View
from drivers.simulator.world import Truth

CARRIER_FROM_M = 0.3
"""A pad this high stands on a van's roof; a lower one lies on the ground."""
BLUR_STEP_PX = 1.0
"""Motion in the exposure that takes another sub-exposure: less is lost in the lens's own blur."""
SUB_EXPOSURES_MAX = 4
TEXTURE_SEEDS = 4
"""There are so many different lawns and roads: they are costly to make."""
SUN_STEP_RAD = math.radians(10.0)
"""On a bend the shadows that go with the pad are made anew after so much of a turn."""
SHADOW_SHARP_M = 1.5
"""The vehicle's shadow is sharp on what is this near under it."""


class Renderer:
    """Draws frames.

    Args:
        world: Ground, sun, noise, exposure; its seed makes textures and noise.
        landmark: On the pad.
        lens: The lens.
        camera: How it is mounted on the vehicle.
    """

    def __init__(self, world: WorldConfig, landmark: Landmark, lens: LensConfig, camera: CameraConfig) -> None:
        motion = world.motion
        texture_seed = world.seed % TEXTURE_SEEDS
        self._camera = Camera(lens, camera)
        self._sensor = Sensor(self._camera.rays, world.noise_dn, world.seed, world.exposure_ms / 1e3)
        self._landscape = Landscape(world.ground, texture_seed, self._camera)
        reach = 1.0 / math.tan(math.radians(world.sun_elevation_deg))
        azimuth = math.radians(world.sun_azimuth_deg)
        self._sun = (reach * math.cos(azimuth), reach * math.sin(azimuth))
        self._light = world.light
        self._glare = glare_of(world.light, self._sun)
        self._first_s: float | None = None
        self._azimuth, self._reach = azimuth, reach
        self._landmark, self._motion, self._texture_seed = landmark, motion, texture_seed
        self._layers = print_layers(landmark)
        start = Place(motion.north_m, motion.east_m, math.radians(motion.heading_deg), 0.0)
        self._decoys = tuple((decoy_layers(d, landmark), decoy_place(d, start)) for d in world.decoys)
        self._has_van = motion.height_m >= CARRIER_FROM_M and motion.carrier == "van"
        self._boat: Boat | None = None
        if motion.height_m >= CARRIER_FROM_M and motion.carrier == "boat":
            self._boat = build_boat(motion.deck_m, texture_seed)
        shadow = world.light.shadow
        self._edge = shadow_edge(shadow, motion) if shadow is not None else None
        size = (lens.height_px, lens.width_px)
        self._occluder = Occluder(world.occlusion, size) if world.occlusion is not None else None
        self._lane = lane_mark() if world.ground == "asphalt" else None
        self._lane_place = start
        self._drone = drone_shadow()

    # ---------------------------------------------------------------------------------------------------- one frame
    def render(self, truth: Truth) -> Image:
        """(height, width) uint8 grey, exposed about the instant of the truth, by the sensor's own exposure."""
        return self.shoot(truth).image

    def shoot(self, truth: Truth, told: Exposure | None = None) -> Shot:
        """A frame exposed about the instant of the truth as the camera is told; None: by itself."""
        if self._first_s is None:
            self._first_s = truth.t_s
        level = level_at(self._light, truth.t_s - self._first_s)
        exposure_s = self._sensor.exposure_s(told)
        if self._occluder is not None and self._occluder.hides(truth):
            return self._sensor.develop(self._occluder.light(), level, told)
        count = self._sub_exposures(truth, exposure_s)
        if count == 1:
            return self._sensor.develop(self._draw(self._camera.look(truth)), level, told)
        light = np.zeros((self._camera.lens.height, self._camera.lens.width), dtype=np.float32)
        for k in range(count):
            shift_s = ((k + 0.5) / count - 0.5) * exposure_s
            cv2.accumulate(self._draw(self._camera.look(truth, shift_s)), light)
        light *= np.float32(1.0 / count)
        return self._sensor.develop(light, level, told)

    def _sub_exposures(self, truth: Truth, exposure_s: float) -> int:
        """How many instants the exposure is made of, by how far the image moves in it."""
        p, q, r = truth.rates
        pad = truth.pad
        over_ground = math.hypot(truth.vel[0], truth.vel[1]) / max(0.1, -truth.pos[2])
        over_pad = math.hypot(truth.vel[0] - pad.vel_north_m_s, truth.vel[1] - pad.vel_east_m_s)
        over_pad /= max(0.1, pad.down_m - truth.pos[2])
        speed = math.hypot(p, q) + 0.5 * abs(r) + max(over_ground, over_pad)
        moved_px = speed * self._camera.lens.focal_px * exposure_s
        return max(1, min(SUB_EXPOSURES_MAX, math.ceil(moved_px / BLUR_STEP_PX)))

    def _sun_on_pad(self, view: View) -> tuple[float, float]:
        """Horizontal way to the sun over its height, along the pad's forward and right; in steps of SUN_STEP_RAD."""
        turn = round((self._azimuth - view.truth.pad.heading_rad) / SUN_STEP_RAD) * SUN_STEP_RAD
        if self._motion.bend_radius_m == 0.0:
            turn = self._azimuth - math.radians(self._motion.heading_deg)
        return self._reach * math.cos(turn), self._reach * math.sin(turn)

    def _draw(self, view: View) -> Plane:
        """Light of one instant, (height, width). What is covered whole by something nearer is left out."""
        camera, place, sun = self._camera, view.pad_place, self._sun_on_pad(view)
        van = build_van(self._motion.height_m, self._motion.deck_m, sun, self._texture_seed) if self._has_van else None
        deck = van.panels[-1].picture if van is not None else self._boat.deck if self._boat is not None else None
        if camera.is_filled(view, self._layers[0].rim_m, place):
            light = np.zeros_like(view.north)
        else:
            if deck is not None and self._boat is None and camera.is_filled(view, 0.9 * deck.rim_m, place):
                light = np.zeros_like(view.north)
                lay(light, camera, view, deck, place)
            else:
                light = self._draw_surroundings(view, van)
            lay(light, camera, view, board_shadow(self._landmark, *sun), place)
        lay_print(light, camera, view, self._layers, place)
        self._draw_drone_shadow(light, view, place.height_m)
        if self._edge is not None:
            self._edge.dim(light, view)
        if self._glare is not None:
            self._glare.add(light, view.north, view.east)
        return light

    def _draw_surroundings(self, view: View, van: Van | None) -> Plane:
        """All but the board: ground and sky, the lane's line, decoys, the van or boat and what it shades."""
        light = self._landscape.draw(view)
        if self._lane is not None:
            self._draw_lane(light, view, self._lane)
        for layers, at in self._decoys:
            lay_print(light, self._camera, view, layers, at)
        if van is not None:
            self._draw_van(light, view, van)
        if self._boat is not None:
            self._draw_boat(light, view, self._boat)
        return light

    def _draw_boat(self, light: Plane, view: View, boat: Boat) -> None:
        """Its sides, from the deck's rim to the water, then its deck."""
        high = view.pad_place.world(boat.outline)
        low = high * (1.0, 1.0, 0.0)
        if view.height_m > -float(high[:, 2].min()) + 0.1:
            ends = np.vstack([high, low]) - view.position
            fill_hull(light, self._camera, view, ends[:, :2] / ends[:, 2:], BOAT_SIDE)
        lay(light, self._camera, view, boat.deck, view.pad_place)

    def _draw_lane(self, light: Plane, view: View, mark: Decal) -> None:
        """Dashes of the lane's line near the camera, to the left of the way that the pad drives."""
        lane = self._lane_place
        along = float(view.on_plane(lane)[0, 2])
        reach = 3.0 * max(1.0, view.height_m)
        for k in range(math.ceil((along - reach) / LANE_PERIOD_M), math.floor((along + reach) / LANE_PERIOD_M) + 1):
            north, east, _ = lane.world(np.array([[LANE_PERIOD_M * k, LANE_OFFSET_M]]))[0]
            lay(light, self._camera, view, mark, Place(float(north), float(east), lane.heading_rad, 0.0))

    def _draw_van(self, light: Plane, view: View, van: Van) -> None:
        """Its shadow and the vehicle's on the road, its sides, its panels from low to high."""
        place = view.pad_place

        def at(height_m: float) -> Place:
            return Place(place.north_m, place.east_m, place.heading_rad, height_m)

        lay(light, self._camera, view, van.shadow.picture, at(van.shadow.height_m))
        self._draw_drone_shadow(light, view, 0.0)
        top = 0.98 * van.body_height_m
        if view.height_m > top + 0.1:
            # The sides are the hull of the body's outline on the road, at the bonnet's height, and under the roof.
            body = place.world(van.body)[:, :2] - view.position[:2]
            low, middle, high = (body / (view.height_m - level) for level in (0.12, 0.55 * top, top))
            fill_hull(light, self._camera, view, np.vstack([low, middle, high[2:]]), SIDE)
        for panel in van.panels:
            lay(light, self._camera, view, panel.picture, at(panel.height_m))

    def _draw_drone_shadow(self, light: Plane, view: View, height_m: float) -> None:
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
        picture = sharp if above < SHADOW_SHARP_M else soft
        lay(light, self._camera, view, picture, Place(at[0], at[1], yaw, height_m))
