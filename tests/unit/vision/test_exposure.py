"""Steering against a camera of the test's own: response, saturation, noise, and commands that take effect late."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import cv2
import numpy as np
import pytest

from app.config import ExposureConfig, LensConfig
from app.landmark import paper_landmark
from app.messages import Detection, ExposureLimits, Frame, LightSource, PlaneFit, SeenContour
from app.vision.camera_model import lens_from_config
from app.vision.exposure import ExposureState, ExposureSteering, motion_px_s

PAD = paper_landmark()
LENS = LensConfig(model="pinhole", width_px=160, height_px=120, fx_px=150.0, fy_px=150.0, cx_px=79.5, cy_px=59.5)
LIMITS = ExposureLimits(20e-6, 30e-3, 1.0, 16.0)
EXPOSURE_MAX_S = 8e-3
PERIOD_S = 1.0 / 30.0
WHITE, BLACK, GROUND = 0.78, 0.045, 0.10
"""Reflectances."""
WELL_EXPOSED_S = 0.3e-3
"""Of noon's light at gain 1: what brings white near its level."""
HEIGHT_M = 2.0


class Bench:
    """A camera over a pad: what it sees follows from light and exposure by one formula."""

    def __init__(self, *, delay=3, noise=1.5, gamma=2.0, tells=True, **config):
        self.steering = ExposureSteering(PAD, lens_from_config(LENS), ExposureConfig(**config), EXPOSURE_MAX_S)
        self.state = ExposureState()
        self.level, self.seen, self.glare, self.speed_px_s = 1.0, True, False, 0.0
        self.ground, self.height_m = GROUND, HEIGHT_M
        self.sunlit = None
        self.commands, self.frames = [], []
        self.exposure = (1e-3, 1.0)
        self._waiting = deque([self.exposure] * delay)
        self._noise, self._gamma, self._tells = noise, gamma, tells
        self._source = np.random.default_rng(4)
        self._t_s, self._u = 0.0, 0.0

    def _reflectance(self):
        half = PAD.quiet_zone_m / 2
        zone = np.array([[half, -half], [half, half], [-half, half], [-half, -half]])
        image = np.full((120 * 4, 160 * 4), self.ground, np.float32)
        if self.seen:
            scale = 150.0 / self.height_m
            for corners, value in [(zone, WHITE), *((c.corners_m, BLACK if c.black else WHITE) for c in PAD.contours)]:
                px = np.column_stack([79.5 + self._u + scale * corners[:, 1], 59.5 - scale * corners[:, 0]])
                cv2.fillConvexPoly(image, np.rint((px + 0.5) * 4 - 0.5).astype(np.int32), value)
        return cv2.resize(image, (160, 120), interpolation=cv2.INTER_AREA)

    def run(self, frames):
        for _ in range(frames):
            self._waiting.append(self.exposure)
            exposure_s, gain = self._waiting.popleft()
            light = self._reflectance() * self.level * exposure_s * gain / (WELL_EXPOSED_S / 0.8)
            if self.sunlit is not None:
                light[10:22, 100:112] = self.sunlit * exposure_s * gain / (WELL_EXPOSED_S / 0.8)
            if self.glare:
                light[54:61, 72:79] += 50.0
            grey = 255.0 * np.minimum(light, 1.0) ** (1.0 / self._gamma)
            grey += self._source.normal(0.0, self._noise * math.sqrt(gain), grey.shape)
            image = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
            k = len(self.frames)
            told = (exposure_s, gain) if self._tells else (None, None)
            frame = Frame(self._t_s, k, image, told[0], gain=told[1])
            self.frames.append(
                (exposure_s, gain, grey_of_white(image, self._u, self.height_m) if self.seen else math.nan)
            )
            rays = np.array([[0.0, 1.0, self._u * self.height_m / 150.0], [-1.0, 0.0, 0.0], [0.0, 0.0, self.height_m]])
            detection = Detection(self._t_s, k)
            if self.seen:
                corners = SeenContour(0, np.full((4, 2), np.nan))  # the plane says where all is
                detection = Detection(self._t_s, k, (corners,), plane=PlaneFit(rays, np.eye(8), 0.19))
            self.state, command = self.steering.step(self.state, frame, detection, LIMITS, self._t_s)
            if command is not None:
                self.commands.append(command)
                self.exposure = (command.exposure_s, command.gain)
            self._t_s += PERIOD_S
            self._u += self.speed_px_s * PERIOD_S
        return self

    @property
    def white(self):
        """Grey of the pad's white in the last frame."""
        return self.frames[-1][2]

    @property
    def total(self):
        return self.frames[-1][0] * self.frames[-1][1]


def grey_of_white(image, u, height_m):
    """In the ring between the outermost black and the edge of the quiet zone, right of the pad."""
    column = round(79.5 + u + 150.0 / height_m * (PAD.quiet_zone_m + PAD.size_m) / 4)
    return float(np.median(image[50:70, column]))


@pytest.mark.parametrize("delay", [0, 3, 8])
@pytest.mark.parametrize("gamma", [1.8, 2.2])
@pytest.mark.parametrize("factor", [3.0, 1 / 3])
def test_step_of_light_is_made_up_once_the_camera_obeys_and_nothing_swings(factor, gamma, delay):
    bench = Bench(delay=delay, gamma=gamma)
    bench.level = 0.5
    bench.run(60)
    assert bench.white == pytest.approx(205, abs=12)
    bench.level *= factor
    bench.run(2 * delay + 4)
    assert bench.white == pytest.approx(205, abs=18)
    bench.run(2 * delay + 20)
    whites = [white for _, _, white in bench.run(60).frames[-60:]]
    assert min(whites) > 190
    assert max(whites) < 220


@pytest.mark.parametrize("level", [100.0, 0.03])
def test_start_far_off_is_well_exposed_within_a_second(level):
    bench = Bench()
    bench.level = level
    bench.exposure = (1e-3, 1.0)
    bench.run(30)
    wanted_s = WELL_EXPOSED_S / level
    assert bench.total == pytest.approx(max(LIMITS.exposure_min_s, wanted_s), rel=0.25)


@pytest.mark.parametrize(("seen", "allowed"), [(True, 0), (False, 1)])
def test_steady_light_is_left_alone_in_spite_of_noise(seen, allowed):
    bench = Bench(noise=4.0).run(60)
    bench.seen = seen
    bench.run(300)
    told = len(bench.commands)
    bench.run(150)
    # Ten seconds after the pad was lost, its ratio to the picture still fades a little.
    assert len(bench.commands) - told <= allowed


def test_commands_say_what_they_rest_on():
    bench = Bench().run(30)
    last = bench.commands[-1]
    assert last.source is LightSource.PAD
    assert last.white is not None and last.black is not None and last.black < last.white
    bench.seen = False
    bench.level = 0.2
    bench.run(10)
    assert bench.commands[-1].source is LightSource.PICTURE
    assert bench.commands[-1].white is None


def test_lost_pad_leaves_the_exposure_as_it_was_over_it():
    """The ground is darker than most: metered by itself it would be exposed longer."""
    bench = Bench()
    bench.ground = 0.03
    bench.run(60)
    over_pad = bench.total
    bench.seen = False
    bench.run(12)
    assert bench.total == pytest.approx(over_pad, rel=0.1)


@pytest.mark.parametrize("factor", [3.0, 1 / 3])
def test_step_of_light_while_the_pad_is_lost_is_followed_by_the_picture(factor):
    bench = Bench().run(60)
    before = bench.total
    bench.seen = False
    bench.level *= factor
    bench.run(8)
    assert bench.total == pytest.approx(before / factor, rel=0.2)


def test_picture_alone_is_brought_to_its_level():
    bench = Bench(picture_level=80, gamma=2.2)
    bench.seen = False
    bench.level = 0.3
    bench.run(60)
    grey = 255.0 * (GROUND * 0.3 * bench.total / (WELL_EXPOSED_S / 0.8)) ** (1 / 2.2)
    assert grey == pytest.approx(80, abs=5)


@pytest.mark.parametrize(("brighter", "by"), [(0.7, 1.0), (2.5, 2.5), (12.0, 4.0)], ids=["no more", "more", "far more"])
def test_what_is_brighter_than_a_pad_would_be_is_kept_from_saturating_within_bounds(brighter, by):
    """The picture's middle lies in a shadow; beside it something white lies in the sun."""
    usual = Bench(gamma=2.2, noise=0.5)
    usual.seen = False
    usual.run(60)
    # White is taken to be so many times the light of the middle.
    ratio = (205 / 80) ** 2.2
    bench = Bench(gamma=2.2, noise=0.5)
    bench.seen, bench.sunlit = False, brighter * ratio * GROUND
    bench.run(90)
    assert bench.total == pytest.approx(usual.total / by, rel=0.15)


def test_still_pad_gets_exposure_time_before_gain():
    bench = Bench()
    bench.level = 0.1
    bench.run(30)
    assert bench.frames[-1][1] == 1.0
    assert bench.frames[-1][0] == pytest.approx(WELL_EXPOSED_S / 0.1, rel=0.15)


def test_moving_pad_gets_gain_beyond_the_time_in_which_it_would_smear():
    bench = Bench(blur_max_px=1.5)
    bench.level = 0.05
    bench.run(30)
    bench.speed_px_s, bench._u = 600.0, -50.0
    bench.state = ExposureState()
    bench.run(5)
    exposure_s, gain = bench.exposure
    assert exposure_s * 600.0 == pytest.approx(1.5, rel=0.1)
    assert exposure_s * gain == pytest.approx(WELL_EXPOSED_S / 0.05, rel=0.25)


@pytest.mark.parametrize("level", [1e-5, 1e5])
def test_command_never_leaves_the_limits(level):
    bench = Bench(gain_max=6.0)
    bench.level = level
    bench.run(60)
    exposure_s, gain = bench.exposure
    assert LIMITS.exposure_min_s <= exposure_s <= EXPOSURE_MAX_S
    assert 1.0 <= gain <= 6.0
    assert exposure_s == pytest.approx(EXPOSURE_MAX_S if level < 1 else LIMITS.exposure_min_s)


def test_glare_on_a_part_of_the_pad_changes_nothing():
    bench = Bench().run(60)
    told = len(bench.commands)
    bench.glare = True
    bench.run(30)
    assert len(bench.commands) == told


def test_camera_that_does_not_tell_its_exposure_is_given_one_to_begin_with():
    bench = Bench(tells=False).run(10)
    assert [command.source for command in bench.commands] == [LightSource.START]
    bench._tells = True
    assert bench.run(30).white == pytest.approx(205, abs=12)


def test_camera_that_does_not_tell_its_exposure_for_a_while_is_steered_on_from_what_it_had():
    """A device that refuses an exposure goes back to automatic, and is told its last one again later."""
    bench = Bench().run(60)
    told, last = len(bench.commands), bench.exposure
    bench._tells, bench.level = False, 0.3
    bench.run(60)
    assert (len(bench.commands), bench.exposure) == (told, last)
    bench._tells = True
    assert bench.run(30).white == pytest.approx(205, abs=12)


def test_black_that_would_drown_lifts_white_towards_saturation():
    plain = Bench(black_level=0).run(60)
    lifted = Bench(black_level=70).run(60)
    assert 1.1 < lifted.total / plain.total < 1.4
    assert lifted.white < 250


def test_large_pad_that_is_gone_leaves_the_say_to_the_ground_as_it_was_seen_from_higher_up():
    bench = Bench()
    bench.ground = 0.03
    bench.run(60)
    over_pad = bench.total
    bench.height_m = 0.5
    bench.run(30)
    bench.seen = False
    bench.run(30)
    assert bench.total == pytest.approx(over_pad, rel=0.35)


@pytest.mark.parametrize("gap_s", [1.0 / 60.0, 1.0 / 30.0, 0.1, 0.2, 0.4])
def test_motion_of_the_pads_image_fades_with_time_however_often_it_is_seen(gap_s):
    """A wrong detection far away looked like 9000 px/s; the pad stands still since. After 2 s that is exp(-2 / 0.65)
    of it; detections 0.4 s apart read no motion, but forget it all the same.
    """
    state = ExposureState(t_pad_s=0.0, centre_px=np.array([80.0, 60.0]), motion_px_s=9000.0)
    while state.t_pad_s < 2.0 - 1e-6:
        t_s = state.t_pad_s + gap_s
        state = replace(state, motion_px_s=motion_px_s(state, np.array([80.0, 60.0]), t_s), t_pad_s=t_s)
    assert state.motion_px_s == pytest.approx(9000.0 * math.exp(-state.t_pad_s / 0.65), rel=1e-6)
