"""The benchmark's renderer against geometry: expected places come from formulas, not from what it drew."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from covers import cover
from optics import CENTRE, lens
from prints import MARKERS, SIDE_M
from render import exposures, poses_in_exposure, render
from scenes import Light, Scene, attitude, shake_for, translation_at, truth
from sequences import draw_sequence, is_visible
from sets import HARD_KINDS, draw

PLAIN = {"blur_px": 0.0, "veil": 0.0, "vignette": 0.0, "paper": 0.8, "ink": 0.05}


def scene_at(lens_name: str, rotation: np.ndarray, translation: np.ndarray, **changes: object) -> Scene:
    """Even light, no noise."""
    fields = {**PLAIN, **changes}
    return Scene(1, 2, lens_name, rotation, translation, light=Light("even"), **fields)


def overhead(lens_name: str, height: float, **changes: object) -> Scene:
    """Straight above the middle, the image's top forward."""
    return scene_at(lens_name, attitude(0.0, 0.0, 0.0), np.array([0.0, 0.0, height]), **changes)


def test_fisheye_sees_45_degrees_at_a_radius_of_f_times_the_angle():
    px = lens("A").project(np.array([[1.0, 0.0, 1.0]]))
    assert px[0] == pytest.approx([319.5 + 215 * math.pi / 4, 239.5])


def test_pinhole_sees_45_degrees_at_a_radius_of_f():
    px = lens("B").project(np.array([[0.0, -2.0, 2.0]]))
    assert px[0] == pytest.approx([319.5, 239.5 - 495])


@pytest.mark.parametrize("name", ["A", "B"])
def test_ray_of_a_pixel_projects_to_that_pixel(name):
    px = np.array([[0.0, 0.0], [639.0, 100.0], [320.0, 240.0], [12.5, 471.25]])
    assert lens(name).project(lens(name).rays(px) * 3.0) == pytest.approx(px, abs=1e-6)


def test_truth_of_an_overhead_view_is_a_square_about_the_centre():
    seen = truth("B", attitude(0.0, 0.0, 0.0), np.array([0.0, 0.0, 2.0]))
    half = 495 * 0.19 / 2
    assert seen.corners_px - CENTRE == pytest.approx(
        np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    )
    assert (seen.side_px, seen.visible, seen.height) == pytest.approx((2 * half, 1.0, 2.0))


def test_heading_to_the_right_turns_the_pads_forward_to_the_images_left():
    # A camera that heads 90 degrees to the right of the pad's forward has the pad's front on its left.
    seen = truth("B", attitude(0.0, 0.0, math.radians(-90.0)), np.array([0.0, 0.0, 2.0]))
    front = seen.corners_px[:2].mean(axis=0) - CENTRE
    assert front == pytest.approx([-495 * 0.19 / 2, 0.0], abs=1e-9)


def test_marker_on_the_images_edge_is_half_visible():
    rotation = attitude(0.0, 0.0, 0.0)
    translation = translation_at("B", rotation, np.array([-0.5, 240.0]), 2.0)
    assert truth("B", rotation, translation).visible == pytest.approx(0.5, abs=1 / 41)


@pytest.mark.parametrize("height", [0.7, 2.0, 9.0])
@pytest.mark.parametrize("marker", ["alight", "aruco4"])
def test_ink_covers_its_true_area(marker, height):
    scene = overhead("B", height)
    (linear,), _ = exposures(scene, (marker,))
    # Areas of the landmark's contours are 1, 1/2, 1/8, 1/16, 1/64 of the outer square's, black first; of ArUco's
    # modules, the black ones.
    part = 1 - 1 / 2 + 1 / 8 - 1 / 16 + 1 / 64
    if marker == "aruco4":
        tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 6)
        part = float((tag == 0).mean())
    half = round(495 * 0.215 / height)  # into the quiet zone
    window = linear[240 - half : 240 + half, 320 - half : 320 + half]
    ink_px = float(((0.8 - window) / 0.75).sum())
    assert ink_px == pytest.approx(part * (495 * SIDE_M / height) ** 2, rel=0.004)


def crossings(scene: Scene, marker: str, across: np.ndarray) -> tuple[float, float]:
    """Places along a line of the pad through `across` (unit vector forward, right) where the outer black begins."""
    (linear,), _ = exposures(scene, (marker,))
    places = np.linspace(-0.2, 0.2, 4001)
    points = np.column_stack([np.outer(places, across), np.zeros(len(places))]) @ scene.rotation.T + scene.translation
    px = lens(scene.lens).project(points).astype(np.float32)
    seen = cv2.remap(linear, px[None, :, 0], px[None, :, 1], cv2.INTER_LINEAR)[0]
    dark = np.flatnonzero(seen < (0.8 + 0.05) / 2)
    return float(places[dark[0]]), float(places[dark[-1]])


@pytest.mark.parametrize("marker", MARKERS)
@pytest.mark.parametrize("name", ["A", "B"])
@pytest.mark.parametrize("across", [(1.0, 0.0), (0.0, 1.0)], ids=["front and back", "left and right"])
def test_edges_of_a_tilted_print_lie_at_19_cm_on_the_pad(across, name, marker):
    height = 0.9 if name == "A" else 2.0
    rotation = attitude(math.radians(12.0), 0.7, 1.9)
    translation = translation_at(name, rotation, np.array([390.0, 190.0]), height)
    scene = scene_at(name, rotation, translation)
    m_per_px = height / lens(name).f
    assert crossings(scene, marker, np.array(across)) == pytest.approx((-0.19, 0.19), abs=0.1 * m_per_px)


def test_innermost_square_lies_behind_the_middle():
    (linear,), _ = exposures(overhead("B", 1.0), ("alight",))
    behind = linear[round(239.5 + 495 * 0.035), 320]
    before = linear[round(239.5 - 495 * 0.02), 320]
    assert (behind, before) == pytest.approx((0.05, 0.8), abs=0.01)


def test_motion_is_centred_on_the_true_pose():
    rotation = attitude(0.1, 0.3, 0.5)
    translation = translation_at("A", rotation, np.array([420.0, 300.0]), 1.5)
    shake = shake_for("A", translation, (4.0, -3.0), 0.01)
    scene = scene_at("A", rotation, translation, motion_px=(4.0, -3.0), shake=tuple(shake))
    centres = lens("A").project(np.array([t for _, t in poses_in_exposure(scene)]))
    assert len(centres) == 5
    assert centres.mean(axis=0) == pytest.approx([420.0, 300.0], abs=0.03)
    assert (centres[-1] - centres[0]) * 5 / 4 == pytest.approx([4.0, -3.0], abs=0.03)


def test_cover_hides_the_part_that_it_says():
    seed, height = 12, 0.8
    _, part, _ = cover(seed, 0.1, 0.2)
    (bare,), _ = exposures(overhead("B", height), ("alight",))
    (covered,), _ = exposures(overhead("B", height, cover_seed=seed, cover_part=(0.1, 0.2)), ("alight",))
    half = round(495 * 0.19 / height)
    window = (slice(240 - half, 240 + half), slice(320 - half, 320 + half))
    changed = float((np.abs(bare[window] - covered[window]) > 0.004).mean())
    assert 0.1 <= part <= 0.2
    assert changed == pytest.approx(part, abs=0.03)


def test_frames_of_all_markers_differ_on_the_board_alone():
    scene = overhead("B", 4.0, blur_px=0.5)
    frames = render(scene, ("alight", "aruco4"))
    differs = frames["alight"] != frames["aruco4"]
    half = 495 * 0.26 / 4.0 + 4
    assert differs.any()
    assert not differs[:, : int(319.5 - half)].any()
    assert not differs[: int(239.5 - half)].any()


def test_same_number_draws_the_same_case_and_unseen_another():
    one, two, other = draw("hard-A", 3), draw("hard-A", 3), draw("hard-A", 3, unseen=True)
    assert np.array_equal(one.scene.rotation, two.scene.rotation)
    assert replace(one.scene, rotation=0, translation=0) == replace(two.scene, rotation=0, translation=0)
    assert one.scene.seed != other.scene.seed
    assert one.scene.ground_variant < 4 <= other.scene.ground_variant


def test_hard_cases_come_in_equal_shares_and_keep_their_rules():
    cases = [draw("hard-B", k) for k in range(20)]
    assert [c.kind for c in cases] == list(HARD_KINDS) * 2
    cut = [c.truth.visible for c in cases if c.kind == "cut"]
    small = [c.truth.side_px for c in cases if c.kind == "small"]
    moved = [math.hypot(*c.scene.motion_px) for c in cases if c.kind == "motion"]
    assert all(0.5 <= v <= 0.95 for v in cut)
    assert all(12 <= s <= 25 for s in small)
    assert all(2.5 <= m <= 6 for m in moved)


def test_cone_case_has_the_whole_marker_in_the_image_from_inside_the_cone():
    cases = [draw("cone", k).truth for k in range(12)]
    assert all(c.visible == 1.0 and 0.3 <= c.height <= 3.0 for c in cases)
    assert all(np.linalg.norm(c.translation) <= math.sqrt(2) * c.height + 1e-9 for c in cases)


def test_sequence_moves_smoothly_at_30_hz():
    frames = list(draw_sequence("landing-B"))
    steps = np.diff([f.truth.translation for f in frames], axis=0)
    assert [f.t_s for f in frames[:3]] == pytest.approx([0.0, 1 / 30, 2 / 30])
    assert np.abs(np.diff(steps, axis=0)).max() < 0.01
    assert all(is_visible(f.truth) == (f.truth.visible >= 0.5) for f in frames)
