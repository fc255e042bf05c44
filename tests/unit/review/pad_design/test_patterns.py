"""Every landmark that a design can choose: legal, unambiguous, and printed with gaps that a second reckoning finds."""

import itertools

import cv2
import numpy as np
import pytest

from app.landmark import paper_landmark
from app.review.pad_design.patterns import COUNTS, codes, patterns

ALL = [pattern for count in COUNTS for pattern in patterns(count)]


def runs_of(landmark, length):
    """(code, area ratios) of all runs of a length."""
    code = landmark.code
    areas = [contour.area_m2 for contour in landmark.contours]
    return [
        (code[k : k + length], tuple(areas[i] / areas[i + 1] for i in range(k, k + length - 1)))
        for k in range(len(code) - length + 1)
    ]


def test_patterns_have_five_to_seven_contours_and_the_papers_comes_first():
    assert [len(patterns(count)[0].specs) for count in COUNTS] == [5, 6, 7]
    np.testing.assert_allclose(
        np.concatenate([c.corners_m for c in patterns(5)[0].landmark.contours]),
        np.concatenate([c.corners_m for c in paper_landmark(1.0).contours]),
        atol=1e-12,
    )
    assert [pattern.is_paper for pattern in ALL].index(True) == 0
    assert sum(pattern.is_paper for pattern in ALL) == 1


def test_codes_are_all_that_the_rules_allow():
    # By hand: from 44 to 43, then the ways along 433, 434, 334, 343, 344 with each triple once, to a mixed pair.
    assert [codes(count) for count in COUNTS] == [("44334", "44343"), ("443343",), ("4433434", "4434334")]


@pytest.mark.parametrize("length", [3, 4, 5, 6])
def test_no_run_of_three_or_more_occurs_twice(length):
    for pattern in ALL:
        found = [code for code, _ in runs_of(pattern.landmark, length)]
        assert len(set(found)) == len(found), pattern.landmark.code


def test_pairs_with_one_code_differ_clearly_in_area_ratio():
    ratios = [
        max(a[0], b[0]) / min(a[0], b[0])
        for pattern in ALL
        for (one, a), (other, b) in itertools.combinations(runs_of(pattern.landmark, 2), 2)
        if one == other
    ]
    assert min(ratios) > 1.9


def test_every_run_of_three_and_the_innermost_pair_settle_the_heading():
    for pattern in ALL:
        code = pattern.landmark.code
        assert all(set(code[k : k + 3]) == {"3", "4"} for k in range(len(code) - 2))
        assert set(code[-2:]) == {"3", "4"}


def test_gaps_are_wide_enough_to_be_seen_by_a_second_reckoning():
    for pattern in ALL:
        contours = pattern.landmark.contours
        for parent, child in itertools.pairwise(contours):
            outline = (1000.0 * parent.corners_m).astype(np.float32)
            gap = min(cv2.pointPolygonTest(outline, (float(f), float(r)), True) for f, r in 1000.0 * child.corners_m)
            assert gap / (1000.0 * parent.side_m) > 0.079


def test_contours_seen_last_lie_nearer_to_the_middle_where_they_were_moved_there():
    for plain, moved in ((a, b) for a in ALL for b in ALL if b.moved and not a.moved):
        if [s.area_ratio for s in plain.specs] != [s.area_ratio for s in moved.specs]:
            continue
        if plain.landmark.code == moved.landmark.code:
            assert moved.unit.radii_m[-2] < plain.unit.radii_m[-2]
