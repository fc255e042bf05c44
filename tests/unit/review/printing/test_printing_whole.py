"""The landmark drawn on one sheet, read back from each format, against the specification's table in millimetres."""

import numpy as np
import pytest

from app.landmark import ContourSpec, Shape, build_landmark, paper_landmark
from app.review.printing import draw_landmark

# Corners (right, up) in mm from the centre, from the table: sides 380, 268.701, 204.168, 144.369, 47.5.
TABLE_MM = [
    [(-190, 190), (190, 190), (190, -190), (-190, -190)],
    [(-134.35, 134.35), (134.35, 134.35), (134.35, -134.35), (-134.35, -134.35)],
    [(0, 88.407), (102.084, -88.407), (-102.084, -88.407)],
    [(0, 53.882), (72.184, -71.145), (-72.184, -71.145)],
    [(-23.75, -11.515), (23.75, -11.515), (23.75, -59.015), (-23.75, -59.015)],
]
GREYS = [0.0, 1.0, 0.0, 1.0, 0.0]
ZONE_HALF_MM = 230.0


@pytest.fixture
def whole_pdf(tmp_path, read_pdf):
    draw_landmark(paper_landmark(), tmp_path / "pad.pdf")
    (page,) = read_pdf(tmp_path / "pad.pdf")
    return page


def _centre(drawn):
    return drawn.polygons[0][1].mean(axis=0)


def _check_pattern(drawn):
    assert [grey for grey, _ in drawn.polygons[:5]] == GREYS
    for (_, corners), expected in zip(drawn.polygons[:5], TABLE_MM, strict=True):
        np.testing.assert_allclose(corners - _centre(drawn), expected, atol=0.01)


def test_pdf_contours_have_the_tables_sizes_in_true_millimetres(whole_pdf):
    _check_pattern(whole_pdf)


def test_svg_contours_have_the_tables_sizes_in_true_millimetres(tmp_path, read_svg):
    assert draw_landmark(paper_landmark(), tmp_path / "pad.svg") == [tmp_path / "pad.svg"]
    _check_pattern(read_svg(tmp_path / "pad.svg"))


@pytest.mark.parametrize("suffix", ["pdf", "svg"])
def test_sheet_holds_the_quiet_zone_and_keeps_everything_else_out_of_it(tmp_path, read_pdf, read_svg, suffix):
    path = tmp_path / f"pad.{suffix}"
    draw_landmark(paper_landmark(), path)
    drawn = read_svg(path) if suffix == "svg" else read_pdf(path)[0]
    centre = _centre(drawn)
    assert (np.array([drawn.width, drawn.height]) - centre > ZONE_HALF_MM).all()
    assert (centre > ZONE_HALF_MM).all()
    others = [corners for _, corners in drawn.polygons[5:]] + [np.array(line) for line in drawn.lines]
    # Convex pieces: one is outside if all of it lies beyond one side of the zone.
    inside = [piece for piece in others if not _beyond_a_side(piece - centre)]
    assert (len(others) > 10, inside) == (True, [])


def _beyond_a_side(piece):
    return bool((piece > ZONE_HALF_MM).all(axis=0).any() or (piece < -ZONE_HALF_MM).all(axis=0).any())


def test_pdf_arrow_stands_in_front_of_the_zone_and_points_forward(whole_pdf):
    (arrow,) = [corners for grey, corners in whole_pdf.polygons if 0.0 < grey < 1.0]
    tip = arrow[arrow[:, 1].argmax()] - _centre(whole_pdf)
    assert tip[0] == pytest.approx(0.0, abs=0.01)
    assert arrow[:, 1].min() - _centre(whole_pdf)[1] > ZONE_HALF_MM
    assert "FRONT" in whole_pdf.text


def test_pdf_ruler_is_10_cm_long_between_its_outer_ticks(whole_pdf):
    below = _centre(whole_pdf)[1] - ZONE_HALF_MM - 2.0
    ticks = sorted(a[0] for a, b in whole_pdf.lines if a[0] == b[0] and max(a[1], b[1]) < below)
    assert np.diff(ticks) == pytest.approx([10.0] * 10, abs=0.01)


def test_pdf_text_says_name_and_sizes(whole_pdf):
    wanted = ("paper", "side 38 cm", "quiet zone 46 cm", "44334")
    assert [word for word in wanted if word not in whole_pdf.text] == []


def test_pdf_asks_the_viewer_not_to_scale(tmp_path):
    draw_landmark(paper_landmark(), tmp_path / "pad.pdf")
    assert b"/PrintScaling /None" in (tmp_path / "pad.pdf").read_bytes()


def test_pdf_of_the_same_landmark_is_the_same_file(tmp_path):
    draw_landmark(paper_landmark(), tmp_path / "a.pdf")
    draw_landmark(paper_landmark(), tmp_path / "b.pdf")
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


def _spans(row):
    """Where black begins and ends along a row, in pixel edges."""
    return np.flatnonzero(np.diff((row < 60).astype(np.int8))) + 1


def test_png_carries_its_resolution_and_measures_true(tmp_path, read_png):
    draw_landmark(paper_landmark(), tmp_path / "pad.png", dpi=254)
    image, pixels_per_m = read_png(tmp_path / "pad.png")
    assert pixels_per_m == pytest.approx(10_000, abs=1)
    black = np.argwhere(image < 60)
    top, left = black.min(axis=0)
    assert (black.max(axis=0) + 1 - (top, left)).tolist() == [3800, 3800]
    # Along the row 35.3 mm behind the centre: S1, S2, T3, T4 and S5 in turn, in tenths of a millimetre. T3's sides are
    # at (88.407 + 35.3) / sqrt(3) = 71.42 mm there, T4's at (53.882 + 35.3) / sqrt(3) = 51.49 mm.
    spans = _spans(image[top + 1900 + 353]) - (left + 1900)
    half = [1900, 1343.5, 714.2, 514.9, 237.5]
    np.testing.assert_allclose(spans, [-h for h in half] + half[::-1], atol=1.0)


def test_png_quiet_zone_is_white_round_the_outermost_square(tmp_path, read_png):
    draw_landmark(paper_landmark(), tmp_path / "pad.png", dpi=127)
    image, _ = read_png(tmp_path / "pad.png")
    top, left = np.argwhere(image < 60).min(axis=0)
    zone = image[top - 200 : top + 2100, left - 200 : left + 2100].copy()
    zone[200:2100, 200:2100] = 255
    assert zone.shape == (2300, 2300)
    assert zone.min() == 255


@pytest.mark.parametrize(("dpi", "side_px"), [(72, 1077), (200, 2992), (300, 4488)])
def test_png_of_another_resolution_is_the_same_size_on_paper(tmp_path, read_png, dpi, side_px):
    # 380 mm / 25.4 * dpi.
    draw_landmark(paper_landmark(), tmp_path / "pad.png", dpi=dpi)
    image, pixels_per_m = read_png(tmp_path / "pad.png")
    columns = np.flatnonzero((image < 60).any(axis=0))
    assert columns[-1] + 1 - columns[0] == pytest.approx(side_px, abs=1)
    assert pixels_per_m == pytest.approx(dpi / 0.0254, abs=1)


def test_drawing_a_users_own_nest_draws_each_of_its_contours(tmp_path, read_svg):
    square, triangle = Shape.SQUARE, Shape.TRIANGLE
    shapes = (square, triangle, square, square)
    specs = tuple(ContourSpec(s, r) for s, r in zip(shapes, (1, 1 / 4, 1 / 16, 1 / 36), strict=True))
    draw_landmark(build_landmark("own", 0.6, specs, 0.7), tmp_path / "own.svg")
    drawn = read_svg(tmp_path / "own.svg")
    assert [len(corners) for _, corners in drawn.polygons[:4]] == [4, 3, 4, 4]
    widths = [np.ptp(corners[:, 0]) for _, corners in drawn.polygons[:4]]
    # Squares of 600, 150 and 100 mm; a triangle of a quarter of 0.36 m2 has sides of sqrt(0.36 / sqrt(3)) m.
    assert widths == pytest.approx([600.0, 455.90, 150.0, 100.0], abs=0.01)


def test_drawing_a_small_landmark_leaves_room_for_the_ruler(tmp_path, read_pdf):
    draw_landmark(paper_landmark(0.05), tmp_path / "pad.pdf")
    (page,) = read_pdf(tmp_path / "pad.pdf")
    xs = [x for a, b in page.lines for x, _ in (a, b)]
    assert (min(xs) > 0, max(xs) < page.width) == (True, True)
