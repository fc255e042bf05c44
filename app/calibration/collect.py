"""Frames in, views of a board out: what was seen so far, and what is still missing. For files and for a live camera."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from app.calibration.board import Board, NoView, View
from app.calibration.coverage import CELL_CORNERS, NEW_DISTANCE, Grid, features, lit_cells, sharp_enough
from app.calibration.finder import BoardFinder
from app.calibration.judgement import Verdict, coverage_checks
from app.frames import Array
from app.messages import Frame, Image

BRIGHTNESS_WIDTH_PX = 160
"""The brightest image is kept at this width: it only tells where the lens gives light."""
KEPT_FRAMES = 6
"""Frames without a board that are kept, to see what else they may show."""
LIVE_VIEWS = 25
"""Views after which a live session may end, if they cover the image."""


class Collector:
    """Looks for the board in one frame after the other.

    Args:
        board: What to look for.

    Attributes:
        views: Found.
        refused: Frames without a view, and why.
        size_px: Of the images; None before the first.
        looked_at: Frames.
        without: A few frames in which nothing was found.
    """

    def __init__(self, board: Board) -> None:
        self.board = board
        self.views: list[View] = []
        self.refused: list[NoView] = []
        self.size_px: tuple[int, int] | None = None
        self.looked_at = 0
        self.without: list[Image] = []
        self._finder = BoardFinder(board)
        self._brightest: Image | None = None
        self._features: list[Array] = []

    def look(self, frame: Frame) -> View | NoView:
        """Look at a frame, and keep what it says."""
        found = self._find(frame)
        if isinstance(found, View):
            self.views.append(found)
        else:
            self.refused.append(found)
        return found

    def look_live(self, frame: Frame) -> View | NoView:
        """The same, but keep a view only if it adds something to those that are kept, and is as sharp."""
        found = self._find(frame)
        if isinstance(found, NoView):
            return found
        _, blurred = sharp_enough([*self.views, found])
        if any(view.name == found.name for view in blurred):
            return blurred[-1]
        place = features(found)
        if any(float(np.linalg.norm(place - other)) < NEW_DISTANCE for other in self._features):
            return NoView(found.name, "adds nothing new")
        self.views.append(found)
        self._features.append(place)
        return found

    def _find(self, frame: Frame) -> View | NoView:
        self.looked_at += 1
        name = frame.name or f"frame {frame.sequence}"
        image = frame.image
        if image.ndim == 3:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        height, width = image.shape
        self.size_px = self.size_px or (width, height)
        if (width, height) != self.size_px:
            return NoView(
                frame.name, f"{width}x{height} pixels, the first image has {'x'.join(map(str, self.size_px))}"
            )
        small = cv2.resize(
            image,
            (BRIGHTNESS_WIDTH_PX, max(1, BRIGHTNESS_WIDTH_PX * height // width)),
            interpolation=cv2.INTER_AREA,
        )
        seen = np.asarray(small, dtype=np.uint8)
        self._brightest = seen if self._brightest is None else np.maximum(self._brightest, seen)
        found = self._finder.find(image, name)
        if isinstance(found, NoView) and len(self.without) < KEPT_FRAMES and self.looked_at % 7 == 1:
            self.without.append(image)
        return found

    # ------------------------------------------------------------------------------------------------------- coverage
    def grid(self) -> Grid:
        """The cells over the images; there must have been one."""
        assert self.size_px is not None
        return Grid.over(self.size_px)

    def lit(self) -> NDArray[np.bool_]:
        """(rows, columns) cells in which the lens gives light."""
        assert self._brightest is not None
        return lit_cells(self._brightest, self.grid())

    def counts(self, views: Sequence[View] | None = None) -> NDArray[np.int64]:
        """(rows, columns) corners in each cell, of these views or all."""
        chosen = self.views if views is None else views
        points = [view.px for view in chosen] or [np.zeros((0, 2))]
        return self.grid().counts(np.concatenate(points))

    def missing(self) -> list[str]:
        """What a live session still needs, as imperatives; empty when it may end."""
        checks = coverage_checks(self.counts() >= CELL_CORNERS, self.lit())
        wanted = [check.advice for check in checks if check.verdict is not Verdict.GOOD]
        if len(self.views) < LIVE_VIEWS:
            wanted.append(f"more views: {len(self.views)} of {LIVE_VIEWS}; tilt the board, bring it near and far")
        return wanted


def other_boards(board: Board, images: Sequence[Image]) -> str:
    """What board the images do show, in words that name the options, or "" if none is recognised."""
    if board.kind == "charuco":
        return _other_markers(board, images)
    columns, rows = board.columns, board.rows
    for c, r in (
        (columns + 1, rows + 1),
        (columns - 1, rows - 1),
        (columns + 1, rows),
        (columns, rows + 1),
        (columns - 1, rows),
        (columns, rows - 1),
    ):
        if min(c, r) < 4:
            continue
        finder = BoardFinder(Board("chessboard", c, r, board.square_m))
        if any(isinstance(finder.find(image, ""), View) for image in images):
            inner = ": squares are counted, not inner corners" if (c, r) == (columns + 1, rows + 1) else ""
            return f"a board of {c} x {r} squares is there: give --columns {c} --rows {r}{inner}"
    return ""


def _other_markers(board: Board, images: Sequence[Image]) -> str:
    """Which dictionary's markers the images show."""
    best, count = "", 3
    for name in ("4X4_50", "4X4_250", "5X5_100", "5X5_250", "6X6_250", "7X7_250", "APRILTAG_36H11"):
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
        detector = cv2.aruco.ArucoDetector(dictionary)
        found = max((len(detector.detectMarkers(image)[0]) for image in images), default=0)
        if found > count:
            best, count = f"DICT_{name}", found
    if not best:
        return ""
    if best.upper() == board.dictionary.upper() or best.upper() == f"DICT_{board.dictionary.upper()}":
        return "markers of that dictionary are there: see that --columns, --rows and --marker-mm are what was printed"
    return f"markers of {best} are there: give --dictionary {best}"
