"""Frames against ray geometry written here: where edges fall to a fraction of a pixel, and what light does."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from app.config import CameraConfig, LensConfig, PadMotionConfig, WorldConfig
from app.landmark import paper_landmark
from drivers.simulator.lens import Lens
from drivers.simulator.pad import Pad, PadState
from drivers.simulator.renderer import Renderer
from drivers.simulator.world import Truth

CX, CY = 319.5, 239.5
PINHOLE = {"model": "pinhole", "fx_px": 495.0, "fy_px": 495.0}
FISHEYE = {"model": "equidistant", "fx_px": 215.0, "fy_px": 215.0}
BENT = {**PINHOLE, "distortion": (-0.28, 0.07, 0.0, 0.0)}
BENT_FISHEYE = {**FISHEYE, "distortion": (0.03, -0.01, 0.002, 0.0)}
HALF = 0.19
CAMERA_DOWN_M = 0.05


def lens_of(fields: dict[str, Any]) -> LensConfig:
    return LensConfig(width_px=640, height_px=480, cx_px=CX, cy_px=CY, **fields)


def camera(**mount: float) -> CameraConfig:
    return CameraConfig(driver="synthetic", lens="-", **mount)


class Studio:
    """A renderer and a pad, and instants about them."""

    def __init__(self, lens: dict[str, Any], *, mount: dict[str, float] | None = None, **world: Any) -> None:
        motion = PadMotionConfig(**{"north_m": 3.0, "east_m": 2.0, **world.pop("motion", {})})
        config = WorldConfig(**{"noise_dn": 0.0, "motion": motion, **world})
        self.renderer = Renderer(config, paper_landmark(), lens_of(lens), camera(**(mount or {})))
        self.pad = Pad(motion).state

    def instant(
        self,
        height_m: float,
        *,
        north_m: float = 0.0,
        east_m: float = 0.0,
        roll: float = 0.0,
        pitch: float = 0.0,
        yaw: float = 0.0,
        vel: tuple[float, float, float] = (0.0, 0.0, 0.0),
        rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Truth:
        """The camera's optical centre height_m over the pad, for a level vehicle."""
        pos = (self.pad.north_m + north_m, self.pad.east_m + east_m, self.pad.down_m - height_m - CAMERA_DOWN_M)
        return Truth(0.0, pos, vel, quaternion(roll, pitch, yaw), rates, self.pad)

    def frame(self, truth: Truth) -> np.ndarray:
        self.renderer.render(truth)  # the gain settles on the first frame
        return self.renderer.render(truth)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def spun(q: tuple[float, float, float, float], v: np.ndarray) -> np.ndarray:
    """The vector turned by the quaternion: q v q*, by Rodrigues."""
    axis, w = np.array(q[1:]), q[0]
    return v + 2.0 * np.cross(axis, np.cross(axis, v) + w * v)


def ray_of(fields: dict[str, Any], u: float, v: float) -> np.ndarray:
    """Direction of a pixel in the camera's axes, by bisection on the lens's own forward formula."""
    x, y = (u - CX) / fields["fx_px"], (v - CY) / fields["fy_px"]
    radius = math.hypot(x, y)
    k = (*fields.get("distortion", ()), 0.0, 0.0, 0.0, 0.0)[:4]

    def bent(angle: float) -> float:
        if fields["model"] == "pinhole":
            t = math.tan(angle)
            return t * (1 + k[0] * t**2 + k[1] * t**4)
        return angle * (1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6)

    low, high = 0.0, 0.9 if fields["model"] == "pinhole" else 1.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bent(middle) < radius else (low, middle)
    if radius == 0.0:
        return np.array([0.0, 0.0, 1.0])
    return np.array([x / radius * math.sin(low), y / radius * math.sin(low), math.cos(low)])


def on_pad(fields: dict[str, Any], truth: Truth, pad: PadState, u: float, v: float) -> tuple[float, float]:
    """Where on the pad's plane a pixel looks: forward, right of its centre. Image top is the vehicle's front."""
    right, back, down = ray_of(fields, u, v)
    direction = spun(truth.q, np.array([-back, right, down]))
    origin = np.array(truth.pos) + spun(truth.q, np.array([0.0, 0.0, CAMERA_DOWN_M]))
    hit = origin + direction * (pad.down_m - origin[2]) / direction[2]
    n, e = hit[0] - pad.north_m, hit[1] - pad.east_m
    c, s = math.cos(pad.heading_rad), math.sin(pad.heading_rad)
    return c * n + s * e, -s * n + c * e


def crossing(along: Callable[[float], float], low: float, high: float) -> float:
    """Where a growing function is zero."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if along(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def edge_at(profile: np.ndarray, guess: float, window: int = 4) -> float:
    """Sub-pixel place of a step in a row of grey levels: the area that each side has in the window, in light."""
    start = round(guess) - window
    light = profile[start : start + 2 * window + 1].astype(np.float64) ** 2
    before, after = light[:2].mean(), light[-2:].mean()
    return start - 0.5 + float(((light - after) / (before - after)).sum())


POSES = [
    {"height_m": 1.2},
    {"height_m": 1.2, "north_m": 0.12, "east_m": -0.2, "yaw": 0.1},
    {"height_m": 0.9, "roll": 0.12, "pitch": -0.08, "yaw": -0.15},
    {"height_m": 2.4, "north_m": -0.3, "roll": -0.05, "yaw": 0.07},
]
"""For 495 px; lower in proportion for a shorter lens."""


@pytest.mark.parametrize("pose", POSES, ids=["straight", "aside", "tilted", "high"])
@pytest.mark.parametrize(
    ("fields", "motion"),
    [(PINHOLE, {}), (BENT, {}), (FISHEYE, {}), (BENT_FISHEYE, {}), (PINHOLE, {"height_m": 1.6, "heading_deg": 6.0})],
    ids=["pinhole", "pinhole bent", "fisheye", "fisheye bent", "on the van"],
)
def test_renderer_puts_the_outer_edges_where_the_rays_say(
    fields: dict[str, Any], motion: dict[str, float], pose: dict[str, float]
) -> None:
    # A low sun throws the vehicle's shadow out of the picture.
    studio = Studio(fields, motion=motion, sun_elevation_deg=10.0)
    shrink = fields["fx_px"] / 495.0
    truth = studio.instant(**{k: v * shrink if k.endswith("_m") else v for k, v in pose.items()})
    image, pad = studio.frame(truth), studio.pad

    def forward(u: float, v: float) -> float:
        return on_pad(fields, truth, pad, u, v)[0]

    def right(u: float, v: float) -> float:
        return on_pad(fields, truth, pad, u, v)[1]

    # A pixel row and a column through the pad near its middle.
    u0, v0 = CX, CY
    for _ in range(20):
        scale = 495.0 / pose["height_m"]
        u0, v0 = u0 - scale * right(u0, v0), v0 + scale * (forward(u0, v0) - 0.02)
    row, column = round(v0), round(u0)
    reach = 0.3 * 495.0 / pose["height_m"]
    u_right = crossing(lambda u: right(u, row) - HALF, u0, u0 + reach)
    u_left = crossing(lambda u: right(u, row) + HALF, u0 - reach, u0)
    v_front = -crossing(lambda v: forward(column, -v) - HALF, -v0, -v0 + reach)
    assert image.max() < 255
    assert edge_at(image[row], u_right) == pytest.approx(u_right, abs=0.08)
    assert edge_at(image[row], u_left) == pytest.approx(u_left, abs=0.08)
    assert edge_at(image[:, column], v_front) == pytest.approx(v_front, abs=0.08)


@pytest.mark.parametrize(
    ("mount", "ahead"),
    [
        ({"mount_yaw_deg": 90.0}, (0.0, -1.0)),
        ({"mount_yaw_deg": 180.0}, (-1.0, 0.0)),
        ({}, (1.0, 0.0)),
    ],
    ids=["right", "back", "front"],
)
def test_renderer_turns_with_the_mount(mount: dict[str, float], ahead: tuple[float, float]) -> None:
    """A board ahead of the vehicle is at the image's top for a camera mounted straight, at its left for one turned
    right: ahead is (up, right) in the image."""
    studio = Studio(PINHOLE, mount=mount)
    bright = np.argwhere(studio.frame(studio.instant(2.5, north_m=-0.7)) > 190)
    down, right = bright.mean(axis=0) - (CY, CX)
    expected_px = 495.0 * 0.7 / 2.5
    assert down == pytest.approx(-ahead[0] * expected_px, abs=8.0)
    assert right == pytest.approx(ahead[1] * expected_px, abs=8.0)


def test_renderer_with_the_camera_pitched_forward_sees_the_board_lower() -> None:
    straight, pitched = Studio(PINHOLE), Studio(PINHOLE, mount={"mount_pitch_deg": 10.0})
    rows = [np.argwhere(s.frame(s.instant(2.5)) > 190).mean(axis=0)[0] for s in (straight, pitched)]
    assert rows[1] - rows[0] == pytest.approx(495.0 * math.tan(math.radians(10.0)), abs=8.0)


def test_renderer_shows_the_deck_nearer_than_the_ground() -> None:
    """The same camera height over the ground: a board on a roof is larger by the ratio of the distances."""
    sizes = []
    for height_m in (0.0, 1.6):
        studio = Studio(PINHOLE, motion={"height_m": height_m})
        image = studio.frame(studio.instant(4.0 - height_m))
        sizes.append(math.sqrt(float((image > 0.85 * image.max()).sum())))
    assert sizes[1] / sizes[0] == pytest.approx(4.0 / 2.4, rel=0.06)


def test_renderer_of_the_same_seed_draws_the_same_frames_and_of_another_not() -> None:
    frames = []
    for seed in (5, 5, 6):
        studio = Studio(FISHEYE, seed=seed, noise_dn=2.0)
        frames.append([studio.renderer.render(studio.instant(2.0)) for _ in range(3)])
    assert all((a == b).all() for a, b in zip(frames[0], frames[1], strict=True))
    assert (frames[0][2] != frames[2][2]).any()


def test_renderer_noise_has_its_deviation() -> None:
    clean, noisy = Studio(PINHOLE), Studio(PINHOLE, noise_dn=3.0)
    a, b = clean.frame(clean.instant(3.0)), noisy.frame(noisy.instant(3.0))
    middle = (slice(100, 380), slice(100, 540))
    assert (b[middle].astype(float) - a[middle].astype(float)).std() == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("motion", ["speed", "rate"])
def test_renderer_smears_edges_over_the_way_that_the_image_moves(motion: str) -> None:
    """8 ms at 3 m/s over 1.2 m is 9.9 px along the row: the edge's slope is a box of that width."""
    studio = Studio(PINHOLE, exposure_ms=8.0)
    moving = {"vel": (0.0, 3.0, 0.0)} if motion == "speed" else {"rates": (-2.5, 0.0, 0.0)}
    image = studio.frame(studio.instant(1.2, **moving))
    profile = image[round(CY)].astype(float) ** 2
    edge = round(CX + 495.0 * HALF / 1.2)
    window = profile[edge - 12 : edge + 13]
    share = (window - window[:3].mean()) / (window[-3:].mean() - window[:3].mean())
    width = float(((share > 0.1) & (share < 0.9)).sum())
    assert width == pytest.approx(0.8 * 9.9, abs=2.6)


def test_renderer_gain_brings_dark_and_bright_scenes_to_one_level() -> None:
    means = []
    for ground in ("lawn", "asphalt"):
        studio = Studio(PINHOLE, ground=ground, motion={"north_m": 300.0})
        truth = Truth(0.0, (0.0, 0.0, -4.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), studio.pad)
        means.append(float(studio.frame(truth).mean()))
    assert means[0] == pytest.approx(means[1], rel=0.06)
    assert 70.0 < means[0] < 100.0


def test_renderer_at_rest_on_the_ground_and_beside_the_van_still_draws() -> None:
    studio = Studio(FISHEYE, ground="asphalt", motion={"height_m": 1.6})
    truth = Truth(0.0, (0.0, 0.0, -0.117), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), studio.pad)
    assert studio.frame(truth).std() > 3.0


@pytest.mark.parametrize("fields", [PINHOLE, BENT, FISHEYE, BENT_FISHEYE], ids=["pin", "bent", "fish", "bent fish"])
def test_lens_rays_project_back_to_their_pixels(fields: dict[str, Any]) -> None:
    lens = Lens(lens_of(fields))
    rays = lens.rays()[60:420:40, 80:560:40].reshape(-1, 3).astype(np.float64)
    v, u = np.mgrid[60:420:40, 80:560:40]
    back = lens.project(rays * 3.7)
    assert np.abs(back - np.column_stack([u.ravel(), v.ravel()])).max() < 2e-3


def test_lens_sees_no_point_behind_a_pinhole() -> None:
    assert np.isnan(Lens(lens_of(PINHOLE)).project(np.array([[0.1, 0.1, -1.0]]))).all()


def test_lens_fisheye_sees_past_ninety_degrees() -> None:
    pixel = Lens(lens_of(FISHEYE)).project(np.array([[1.0, 0.0, -0.1]]))[0]
    assert pixel[0] == pytest.approx(CX + 215.0 * (math.pi / 2 + math.atan(0.1)))


def test_lens_with_tangential_distortion_follows_browns_formula() -> None:
    fields = {**PINHOLE, "distortion": (-0.1, 0.02, 0.003, -0.002, 0.001)}
    x, y = 0.3, -0.2
    r2 = 0.13
    radial = 1 - 0.1 * r2 + 0.02 * r2**2 + 0.001 * r2**3
    u = x * radial + 2 * 0.003 * x * y - 0.002 * (r2 + 2 * x * x)
    v = y * radial + 0.003 * (r2 + 2 * y * y) - 2 * 0.002 * x * y
    pixel = Lens(lens_of(fields)).project(np.array([[x, y, 1.0]]))[0]
    assert pixel == pytest.approx([CX + 495.0 * u, CY + 495.0 * v])
