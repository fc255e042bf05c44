"""Designs against a projection of one's own: where one is said to be met, a run is whole and large at every height."""

import dataclasses
import math
import tomllib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.config import PadConfig
from app.errors import ConfigError
from app.review.pad_design.advice import remedies, shortfalls
from app.review.pad_design.command import request_of
from app.review.pad_design.pad_file import pad_text
from app.review.pad_design.proposal import propose
from app.review.pad_design.view import view_of
from app.vision.camera_model import lens_from_config


def request(ceiling_m, floor_m, *, max_size_cm=200.0, detail_mm=1.0):
    return request_of(ceiling_m, floor_m, max_size_cm=max_size_cm, min_side_px=None, detail_mm=detail_mm)


def view(camera, *, tilt_deg=10.0, offset=0.2):
    return view_of(lens_from_config(camera.config), tilt_rad=math.radians(tilt_deg), offset=offset)


def is_seen(scene, camera, design, run, height_m, tilt_deg, off_m):
    """Whether a run's outermost contour is inside the image with 12 px sides, tilted and turned any way."""
    corners = design.landmark.contours[run.first].corners_m
    for turn in np.radians(np.arange(0, 360, 45)):
        for way in np.radians([20, 110, 200, 290]):
            at = scene.view(
                height_m,
                forward_m=off_m * math.cos(way),
                right_m=off_m * math.sin(way),
                pad_yaw_deg=math.degrees(2.3 * turn + way),
                roll_deg=tilt_deg * math.cos(turn),
                pitch_deg=tilt_deg * math.sin(turn),
            )
            points = np.column_stack([corners, np.zeros(len(corners))]) @ at.rotation.T + at.t
            px = camera.project(points)
            sides = np.linalg.norm(px - np.roll(px, 1, axis=0), axis=1)
            inside = (
                (points[:, 2] > 0).all() and (px >= 0).all() and (px <= (camera.width - 1, camera.height - 1)).all()
            )
            if not inside or sides.min() < 12.0:
                return False
    return True


def test_the_papers_own_landmark_comes_out_where_it_suffices(scene):
    design = propose(view(scene.fisheye), request(5.0, 0.3, max_size_cm=38.0))
    assert design.is_met
    assert design.landmark.size_m == 0.38
    assert design.landmark.quiet_zone_m == 0.46
    np.testing.assert_allclose(
        np.concatenate([c.corners_m for c in design.landmark.contours]),
        np.concatenate([c.corners_m for c in scene.landmark.contours]),
        atol=1e-9,
    )


def test_a_lower_floor_takes_more_contours_and_a_higher_ceiling_a_larger_pad(scene):
    low, high = (propose(view(scene.fisheye), request(*range_m)) for range_m in ((12.0, 0.1), (12.0, 0.3)))
    assert low.is_met and high.is_met
    assert len(low.specs) > len(high.specs) == 5
    assert high.landmark.size_m > 0.7  # 12 px at 12 m through 201 px for 1 m at 1 m: 0.717 m


@given(
    model=st.sampled_from(["pinhole", "equidistant"]),
    focal_px=st.floats(200.0, 900.0),
    ceiling_m=st.floats(0.8, 40.0),
    ratio=st.floats(2.0, 150.0),
    tilt_deg=st.floats(0.0, 12.0),
    offset=st.floats(0.0, 0.4),
    max_size_cm=st.floats(10.0, 500.0),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_design_covers_what_was_asked_for_or_says_what_it_does_not(
    scene, model, focal_px, ceiling_m, ratio, tilt_deg, offset, max_size_cm
):
    camera = dataclasses.replace(scene.fisheye, model=model, f=focal_px)
    floor_m = ceiling_m / ratio
    try:
        sight = view(camera, tilt_deg=tilt_deg, offset=offset)
        design = propose(sight, request(ceiling_m, floor_m, max_size_cm=max_size_cm))
    except ConfigError:
        assert model == "pinhole"  # the narrowest views: no run is in view and large at once
        assert math.degrees(math.atan(236.5 / focal_px)) - tilt_deg < 4.0
        return
    assert design.landmark.size_m <= max_size_cm / 100.0 + 1e-9
    assert (shortfalls(design) == ()) is design.is_met
    if not design.is_met:
        return
    for height_m in np.geomspace(floor_m, ceiling_m, 9):
        off_m = offset * math.tan(sight.usable_rad) * height_m
        assert any(
            is_seen(scene, camera, design, run, height_m, tilt_deg, off_m)
            for run in design.runs
            if run.from_m <= height_m <= run.to_m
        ), height_m


@given(
    focal_px=st.floats(200.0, 600.0),
    ceiling_m=st.floats(0.8, 40.0),
    ratio=st.floats(2.0, 150.0),
    max_size_cm=st.floats(10.0, 500.0),
)
@settings(max_examples=40, deadline=None)
def test_a_design_is_the_same_when_it_is_read_back_from_its_file(scene, focal_px, ceiling_m, ratio, max_size_cm):
    camera = dataclasses.replace(scene.fisheye, f=focal_px)
    design = propose(view(camera), request(ceiling_m, ceiling_m / ratio, max_size_cm=max_size_cm))
    text = pad_text(design, "some camera")
    landmark = PadConfig.model_validate(tomllib.loads(text)).landmark()
    assert (landmark.name, landmark.code) == (design.landmark.name, design.landmark.code)
    assert landmark.quiet_zone_m == pytest.approx(design.landmark.quiet_zone_m, abs=1e-6)
    for read, made in zip(landmark.contours, design.landmark.contours, strict=True):
        np.testing.assert_allclose(read.corners_m, made.corners_m, atol=1e-6)


def test_a_pad_that_is_too_small_for_the_ceiling_says_so_and_what_would_do(scene):
    sight = view(scene.fisheye)
    wanted = request(12.0, 0.3, max_size_cm=38.0)
    design = propose(sight, wanted)
    (words,) = shortfalls(design)
    # 201 px for 1 m at 1 m (see test_view): 38 cm are 12 px at 6.36 m, and 6.4 px at 12 m.
    assert "ceiling of 12 m is out of reach: a pad of 38 cm is seen up to 6.36 m" in words
    assert "6.4 px, under 12 px" in words
    advice = dict(
        words.split(": ") for words in remedies(design, lambda t, o: view_of_lens(scene, t, o)) if ": --" in words
    )
    assert set(advice) >= {"a larger pad", "a lower ceiling"}
    larger = float(advice["a larger pad"].removeprefix("--max-size-cm "))
    lower = float(advice["a lower ceiling"].removeprefix("--ceiling "))
    assert propose(sight, request(12.0, 0.3, max_size_cm=larger)).is_met
    assert propose(sight, request(lower, 0.3, max_size_cm=38.0)).is_met
    assert larger == pytest.approx(76, abs=1.5)  # 5% of headroom over 71.7 cm


def view_of_lens(scene, tilt_rad, offset):
    return view_of(lens_from_config(scene.fisheye.config), tilt_rad=tilt_rad, offset=offset)


def test_a_floor_out_of_reach_says_so_and_every_advice_holds(scene):
    sight = view(scene.pinhole)
    design = propose(sight, request(40.0, 0.1))
    (words,) = shortfalls(design)
    assert words.startswith("the floor of 0.1 m is out of reach: under 0.1")
    advice = remedies(design, lambda t, o: view_of(lens_from_config(scene.pinhole.config), tilt_rad=t, offset=o))
    floors = [float(words.rpartition(" ")[2]) for words in advice if "--floor" in words]
    assert len(floors) == 1
    assert propose(sight, request(40.0, floors[0])).is_met


def test_a_pad_too_small_to_print_says_so(scene):
    design = propose(view(scene.pinhole), request(2.0, 0.1, max_size_cm=5.0, detail_mm=8.0))
    assert any("finest line is" in words and "under the 8 mm" in words for words in shortfalls(design))


def test_a_met_design_needs_no_advice(scene):
    design = propose(view(scene.fisheye), request(5.0, 0.3))
    assert remedies(design, lambda t, o: view_of_lens(scene, t, o)) == ()
