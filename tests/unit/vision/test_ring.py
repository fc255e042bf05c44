"""Landmarks of which a corner of the ring shows: hypotheses from its four lines come within reach of the edges."""

import cv2
import numpy as np
import pytest

from app.config import VisionConfig
from app.messages import Frame
from app.vision.candidates import RING_REACHES_PX, confirm_ring
from app.vision.contours import contour_tree
from app.vision.detector import Detector
from app.vision.partial import outlines
from app.vision.preprocess import binarise, global_otsu, prepare, whole
from app.vision.ring import MAX_RINGS, rings
from app.vision.verdict import Found


def rings_of(maps, image, lens, reduction=1):
    prepared = prepare(image, whole(image), reduction=reduction)
    binary = binarise(prepared.smooth, global_otsu(image))
    look = maps.look_at(image, lens)
    return rings(outlines(contour_tree(binary), prepared, look), look), look


def worst_px(maps, ring, view, lens):
    """In its best turn, how far those corners of its two contours that lie in the image are from the truth."""
    turned = [ring.rays_from_pad @ turn for turn in maps.geometry.turns_about(ring.contour)]
    pair = [ring.contour, ring.contour + 1]
    return min(maps.distances_px(m, view, lens, pair).max(initial=0.0) for m in turned)


# A pinhole of 495 px sees 0.48 of the height to the front and 0.65 to the right.
@pytest.mark.parametrize("reduction", [1, 2])
@pytest.mark.parametrize("yaw_deg", [0, 30, 100, 200])
@pytest.mark.parametrize(("forward_m", "right_m"), [(0.30, 0.40), (-0.32, 0.38), (0.28, -0.42)])
def test_landmark_in_the_images_corner_has_a_hypothesis_within_reach(
    scene, maps, forward_m, right_m, yaw_deg, reduction
):
    view = scene.view(0.7, forward_m=forward_m, right_m=right_m, pad_yaw_deg=yaw_deg)
    found, _ = rings_of(maps, scene.draw(view, lens=scene.pinhole, lawn=False), scene.pinhole, reduction)
    assert 0 < len(found) <= MAX_RINGS
    assert {ring.contour for ring in found} <= {0, 2}
    assert min(worst_px(maps, ring, view, scene.pinhole) for ring in found) < RING_REACHES_PX[0]


@pytest.mark.parametrize(("roll_deg", "right_m"), [(0, 0.4), (-20, 0.6), (-10, 0.4), (20, -0.2)])
def test_hypothesis_from_a_corner_leads_to_the_landmark(scene, maps, roll_deg, right_m):
    view = scene.view(0.7, forward_m=0.30, right_m=right_m, pad_yaw_deg=30, roll_deg=roll_deg)
    found, look = rings_of(maps, scene.draw(view, lens=scene.pinhole), scene.pinhole)
    confirmed = [r for r in (confirm_ring(ring, look) for ring in found) if isinstance(r, Found)]
    assert confirmed
    assert maps.rms_px(confirmed[0].rays_from_pad, view, scene.pinhole) < 0.15


def test_square_alone_gives_no_ring(scene, maps, changed):
    view = scene.view(0.7, forward_m=0.1)
    alone = scene.draw(view, lens=scene.pinhole, polygons=changed(without=(1, 2, 3, 4)), lawn=False)
    assert rings_of(maps, alone, scene.pinhole)[0] == []


def test_corners_in_the_outlines_are_the_drawings(scene, maps):
    view = scene.view(1.0, pad_yaw_deg=20)
    image = scene.draw(view, lens=scene.pinhole, lawn=False)
    found, _ = rings_of(maps, image, scene.pinhole)
    outer, inner = (scene.corners_px(view, k, scene.pinhole) for k in (0, 1))
    for ring in found:
        assert np.linalg.norm(outer - ring.outline_px[0], axis=1).min() < 2.5
        assert np.linalg.norm(inner - ring.outline_px[1], axis=1).min() < 2.5
        # The same corner of both.
        assert np.linalg.norm(outer - ring.outline_px[0], axis=1).argmin() == (
            np.linalg.norm(inner - ring.outline_px[1], axis=1).argmin()
        )


# Poses of which the detector without these hypotheses finds none: no side shows from corner to corner. The last four
# are close up, with a corner of the triangles.
@pytest.mark.parametrize(
    ("height_m", "forward_m", "right_m", "yaw_deg", "roll_deg", "pitch_deg"),
    [
        (0.761, 0.340, -0.513, 112.3, -1.2, 5.2),
        (0.416, -0.200, 0.243, 53.3, 6.9, -6.9),
        (0.604, -0.305, 0.407, 34.8, -8.0, -0.7),
        (0.555, 0.275, -0.339, 300.5, 6.5, -3.5),
        (0.841, -0.420, 0.506, 317.0, 2.9, -3.7),
        (0.210, 0.016, -0.146, 110.3, 1.3, 4.7),
        (0.166, 0.011, 0.104, 228.5, -4.7, -7.3),
        (0.148, -0.132, 0.002, 236.9, 4.3, -6.3),
        (0.167, 0.145, -0.042, 70.5, -2.7, 6.4),
    ],
)
def test_landmark_cut_by_the_images_corner_is_found(
    scene, maps, height_m, forward_m, right_m, yaw_deg, roll_deg, pitch_deg
):
    view = scene.view(
        height_m,
        forward_m=forward_m,
        right_m=right_m,
        pad_yaw_deg=yaw_deg,
        roll_deg=roll_deg,
        pitch_deg=pitch_deg,
    )
    detector = Detector(scene.landmark, maps.lens(scene.pinhole), VisionConfig())
    found = detector.detect(Frame(0.0, 0, scene.draw(view, lens=scene.pinhole)), still=True)
    assert found.detected
    assert maps.rms_px(found.plane.rays_from_pad, view, scene.pinhole) < 0.3


def test_corners_follow_each_other_round_a_contour_with_a_blade_of_grass(maps, scene):
    """The contour runs up one side of the blade and down the other: it passes each of its pixels twice."""
    black = np.zeros((480, 640), np.uint8)
    black[200:280, 300:380] = 255
    black[212:268, 312:368] = 0
    cv2.line(black, (340, 199), (352, 120), 255, 1)
    look = maps.look_at(255 - black, scene.pinhole)
    (outer, *_) = outlines(contour_tree(black), prepare(look.image, whole(look.image)), look)
    ahead = np.diff(outer.index, append=outer.index[0] + len(outer.points)) % len(outer.points)
    assert (ahead > 0).all()
    assert ahead.sum() == len(outer.points)
    expected = [[300, 200], [380, 200], [380, 280], [300, 280]]  # edges of its pixels; contours run half a pixel in
    assert np.linalg.norm(outer.px[:, None] - expected, axis=2).min(axis=0).max() < 3.0
