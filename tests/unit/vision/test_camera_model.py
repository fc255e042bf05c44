import math

import cv2
import numpy as np
import pytest

from app.config import LensConfig
from app.vision.camera_model import lens_from_config, tangent_basis

BROWN = (-0.3, 0.1, 0.001, -0.002, 0.01)
KANNALA = (0.05, -0.01, 0.003, -0.001)


def lens_config(model, f=300.0, distortion=()):
    return LensConfig(
        model=model,
        width_px=640,
        height_px=480,
        fx_px=f,
        fy_px=f * 1.02,
        cx_px=310.0,
        cy_px=250.0,
        distortion=distortion,
    )


@pytest.fixture
def points():
    rng = np.random.default_rng(4)
    return np.column_stack([rng.uniform(-0.8, 0.8, 200), rng.uniform(-0.6, 0.6, 200), rng.uniform(0.9, 3.0, 200)])


CAMERA_MATRIX = np.array([[300.0, 0.0, 310.0], [0.0, 306.0, 250.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("distortion", [(), BROWN[:4], BROWN])
def test_pinhole_projection_agrees_with_opencv(points, distortion):
    lens = lens_from_config(lens_config("pinhole", distortion=distortion))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), CAMERA_MATRIX, np.array(distortion or (0.0,) * 4))
    px, valid = lens.project(points)
    assert valid.all()
    np.testing.assert_allclose(px, theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize("distortion", [(), KANNALA])
def test_equidistant_projection_agrees_with_opencv_fisheye(points, distortion):
    lens = lens_from_config(lens_config("equidistant", distortion=distortion))
    theirs, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), CAMERA_MATRIX, np.array(distortion or (0.0,) * 4)
    )
    px, valid = lens.project(points)
    assert valid.all()
    np.testing.assert_allclose(px, theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("model", "distortion"), [("pinhole", ()), ("pinhole", BROWN), ("equidistant", ()), ("equidistant", KANNALA)]
)
def test_rays_of_projected_points_point_at_them(points, model, distortion):
    lens = lens_from_config(lens_config(model, distortion=distortion))
    px, _ = lens.project(points)
    directions = points / np.linalg.norm(points, axis=1)[:, None]
    np.testing.assert_allclose(lens.rays(px), directions, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "distortion"), [("pinhole", ()), ("pinhole", BROWN), ("equidistant", ()), ("equidistant", KANNALA)]
)
def test_jacobian_agrees_with_differences(points, model, distortion):
    lens = lens_from_config(lens_config(model, distortion=distortion))
    px, jacobian, valid = lens.project_with_jacobian(points)
    steps = 1e-6 * np.eye(3)
    by_differences = np.stack([(lens.project(points + s)[0] - lens.project(points - s)[0]) / 2e-6 for s in steps], -1)
    assert valid.all()
    np.testing.assert_allclose(px, lens.project(points)[0], atol=1e-9)
    np.testing.assert_allclose(jacobian, by_differences, atol=1e-5)


def test_equidistant_ray_at_45_degrees_lands_a_quarter_pi_of_focal_lengths_out():
    lens = lens_from_config(lens_config("equidistant", f=200.0))
    px, _ = lens.project(np.array([[1.0, 0.0, 1.0]]))
    np.testing.assert_allclose(px, [[310.0 + 200.0 * math.pi / 4, 250.0]], atol=1e-9)


def test_equidistant_sees_beyond_90_degrees():
    lens = lens_from_config(lens_config("equidistant", f=200.0))
    angle = math.radians(100.0)
    ray = np.array([[math.sin(angle), 0.0, math.cos(angle)]])
    px, valid = lens.project(ray)
    assert valid.all()
    np.testing.assert_allclose(px, [[310.0 + 200.0 * angle, 250.0]], atol=1e-9)
    np.testing.assert_allclose(lens.rays(px), ray, atol=1e-12)


@pytest.mark.parametrize("model", ["pinhole", "equidistant"])
def test_point_on_the_axis_lands_on_the_principal_point(model):
    px, jacobian, valid = lens_from_config(lens_config(model)).project_with_jacobian(np.array([[0.0, 0.0, 2.0]]))
    assert valid.all()
    np.testing.assert_allclose(px, [[310.0, 250.0]])
    np.testing.assert_allclose(jacobian, [[[150.0, 0.0, 0.0], [0.0, 153.0, 0.0]]], atol=1e-12)


def test_pinhole_point_behind_the_camera_is_invalid():
    px, valid = lens_from_config(lens_config("pinhole")).project(np.array([[0.1, 0.1, -1.0]]))
    assert not valid.any()
    assert np.isnan(px).all()


def test_pinhole_point_beyond_the_fold_of_its_distortion_is_invalid():
    # r (1 - 0.3 r^2) turns back at r = sqrt(1 / 0.9) = 1.054.
    lens = lens_from_config(lens_config("pinhole", distortion=(-0.3, 0.0, 0.0, 0.0)))
    _, valid = lens.project(np.array([[1.0, 0.0, 1.0], [1.1, 0.0, 1.0]]))
    assert valid.tolist() == [True, False]


def test_pinhole_pixel_that_no_ray_reaches_has_no_ray():
    # The distorted radius is at most 1.054 (1 - 0.3 * 1.111) = 0.703: 211 px from the centre.
    lens = lens_from_config(lens_config("pinhole", distortion=(-0.3, 0.0, 0.0, 0.0)))
    rays = lens.rays(np.array([[310.0 + 205.0, 250.0], [310.0 + 230.0, 250.0]]))
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).any()


@pytest.mark.parametrize("ray", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.05), (0.9, -0.3, -0.2), (-1.0, 0.0, 0.0)])
def test_tangent_basis_is_a_rotation_that_looks_along_the_ray(ray):
    direction = np.array(ray) / np.linalg.norm(ray)
    basis = tangent_basis(3.0 * direction)
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(basis) == pytest.approx(1.0)
    np.testing.assert_allclose(basis @ direction, [0.0, 0.0, 1.0], atol=1e-12)
