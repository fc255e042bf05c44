"""The simulator's daylight and its camera's exposure, against the formulas that they stand for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from app.config import CameraConfig, LensConfig, LightChange, LightConfig, PadMotionConfig, WorldConfig
from app.landmark import paper_landmark
from drivers.simulator.daylight import level_at
from drivers.simulator.pad import Pad
from drivers.simulator.renderer import Renderer
from drivers.simulator.shutter import LIMITS, Exposure, Shutter
from drivers.simulator.world import Truth

LENS = LensConfig(model="pinhole", width_px=320, height_px=240, fx_px=250.0, fy_px=250.0, cx_px=159.5, cy_px=119.5)
CAMERA_DOWN_M = 0.05


class Studio:
    """A camera over a pad."""

    def __init__(self, **world: Any) -> None:
        motion = PadMotionConfig(north_m=3.0, east_m=2.0)
        config = WorldConfig(**{"noise_dn": 0.0, "motion": motion, **world})
        self.renderer = Renderer(config, paper_landmark(), LENS, CameraConfig(driver="synthetic", lens="-"))
        self.pad = Pad(motion).state

    def image(
        self,
        told: Exposure | None,
        *,
        t_s: float = 0.0,
        height_m: float = 1.5,
        north_m: float = 0.0,
        vel: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> np.ndarray:
        pos = (self.pad.north_m + north_m, self.pad.east_m, self.pad.down_m - height_m - CAMERA_DOWN_M)
        truth = Truth(t_s, pos, vel, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), self.pad)
        return self.renderer.shoot(truth, told).image.astype(np.float64)


def light_of(image: np.ndarray) -> float:
    """The response is the square root of light; what saturates doesn't count."""
    return float((image[image < 250] ** 2).mean())


@pytest.mark.parametrize(
    ("t_s", "level"),
    [(0.0, 1.0), (0.99, 1.0), (1.0, 0.25), (2.99, 0.25), (4.0, math.sqrt(0.25 * 0.01)), (5.0, 0.01), (99.0, 0.01)],
)
def test_daylight_follows_its_changes_at_once_or_evenly_in_stops(t_s: float, level: float) -> None:
    changes = (LightChange(at_s=1.0, level=0.25), LightChange(at_s=3.0, level=0.01, over_s=2.0))
    assert level_at(LightConfig(level=1.0, changes=changes), t_s) == pytest.approx(level)


def test_daylight_with_changes_out_of_order_is_refused() -> None:
    with pytest.raises(ValueError, match="at_s = 2 must begin after the one before has ended, at 3 s"):
        LightConfig(changes=(LightChange(at_s=1.0, level=0.5, over_s=2.0), LightChange(at_s=2.0, level=1.0)))


def test_daylight_counts_from_the_first_frame_whatever_its_time() -> None:
    light = LightConfig(level=1.0, changes=(LightChange(at_s=1.0, level=0.25),))
    studio, told = Studio(light=light), Exposure(0.2e-3, 1.0)
    before, after = (light_of(studio.image(told, t_s=t_s)) for t_s in (5000.0, 5001.0))
    assert after / before == pytest.approx(0.25, rel=0.03)


@pytest.mark.parametrize("told", [Exposure(0.1e-3, 1.0), Exposure(0.05e-3, 4.0), Exposure(0.2e-3, 1.5)])
def test_camera_told_its_exposure_gives_light_times_exposure_times_gain(told: Exposure) -> None:
    studio = Studio()
    reference = light_of(studio.image(Exposure(0.1e-3, 1.0)))
    assert light_of(studio.image(told)) / reference == pytest.approx(told.exposure_s * told.gain / 0.1e-3, rel=0.03)


def test_camera_told_nothing_meets_steps_of_light_with_its_own_gain_in_time() -> None:
    light = LightConfig(level=0.5, changes=(LightChange(at_s=1.0, level=0.1),))
    studio = Studio(light=light)
    frames = [light_of(studio.image(None, t_s=k / 30, north_m=5.0)) for k in range(120)]
    # A fifth of the light, of which the automatic gain makes up 8% of the stops in each frame.
    assert frames[30] / frames[29] == pytest.approx(0.2 * 5.0**0.08, rel=0.03)
    assert frames[-1] / frames[29] == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("gain", [1.0, 4.0, 9.0])
def test_camera_noise_at_one_grey_level_grows_with_the_root_of_gain(gain: float) -> None:
    told = Exposure(0.3e-3 / gain, gain)
    noise = Studio(noise_dn=2.0).image(told) - Studio().image(told)
    middle = noise[60:180, 80:240]
    assert middle.std() == pytest.approx(2.0 * math.sqrt(gain), rel=0.12)


@pytest.mark.parametrize(("exposure_s", "smear_px"), [(6e-3, 3.0), (10e-3, 5.0)])
def test_camera_smears_over_the_exposure_that_it_is_told(exposure_s: float, smear_px: float) -> None:
    """3 m/s over 1.5 m is 500 px/s; the slope of an edge grows by the way in the exposure."""
    light = LightConfig(level=0.1e-3 / exposure_s)
    told = Exposure(exposure_s, 1.0)
    widths = []
    for speed in (0.0, 3.0):
        column = Studio(light=light).image(told, vel=(speed, 0.0, 0.0))[:, 160] ** 2
        edge = round(119.5 - 250.0 * 0.19 / 1.5)
        profile = column[edge - 9 : edge + 10]
        # A box of width w adds w^2 / 12 to the variance of the edge's slope.
        slope = np.clip(profile[:-1] - profile[1:], 0.0, None)
        at = np.arange(len(slope))
        mean = (slope * at).sum() / slope.sum()
        widths.append((slope * (at - mean) ** 2).sum() / slope.sum())
    assert math.sqrt(12.0 * max(0.0, widths[1] - widths[0])) == pytest.approx(smear_px, abs=0.8)


def test_glare_is_where_the_ray_turned_up_meets_the_sun_and_drowns_the_pad_there() -> None:
    """The sun 75 degrees high in the north: mirrored 15 degrees ahead of straight down."""
    world = {"sun_elevation_deg": 75.0, "sun_azimuth_deg": 0.0}
    told = Exposure(0.1e-3, 1.0)
    plain = Studio(**world).image(told, north_m=-3.0)
    bright = Studio(light=LightConfig(glare=5.0, glare_width_deg=1.0), **world).image(told, north_m=-3.0) - plain
    row, column = np.unravel_index(int(bright.argmax()), bright.shape)
    assert row == pytest.approx(119.5 - 250.0 * math.tan(math.radians(15.0)), abs=12)
    assert column == pytest.approx(159.5, abs=12)
    assert (bright > 1.0).mean() < 0.2


def test_shutter_does_what_it_is_told_after_its_delay_and_by_itself_before() -> None:
    shutter = Shutter(2)
    shutter.tell(Exposure(1e-3, 2.0))
    assert [shutter.next() for _ in range(4)] == [None, None, Exposure(1e-3, 2.0), Exposure(1e-3, 2.0)]
    shutter.tell(None)
    assert [shutter.next() for _ in range(3)] == [Exposure(1e-3, 2.0), Exposure(1e-3, 2.0), None]


def test_shutter_told_too_much_does_what_comes_nearest() -> None:
    shutter = Shutter(0)
    shutter.tell(Exposure(9.0, 0.0))
    assert shutter.next() == Exposure(LIMITS.exposure_max_s, LIMITS.gain_min)
