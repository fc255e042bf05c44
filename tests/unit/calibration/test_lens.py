"""Lenses recovered from views that a textbook camera would give; OpenCV's own fits as a second oracle."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from app.calibration.lens import VIEWS_MIN, calibrate_lens
from app.calibration.parameters import NAMES, Model, parameter_jacobian
from app.calibration.start import first_fit, pose_from_rays
from app.errors import CalibrationError

NOISE_PX = 0.1


@pytest.fixture(scope="module")
def waved(bench):
    """Twenty-four views through each lens."""
    return {c.model: bench.wave(c, 24, noise=NOISE_PX) for c in (bench.pinhole, bench.fisheye)}


@pytest.fixture(scope="module")
def calibrated(waved):
    return {name: calibrate_lens(views, name) for name, views in waved.items()}


@pytest.fixture
def truth(bench):
    return {c.model: c for c in (bench.pinhole, bench.fisheye)}


@pytest.mark.parametrize(("model", "focal_px", "centre_px"), [("pinhole", 1.5, 3.0), ("equidistant", 0.4, 0.4)])
def test_lens_from_twenty_four_views_has_the_true_focal_length_and_centre(
    calibrated, truth, model, focal_px, centre_px
):
    found, true = calibrated[model].fitted.parameters, truth[model].parameters
    np.testing.assert_allclose(found[:2], true[:2], atol=focal_px)
    np.testing.assert_allclose(found[2:4], true[2:4], atol=centre_px)


@pytest.mark.parametrize("model", ["pinhole", "equidistant"])
def test_directions_fall_where_the_true_lens_puts_them_within_the_stated_uncertainty(calibrated, truth, model):
    found = calibrated[model]
    rays = found.lens.rays(found.grid.centres_px())
    seen = found.grid.counts(np.concatenate([v.px for v in found.used])).ravel() > 0
    # A turn of the camera belongs to its mount: the one that brings the directions that were seen nearest is taken out.
    px = found.grid.centres_px()
    for _ in range(10):
        slope = np.stack([truth[model].project(rays + 1e-6 * np.cross(axis, rays)) for axis in np.eye(3)], axis=-1)
        here = truth[model].project(rays)
        slope = (slope - here[..., None]) / 1e-6
        step = np.linalg.lstsq(slope[seen].reshape(-1, 3), (px - here)[seen].ravel(), rcond=None)[0]
        rays = rays + np.cross(step, rays)
    off = np.linalg.norm(truth[model].project(rays) - px, axis=1)
    assert off[seen].max() < 0.5
    assert (off < 4 * found.place_sigma_px.ravel() + 0.02).all()


@pytest.mark.parametrize("model", ["pinhole", "equidistant"])
def test_lens_uncertainty_covers_the_true_parameters_with_a_full_model(waved, truth, model):
    full = Model(model, waved[model][0].size_px)
    found = first_fit(waved[model], full)
    sigma = np.sqrt(np.diag(found.covariance))
    z = (found.parameters - truth[model].parameters) / sigma
    # Nine and eight normal numbers: a root mean square over 1.7 has a chance of one in a thousand.
    assert np.sqrt(np.mean(z**2)) < 1.7
    assert (np.abs(z) < 3.7).all()


@pytest.mark.parametrize("model", ["pinhole", "equidistant"])
def test_error_of_the_fit_and_of_views_held_out_is_the_noise(calibrated, model):
    expected = NOISE_PX * np.sqrt(2)  # of a distance, both coordinates
    found = calibrated[model]
    assert found.fitted.total_rms_px == pytest.approx(expected, rel=0.08)
    assert found.held_out_rms_px == pytest.approx(expected, rel=0.08)
    assert found.held_out_px.shape == found.fitted.rms_px.shape == (len(found.used),)


def test_pinhole_fit_agrees_with_opencv(waved, bench):
    views = waved["pinhole"]
    found = first_fit(views, Model("pinhole", bench.size))
    objects = [v.corners_m.astype(np.float32) for v in views]
    images = [v.px.astype(np.float32) for v in views]
    rms, matrix, k, *_ = cv2.calibrateCamera(objects, images, bench.size, None, None)
    oracle = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *k.ravel()[:5]])
    # The fits differ by their loss: Huber's counts the largest tenths of a percent of the residuals less.
    np.testing.assert_allclose(found.parameters, oracle, atol=0.25 * np.sqrt(np.diag(found.covariance)).max())
    np.testing.assert_allclose((found.parameters - oracle) / np.sqrt(np.diag(found.covariance)), 0.0, atol=0.3)
    assert found.total_rms_px == pytest.approx(rms, rel=1e-3)


def test_fisheye_fit_agrees_with_opencv_where_that_can_look(waved, bench):
    # OpenCV's own calibration takes no corner beyond 90 degrees.
    views = [v for v in waved["equidistant"] if np.hypot(*(v.px - [324.0, 236.0]).T).max() < 215 * 1.2]
    assert len(views) >= 10
    found = first_fit(views, Model("equidistant", bench.size))
    objects = [v.corners_m.reshape(1, -1, 3) for v in views]
    images = [v.px.reshape(1, -1, 2) for v in views]
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    rms, matrix, k, *_ = cv2.fisheye.calibrate(objects, images, bench.size, None, None, flags=flags)
    oracle = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *k.ravel()])
    np.testing.assert_allclose((found.parameters - oracle) / np.sqrt(np.diag(found.covariance)), 0.0, atol=0.3)
    assert found.total_rms_px == pytest.approx(rms, rel=1e-3)


def test_fisheye_learns_from_corners_beyond_ninety_degrees(bench):
    camera = bench.camera("equidistant", 120.0, 120.0, 322.0, 238.0, (0.02, -0.004, 0.0, 0.0))
    rng = np.random.default_rng(3)
    views = [
        bench.view_of(
            camera, bench.hold(a, angle, 0.2, tuple(rng.uniform(-0.4, 0.4, 3))), f"{k}", rng.normal(0, 0.1, (54, 2))
        )
        for k, (a, angle) in enumerate((a, angle) for a in np.linspace(0, 5.5, 8) for angle in (0.3, 0.9, 1.4))
    ]
    beyond = max(float(np.hypot(*(v.px - [322.0, 238.0]).T).max()) for v in views)
    assert beyond > 120.0 * (1.65 + 0.02 * 1.65**3)
    found = first_fit(views, Model("equidistant", bench.size))
    sigma = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.parameters - camera.parameters) < 4 * sigma).all()
    assert sigma[0] < 0.5


@pytest.mark.parametrize("focal", [180.0, 495.0, 2400.0])
def test_fit_finds_its_own_start_for_wide_and_long_lenses(bench, focal):
    camera = bench.camera("pinhole", focal, focal, 320.0, 240.0, (0.0,) * 5)
    rng = np.random.default_rng(5)
    distance = 0.25 * focal / 180.0
    views = [
        bench.view_of(
            camera,
            bench.hold(a, 60.0 / focal, distance, tuple(rng.uniform(-0.6, 0.6, 3))),
            f"{a}",
            rng.normal(0, 0.05, (54, 2)),
        )
        for a in np.linspace(0, 6, 12)
    ]
    found = first_fit(views, Model("pinhole", bench.size, frozenset({"k1", "k2", "k3", "p1", "p2"})))
    assert found.parameters[0] == pytest.approx(focal, rel=0.01)


def test_k3_is_held_at_zero_unless_the_data_ask_for_it(bench, calibrated):
    assert calibrated["pinhole"].fitted.model.held == {"k3"}
    bent = replace(bench.pinhole, k=(-0.30, 0.30, 0.0, 0.0, -0.30))
    asked = calibrate_lens(bench.wave(bent, 20, noise=0.05), "pinhole")
    assert asked.fitted.model.held == frozenset()
    assert asked.fitted.parameters[8] == pytest.approx(-0.30, abs=0.06)


def test_view_that_does_not_fit_is_dropped_with_its_error_and_the_others_stay(bench, waved, calibrated):
    views = list(waved["pinhole"])
    bent = views[4].px + 2.5 * np.sin(views[4].corners_m[:, :2] * 60.0)  # a board that is not flat
    views[4] = replace(views[4], name="bent.png", px=bent)
    found = calibrate_lens(views, "pinhole")
    assert [item.name for item in found.dropped] == ["bent.png"]
    assert "does not fit: corners are" in found.dropped[0].reason
    assert len(found.used) == 23
    assert found.fitted.parameters[0] == pytest.approx(calibrated["pinhole"].fitted.parameters[0], abs=0.5)


def test_single_wrong_corners_pull_little(bench, waved, calibrated):
    rng = np.random.default_rng(2)
    views = []
    for view in waved["equidistant"]:
        px = view.px.copy()
        px[rng.integers(54)] += rng.uniform(-1.5, 1.5, 2)
        views.append(replace(view, px=px))
    found = calibrate_lens(views, "equidistant")
    np.testing.assert_allclose(found.fitted.parameters[:4], calibrated["equidistant"].fitted.parameters[:4], atol=0.25)


def test_uncertainty_of_a_pixel_grows_where_no_corner_was_seen(bench):
    middle = bench.wave(bench.fisheye, 15, inside=lambda px: float(np.abs(px - [320, 240]).max()) < 160)
    sigma = calibrate_lens(middle, "equidistant").place_sigma_px
    assert sigma[[0, 0, -1, -1], [0, -1, 0, -1]].min() > 10 * sigma[2:4, 3:5].max()


def test_too_few_views_are_refused_with_their_number(waved):
    with pytest.raises(CalibrationError, match=rf"5 usable view\(s\) of the board, at least {VIEWS_MIN} are needed"):
        calibrate_lens(waved["pinhole"][:5], "pinhole")


@pytest.mark.parametrize("model", ["pinhole", "equidistant"])
def test_parameter_jacobian_is_the_slope_of_the_true_projection(bench, truth, model):
    camera = truth[model]
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.4, 0.4, 20), rng.uniform(-0.3, 0.3, 20), rng.uniform(0.5, 1.0, 20)])
    found = parameter_jacobian(Model(model, bench.size), camera.parameters, points, camera.project(points))
    for k in range(len(NAMES[model])):
        step = np.zeros(len(NAMES[model]))
        step[k] = 1e-4 * max(1.0, abs(camera.parameters[k]))
        up, down = (
            bench.camera(model, *(camera.parameters + sign * step)[:4], tuple((camera.parameters + sign * step)[4:]))
            for sign in (1, -1)
        )
        slope = (up.project(points) - down.project(points)) / (2 * step[k])
        np.testing.assert_allclose(found[:, :, k], slope, atol=1e-5 * max(1.0, np.abs(slope).max()))


def test_pose_from_rays_is_the_pose_also_behind_ninety_degrees(bench):
    rotation, t = bench.hold(1.0, 1.5, 0.2, (0.3, -0.2, 0.5))
    corners = bench.board.corners_m
    points = corners @ rotation.T + t
    assert (points[:, 2] < 0).any()
    found, where = pose_from_rays(corners, points / np.linalg.norm(points, axis=1)[:, None])
    np.testing.assert_allclose(found, rotation, atol=1e-9)
    np.testing.assert_allclose(where, t, atol=1e-9)
