"""What a camera sees of a pad, against the textbook's formulas of two lenses."""

import math

import numpy as np
import pytest

from app.config import LensConfig
from app.errors import ConfigError
from app.review.pad_design.view import half_angle_rad, view_of
from app.vision.camera_model import lens_from_config


def lens(model, focal_px, *, width=640, height=480, cx=None, cy=None, distortion=()):
    return lens_from_config(
        LensConfig(
            model=model,
            width_px=width,
            height_px=height,
            fx_px=focal_px,
            fy_px=focal_px,
            cx_px=(width - 1) / 2 if cx is None else cx,
            cy_px=(height - 1) / 2 if cy is None else cy,
            distortion=distortion,
        )
    )


# 239.5 px from the middle to the border's middle, less 3 px for a blurred edge.
@pytest.mark.parametrize(
    ("model", "focal_px", "expected_rad"),
    [("pinhole", 495.0, math.atan(236.5 / 495.0)), ("equidistant", 215.0, 236.5 / 215.0)],
)
def test_half_angle_is_that_of_the_nearest_border(model, focal_px, expected_rad):
    assert half_angle_rad(lens(model, focal_px)) == pytest.approx(expected_rad, rel=1e-6)


def test_half_angle_of_an_axis_off_the_middle_is_that_of_the_nearer_border():
    assert half_angle_rad(lens("pinhole", 500.0, cx=100.0)) == pytest.approx(math.atan(97.0 / 500.0), rel=1e-6)


def test_half_angle_ends_where_a_fisheyes_circle_does():
    # The radius 200 (theta - theta^3 / 3) turns back at theta = 1, 133.3 px from the middle: inside the image. A pixel
    # nearer, about as finely as it is looked for, it is 0.915.
    assert 0.915 < half_angle_rad(lens("equidistant", 200.0, distortion=(-1 / 3, 0.0, 0.0, 0.0))) <= 1.0


def test_reach_is_what_the_tilt_and_the_offset_leave():
    view = view_of(lens("pinhole", 495.0), tilt_rad=0.1, offset=0.25)
    assert view.reach == pytest.approx(0.75 * math.tan(math.atan(236.5 / 495.0) - 0.1), rel=1e-6)
    assert view.lowest_m(0.3) == pytest.approx(0.3 / view.reach)


def test_scale_of_a_pinhole_is_least_straight_below():
    view = view_of(lens("pinhole", 495.0), tilt_rad=math.radians(10), offset=0.2)
    assert view.scale_px == pytest.approx(495.0, rel=1e-6)
    assert view.highest_m(0.38, 12.0) == pytest.approx(495.0 * 0.38 / 12.0)


def test_scale_of_a_fisheye_is_least_at_the_edge_of_what_is_allowed_for():
    # d angle / d place at x heights off is 1 / (1 + x^2), and so many pixels more to a radian.
    view = view_of(lens("equidistant", 215.0), tilt_rad=math.radians(10), offset=0.4)
    off = 0.4 * math.tan(236.5 / 215.0 - math.radians(10))
    assert view.scale_px == pytest.approx(215.0 / (1.0 + off * off), rel=1e-6)


def test_view_of_a_very_wide_lens_ends_at_70_degrees():
    view = view_of(lens("equidistant", 150.0), tilt_rad=0.0, offset=0.0)
    assert np.degrees(view.usable_rad) == pytest.approx(70.0)


def test_view_that_the_tilt_leaves_nothing_of_is_refused_with_its_angle():
    with pytest.raises(ConfigError, match=r"tilt of 40 deg leaves nothing of a view of 25\.5 deg.*smaller --tilt"):
        view_of(lens("pinhole", 495.0), tilt_rad=math.radians(40), offset=0.0)


def test_lens_whose_axis_is_at_the_border_of_the_image_is_refused():
    with pytest.raises(ConfigError, match=r"axis at 638\.0, 239\.5 px lies at the border.*640x480; mend cx_px"):
        half_angle_rad(lens("pinhole", 495.0, cx=638.0))
