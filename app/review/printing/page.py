"""What a page is made of: shapes in millimetres from its lower left corner, x to the right and y up.

The layout makes pages; the writers turn them into PDF, SVG or PNG. Nothing here knows a file format or the landmark.
"""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float]
"""Millimetres right and up of the page's lower left corner."""
Box = tuple[float, float, float, float]
"""Left, bottom, right, top in millimetres."""

BLACK = 0.0
WHITE = 1.0


@dataclass(frozen=True, slots=True)
class Polygon:
    """A filled convex polygon.

    Attributes:
        points: Its corners.
        grey: 0 black to 1 white.
    """

    points: tuple[Point, ...]
    grey: float


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line.

    Attributes:
        start: One end.
        end: The other.
        width: Millimetres.
        grey: 0 black to 1 white.
        dash: Length of a dash and of the gap after it; 0 for a full line.
    """

    start: Point
    end: Point
    width: float = 0.2
    grey: float = 0.45
    dash: float = 0.0


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text, horizontal.

    Attributes:
        at: Middle of its baseline.
        words: ASCII.
        height: Font size in millimetres.
        grey: 0 black to 1 white.
    """

    at: Point
    words: str
    height: float = 3.0
    grey: float = 0.45


Item = Polygon | Line | Text


@dataclass(frozen=True, slots=True)
class Group:
    """Items that are scaled, then shifted, then cut to a box of the page.

    Attributes:
        items: In drawing order.
        shift: Added to every point after the scale.
        scale: 1 for true size.
        clip: Nothing is drawn outside of it; None for no limit.
    """

    items: tuple[Item, ...]
    shift: Point = (0.0, 0.0)
    scale: float = 1.0
    clip: Box | None = None

    def placed(self) -> tuple[Item, ...]:
        """The items in the page's own millimetres."""
        return tuple(_place(item, self.scale, self.shift) for item in self.items)


@dataclass(frozen=True, slots=True)
class Page:
    """One page.

    Attributes:
        width: Millimetres.
        height: Millimetres.
        groups: In drawing order, on white.
    """

    width: float
    height: float
    groups: tuple[Group, ...]


def _place(item: Item, scale: float, shift: Point) -> Item:
    def moved(point: Point) -> Point:
        return point[0] * scale + shift[0], point[1] * scale + shift[1]

    match item:
        case Polygon(points, grey):
            return Polygon(tuple(moved(point) for point in points), grey)
        case Line(start, end, width, grey, dash):
            return Line(moved(start), moved(end), width, grey, dash * scale)
        case Text(at, words, height, grey):
            return Text(moved(at), words, height * scale, grey)
