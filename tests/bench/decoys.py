"""Prints that must not be taken for the paper's landmark: what they are and how they are drawn.

It owns the prints (reflectance and alpha, at a resolution above any camera's here) and, for each, the size from which
an image can tell it from the landmark at all. It knows no camera, no ground and no detector.

Print coordinates: x right, y down, in outer sides; the origin is the middle of the outermost shape.

What is *not* a decoy: the landmark at another size, turned as a whole (also its three inner contours by 90 degrees
within the squares, which is the whole turned, the squares being symmetric; a mirror image changes nothing either), or
with a part covered.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.landmark import paper_landmark

Plane = NDArray[np.float32]
Poly = NDArray[np.float64]
Shape = tuple[Poly, float]
"""Corners (n, 2) in print coordinates and the grey of the inside, 0 black to 1 white."""

PRINT_PX = 512
BLACK, WHITE = 0.06, 0.90
MARGIN = 46.0 / 38.0
"""Side of the white board over the outer side: the landmark's own quiet zone."""
VARIANTS = 10
"""Different prints of each kind; one is drawn once and kept."""


class Family(StrEnum):
    """How near a decoy comes to the landmark."""

    NEAR = "near"
    """Nests of squares and triangles; the landmark with something wrong in it."""
    INNERMOST = "innermost"
    """The landmark with its innermost square alone altered: a sixty-fourth of its area."""
    THING = "thing"
    """What lies about and is printed in the world."""
    ARGUABLE = "arguable"
    """A reader may call it the landmark with a part covered or faded: reported, but apart from the rest."""


@dataclass(frozen=True, slots=True)
class Print:
    """One decoy.

    Attributes:
        kind: Its name.
        family: How near it comes.
        levels: (n, n, 2) uint8, n from PRINT_PX down by halves: alpha times reflectance, and alpha, of 255.
        span: Side of the picture in outer sides.
        least_side_px: Outer side from which an image tells it from the landmark (see `least_side_px`).
    """

    kind: str
    family: Family
    levels: tuple[NDArray[np.uint8], ...]
    span: float
    least_side_px: float


@dataclass(frozen=True, slots=True)
class Drawing:
    """What a kind's function gives: shapes in painter's order on a board, or a picture.

    Attributes:
        shapes: Painted one over the other.
        board: Side of the board under them in outer sides; 0: no board, painted on the ground.
        board_grey: Its grey.
        picture: Instead of shapes: grey 0..1 of a square picture that spans `board` outer sides.
        alpha: With a picture: where it covers the ground; None: everywhere.
    """

    shapes: tuple[Shape, ...] = ()
    board: float = MARGIN
    board_grey: float = WHITE
    picture: Plane | None = None
    alpha: Plane | None = None


Maker = Callable[[np.random.Generator], Drawing]
KINDS: dict[str, tuple[Family, Maker]] = {}


def kind(name: str, family: Family) -> Callable[[Maker], Maker]:
    """Enter a maker under a name (decoy_nests.py and decoy_things.py do)."""

    def enter(maker: Maker) -> Maker:
        KINDS[name] = (family, maker)
        return maker

    return enter


# ------------------------------------------------------------------------------------------------------- polygons
def square(side: float, centre: tuple[float, float] = (0.0, 0.0)) -> Poly:
    """Axis aligned."""
    h = side / 2
    return np.asarray(np.array([[-h, -h], [h, -h], [h, h], [-h, h]]) + np.array(centre))


def triangle(side: float, centroid: tuple[float, float] = (0.0, 0.0)) -> Poly:
    """Equilateral, apex up."""
    r = side / math.sqrt(3.0)
    return np.asarray(np.array([[0.0, -r], [side / 2, r / 2], [-side / 2, r / 2]]) + np.array(centroid))


def regular(n: int, radius: float, centre: tuple[float, float] = (0.0, 0.0), turn_deg: float = 0.0) -> Poly:
    """A regular polygon by its circumradius; 96 corners make a disc."""
    a = np.arange(n) * (2 * math.pi / n) + math.radians(turn_deg)
    return np.asarray(np.column_stack([np.cos(a), np.sin(a)]) * radius + np.array(centre))


def disc(radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> Poly:
    """A circle."""
    return regular(96, radius, centre)


def turned(poly: Poly, deg: float, about: Poly | tuple[float, float] = (0.0, 0.0)) -> Poly:
    """Rotated about a point."""
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    middle = np.asarray(about, dtype=np.float64)
    result: Poly = (poly - middle) @ np.array([[c, s], [-s, c]]) + middle
    return result


def scaled(poly: Poly, factor: float, about: Poly | tuple[float, float] | None = None) -> Poly:
    """Scaled about a point, by default its corners' mean."""
    middle = poly.mean(axis=0) if about is None else np.asarray(about, dtype=np.float64)
    result: Poly = (poly - middle) * factor + middle
    return result


def landmark_polygons() -> list[Poly]:
    """S1, S2, T3, T4, S5 of the paper's landmark in print coordinates."""
    return [np.column_stack([c.corners_m[:, 1], -c.corners_m[:, 0]]) for c in paper_landmark(1.0).contours]


def nest(polygons: list[Poly], *, inverted: bool = False) -> tuple[Shape, ...]:
    """Black and white in turn, outermost first."""
    greys = (WHITE, BLACK) if inverted else (BLACK, WHITE)
    return tuple((poly, greys[k % 2]) for k, poly in enumerate(polygons))


# -------------------------------------------------------------------------------------------------------- drawing
def _fill(canvas: Plane, poly: Poly, grey: float, span: float) -> None:
    px = (poly / span + 0.5) * canvas.shape[0] - 0.5
    cv2.fillPoly(canvas, [np.round(px * 256).astype(np.int32)], grey, cv2.LINE_8, 8)


def render(drawing: Drawing, size: int = PRINT_PX) -> tuple[Plane, Plane, float]:
    """Reflectance, alpha (size, size) and the picture's side in outer sides; drawn at twice the size and averaged."""
    if drawing.picture is not None:
        grey = cv2.resize(drawing.picture, (size, size), interpolation=cv2.INTER_AREA)
        cover = np.ones_like(grey) if drawing.alpha is None else cv2.resize(drawing.alpha, (size, size))
        return np.asarray(grey, np.float32), np.asarray(cover, np.float32), drawing.board
    reach = 2.0 * max((float(np.abs(poly).max()) for poly, _ in drawing.shapes), default=0.5)
    span = max(drawing.board, reach) * 1.02
    canvas = np.full((2 * size, 2 * size), drawing.board_grey, np.float32)
    alpha = np.zeros_like(canvas)
    if drawing.board > 0:
        _fill(alpha, square(drawing.board), 1.0, span)
    for poly, shade in drawing.shapes:
        _fill(canvas, poly, shade, span)
        _fill(alpha, poly, 1.0, span)
    small = [np.asarray(cv2.resize(p, (size, size), interpolation=cv2.INTER_AREA), np.float32) for p in (canvas, alpha)]
    return small[0], small[1], span


def _seen(grey: Plane, span: float, side_px: float, scale: float) -> Plane:
    """A print on mid-grey ground as a camera sees it, side_px * scale to its outer side, in a picture of fixed size."""
    n = math.ceil(side_px * 1.25)
    inner = max(2, round(side_px * scale * span * 2.5))
    small = cv2.resize(
        grey, (inner, inner), interpolation=cv2.INTER_AREA if inner < grey.shape[0] else cv2.INTER_LINEAR
    )
    per = side_px * scale * span / inner
    small = cv2.GaussianBlur(small, (0, 0), OPTICS_PX / per)
    shift = (n - 1) / 2 - per * (inner - 1) / 2
    matrix = np.array([[per, 0.0, shift], [0.0, per, shift]])
    out = cv2.warpAffine(small, matrix, (n, n), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out, np.float32)


TELLING_PX = 9.0
"""Difference to the landmark, in pixels of full contrast, that an image must hold before it can be told."""
SIDES_PX = (8.0, 10.0, 12.0, 15.0, 18.0, 22.0, 27.0, 33.0, 40.0, 50.0, 62.0, 78.0, 98.0)
SCALES = (0.88, 0.94, 1.0, 1.06, 1.12)
OPTICS_PX = 0.75
"""Blur of a good lens and of the pixel's own area, one sigma."""
GROUND = 0.35


@lru_cache(maxsize=len(SIDES_PX))
def _landmark_seen(side_px: float) -> NDArray[np.float64]:
    """(20, n) the landmark in its four headings and five scales, each of mean 0 and length 1."""
    reflectance, alpha, span = render(Drawing(nest(landmark_polygons())))
    grey = alpha * reflectance + (1 - alpha) * np.float32(GROUND)
    seen = [_seen(np.rot90(grey, turn).copy(), span, side_px, scale) for turn in range(4) for scale in SCALES]
    rows = np.stack(seen).reshape(len(seen), -1).astype(np.float64)
    rows -= rows.mean(axis=1, keepdims=True)
    return np.asarray(rows)


def least_side_px(reflectance: Plane, alpha: Plane, span: float) -> float:
    """Outer side in pixels from which an image tells a print from the landmark.

    From this size the energy of the difference to the best-fitting landmark (four headings, scales within 12%, any gain
    and offset) is that of TELLING_PX pixels at full contrast. Below it the two are the same to a camera, so that a
    frame with it would be no negative. Infinite if no size here does.
    """
    grey = alpha * reflectance + (1 - alpha) * np.float32(GROUND)
    for side in SIDES_PX:
        seen = _seen(grey, span, side, 1.0).ravel().astype(np.float64)
        seen -= seen.mean()
        models = _landmark_seen(side)
        gain = np.maximum(0.0, models @ seen / np.sum(models**2, axis=1))
        left = np.sum((seen - gain[:, None] * models) ** 2, axis=1)
        if float(np.min(left / (np.maximum(gain, 0.3) * (WHITE - BLACK)) ** 2)) >= TELLING_PX:
            return side
    return math.inf


def _levels(reflectance: Plane, alpha: Plane) -> tuple[NDArray[np.uint8], ...]:
    level = np.dstack([reflectance * alpha, alpha]).astype(np.float32)
    levels = []
    while level.shape[0] > 10:
        levels.append(np.asarray(level * 255 + 0.5, np.uint8))
        n = level.shape[0] // 2
        level = np.asarray(cv2.resize(level, (n, n), interpolation=cv2.INTER_AREA), np.float32)
    return tuple(levels)


def the_landmark() -> Print:
    """The landmark itself, drawn in the same way: what a sequence shows before the decoy takes its place."""
    reflectance, alpha, span = render(Drawing(nest(landmark_polygons())))
    return Print("landmark", Family.NEAR, _levels(reflectance, alpha), span, 0.0)


@lru_cache(maxsize=1024)
def make_print(name: str, variant: int) -> Print:
    """One print of a kind; the same for the same variant.

    Raises:
        KeyError: There is no such kind.
    """
    family, maker = KINDS[name]
    source = np.random.default_rng((sum(map(ord, name)), len(name), variant))
    reflectance, alpha, span = render(maker(source))
    return Print(name, family, _levels(reflectance, alpha), span, least_side_px(reflectance, alpha, span))
