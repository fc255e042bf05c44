"""A shadow's edge across a small landmark is found where it was drawn, and taken out of the picture again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.vision.candidates import confirm_relit, confirm_small
from app.vision.patch import rectify
from app.vision.picture import check_picture
from app.vision.refusal import Rejection
from app.vision.relight import find_shadow_edge, relit
from app.vision.template import PATCH, PATCH_EXTENT
from app.vision.verdict import Found

T3, T4, S5 = 2, 3, 4
PATCH_HALF_M = 0.5 * PATCH_EXTENT * 0.38


def edge_light(shade, angle_deg=25.0, offset_m=0.03):
    """A light of 1 on the far side of a line on the pad, of `shade` before it."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return lambda p: np.where(c * p[..., 0] + s * p[..., 1] > offset_m, 1.0, shade)


def at_side(scene, side_px, **pose):
    return scene.view(scene.fisheye.f * 0.38 / side_px, **pose)


@pytest.mark.parametrize("shade", [0.2, 0.4, 0.65])
@pytest.mark.parametrize("side_px", [16, 24, 40, 100])
@pytest.mark.parametrize("angle_deg", [25, 100, -70, 180])
def test_edge_is_found_where_it_lies_and_as_dark_as_it_is(scene, maps, side_px, shade, angle_deg):
    view = at_side(scene, side_px)
    # The camera is straight over the pad and the pad's heading is its own: forward, right are the pad's.
    image = scene.draw(view, light=edge_light(shade, angle_deg))
    edge = find_shadow_edge(rectify(maps.look_at(image, scene.fisheye), maps.true(view)), maps.geometry)
    assert edge is not None
    off_deg = (math.degrees(edge.angle) - angle_deg + 180.0) % 360.0 - 180.0
    assert abs(off_deg) < (8.0 if side_px > 16 else 15.0)
    # In pixels; of a large landmark the patch has one cell for several.
    px_per_m, cell_px = side_px / 0.38, PATCH_EXTENT * side_px / PATCH
    assert edge.offset * PATCH_HALF_M * px_per_m == pytest.approx(0.03 * px_per_m, abs=max(0.8, 0.3 * cell_px))
    assert edge.contrast[0] / edge.contrast[1] == pytest.approx(shade, rel=0.12)


@pytest.mark.parametrize("side_px", [16, 40, 100])
def test_even_light_has_no_edge(scene, maps, side_px):
    view = at_side(scene, side_px, pad_yaw_deg=20)
    seen = maps.look_at(scene.draw(view), scene.fisheye)
    assert find_shadow_edge(rectify(seen, maps.true(view)), maps.geometry) is None


def test_map_that_leads_behind_the_camera_has_no_edge(scene, maps):
    view = at_side(scene, 40)
    seen = maps.look_at(scene.draw(view, light=edge_light(0.3)), scene.fisheye)
    assert find_shadow_edge(rectify(seen, -maps.true(view)), maps.geometry) is None
    assert isinstance(confirm_relit(-maps.true(view), seen), Rejection)


def test_what_is_no_landmark_has_no_edge(scene, maps):
    view = at_side(scene, 40)
    image = scene.draw(view, polygons=[], light=edge_light(0.3))
    assert find_shadow_edge(rectify(maps.look_at(image, scene.fisheye), maps.true(view)), maps.geometry) is None


def test_relit_picture_is_that_of_one_light(scene, maps):
    view = at_side(scene, 40, pad_yaw_deg=20)
    image = scene.draw(view, light=edge_light(0.3), noise=0.0)
    lit_all_over = scene.draw(view, noise=0.0)
    seen = maps.look_at(image, scene.fisheye)
    matrix = maps.true(view)
    edge = find_shadow_edge(rectify(seen, matrix), maps.geometry)
    after = rectify(relit(seen, matrix, edge), matrix)
    before = rectify(maps.look_at(lit_all_over, scene.fisheye), matrix)
    off = np.abs(after.grey - before.grey)[maps.geometry.judged]
    # Rounding of the dark side's greys is spread by 1 / 0.3, and a pixel on the line may be off by more.
    assert np.median(off) < 3.0
    assert np.percentile(off, 95) < 20.0
    assert check_picture(after, maps.geometry).rejection is None


def test_saturated_pixels_stay_saturated(scene, maps):
    view = at_side(scene, 60)
    light = edge_light(0.3)
    image = scene.draw(view, light=lambda p: 1.6 * light(p))
    seen = maps.look_at(image, scene.fisheye)
    edge = find_shadow_edge(rectify(seen, maps.true(view)), maps.geometry)
    after = relit(seen, maps.true(view), edge)
    u0, v0 = after.origin
    height, width = after.image.shape
    assert (image >= 254).any()
    np.testing.assert_array_equal(after.image >= 254, image[v0 : v0 + height, u0 : u0 + width] >= 254)


@pytest.mark.parametrize("shade", [0.2, 0.4])
@pytest.mark.parametrize("side_px", [18, 26, 40, 58])
def test_small_landmark_under_a_shadows_edge_is_confirmed_where_it_is(scene, maps, side_px, shade):
    view = at_side(scene, side_px, pad_yaw_deg=35, pitch_deg=5)
    seen = maps.look_at(scene.draw(view, light=edge_light(shade)), scene.fisheye)
    start = maps.off_by(view, 0.6, side_px, seed=3)
    assert isinstance(confirm_small(start, seen), Rejection)
    found = confirm_relit(start, seen)
    assert isinstance(found, Found), found.text
    assert maps.rms_px(found.rays_from_pad, view, scene.fisheye, [0]) < 0.3


@pytest.mark.parametrize("angle_deg", [0, 60, 90])
@pytest.mark.parametrize("off_axis_deg", [30, 45])
def test_edge_far_off_the_axis_is_straight_on_the_ground_and_not_in_the_image(scene, maps, off_axis_deg, angle_deg):
    """A fisheye bends it."""
    height_m = 1.1
    view = scene.view(height_m, forward_m=height_m * math.tan(math.radians(off_axis_deg)))
    seen = maps.look_at(scene.draw(view, light=edge_light(0.3, angle_deg)), scene.fisheye)
    found = confirm_relit(maps.true(view), seen)
    assert isinstance(found, Found), found.text
    assert maps.rms_px(found.rays_from_pad, view, scene.fisheye, [0]) < 0.3


@pytest.mark.parametrize("side_px", [30, 44, 58])
@pytest.mark.parametrize(
    "drawn",
    [{"upside_down": (T3,)}, {"upside_down": (T3, T4)}, {"without": (T3, T4, S5)}, {"without": (T4, S5)}],
    ids=str,
)
def test_another_drawing_under_a_shadows_edge_is_refused(scene, maps, changed, drawn, side_px):
    view = at_side(scene, side_px, pad_yaw_deg=35)
    image = scene.draw(view, polygons=changed(**drawn), light=edge_light(0.35))
    assert isinstance(confirm_relit(maps.true(view), maps.look_at(image, scene.fisheye)), Rejection)


def test_landmark_turned_under_a_shadows_edge_is_refused(scene, maps):
    view, turned = at_side(scene, 40), at_side(scene, 40, pad_yaw_deg=90)
    image = scene.draw(turned, light=edge_light(0.35))
    assert isinstance(confirm_relit(maps.true(view), maps.look_at(image, scene.fisheye)), Rejection)
