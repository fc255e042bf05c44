"""The landmark in changing light: rendered frames through the real detector, the real steering and a camera that obeys.

A frame counts as one with the landmark if the detector says so and its contours lie where geometry puts them. A track
is not ended if the landmark is never out of sight for safety.track_stale_s, after which guidance flies no velocity
towards it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pytest

from app.clock import run_virtual
from app.config import ExposureConfig, LensConfig, LightChange, LightConfig, PadMotionConfig, WorldConfig
from app.messages import Detection, Frame, OperatorAction, Phase
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector
from app.vision.exposure import ExposureState, ExposureSteering
from app.wiring import CONFIGS, load_rig, read_lens
from drivers.simulator.pad import Pad
from drivers.simulator.renderer import Renderer
from drivers.simulator.shutter import LIMITS, Exposure, Shutter
from drivers.simulator.world import Truth

RIG = load_rig(CONFIGS / "simulator.toml")
RATE_HZ = 30.0
STEP_FRAME = 12
BACK_WITHIN = 5
"""Frames: 150 ms."""
LENSES = ["pi-fisheye-640", "pi-camera3-640"]
MOTION = PadMotionConfig(north_m=3.0, east_m=2.0)
TRACK_STALE_FRAMES = RIG.config.safety.track_stale_s * RATE_HZ


@dataclass(frozen=True)
class Seen:
    """What came of one frame."""

    frame: Frame
    detection: Detection
    found: bool


def straight_down(
    lens: LensConfig, height_m: float, north_m: float, east_m: float
) -> Callable[[np.ndarray], np.ndarray]:
    """Pixels of points (n, 2) of the pad, for a level vehicle north_m, east_m off it: image up is north."""

    def project(points: np.ndarray) -> np.ndarray:
        up, right = points[:, 0] - north_m, points[:, 1] - east_m
        away = np.hypot(up, right)
        radius = np.arctan2(away, height_m) if lens.model == "equidistant" else away / height_m
        scale = np.where(away > 0, radius / np.maximum(away, 1e-12), 1.0 / height_m)
        return np.column_stack([lens.cx_px + lens.fx_px * right * scale, lens.cy_px - lens.fy_px * up * scale])

    return project


def watch(
    light: LightConfig,
    frames: int,
    *,
    lens: str = "pi-fisheye-640",
    camera: str = "steered",
    height_m: float = 2.5,
    north_m: Callable[[float], float] = lambda _: 0.2,
    sun_elevation_deg: float = 50.0,
    fixed: Exposure | None = None,
) -> list[Seen]:
    """A camera over the pad at 30 Hz. camera: "steered", "automatic" (its own gain), "fixed"."""
    lens_config = read_lens(CONFIGS / "cameras" / f"{lens}.toml")
    model = lens_from_config(lens_config)
    world = WorldConfig(light=light, motion=MOTION, sun_elevation_deg=sun_elevation_deg, sun_azimuth_deg=0.0)
    renderer = Renderer(world, RIG.landmark, lens_config, RIG.config.camera)
    detector = Detector(RIG.landmark, model, RIG.config.vision)
    steering = ExposureSteering(RIG.landmark, model, ExposureConfig(), 8e-3)
    state, shutter, pad = ExposureState(), Shutter(0 if camera == "fixed" else 3), Pad(MOTION).state
    shutter.tell(fixed)
    seen = []
    for k in range(frames):
        t_s, east_m = k / RATE_HZ, 0.1
        north = north_m(t_s)
        body = (pad.north_m + north, pad.east_m + east_m, pad.down_m - height_m - 0.05)
        shot = renderer.shoot(Truth(t_s, body, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3, pad), shutter.next())
        frame = Frame(t_s, k, shot.image, shot.exposure.exposure_s, gain=shot.exposure.gain)
        detection = detector.detect(frame)
        if camera == "steered":
            state, command = steering.step(state, frame, detection, LIMITS, t_s)
            if command is not None:
                shutter.tell(Exposure(command.exposure_s, command.gain))
        project = straight_down(lens_config, height_m, north, east_m)
        right = all(
            np.abs(contour.corners_px - project(RIG.landmark.contours[contour.index].corners_m)).max() < 3.0
            for contour in detection.contours
        )
        assert right, f"frame {k}: contours where there are none"
        seen.append(Seen(frame, detection, detection.detected))
    return seen


def longest_gap(seen: list[Seen]) -> int:
    """Frames in a row without the landmark."""
    return max((len(list(run)) for found, run in groupby(one.found for one in seen) if not found), default=0)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(
    ("camera", "before", "after"),
    [
        pytest.param("steered", 0.3, 0.9, id="steered up"),
        pytest.param("steered", 0.9, 0.3, id="steered down"),
        pytest.param("steered", 0.006, 0.002, id="steered at dusk"),
        pytest.param("automatic", 0.3, 0.9, id="automatic up"),
        pytest.param("automatic", 0.9, 0.3, id="automatic down"),
        pytest.param("fixed", 0.3, 0.9, id="fixed up"),
        pytest.param("fixed", 0.9, 0.3, id="fixed down"),
    ],
)
def test_landmark_after_a_step_of_light_by_three_is_back_within_five_frames(lens, camera, before, after):
    """The fixed exposure is the one that just doesn't saturate white in the brighter light."""
    fixed = Exposure(0.3e-3 / max(before, after), 1.0) if camera == "fixed" else None
    light = LightConfig(level=before, changes=(LightChange(at_s=STEP_FRAME / RATE_HZ, level=after),))
    seen = watch(light, STEP_FRAME + 12, lens=lens, camera=camera, fixed=fixed)
    assert all(one.found for one in seen[STEP_FRAME - 4 : STEP_FRAME])
    assert any(one.found for one in seen[STEP_FRAME : STEP_FRAME + BACK_WITHIN])
    assert all(one.found for one in seen[STEP_FRAME + BACK_WITHIN :])


@pytest.mark.parametrize("factor", [3.0, 1 / 3])
def test_steered_camera_after_a_step_of_light_exposes_the_pads_white_as_before(factor):
    """Three frames of the camera's delay, and three for the steering; the response is the square root of light."""
    light = LightConfig(level=0.3, changes=(LightChange(at_s=20 / RATE_HZ, level=0.3 * factor),))
    seen = watch(light, 30)
    before, after = (one.frame.exposure_s * one.frame.gain for one in (seen[19], seen[26]))
    assert after / before == pytest.approx(1 / factor, rel=0.25)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("camera", ["steered", "automatic"])
def test_track_does_not_end_while_dusk_falls(lens, camera):
    """From noon to 200 lux, compressed into two seconds: 4.5 stops a second."""
    light = LightConfig(level=1.0, changes=(LightChange(at_s=0.2, level=0.002, over_s=2.0),))
    seen = watch(light, 75, lens=lens, camera=camera)
    assert longest_gap(seen) <= BACK_WITHIN
    assert all(one.found for one in seen[-5:])


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(
    ("camera", "glare", "width_deg"),
    [
        pytest.param("steered", 10.0, 0.7, id="polished"),
        pytest.param("steered", 3.0, 1.0, id="laminated"),
        pytest.param("steered", 1.0, 2.0, id="wet"),
        pytest.param("automatic", 1.0, 2.0, id="wet, automatic"),
    ],
)
def test_track_does_not_end_while_the_suns_glare_crosses_the_landmark(lens, camera, glare, width_deg):
    """The sun 80 degrees high in the north is mirrored 10 degrees ahead; at 2 m and 0.5 m/s the pad passes it."""
    light = LightConfig(level=1.0, glare=glare, glare_width_deg=width_deg)
    ahead_m = 2.0 * math.tan(math.radians(10.0))
    seen = watch(
        light,
        48,
        lens=lens,
        camera=camera,
        height_m=2.0,
        north_m=lambda t_s: -ahead_m - 0.4 + 0.5 * t_s,
        sun_elevation_deg=80.0,
    )
    assert seen[2].found
    assert longest_gap(seen) < TRACK_STALE_FRAMES
    assert seen[-1].found


def test_flight_into_dusk_with_clouds_lands_on_the_pad(fly):
    """Clouds come and go while it searches and tracks, and dusk falls while it lands."""

    async def land(flight):
        await flight.ready()
        flight.phone.ask(OperatorAction.LAND, 0.0)
        await flight.reach(Phase.TAKEOFF)
        await flight.reach(Phase.LANDED, Phase.HOLD, Phase.IDLE)

    clouds = tuple(LightChange(at_s=t_s, level=level) for t_s, level in ((9.0, 0.33), (12.0, 1.0), (15.0, 0.33)))
    light = LightConfig(level=1.0, changes=(*clouds, LightChange(at_s=17.0, level=0.004, over_s=6.0)))
    world = WorldConfig(seed=8, light=light, motion=PadMotionConfig(north_m=2.0, east_m=-1.5, heading_deg=40.0))
    flight = run_virtual(fly(world, land))
    assert flight.phase is Phase.LANDED
    assert flight.contacts[-1].on_deck
    assert flight.contacts[0].error_m < 0.10
    assert Phase.HOLD not in flight.phases
