import numpy as np
import pytest

from app.vision.camera_model import lens_from_config
from app.vision.fit import affine, apply, fit_run, homography, project_pad
from app.vision.geometry import LandmarkGeometry


@pytest.fixture(scope="module")
def geometry(scene):
    return LandmarkGeometry(scene.landmark)


def test_homography_of_hand_worked_points():
    # Unit square to a trapezium: (x, y) -> (x, y) / (1 + y / 2), scaled by 3 and moved by (10, 20).
    source = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]])
    target = np.array([[10.0, 20.0], [13.0, 20.0], [12.0, 22.0], [10.0, 22.0], [11.2, 21.2]])
    np.testing.assert_allclose(apply(homography(source, target), source), target, atol=1e-9)


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.array([[0.0, 0.0], [1, 1], [2, 2], [3, 3]])])
def test_points_on_a_line_determine_no_homography(points):
    found = homography(points, np.array([[0.0, 0.0], [1, 0], [1, 1], [0, 1]]))
    assert found is None or not np.allclose(apply(found, points), [[0.0, 0.0], [1, 0], [1, 1], [0, 1]], atol=1e-3)


def test_affine_takes_three_points_to_three_points():
    source, target = np.array([[0.0, 0.0], [1, 0], [0, 1]]), np.array([[5.0, 5.0], [7, 6], [4, 9]])
    np.testing.assert_allclose(apply(affine(source, target), source), target)


@pytest.mark.parametrize(("first", "count"), [(0, 5), (0, 3), (1, 2), (2, 2), (2, 3), (3, 2)])
@pytest.mark.parametrize("start", [0, 1, 2])
def test_run_is_laid_the_right_way_round_from_whichever_corner(scene, geometry, first, count, start):
    view = scene.view(0.8, forward_m=0.2, pad_yaw_deg=130, roll_deg=20)
    corners = [np.roll(scene.corners_px(view, first + i, scene.fisheye), start * (i + 1), axis=0) for i in range(count)]
    lens = lens_from_config(scene.fisheye.config)
    fits = fit_run(corners, first, geometry, lens)
    truth = scene.corners_px(view, 2, scene.fisheye)
    found = [project_pad(f.rays_from_pad, scene.landmark.contours[2].corners_m, lens)[0] for f in fits]
    # Two triangles about one centroid can lie three ways; the picture decides. All else lies one way.
    assert len(fits) == (3 if (first, count) == (2, 2) else 1)
    assert min(np.abs(f - truth).max() for f in found) < 1e-2
    assert fits[0].residual_px < 1e-2


def test_two_concentric_squares_can_lie_four_ways(scene, geometry):
    view = scene.view(1.0, pad_yaw_deg=30)
    lens = lens_from_config(scene.fisheye.config)
    fits = fit_run([scene.corners_px(view, k, scene.fisheye) for k in (0, 1)], 0, geometry, lens)
    apexes = np.array([project_pad(f.rays_from_pad, scene.landmark.contours[2].corners_m, lens)[0][0] for f in fits])
    truth = scene.corners_px(view, 2, scene.fisheye)[0]
    assert len(fits) == 4
    assert np.linalg.norm(apexes - truth, axis=1).min() < 0.05
