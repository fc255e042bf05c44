import cv2
import numpy as np
import pytest

from app.config import LensConfig
from app.landmark import paper_landmark
from app.vision.camera_model import lens_from_config
from app.vision.contours import contour_tree, likely_pairs, nests
from app.vision.geometry import LandmarkGeometry
from app.vision.preprocess import binarise, prepare, whole
from app.vision.refusal import Refusal

LENS = lens_from_config(
    LensConfig(model="pinhole", width_px=320, height_px=240, fx_px=300, fy_px=300, cx_px=159.5, cy_px=119.5)
)
GEOMETRY = LandmarkGeometry(paper_landmark())


def canvas():
    return np.full((240, 320), 220, np.uint8)


def box(image, corner, size, grey):
    cv2.rectangle(image, corner, (corner[0] + size - 1, corner[1] + size - 1), grey, -1)


@pytest.fixture
def square_in_square():
    """Black from 100 to 139 across and 60 to 99 down; white from 106 to 133 and 66 to 93 in it."""
    image = canvas()
    box(image, (100, 60), 40, 20)
    box(image, (106, 66), 28, 220)
    return image


def found_in(image):
    prepared = prepare(image, whole(image), sigma_px=0.0)
    return nests(prepared, contour_tree(binarise(prepared.smooth, 120)), GEOMETRY, LENS, 10.0)


def test_tree_tells_black_from_white_and_who_lies_in_whom(square_in_square):
    tree = contour_tree(binarise(square_in_square, 120))
    outer = int(np.flatnonzero(tree.parent < 0)[0])
    inner = int(np.flatnonzero(tree.parent == outer)[0])
    assert (tree.black_inside[outer], tree.black_inside[inner]) == (True, False)
    assert tree.length[outer] == 4 * 39


def test_empty_image_has_no_contours():
    assert len(contour_tree(np.zeros((20, 20), np.uint8)).length) == 0


def test_nest_of_two_squares_has_its_corners_on_their_edges(square_in_square):
    (nest,) = found_in(square_in_square)
    assert nest.outermost_black
    assert [p.corner_count for p in nest.polygons] == [4, 4]
    # Pixel centres are at whole numbers: pixels 100 to 139 reach from 99.5 to 139.5.
    outer, inner = (np.sort(p.corners_px, axis=0) for p in nest.polygons)
    np.testing.assert_allclose(outer, [[99.5, 59.5], [99.5, 59.5], [139.5, 99.5], [139.5, 99.5]], atol=0.1)
    # The border of a hole runs through black pixels and cuts its corners by one of them.
    np.testing.assert_allclose(inner, [[105.5, 65.5], [105.5, 65.5], [133.5, 93.5], [133.5, 93.5]], atol=1.1)


def test_corners_run_clockwise_as_seen(square_in_square):
    corners = found_in(square_in_square)[0].polygons[0].corners_px
    u, v = corners.T
    assert 0.5 * float(u @ np.roll(v, -1) - v @ np.roll(u, -1)) > 0  # v points down: positive is clockwise


def test_speck_in_a_large_square_is_no_pair():
    image = canvas()
    box(image, (60, 40), 160, 20)
    box(image, (130, 100), 8, 220)
    tree = contour_tree(binarise(image, 120))
    assert len(likely_pairs(tree, GEOMETRY, 10.0)) == 0


def test_square_at_the_border_is_refused_for_that():
    image = canvas()
    box(image, (-20, 60), 80, 20)
    box(image, (2, 72), 46, 220)
    (nest,) = found_in(image)
    assert nest.polygons[0].rejection.test is Refusal.CUT_BY_BORDER


def test_disc_is_refused_for_its_corners():
    image = canvas()
    cv2.circle(image, (160, 120), 60, 20, -1)
    cv2.circle(image, (160, 120), 42, 220, -1)
    (nest,) = found_in(image)
    assert nest.polygons[0].corner_count == 0
    assert nest.polygons[0].rejection.test in {Refusal.CORNERS, Refusal.NOT_CONVEX}


def test_nests_come_the_largest_first(square_in_square):
    box(square_in_square, (20, 20), 30, 20)
    box(square_in_square, (25, 25), 20, 220)
    assert [n.polygons[0].length_px for n in found_in(square_in_square)] == [4 * 39, 4 * 29]
