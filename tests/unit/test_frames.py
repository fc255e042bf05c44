"""Rotations and transforms by hand-worked cases, by OpenCV as a second reckoning, and by their algebra."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app import frames

HALF_PI = math.pi / 2
FORWARD, RIGHT, DOWN = np.eye(3)
NORTH, EAST, _ = np.eye(3)
angles = st.floats(-math.pi, math.pi)
vectors = st.tuples(*[st.floats(-100.0, 100.0)] * 3).map(np.array)
quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .map(np.array)
    .filter(lambda q: float(np.linalg.norm(q)) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.0, 0.0), (math.pi, -math.pi), (-math.pi, -math.pi), (3.5, 3.5 - 2 * math.pi), (-7.0, -7.0 + 2 * math.pi)],
)
def test_wrap_angle_lies_in_the_half_open_circle(angle, wrapped):
    assert frames.wrap_angle_rad(angle) == pytest.approx(wrapped)


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "axis_body", "axis_ned"),
    [
        (0.0, 0.0, HALF_PI, FORWARD, EAST),  # heading east
        (0.0, 0.0, HALF_PI, RIGHT, -NORTH),
        (HALF_PI, 0.0, 0.0, RIGHT, DOWN),  # right wing down
        (HALF_PI, 0.0, 0.0, DOWN, -EAST),
        (0.0, HALF_PI, 0.0, FORWARD, -DOWN),  # nose up
        (0.0, HALF_PI, 0.0, DOWN, NORTH),
        (HALF_PI, 0.0, HALF_PI, FORWARD, EAST),  # east, right wing down: its belly looks north
        (HALF_PI, 0.0, HALF_PI, DOWN, NORTH),
        (0.0, HALF_PI, HALF_PI, DOWN, EAST),  # east, nose up: its belly looks east
    ],
)
def test_rotation_from_euler_quarter_turns_send_axes_where_an_aeroplane_would(roll, pitch, yaw, axis_body, axis_ned):
    np.testing.assert_allclose(frames.rotation_from_euler(roll, pitch, yaw) @ axis_body, axis_ned, atol=1e-15)


@pytest.mark.parametrize(("axis_cam", "axis_body"), [(0, RIGHT), (1, -FORWARD), (2, DOWN)])
def test_body_from_cam_of_a_camera_looking_down_puts_image_top_forward(axis_cam, axis_body):
    np.testing.assert_array_equal(frames.BODY_FROM_CAM_DOWN @ np.eye(3)[axis_cam], axis_body)


@given(yaw=angles)
def test_yaw_from_rotation_of_a_level_vehicle_is_its_heading(yaw):
    assert frames.wrap_angle_rad(frames.yaw_from_rotation(frames.rotation_from_yaw(yaw)) - yaw) == pytest.approx(
        0.0, abs=1e-12
    )


def test_rotation_from_quaternion_of_a_quarter_turn_about_down_heads_east():
    s = math.sqrt(0.5)
    np.testing.assert_allclose(frames.rotation_from_quaternion(np.array([s, 0.0, 0.0, s])) @ FORWARD, EAST, atol=1e-15)


@given(quaternions)
def test_rotation_from_quaternion_agrees_with_opencv(q):
    angle = 2.0 * math.acos(max(-1.0, min(1.0, float(q[0]))))
    length = float(np.linalg.norm(q[1:]))
    vector = q[1:] / length * angle if length > 1e-12 else np.zeros(3)
    np.testing.assert_allclose(frames.rotation_from_quaternion(q), cv2.Rodrigues(vector)[0], atol=1e-6)


@given(quaternions)
def test_quaternion_from_rotation_returns_the_quaternion_up_to_its_sign(q):
    found = frames.quaternion_from_rotation(frames.rotation_from_quaternion(q))
    assert abs(float(found @ q)) == pytest.approx(1.0, abs=1e-12)
    assert found[0] >= 0.0


@pytest.mark.parametrize("q", [np.zeros(4), np.array([np.nan, 0.0, 0.0, 1.0])])
def test_rotation_from_quaternion_of_no_rotation_is_refused(q):
    with pytest.raises(ValueError, match="not a rotation"):
        frames.rotation_from_quaternion(q)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slerp_half_way_of_a_quarter_turn_is_an_eighth_whichever_sign_the_end_has(sign):
    start = np.array([1.0, 0.0, 0.0, 0.0])
    end = sign * np.array([math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)])
    middle = frames.rotation_from_quaternion(frames.slerp(start, end, 0.5))
    assert frames.yaw_from_rotation(middle) == pytest.approx(math.pi / 4)


@given(q0=quaternions, q1=quaternions, fraction=st.floats(0.0, 1.0))
def test_slerp_turns_at_a_constant_rate(q0, q1, fraction):
    whole = math.acos(min(1.0, abs(float(q0 @ q1))))
    part = math.acos(min(1.0, abs(float(q0 @ frames.slerp(q0, q1, fraction)))))
    assert part == pytest.approx(fraction * whole, abs=1e-3)


@given(q=quaternions, t=vectors, point=vectors)
def test_transform_inverse_brings_a_point_back(q, t, point):
    a_from_b = frames.Transform(frames.rotation_from_quaternion(q), t)
    np.testing.assert_allclose(a_from_b.inverse().apply(a_from_b.apply(point)), point, atol=1e-9)


def test_transform_chain_places_a_pad_seen_by_the_camera():
    # Vehicle at 10 m north, 20 m east, 5 m up, heading east; the pad 4 m below the camera, 1 m towards the top of the
    # image, that is 1 m ahead: east. Pad forward points to the image's top, too.
    ned_from_body = frames.Transform(frames.rotation_from_yaw(HALF_PI), np.array([10.0, 20.0, -5.0]))
    body_from_cam = frames.Transform(frames.BODY_FROM_CAM_DOWN, np.array([0.0, 0.0, 0.1]))
    cam_from_pad = frames.Transform(frames.BODY_FROM_CAM_DOWN.T, np.array([0.0, -1.0, 4.0]))
    ned_from_pad = ned_from_body @ body_from_cam @ cam_from_pad
    np.testing.assert_allclose(ned_from_pad.translation, [10.0, 21.0, -0.9], atol=1e-12)
    assert frames.yaw_from_rotation(ned_from_pad.rotation) == pytest.approx(HALF_PI)


def test_transform_apply_takes_one_point_or_many():
    a_from_b = frames.Transform(frames.rotation_from_yaw(HALF_PI), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(a_from_b.apply(FORWARD), [1.0, 3.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(a_from_b.apply(np.eye(3))[1], [0.0, 2.0, 3.0], atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.35, HALF_PI, 3.0, math.pi])
@given(about=angles, yaw=angles)
def test_tilt_is_the_angle_from_level_whatever_the_heading(angle, about, yaw):
    axis = math.cos(about) * FORWARD + math.sin(about) * RIGHT
    rotation, _ = cv2.Rodrigues(angle * axis)
    assert frames.tilt_rad(frames.rotation_from_yaw(yaw) @ rotation) == pytest.approx(angle, abs=1e-12)


@pytest.mark.parametrize("element", range(3))
def test_tilt_of_what_is_not_a_number_is_not_level(element):
    rotation = np.eye(3)
    rotation[element, 2] = math.nan
    assert math.isnan(frames.tilt_rad(rotation))


@pytest.mark.parametrize(("value", "clamped"), [(-3.0, -1.0), (-1.0, -1.0), (0.5, 0.5), (2.0, 2.0), (math.inf, 2.0)])
def test_clamp_keeps_a_value_between_its_limits(value, clamped):
    assert frames.clamp(value, -1.0, 2.0) == clamped


def test_clamp_leaves_nan_as_it_is():
    assert math.isnan(frames.clamp(math.nan, -1.0, 2.0))


@pytest.mark.parametrize(
    ("q", "expected"),
    [
        ([1.0, 0.0, 0.0, 0.0], True),
        ([0.0, -2.0, 0.0, 0.0], True),
        ([0.0, 0.0, 0.0, 0.0], False),
        ([math.nan, 0.0, 0.0, 1.0], False),
        ([math.inf, 0.0, 0.0, 1.0], False),
    ],
)
def test_quaternion_is_a_rotation_if_it_has_a_length(q, expected):
    assert frames.is_rotation(np.array(q)) is expected
