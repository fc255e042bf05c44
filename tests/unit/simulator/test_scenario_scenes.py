"""What scenarios put before the camera: a leaning deck, a leaf, a shadow's edge, prints that are not the landmark."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from app.config import CameraConfig, LensConfig, LightConfig, PadMotionConfig, WorldConfig
from app.config_world import DecoyConfig, OcclusionConfig, ShadowConfig
from app.frames import quaternion_from_rotation, rotation_from_euler
from app.landmark import paper_landmark
from drivers.simulator.pad import Pad, PadState
from drivers.simulator.renderer import Renderer
from drivers.simulator.world import Truth

LENS = LensConfig(model="pinhole", width_px=320, height_px=240, fx_px=300.0, fy_px=300.0, cx_px=159.5, cy_px=119.5)
MOUNT = CameraConfig(driver="synthetic", lens="", position_body_m=(0.0, 0.0, 0.0))
MOTION = PadMotionConfig(north_m=0.0, east_m=0.0)


def shot(pad: PadState, body: np.ndarray, turned: np.ndarray, *, t_s: float = 0.0, **world: object) -> np.ndarray:
    # A low sun throws the vehicle's own shadow out of the picture.
    config = WorldConfig(noise_dn=0.0, motion=MOTION, sun_elevation_deg=15.0, **world)
    renderer = Renderer(config, paper_landmark(0.38), LENS, MOUNT)
    return frame(renderer, pad, body, turned, t_s).astype(int)


def frame(renderer: Renderer, pad: PadState, body: np.ndarray, turned: np.ndarray, t_s: float = 0.0) -> np.ndarray:
    n, e, d = (float(v) for v in body)
    w, x, y, z = (float(v) for v in quaternion_from_rotation(turned))
    return renderer.shoot(Truth(t_s, (n, e, d), (0.0,) * 3, (w, x, y, z), (0.0,) * 3, pad)).image


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(8.0, 0.0), (0.0, -8.0), (12.0, 9.0)])
def test_landmark_on_a_leaning_deck_looks_as_it_does_to_a_camera_that_leans_the_other_way(roll_deg, pitch_deg):
    """The image depends on the camera's place relative to the pad only. Off the print the grounds differ."""
    level = Pad(MOTION).state
    leaning = rotation_from_euler(math.radians(roll_deg), math.radians(pitch_deg), 0.0)
    away = np.array([0.05, -0.1, -1.2])
    deck = replace(level, roll_rad=math.radians(roll_deg), pitch_rad=math.radians(pitch_deg))
    one = shot(deck, away, np.eye(3), ground="asphalt")
    other = shot(level, leaning.T @ away, leaning.T, ground="asphalt")
    black = (one < 0.4 * one.max()) | (other < 0.4 * other.max())
    # The middle of the print: 0.2 m to each side of its centre at 300 px over 1.2 m.
    row, column = (int(c) for c in (119.5 + 300 * 0.05 / 1.2, 159.5 + 300 * 0.1 / 1.2))
    part = (slice(row - 40, row + 41), slice(column - 40, column + 41))
    assert 0.3 < black[part].mean() < 0.9
    brightness = one[part].mean() / other[part].mean()  # the automatic gain looks at the grounds too
    apart = np.abs(one[part] - brightness * other[part]).mean()
    assert apart < 1.0
    assert np.abs(one[part] - shot(level, away, np.eye(3), ground="asphalt")[part]).mean() > 3.0 * apart


def test_leaf_hides_all_for_its_time_once_the_camera_has_sunk_below_its_height():
    world = WorldConfig(noise_dn=0.0, motion=MOTION, occlusion=OcclusionConfig(below_m=1.0, for_s=1.0))
    renderer, pad = Renderer(world, paper_landmark(0.38), LENS, MOUNT), Pad(MOTION).state
    heights_m = [0.5, 1.5, 1.3, 0.99, 0.8, 0.8, 0.8]
    times_s = [0.0, 1.0, 2.0, 3.0, 3.9, 4.1, 9.0]
    middle = (slice(90, 150), slice(130, 190))
    contrast = [
        np.ptp(frame(renderer, pad, np.array([0.0, 0.0, -h]), np.eye(3), t)[middle].astype(int))
        for h, t in zip(heights_m, times_s, strict=True)
    ]
    assert [bool(c > 80) for c in contrast] == [True, True, True, False, False, True, True]


def test_shadows_edge_leaves_its_share_of_the_light_on_its_side():
    """Toward the east from the pad's centre: the right half of an image whose top is north. Grey is light's root."""
    shade = LightConfig(shadow=ShadowConfig(toward_deg=90.0, light=0.25, soft_m=0.01))
    pad, above = Pad(MOTION).state, np.array([0.0, 0.0, -2.0])
    lit, shaded = (shot(pad, above, np.eye(3), light=light, exposure_ms=0.1) for light in (LightConfig(), shade))
    ratio = shaded[:, 170:].mean() / shaded[:, :150].mean()
    assert ratio == pytest.approx(0.5 * lit[:, 170:].mean() / lit[:, :150].mean(), rel=0.05)


@pytest.mark.parametrize("kind", ["squares", "triangles", "helipad", "marker", "negative"])
def test_decoy_is_seen_where_it_lies(kind):
    """0.4 m ahead of a camera at 2.5 m: 48 px above the image's middle."""
    pad, above = Pad(MOTION).state, np.array([0.4, 0.0, -2.5])
    decoy = DecoyConfig(kind=kind, forward_m=0.8, right_m=0.0, size_m=0.38)
    bare, with_decoy = (shot(pad, above, np.eye(3), decoys=decoys, exposure_ms=0.1) for decoys in ((), (decoy,)))
    changed = np.argwhere(np.abs(bare - with_decoy)[:110] > 25)  # above the landmark, which the gain changes a little
    assert changed.mean(axis=0) == pytest.approx([119.5 - 300 * 0.4 / 2.5, 159.5], abs=6.0)
    assert np.ptp(changed, axis=0) == pytest.approx([300 * 0.46 / 2.5] * 2, abs=6.0)
