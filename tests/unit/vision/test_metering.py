"""The pad's grey levels, read from pictures that are drawn here with levels that are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from app.config import LensConfig
from app.landmark import paper_landmark
from app.messages import Detection, Frame, PlaneFit, SeenContour
from app.vision.camera_model import lens_from_config
from app.vision.metering import HighlightMeter, PadMeter, middle_grey

PAD = paper_landmark()
LENS = LensConfig(model="pinhole", width_px=320, height_px=240, fx_px=250.0, fy_px=250.0, cx_px=159.5, cy_px=119.5)
GROUND = 60


def project(points_m, height_m, shift_px):
    """Straight down, image top forward: u grows to the right, v backward."""
    scale = 250.0 / height_m
    return np.column_stack([159.5 + shift_px + scale * points_m[:, 1], 119.5 - scale * points_m[:, 0]])


def drawn(white, black, height_m=0.6, shift_px=0.0):
    """A picture of the pad, eight times supersampled."""
    half = PAD.quiet_zone_m / 2
    zone = np.array([[half, -half], [half, half], [-half, half], [-half, -half]])
    image = np.full((240 * 8, 320 * 8), GROUND, np.uint8)
    for corners, grey in [(zone, white), *((c.corners_m, black if c.black else white) for c in PAD.contours)]:
        px = (project(corners, height_m, shift_px) + 0.5) * 8 - 0.5
        cv2.fillConvexPoly(image, np.rint(px).astype(np.int32), int(grey))
    return cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)


def seen(height_m=0.6, shift_px=0.0, first=0, last=5):
    return Detection(
        0.0,
        0,
        tuple(SeenContour(k, project(PAD.contours[k].corners_m, height_m, shift_px)) for k in range(first, last)),
    )


def read(image, detection):
    return PadMeter(PAD, lens_from_config(LENS)).read(Frame(0.0, 0, image), detection)


@pytest.mark.parametrize(("white", "black"), [(200, 40), (90, 70), (255, 110)])
def test_meter_reads_white_and_black_from_the_corners(white, black):
    light = read(drawn(white, black), seen())
    assert (light.white, light.black) == (white, black)
    assert light.centre_px == pytest.approx([159.5, 119.5], abs=1e-6)


@pytest.mark.parametrize("run", [(0, 2), (2, 4), (3, 5)])
def test_meter_reads_the_whole_pad_by_any_run_of_its_contours(run):
    light = read(drawn(190, 30), seen(first=run[0], last=run[1]))
    assert (light.white, light.black) == (190, 30)


def test_meter_takes_the_plane_of_the_detection_where_corners_are_few():
    """Of [r1 r2 t]: pad forward is image up (-y), pad right is x, at 0.6 m."""
    plane = PlaneFit(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.6]]), np.eye(8), 0.19)
    detection = Detection(0.0, 0, seen(last=1).contours, plane=plane)
    light = read(drawn(180, 50), detection)
    assert (light.white, light.black) == (180, 50)


def test_meter_of_a_pad_that_is_half_outside_the_image_reads_the_rest():
    light = read(drawn(200, 40, shift_px=150.0), seen(shift_px=150.0))
    assert (light.white, light.black) == (200, 40)


def test_meter_of_a_pad_outside_the_image_reads_nothing():
    assert read(drawn(200, 40), seen(shift_px=400.0)) is None


def test_meter_of_a_pad_of_twenty_pixels_reads_its_quiet_zone_and_that_black_is_dark():
    light = read(drawn(200, 40, height_m=4.75), seen(height_m=4.75))
    assert light.white == pytest.approx(200, abs=25)
    assert light.black < 110


def test_meter_of_glare_on_a_fifth_of_the_pad_reads_as_without():
    image = drawn(200, 40)
    # A fifth of the quiet zone's width, over its whole height: black and white drown there.
    left = round(159.5 - 250.0 / 0.6 * PAD.quiet_zone_m / 2)
    image[:, left : left + round(250.0 / 0.6 * PAD.quiet_zone_m / 5)] = 255
    light = read(image, seen())
    assert (light.white, light.black) == (200, 40)
    assert 0.1 < light.saturated < 0.35


def test_meter_of_a_pad_half_in_shade_reads_the_lit_white():
    image = drawn(200, 40)
    image[:120] //= 3
    assert read(image, seen()).white == 200


def test_middle_grey_is_that_of_the_middle_whatever_the_corners_are():
    image = np.full((240, 320), 250, np.uint8)
    image[40:200, 60:260] = 70
    image[100:110, 100:140] = 255
    assert middle_grey(image) == 70


def test_middle_grey_of_a_colour_picture_weighs_as_bt601():
    image = np.zeros((240, 320, 3), np.uint8)
    image[:] = (200, 100, 50)
    assert middle_grey(image) == pytest.approx(0.114 * 200 + 0.587 * 100 + 0.299 * 50, abs=1.0)


@pytest.mark.parametrize(("side", "read"), [(0, 60), (6, 60), (12, 200)])
def test_highlight_is_what_a_small_pad_would_be_and_no_glint(side, read):
    image = np.full((240, 320), 60, np.uint8)
    image[100 : 100 + side, 200 : 200 + side] = 200
    assert HighlightMeter(lens_from_config(LENS)).read(image) == read


def test_highlight_of_a_colour_picture_weighs_as_bt601():
    image = np.zeros((240, 320, 3), np.uint8)
    image[:] = (200, 100, 50)
    expected = 0.114 * 200 + 0.587 * 100 + 0.299 * 50
    assert HighlightMeter(lens_from_config(LENS)).read(image) == pytest.approx(expected, abs=1.0)


def test_sky_in_a_fisheyes_corners_is_no_highlight():
    fisheye = LensConfig(
        model="equidistant", width_px=320, height_px=240, fx_px=107.5, fy_px=107.5, cx_px=159.5, cy_px=119.5
    )
    image = np.full((240, 320), 60, np.uint8)
    # 64 degrees from the axis and more, at the left and right.
    image[:, :39], image[:, -39:] = 255, 255
    assert HighlightMeter(lens_from_config(fisheye)).read(image) == 60
