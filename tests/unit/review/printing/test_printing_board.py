"""Calibration boards as drawn, read back: true sizes, and OpenCV's own detector for the markers."""

import cv2
import numpy as np
import pytest

from app.calibration.board import board_of
from app.errors import LandmarkError
from app.review.printing.board import draw_board

MM_PER_PX = 25.4 / 300
CHESSBOARD = board_of("chessboard", 10, 7, 25.0, None, "")
CHARUCO = board_of("charuco", 10, 7, 25.0, 18.0, "DICT_5X5_100")


def test_pdf_chessboard_has_black_squares_of_true_size_upper_left_first(tmp_path, read_pdf):
    draw_board(CHESSBOARD, tmp_path / "board.pdf")
    (page,) = read_pdf(tmp_path / "board.pdf")
    black = [corners for grey, corners in page.polygons if grey == 0.0]
    assert len(black) == 35
    left, top = np.concatenate(black).min(axis=0)[0], np.concatenate(black).max(axis=0)[1]
    for corners in black:
        low, high = corners.min(axis=0), corners.max(axis=0)
        np.testing.assert_allclose(high - low, [25.0, 25.0], atol=1e-3)
        column, row = (low[0] - left) / 25.0, (top - high[1]) / 25.0
        assert round(column + row) % 2 == 0
        np.testing.assert_allclose([column, row], np.round([column, row]), atol=1e-3)


def test_png_charuco_is_read_by_opencv_with_every_corner_where_it_belongs(tmp_path):
    draw_board(CHARUCO, tmp_path / "board.png")
    image = cv2.imread(str(tmp_path / "board.png"), cv2.IMREAD_GRAYSCALE)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((10, 7), 0.025, 0.018, dictionary))
    corners, ids, _, markers = detector.detectBoard(image)
    assert len(markers) == 35
    assert sorted(ids.ravel().tolist()) == list(range(54))
    px = corners.reshape(-1, 2)[np.argsort(ids.ravel())].reshape(6, 9, 2)
    np.testing.assert_allclose(np.diff(px[..., 0], axis=1) * MM_PER_PX, 25.0, atol=0.1)
    np.testing.assert_allclose(np.diff(px[..., 1], axis=0) * MM_PER_PX, 25.0, atol=0.1)


@pytest.mark.parametrize(
    ("paper", "size_mm"), [("a4", (297.0, 210.0)), ("a3", (297.0, 420.0)), ("letter", (279.4, 215.9))]
)
def test_board_lies_whole_on_the_paper_with_white_round_it(tmp_path, read_pdf, paper, size_mm):
    draw_board(CHARUCO, tmp_path / "board.pdf", paper)
    (page,) = read_pdf(tmp_path / "board.pdf")
    np.testing.assert_allclose([page.width, page.height], size_mm, atol=0.01)
    points = np.concatenate([corners for _, corners in page.polygons])
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_allclose(high - low, [250.0, 175.0], atol=1e-3)
    assert low.min() >= 9.9
    assert (np.array(size_mm) - high).min() >= 9.9


def test_board_carries_a_true_ruler_and_its_own_sizes(tmp_path, read_pdf):
    draw_board(CHARUCO, tmp_path / "board.pdf")
    (page,) = read_pdf(tmp_path / "board.pdf")
    assert "ChArUco, 10 x 7 squares of 25 mm, markers DICT_5X5_100 of 18 mm" in page.text
    assert any(abs(end[0] - start[0]) == pytest.approx(100.0, abs=0.01) for start, end in page.lines)


def test_board_too_large_for_the_paper_is_refused_with_its_size(tmp_path):
    large = board_of("chessboard", 10, 7, 40.0, None, "")
    with pytest.raises(LandmarkError, match="400 x 280 mm with its margins does not fit on a4"):
        draw_board(large, tmp_path / "board.pdf", "a4")
    assert not list(tmp_path.iterdir())
