"""Draws a calibration board at true size: chessboard or ChArUco, on a sheet just big enough or on a paper."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from app.calibration.board import Board, charuco_board, predefined
from app.errors import LandmarkError
from app.frames import Array
from app.review.printing.draw import write_pages
from app.review.printing.page import BLACK, WHITE, Group, Item, Page, Polygon, Text
from app.review.printing.sheet import RULER_MM, ruler
from app.review.printing.tiles import PAPERS_MM

MARGIN_MM = 10.0
"""White round the board, at least; finders want about half a square."""
FOOT_MM = 22.0
"""Band below the board, for ruler and text."""


def draw_board(board: Board, out: Path, paper: str | None = None) -> list[Path]:
    """Draw a board to a .pdf, .svg or .png file.

    Args:
        board: What to draw.
        out: The file.
        paper: "a4", "a3" or "letter", upright or across; None for a sheet just big enough.

    Returns:
        The file that was written.

    Raises:
        LandmarkError: It doesn't fit on the paper, or the file can't be written.
    """
    return write_pages((_page(board, paper),), out, str(board))


def _page(board: Board, paper: str | None) -> Page:
    square = board.square_m * 1000.0
    width, height = board.columns * square, board.rows * square
    margin = max(MARGIN_MM, 0.5 * square)
    # The white round the board may shrink to the smaller margin on a paper, not on a sheet of its own.
    sheet = max(width + 2 * margin, RULER_MM + 26.0), height + 2 * margin + FOOT_MM
    if paper is not None:
        needed = width + 2 * MARGIN_MM, height + MARGIN_MM + FOOT_MM
        short, long = PAPERS_MM[paper]
        fitting = [p for p in ((short, long), (long, short)) if needed[0] <= p[0] and needed[1] <= p[1]]
        if not fitting:
            raise LandmarkError(
                f"a board of {width:.0f} x {height:.0f} mm with its margins does not fit on {paper}",
                "give fewer or smaller squares, or a larger --paper",
            )
        sheet = fitting[0]
    left = (sheet[0] - width) / 2
    # In the middle where the foot leaves it; else as far above the foot as the upper margin allows.
    bottom = max((sheet[1] - height) / 2, min(FOOT_MM + margin, sheet[1] - height - MARGIN_MM))
    items: list[Item] = [
        *_pattern(board, left, bottom + height),
        *ruler((sheet[0] / 2 - RULER_MM / 2, 12.0)),
        Text((sheet[0] / 2, 8.0), "Is this ruler 10 cm long? If not, print again at 100 %, not fitted to the page."),
        Text((sheet[0] / 2, 4.0), str(board), 2.6),
    ]
    return Page(*sheet, (Group(tuple(items)),))


def _pattern(board: Board, left: float, top: float) -> Iterator[Item]:
    """Black squares, and markers in the white ones; the board's x is to the right and its y down."""

    def box(x0: float, y0: float, x1: float, y1: float, grey: float) -> Polygon:
        corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        return Polygon(tuple((left + 1000.0 * x, top - 1000.0 * y) for x, y in corners), grey)

    side = board.square_m
    for row in range(board.rows):
        for column in range(row % 2, board.columns, 2):
            yield box(column * side, row * side, (column + 1) * side, (row + 1) * side, BLACK)
    if board.kind == "chessboard":
        return
    made = charuco_board(board)
    size = predefined(board.dictionary).markerSize + 2
    for corners, number in zip(made.getObjPoints(), np.ravel(made.getIds()), strict=True):
        x0, y0 = (float(v) for v in np.asarray(corners, dtype=np.float64).min(axis=0)[:2])
        cell = board.marker_m / size
        yield box(x0, y0, x0 + board.marker_m, y0 + board.marker_m, BLACK)
        # White cells side by side in one piece: no hairlines between them.
        for k, bits in enumerate(_bits(board, int(number), size)):
            edges = np.flatnonzero(np.diff(np.concatenate([[0.0], bits, [0.0]])))
            for a, b in zip(edges[::2], edges[1::2], strict=True):
                yield box(x0 + a * cell, y0 + k * cell, x0 + b * cell, y0 + (k + 1) * cell, WHITE)


def _bits(board: Board, number: int, size: int) -> Array:
    """(size, size) of a marker with its black border: 1 for white."""
    drawn = predefined(board.dictionary).generateImageMarker(number, size, borderBits=1)
    return (np.asarray(drawn) > 127).astype(np.float64)
