"""Poses from corners whose true places a textbook projection gives, and from rendered images."""

import math

import numpy as np
import pytest

from app.config import VisionConfig
from app.estimation.pose import estimate_camera_pose, predicted_corners_px, rotation_from_vector
from app.frames import rotation_from_quaternion
from app.messages import Detection, Frame, SeenContour
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector

EVERYTHING = range(5)


def detection_of(scene, view, lens, contours=EVERYTHING, noise_px=0.0, seed=0):
    rng = np.random.default_rng(seed)
    seen = tuple(
        SeenContour(k, px + rng.normal(0.0, noise_px, px.shape))
        for k in contours
        for px in [scene.corners_px(view, k, lens)]
    )
    return Detection(0.0, 0, contours=seen, code="44334")


def turn_between_deg(a, b):
    cosine = (np.trace(a @ b.T) - 1.0) / 2.0
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


VIEWS = [
    {"height_m": 0.3, "forward_m": 0.1, "pad_yaw_deg": 20, "roll_deg": 10},
    {"height_m": 1.0, "right_m": 0.4, "pad_yaw_deg": -100, "pitch_deg": 30},
    {"height_m": 3.0, "forward_m": -0.8, "right_m": 0.5, "pad_yaw_deg": 170, "roll_deg": -12, "pitch_deg": 8},
    {"height_m": 8.0, "forward_m": 1.0, "pad_yaw_deg": 45},
]


@pytest.mark.parametrize("where", VIEWS, ids=lambda w: f"{w['height_m']} m")
@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
@pytest.mark.parametrize("prior", [True, False])
def test_pose_of_exact_corners_is_exact(scene, where, lens_name, prior):
    lens, view = getattr(scene, lens_name), scene.view(**where)
    pose = estimate_camera_pose(
        detection_of(scene, view, lens),
        scene.landmark,
        lens_from_config(lens.config),
        view.rotation if prior else None,
    )
    np.testing.assert_allclose(pose.t_cam_from_pad_m, view.t, atol=1e-4 * where["height_m"])
    assert turn_between_deg(rotation_from_quaternion(pose.q_cam_from_pad_wxyz), view.rotation) < 0.02
    assert pose.reprojection_px < 1e-2


@pytest.mark.parametrize("contours", [(3, 4), (2, 3), (0, 1), (2, 3, 4)])
def test_pose_of_a_run_alone_is_exact(scene, contours):
    view = scene.view(0.4, forward_m=0.05, pad_yaw_deg=30, roll_deg=8)
    pose = estimate_camera_pose(
        detection_of(scene, view, scene.fisheye, contours),
        scene.landmark,
        lens_from_config(scene.fisheye.config),
        view.rotation,
    )
    np.testing.assert_allclose(pose.t_cam_from_pad_m, view.t, atol=2e-4)


def test_attitude_decides_between_the_two_poses_of_a_far_landmark(scene):
    # 12 px sides with a third of a pixel of noise: the corners alone can't tell which way it tilts.
    view = scene.view(7.0, forward_m=1.0, pad_yaw_deg=10, roll_deg=15)
    lens = lens_from_config(scene.fisheye.config)
    turns = [
        turn_between_deg(rotation_from_quaternion(pose.q_cam_from_pad_wxyz), view.rotation)
        for seed in range(20)
        for pose in [
            estimate_camera_pose(
                detection_of(scene, view, scene.fisheye, (0, 1), 0.3, seed), scene.landmark, lens, view.rotation
            )
        ]
    ]
    # The other pose lies twice as far away as the pad's normal from the line of sight: 2 * 16 degrees.
    assert max(turns) < 20.0


def test_one_wild_corner_does_not_move_the_pose(scene):
    view = scene.view(1.0, forward_m=0.1, pad_yaw_deg=10)
    seen = detection_of(scene, view, scene.fisheye)
    wild = seen.contours[1].corners_px.copy()
    wild[2] += [9.0, -6.0]
    contours = (seen.contours[0], SeenContour(1, wild), *seen.contours[2:])
    pose = estimate_camera_pose(
        Detection(0.0, 0, contours=contours, code="44334"),
        scene.landmark,
        lens_from_config(scene.fisheye.config),
        view.rotation,
    )
    assert np.linalg.norm(pose.t_cam_from_pad_m - view.t) < 0.01


@pytest.mark.parametrize("height_m", [0.5, 1.5, 4.0])
def test_covariance_covers_the_errors_of_noisy_corners(scene, height_m):
    # Normalised error squared of a three-dimensional quantity: mean 3 if the covariance is right; the common part that
    # real images have is absent here, so it may be less, but not more.
    view = scene.view(height_m, forward_m=0.2 * height_m, pad_yaw_deg=25, roll_deg=6)
    lens = lens_from_config(scene.fisheye.config)
    squared = []
    for seed in range(60):
        pose = estimate_camera_pose(
            detection_of(scene, view, scene.fisheye, noise_px=0.12, seed=seed), scene.landmark, lens, view.rotation
        )
        error = pose.t_cam_from_pad_m - view.t
        squared.append(float(error @ np.linalg.solve(pose.covariance[:3, :3], error)))
    assert 0.4 < np.mean(squared) < 3.6


def test_covariance_grows_with_the_residuals(scene):
    view = scene.view(1.0, pad_yaw_deg=25)
    lens = lens_from_config(scene.fisheye.config)
    sigma = [
        math.sqrt(estimate_camera_pose(found, scene.landmark, lens, view.rotation).covariance[2, 2])
        for found in (detection_of(scene, view, scene.fisheye), detection_of(scene, view, scene.fisheye, noise_px=1.0))
    ]
    assert sigma[1] > 2.0 * sigma[0]


@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
@pytest.mark.parametrize("height_m", [0.5, 1.0, 2.0, 4.0])
def test_pose_from_a_rendered_image_is_right_to_half_a_percent(scene, lens_name, height_m):
    lens = getattr(scene, lens_name)
    view = scene.view(height_m, forward_m=0.05 * height_m, right_m=0.08 * height_m, pad_yaw_deg=35, roll_deg=5)
    app_lens = lens_from_config(lens.config)
    image = scene.draw(view, lens=lens)
    found = Detector(scene.landmark, app_lens, VisionConfig()).detect(Frame(0.0, 0, image), still=True)
    pose = estimate_camera_pose(found, scene.landmark, app_lens, view.rotation)
    assert np.linalg.norm(pose.t_cam_from_pad_m - view.t) < 0.005 * np.linalg.norm(view.t)
    assert turn_between_deg(rotation_from_quaternion(pose.q_cam_from_pad_wxyz), view.rotation) < 1.5


def test_nothing_seen_gives_no_pose(scene):
    lens = lens_from_config(scene.fisheye.config)
    assert estimate_camera_pose(Detection(0.0, 0, reason="no"), scene.landmark, lens) is None


def test_corners_on_one_point_give_no_pose(scene):
    lens = lens_from_config(scene.fisheye.config)
    same = Detection(0.0, 0, contours=(SeenContour(0, np.full((4, 2), 300.0)), SeenContour(1, np.full((4, 2), 300.0))))
    assert estimate_camera_pose(same, scene.landmark, lens) is None


def test_predicted_corners_lie_where_the_landmark_is(scene):
    view = scene.view(0.5, forward_m=0.1, pad_yaw_deg=50, roll_deg=12)
    lens = lens_from_config(scene.fisheye.config)
    pose = estimate_camera_pose(detection_of(scene, view, scene.fisheye, (2, 3, 4)), scene.landmark, lens)
    np.testing.assert_allclose(
        predicted_corners_px(pose, scene.landmark, lens), scene.corners_px(view, 0, scene.fisheye), atol=0.05
    )


def test_rotation_from_vector_turns_by_its_length_about_its_direction():
    np.testing.assert_allclose(
        rotation_from_vector(np.array([0.0, 0.0, math.pi / 2])), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12
    )
    np.testing.assert_array_equal(rotation_from_vector(np.zeros(3)), np.eye(3))
