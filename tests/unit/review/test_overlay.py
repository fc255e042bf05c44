"""What is drawn on a camera image, and where: pixels against the geometry of a camera that looks straight down."""

import numpy as np
import pytest

from app.messages import CameraPose, Detection, SeenContour
from app.review.overlay import AXES, COLOURS, PAPER, draw_line, draw_overlay, to_colour, write_lines
from app.vision.camera_model import lens_from_config

F_PX, CX, CY = 495.0, 319.5, 239.5
HEIGHT_M = 2.0
GREY = 90


@pytest.fixture(scope="module")
def lens(scene):
    return lens_from_config(scene.pinhole.config)


@pytest.fixture(scope="module")
def pose():
    """The pad 2 m below the image's centre, its forward axis to the image's right, its right axis down."""
    return CameraPose(np.array([0.0, 0.0, HEIGHT_M]), np.array([1.0, 0.0, 0.0, 0.0]), np.eye(6) * 1e-6, 0.1)


@pytest.fixture
def blank():
    return np.full((480, 640), GREY, np.uint8)


def at(canvas, forward_m, right_m, height_m=0.0):
    """The pixel at a point of the pad's frame."""
    scale = F_PX / (HEIGHT_M - height_m)
    return canvas[round(CY + scale * right_m), round(CX + scale * forward_m)].astype(int)


def near(pixel, colour):
    return np.abs(pixel - np.array(colour)).max() < 100 and np.ptp(pixel) > 40


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 3)])
def test_colour_image_of_grey_or_bgr_is_a_bgr_copy(shape):
    image = np.full(shape, 7, np.uint8)
    colour = to_colour(image)
    assert colour.shape == (4, 5, 3) and (colour == 7).all()
    colour[:] = 0
    assert (image == 7).all()


def test_overlay_of_a_frame_with_nothing_in_it_is_that_frame(blank, lens, scene):
    canvas = draw_overlay(blank, Detection(0.0, 0), None, lens, scene.landmark)
    assert (canvas == GREY).all()


def test_overlay_lays_the_drawing_over_the_pad(blank, lens, scene, pose):
    canvas = draw_overlay(blank, Detection(0.0, 0), pose, lens, scene.landmark)
    half = scene.landmark.size_m / 2
    sides = [at(canvas, side * half, along * half) for side in (-1, 1) for along in (-0.5, 0.5)]
    sides += [at(canvas, along * half, side * half) for side in (-1, 1) for along in (-0.5, 0.5)]
    np.testing.assert_allclose(sides, [PAPER] * 8, atol=80)  # a thin line may share its light with the next pixel
    np.testing.assert_array_equal(at(canvas, 1.2 * half, 1.2 * half), [GREY] * 3)


def test_overlay_axes_point_forward_and_right(blank, lens, scene, pose):
    canvas = draw_overlay(blank, Detection(0.0, 0), pose, lens, scene.landmark)
    x, y, _ = (colour for _, _, colour in AXES)
    length = 0.5 * scene.landmark.size_m
    assert near(at(canvas, 0.55 * length, 0.0), x)
    assert near(at(canvas, 0.0, 0.55 * length), y)
    assert not near(at(canvas, -0.55 * length, 0.0), x)


def test_overlay_rings_each_corner_that_was_seen_in_the_colour_of_its_contour(blank, lens, scene):
    seen = SeenContour(1, np.array([[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]]))
    canvas = draw_overlay(blank, Detection(0.0, 0, (seen,), "4"), None, lens, scene.landmark).astype(int)
    ring = [canvas[100, 96], canvas[96, 200], canvas[204, 200], canvas[200, 104]]
    np.testing.assert_allclose(ring, [COLOURS[1]] * 4, atol=60)


def test_overlay_frames_the_region_that_was_searched(blank, lens, scene):
    canvas = draw_overlay(blank, Detection(0.0, 0, roi_px=(10, 20, 110, 220)), None, lens, scene.landmark)
    edge = [canvas[20, 60], canvas[219, 60], canvas[120, 10], canvas[120, 109]]
    np.testing.assert_array_equal(edge, [[120] * 3] * 4)
    assert (canvas[21:219, 11:109] == GREY).all()


def test_overlay_of_a_pad_behind_the_camera_draws_nothing(blank, lens, scene):
    behind = CameraPose(np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0, 0.0]), np.eye(6), 0.1)
    canvas = draw_overlay(blank, Detection(0.0, 0), behind, lens, scene.landmark)
    assert (canvas == GREY).all()


def test_overlay_beside_the_image_draws_nothing_and_does_not_fail(blank, lens, scene):
    beside = CameraPose(np.array([50.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0]), np.eye(6), 0.1)
    canvas = draw_overlay(blank, Detection(0.0, 0), beside, lens, scene.landmark)
    assert (canvas == GREY).all()


@pytest.mark.parametrize("points", [[[5.0, 5.0]], [[5.0, 5.0], [np.nan, 9.0]], np.zeros((0, 2))])
def test_line_of_one_point_or_unknown_points_draws_nothing(points):
    canvas = np.zeros((20, 20, 3), np.uint8)
    draw_line(canvas, np.array(points), (255, 255, 255))
    assert not canvas.any()


def test_lines_of_text_are_bright_on_a_dark_rim_in_the_upper_left_corner():
    canvas = np.full((120, 320, 3), 128, np.uint8)
    write_lines(canvas, [("landed", (255, 255, 255)), ("at last", (190, 230, 255))])
    corner = canvas[:60, :120]
    assert (corner.min(axis=2) > 240).any() and (corner.max(axis=2) < 15).any()
    assert (canvas[70:] == 128).all() and (canvas[:, 200:] == 128).all()
