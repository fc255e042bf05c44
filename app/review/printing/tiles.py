"""Cuts a sheet into printer pages that overlap, with crop marks and numbers, behind an overview of how they join.

The overview comes first. Pages count from the front left, row by row. On each page the marks in the margin show the
box that its part of the sheet fills; the dashed ones show where the neighbour's part begins, so the pages can be cut
along one edge and laid over the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.errors import LandmarkError
from app.review.printing.page import Box, Group, Item, Line, Page, Text
from app.review.printing.sheet import RULER_MM, ruler

PAPERS_MM: dict[str, tuple[float, float]] = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
"""Width and height of the papers upright (ISO 216, ANSI/ASME Y14.1)."""
MARGIN_MM = 14.0
"""White edge of a page: wider than what printers can't reach (about 6 mm), with room for the marks."""
OVERLAP_MM = 10.0
"""What two neighbouring pages both show: enough to glue."""
PAGES_MAX = 400


@dataclass(frozen=True, slots=True)
class Grid:
    """How many pages of which size cover a sheet.

    Attributes:
        columns: Pages across.
        rows: Pages along.
        width: Of a page, mm.
        height: Of a page, mm.
    """

    columns: int
    rows: int
    width: float
    height: float

    @property
    def step(self) -> tuple[float, float]:
        """From one page's part of the sheet to the next one's, mm."""
        return self.width - 2 * MARGIN_MM - OVERLAP_MM, self.height - 2 * MARGIN_MM - OVERLAP_MM


def tile(sheet: Page, paper: str, title: str) -> tuple[Page, ...]:
    """The pages that a sheet is printed on: one if it fits, else an overview and the grid's.

    Raises:
        LandmarkError: The paper is unknown, or there would be more than PAGES_MAX pages.
    """
    if paper not in PAPERS_MM:
        raise LandmarkError(f"--tile {paper}: unknown paper", f"give one of {', '.join(PAPERS_MM)}")
    short, long = PAPERS_MM[paper]
    for width, height in ((short, long), (long, short)):
        if sheet.width <= width + 1e-6 and sheet.height <= height + 1e-6:
            shift = ((width - sheet.width) / 2, (height - sheet.height) / 2)
            return (Page(width, height, (Group(_items(sheet), shift),)),)
    grid = min((_grid(sheet, short, long), _grid(sheet, long, short)), key=lambda g: g.columns * g.rows)
    count = grid.columns * grid.rows
    if count > PAGES_MAX:
        raise LandmarkError(
            f"--tile {paper}: a sheet of {sheet.width / 10:.0f} x {sheet.height / 10:.0f} cm takes {count} pages",
            f"use a larger paper (at most {PAGES_MAX} pages), or have it printed whole without --tile",
        )
    parts = [_part(sheet, grid, row, column, title) for row in range(grid.rows) for column in range(grid.columns)]
    return (_overview(sheet, grid, title), *parts)


def _items(sheet: Page) -> tuple[Item, ...]:
    return tuple(item for group in sheet.groups for item in group.items)


def _grid(sheet: Page, width: float, height: float) -> Grid:
    step = Grid(1, 1, width, height).step
    columns = max(1, math.ceil((sheet.width - OVERLAP_MM) / step[0] - 1e-9))
    rows = max(1, math.ceil((sheet.height - OVERLAP_MM) / step[1] - 1e-9))
    return Grid(columns, rows, width, height)


def _origin(sheet: Page, grid: Grid, row: int, column: int) -> tuple[float, float]:
    """The sheet's point at the lower left of a page's box; the sheet is centred on the grid, row 0 in front."""
    step_x, step_y = grid.step
    left = (sheet.width - (grid.columns * step_x + OVERLAP_MM)) / 2
    bottom = (sheet.height - (grid.rows * step_y + OVERLAP_MM)) / 2
    return left + column * step_x, bottom + (grid.rows - 1 - row) * step_y


def _part(sheet: Page, grid: Grid, row: int, column: int, title: str) -> Page:
    box = (MARGIN_MM, MARGIN_MM, grid.width - MARGIN_MM, grid.height - MARGIN_MM)
    x, y = _origin(sheet, grid, row, column)
    number = row * grid.columns + column + 1
    label = f"{title}  page {number} of {grid.rows * grid.columns}  (row {row + 1}, column {column + 1})"
    marks: list[Item] = [
        *_crop_marks(box),
        *_joints(box, grid, row, column),
        Text((grid.width / 2, grid.height - 6.5), label, 2.8),
        *ruler((grid.width / 2 - RULER_MM / 2, 7.0)),
    ]
    return Page(
        grid.width, grid.height, (Group(_items(sheet), (box[0] - x, box[1] - y), 1.0, box), Group(tuple(marks)))
    )


def _crop_marks(box: Box) -> tuple[Item, ...]:
    """Two short lines outside each corner of a box, along its edges."""
    left, bottom, right, top = box
    marks: list[Item] = []
    for x, outward_x in ((left, -1.0), (right, 1.0)):
        for y, outward_y in ((bottom, -1.0), (top, 1.0)):
            marks.append(Line((x + outward_x, y), (x + 7.0 * outward_x, y), grey=0.0))
            marks.append(Line((x, y + outward_y), (x, y + 7.0 * outward_y), grey=0.0))
    return tuple(marks)


def _joints(box: Box, grid: Grid, row: int, column: int) -> tuple[Item, ...]:
    """Dashed marks in the margin where a neighbouring page's box begins."""
    left, bottom, right, top = box
    xs = ([left + OVERLAP_MM] if column > 0 else []) + ([right - OVERLAP_MM] if column < grid.columns - 1 else [])
    ys = ([bottom + OVERLAP_MM] if row < grid.rows - 1 else []) + ([top - OVERLAP_MM] if row > 0 else [])
    marks: list[Item] = []
    for x in xs:
        marks += [
            Line((x, bottom - 1.0), (x, bottom - 5.0), dash=1.0),
            Line((x, top + 1.0), (x, top + 5.0), dash=1.0),
        ]
    for y in ys:
        marks += [
            Line((left - 1.0, y), (left - 5.0, y), dash=1.0),
            Line((right + 1.0, y), (right + 5.0, y), dash=1.0),
        ]
    return tuple(marks)


def _overview(sheet: Page, grid: Grid, title: str) -> Page:
    """The sheet, small, with the pages' boxes and numbers over it."""
    step_x, step_y = grid.step
    whole = (grid.columns * step_x + OVERLAP_MM, grid.rows * step_y + OVERLAP_MM)
    room = (grid.width - 2 * MARGIN_MM, grid.height - 2 * MARGIN_MM - 30.0)
    scale = min(room[0] / whole[0], room[1] / whole[1])
    first = _origin(sheet, grid, grid.rows - 1, 0)
    shift = (
        (grid.width - whole[0] * scale) / 2 - first[0] * scale,
        MARGIN_MM + (room[1] - whole[1] * scale) / 2 - first[1] * scale,
    )
    boxes: list[Item] = []
    for row in range(grid.rows):
        for column in range(grid.columns):
            x, y = _origin(sheet, grid, row, column)
            box = (x, y, x + step_x + OVERLAP_MM, y + step_y + OVERLAP_MM)
            boxes += _outline(box, scale)
            number = str(row * grid.columns + column + 1)
            boxes.append(Text(((box[0] + box[2]) / 2, (box[1] + box[3]) / 2), number, 9.0 / scale, 0.55))
    top = grid.height - MARGIN_MM
    words = (
        Text((grid.width / 2, top - 5.0), f"{title}: how the {grid.rows * grid.columns} pages join", 5.0, 0.0),
        Text((grid.width / 2, top - 12.0), "Print at 100 % (no fit to page) and check the 10 cm ruler on each page."),
        Text((grid.width / 2, top - 17.0), f"Neighbours overlap by {OVERLAP_MM:.0f} mm: cut one of them between its"),
        Text((grid.width / 2, top - 21.5), "corner marks, and lay it on the other up to the dashed marks."),
    )
    return Page(
        grid.width, grid.height, (Group(_items(sheet), shift, scale), Group(tuple(boxes), shift, scale), Group(words))
    )


def _outline(box: Box, scale: float) -> list[Item]:
    left, bottom, right, top = box
    corners = ((left, bottom), (right, bottom), (right, top), (left, top))
    return [Line(corners[k], corners[(k + 1) % 4], width=0.3, grey=0.55, dash=2.0 / scale) for k in range(len(corners))]
