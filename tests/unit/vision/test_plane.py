"""Warps and fits of the landmark's plane, against a textbook projection."""

import math

import numpy as np
import pytest

from app.vision.camera_model import lens_from_config
from app.vision.plane import along_normals, plane_fit_from_corners, warp_jacobian, warped

UNIT_M = 0.19
PLACES = [
    {"height_m": 0.3, "forward_m": 0.1, "pad_yaw_deg": 20, "roll_deg": 10},
    {"height_m": 2.0, "right_m": 0.4, "pad_yaw_deg": -100, "pitch_deg": 25},
    {"height_m": 6.0, "forward_m": -2.0, "right_m": 1.0, "pad_yaw_deg": 170, "roll_deg": -12},
]


def seen_from(view, lens, points, warp=None):
    """Textbook pixels of points (n, 2) of the pad, after a warp W of the pad's plane in units of UNIT_M."""
    unit = np.column_stack([points / UNIT_M, np.ones(len(points))])
    moved = unit if warp is None else unit @ warp.T
    rays = moved @ (np.column_stack([view.rotation[:, :2] * UNIT_M, view.t])).T
    return lens.project(rays)


def warp_of(d):
    return np.array([[1 + d[0], d[1], d[2]], [d[3], 1 + d[4], d[5]], [d[6], d[7], 1.0]])


def corners_of(scene, contours=range(5)):
    return np.concatenate([scene.landmark.contours[k].corners_m for k in contours])


def true_map(view):
    return np.column_stack([view.rotation[:, :2], view.t])


@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
@pytest.mark.parametrize("place", PLACES, ids=lambda p: f"{p['height_m']} m")
def test_warp_jacobian_is_how_the_textbooks_pixels_move(scene, lens_name, place):
    lens, view = getattr(scene, lens_name), scene.view(**place)
    points = corners_of(scene)
    px, jacobian, valid = warp_jacobian(3.0 * true_map(view), points, lens_from_config(lens.config), UNIT_M)
    assert valid.all()
    np.testing.assert_allclose(px, seen_from(view, lens, points), atol=1e-9)
    h = 1e-5
    for k, way in enumerate(np.eye(8)):
        slope = (seen_from(view, lens, points, warp_of(h * way)) - seen_from(view, lens, points, warp_of(-h * way))) / (
            2 * h
        )
        np.testing.assert_allclose(jacobian[:, :, k], slope, atol=1e-4 * np.abs(slope).max())


def test_motion_along_normals_is_the_part_of_the_motion_across_the_edge():
    jacobian = np.zeros((2, 2, 8))
    jacobian[0, 0, 3], jacobian[0, 1, 3], jacobian[1, 1, 7] = 2.0, 5.0, -4.0
    across = along_normals(jacobian, np.array([[0.6, 0.8], [0.0, -1.0]]))
    assert across.shape == (2, 8)
    assert across[0, 3] == pytest.approx(0.6 * 2.0 + 0.8 * 5.0)
    assert across[1, 7] == pytest.approx(4.0)
    assert np.count_nonzero(across) == 2


def test_warped_map_is_the_product_of_its_definition():
    rng = np.random.default_rng(0)
    matrix, d = rng.normal(size=(3, 3)), rng.normal(size=8)
    scale = np.diag([UNIT_M, UNIT_M, 1.0])
    np.testing.assert_allclose(warped(matrix, d, UNIT_M), matrix @ scale @ warp_of(d) @ np.linalg.inv(scale))


@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
@pytest.mark.parametrize("contours", [(0, 1, 2, 3, 4), (3, 4), (0,)], ids=str)
@pytest.mark.parametrize("place", PLACES, ids=lambda p: f"{p['height_m']} m")
def test_fit_to_exact_corners_is_the_true_map(scene, lens_name, contours, place):
    lens, view = getattr(scene, lens_name), scene.view(**place)
    points = corners_of(scene, contours)
    fit = plane_fit_from_corners(points, seen_from(view, lens, points), lens_from_config(lens.config), 0.1, UNIT_M)
    truth = true_map(view)
    np.testing.assert_allclose(
        fit.rays_from_pad / np.linalg.norm(fit.rays_from_pad), truth / np.linalg.norm(truth), atol=1e-6
    )
    assert fit.residual_px < 1e-6
    assert fit.unit_m == UNIT_M


@pytest.mark.parametrize(
    ("place", "sigma_px", "contours"),
    [(PLACES[0], 0.3, (0, 1, 2, 3, 4)), (PLACES[1], 0.1, (0, 1, 2, 3, 4)), (PLACES[2], 0.05, (0, 1))],
    ids=["near", "tilted", "far"],
)
def test_information_is_that_of_the_errors_of_noisy_corners(scene, place, sigma_px, contours):
    # The true map is rays_from_pad S W(d) S^-1, so d comes from the two maps; d' Lambda d is chi squared of 8.
    view, points = scene.view(**place), corners_of(scene, contours)
    lens, exact = lens_from_config(scene.fisheye.config), seen_from(view, scene.fisheye, points)
    scale, rng = np.diag([UNIT_M, UNIT_M, 1.0]), np.random.default_rng(5)
    squared, residual = [], []
    for _ in range(300):
        fit = plane_fit_from_corners(points, exact + rng.normal(0.0, sigma_px, exact.shape), lens, sigma_px, UNIT_M)
        warp = np.linalg.inv(fit.rays_from_pad @ scale) @ true_map(view) @ scale
        d = (warp / warp[2, 2] - np.eye(3)).reshape(-1)[:8]
        squared.append(float(d @ fit.information @ d))
        residual.append(fit.residual_px)
    # The mean of 300 has a standard deviation of sqrt(16 / 300) = 0.23.
    assert np.mean(squared) == pytest.approx(8.0, abs=2.0 * 0.23)
    free = 2 * len(points) - 8
    assert np.sqrt(np.mean(np.square(residual))) == pytest.approx(sigma_px * math.sqrt(free / len(points)), rel=0.1)


def test_wild_corner_pulls_less_under_huber(scene):
    view, points = scene.view(1.0, forward_m=0.1), corners_of(scene)
    lens, px = lens_from_config(scene.fisheye.config), seen_from(view, scene.fisheye, points)
    px[6] += [9.0, -6.0]
    off = [
        np.abs(warp_jacobian(fit.rays_from_pad, points, lens, UNIT_M)[0] - seen_from(view, scene.fisheye, points)).max()
        for huber in (math.inf, 2.5)
        for fit in [plane_fit_from_corners(points, px, lens, 0.1, UNIT_M, huber_sigmas=huber)]
    ]
    assert off[1] < 0.25 < off[0]


@pytest.mark.parametrize(
    "corners_px",
    [
        np.full((8, 2), 300.0),
        np.column_stack([np.linspace(200.0, 300.0, 8), np.full(8, 240.0)]),
        np.full((8, 2), np.nan),
        np.array([[0.0, 240.0], [639.0, 240.0], [639.0, 241.0], [0.0, 241.0]] * 2) * 30.0,
    ],
    ids=["one point", "a line", "no numbers", "outside the lens's view"],
)
def test_corners_that_determine_no_plane_give_none(scene, corners_px):
    lens = lens_from_config(scene.fisheye.config)
    assert plane_fit_from_corners(corners_of(scene, (0, 1)), corners_px, lens, 0.1, UNIT_M) is None


def test_three_corners_are_too_few(scene):
    lens, points = lens_from_config(scene.fisheye.config), corners_of(scene, (2,))
    px = seen_from(scene.view(1.0), scene.fisheye, points)
    assert plane_fit_from_corners(points, px, lens, 0.1, UNIT_M) is None
