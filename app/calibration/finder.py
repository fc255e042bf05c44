"""A board's corners in an image, to sub-pixel. It knows nothing of lenses."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from app.calibration.board import Board, Indices, NoView, View, charuco_board
from app.calibration.sharpness import edge_sigma_px
from app.frames import Array
from app.messages import Image

SPACING_MIN_PX = 5.0
"""Corners closer than this spoil each other: the refinement's window would reach the next one."""
WINDOW_PX = (2, 5)
"""Its limits, the upper one for images of up to FINE_WIDTH_PX; in wider ones edges are softer in proportion."""
FINE_WIDTH_PX = 1000
CORNERS_MIN = 8
"""A pose takes four; a view of fewer than eight says next to nothing of the lens."""
SEARCH_WIDTH_PX = 1280
"""Wider images are searched for a chessboard at a lower resolution; corners are refined at the full one."""


class BoardFinder:
    """Finds one board in images.

    Args:
        board: Which.
    """

    def __init__(self, board: Board) -> None:
        self.board = board
        self._charuco: list[Any] = []
        if board.kind == "charuco":
            # Old prints are as good as new ones; which it is shows itself at the first view.
            self._charuco = [_charuco_detector(board, legacy) for legacy in (False, True)]

    def find(self, image: Image, name: str) -> View | NoView:
        """Look for the board in a grey image (h, w)."""
        index, px = self._chessboard(image) if self.board.kind == "chessboard" else self._parts(image)
        if not len(index):
            return NoView(name, "no board found")
        if len(index) < CORNERS_MIN:
            return NoView(name, f"only {len(index)} corners of the board found, at least {CORNERS_MIN} are needed")
        spacing = self._spacing_px(index, px)
        if float(np.median(spacing)) < SPACING_MIN_PX:
            return NoView(
                name,
                f"the board is too small in the image: {np.median(spacing):.1f} px a square, at least "
                f"{SPACING_MIN_PX:g} are needed",
            )
        px, kept = _refined(image, px, self.board.clear_part * spacing)
        index, px, spacing = index[kept], px[kept], spacing[kept]
        corners = self.board.corners_m[index]
        if len(index) < CORNERS_MIN or np.ptp(corners[:, 0]) == 0 or np.ptp(corners[:, 1]) == 0:
            return NoView(name, "the corners that were found lie on a line, or are too few")
        height, width = image.shape[:2]
        blur = edge_sigma_px(image, self._grid(index, px))
        return View(name, (width, height), index, corners, px, blur, float(np.median(spacing)))

    # ---------------------------------------------------------------------------------------------------- both kinds
    def _chessboard(self, image: Image) -> tuple[Indices, Array]:
        """Index and pixels of all inner corners, or none. The order may be turned by half a turn: the pattern is."""
        size = (self.board.columns - 1, self.board.rows - 1)
        scale = min(1.0, SEARCH_WIDTH_PX / image.shape[1])
        small = image
        if scale < 1.0:
            small = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        done, corners = cv2.findChessboardCornersSB(small, size)
        if not done:
            flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
            done, corners = cv2.findChessboardCorners(small, size, flags=flags)
        if not done or corners is None:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 2))
        px = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) / scale - 0.5
        return np.arange(len(px), dtype=np.int64), px

    def _parts(self, image: Image) -> tuple[Indices, Array]:
        """Index and pixels of the inner corners of a ChArUco board that were found."""
        for k, detector in enumerate(self._charuco):
            corners, ids, _, _ = detector.detectBoard(image)
            if ids is not None and len(ids) >= CORNERS_MIN:
                self._charuco = [self._charuco[k]]
                return np.asarray(ids).ravel().astype(np.int64), np.asarray(corners, np.float64).reshape(-1, 2)
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2))

    def _grid(self, index: Indices, px: Array) -> Array:
        """(rows - 1, columns - 1, 2) pixels of the inner corners; not a number where not found."""
        grid = np.full(((self.board.rows - 1) * (self.board.columns - 1), 2), np.nan)
        grid[index] = px
        return grid.reshape(self.board.rows - 1, self.board.columns - 1, 2)

    def _spacing_px(self, index: Indices, px: Array) -> Array:
        """(n,) distance of each corner to its nearest neighbour on the board; infinite without one."""
        grid = self._grid(index, px)
        nearest = np.full(grid.shape[:2], np.inf)
        for axis in (0, 1):
            d = np.linalg.norm(np.diff(grid, axis=axis), axis=-1)
            d = np.where(np.isnan(d), np.inf, d)
            wide = [(0, 0), (0, 0)]
            for side in ((1, 0), (0, 1)):
                wide[axis] = side
                nearest = np.minimum(nearest, np.pad(d, wide, constant_values=np.inf))
        result: Array = nearest.reshape(-1)[index]
        return result


def _charuco_detector(board: Board, legacy: bool) -> Any:
    detection = cv2.aruco.DetectorParameters()
    detection.adaptiveThreshWinSizeMax = 43  # large markers close up: more window sizes than the default
    return cv2.aruco.CharucoDetector(charuco_board(board, legacy=legacy), cv2.aruco.CharucoParameters(), detection)


def _refined(image: Image, px: Array, clear_px: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Corners to sub-pixel (Förstner's method, as OpenCV has it), and which of them held still enough to be believed.

    Args:
        image: (h, w) grey.
        px: (n, 2) where the corners are, roughly.
        clear_px: (n,) how far round each nothing but its own edges is seen.
    """
    least, most = WINDOW_PX
    half = np.clip(clear_px, least, most * max(1.0, image.shape[1] / FINE_WIDTH_PX)).astype(np.int64)
    result = px.copy()
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    for size in np.unique(half):
        mine = half == size
        start = np.ascontiguousarray(px[mine].reshape(-1, 1, 2), dtype=np.float32)
        found = cv2.cornerSubPix(image, start, (int(size), int(size)), (-1, -1), criteria)
        result[mine] = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    kept = np.linalg.norm(result - px, axis=1) <= half
    height, width = image.shape[:2]
    kept &= ((result > 1.0) & (result < np.array([width - 2.0, height - 2.0]))).all(axis=1)
    return result, kept
