"""From a scene to frames: rays, plane, albedo, light, exposure, lens, sensor.

All four markers are rendered of one scene: same pose, ground, light, things that lie about, and noise. Light is linear
until the sensor. A frame is the mean of sub-exposures along the camera's motion; the truth is the pose at mid-exposure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from covers import cover
from grounds import ground, litter, noise
from optics import HEIGHT, WIDTH, Array, Optics, lens
from prints import SPAN_M, marker_texture
from scenes import Light, Scene
from texture import Texture

SUB_STEP_PX = 1.0
"""Motion between sub-exposures: less than the pixel's own box blurs."""
SKY = 0.03
"""Down component of a ray under which it looks at the sky."""


def _rotation(turn: Array) -> Array:
    """(3, 3) rotation by a vector (3,), radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, np.float64))[0])


def poses_in_exposure(scene: Scene) -> list[tuple[Array, Array]]:
    """cam_from_pad (rotation, translation) of each sub-exposure, evenly over the exposure."""
    travel = float(np.hypot(*scene.motion_px))
    count = max(1, math.ceil(travel / SUB_STEP_PX))
    rotation, translation = np.asarray(scene.rotation), np.asarray(scene.translation)
    poses = []
    for k in range(count):
        part = (k + 0.5) / count - 0.5
        turn = _rotation(np.asarray(scene.shake) * part)
        poses.append((turn @ rotation, turn @ translation))
    return poses


class View:
    """The plane as one pose of the camera sees it.

    Attributes:
        x: (HEIGHT + 2, WIDTH + 2) float32 metres to the pad's right.
        y: The same to the pad's back.
        footprint: Size of a pixel on the plane, in metres.
        sky: (HEIGHT + 2, WIDTH + 2) where no ground is seen.
    """

    def __init__(self, optics: Optics, rotation: Array, translation: Array) -> None:
        pad_from_cam = rotation.T
        eye = -pad_from_cam @ translation
        d = optics.grid @ pad_from_cam.T.astype(np.float32)
        self.sky = d[..., 2] < SKY
        down = np.maximum(d[..., 2], np.float32(SKY))
        reach = np.float32(-eye[2]) / down
        self.x = np.float32(eye[1]) + reach * d[..., 1]
        self.y = -(np.float32(eye[0]) + reach * d[..., 0])
        # Across the line of sight a pixel spans reach / px_per_rad; along it 1 / down more. Between the two, nearer the
        # longer.
        self.footprint = reach / optics.px_per_rad * down ** np.float32(-0.8)


def _inner(field: Array) -> Array:
    return field[1:-1, 1:-1]


def _print_box(view: View, reach_m: float) -> tuple[int, int, int, int] | None:
    """(top, bottom, left, right) of the pixels that can show the board, half open; None if none."""
    near = _inner((np.abs(view.x) < reach_m) & (np.abs(view.y) < reach_m) & ~view.sky)
    rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    if not len(rows):
        return None
    return (
        max(0, int(rows[0]) - 2),
        min(HEIGHT, int(rows[-1]) + 3),
        max(0, int(columns[0]) - 2),
        min(WIDTH, int(columns[-1]) + 3),
    )


def _subsamples(box: tuple[int, int, int, int]) -> int:
    """Per pixel and direction: many for a small print, whose whole area counts; two fill the pixel for a large one,
    since each lookup is itself a mean."""
    area = (box[1] - box[0]) * (box[3] - box[2])
    return 4 if area < 12000 else 3 if area < 50000 else 2


def _finer(field: Array, box: tuple[int, int, int, int], times: int) -> Array:
    """A smooth field at `times` points per pixel and direction, by linear interpolation between pixel centres."""
    top, bottom, left, right = box
    framed = field[top : bottom + 2, left : right + 2]
    fine = cv2.resize(framed, None, fx=times, fy=times, interpolation=cv2.INTER_LINEAR)
    return fine[times:-times, times:-times]


def _print_coverages(view: View, markers: Sequence[Texture], box: tuple[int, int, int, int]) -> list[Array]:
    """(rows, columns, 2) float32 paper and ink in each pixel of the box, for each marker."""
    times = _subsamples(box)
    x, y = _finer(view.x, box, times), _finer(view.y, box, times)
    address = markers[0].address(x, y, _finer(view.footprint, box, times) / np.float32(times))
    rows, columns = box[1] - box[0], box[3] - box[2]
    coverages = []
    for marker in markers:
        fine = cv2.resize(marker.at(address), (columns, rows), interpolation=cv2.INTER_AREA)
        coverages.append(fine.reshape(rows, columns, 2) * np.float32(1 / 255))
    return coverages


def _step(distance: Array, width: Array) -> Array:
    """0 to 1 over `width`, smooth, round distance 0."""
    t = np.clip(distance / width + np.float32(0.5), 0, 1)
    return t * t * (3 - 2 * t)


def _sunlit(light: Light, view: View, cloud: Texture | None) -> Array:
    """(HEIGHT, WIDTH) part of the sun that reaches the ground: shadows with their penumbra."""
    x, y, footprint = _inner(view.x), _inner(view.y), _inner(view.footprint)
    lit: Array = np.ones((HEIGHT, WIDTH), np.float32)
    for shadow in light.shadows:
        width = np.maximum(np.float32(shadow.penumbra), footprint)
        if shadow.kind == "dapple":
            assert cloud is not None
            field = cloud.sample(x / np.float32(shadow.width), y / np.float32(shadow.width), footprint)
            lit *= _step((field - np.float32(shadow.place)) * np.float32(shadow.width), width * 8)
            continue
        c, s = np.float32(math.cos(shadow.turn)), np.float32(math.sin(shadow.turn))
        across = c * x + s * y - np.float32(shadow.place)
        if shadow.kind == "edge":
            lit *= _step(across, width)
        else:
            lit *= 1 - _step(np.float32(shadow.width / 2) - np.abs(across), width)
    return lit


def _shine(light: Light, view: View) -> Array | None:
    """(HEIGHT, WIDTH) light that the surface mirrors, whatever is printed there."""
    if not light.glares and light.gloss == 0.0:
        return None
    x, y = _inner(view.x), _inner(view.y)
    shine: Array = np.zeros((HEIGHT, WIDTH), np.float32)
    for glare in light.glares:
        dx, dy = x - np.float32(glare.right), y - np.float32(glare.back)
        c, s = math.cos(glare.turn), math.sin(glare.turn)
        a, b = (c * dx + s * dy) / glare.length, (c * dy - s * dx) / glare.width
        r2 = a * a + b * b
        shine += np.float32(glare.strength) * (np.exp(-0.5 * r2) + np.float32(0.15) / (1 + r2)).astype(np.float32)
    if light.gloss > 0.0:
        along = x * np.float32(math.cos(light.gloss_turn)) + y * np.float32(math.sin(light.gloss_turn))
        shine += np.float32(light.gloss) * _step(along, np.full_like(along, np.float32(light.gloss_width)))
    return shine


@lru_cache(maxsize=4)
def _leaves(seed: int) -> Texture:
    """What leaves' shadows are cut from: a level of noise of deviation 1, waves of a third of a metre and less."""
    return Texture(noise(np.random.default_rng(seed), 1024, 1.6, 0.06), 5.0, wraps=True)


class _Plane:
    """What of a scene does not depend on the pose."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.ground = ground(scene.ground, scene.ground_variant)
        self.litter = (
            litter(scene.seed + 1, scene.litter_span, 0.36, scene.litter_count) if scene.litter_count else None
        )
        self.cover = cover(scene.cover_seed, *scene.cover_part)[0] if scene.cover_seed is not None else None
        self.cloud: Texture | None = None
        if any(s.kind == "dapple" for s in scene.light.shadows):
            self.cloud = _leaves(scene.seed + 2)

    def radiance(self, view: View, markers: Sequence[str]) -> tuple[list[Array], Array]:
        """(HEIGHT, WIDTH) float32 linear light towards the camera, with each marker and with no board at all."""
        scene, light = self.scene, self.scene.light
        x, y, footprint = _inner(view.x), _inner(view.y), _inner(view.footprint)
        c, s = np.float32(math.cos(scene.ground_turn)), np.float32(math.sin(scene.ground_turn))
        gx, gy = x + np.float32(scene.ground_shift[0]), y + np.float32(scene.ground_shift[1])
        bare = self.ground.sample(c * gx - s * gy, s * gx + c * gy, footprint) * np.float32(scene.albedo)
        if self.litter is not None:
            lying = self.litter.sample(x, y, footprint)
            bare = bare * (1 - lying[..., 0]) + lying[..., 1]
        sun = np.float32(light.sun) * _sunlit(light, view, self.cloud) + np.float32(1 - light.sun)
        slope = x * np.float32(light.slope[0]) + y * np.float32(light.slope[1])
        sun = sun * np.exp(np.clip(slope, -0.4, 0.4))
        shine = _shine(light, view)
        sky = _inner(view.sky)
        cover_px = None
        if self.cover is not None:
            shift = scene.cover_shift
            cover_px = self.cover.sample(x - np.float32(shift[0]), y - np.float32(shift[1]), footprint)
        # The board lies a little above the ground and throws a soft shadow.
        dx, dy = np.float32(scene.board_shadow[0]), np.float32(scene.board_shadow[1])
        rim = np.maximum(np.float32(0.01), footprint)
        half = np.float32(0.24)
        dark = _step(half - np.abs(x - dx), rim) * _step(half - np.abs(y - dy), rim)
        under = bare * (1 - np.float32(0.5 * light.sun) * dark)

        def lit(albedo: Array) -> Array:
            out = np.asarray(albedo * sun)
            if shine is not None:
                out += shine
            out[sky] = scene.sky
            return out

        frames = []
        box = _print_box(view, SPAN_M / 2 * 1.05) if markers else None
        parts = [] if box is None else _print_coverages(view, [marker_texture(name) for name in markers], box)
        for k in range(len(markers)):
            albedo = under.copy()
            if box is not None:
                part = parts[k]
                window = albedo[box[0] : box[1], box[2] : box[3]]
                window *= 1 - part[..., 0] - part[..., 1]
                window += part[..., 0] * np.float32(scene.paper) + part[..., 1] * np.float32(scene.ink)
            if cover_px is not None:
                albedo = albedo * (1 - cover_px[..., 0]) + cover_px[..., 1]
            frames.append(lit(albedo))
        return frames, lit(bare)


def exposures(scene: Scene, markers: Sequence[str]) -> tuple[list[Array], Array]:
    """Linear light on the sensor, for each marker, and without a board: mean over the exposure."""
    plane = _Plane(scene)
    optics = lens(scene.lens)
    total: list[Array] = []
    bare_total: Array | None = None
    poses = poses_in_exposure(scene)
    for rotation, translation in poses:
        frames, bare = plane.radiance(View(optics, rotation, translation), markers)
        if bare_total is None:
            total, bare_total = frames, bare
        else:
            for one, more in zip(total, frames, strict=True):
                one += more
            bare_total += bare
    assert bare_total is not None
    part = np.float32(1 / len(poses))
    return [one * part for one in total], bare_total * part


def _through_lens(scene: Scene, light: Array) -> Array:
    """Point spread, stray light and fall-off to the corners."""
    spread = cv2.GaussianBlur(light, (0, 0), scene.blur_px) if scene.blur_px > 0.05 else light
    if scene.veil > 0:
        small = cv2.resize(np.minimum(light, 8.0), (WIDTH // 8, HEIGHT // 8), interpolation=cv2.INTER_AREA)
        halo = cv2.resize(cv2.GaussianBlur(small, (0, 0), 6), (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
        spread = spread * np.float32(1 - scene.veil) + halo * np.float32(scene.veil)
    return spread * lens(scene.lens).shading(scene.vignette)


def gain(scene: Scene, bare: Array) -> float:
    """The exposure: between what puts the mean of the ground in the middle, and what puts paper just under white."""
    lit = float(np.mean(bare * lens(scene.lens).shading(scene.vignette)))
    by_mean, by_white = 0.2 / max(lit, 1e-3), 0.72 / scene.paper
    met = by_mean**scene.meter * by_white ** (1 - scene.meter)
    return float(min(met, 1.5 / scene.paper) * scene.exposure)


def _grain(scene: Scene) -> Array:
    """(HEIGHT, WIDTH) noise of deviation 1."""
    grain: Array = np.random.default_rng(scene.noise_seed).standard_normal((HEIGHT, WIDTH), dtype=np.float32)
    if scene.noise_grain > 0:
        grain = cv2.GaussianBlur(grain, (0, 0), scene.noise_grain)
        grain = grain * np.float32(1 / float(grain.std()))
    return grain


def _sensor(scene: Scene, light: Array, grain: Array) -> Array:
    """Grey levels: response, noise that grows with the signal, and what a compressor leaves of it."""
    grey = np.float32(255) * np.clip(light, 0, 1) ** np.float32(1 / scene.gamma)
    grey = np.float32(scene.black_level) + grey * np.float32((255 - scene.black_level) / 255)
    level = np.sqrt(np.float32(0.35) + np.float32(0.65 / 128) * grey)
    grey = grey + np.float32(scene.noise) * level * grain
    image: Array = np.clip(grey + np.float32(0.5), 0, 255).astype(np.uint8)
    if scene.jpeg is not None:
        coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg])[1]
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)
    return image


def render(scene: Scene, markers: Sequence[str] = ("alight",)) -> dict[str, Array]:
    """Frames (HEIGHT, WIDTH) uint8 of one scene, one for each marker; "none" is the ground without a board."""
    boards = [name for name in markers if name != "none"]
    frames, bare = exposures(scene, boards)
    amount, grain = np.float32(gain(scene, bare)), _grain(scene)
    raw = dict(zip(boards, frames, strict=True))
    raw["none"] = bare
    return {name: _sensor(scene, amount * _through_lens(scene, raw[name]), grain) for name in markers}
