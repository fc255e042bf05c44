"""Poses from corners whose true places a textbook projection gives, from planes fitted to them, and from rendered
images."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.config import VisionConfig
from app.estimation.pose import COMMON_SIGMA_PX, estimate_camera_pose, pad_normal_cam, predicted_corners_px
from app.frames import rotation_from_quaternion
from app.messages import Detection, Frame, PlaneFit, SeenContour
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector
from app.vision.plane import plane_fit_from_corners

EVERYTHING = range(5)
DRAWS = 500
BAND = 1.96 * math.sqrt(2.0 / DRAWS)
"""Mean of DRAWS values of chi squared, k degrees of freedom, over k: 95% lie within sqrt(1 / k) of this about 1."""


def detection_of(scene, view, lens, contours=EVERYTHING, noise_px=0.0, seed=0):
    rng = np.random.default_rng(seed)
    seen = tuple(
        SeenContour(k, px + rng.normal(0.0, noise_px, px.shape))
        for k in contours
        for px in [scene.corners_px(view, k, lens)]
    )
    return Detection(0.0, 0, contours=seen, code="44334")


def corners_of(scene, keep=lambda corner: True):
    points = np.concatenate([contour.corners_m for contour in scene.landmark.contours])
    return points[[bool(keep(p)) for p in points]]


def true_px(view, lens, points):
    return lens.project(np.column_stack([points, np.zeros(len(points))]) @ view.rotation.T + view.t)


def plane_seen(scene, view, lens, points, sigma_px, rng):
    """The plane fitted to noisy corners, and nothing else: the contour is a placeholder that must not be looked at."""
    px = true_px(view, lens, points) + rng.normal(0.0, sigma_px, (len(points), 2))
    fit = plane_fit_from_corners(points, px, lens_from_config(lens.config), max(sigma_px, 1e-3), 0.19)
    return Detection(0.0, 0, contours=(SeenContour(0, np.zeros((4, 2))),), code="44334", plane=fit)


def turned(w):
    """Rotation by |w| about w, by the power series of the exponential."""
    x, y, z = w
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result, term = np.eye(3), np.eye(3)
    for n in range(1, 20):
        term = term @ k / n
        result = result + term
    return result


def off_by(direction, angles_rad):
    """A unit vector turned by small angles about two axes at right angles to it."""
    across = np.linalg.svd(direction[None])[2][1:]
    return turned(angles_rad @ across) @ direction


def prior_of(down):
    """Any rotation whose third column is the vertical."""
    return np.column_stack([np.zeros((3, 2)), down])


def turn_of(a, b):
    """Rotation vector of a @ b.T, radians, for less than a quarter turn."""
    m = a @ b.T
    w = 0.5 * np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    sine = np.linalg.norm(w)
    return w * (math.atan2(sine, 0.5 * (np.trace(m) - 1.0)) / max(sine, 1e-12))


def turn_between_deg(a, b):
    return math.degrees(np.linalg.norm(turn_of(a, b)))


def rotation_of(pose):
    return rotation_from_quaternion(pose.q_cam_from_pad_wxyz)


def angle_deg(a, b):
    return math.degrees(math.acos(max(-1.0, min(1.0, float(a @ b)))))


def error_of(pose, view):
    """(6,) true minus found: translation, and rotation about the camera's axes."""
    return np.concatenate([view.t - pose.t_cam_from_pad_m, turn_of(view.rotation, rotation_of(pose))])


@pytest.fixture
def without_common_error(monkeypatch):
    """Noise of the corners alone: all edges off together, which real images have, is absent."""
    monkeypatch.setattr("app.estimation.pose.COMMON_SIGMA_PX", 0.0)


VIEWS = [
    {"height_m": 0.3, "forward_m": 0.1, "pad_yaw_deg": 20, "roll_deg": 10},
    {"height_m": 1.0, "right_m": 0.4, "pad_yaw_deg": -100, "pitch_deg": 30},
    {"height_m": 3.0, "forward_m": -0.8, "right_m": 0.5, "pad_yaw_deg": 170, "roll_deg": -12, "pitch_deg": 8},
    {"height_m": 8.0, "forward_m": 1.0, "pad_yaw_deg": 45},
]


# ------------------------------------------------------------------------------------------------------------ exact
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
    assert turn_between_deg(rotation_of(pose), view.rotation) < 0.02
    assert pose.reprojection_px < 1e-2


@pytest.mark.parametrize("scale", [1.0, 250.0, -0.01])
@pytest.mark.parametrize("where", VIEWS, ids=lambda w: f"{w['height_m']} m")
def test_pose_of_an_exact_plane_is_exact_whatever_the_planes_scale(scene, where, scale):
    view, lens = scene.view(**where), lens_from_config(scene.fisheye.config)
    seen = plane_seen(scene, view, scene.fisheye, corners_of(scene), 0.0, np.random.default_rng(0))
    plane = replace(seen.plane, rays_from_pad=scale * np.column_stack([view.rotation[:, :2], view.t]))
    pose = estimate_camera_pose(replace(seen, plane=plane), scene.landmark, lens)
    np.testing.assert_allclose(pose.t_cam_from_pad_m, view.t, atol=1e-6)
    assert turn_between_deg(rotation_of(pose), view.rotation) < 1e-4


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


# ------------------------------------------------------------------------------------------------------- covariance
def front(corner):
    return corner[0] > 0.03


def right(corner):
    return corner[1] > 0.05


def any_corner(corner):
    return True


NEAR = [
    ("near", "fisheye", (0.3, 0.8), 0.3, 10.0, any_corner, 0.1),
    ("near", "pinhole", (0.4, 1.0), 0.15, 10.0, any_corner, 0.1),
    ("middle", "fisheye", (1.0, 2.0), 0.3, 15.0, any_corner, 0.1),
    ("tilted", "fisheye", (1.0, 2.0), 0.2, 30.0, any_corner, 0.1),
    ("front side alone", "fisheye", (0.2, 0.5), 0.2, 10.0, front, 0.1),
    ("right side alone", "pinhole", (0.2, 0.5), 0.1, 10.0, right, 0.1),
]
FAR = [
    ("12 to 20 px", "fisheye", (4.1, 6.8), 0.3, 15.0, any_corner, 0.1),
    ("12 to 20 px", "pinhole", (9.4, 15.7), 0.15, 15.0, any_corner, 0.1),
]


def normalised_errors(scene, regime, seed=0):
    """Mean normalised error squared over DRAWS views and noises, over its degrees of freedom: of all six dimensions and
    of the translation alone, [with, without] the vertical known."""
    _, lens_name, (low, high), aside, tilt_deg, keep, sigma_px = regime
    lens, points, rng = getattr(scene, lens_name), corners_of(scene, keep), np.random.default_rng(seed)
    app_lens = lens_from_config(lens.config)
    squared = []
    for _ in range(DRAWS):
        height = rng.uniform(low, high)
        bearing, tilt_to = rng.uniform(0, math.tau, 2)
        off_m, tilt = rng.uniform(0, aside * height), rng.uniform(0, tilt_deg)
        view = scene.view(
            height,
            forward_m=off_m * math.cos(bearing),
            right_m=off_m * math.sin(bearing),
            pad_yaw_deg=rng.uniform(-180, 180),
            roll_deg=tilt * math.cos(tilt_to),
            pitch_deg=tilt * math.sin(tilt_to),
        )
        # The vertical is as far off the pad's normal as the estimator believes: 6 degrees about each axis.
        down = off_by(view.rotation[:, 2], rng.normal(0.0, math.radians(6.0), 2))
        seen = plane_seen(scene, view, lens, points, sigma_px, rng)
        for prior in (prior_of(down), None):
            pose = estimate_camera_pose(seen, scene.landmark, app_lens, prior)
            error = error_of(pose, view)
            squared.append(error @ np.linalg.solve(pose.covariance, error) / 6.0)
            squared.append(error[:3] @ np.linalg.solve(pose.covariance[:3, :3], error[:3]) / 3.0)
    mean = np.reshape(squared, (DRAWS, 2, 2)).mean(axis=0)
    return mean[:, 0], mean[:, 1]


@pytest.mark.usefixtures("without_common_error")
@pytest.mark.parametrize("regime", NEAR, ids=lambda r: f"{r[0]}, {r[1]}")
def test_covariance_is_that_of_the_errors_with_and_without_the_vertical(scene, regime):
    six, three = normalised_errors(scene, regime)
    np.testing.assert_allclose(six, 1.0, atol=BAND * math.sqrt(1 / 6))
    np.testing.assert_allclose(three, 1.0, atol=BAND * math.sqrt(1 / 3))


@pytest.mark.usefixtures("without_common_error")
@pytest.mark.parametrize("regime", FAR, ids=lambda r: f"{r[0]}, {r[1]}")
def test_covariance_of_a_far_landmark_is_nearly_that_of_the_errors(scene, regime):
    # Its tilt is seen by its square: the error is no Gaussian, and its square's mean has no tight band. The place is
    # right to a tenth in sigma, all six to a quarter.
    six, three = normalised_errors(scene, regime)
    np.testing.assert_allclose(np.sqrt(six), 1.0, atol=0.25)
    np.testing.assert_allclose(np.sqrt(three), 1.0, atol=0.1)


def test_error_that_all_edges_share_is_in_the_distance(scene):
    view, lens = scene.view(3.0, pad_yaw_deg=25), lens_from_config(scene.fisheye.config)
    points = scene.landmark.contours[0].corners_m
    px = scene.corners_px(view, 0, scene.fisheye)
    # Sides 0.08 px further out: the side of 27 px looks 0.16 px longer, the distance 0.6% shorter.
    middle = px.mean(axis=0)
    half_px = 215.0 * 0.19 / 3.0
    larger = middle + (px - middle) * (1.0 + COMMON_SIGMA_PX / half_px)
    plane = plane_fit_from_corners(points, larger, lens, 1e-3, 0.19)
    seen = Detection(0.0, 0, contours=(SeenContour(0, larger),), plane=plane)
    pose = estimate_camera_pose(seen, scene.landmark, lens, view.rotation)
    off = abs(float(np.linalg.norm(pose.t_cam_from_pad_m)) - 3.0)
    assert off == pytest.approx(3.0 * COMMON_SIGMA_PX / half_px, rel=0.05)
    assert 0.7 < off / math.sqrt(pose.covariance[2, 2]) < 1.5


def test_plane_that_no_rigid_pose_explains_widens_the_covariance(scene):
    view, lens = scene.view(1.0, pad_yaw_deg=25), lens_from_config(scene.fisheye.config)
    seen = plane_seen(scene, view, scene.fisheye, corners_of(scene), 0.05, np.random.default_rng(3))
    # 3% longer than wide, and sheared: that is 30 sigma of this plane.
    bent = replace(
        seen.plane, rays_from_pad=seen.plane.rays_from_pad @ np.array([[1.03, 0.03, 0], [0, 1, 0], [0, 0, 1]])
    )
    straight, crooked = (
        estimate_camera_pose(one, scene.landmark, lens, view.rotation) for one in (seen, replace(seen, plane=bent))
    )
    assert np.trace(crooked.covariance[3:, 3:]) > 9.0 * np.trace(straight.covariance[3:, 3:])


def test_covariance_grows_with_the_corners_residuals(scene):
    view = scene.view(1.0, pad_yaw_deg=25)
    lens = lens_from_config(scene.fisheye.config)
    sigma = [
        math.sqrt(estimate_camera_pose(found, scene.landmark, lens, view.rotation).covariance[2, 2])
        for found in (detection_of(scene, view, scene.fisheye), detection_of(scene, view, scene.fisheye, noise_px=1.0))
    ]
    assert sigma[1] > 2.0 * sigma[0]


# ---------------------------------------------------------------------------------------------- the vertical's part
@pytest.mark.usefixtures("without_common_error")
def test_heading_is_the_same_with_and_without_the_vertical(scene):
    lens, rng = lens_from_config(scene.fisheye.config), np.random.default_rng(1)
    errors, sigmas = [], []
    for _ in range(150):
        view = scene.view(2.0, forward_m=rng.uniform(-0.6, 0.6), pad_yaw_deg=rng.uniform(-180, 180), roll_deg=12)
        seen = plane_seen(scene, view, scene.fisheye, corners_of(scene), 0.1, rng)
        down = off_by(view.rotation[:, 2], rng.normal(0.0, math.radians(3.0), 2))
        normal = view.rotation[:, 2]
        both = [estimate_camera_pose(seen, scene.landmark, lens, prior) for prior in (prior_of(down), None)]
        errors.append([error_of(pose, view)[3:] @ normal for pose in both])
        sigmas.append([math.sqrt(normal @ pose.covariance[3:, 3:] @ normal) for pose in both])
    with_it, without = np.sqrt(np.mean(np.square(errors), axis=0))
    assert with_it == pytest.approx(without, rel=0.03)
    np.testing.assert_allclose(*np.transpose(sigmas), rtol=0.05)


def test_slope_of_five_degrees_is_told_where_the_image_shows_it(scene):
    # At 2 m the image knows the tilt to about a degree: the vertical, believed to 6, may pull by a tenth of the slope.
    lens, rng = lens_from_config(scene.fisheye.config), np.random.default_rng(2)
    found = []
    for _ in range(150):
        view = scene.view(2.0, forward_m=0.6, pad_yaw_deg=rng.uniform(-180, 180))
        normal, axis = view.rotation[:, 2], np.array([math.cos(1.0), math.sin(1.0), 0.0])
        down = turned(math.radians(5.0) * axis) @ normal
        seen = plane_seen(scene, view, scene.fisheye, corners_of(scene), 0.1, rng)
        pose = estimate_camera_pose(seen, scene.landmark, lens, prior_of(down))
        found.append(math.degrees(np.cross(pad_normal_cam(pose), down) @ axis))
    # The normal's turn to the vertical, about the axis of the slope.
    assert np.mean(found) == pytest.approx(5.0, abs=0.5)


def test_contradicted_vertical_is_not_believed(scene):
    # The pad lies on a slope of 35 degrees, six of the vertical's sigmas: near, the image alone must win.
    view, lens = scene.view(0.6, forward_m=0.1, pad_yaw_deg=70), lens_from_config(scene.fisheye.config)
    seen = plane_seen(scene, view, scene.fisheye, corners_of(scene), 0.1, np.random.default_rng(0))
    down = turned([math.radians(35.0), 0.0, 0.0]) @ view.rotation[:, 2]
    pose = estimate_camera_pose(seen, scene.landmark, lens, prior_of(down))
    assert turn_between_deg(rotation_of(pose), view.rotation) < 1.0


# -------------------------------------------------------------------------------------------------------- two poses
def mirrored(view):
    """The pad's normal in the other pose: mirrored at the line of sight."""
    sight, normal = view.t / np.linalg.norm(view.t), view.rotation[:, 2]
    return 2.0 * float(normal @ sight) * sight - normal


def far_poses(scene, lens_name, attitude_error_deg, aside):
    """200 views of a landmark of 12 to 20 px with the poses found: noise as of a whole landmark's edges, a vehicle
    tilted up to 15 degrees, an attitude that is off by so much, the pad this far from below it, in heights."""
    lens, rng = getattr(scene, lens_name), np.random.default_rng(7)
    app_lens = lens_from_config(lens.config)
    for _ in range(200):
        height, (bearing, tilt_to, wrong) = lens.f * 0.38 / rng.uniform(12.0, 20.0), rng.uniform(0, math.tau, 3)
        tilt_deg, off_m = rng.uniform(0, 15), rng.uniform(*aside) * height
        view = scene.view(
            height,
            forward_m=off_m * math.cos(bearing),
            right_m=off_m * math.sin(bearing),
            pad_yaw_deg=rng.uniform(-180, 180),
            roll_deg=tilt_deg * math.cos(tilt_to),
            pitch_deg=tilt_deg * math.sin(tilt_to),
        )
        error = math.radians(attitude_error_deg) * np.array([math.cos(wrong), math.sin(wrong)])
        down = off_by(view.rotation[:, 2], error)
        seen = plane_seen(scene, view, lens, corners_of(scene), 0.05, rng)
        yield view, estimate_camera_pose(seen, scene.landmark, app_lens, prior_of(down))


@pytest.mark.parametrize("attitude_error_deg", [1.0, 3.0])
@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
def test_far_landmark_never_flips_under_a_known_attitude(scene, lens_name, attitude_error_deg):
    # Seen from 9 to 17 degrees off its normal, where the other pose is twice that away.
    found = list(far_poses(scene, lens_name, attitude_error_deg, (0.16, 0.3)))
    assert max(turn_between_deg(rotation_of(pose), view.rotation) for view, pose in found) < 5.0


def test_far_landmark_right_below_is_as_level_as_the_vertical_is_believed(scene):
    # Its tilt hardly shows: what noise makes of it, the vertical holds within two of its sigmas of 6 degrees.
    found = list(far_poses(scene, "fisheye", 2.0, (0.0, 0.1)))
    turns = [turn_between_deg(rotation_of(pose), view.rotation) for view, pose in found]
    assert np.median(turns) < 3.0
    assert max(turns) < 12.0


def noisy_sequence(scene, count, sigma_px, seed=0):
    """A pad 14 px large, looked at from 17 degrees off its normal: the image hardly says which way it tilts."""
    view = scene.view(6.0, forward_m=1.8, pad_yaw_deg=20)
    rng = np.random.default_rng(seed)
    return view, [plane_seen(scene, view, scene.fisheye, corners_of(scene), sigma_px, rng) for _ in range(count)]


def flips(view, poses):
    normals = [pad_normal_cam(pose) for pose in poses]
    return [angle_deg(n, view.rotation[:, 2]) > angle_deg(n, mirrored(view)) for n in normals]


def test_pose_before_keeps_a_sequence_without_attitude_from_flipping(scene):
    lens = lens_from_config(scene.fisheye.config)
    view, sequence = noisy_sequence(scene, 150, 0.15)
    alone = [estimate_camera_pose(seen, scene.landmark, lens) for seen in sequence]
    assert sum(flips(view, alone)) > 10
    carried, expected = [], view.rotation[:, 2]
    for seen in sequence:
        carried.append(estimate_camera_pose(seen, scene.landmark, lens, expected_normal_cam=expected))
        expected = pad_normal_cam(carried[-1])
    assert not any(flips(view, carried))


def test_image_that_shows_the_pose_before_to_be_wrong_is_believed(scene):
    view, lens = scene.view(1.5, forward_m=0.5, pad_yaw_deg=20), lens_from_config(scene.fisheye.config)
    seen = plane_seen(scene, view, scene.fisheye, corners_of(scene), 0.1, np.random.default_rng(0))
    pose = estimate_camera_pose(seen, scene.landmark, lens, expected_normal_cam=mirrored(view))
    assert turn_between_deg(rotation_of(pose), view.rotation) < 3.0


def test_covariance_spans_both_poses_where_the_image_cannot_tell(scene):
    lens = lens_from_config(scene.fisheye.config)
    view, sequence = noisy_sequence(scene, 40, 0.2)
    apart = turn_vector(view.rotation[:, 2], mirrored(view))
    way = apart / np.linalg.norm(apart)
    sigma = [
        math.sqrt(way @ estimate_camera_pose(seen, scene.landmark, lens).covariance[3:, 3:] @ way) for seen in sequence
    ]
    assert np.linalg.norm(apart) == pytest.approx(2.0 * math.atan(0.3), rel=1e-6)
    assert np.median(sigma) > 0.3 * np.linalg.norm(apart)
    # Near, the image tells.
    close = scene.view(1.0, forward_m=0.3, pad_yaw_deg=20)
    seen = plane_seen(scene, close, scene.fisheye, corners_of(scene), 0.1, np.random.default_rng(0))
    told = estimate_camera_pose(seen, scene.landmark, lens)
    assert math.sqrt(way @ told.covariance[3:, 3:] @ way) < math.radians(2.0)


def turn_vector(a, b):
    """Shortest rotation that takes a unit vector to another."""
    axis = np.cross(a, b)
    return axis / np.linalg.norm(axis) * math.radians(angle_deg(a, b))


# -------------------------------------------------------------------------------------------------- odd detections
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
    assert turn_between_deg(rotation_of(pose), view.rotation) < 1.5


def test_nothing_seen_gives_no_pose(scene):
    lens = lens_from_config(scene.fisheye.config)
    assert estimate_camera_pose(Detection(0.0, 0, reason="no"), scene.landmark, lens) is None


def test_corners_on_one_point_give_no_pose(scene):
    lens = lens_from_config(scene.fisheye.config)
    same = Detection(0.0, 0, contours=(SeenContour(0, np.full((4, 2), 300.0)), SeenContour(1, np.full((4, 2), 300.0))))
    assert estimate_camera_pose(same, scene.landmark, lens) is None


@pytest.mark.parametrize(
    "plane",
    [
        PlaneFit(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 2]]), np.zeros((8, 8)), 0.19),
        PlaneFit(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 2]]), -np.eye(8), 0.19),
        PlaneFit(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 2]]), np.full((8, 8), np.nan), 0.19),
        PlaneFit(np.array([[1.0, 1, 0], [0, 0, 0], [0, 0, 2]]), np.eye(8), 0.19),
        PlaneFit(np.full((3, 3), np.nan), np.eye(8), 0.19),
    ],
    ids=["no information", "negative information", "no numbers", "edge on", "no map"],
)
@pytest.mark.parametrize("prior", [True, False])
def test_plane_that_says_nothing_gives_no_pose(scene, plane, prior):
    seen = Detection(0.0, 0, contours=(SeenContour(0, np.zeros((4, 2))),), plane=plane)
    level = np.eye(3) if prior else None
    assert estimate_camera_pose(seen, scene.landmark, lens_from_config(scene.fisheye.config), level) is None


def test_plane_whose_information_lacks_directions_is_completed_by_the_vertical(scene):
    # Only where the middle is, the size and the heading are known: d2, d5, d0 + d4 and d1 - d3.
    view, lens = scene.view(2.0, pad_yaw_deg=40), lens_from_config(scene.fisheye.config)
    known = np.zeros((4, 8))
    known[0, 2] = known[1, 5] = known[2, 0] = known[2, 4] = known[3, 1] = 1.0
    known[3, 3] = -1.0
    plane = PlaneFit(np.column_stack([view.rotation[:, :2], view.t]), 1e6 * known.T @ known, 0.19)
    seen = Detection(0.0, 0, contours=(SeenContour(0, np.zeros((4, 2))),), plane=plane)
    pose = estimate_camera_pose(seen, scene.landmark, lens, view.rotation)
    np.testing.assert_allclose(pose.t_cam_from_pad_m, view.t, atol=1e-3)
    # Its tilt is as well known as the vertical is.
    normal = view.rotation[:, 2]
    tilt = np.trace(pose.covariance[3:, 3:]) - normal @ pose.covariance[3:, 3:] @ normal
    assert math.degrees(math.sqrt(tilt / 2.0)) == pytest.approx(6.0, rel=0.05)


def test_predicted_corners_lie_where_the_landmark_is(scene):
    view = scene.view(0.5, forward_m=0.1, pad_yaw_deg=50, roll_deg=12)
    lens = lens_from_config(scene.fisheye.config)
    pose = estimate_camera_pose(detection_of(scene, view, scene.fisheye, (2, 3, 4)), scene.landmark, lens)
    np.testing.assert_allclose(
        predicted_corners_px(pose, scene.landmark, lens), scene.corners_px(view, 0, scene.fisheye), atol=0.05
    )


def test_pads_normal_is_the_poses_third_axis(scene):
    view = scene.view(0.5, forward_m=0.1, pad_yaw_deg=50, roll_deg=12)
    lens = lens_from_config(scene.fisheye.config)
    pose = estimate_camera_pose(detection_of(scene, view, scene.fisheye), scene.landmark, lens)
    np.testing.assert_allclose(pad_normal_cam(pose), view.rotation[:, 2], atol=1e-4)
