"""Lays the landmark out on one sheet at true size: the pattern, and round it what a person needs to use it.

All that is not the pattern stands outside the quiet zone, in grey: a dashed hairline round the zone, an arrow to the
front, a ruler to check the print with, and name and sizes. A detector that sees the sheet sees the quiet zone white.
"""

from __future__ import annotations

from app.landmark import Landmark
from app.review.printing.page import BLACK, WHITE, Group, Item, Line, Page, Point, Polygon, Text

SIDE_MM = 10.0
"""White to the left and right of the quiet zone."""
FRONT_MM = 22.0
"""Band in front of the quiet zone, for the arrow."""
BACK_MM = 28.0
"""Band behind the quiet zone, for the ruler and the text."""
RULER_MM = 100.0
HAIRLINE_OFFSET_MM = 1.0


def lay_out(landmark: Landmark) -> Page:
    """The landmark on a sheet just big enough, forward up; the ruler lets no sheet be narrower than 126 mm."""
    zone = landmark.quiet_zone_m * 1000.0
    width = max(zone + 2 * SIDE_MM, RULER_MM + 26.0)
    height = zone + FRONT_MM + BACK_MM
    centre = (width / 2, BACK_MM + zone / 2)
    items = (
        *_zone_border(centre, zone / 2 + HAIRLINE_OFFSET_MM),
        *_pattern(landmark, centre),
        *_front_arrow((centre[0], centre[1] + zone / 2 + 4.0)),
        *ruler((centre[0] - RULER_MM / 2, 16.0)),
        Text((centre[0], 11.0), "Is this ruler 10 cm long? If not, print again at 100 %, not fitted to the page."),
        Text((centre[0], 5.0), caption(landmark)),
    )
    return Page(width, height, (Group(items),))


def caption(landmark: Landmark) -> str:
    """Name and sizes in a line."""
    return (
        f"{landmark.name}: side {landmark.size_m * 100:.4g} cm, quiet zone {landmark.quiet_zone_m * 100:.4g} cm, "
        f"code {landmark.code}"
    )


def ruler(left: Point) -> tuple[Item, ...]:
    """A 10 cm ruler to the right of a point: the centre lines of its outer ticks are 100 mm apart."""
    x, y = left
    ticks = tuple(
        Line((x + 10.0 * k, y), (x + 10.0 * k, y + (4.0 if k in (0, 5, 10) else 2.5)), width=0.15) for k in range(11)
    )
    return (
        Line((x, y), (x + RULER_MM, y), width=0.15),
        *ticks,
        Text((x + RULER_MM + 6.5, y), "10 cm", 2.8),
    )


def _pattern(landmark: Landmark, centre: Point) -> tuple[Item, ...]:
    """The contours, outermost first, each filled over its parent."""
    return tuple(
        Polygon(
            tuple((centre[0] + right * 1000.0, centre[1] + forward * 1000.0) for forward, right in contour.corners_m),
            BLACK if contour.black else WHITE,
        )
        for contour in landmark.contours
    )


def _zone_border(centre: Point, half: float) -> tuple[Item, ...]:
    x, y = centre
    corners = ((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half))
    return tuple(Line(corners[k], corners[(k + 1) % 4], width=0.15, grey=0.75, dash=2.0) for k in range(len(corners)))


def _front_arrow(foot: Point) -> tuple[Item, ...]:
    """An arrow forward with the word beside it, from its foot up."""
    x, y = foot
    return (
        Line((x, y), (x, y + 9.0), width=0.8),
        Polygon(((x - 3.0, y + 8.0), (x + 3.0, y + 8.0), (x, y + 14.0)), 0.45),
        Text((x + 14.0, y + 5.0), "FRONT", 5.0),
    )
