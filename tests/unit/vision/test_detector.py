"""The detector against images that an independent renderer draws from geometry."""

import numpy as np
import pytest

from app.config import VisionConfig
from app.errors import ImageError
from app.landmark import ContourSpec, Shape, build_landmark
from app.messages import Frame
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector
from app.vision.threshold import Search

SIX = build_landmark(
    "six",
    0.6,
    (
        ContourSpec(Shape.SQUARE, 1.0),
        ContourSpec(Shape.SQUARE, 0.6),
        ContourSpec(Shape.SQUARE, 0.38),
        ContourSpec(Shape.TRIANGLE, 0.1),
        ContourSpec(Shape.TRIANGLE, 0.045),
        ContourSpec(Shape.SQUARE, 0.009),
    ),
)
SQUARE_THEN_TRIANGLE = build_landmark(
    "two and a half",
    0.3,
    (ContourSpec(Shape.SQUARE, 1.0), ContourSpec(Shape.TRIANGLE, 0.3), ContourSpec(Shape.TRIANGLE, 0.12)),
)


def frame(image, sequence=0):
    return Frame(t_capture_s=sequence / 30, sequence=sequence, image=image, name="drawn")


def detector(scene, lens, landmark=None, **config):
    return Detector(landmark or scene.landmark, lens_from_config(lens.config), VisionConfig(**config))


def corner_errors_px(scene, detection, view, lens, landmark=None):
    return np.concatenate(
        [
            np.linalg.norm(c.corners_px - scene.corners_px(view, c.index, lens, landmark), axis=1)
            for c in detection.contours
        ]
    )


@pytest.mark.parametrize("height_m", [0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0])
def test_fisheye_still_at_each_height_has_its_corners_to_a_third_of_a_pixel(scene, height_m):
    view = scene.view(height_m, forward_m=0.15 * height_m, right_m=-0.1 * height_m, pad_yaw_deg=25, roll_deg=4)
    found = detector(scene, scene.fisheye).detect(frame(scene.draw(view)), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, scene.fisheye).max() < 0.34


@pytest.mark.parametrize("height_m", [0.5, 1.0, 2.0, 4.0, 7.0, 10.0])
def test_pinhole_still_at_each_height_has_its_corners_to_a_third_of_a_pixel(scene, height_m):
    view = scene.view(height_m, forward_m=0.02 * height_m, right_m=0.04 * height_m, pad_yaw_deg=-70, pitch_deg=3)
    found = detector(scene, scene.pinhole).detect(frame(scene.draw(view, lens=scene.pinhole)), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, scene.pinhole).max() < 0.34


@pytest.mark.parametrize("pad_yaw_deg", [0, 45, 91, 135, 180, 225, 270, 313])
@pytest.mark.parametrize("height_m", [0.6, 3.5])
def test_heading_is_settled_whatever_the_yaw(scene, height_m, pad_yaw_deg):
    view = scene.view(height_m, pad_yaw_deg=pad_yaw_deg, roll_deg=3)
    found = detector(scene, scene.fisheye).detect(frame(scene.draw(view)), still=True)
    outer = next(c.corners_px for c in found.contours if c.index == 0)
    np.testing.assert_allclose(outer, scene.corners_px(view, 0, scene.fisheye), atol=0.5)


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(35, 0), (-35, 0), (0, 35), (0, -35), (25, -25)])
@pytest.mark.parametrize("height_m", [0.4, 2.5])
def test_tilt_of_the_vehicle_does_not_hide_the_landmark(scene, height_m, roll_deg, pitch_deg):
    view = scene.view(height_m, pad_yaw_deg=10, roll_deg=roll_deg, pitch_deg=pitch_deg)
    found = detector(scene, scene.fisheye).detect(frame(scene.draw(view)), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, scene.fisheye).max() < 0.5


@pytest.mark.parametrize(("forward_m", "right_m"), [(0.17, 0.0), (0.0, 0.25), (-0.17, 0.05)])
def test_landmark_cut_by_the_image_is_read_from_its_inner_contours(scene, forward_m, right_m):
    view = scene.view(0.6, forward_m=forward_m, right_m=right_m, pad_yaw_deg=20)
    image = scene.draw(view, lens=scene.pinhole)
    found = detector(scene, scene.pinhole).detect(frame(image), still=True)
    assert found.detected, found.reason
    assert found.contours[0].index > 0
    assert found.code in scene.landmark.code
    assert corner_errors_px(scene, found, view, scene.pinhole).max() < 1.0


def test_innermost_pair_alone_is_enough_close_to_the_ground(scene):
    view = scene.view(0.16, forward_m=0.03, pad_yaw_deg=-35)
    found = detector(scene, scene.pinhole).detect(frame(scene.draw(view, lens=scene.pinhole)), still=True)
    assert found.detected, found.reason
    assert found.code in {"34", "334"}
    assert corner_errors_px(scene, found, view, scene.pinhole).max() < 1.0


def test_sides_bent_by_the_fisheye_at_its_edge_are_straight_enough(scene):
    view = scene.view(0.35, forward_m=0.25, right_m=0.3, pad_yaw_deg=60)
    found = detector(scene, scene.fisheye).detect(frame(scene.draw(view)), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, scene.fisheye).max() < 0.5


def test_distorted_pinhole_lens_finds_the_pose_that_was_drawn(scene):
    lens = type(scene.pinhole)("pinhole", 350.0, k=(-0.2, 0.05, 0.0, 0.0))
    view = scene.view(0.8, forward_m=0.25, right_m=0.3, pad_yaw_deg=15)
    found = detector(scene, lens).detect(frame(scene.draw(view, lens=lens)), still=True)
    app_lens = lens_from_config(lens.config)
    corners = scene.landmark.contours[0].corners_m
    truth, _ = app_lens.project(np.column_stack([corners, np.zeros(4)]) @ view.rotation.T + view.t)
    np.testing.assert_allclose(found.contours[0].corners_px, truth, atol=0.3)


@pytest.mark.parametrize("landmark", [SIX, SQUARE_THEN_TRIANGLE], ids=["six contours", "three contours"])
@pytest.mark.parametrize("height_m", [0.8, 2.5])
def test_pad_of_the_users_own_is_found(scene, landmark, height_m):
    view = scene.view(height_m, forward_m=0.2, pad_yaw_deg=75, roll_deg=6)
    image = scene.draw(view, landmark=landmark)
    found = detector(scene, scene.fisheye, landmark).detect(frame(image), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, scene.fisheye, landmark).max() < 0.5


# ------------------------------------------------------------------------------------------------ what it must not see
def decoys(scene):
    polygons = scene.polygons()
    upside_down = (polygons[3][0] * [-1.0, 1.0], polygons[3][1])
    inner_upside_down = (polygons[4][0] * [-1.0, 1.0] * 0.6, polygons[4][1])
    inner_square = (polygons[2][0] * 0.5, polygons[1][1] * 0 + 25.0)
    return {
        "lawn": [],
        "square in square": polygons[:3],
        "three squares": [*polygons[:3], inner_square],
        "inverted colours": scene.polygons(inverted=True),
        "outer triangle upside down": [*polygons[:3], upside_down, inner_upside_down, polygons[5]],
        "triangle without its inside": [*polygons[:2], polygons[3]],
    }


@pytest.mark.parametrize("height_m", [0.5, 1.2, 3.0])
@pytest.mark.parametrize(
    "decoy", ["lawn", "square in square", "three squares", "inverted colours", "triangle without its inside"]
)
def test_decoy_is_refused_with_a_reason(scene, decoy, height_m):
    view = scene.view(height_m, forward_m=0.1, pad_yaw_deg=30, roll_deg=5)
    image = scene.draw(view, polygons=decoys(scene)[decoy])
    found = detector(scene, scene.fisheye).detect(frame(image), still=True)
    assert not found.detected
    assert found.reason
    assert (found.code, found.score, found.contours) == (None, 0.0, ())


@pytest.mark.parametrize("height_m", [0.5, 1.2])
def test_landmark_with_its_outer_triangle_upside_down_is_refused(scene, height_m):
    image = scene.draw(scene.view(height_m), polygons=decoys(scene)["outer triangle upside down"])
    assert not detector(scene, scene.fisheye).detect(frame(image), still=True).detected


def test_flat_image_is_refused_for_having_no_dark_square(scene):
    found = detector(scene, scene.fisheye).detect(frame(np.full((480, 640), 120, np.uint8)), still=True)
    assert found.reason is not None
    assert "no dark square" in found.reason


def test_square_in_square_is_refused_for_what_it_lacks_inside(scene):
    image = scene.draw(scene.view(1.0), polygons=decoys(scene)["square in square"], lawn=False)
    found = detector(scene, scene.fisheye).detect(frame(image), still=True)
    assert found.reason is not None
    assert "correlation inside the contours found" in found.reason


def test_wrong_area_ratio_is_named_with_its_limits(scene):
    polygons = scene.polygons()
    smaller = (polygons[2][0] * 0.62, polygons[2][1])
    image = scene.draw(scene.view(1.0), polygons=[polygons[0], polygons[1], smaller], lawn=False)
    found = detector(scene, scene.fisheye).detect(frame(image), still=True)
    assert found.reason is not None
    # The true ratio is 2 / 0.62^2 = 5.2.
    assert found.reason.startswith("area ratio S1:S2 5.")
    assert "outside" in found.reason


def test_landmark_smaller_than_the_limit_is_refused_for_its_side(scene):
    view = scene.view(2.5)
    found = detector(scene, scene.fisheye, min_side_px=40).detect(frame(scene.draw(view, lawn=False)), still=True)
    assert not found.detected


def test_image_of_another_size_is_an_error_that_names_both(scene):
    with pytest.raises(ImageError, match=r"drawn: 320x240 pixels, the camera file says 640x480"):
        detector(scene, scene.fisheye).detect(frame(np.zeros((240, 320), np.uint8)))


# ---------------------------------------------------------------------------------------------------- in a sequence
def approach(scene, count, gain=lambda k: 1.0):
    for k in range(count):
        view = scene.view(2.0 - 0.02 * k, forward_m=0.3 - 0.02 * k, right_m=0.01 * k, pad_yaw_deg=2 * k, roll_deg=3)
        yield view, frame(scene.draw(view, gain=gain(k), seed=k), k)


def test_sequence_keeps_to_a_region_round_the_landmark(scene):
    seeing = detector(scene, scene.fisheye)
    found = [seeing.detect(one) for _, one in approach(scene, 6)]
    assert [d.detected for d in found] == [True] * 6
    u0, v0, u1, v1 = found[-1].roi_px
    assert (u1 - u0) * (v1 - v0) < 0.2 * 640 * 480


def test_sequence_is_as_exact_as_a_still(scene):
    seeing = detector(scene, scene.fisheye)
    errors = [
        corner_errors_px(scene, seeing.detect(one), view, scene.fisheye).max() for view, one in approach(scene, 6)
    ]
    assert max(errors) < 0.3


@pytest.mark.parametrize("factor", [1 / 3, 0.5, 1.15])
def test_step_of_brightness_does_not_end_the_track(scene, factor):
    seeing = detector(scene, scene.fisheye)
    found = [seeing.detect(one).detected for _, one in approach(scene, 9, lambda k: 1.0 if k < 3 else factor)]
    assert found[:3] == [True] * 3
    assert found[-4:] == [True] * 4


def test_slow_dusk_is_followed_by_the_threshold(scene):
    seeing = detector(scene, scene.fisheye)
    found = [seeing.detect(one) for _, one in approach(scene, 12, lambda k: 0.85**k)]
    assert [d.detected for d in found] == [True] * 12
    assert found[-1].threshold < 0.5 * found[1].threshold


def test_landmark_out_of_sight_leads_through_the_levels_of_search(scene):
    seeing = detector(scene, scene.fisheye, misses_before_sweep=1, sweeps_before_wide=1, wide_sweeps_before_lost=1)
    _, first = next(approach(scene, 1))
    lawn = scene.draw(scene.view(2.0), polygons=[])
    seeing.detect(first)
    seen = [seeing.threshold.search]
    regions = []
    for k in range(40):
        regions.append(seeing.detect(frame(lawn, k)).roi_px)
        if seeing.threshold.search is not seen[-1]:
            seen.append(seeing.threshold.search)
    assert seen[:4] == [Search.TRACK, Search.SWEEP, Search.WIDE, Search.FRESH]
    assert regions[0] is not None
    assert regions[5] is None


def test_landmark_that_comes_back_far_away_is_found_again(scene):
    seeing = detector(scene, scene.fisheye)
    near = scene.draw(scene.view(2.0, forward_m=1.0, right_m=1.0))
    away = scene.draw(scene.view(2.0, forward_m=-1.2, right_m=-1.5))
    assert seeing.detect(frame(near)).detected
    found = [seeing.detect(frame(away, k)).detected for k in range(1, 12)]
    assert any(found)


def test_predicted_position_moves_the_region(scene):
    seeing = detector(scene, scene.fisheye)
    seeing.detect(frame(scene.draw(scene.view(2.0, forward_m=1.0, right_m=1.0))))
    view = scene.view(2.0, forward_m=-1.2, right_m=-1.5)
    middle = scene.corners_px(view, 0, scene.fisheye).mean(axis=0)
    found = seeing.detect(frame(scene.draw(view), 1), predicted_px=(float(middle[0]), float(middle[1])))
    assert found.detected, found.reason
    assert found.roi_px is not None


def test_reset_forgets_the_sequence(scene):
    seeing = detector(scene, scene.fisheye)
    (_, first), (_, second) = approach(scene, 2)
    seeing.detect(first)
    seeing.reset()
    assert seeing.detect(second).roi_px is None


def test_shadow_edge_over_the_landmark_does_not_hide_it(scene):
    view = scene.view(1.0, forward_m=0.1, pad_yaw_deg=20)
    image = scene.draw(view, light=lambda p: np.where(p[..., 0] + 0.3 * p[..., 1] > 0.05, 1.0, 0.62))
    found = detector(scene, scene.fisheye).detect(frame(image), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, scene.fisheye).max() < 1.0


def test_colour_image_gives_what_its_grey_gives(scene):
    view = scene.view(1.0, forward_m=0.1, pad_yaw_deg=20)
    grey = scene.draw(view)
    colour = np.repeat(grey[..., None], 3, axis=2)
    found = [detector(scene, scene.fisheye).detect(frame(image), still=True) for image in (grey, colour)]
    assert found[1].detected
    np.testing.assert_allclose(found[1].contours[0].corners_px, found[0].contours[0].corners_px, atol=0.05)


@pytest.mark.parametrize("height_m", [0.5, 6.0])
def test_image_of_twice_the_size_is_searched_at_both_resolutions(scene, height_m):
    lens = type(scene.fisheye)("equidistant", 430.0, 1280, 960, 639.5, 479.5)
    view = scene.view(height_m, forward_m=0.1, pad_yaw_deg=20)
    found = detector(scene, lens).detect(frame(scene.draw(view, lens=lens)), still=True)
    assert found.detected, found.reason
    assert corner_errors_px(scene, found, view, lens).max() < 0.5
