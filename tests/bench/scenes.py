"""What is in front of the camera: pose, ground, light, lens and sensor of one frame, and the truth about it.

Pad frame: forward, right, down; camera frame: right, down, into the scene. Drawing a scene at random is in sets.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from optics import Array, inside, lens
from prints import CORNERS_M, SIDE_M

CAM_FROM_PAD_DOWN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A camera that looks straight down, the top of its image forward."""
GRID = 41
"""Points per direction that the visible part of the marker is counted on."""


@dataclass(frozen=True)
class Shadow:
    """A shadow on the plane, in metres from the pad's middle.

    Attributes:
        kind: "edge" (a half plane), "band" (a pole's), "dapple" (leaves').
        turn: Direction of the edge's normal.
        place: Along it; for dapple the part of the light that is kept out (a level of noise of deviation 1).
        width: Of the band, or of the dapple's pattern.
        penumbra: Over which it goes from dark to light.
    """

    kind: str
    turn: float = 0.0
    place: float = 0.0
    width: float = 0.1
    penumbra: float = 0.01


@dataclass(frozen=True)
class Glare:
    """A mirrored light on the plane: centre right and back of the pad's middle, sizes in metres, strength in paper."""

    right: float
    back: float
    length: float
    width: float
    turn: float
    strength: float


@dataclass(frozen=True)
class Light:
    """Illumination.

    Attributes:
        name: For the table.
        sun: Part of the light that shadows take away; 1 - sun is what a full shadow keeps.
        slope: Of the logarithm of the light along right and back, per metre.
        shadows: On the plane.
        glares: On the plane.
        gloss: What a wet surface mirrors at its bright end.
        gloss_turn: Direction of that gradient.
        gloss_width: Metres over which it rises.
    """

    name: str
    sun: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)
    shadows: tuple[Shadow, ...] = ()
    glares: tuple[Glare, ...] = ()
    gloss: float = 0.0
    gloss_turn: float = 0.0
    gloss_width: float = 0.3


@dataclass(frozen=True)
class Scene:
    """One frame, before it is rendered. Lengths in metres, angles in radians.

    Attributes:
        seed: Of litter and the pattern of leaves' shadows.
        noise_seed: Of the noise.
        lens: "A" or "B".
        rotation: (3, 3) cam_from_pad.
        translation: (3,) the pad's middle in the camera frame.
        motion_px: How the pad's middle moves in the image during the exposure.
        shake: (3,) rotation of the camera during the exposure, rotation vector in the camera frame.
        ground: Of grounds.GROUNDS.
        ground_variant: Seed of its texture.
        ground_shift: Of the texture.
        ground_turn: Of the texture.
        albedo: Mean of the ground.
        litter_count: Things that lie about.
        litter_span: Side of the square they lie in.
        cover_seed: Of what lies on the print; None for nothing.
        cover_part: Limits of the part of the marker that it covers, where it lies unshifted.
        cover_shift: Of what lies on the print, right and back.
        light: Illumination.
        paper: Albedo.
        ink: Albedo.
        board_shadow: Where the board's own shadow falls, right and back.
        sky: Radiance beyond the horizon.
        blur_px: Deviation of the lens's point spread.
        veil: Part of the light that strays.
        vignette: What the corners lose.
        meter: 1: exposed for the mean; 0: for the paper.
        exposure: Error of the exposure, 1 for none.
        gamma: Grey level is light^(1/gamma).
        black_level: Grey level of no light.
        noise: Deviation at middle grey, in grey levels.
        noise_grain: Correlation of the noise, deviation in pixels.
        jpeg: Quality, or None.
    """

    seed: int
    noise_seed: int
    lens: str
    rotation: Array = field(repr=False)
    translation: Array = field(repr=False)
    light: Light
    ground: str = "asphalt"
    ground_variant: int = 0
    ground_shift: tuple[float, float] = (0.0, 0.0)
    ground_turn: float = 0.0
    albedo: float = 0.2
    motion_px: tuple[float, float] = (0.0, 0.0)
    shake: tuple[float, float, float] = (0.0, 0.0, 0.0)
    litter_count: int = 0
    litter_span: float = 3.0
    cover_seed: int | None = None
    cover_part: tuple[float, float] = (0.03, 0.25)
    cover_shift: tuple[float, float] = (0.0, 0.0)
    paper: float = 0.8
    ink: float = 0.05
    board_shadow: tuple[float, float] = (0.0, 0.0)
    sky: float = 0.6
    blur_px: float = 0.6
    veil: float = 0.01
    vignette: float = 0.2
    meter: float = 0.5
    exposure: float = 1.0
    gamma: float = 2.0
    black_level: float = 4.0
    noise: float = 2.0
    noise_grain: float = 0.3
    jpeg: int | None = None


@dataclass(frozen=True)
class Truth:
    """Where the marker is in one frame.

    Attributes:
        rotation: (3, 3) cam_from_pad.
        translation: (3,) metres.
        corners_px: (4, 2) outer black corners: front-left, front-right, back-right, back-left.
        side_px: Mean length of the outer sides in the image.
        visible: Part of the outer square's area that is in the image.
        height: Of the camera above the plane, in metres.
    """

    rotation: Array
    translation: Array
    corners_px: Array
    side_px: float
    visible: float
    height: float


def truth(lens_name: str, rotation: Array, translation: Array) -> Truth:
    """By projecting the marker's corners and a grid of points on it."""
    optics = lens(lens_name)
    corners = optics.project(_on_plane(CORNERS_M) @ rotation.T + translation)
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    places = (np.arange(GRID) + 0.5) / GRID * SIDE_M - SIDE_M / 2
    points = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    seen = inside(optics.project(_on_plane(points) @ rotation.T + translation))
    side = float(sides.mean()) if np.isfinite(sides).all() else optics.f * SIDE_M / float(np.linalg.norm(translation))
    height = float(rotation[:, 2] @ translation)
    return Truth(rotation, translation, corners, side, float(seen.mean()), height)


def _on_plane(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])


def attitude(tilt: float, towards: float, heading: float) -> Array:
    """(3, 3) cam_from_pad of a camera whose axis leans by `tilt` from straight down.

    Args:
        tilt: Angle between the camera's axis and the plane's normal.
        towards: Direction of the lean in the image.
        heading: Of the camera over the pad: the pad's forward axis turns the other way in the image.
    """
    lean = np.asarray(cv2.Rodrigues(tilt * np.array([math.cos(towards), math.sin(towards), 0.0]))[0])
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(lean @ CAM_FROM_PAD_DOWN @ turn)


def translation_at(lens_name: str, rotation: Array, px: Array, height: float) -> Array | None:
    """(3,) such that the pad's middle is seen at a pixel, from a height above the plane; None above the horizon."""
    ray = lens(lens_name).rays(np.asarray(px)[None, :])[0]
    down = float(rotation[:, 2] @ ray)
    return None if down < 0.05 else np.asarray(ray * height / down)


def shake_for(lens_name: str, translation: Array, motion_px: tuple[float, float], roll: float) -> Array:
    """(3,) rotation vector of the camera in an exposure that moves the pad's middle by motion_px in the image."""
    optics = lens(lens_name)
    wanted = np.array(motion_px)
    if not wanted.any():
        return np.array([0.0, 0.0, roll])
    turn = np.array([-wanted[1], wanted[0]]) / optics.f
    for _ in range(8):
        half = 0.5 * np.array([turn[0], turn[1], roll])
        ends = [np.asarray(cv2.Rodrigues(sign * half)[0]) @ translation for sign in (-1.0, 1.0)]
        got = optics.project(np.array(ends))
        missing = wanted - (got[1] - got[0])
        turn = turn + np.array([-missing[1], missing[0]]) / optics.f * 0.7
    return np.array([turn[0], turn[1], roll])
