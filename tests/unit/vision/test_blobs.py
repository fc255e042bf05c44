"""Landmarks of a few pixels are among the hypotheses."""

import numpy as np
import pytest

from app.vision.align import align
from app.vision.blobs import blobs, in_two_lights
from app.vision.contours import contour_tree
from app.vision.detector import LOCAL_WINDOWS_PX
from app.vision.preprocess import binarise, local_binary, prepare, whole

NARROW_PX = LOCAL_WINDOWS_PX[0]


def hypotheses(maps, image, lens, window_px=0):
    prepared = prepare(image, whole(image))
    # Black is 25, what lies round it 95 or 110.
    binary = local_binary(prepared.smooth, window_px) if window_px else binarise(prepared.smooth, 68)
    return blobs(contour_tree(binary), prepared, maps.look_at(image, lens))


# The ring of one of 12 px is 1.8 px wide: blurred, it is no darker than a lawn, but than its surroundings.
@pytest.mark.parametrize(
    ("side_px", "lawn", "window_px"),
    [(20, False, 0), (12, True, NARROW_PX), (15, True, NARROW_PX), (20, True, NARROW_PX)],
    ids=["20 at one level", "12 place by place", "15 place by place", "20 place by place"],
)
@pytest.mark.parametrize("pad_yaw_deg", [0, 45, 110, 200])
@pytest.mark.parametrize("lens_name", ["fisheye", "pinhole"])
def test_small_landmark_is_among_the_hypotheses(scene, maps, lens_name, side_px, pad_yaw_deg, lawn, window_px):
    lens = getattr(scene, lens_name)
    h = lens.f * 0.38 / side_px
    view = scene.view(h, forward_m=0.06 * h, right_m=0.09 * h, pad_yaw_deg=pad_yaw_deg, roll_deg=4)
    image = scene.draw(view, lens=lens, lawn=lawn)
    found = hypotheses(maps, image, lens, window_px)
    # Its heading included: the corner that is the front left one must be it, to a fifth of a side, and the alignment
    # must get there from it.
    off = {maps.distances_px(m, view, lens, [0]).max(): m for several, _ in found for m in several}
    assert min(off) < 0.2 * side_px
    aligned = align(maps.look_at(image, lens), off[min(off)], 8)
    assert maps.rms_px(aligned.rays_from_pad, view, lens, [0]) < 0.2


@pytest.mark.parametrize("side_px", [24, 32, 40])
@pytest.mark.parametrize("pad_yaw_deg", [0, 35])
def test_landmark_whose_ring_runs_into_something_dark_is_found_by_its_second_contour(scene, maps, side_px, pad_yaw_deg):
    h = scene.fisheye.f * 0.38 / side_px
    view = scene.view(h, forward_m=0.06 * h, pad_yaw_deg=pad_yaw_deg)
    zone, *contours = scene.polygons()
    # A cable of half the pad's width, as dark as its black, lies over the quiet zone up to the ring.
    cable = np.array([[0.19, -0.1], [0.9, -0.1], [0.9, 0.1], [0.19, 0.1]])
    image = scene.draw(view, polygons=[zone, (cable, contours[0][1]), *contours], lawn=False)
    off = [
        maps.distances_px(m, view, scene.fisheye, [0]).max()
        for several, _ in hypotheses(maps, image, scene.fisheye)
        for m in several
    ]
    assert min(off) < 0.2 * side_px


def test_hypothesis_comes_with_the_box_it_was_made_from(scene, maps):
    view = scene.view(4.0, forward_m=0.3, pad_yaw_deg=45)
    found = hypotheses(maps, scene.draw(view, lawn=False), scene.fisheye)
    middle = scene.corners_px(view, 0, scene.fisheye).mean(axis=0)
    assert min(np.linalg.norm(box.mean(axis=0) - middle) for _, box in found) < 1.0


@pytest.mark.parametrize("side_px", [3.5, 90])
def test_landmark_of_another_size_is_left_to_others(scene, maps, side_px):
    view = scene.view(215.0 * 0.38 / side_px, pad_yaw_deg=20)
    outer = scene.corners_px(view, 0, scene.fisheye)
    found = hypotheses(maps, scene.draw(view, lawn=False), scene.fisheye)
    assert all(np.abs(box - outer).max() > 0.3 * side_px for _, box in found)


@pytest.mark.parametrize("polygons", [[], None], ids=["lawn", "nothing"])
def test_image_without_a_landmark_gives_few_hypotheses_or_none(scene, maps, polygons):
    flat = np.full((480, 640), 120, np.uint8)
    image = flat if polygons is None else scene.draw(scene.view(3.0), polygons=polygons)
    assert len(hypotheses(maps, image, scene.fisheye)) <= 4


def two_lights(maps, values):
    """Likeness of greys (m,) at the samples, best turn."""
    values = values - values.mean()
    length = np.linalg.norm(values)
    values = values / length if length > 0 else values
    return in_two_lights(
        values[None], maps.geometry.glance.templates(maps.geometry.template(0.5)), maps.geometry.glance.halves
    )[0]


def test_drawing_half_in_the_shade_is_as_alike_as_in_one_light(maps):
    forward, right = maps.geometry.glance.grid.T
    drawn = maps.geometry.glance.templates(maps.geometry.template(0.5))[1]
    lit = np.where(0.6 * forward + 0.8 * right > 0.1, 1.0, 0.25)
    alike = two_lights(maps, (drawn - drawn.min()) * lit)
    assert alike.argmax() == 1
    assert alike[1] > 0.9


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_two_greys_and_nothing_at_all_are_like_no_drawing(maps, seed):
    forward, _ = maps.geometry.glance.grid.T
    step = np.zeros_like(forward) if seed is None else np.where(forward > 0.2, 200.0, 60.0)
    noise = 0.0 if seed is None else np.random.default_rng(seed).normal(0.0, 3.0, len(forward))
    assert two_lights(maps, step + noise).max() < 0.5
