"""Pages as a PDF, one file for all, at true size; the viewer is asked not to scale when it prints."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from reportlab.pdfgen.canvas import Canvas

from app.errors import LandmarkError
from app.review.printing.page import Group, Line, Page, Polygon, Text

POINT_PER_MM = 72.0 / 25.4
SIDE_MAX_MM = 14400 / POINT_PER_MM
"""Largest page side that PDF readers take: 14400 points (PDF 32000-1, annex C.2)."""


def pdf_bytes(pages: Sequence[Page], title: str) -> bytes:
    """The file's content; the same for the same pages.

    Raises:
        LandmarkError: A page is larger than a PDF page can be.
    """
    largest_mm = max(max(page.width, page.height) for page in pages)
    if largest_mm > SIDE_MAX_MM:
        raise LandmarkError(
            f"a sheet of {largest_mm / 10:.0f} cm is larger than a PDF page can be ({SIDE_MAX_MM / 10:.0f} cm)",
            "cut it into pages with --tile a3, or write an .svg",
        )
    buffer = io.BytesIO()
    canvas: Any = Canvas(buffer, invariant=1)
    canvas.setTitle(title)
    canvas.setCreator("Alight")
    canvas.setViewerPreference("PrintScaling", "None")
    for page in pages:
        canvas.setPageSize((page.width * POINT_PER_MM, page.height * POINT_PER_MM))
        for group in page.groups:
            _draw_group(canvas, group)
        canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def _draw_group(canvas: Any, group: Group) -> None:
    canvas.saveState()
    if group.clip is not None:
        left, bottom, right, top = (value * POINT_PER_MM for value in group.clip)
        path = canvas.beginPath()
        path.rect(left, bottom, right - left, top - bottom)
        canvas.clipPath(path, stroke=0, fill=0)
    for item in group.placed():
        match item:
            case Polygon(points, grey):
                path = canvas.beginPath()
                path.moveTo(points[0][0] * POINT_PER_MM, points[0][1] * POINT_PER_MM)
                for x, y in points[1:]:
                    path.lineTo(x * POINT_PER_MM, y * POINT_PER_MM)
                path.close()
                canvas.setFillGray(grey)
                canvas.drawPath(path, stroke=0, fill=1)
            case Line(start, end, width, grey, dash):
                canvas.setStrokeGray(grey)
                canvas.setLineWidth(width * POINT_PER_MM)
                canvas.setDash([dash * POINT_PER_MM] if dash > 0 else [])
                canvas.line(*(value * POINT_PER_MM for value in (*start, *end)))
            case Text(at, words, height, grey):
                canvas.setFillGray(grey)
                canvas.setFont("Helvetica", height * POINT_PER_MM)
                canvas.drawCentredString(at[0] * POINT_PER_MM, at[1] * POINT_PER_MM, words)
    canvas.restoreState()
