"""The fit by edges, against maps known from geometry."""

import numpy as np
import pytest

from app.vision.refine import fit_edges

REACHES_PX = (4.0, 3.5, 3.0, 2.2)
ALL = range(5)


def height_m(lens, side_px):
    return lens.f * 0.38 / side_px


def fitted(maps, image, start, lens, run=ALL, reaches=REACHES_PX, **options):
    return fit_edges(image, start, maps.geometry, maps.lens(lens), run, reaches, **options)


# At 60 px the innermost contours are too narrow to be measured: their corners lie beyond what holds the fit.
@pytest.mark.parametrize(("side_px", "least_px"), [(60, 0.1), (90, 0.05), (150, 0.05), (240, 0.05)])
@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
def test_map_that_is_off_comes_back_to_a_part_of_a_pixel(scene, maps, lens_name, side_px, least_px):
    lens = getattr(scene, lens_name)
    h = height_m(lens, side_px)
    view = scene.view(h, forward_m=0.05 * h, right_m=-0.08 * h, pad_yaw_deg=25, roll_deg=6, pitch_deg=-4)
    start = maps.off_by(view, 2.0, side_px, seed=side_px)
    assert maps.rms_px(start, view, lens, [0]) > 1.5
    fit = fitted(maps, scene.draw(view, lens=lens), start, lens)
    assert maps.rms_px(fit.rays_from_pad, view, lens) < least_px
    assert fit.edges.share > 0.95
    assert fit.edges.bent < 0.01


@pytest.mark.parametrize("blur_px", [0.5, 1.0, 1.6])
@pytest.mark.parametrize("side_px", [90, 150])
def test_edge_that_blur_takes_out_of_its_profile_is_seen_where_it_is_in_two_looks(scene, maps, side_px, blur_px):
    """Profiles of 2.2 px to either side end in the blur; what follows a landmark begins a pixel or two beside it."""
    h = height_m(scene.pinhole, side_px)
    view = scene.view(h, forward_m=0.05 * h, right_m=-0.08 * h, pad_yaw_deg=25, roll_deg=6, pitch_deg=-4)
    start = maps.off_by(view, 2.0, side_px, seed=side_px)
    image = scene.draw(view, lens=scene.pinhole, blur_px=blur_px, noise=1.0)
    fit = fitted(maps, image, start, scene.pinhole, reaches=(4.5, 2.2))
    assert maps.rms_px(fit.rays_from_pad, view, scene.pinhole) < 0.1


@pytest.mark.parametrize("height", [0.3, 0.2])
def test_landmark_larger_than_the_image_is_fitted_to_what_shows(scene, maps, height):
    view = scene.view(height, forward_m=0.03, right_m=0.05, pad_yaw_deg=20)
    start = maps.off_by(view, 3.0, 495.0 * 0.38 / height)
    fit = fitted(maps, scene.draw(view, lens=scene.pinhole), start, scene.pinhole)
    assert maps.rms_px(fit.rays_from_pad, view, scene.pinhole) < 0.08
    assert fit.edges.in_view.sum() < 180  # not all of the points along eighteen sides can be seen


@pytest.mark.parametrize(("forward_m", "right_m", "yaw_deg"), [(0.29, 0.0, 0), (-0.29, 0.1, 40), (0.05, 0.387, 200)])
def test_landmark_cut_in_half_by_the_image_is_fitted_where_it_shows(scene, maps, forward_m, right_m, yaw_deg):
    # 0.6 m below a pinhole of 495 px, the top border is 0.29 m to the front and the right one 0.387 m to the right.
    view = scene.view(0.6, forward_m=forward_m, right_m=right_m, pad_yaw_deg=yaw_deg)
    fit = fitted(maps, scene.draw(view, lens=scene.pinhole), maps.off_by(view, 1.5, 313.0), scene.pinhole)
    assert maps.rms_px(fit.rays_from_pad, view, scene.pinhole) < 0.1
    assert fit.edges.share > 0.9


@pytest.mark.parametrize("grey", [15.0, 120.0, 230.0], ids=["dark", "grey", "light"])
def test_cover_over_a_quarter_moves_nothing(scene, maps, grey):
    view = scene.view(0.7, forward_m=0.1, pad_yaw_deg=35, roll_deg=5)
    cover = (np.array([[0.25, 0.0], [0.25, 0.25], [0.0, 0.25], [0.0, 0.0]]), grey)
    image = scene.draw(view, polygons=[*scene.polygons(), cover])
    fit = fitted(maps, image, maps.off_by(view, 2.0, 117.0), scene.fisheye)
    assert maps.rms_px(fit.rays_from_pad, view, scene.fisheye) < 0.1
    assert 0.6 < fit.edges.share < 0.95


@pytest.mark.parametrize("slope", [0.0, 0.4, -3.0])
@pytest.mark.parametrize("shade", [0.6, 0.3])
def test_shadow_edge_across_the_landmark_moves_nothing(scene, maps, slope, shade):
    view = scene.view(0.7, forward_m=0.1, pad_yaw_deg=35, roll_deg=5)
    image = scene.draw(view, light=lambda p: np.where(p[..., 0] + slope * p[..., 1] > 0.02, 1.0, shade))
    fit = fitted(maps, image, maps.off_by(view, 2.0, 117.0), scene.fisheye)
    assert maps.rms_px(fit.rays_from_pad, view, scene.fisheye) < 0.08


@pytest.mark.parametrize("blur_px", [0.3, 1.2])
@pytest.mark.parametrize("grown_m", [-0.0008, 0.0008])
def test_black_that_is_large_or_small_all_over_does_not_act_on_the_scale(scene, maps, grown_m, blur_px):
    # Ink that spreads: black contours grow, white ones shrink, by 0.8 mm a side: a quarter of a pixel.
    view = scene.view(0.7, pad_yaw_deg=35)
    zone, *contours = scene.polygons()
    inked = [
        (c.centroid_m + (corners - c.centroid_m) * (1 + (grown_m if c.black else -grown_m) / inradius), grey)
        for (corners, grey), c in zip(contours, scene.landmark.contours, strict=True)
        for inradius in [c.side_m * (0.5 if len(corners) == 4 else np.sqrt(3) / 6)]
    ]
    image = scene.draw(view, polygons=[zone, *inked], blur_px=blur_px)
    fit = fitted(maps, image, maps.off_by(view, 1.0, 117.0), scene.fisheye)
    assert maps.rms_px(fit.rays_from_pad, view, scene.fisheye) < 0.05


@pytest.mark.parametrize(
    ("side_px", "noise_dn", "where"),
    [(70, 3.0, {}), (110, 8.0, {"roll_deg": 12}), (220, 8.0, {"pitch_deg": -20}), (300, 15.0, {"roll_deg": 4})],
)
def test_information_is_about_that_of_the_errors(scene, maps, side_px, noise_dn, where):
    lens, rng = scene.fisheye, np.random.default_rng(side_px)
    found = []
    for k in range(4):
        h = height_m(lens, side_px)
        view = scene.view(h, forward_m=0.03 * h * k, right_m=0.013 * h, pad_yaw_deg=19 + 31 * k, **where)
        clean = scene.draw(view, noise=0.0).astype(float)
        for _ in range(6):
            image = np.clip(np.rint(clean + rng.normal(0.0, noise_dn, clean.shape)), 0, 255).astype(np.uint8)
            fit = fitted(maps, image, maps.true(view), lens, reaches=(3.0, 2.2))
            found.append(maps.square_per_dof(fit, view))
    assert 0.3 < np.mean(found) < 4.0


def test_region_of_the_frame_gives_what_the_frame_gives(scene, maps):
    view = scene.view(1.0, forward_m=0.1, pad_yaw_deg=20)
    image, start = scene.draw(view), maps.off_by(view, 1.0, 82.0)
    frame = fitted(maps, image, start, scene.fisheye)
    region = fitted(maps, np.ascontiguousarray(image[120:320, 200:440]), start, scene.fisheye, origin=(200, 120))
    np.testing.assert_allclose(region.rays_from_pad, frame.rays_from_pad, atol=1e-4)


def test_neighbours_are_taken_in_step_by_step_unless_the_run_stays_alone(scene, maps):
    view = scene.view(0.7, forward_m=0.1, pad_yaw_deg=20)
    image, start = scene.draw(view), maps.off_by(view, 1.0, 117.0)
    alone = fitted(maps, image, start, scene.fisheye, range(1), alone=True)
    grown = fitted(maps, image, start, scene.fisheye, range(1))
    assert np.flatnonzero(alone.edges.in_view).tolist() == [0]
    assert np.flatnonzero(grown.edges.in_view).tolist() == [0, 1, 2, 3, 4]


def test_lawn_confirms_few_edges(scene, maps):
    view = scene.view(0.7)
    fit = fitted(maps, scene.draw(view, polygons=[]), maps.true(view), scene.fisheye)
    assert fit is None or fit.edges.share < 0.5


def test_flat_image_holds_nothing(scene, maps):
    assert fitted(maps, np.full((480, 640), 120, np.uint8), maps.true(scene.view(0.7)), scene.fisheye) is None


def test_map_out_of_the_image_holds_nothing(scene, maps):
    image = scene.draw(scene.view(0.7), lens=scene.pinhole)
    assert fitted(maps, image, maps.true(scene.view(0.7, forward_m=5.0)), scene.pinhole) is None
