"""Equations (3) to (13), each by numbers worked by hand, and the method on rendered images."""

import math

import numpy as np
import pytest

from app.estimation.height_table import HeightTable, computed_height_table
from app.estimation.paper import (
    camera_pose_from_paper,
    equation_3,
    equation_4,
    equation_5,
    equation_6,
    equation_7,
    equation_8,
    equation_9,
    equation_10,
    equation_11,
    equation_12,
    equation_13,
    longest_side_px,
    paper_pose,
)
from app.frames import rotation_from_quaternion
from app.messages import Detection, SeenContour
from app.vision.camera_model import lens_from_config

# Apex up, 40 px wide, 30 px high, in pixels: apex, back right, back left.
TRIANGLE = np.array([[100.0, 50.0], [120.0, 80.0], [80.0, 80.0]])

TABLE = HeightTable(
    "by hand",
    heights_m=np.array([1.0, 2.0, 4.0]),
    centred_px=np.array([80.0, 40.0, 16.0]),
    offset_px=np.array([70.0, 36.0, 14.0]),
    offset_distance_px=100.0,
    side_m=0.2,
    focal_px=400.0,
)


def test_equations_3_and_4_mean_the_vertices():
    assert equation_3(TRIANGLE) == pytest.approx(100.0)
    assert equation_4(TRIANGLE) == pytest.approx(70.0)


def test_equations_5_and_6_scale_pixels_by_the_known_side():
    # 30 px right and 10 px up of the middle, where 40 px are 0.2 m.
    assert equation_5(350.0, 320.0, 0.2, 40.0) == pytest.approx(0.15)
    assert equation_6(230.0, 240.0, 0.2, 40.0) == pytest.approx(-0.05)


@pytest.mark.parametrize(
    ("yaw_deg", "expected"),
    [
        (
            0,
            (-0.3, -0.1),
        ),  # pad 0.3 right = east and 0.1 back = south of the vehicle: the vehicle is west and north of it
        (90, (0.1, -0.3)),  # heading east: right is south, back is west
        (180, (0.3, 0.1)),
        (-90, (-0.1, 0.3)),
    ],
)
def test_equation_7_turns_the_offset_into_east_and_south(yaw_deg, expected):
    assert equation_7(0.3, 0.1, math.radians(yaw_deg)) == pytest.approx(expected)


def test_equations_8_and_9_point_from_the_base_to_the_apex():
    base = equation_8(TRIANGLE)
    np.testing.assert_allclose(base, [100.0, 80.0])
    np.testing.assert_allclose(equation_9(TRIANGLE, base), [0.0, -30.0])


@pytest.mark.parametrize(
    ("axis", "theta_deg"), [((0, -30), 0), ((30, 0), 90), ((0, 30), 180), ((-30, 0), -90), ((10, -10), 45)]
)
def test_equation_10_is_clockwise_from_image_up_in_all_quadrants(axis, theta_deg):
    assert math.degrees(equation_10(np.array(axis, dtype=float))) == pytest.approx(theta_deg)


@pytest.mark.parametrize(("centre", "weight"), [((320, 240), 0.0), ((350, 280), 0.5), ((420, 240), 1.0), ((0, 0), 1.0)])
def test_equation_11_weighs_by_the_distance_from_the_middle(centre, weight):
    middle = np.array([320.0, 240.0])
    assert equation_11(np.array(centre, dtype=float), middle, 100.0) == pytest.approx(weight)


@pytest.mark.parametrize(("weight", "lengths"), [(0.0, (80, 40, 16)), (1.0, (70, 36, 14)), (0.25, (77.5, 39.0, 15.5))])
def test_equation_12_mixes_the_groups(weight, lengths):
    np.testing.assert_allclose(equation_12(TABLE, weight), lengths)


@pytest.mark.parametrize(
    ("length", "height"),
    [
        (80.0, 1.0),
        (40.0, 2.0),
        (60.0, 4.0 / 3.0),  # 1 / L is a third of the way from 1 / 80 to 1 / 40
        (160.0, 0.5),  # beyond the first row: H L = 80
        (8.0, 8.0),  # beyond the last row: H L = 64
    ],
)
def test_equation_13_is_inverse_between_the_rows_and_beyond(length, height):
    assert equation_13(length, TABLE.centred_px, TABLE.heights_m) == pytest.approx(height)


def test_longest_side_is_the_longest():
    assert longest_side_px(TRIANGLE) == pytest.approx(40.0)


def seen_triangle(scene, view, lens):
    return Detection(0.0, 0, contours=(SeenContour(2, scene.corners_px(view, 2, lens)),), code="43")


def test_level_camera_above_the_pad_reads_place_height_and_heading(scene):
    # The pad's origin is 0.30 m forward and 0.20 m right, turned 90 degrees clockwise. The triangle's centroid lies
    # 2.9469 cm behind the origin along the pad's own forward, which is to the vehicle's right: 0.1705 m right.
    view = scene.view(2.0, forward_m=0.3, right_m=0.2, pad_yaw_deg=90)
    lens = lens_from_config(scene.fisheye.config)
    table = computed_height_table(scene.landmark, 215.0)
    pose = paper_pose(seen_triangle(scene, view, scene.fisheye), scene.landmark, lens, table)
    assert pose.x_c_m == pytest.approx(0.170531, abs=1e-5)
    assert pose.y_c_m == pytest.approx(-0.3, abs=1e-5)
    assert pose.h_m == pytest.approx(2.0, abs=1e-5)
    assert pose.theta_rad == pytest.approx(math.pi / 2, abs=1e-6)


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(20, 0), (0, -25), (-15, 10)])
def test_tilt_is_taken_out_first(scene, roll_deg, pitch_deg):
    place = {"forward_m": 0.3, "right_m": -0.2, "pad_yaw_deg": 40}
    view = scene.view(1.5, roll_deg=roll_deg, pitch_deg=pitch_deg, **place)
    level_view = scene.view(1.5, **place)
    lens = lens_from_config(scene.fisheye.config)
    table = computed_height_table(scene.landmark, 215.0)
    level = level_view.rotation @ view.rotation.T
    pose = paper_pose(seen_triangle(scene, view, scene.fisheye), scene.landmark, lens, table, level)
    back, right = 0.029469 * math.cos(math.radians(40)), 0.029469 * math.sin(math.radians(40))
    assert pose.x_c_m == pytest.approx(-0.2 - right, abs=1e-4)
    assert pose.y_c_m == pytest.approx(-(0.3 - back), abs=1e-4)
    assert pose.h_m == pytest.approx(1.5, abs=1e-4)
    assert math.degrees(pose.theta_rad) == pytest.approx(40.0, abs=0.01)


def test_recorded_table_is_used_for_a_pad_of_another_size(scene):
    # 400 * 0.204168 / 2.04168 = 40 px, as long as 39.1834 px of the recorded triangle, whose side is 0.2 m.
    view = scene.view(2.04168)
    lens = lens_from_config(scene.fisheye.config)
    pose = paper_pose(seen_triangle(scene, view, scene.fisheye), scene.landmark, lens, TABLE)
    # The centroid is 2.9469 cm off the axis: 400 * 0.029469 / 2.04168 = 5.7735 px, so 5.7735% of the way to the second
    # group: 39.7691 px at 2 m and 15.8845 px at 4 m. 1 / 39.1834 lies 0.99405% of the way from 1 / 39.7691 to
    # 1 / 15.8845: 2 + 2 * 0.0099405 m.
    assert pose.h_m == pytest.approx(2.01988, abs=2e-5)


@pytest.mark.parametrize(("roll_deg", "pad_yaw_deg"), [(0, 0), (12, 130), (-20, -60)])
def test_camera_pose_from_the_paper_is_the_pads_origin(scene, roll_deg, pad_yaw_deg):
    place = {"forward_m": 0.2, "right_m": 0.1, "pad_yaw_deg": pad_yaw_deg}
    view = scene.view(1.2, roll_deg=roll_deg, **place)
    level = scene.view(1.2, **place).rotation @ view.rotation.T
    lens = lens_from_config(scene.fisheye.config)
    table = computed_height_table(scene.landmark, 215.0)
    seen = seen_triangle(scene, view, scene.fisheye)
    paper = paper_pose(seen, scene.landmark, lens, table, level)
    pose = camera_pose_from_paper(paper, seen, scene.landmark, lens, table, level)
    np.testing.assert_allclose(pose.t_cam_from_pad_m, view.t, atol=1e-4)
    np.testing.assert_allclose(rotation_from_quaternion(pose.q_cam_from_pad_wxyz), view.rotation, atol=1e-4)
    assert pose.reprojection_px < 0.05
    assert np.linalg.eigvalsh(pose.covariance).min() > 0


def test_without_the_triangle_there_is_no_paper_pose(scene):
    view = scene.view(2.0)
    lens = lens_from_config(scene.fisheye.config)
    only_square = Detection(0.0, 0, contours=(SeenContour(0, scene.corners_px(view, 0, scene.fisheye)),), code="44")
    assert paper_pose(only_square, scene.landmark, lens, TABLE) is None
