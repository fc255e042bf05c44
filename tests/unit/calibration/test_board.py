"""The board's corners in pictures of it, and pictures that are refused."""

import cv2
import numpy as np
import pytest

from app.calibration.board import Board, NoView, View, board_of, charuco_board
from app.calibration.collect import Collector, other_boards
from app.calibration.finder import BoardFinder
from app.errors import ConfigError
from app.messages import Frame

CHARUCO = Board("charuco", 7, 5, 0.03, 0.0216, "DICT_4X4_50")


def pattern(board, legacy=False):
    return charuco_board(board, legacy=legacy).generateImage((board.columns * 100, board.rows * 100), marginSize=0)


def true_px(bench, camera, pose, board):
    return bench.view_of(camera, pose, "", 0.0, board).px


@pytest.fixture(scope="module")
def held(bench):
    """A pose in which the board is tilted, off the middle, and wholly in the image of both lenses."""
    return {
        "straight": bench.hold(0.5, 0.1, 0.5, (0.4, -0.3, 0.2)),
        "straight_fisheye": bench.hold(0.5, 0.3, 0.22, (0.2, -0.3, 0.2)),
    }


@pytest.mark.parametrize("lens", ["straight", "straight_fisheye"])
def test_chessboard_corners_are_found_to_a_tenth_of_a_pixel(bench, held, lens):
    camera = getattr(bench, lens)
    found = BoardFinder(bench.board).find(bench.photograph(camera, held[lens], bench.board), "a.png")
    truth = true_px(bench, camera, held[lens], bench.board)
    assert isinstance(found, View)
    assert found.px.shape == (54, 2)
    # The board looks the same after half a turn: either order is right.
    off = min((np.linalg.norm(p - truth, axis=1) for p in (found.px, found.px[::-1])), key=np.median)
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert off.max() < 0.4


def test_charuco_corners_are_found_with_their_own_number_in_a_part_of_the_board(bench):
    pose = bench.hold(np.pi, 0.5, 0.28, (0.1, -0.5, 0.2), CHARUCO)
    image = bench.photograph(bench.straight, pose, CHARUCO, pattern=pattern(CHARUCO))
    truth = true_px(bench, bench.straight, pose, CHARUCO)
    inside = ((truth > 0) & (truth < np.array(bench.size) - 1)).all(axis=1)
    assert not inside.all()
    found = BoardFinder(CHARUCO).find(image, "part.png")
    assert isinstance(found, View)
    assert 8 <= len(found.px) <= inside.sum()
    off = np.linalg.norm(found.px - truth[found.index], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.2
    np.testing.assert_allclose(found.corners_m[:, 0], (found.index % 6 + 1) * 0.03)


def test_charuco_board_as_opencv_drew_it_before_4_6_is_found_too(bench):
    board = Board("charuco", 7, 6, 0.03, 0.0216, "DICT_4X4_50")
    old, new = pattern(board, legacy=True), pattern(board)
    assert (old != new).any()
    pose = bench.hold(0.0, 0.0, 0.35, (0.1, 0.1, 0.0), board)
    image = bench.photograph(bench.straight, pose, board, pattern=old)
    found = BoardFinder(board).find(image, "old.png")
    assert isinstance(found, View)
    assert len(found.px) >= 25


@pytest.mark.parametrize("sigma", [0.7, 1.5, 2.5, 3.5])
def test_blur_is_the_sigma_that_the_picture_was_blurred_with(bench, sigma):
    pose = bench.hold(0.0, 0.0, 0.4, (0.05, 0.1, 0.1))
    found = BoardFinder(bench.board).find(bench.photograph(bench.straight, pose, bench.board, blur=sigma), "")
    # A pixel's own width counts too: a box of side 1 has a variance of 1/12; the second one is the interpolation's.
    expected = np.sqrt(sigma**2 + 2 / 12)
    assert found.blur_px == pytest.approx(expected, rel=0.12)


def test_blur_along_one_direction_counts_like_blur_along_both(bench):
    pose = bench.hold(0.0, 0.0, 0.4, (0.05, 0.1, 0.0))
    still = bench.photograph(bench.straight, pose, bench.board)
    moved = cv2.blur(still, (9, 1))
    finder = BoardFinder(bench.board)
    # Nine pixels of motion: an edge rises over 9 px, like that of a Gaussian of 9 / sqrt(2 pi).
    assert finder.find(moved, "").blur_px == pytest.approx(9 / np.sqrt(2 * np.pi), rel=0.15)
    assert finder.find(still, "").blur_px < 1.0


def test_picture_without_a_board_is_refused_in_words():
    noise = np.random.default_rng(0).integers(0, 255, (240, 320)).astype(np.uint8)
    for board in (Board("chessboard", 10, 7, 0.025), CHARUCO):
        assert BoardFinder(board).find(noise, "lawn.png") == NoView("lawn.png", "no board found")


def test_board_that_is_too_small_in_the_image_is_refused(bench):
    wide = bench.camera("pinhole", 90.0, 90.0, 319.5, 239.5, (0.0,) * 5)
    board = Board("chessboard", 6, 5, 0.025)
    pose = bench.hold(0.0, 0.0, 0.48, (0.0, 0.0, 0.0), board)
    sharp = bench.photograph(wide, pose, board, blur=0.4, noise=0.5)
    found = BoardFinder(board).find(sharp, "far.png")
    assert isinstance(found, NoView)
    assert "too small in the image" in found.reason or found.reason == "no board found"


@pytest.mark.parametrize(
    ("columns", "rows", "says"),
    [
        (9, 6, "give --columns 10 --rows 7: squares are counted, not inner corners"),
        (11, 7, "give --columns 10 --rows 7"),
        (11, 8, "give --columns 10 --rows 7"),
    ],
)
def test_board_of_another_size_is_named(bench, columns, rows, says):
    half = bench.camera("pinhole", 247.0, 247.0, 159.5, 119.5, (0.0,) * 5)
    image = bench.photograph(half, bench.hold(0.0, 0.0, 0.4, (0.2, 0.1, 0.0)), bench.board, size=(320, 240))
    assert other_boards(Board("chessboard", columns, rows, 0.025), [image]).endswith(says)


def test_markers_of_another_dictionary_are_named(bench):
    pose = bench.hold(0.0, 0.0, 0.3, (0.1, 0.1, 0.0), CHARUCO)
    image = bench.photograph(bench.straight, pose, CHARUCO, pattern=pattern(CHARUCO))
    wrong = Board("charuco", 7, 5, 0.03, 0.0216, "DICT_6X6_250")
    assert isinstance(BoardFinder(wrong).find(image, ""), NoView)
    assert other_boards(wrong, [image]) == "markers of DICT_4X4_50 are there: give --dictionary DICT_4X4_50"


def test_images_of_another_size_are_refused_with_both_sizes(bench):
    collector = Collector(bench.board)
    collector.look(Frame(0.0, 0, np.full((480, 640), 120, np.uint8), name="a.png"))
    found = collector.look(Frame(0.0, 1, np.full((240, 320), 120, np.uint8), name="b.png"))
    assert found == NoView("b.png", "320x240 pixels, the first image has 640x480")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("chessboard", 3, 7, 25.0, None, ""), "give at least 4 x 4"),
        (("charuco", 10, 7, 25.0, None, "DICT_9X9_50"), "unknown dictionary 'DICT_9X9_50'"),
        (("charuco", 10, 7, 25.0, 24.0, "DICT_5X5_100"), "give --marker-mm between 7.5 and 22.5"),
        (("charuco", 20, 20, 25.0, None, "4x4_50"), "needs 200 markers, 4x4_50 has 50"),
    ],
)
def test_board_that_cannot_be_is_refused_with_what_to_give(arguments, says):
    with pytest.raises(ConfigError, match=says):
        board_of(*arguments)
