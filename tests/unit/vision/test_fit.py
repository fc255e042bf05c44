import numpy as np
import pytest

from app.vision.align import align
from app.vision.camera_model import lens_from_config
from app.vision.edges import measure_sides
from app.vision.evidence import judge, rectify
from app.vision.fit import Fit, affine, apply, fit_run, homography, project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.preprocess import prepare, whole


@pytest.fixture(scope="module")
def geometry(scene):
    return LandmarkGeometry(scene.landmark)


def true_fit(view, **moved):
    """The fit that a view is: columns r1, r2, t, and the pad moved on its plane in metres."""
    matrix = np.column_stack([view.rotation[:, 0], view.rotation[:, 1], view.t])
    shift = np.eye(3)
    shift[:2, 2] = moved.get("by", (0.0, 0.0))
    grown = np.diag([moved.get("scale", 1.0)] * 2 + [1.0])
    return Fit(matrix @ shift @ grown, np.eye(3), np.zeros((4, 2)), np.arange(4), 0.0)


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


def test_sides_are_measured_where_they_are_from_a_fit_that_is_off(scene, geometry):
    view = scene.view(0.8, forward_m=0.1, pad_yaw_deg=20)
    image = scene.draw(view)
    lens = lens_from_config(scene.fisheye.config)
    off = true_fit(view, by=(0.003, -0.003), scale=1.005)
    sides = measure_sides(prepare(image, whole(image)), off.rays_from_pad, off.basis, geometry, lens, range(5), 2.6)
    outer = geometry.slices[0]
    assert sides.corner_found[outer].all()
    rays = np.column_stack([sides.corners_plane[outer], np.ones(4)])
    np.testing.assert_allclose(lens.project(rays)[0], scene.corners_px(view, 0, scene.fisheye), atol=0.12)


def test_sides_out_of_the_image_are_not_found(scene, geometry):
    view = scene.view(0.5, forward_m=0.17)
    image = scene.draw(view, lens=scene.pinhole)
    fit = true_fit(view)
    sides = measure_sides(
        prepare(image, whole(image)),
        fit.rays_from_pad,
        fit.basis,
        geometry,
        lens_from_config(scene.pinhole.config),
        range(5),
        2.0,
    )
    assert not sides.found[0]  # the front of S1
    assert sides.corner_found[geometry.slices[4]].all()


@pytest.mark.parametrize("height_m", [3.0, 5.0])
def test_small_landmark_is_aligned_to_a_tenth_of_a_pixel(scene, geometry, height_m):
    view = scene.view(height_m, forward_m=0.3, pad_yaw_deg=40)
    image = scene.draw(view, noise=1.0)
    lens = lens_from_config(scene.fisheye.config)
    off = true_fit(view, by=(0.012, -0.009), scale=1.03)
    fit, _ = align(prepare(image, whole(image)), off, geometry, lens, 215.0 / height_m, 0.8)
    found, _ = project_pad(fit.rays_from_pad, scene.landmark.contours[0].corners_m, lens)
    np.testing.assert_allclose(found, scene.corners_px(view, 0, scene.fisheye), atol=0.15)


def test_patch_of_the_landmark_correlates_and_that_of_the_lawn_does_not(scene, geometry):
    view = scene.view(1.0, pad_yaw_deg=40)
    lens = lens_from_config(scene.fisheye.config)
    judged = [
        judge(rectify(prepare(image, whole(image)), true_fit(view), geometry, lens, 215.0, 0.8), 1, geometry)
        for image in (scene.draw(view), scene.draw(view, polygons=[]))
    ]
    assert judged[0].whole > 0.98
    assert judged[0].inner > 0.97
    # 215 - 25 grey levels were drawn.
    assert judged[0].contrast == pytest.approx(190, rel=0.03)
    assert abs(judged[1].whole) < 0.3
