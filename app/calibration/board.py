"""The calibration board: what is drawn on it, and what is seen of it. It knows nothing of lenses.

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

from app.errors import ConfigError
from app.frames import Array

BoardKind = Literal["chessboard", "charuco"]
Indices: TypeAlias = NDArray[np.int64]

MARKER_PART = 0.72
"""Large markers are read from further away, but leave each corner some white."""
WINDOW_PART = 0.35
"""Half of the window in which a corner is refined, in distances to its nearest neighbour: it ends before that. On a
ChArUco board it ends before the markers."""


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
