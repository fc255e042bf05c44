"""Which views are taken, and which part of the image they cover."""

from dataclasses import replace

import numpy as np
import pytest

from app.calibration.coverage import Grid, choose, features, lit_cells, sharp_enough
from app.calibration.judgement import Verdict, coverage_checks


@pytest.fixture(scope="module")
def views(bench):
    return bench.wave(bench.straight, 20, noise=0.05)


@pytest.mark.parametrize(("size", "cells"), [((640, 480), (6, 8)), ((1920, 1080), (4, 8)), ((480, 640), (11, 8))])
def test_grid_has_about_square_cells(size, cells):
    assert Grid.over(size).counts(np.zeros((0, 2))).shape == cells


def test_grid_counts_points_in_the_cell_that_they_lie_in():
    grid = Grid.over((640, 480))
    counts = grid.counts(np.array([[0.0, 0.0], [639.0, 479.0], [639.4, 479.4], [330.0, 250.0]]))
    assert (counts[0, 0], counts[-1, -1], counts[3, 4], counts.sum()) == (1, 2, 1, 4)


def test_cells_outside_the_image_circle_of_a_lens_are_not_lit():
    v, u = np.mgrid[:480, :640]
    circle = np.where(np.hypot(u - 320, v - 240) < 235, 150, 3).astype(np.uint8)
    lit = lit_cells(circle, Grid.over((640, 480)))
    assert not lit[:, [0, -1]].any()
    assert lit[1:5, 2:6].all()


def test_features_tell_place_size_and_both_tilts_apart(bench):
    def seen(azimuth, angle, distance, tilt):
        return features(bench.view_of(bench.straight, bench.hold(azimuth, angle, distance, tilt), "", 0.0))

    level = seen(0.0, 0.0, 0.5, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(level[:2], [0.5, 0.375], atol=0.002)
    # Twice as near: a power of two more, half weighted; half of the logarithm of the area is that of the side.
    assert seen(0.0, 0.0, 0.25, (0.0, 0.0, 0.0))[2] - level[2] == pytest.approx(0.5, abs=0.02)
    right_away, lower_away = seen(0.0, 0.0, 0.5, (0.0, -0.6, 0.0)), seen(0.0, 0.0, 0.5, (0.6, 0.0, 0.0))
    assert right_away[3] < -0.1 < 0.05 > abs(right_away[4])
    assert lower_away[4] < -0.1 < 0.05 > abs(lower_away[3])
    assert seen(0.0, 0.0, 0.5, (0.0, 0.6, 0.0))[3] == pytest.approx(-right_away[3], abs=0.02)


def test_features_of_a_part_of_a_board_are_those_of_the_whole(bench):
    view = bench.view_of(bench.straight, bench.hold(0.3, 0.2, 0.5, (0.3, 0.2, 0.1)), "", 0.0)
    part = replace(view, index=view.index[9:], corners_m=view.corners_m[9:], px=view.px[9:])
    # The outline is the part's own: tilts are those over its own width.
    np.testing.assert_allclose(features(part)[3:], features(view)[3:], atol=0.06)


def test_view_that_repeats_another_is_left_out_and_names_it(views):
    again = [replace(v, name=f"again {v.name}", px=v.px + 0.3) for v in views]
    chosen, spare = choose([*views, *again])
    names = [v.name.removeprefix("again ") for v in chosen]
    assert len(names) == len(set(names))
    assert all(item.reason.startswith("adds nothing to ") for item in spare)


def test_of_two_like_views_the_sharper_is_taken(views):
    soft = [replace(v, name=f"soft {v.name}", blur_px=1.1) for v in views]
    chosen, _ = choose([*soft, *views])
    assert not [v.name for v in chosen if v.name.startswith("soft")]


def test_no_more_views_are_taken_than_wanted(views):
    chosen, spare = choose(views, most=5)
    assert (len(chosen), len(spare)) == (5, 15)
    assert any(item.reason == "not needed: 5 views that add more were chosen" for item in spare)


def test_no_views_are_no_choice():
    assert choose([]) == ([], [])
    assert sharp_enough([]) == ([], [])


def test_blurred_view_among_sharp_ones_is_refused_with_both_figures(views):
    soft = replace(views[0], name="soft.png", blur_px=2.2)
    kept, refused = sharp_enough([*views, soft])
    assert len(kept) == 20
    assert refused[0].name == "soft.png"
    assert refused[0].reason == "blurred: edges of 2.2 px (sigma), over 1.4; the sharper ones: 0.8"


def test_views_that_are_all_blurred_are_refused_too(views):
    kept, refused = sharp_enough([replace(v, blur_px=3.0) for v in views])
    assert (len(kept), len(refused)) == (0, 20)


@pytest.mark.parametrize(
    ("cells", "side"),
    [
        (np.s_[:, :2], "left"),
        (np.s_[:, -2:], "right"),
        (np.s_[:2], "upper"),
        (np.s_[-2:], "lower"),
    ],
)
def test_edge_without_corners_is_named_with_what_to_do(cells, side):
    covered = np.ones((6, 8), dtype=bool)
    covered[cells] = False
    worst = max(coverage_checks(covered, np.ones((6, 8), dtype=bool))[1:], key=lambda check: check.verdict)
    assert (worst.name, worst.verdict) == (f"{side} edge", Verdict.NOT_GOOD)
    assert worst.advice == f"fill the {side} edge of the image"


def test_cells_without_light_need_no_corners():
    lit = np.zeros((6, 8), dtype=bool)
    lit[1:5, 1:7] = True
    assert all(check.verdict is Verdict.GOOD for check in coverage_checks(lit.copy(), lit))
