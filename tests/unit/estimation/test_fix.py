import math
from dataclasses import replace

import numpy as np
import pytest

from app.config import CameraConfig
from app.estimation.fix import (
    ATTITUDE_SIGMA_RAD,
    MEMORY_S,
    FixMaker,
    PoseEstimate,
    is_finite,
    pad_fix,
    pose_estimator,
)
from app.estimation.mount import body_from_cam, level_from_cam
from app.frames import (
    BODY_FROM_CAM_DOWN,
    Transform,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)
from app.messages import CameraPose, Detection, PadFix, SeenContour, VehicleState
from app.vision.camera_model import lens_from_config
from app.vision.plane import plane_fit_from_corners


def camera(**mount):
    return CameraConfig(driver="opencv", lens="x.toml", **{"position_body_m": (0.0, 0.0, 0.0), **mount})


def vehicle(roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0, pos=(0.0, 0.0, 0.0)):
    rotation = rotation_from_euler(math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))
    return VehicleState(
        t_capture_s=5.0,
        pos_ned_m=np.array(pos),
        vel_ned_m_s=np.zeros(3),
        q_ned_from_body_wxyz=quaternion_from_rotation(rotation),
    )


DETECTED = Detection(5.0, 1, code="44334", contours=(SeenContour(0, np.zeros((4, 2))),))


def pose(t, covariance=None):
    # A pad whose forward is image up: its axes in cam are (0, -1, 0), (1, 0, 0), (0, 0, 1).
    rotation = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return CameraPose(
        np.array(t), quaternion_from_rotation(rotation), np.zeros((6, 6)) if covariance is None else covariance, 0.1
    )


@pytest.mark.parametrize(
    ("mount", "image_up", "axis"),
    [
        ({}, (1, 0, 0), (0, 0, 1)),
        ({"mount_yaw_deg": 90.0}, (0, 1, 0), (0, 0, 1)),
        ({"mount_yaw_deg": 180.0}, (-1, 0, 0), (0, 0, 1)),
        ({"mount_pitch_deg": 30.0}, None, (0.5, 0, math.sqrt(0.75))),
        ({"mount_roll_deg": 30.0}, None, (0, -0.5, math.sqrt(0.75))),
    ],
)
def test_mount_turns_the_camera_as_the_config_says(mount, image_up, axis):
    rotation = body_from_cam(camera(**mount)).rotation
    np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], axis, atol=1e-12)
    up = rotation @ [0.0, -1.0, 0.0]
    np.testing.assert_allclose(up, up if image_up is None else image_up, atol=1e-12)


def test_level_vehicle_needs_no_levelling_whatever_its_heading():
    level = level_from_cam(vehicle(yaw_deg=77).q_ned_from_body_wxyz, body_from_cam(camera()).rotation)
    np.testing.assert_allclose(level, np.eye(3), atol=1e-12)


def test_levelling_turns_the_vertical_onto_the_axis():
    state = vehicle(roll_deg=20, pitch_deg=-10, yaw_deg=200)
    mount = body_from_cam(camera(mount_yaw_deg=30.0)).rotation
    level = level_from_cam(state.q_ned_from_body_wxyz, mount)
    ned_from_body = rotation_from_euler(math.radians(20), math.radians(-10), math.radians(200))
    down_cam = mount.T @ ned_from_body.T @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(level @ down_cam, [0.0, 0.0, 1.0], atol=1e-12)


def test_fix_of_a_level_vehicle_heading_east():
    # Image right is body right is south; image up is body forward is east.
    fix = pad_fix(
        DETECTED, pose((0.5, -0.25, 2.0)), vehicle(yaw_deg=90, pos=(10.0, 20.0, -3.0)), body_from_cam(camera())
    )
    np.testing.assert_allclose(fix.pad_from_vehicle_ned_m, [-0.5, 0.25, 2.0], atol=1e-12)
    np.testing.assert_allclose(fix.pad_pos_ned_m, [9.5, 20.25, -1.0], atol=1e-12)
    assert fix.pad_yaw_ned_rad == pytest.approx(math.pi / 2)
    assert fix.pad_tilt_rad == pytest.approx(0.0, abs=1e-6)
    assert (fix.t_capture_s, fix.code) == (5.0, "44334")


def test_camera_off_the_body_origin_is_counted():
    mounted = body_from_cam(camera(position_body_m=(0.1, 0.0, 0.05)))
    fix = pad_fix(DETECTED, pose((0.0, 0.0, 1.0)), vehicle(), mounted)
    np.testing.assert_allclose(fix.pad_from_vehicle_ned_m, [0.1, 0.0, 1.05], atol=1e-12)


def test_rolled_vehicle_sees_the_pad_below_its_left():
    # Right side down by 30 degrees: the camera looks to the left of down.
    fix = pad_fix(DETECTED, pose((0.0, 0.0, 2.0)), vehicle(roll_deg=30), body_from_cam(camera()))
    np.testing.assert_allclose(fix.pad_from_vehicle_ned_m, [0.0, -1.0, math.sqrt(3.0)], atol=1e-12)
    assert fix.pad_tilt_rad == pytest.approx(math.radians(30))


def test_covariance_is_turned_and_widened_by_the_attitude():
    seen = np.diag([0.01, 0.02, 0.04, 0.0, 0.0, 0.0009])
    fix = pad_fix(DETECTED, pose((0.0, 0.0, 3.0), seen), vehicle(), body_from_cam(camera()))
    # Image right is east, image down is south; a degree of roll or pitch moves a pad 3 m below by 5.2 cm.
    widened = (3.0 * ATTITUDE_SIGMA_RAD) ** 2
    np.testing.assert_allclose(np.diag(fix.covariance_ned_m2), [0.02 + widened, 0.01 + widened, 0.04], atol=1e-9)
    assert fix.yaw_sigma_rad == pytest.approx(math.sqrt(0.0009 + ATTITUDE_SIGMA_RAD**2))


@pytest.mark.parametrize("method", ["pnp", "paper"])
@pytest.mark.parametrize(("roll_deg", "pitch_deg", "yaw_deg"), [(0, 0, 0), (15, -10, 120), (-8, 12, -60)])
def test_both_methods_place_the_pad_whatever_the_attitude(scene, method, roll_deg, pitch_deg, yaw_deg):
    # The scene's camera hangs at the body's origin; the pad is 0.4 m ahead and 0.3 m right along the vehicle's level
    # axes, 2 m below, turned 50 degrees from the vehicle.
    view = scene.view(2.0, forward_m=0.4, right_m=0.3, pad_yaw_deg=50, roll_deg=roll_deg, pitch_deg=pitch_deg)
    contours = tuple(SeenContour(k, scene.corners_px(view, k, scene.fisheye)) for k in range(5))
    lens = lens_from_config(scene.fisheye.config)
    make = FixMaker(pose_estimator(scene.landmark, lens, method), body_from_cam(camera()))
    state = vehicle(roll_deg, pitch_deg, yaw_deg, (1.0, 2.0, -2.0))
    fix = make(Detection(5.0, 1, contours=contours, code="44334"), state)
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    expected = np.array([1.0 + c * 0.4 - s * 0.3, 2.0 + s * 0.4 + c * 0.3, 0.0])
    np.testing.assert_allclose(fix.pad_pos_ned_m, expected, atol=2e-3)
    assert math.degrees(fix.pad_yaw_ned_rad) == pytest.approx((yaw_deg + 50 + 180) % 360 - 180, abs=0.1)
    assert fix.pad_tilt_rad < math.radians(0.2)


def seen_exactly(scene, view, t_s=5.0):
    contours = tuple(SeenContour(k, scene.corners_px(view, k, scene.fisheye)) for k in range(5))
    return Detection(t_s, 1, contours=contours, code="44334")


def test_papers_outputs_travel_with_a_fix_by_method_paper_alone(scene):
    seen, lens = seen_exactly(scene, scene.view(2.0)), lens_from_config(scene.fisheye.config)
    by_paper, by_pnp = (
        FixMaker(pose_estimator(scene.landmark, lens, method), body_from_cam(camera()))(seen, vehicle())
        for method in ("paper", "pnp")
    )
    assert by_paper.paper.h_m == pytest.approx(2.0, abs=2e-3)
    assert by_pnp.paper is None


@pytest.mark.parametrize("method", ["pnp", "paper"])
def test_estimate_has_the_papers_outputs_beside_either_pose(scene, method):
    lens = lens_from_config(scene.fisheye.config)
    found = pose_estimator(scene.landmark, lens, method).estimate(seen_exactly(scene, scene.view(2.0)))
    assert found.paper.h_m == pytest.approx(2.0, abs=2e-3)
    np.testing.assert_allclose(found.camera.t_cam_from_pad_m, [0.0, 0.0, 2.0], atol=2e-3)


class Listener:
    """An estimator that keeps what it is told to expect."""

    method = "pnp"

    def __init__(self, poses):
        self.poses = iter(poses)
        self.expected = []

    def estimate(self, detection, level, *, expected_normal_cam, paper_too):
        self.expected.append(expected_normal_cam)
        return PoseEstimate(next(self.poses), None)


def test_slope_of_the_fix_before_is_expected_whatever_the_vehicle_did_since():
    # The pad leans: its down axis points 20 degrees from the vertical, to the north.
    lean = np.array([math.sin(math.radians(20)), 0.0, math.cos(math.radians(20))])
    east = np.array([0.0, 1.0, 0.0])
    ned_from_pad = np.column_stack([np.cross(east, lean), east, lean])
    mount, states = body_from_cam(camera()), [vehicle(yaw_deg=0), vehicle(roll_deg=12, pitch_deg=-7, yaw_deg=100)]
    cam_from_ned = [(rotation_from_quaternion(s.q_ned_from_body_wxyz) @ mount.rotation).T for s in states]
    poses = [
        CameraPose(np.array([0.0, 0.0, 3.0]), quaternion_from_rotation(r @ ned_from_pad), np.eye(6), 0.1)
        for r in cam_from_ned
    ]
    listener = Listener([*poses, poses[1], poses[1]])
    make = FixMaker(listener, mount)
    for t_s, state in ((5.0, states[0]), (5.4, states[1]), (5.4 + 1.01 * MEMORY_S, states[1]), (5.0, states[1])):
        make(replace(DETECTED, t_capture_s=t_s), state)
    first, second, long_after, before = listener.expected
    np.testing.assert_allclose(second, cam_from_ned[1] @ lean, atol=1e-12)
    assert (first, long_after, before) == (None, None, None)


def test_covariance_in_ned_is_that_of_the_errors_of_vision_and_attitude(scene, monkeypatch):
    # A level pad, corners off by 0.1 px, an attitude off by ATTITUDE_SIGMA_RAD about each axis, nothing that all edges
    # share. The mean of 500 values of chi squared with 3 degrees of freedom has a standard deviation of 0.11.
    monkeypatch.setattr("app.estimation.pose.COMMON_SIGMA_PX", 0.0)
    lens, rng, squared, heading = lens_from_config(scene.fisheye.config), np.random.default_rng(0), [], []
    points = np.concatenate([c.corners_m for c in scene.landmark.contours])
    for _ in range(500):
        height, (roll, pitch, yaw) = rng.uniform(1.0, 4.0), rng.uniform(-10, 10, 3)
        view = scene.view(height, forward_m=0.2 * height, roll_deg=roll, pitch_deg=pitch)
        px = np.concatenate([scene.corners_px(view, k, scene.fisheye) for k in range(5)])
        plane = plane_fit_from_corners(points, px + rng.normal(0.0, 0.1, px.shape), lens, 0.1, 0.19)
        # Small errors of the three angles turn about nearly the three axes.
        wrong = np.degrees(rng.normal(0.0, ATTITUDE_SIGMA_RAD, 3))
        state = vehicle(roll + wrong[0], pitch + wrong[1], yaw + wrong[2])
        make = FixMaker(pose_estimator(scene.landmark, lens, "pnp"), body_from_cam(camera()))
        fix = make(replace(DETECTED, plane=plane), state)
        c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
        error = fix.pad_from_vehicle_ned_m - np.array([0.2 * height * c, 0.2 * height * s, height])
        squared.append(error @ np.linalg.solve(fix.covariance_ned_m2, error))
        heading.append((fix.pad_yaw_ned_rad - math.radians(yaw)) / fix.yaw_sigma_rad)
    assert np.mean(squared) == pytest.approx(3.0, abs=1.96 * 0.11)
    assert np.std(heading) == pytest.approx(1.0, abs=1.96 / math.sqrt(2 * 500))


def test_detection_without_the_triangle_gives_no_fix_by_the_paper(scene):
    view = scene.view(2.0)
    seen = Detection(5.0, 1, code="44", contours=(SeenContour(0, scene.corners_px(view, 0, scene.fisheye)),))
    lens = lens_from_config(scene.fisheye.config)
    make = FixMaker(pose_estimator(scene.landmark, lens, "paper"), body_from_cam(camera()))
    assert make(seen, vehicle()) is None


def test_frame_without_the_landmark_gives_no_fix(scene):
    lens = lens_from_config(scene.fisheye.config)
    make = FixMaker(pose_estimator(scene.landmark, lens, "pnp"), body_from_cam(camera()))
    assert make(Detection(5.0, 1, reason="no"), vehicle()) is None


NOT_FINITE = {
    "t_capture_s": math.nan,
    "pad_pos_ned_m": np.array([0.0, math.inf, 0.0]),
    "pad_from_vehicle_ned_m": np.full(3, math.nan),
    "covariance_ned_m2": np.diag([1.0, 1.0, math.nan]),
    "pad_yaw_ned_rad": math.nan,
    "yaw_sigma_rad": math.nan,
    "pad_tilt_rad": math.nan,
    "pad_normal_ned": np.array([0.0, math.nan, 1.0]),
    "normal_sigma_rad": math.inf,
    "travelled_ned_m": np.full(3, math.nan),
    "shift_ned_m_s": np.array([math.nan, 0.0, 0.0]),
    "delay_s": math.nan,
}


@pytest.mark.parametrize("name", list(NOT_FINITE))
def test_fix_with_one_figure_that_is_not_a_number_is_told_from_a_whole_one(name):
    whole = PadFix(10.0, np.zeros(3), np.zeros(3), np.eye(3), 0.0, 0.01, "4433", pad_normal_ned=np.eye(3)[2])
    assert is_finite(whole)
    assert not is_finite(replace(whole, **{name: NOT_FINITE[name]}))


def test_fix_from_a_pose_that_is_not_a_number_claims_no_tilt_and_no_certainty():
    """A pose whose turn is of unknown size: neither may its slope pass for level nor its deviation for zero."""
    pose = CameraPose(np.array([0.0, 0.0, 3.0]), np.array([1.0, 0.0, 0.0, 0.0]), np.full((6, 6), math.nan), 0.1)
    state = VehicleState(10.0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    fix = pad_fix(Detection(10.0, 1), pose, state, Transform(BODY_FROM_CAM_DOWN, np.zeros(3)))
    assert math.isnan(fix.normal_sigma_rad) and math.isnan(fix.yaw_sigma_rad)
    assert not is_finite(fix)
