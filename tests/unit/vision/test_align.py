"""A small landmark's picture aligned, against maps known from geometry."""

import numpy as np
import pytest

from app.vision.align import align

SIDES_PX = [12, 16, 24, 36, 55]


def small_view(scene, lens, side_px, yaw_deg=25.0, right=-0.08):
    h = lens.f * 0.38 / side_px
    return scene.view(h, forward_m=0.05 * h, right_m=right * h, pad_yaw_deg=yaw_deg, roll_deg=5, pitch_deg=-4)


@pytest.mark.parametrize("side_px", SIDES_PX)
@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
def test_map_that_is_off_comes_back_to_a_tenth_of_a_pixel(scene, maps, lens_name, side_px):
    lens = getattr(scene, lens_name)
    view = small_view(scene, lens, side_px)
    start = maps.off_by(view, 0.05 * side_px, side_px, seed=side_px)
    found = align(maps.look_at(scene.draw(view, lens=lens, noise=1.0), lens), start, 8)
    assert maps.rms_px(found.rays_from_pad, view, lens, [0]) < 0.1
    assert found.correlation > 0.97
    # 215 - 25 grey levels were drawn; how much blur takes of them can be told only where bands are wide.
    assert found.contrast == pytest.approx(190, rel=0.25)


@pytest.mark.parametrize("side_px", [14, 30, 50])
@pytest.mark.parametrize(
    "light",
    [lambda p: 0.8 + 1.2 * p[..., 0], lambda p: 0.8 - 0.6 * p[..., 0] + 0.9 * p[..., 1]],
    ids=["to the front", "across"],
)
def test_gradient_of_the_light_does_not_move_it(scene, maps, side_px, light):
    # From one side of the landmark to the other the light changes by half.
    view = small_view(scene, scene.fisheye, side_px)
    image = scene.draw(view, noise=1.0, light=lambda p: np.clip(light(p), 0.2, 1.4))
    found = align(maps.look_at(image, scene.fisheye), maps.off_by(view, 0.03 * side_px, side_px), 8)
    assert maps.rms_px(found.rays_from_pad, view, scene.fisheye, [0]) < 0.15


@pytest.mark.parametrize(("blur_px", "limit_px"), [(0.3, 0.12), (1.0, 0.12), (1.5, 0.2)])
@pytest.mark.parametrize("side_px", [14, 30, 50])
def test_blur_hardly_moves_it(scene, maps, side_px, blur_px, limit_px):
    view = small_view(scene, scene.fisheye, side_px)
    image = scene.draw(view, noise=1.0, blur_px=blur_px)
    found = align(maps.look_at(image, scene.fisheye), maps.off_by(view, 0.03 * side_px, side_px), 8)
    assert maps.rms_px(found.rays_from_pad, view, scene.fisheye, [0]) < limit_px


@pytest.mark.parametrize("gain", [0.25, 0.5, 1.15])
def test_exposure_does_not_move_it(scene, maps, gain):
    view = small_view(scene, scene.fisheye, 30)
    found = align(maps.look_at(scene.draw(view, noise=1.0, gain=gain), scene.fisheye), maps.off_by(view, 1.0, 30), 8)
    assert maps.rms_px(found.rays_from_pad, view, scene.fisheye, [0]) < 0.1
    assert found.contrast == pytest.approx(190 * gain, rel=0.15)


@pytest.mark.parametrize("noise_dn", [2.0, 8.0])
@pytest.mark.parametrize("side_px", [14, 24, 45])
def test_information_is_about_that_of_the_errors(scene, maps, side_px, noise_dn):
    lens, rng, found = scene.fisheye, np.random.default_rng(side_px), []
    for k in range(5):
        view = small_view(scene, lens, side_px, 19 + 31 * k, 0.01 * k)
        clean = scene.draw(view, noise=0.0).astype(float)
        for _ in range(6):
            image = np.clip(np.rint(clean + rng.normal(0.0, noise_dn, clean.shape)), 0, 255).astype(np.uint8)
            found.append(maps.square_per_dof(align(maps.look_at(image, lens), maps.true(view), 8), view))
    assert 0.3 < np.mean(found) < 4.0


def test_landmark_half_out_of_the_image_is_aligned_on_the_rest(scene, maps):
    # The right border of the pinhole is 319.5 / 495 of the height to the right.
    view = scene.view(5.0, right_m=5.0 * 319.5 / 495, pad_yaw_deg=10)
    image = scene.draw(view, lens=scene.pinhole, noise=1.0)
    found = align(maps.look_at(image, scene.pinhole), maps.off_by(view, 0.5, 37.6), 8)
    assert not found.patch.whole
    assert maps.rms_px(found.rays_from_pad, view, scene.pinhole, [0]) < 0.3


def test_flat_image_supports_nothing(scene, maps):
    flat = maps.look_at(np.full((480, 640), 120, np.uint8), scene.fisheye)
    assert align(flat, maps.true(scene.view(3.0))) is None


def test_inverted_landmark_supports_nothing(scene, maps):
    view = scene.view(3.0, pad_yaw_deg=20)
    image = scene.draw(view, polygons=scene.polygons(inverted=True), lawn=False)
    found = align(maps.look_at(image, scene.fisheye), maps.true(view))
    assert found is None or found.correlation < 0.5


@pytest.mark.parametrize("side_px", [14, 22, 30])
def test_place_of_the_clearest_picture_is_claimed_no_better_than_a_hundredth_of_a_pixel(scene, maps, side_px):
    """Were all else known: the benchmark's renderer leaves as much where noise leaves less."""
    view = small_view(scene, scene.fisheye, side_px)
    found = align(maps.look_at(scene.draw(view, noise=0.2), scene.fisheye), maps.off_by(view, 0.5, side_px), 8)
    shifts = np.linalg.inv(found.information[np.ix_([2, 5], [2, 5])])  # half sides of the landmark
    assert np.sqrt(np.linalg.eigvalsh(shifts)[0]) * 0.5 * side_px > 0.0095
