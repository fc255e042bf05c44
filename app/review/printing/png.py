"""A page as a PNG that carries its resolution, so that it prints at true size.

A pixel is filled if its centre lies inside: an edge is off by half a pixel at most, 0.04 mm at 300 dpi.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from app.errors import LandmarkError
from app.review.printing.page import Group, Line, Page, Point, Polygon, Text

PIXELS_MAX = 500_000_000
"""Half a gigabyte of memory: 180 x 180 cm at 300 dpi."""

Grey = NDArray[np.uint8]


def png_bytes(page: Page, dpi: int) -> bytes:
    """The file's content.

    Raises:
        LandmarkError: It would have more than PIXELS_MAX pixels.
    """
    scale = dpi / 25.4
    width, height = round(page.width * scale), round(page.height * scale)
    if width * height > PIXELS_MAX:
        raise LandmarkError(
            f"a PNG of {page.width / 10:.0f} x {page.height / 10:.0f} cm at {dpi} dpi has {width} x {height} pixels",
            f"the limit is {PIXELS_MAX // 1_000_000} million: write a .pdf or .svg, or give fewer dots per inch",
        )
    image: Grey = np.full((height, width), 255, dtype=np.uint8)
    for group in page.groups:
        _draw_group(image, group, page.height, scale)
    buffer = io.BytesIO()
    Pillow.fromarray(image).save(buffer, format="PNG", dpi=(dpi, dpi))
    return buffer.getvalue()


def _draw_group(image: Grey, group: Group, page_height: float, scale: float) -> None:
    target = image if group.clip is None else image.copy()
    for item in group.placed():
        match item:
            case Polygon(points, grey):
                fill_convex(target, _pixels(points, page_height, scale), round(grey * 255))
            case Line():
                for quad in _strokes(item, 1.0 / scale):
                    fill_convex(target, _pixels(quad, page_height, scale), round(item.grey * 255))
            case Text():
                _write(target, item, page_height, scale)
    if group.clip is not None:
        left, bottom, right, top = group.clip
        (u0, v0), (u1, v1) = _pixels(((left, top), (right, bottom)), page_height, scale)
        window = np.s_[max(0, round(v0)) : round(v1), max(0, round(u0)) : round(u1)]
        image[window] = target[window]


def _pixels(points: tuple[Point, ...], page_height: float, scale: float) -> tuple[Point, ...]:
    """Points in pixel edges: (0, 0) is the upper left corner of the first pixel."""
    return tuple((x * scale, (page_height - y) * scale) for x, y in points)


def fill_convex(image: Grey, corners: tuple[Point, ...], value: int) -> None:
    """Set the pixels whose centres lie in a convex polygon; corners in pixel edges, either way round."""
    vs = [v for _, v in corners]
    for row in range(max(0, math.ceil(min(vs) - 0.5)), min(image.shape[0], math.ceil(max(vs) - 0.5))):
        crossings = list(_crossings(corners, row + 0.5))
        if crossings:
            first = max(0, math.ceil(min(crossings) - 0.5))
            image[row, first : max(first, math.ceil(max(crossings) - 0.5))] = value


def _crossings(corners: tuple[Point, ...], v: float) -> Iterator[float]:
    """Where the outline crosses a row."""
    for (u0, v0), (u1, v1) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (v0 <= v) != (v1 <= v):
            yield u0 + (v - v0) / (v1 - v0) * (u1 - u0)


def _strokes(line: Line, thinnest: float) -> Iterator[tuple[Point, ...]]:
    """A line's dashes as rectangles, none thinner than a pixel, in mm."""
    (x0, y0), (x1, y1) = line.start, line.end
    length = math.hypot(x1 - x0, y1 - y0)
    along = ((x1 - x0) / length, (y1 - y0) / length)
    half = max(line.width, thinnest) / 2
    dash = line.dash if line.dash > 0 else length
    for k in range(math.ceil(length / (2 * dash) - 1e-9)):
        start, end = 2 * k * dash, min(length, (2 * k + 1) * dash)
        yield tuple(
            (x0 + along[0] * s - along[1] * t, y0 + along[1] * s + along[0] * t)
            for s, t in ((start, half), (end, half), (end, -half), (start, -half))
        )


def _write(image: Grey, text: Text, page_height: float, scale: float) -> None:
    """Draw a text on the strip of the image that it needs."""
    ((u, v),) = _pixels((text.at,), page_height, scale)
    size = max(1.0, text.height * scale)
    first, last = max(0, math.floor(v - 1.5 * size)), min(image.shape[0], math.ceil(v + size))
    if first >= last:
        return
    strip = Pillow.fromarray(image[first:last])
    font = ImageFont.load_default(size)
    ImageDraw.Draw(strip).text((u, v - first), text.words, fill=round(text.grey * 255), font=font, anchor="ms")
    image[first:last] = np.asarray(strip)
