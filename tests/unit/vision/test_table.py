import pytest

from app.landmark import ContourSpec, Shape, build_landmark, paper_landmark
from app.vision.table import Alignment, alignments, legal_codes


def test_legal_codes_of_the_paper_landmark_are_all_runs_of_its_code():
    assert legal_codes(paper_landmark()) == {
        *("44", "43", "33", "34"),
        *("443", "433", "334"),
        *("4433", "4334", "44334"),
    }


@pytest.mark.parametrize(
    ("corners", "black", "first", "length"),
    [
        ((4, 4, 3, 3, 4), True, 0, 5),
        ((4, 4), True, 0, 2),
        ((4, 3), False, 1, 2),
        ((3, 3), True, 2, 2),
        ((3, 4), False, 3, 2),
        ((3, 3, 4), True, 2, 3),
        ((4, 3, 3, 4), False, 1, 4),
    ],
)
def test_run_is_read_at_its_place(corners, black, first, length):
    assert alignments(corners, black, paper_landmark()) == [Alignment(0, first, length)]


@pytest.mark.parametrize(
    ("corners", "black"),
    [((4, 4), False), ((4, 3), True), ((3, 3), False), ((3, 4), True), ((4,), True), ((0, 0), True)],
)
def test_wrong_colour_or_code_is_no_reading(corners, black):
    assert alignments(corners, black, paper_landmark()) == []


def test_run_inside_clutter_is_found():
    assert alignments((0, 0, 4, 4, 3, 0), True, paper_landmark()) == [Alignment(2, 0, 3)]


def test_ambiguous_run_has_all_its_readings():
    squares = build_landmark("squares", 0.4, tuple(ContourSpec(Shape.SQUARE, r) for r in (1.0, 0.6, 0.36, 0.2)))
    assert [(a.first, a.length) for a in alignments((4, 4), True, squares)] == [(0, 2), (2, 2)]
