"""The calibration board: what is drawn on it, and its corners in an image to sub-pixel. It knows nothing of lenses.

A board is `columns` by `rows` squares, the upper left one black. A chessboard is found whole or not at all; of a
ChArUco board (markers in the white squares) any part will do, so it reaches the image's edges. The board's frame: x
along a row, y down a column, z away from the viewer; its origin is the upper left corner of the upper left square.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from app.calibration.sharpness import edge_sigma_px
from app.errors import ConfigError
from app.frames import Array
from app.messages import Image

BoardKind = Literal["chessboard", "charuco"]
Indices: TypeAlias = NDArray[np.int64]

MARKER_PART = 0.72
"""Large markers are read from further away, but leave each corner some white."""
SPACING_MIN_PX = 5.0
"""Corners closer than this spoil each other: the refinement's window would reach the next one."""
WINDOW_PART = 0.35
"""Half of the window in which a corner is refined, in distances to its nearest neighbour: it ends before that. On a
ChArUco board it ends before the markers."""
WINDOW_PX = (2, 5)
CORNERS_MIN = 8
"""A pose takes four; a view of fewer than eight says next to nothing of the lens."""
SEARCH_WIDTH_PX = 1280
"""Wider images are searched for a chessboard at a lower resolution; corners are refined at the full one."""


@dataclass(frozen=True, slots=True)
class Board:
    """What is drawn.

    Attributes:
        kind: chessboard or charuco.
        columns: Squares across, black and white.
        rows: Squares down.
        square_m: Side of a square. It scales distances; the lens doesn't depend on it.
        marker_m: charuco: side of a marker.
        dictionary: charuco: OpenCV's name of the markers, such as DICT_5X5_100.

    Raises:
        ConfigError: No such board can be drawn.
    """

    kind: BoardKind
    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0
    dictionary: str = ""

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 4:
            raise ConfigError(f"a board of {self.columns} x {self.rows} squares", "give at least 4 x 4, such as 10 x 7")
        if self.kind == "chessboard":
            return
        if not 0.3 * self.square_m <= self.marker_m <= 0.9 * self.square_m:
            raise ConfigError(
                f"markers of {self.marker_m * 1e3:g} mm in squares of {self.square_m * 1e3:g} mm",
                f"give --marker-mm between {300 * self.square_m:.3g} and {900 * self.square_m:.3g}",
            )
        needed, there = self.columns * self.rows // 2, len(predefined(self.dictionary).bytesList)
        if needed > there:
            raise ConfigError(
                f"the board needs {needed} markers, {self.dictionary} has {there}", "give a larger --dictionary"
            )

    @property
    def corners_m(self) -> Array:
        """(n, 3) inner corners in the board's frame, row by row; n = (columns - 1) (rows - 1)."""
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float64)
        return points * self.square_m

    @property
    def clear_part(self) -> float:
        """How far round a corner, in squares, nothing but its own edges is seen."""
        return WINDOW_PART if self.kind == "chessboard" else min(WINDOW_PART, 0.5 * (1 - self.marker_m / self.square_m))

    def __str__(self) -> str:
        size = f"{self.columns} x {self.rows} squares of {self.square_m * 1e3:g} mm"
        if self.kind == "chessboard":
            return f"chessboard, {size}"
        return f"ChArUco, {size}, markers {self.dictionary} of {self.marker_m * 1e3:g} mm"


def board_of(
    kind: BoardKind, columns: int, rows: int, square_mm: float, marker_mm: float | None, dictionary: str
) -> Board:
    """A board from what a user gave; without marker_mm the markers have MARKER_PART of a square's side.

    Raises:
        ConfigError: No such board can be drawn.
    """
    if kind == "chessboard":
        return Board(kind, columns, rows, square_mm / 1000.0)
    marker = MARKER_PART * square_mm if marker_mm is None else marker_mm
    return Board(kind, columns, rows, square_mm / 1000.0, marker / 1000.0, dictionary)


def predefined(name: str) -> Any:
    """OpenCV's dictionary of markers of a name: DICT_5X5_100, or 5x5_100.

    Raises:
        ConfigError: There is none.
    """
    known = {n.upper(): n for n in dir(cv2.aruco) if n.startswith("DICT_")}
    full = name.upper() if name.upper().startswith("DICT_") else f"DICT_{name.upper()}"
    if full not in known:
        raise ConfigError(f"unknown dictionary {name!r}", f"give one of {', '.join(sorted(known))}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known[full]))


def charuco_board(board: Board, *, legacy: bool = False) -> Any:
    """OpenCV's own description of a ChArUco board; legacy: as OpenCV drew it before 4.6 (other colours where the number
    of rows is even).
    """
    made = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_m, board.marker_m, predefined(board.dictionary)
    )
    made.setLegacyPattern(legacy)
    return made


@dataclass(frozen=True, slots=True)
class View:
    """A board as it was found in one image.

    Attributes:
        name: Of the image.
        size_px: Width, height of the image.
        index: (n,) which of Board.corners_m.
        corners_m: (n, 3) in the board's frame.
        px: (n, 2) in the image; pixel centres at whole numbers.
        blur_px: Width of the board's edges in the direction in which they are blurred most: sigma of a Gaussian.
        spacing_px: Median distance of neighbouring corners.
    """

    name: str
    size_px: tuple[int, int]
    index: Indices
    corners_m: Array
    px: Array
    blur_px: float
    spacing_px: float


@dataclass(frozen=True, slots=True)
class NoView:
    """An image from which nothing is learnt.

    Attributes:
        name: Of the image.
        reason: Why, with the figure and the limit.
    """

    name: str
    reason: str


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
    half = np.clip(clear_px, *WINDOW_PX).astype(np.int64)
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
