"""Landmarks cut by the image's border: hypotheses from single sides come within reach of the edges."""

import numpy as np
import pytest

from app.vision.candidates import PARTIAL_REACHES_PX
from app.vision.contours import contour_tree
from app.vision.partial import outlines, readings, sides
from app.vision.preprocess import binarise, global_otsu, prepare, whole


def sides_of(maps, image, lens):
    prepared = prepare(image, whole(image))
    binary = binarise(prepared.smooth, global_otsu(image))
    return sides(outlines(contour_tree(binary), prepared, maps.look_at(image, lens)))


def errors_px(maps, found, view, lens):
    """For each reading, in each of its turns, how far that contour's corners in the image lie from the truth."""
    return [
        maps.distances_px(start @ turned, view, lens, [k]).max(initial=0.0)
        for side in found
        for k, start in readings(side, maps.geometry)
        for turned in maps.geometry.turns_about(k)
        if len(maps.distances_px(start @ turned, view, lens, [k]))
    ]


# 0.29 of 0.6 m to the front lies the top border of the pinhole, 0.387 m to the right the right one.
@pytest.mark.parametrize("scale", [0.6, 1.0, 2.0])
@pytest.mark.parametrize(
    ("forward_m", "right_m", "yaw_deg"), [(0.29, 0.0, 0), (-0.29, 0.1, 15), (0.05, 0.387, 70), (0.0, -0.387, 190)]
)
def test_landmark_cut_in_half_has_a_hypothesis_within_reach(scene, maps, forward_m, right_m, yaw_deg, scale):
    view = scene.view(0.6 * scale, forward_m=forward_m * scale, right_m=right_m * scale, pad_yaw_deg=yaw_deg)
    image = scene.draw(view, lens=scene.pinhole)
    assert min(errors_px(maps, sides_of(maps, image, scene.pinhole), view, scene.pinhole)) < PARTIAL_REACHES_PX[0]


def test_whole_squares_sides_are_its_own(scene, maps):
    view = scene.view(1.0, pad_yaw_deg=20)
    found = sides_of(maps, scene.draw(view, lawn=False), scene.fisheye)
    outer = scene.corners_px(view, 0, scene.fisheye)
    longest = next(s for s in found if s.black and s.length_px == pytest.approx(81.7, abs=3.0))
    ends = longest.outline_px[1:3]
    assert np.abs(outer[:, None] - ends).max(axis=2).min(axis=0).max() < 2.5
    assert longest.whole == (True, True)
    # Straight below the camera a square has right angles.
    assert longest.angle_deg == pytest.approx(90.0, abs=6.0)


def test_sides_come_the_longest_first_and_few(scene, maps):
    found = sides_of(maps, scene.draw(scene.view(0.6, forward_m=0.2), lens=scene.pinhole), scene.pinhole)
    lengths = [s.length_px for s in found]
    assert lengths == sorted(lengths, reverse=True)
    assert 0 < len(lengths) <= 8


def test_side_with_the_angles_of_a_triangle_is_read_as_a_triangles(scene, maps):
    # At 0.2 m the squares reach out of the image on all sides; the triangle is 437 pixels high.
    found = sides_of(maps, scene.draw(scene.view(0.2), lens=scene.pinhole), scene.pinhole)
    pointed = [s for s in found if s.angle_deg < 61.9]
    assert pointed
    assert {k for s in pointed for k, _ in readings(s, maps.geometry)} <= {2, 3}


def test_flat_image_has_no_sides(scene, maps):
    assert sides_of(maps, np.full((480, 640), 120, np.uint8), scene.pinhole) == []
