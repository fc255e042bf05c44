"""The landmark's geometry against the table of its specification, and what can't be drawn.

Expected centimetres are those of the specification's table (Wu et al., section II, with the innermost square at half
the paper's area), not of the code. Print coordinates there are (right, up); here corners are (forward, right).
"""

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from app.errors import LandmarkError
from app.landmark import ContourSpec, Shape, build_landmark, paper_landmark

TABLE = [
    # name, shape, black, share of S1's area, side, back edge, front edge, centroid (all cm, forward up)
    ("S1", Shape.SQUARE, True, 1 / 1, 38.0000, -19.0000, 19.0000, 0.0),
    ("S2", Shape.SQUARE, False, 1 / 2, 26.8701, -13.43505, 13.43505, 0.0),
    ("T3", Shape.TRIANGLE, True, 1 / 8, 20.4168, -8.8407, 8.8407, -2.9469),
    ("T4", Shape.TRIANGLE, False, 1 / 16, 14.4368, -7.1145, 5.3882, -2.9469),
    ("S5", Shape.SQUARE, True, 1 / 64, 4.7500, -5.9015, -1.1515, -3.5265),
]


@pytest.mark.parametrize(("index", "row"), list(enumerate(TABLE)), ids=[row[0] for row in TABLE])
def test_paper_landmark_each_contour_matches_the_table(index, row):
    name, shape, black, share, side_cm, back_cm, front_cm, centroid_cm = row
    contour = paper_landmark().contours[index]
    forward_cm, right_cm = contour.corners_m.T * 100
    assert (contour.name, contour.shape, contour.black) == (name, shape, black)
    assert contour.area_m2 == pytest.approx(0.38**2 * share, rel=1e-9)
    assert contour.side_m * 100 == pytest.approx(side_cm, abs=1e-4)
    assert (forward_cm.min(), forward_cm.max()) == pytest.approx((back_cm, front_cm), abs=1e-4)
    assert contour.centroid_m * 100 == pytest.approx([centroid_cm, 0.0], abs=1e-4)
    assert right_cm.max() == pytest.approx(side_cm / 2, abs=1e-4)
    assert right_cm.min() == pytest.approx(-side_cm / 2, abs=1e-4)


def test_paper_landmark_innermost_square_has_equal_gaps_of_12_mm_to_three_sides():
    _, _, _, triangle, square = paper_landmark().contours
    outline = (triangle.corners_m * 100).astype(np.float32)
    gaps = [cv2.pointPolygonTest(outline, (float(f * 100), float(r * 100)), True) for f, r in square.corners_m]
    # Front corners are nearest to the slanted sides, back corners to the base.
    assert gaps == pytest.approx([1.213] * 4, abs=1e-3)


def test_paper_landmark_code_quiet_zone_and_ratios_are_the_papers():
    landmark = paper_landmark()
    assert landmark.code == "44334"
    assert landmark.quiet_zone_m == pytest.approx(0.46)
    assert [landmark.area_ratio(k) for k in range(4)] == pytest.approx([2, 4, 2, 4])


def test_contour_corners_are_in_the_documented_order():
    square, _, triangle, *_ = paper_landmark().contours
    assert np.sign(square.corners_m).tolist() == [[1, -1], [1, 1], [-1, 1], [-1, -1]]
    assert triangle.corners_m[0] == pytest.approx([0.088407, 0.0], abs=1e-6)
    assert np.sign(triangle.corners_m[1:]).tolist() == [[-1, 1], [-1, -1]]


def test_landmark_of_another_size_is_the_same_pattern_scaled():
    small, large = paper_landmark(0.19), paper_landmark(0.38)
    for a, b in zip(small.contours, large.contours, strict=True):
        np.testing.assert_allclose(2 * a.corners_m, b.corners_m, atol=1e-12)
    assert small.quiet_zone_m == pytest.approx(0.23)


SQUARE, TRIANGLE = Shape.SQUARE, Shape.TRIANGLE
PAPERS_OWN = ((SQUARE, 1.0), (SQUARE, 1 / 2), (TRIANGLE, 1 / 8), (TRIANGLE, 1 / 16), (SQUARE, 1 / 32))


@pytest.mark.parametrize(
    ("contours", "words"),
    [
        # The paper's own last ratio: the square needs a triangle of side 6.7175 / 0.46410 = 14.4744 cm and has one of
        # 14.4368 cm; a gap g on each side takes 2 sqrt(3) g off a side, so g = -0.0108 cm.
        (PAPERS_OWN, ("S5 crosses T4", "sticks out by 0.11 mm", "1.44 mm (1% of T4's side)")),
        # Sides 38 and 37.4257 cm leave 0.287 cm on each side.
        (((SQUARE, 1.0), (SQUARE, 0.97)), ("S2 in S1", "gap of 2.87 mm", "3.80 mm")),
        (((SQUARE, 1.0), (SQUARE, 1.0)), ("S2 touches S1", "3.80 mm")),
        # The second square is larger than the first inner one: 0.5 against 0.6 of the area, 26.8701 and 29.4347 cm.
        (((SQUARE, 1.0), (SQUARE, 0.5), (SQUARE, 0.6)), ("S3 crosses S2", "sticks out by 12.82 mm", "2.69 mm")),
        # A square of 0.36 cm: 0.36 / 38 squared.
        (((SQUARE, 1.0), (SQUARE, 8.975e-5)), ("S2 has sides of 3.60 mm", "3.80 mm")),
        (((TRIANGLE, 1.0), (SQUARE, 0.1)), ("outermost contour is a triangle", "make it a square")),
        (((SQUARE, 1.0),), ("has 1 contour", "at least 2")),
        (((SQUARE, 1.0), (SQUARE, 0.0)), ("S2 has area_ratio 0", "more than 0")),
    ],
    ids=["paper-own", "thin", "touching", "crossing", "tiny", "outer-triangle", "single", "empty"],
)
def test_landmark_that_cannot_be_drawn_is_refused_with_names_and_limit(contours, words):
    with pytest.raises(LandmarkError) as refused:
        build_landmark("mine", 0.38, tuple(ContourSpec(shape, ratio) for shape, ratio in contours))
    assert [word for word in ("'mine'", *words) if word not in str(refused.value)] == []


def test_landmark_shifted_contour_that_leaves_its_parent_is_refused():
    # S2 has 5.5650 cm to S1; 7 cm forward takes it 1.435 cm out.
    specs = (ContourSpec(SQUARE, 1.0), ContourSpec(SQUARE, 0.5, offset_forward_m=0.07))
    with pytest.raises(LandmarkError, match=r"S2 crosses S1: it sticks out by 14\.35 mm.*move it less"):
        build_landmark("mine", 0.38, specs)


def test_landmark_shifted_contour_that_stays_inside_is_drawn_shifted():
    specs = (ContourSpec(SQUARE, 1.0), ContourSpec(SQUARE, 0.25, offset_forward_m=0.03, offset_right_m=-0.02))
    assert build_landmark("mine", 0.4, specs).contours[1].centroid_m == pytest.approx([0.03, -0.02])


def test_landmark_quiet_zone_narrower_than_the_limit_is_refused():
    with pytest.raises(LandmarkError, match=r"quiet zone of 38\.50 cm leaves 0\.25 cm round S1.*0\.38 cm"):
        build_landmark("mine", 0.38, (ContourSpec(SQUARE, 1.0), ContourSpec(SQUARE, 0.5)), 0.385)


@given(
    shapes=st.lists(st.sampled_from(list(Shape)), min_size=1, max_size=5),
    factors=st.lists(st.floats(1.3, 8.0), min_size=5, max_size=5),
    size_m=st.floats(0.05, 3.0),
)
def test_landmark_that_is_drawn_keeps_every_gap_by_a_second_reckoning(shapes, factors, size_m):
    ratios = 1.0 / np.cumprod(factors)
    specs = (
        ContourSpec(SQUARE, 1.0),
        *(ContourSpec(s, float(r)) for s, r in zip(shapes, ratios[: len(shapes)], strict=True)),
    )
    try:
        landmark = build_landmark("any", size_m, specs)
    except LandmarkError:
        assume(False)
    for parent, child in zip(landmark.contours, landmark.contours[1:], strict=False):
        outline = (parent.corners_m / parent.side_m).astype(np.float32)
        corners = child.corners_m / parent.side_m
        nearest = min(cv2.pointPolygonTest(outline, (float(f), float(r)), True) for f, r in corners)
        assert nearest > 0.01 - 1e-5
        assert parent.black is not child.black
        assert math.isclose(child.centroid_m[1], 0.0, abs_tol=1e-9)
