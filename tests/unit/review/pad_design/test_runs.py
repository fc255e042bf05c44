"""Runs of contours: which can be taken for each other, and from where each is seen, by hand from the paper's table."""

import math

import pytest

from app.landmark import ContourSpec, Shape, build_landmark, paper_landmark
from app.review.pad_design.runs import Run as SomeRun
from app.review.pad_design.runs import (
    all_runs,
    clashes,
    covered,
    heading_runs,
    proportions,
    settles_heading,
    working_runs,
)
from app.review.pad_design.view import View

PLAIN = View(half_angle_rad=math.pi / 4, tilt_rad=0.0, offset=0.0, scale_px=200.0)
"""Reach 1: the lowest height is the radius."""


def squares_and_triangles(code, ratios):
    shapes = {"4": Shape.SQUARE, "3": Shape.TRIANGLE}
    areas, specs = 1.0, [ContourSpec(Shape.SQUARE, 1.0)]
    for corners, ratio in zip(code[1:], ratios, strict=True):
        areas /= ratio
        specs.append(ContourSpec(shapes[corners], areas))
    return build_landmark(code, 1.0, tuple(specs))


def test_paper_landmark_has_no_run_that_can_be_taken_for_another():
    assert clashes(paper_landmark()) == ()


@pytest.mark.parametrize(
    ("code", "ratios", "found"),
    [
        ("4334", (4, 2, 4), []),
        ("444", (2, 2), [("44", 0, 1)]),
        ("444", (2, 4), []),
        ("43434", (4, 4, 8, 8), [("434", 0, 2)]),
        ("443443", (2, 4, 4, 4, 8), [("443", 0, 3)]),
        ("4343", (4, 4, 7), [("43", 0, 2)]),
        ("4343", (4, 4, 8), []),
    ],
)
def test_clashes_are_triples_that_occur_twice_and_pairs_with_like_ratios(code, ratios, found):
    landmark = squares_and_triangles(code, ratios)
    assert [(clash.code, clash.first, clash.second) for clash in clashes(landmark)] == found


@pytest.mark.parametrize(("code", "settled"), [("44", False), ("33", False), ("43", True), ("334", True)])
def test_heading_is_settled_by_runs_with_both_shapes(code, settled):
    assert settles_heading(code) is settled


def test_heading_runs_of_the_paper_are_the_shortest_from_each_contour():
    assert heading_runs("44334") == ((0, 3), (1, 2), (2, 3), (3, 2))


def test_working_runs_of_the_paper_are_seen_from_where_they_are_whole_to_where_they_are_12_px():
    first, second, third, fourth = working_runs(proportions(paper_landmark()), PLAIN, 12.0)
    # S1: a corner at 19 * sqrt(2) cm; 38 cm are 12 px at 200 * 0.38 / 12 m, before its gaps are 1 px (3.23 cm: 6.46 m).
    assert (first.code, first.from_m, first.to_m) == (
        "443",
        pytest.approx(0.19 * math.sqrt(2)),
        pytest.approx(6.3333, 1e-4),
    )
    # S2: 26.8701 cm.
    assert (second.code, second.from_m) == ("43", pytest.approx(0.1343505 * math.sqrt(2), rel=1e-4))
    assert second.to_m == pytest.approx(200 * 0.268701 / 12, rel=1e-4)
    # T3: a back corner at 8.8407 cm behind and 10.2084 cm beside; S5, 4.75 cm, is 6 px at 1.583 m.
    assert (third.code, third.from_m) == ("334", pytest.approx(math.hypot(0.088407, 0.102084), rel=1e-4))
    assert third.to_m == pytest.approx(200 * 0.0475 / 6, rel=1e-4)
    # T4: a back corner at 7.1145 cm behind and 7.2184 cm beside.
    assert (fourth.code, fourth.from_m) == ("34", pytest.approx(math.hypot(0.071145, 0.072184), rel=1e-4))


def test_all_runs_of_five_contours_are_the_ten_of_the_code_table():
    codes = {run.code for run in all_runs(proportions(paper_landmark()), PLAIN, 12.0)}
    assert codes == {"44", "43", "33", "34", "443", "433", "334", "4433", "4334", "44334"}


def test_covered_heights_join_where_runs_overlap_and_break_where_not():
    runs = tuple(
        SomeRun(k, 2, "43", low, high) for k, (low, high) in enumerate([(2.0, 9.0), (0.9, 2.2), (0.1, 0.8), (3, 1)])
    )
    assert covered(runs) == ((0.9, 9.0), (0.1, 0.8))
    assert covered(runs, 1.2) == ((2.0, 9.0), (0.9, 2.2), (0.1, 0.8))
