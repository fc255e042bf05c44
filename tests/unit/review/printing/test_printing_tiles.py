"""The landmark cut into pages: put together again as the marks say, the pages give the whole."""

import numpy as np
import pytest

from app.errors import LandmarkError
from app.landmark import paper_landmark
from app.review.printing import draw_landmark

A4 = (210.0, 297.0)
A3 = (297.0, 420.0)
LETTER = (215.9, 279.4)


@pytest.mark.parametrize(
    ("size_cm", "paper", "pages", "page_mm"),
    [
        # A sheet for 38 cm is 480 x 510 mm. A page of A4 shows 182 x 269 mm, 10 of them shared with each neighbour:
        # 3 x 2 pages (the same lying), behind the overview.
        (38.0, "a4", 7, A4),
        # A3 shows 269 x 392 mm: 2 x 2.
        (38.0, "a3", 5, A3),
        # Letter shows 187.9 x 251.4 mm upright (3 x 3), 251.4 x 187.9 mm lying (2 x 3): lying.
        (38.0, "letter", 7, LETTER[::-1]),
        # Paper's name in capitals, too; 10 cm fits on one page, which needs no overview.
        (10.0, "A4", 1, A4),
    ],
)
def test_tile_takes_the_fewest_pages_of_the_papers_exact_size(tmp_path, read_pdf, size_cm, paper, pages, page_mm):
    written = draw_landmark(paper_landmark(size_cm / 100), tmp_path / "pad.pdf", tile=paper)
    drawn = read_pdf(tmp_path / "pad.pdf")
    assert (written, len(drawn)) == ([tmp_path / "pad.pdf"], pages)
    sizes = [size for page in drawn for size in (page.width, page.height)]
    assert sizes == pytest.approx(list(page_mm) * pages, abs=0.01)


def test_tile_pages_are_at_true_size_and_numbered(tmp_path, read_pdf):
    draw_landmark(paper_landmark(), tmp_path / "pad.pdf", tile="a4")
    overview, *parts = read_pdf(tmp_path / "pad.pdf")
    assert [np.ptp(page.polygons[0][1], axis=0) for page in parts] == [pytest.approx([380.0, 380.0], abs=0.01)] * 6
    assert np.ptp(overview.polygons[0][1][:, 0]) < 190.0
    labels = [f"page {k + 1} of 6  (row {k // 3 + 1}, column {k % 3 + 1})" for k in range(6)]
    assert [label for label, page in zip(labels, parts, strict=True) if label not in page.text] == []


def test_tile_pages_step_by_what_neighbours_do_not_share(tmp_path, read_pdf):
    draw_landmark(paper_landmark(), tmp_path / "pad.pdf", tile="a4")
    parts = read_pdf(tmp_path / "pad.pdf")[1:]
    corners = [page.polygons[0][1][0] for page in parts]
    # Each part is cut to the box between its crop marks: 14 mm inside the page.
    assert [page.clips[0] for page in parts] == [pytest.approx((14.0, 14.0, 196.0, 283.0), abs=0.01)] * 6
    assert corners[0] - corners[1] == pytest.approx([172.0, 0.0], abs=0.01)
    assert corners[3] - corners[0] == pytest.approx([0.0, 259.0], abs=0.01)


def test_tile_every_page_has_crop_marks_at_its_box_and_a_10_cm_ruler_in_its_margin(tmp_path, read_pdf):
    draw_landmark(paper_landmark(), tmp_path / "pad.pdf", tile="a4")
    for page in read_pdf(tmp_path / "pad.pdf")[1:]:
        lines = np.round(np.array(page.lines), 2)
        uprights = lines[(lines[:, 0, 0] == lines[:, 1, 0])]
        beside_corners = uprights[np.isin(uprights[:, 0, 0], (14.0, 196.0)) & (np.ptp(uprights[:, :, 1], axis=1) == 6)]
        assert len(beside_corners) == 4
        in_margin = lines[(lines[:, :, 1] < 14.0).all(axis=1)]
        assert 100.0 in np.round(np.ptp(in_margin[:, :, 0], axis=1), 1)


def test_tile_pages_put_together_give_the_whole(tmp_path, read_png):
    # At 127 dpi a millimetre is 5 pixels.
    draw_landmark(paper_landmark(), tmp_path / "whole.png", dpi=127)
    whole, _ = read_png(tmp_path / "whole.png")
    paths = draw_landmark(paper_landmark(), tmp_path / "pad.png", tile="a4", dpi=127)
    assert [path.name for path in paths] == [f"pad-{k:02d}.png" for k in range(7)]
    pages = [read_png(path)[0] for path in paths[1:]]
    assert [page.shape for page in pages] == [(1485, 1050)] * 6
    # Boxes of 182 x 269 mm in steps of 172 x 259 mm cover 526 x 528 mm; the sheet of 480 x 510 mm is in their middle.
    cover = np.full((528 * 5, 526 * 5), 255, np.uint8)
    cover[9 * 5 : 9 * 5 + 2550, 23 * 5 : 23 * 5 + 2400] = whole
    for k, page in enumerate(pages):
        top, left = (k // 3) * 259 * 5, (k % 3) * 172 * 5
        box = page[14 * 5 : -14 * 5, 14 * 5 : -14 * 5]
        expected = cover[top : top + box.shape[0], left : left + box.shape[1]]
        assert int(((box < 60) != (expected < 60)).sum()) == 0


def test_tile_svg_writes_numbered_files_that_are_cut_to_their_boxes(tmp_path, read_svg):
    paths = draw_landmark(paper_landmark(), tmp_path / "pad.svg", tile="a3")
    assert [path.name for path in paths] == [f"pad-{k:02d}.svg" for k in range(5)]
    page = read_svg(paths[1])
    assert (page.width, page.height) == pytest.approx(A3)
    assert 'clip-path="url(#c0)"' in paths[1].read_text()


@pytest.mark.parametrize(
    ("size_cm", "tile", "words"),
    [(38.0, "a5", ["--tile a5", "unknown paper", "a4, a3, letter"]), (800.0, "a4", ["--tile a4", "pages", "400"])],
)
def test_tile_that_makes_no_sense_is_refused(tmp_path, size_cm, tile, words):
    with pytest.raises(LandmarkError) as refused:
        draw_landmark(paper_landmark(size_cm / 100), tmp_path / "pad.pdf", tile=tile)
    assert [word for word in words if word not in str(refused.value)] == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "dpi", "size_m", "words"),
    [
        ("pad.jpg", 300, 0.38, ["pad.jpg", ".pdf, .svg or .png"]),
        ("pad", 300, 0.38, ["pad", "without an extension"]),
        ("nowhere/pad.pdf", 300, 0.38, ["nowhere/pad.pdf", "can't be written", "No such file or directory"]),
        ("pad.png", 10, 0.38, ["10 dots per inch", "30 to 2400"]),
        ("pad.png", 1200, 1.0, ["1200 dpi", "500 million"]),
        ("pad.pdf", 300, 6.0, ["larger than a PDF page can be (508 cm)", "--tile"]),
    ],
)
def test_drawing_that_cannot_be_written_is_refused(tmp_path, name, dpi, size_m, words):
    with pytest.raises(LandmarkError) as refused:
        draw_landmark(paper_landmark(size_m), tmp_path / name, dpi=dpi)
    assert [word for word in words if word not in str(refused.value)] == []
    assert list(tmp_path.iterdir()) == []


def test_drawing_onto_a_folder_is_refused(tmp_path):
    (tmp_path / "pad.pdf").mkdir()
    with pytest.raises(LandmarkError, match=r"pad\.pdf: can't be written"):
        draw_landmark(paper_landmark(), tmp_path / "pad.pdf")
