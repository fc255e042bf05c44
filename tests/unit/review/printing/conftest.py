"""Readers of what was drawn that share nothing with what drew it: PDF operators, SVG elements, PNG chunks."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pypdf
import pytest
from pypdf.generic import ContentStream

MM_PER_POINT = 25.4 / 72.0


@dataclass
class Drawn:
    """A page as read back, in millimetres from the lower left corner, y up."""

    width: float
    height: float
    polygons: list[tuple[float, np.ndarray]] = field(default_factory=list)
    """Grey level and corners."""
    lines: list[tuple[tuple[float, float], tuple[float, float]]] = field(default_factory=list)
    clips: list[tuple[float, float, float, float]] = field(default_factory=list)
    text: str = ""


def _read_pdf_page(page: pypdf.PageObject, reader: pypdf.PdfReader) -> Drawn:
    box = page.mediabox
    drawn = Drawn(float(box.width) * MM_PER_POINT, float(box.height) * MM_PER_POINT, text=page.extract_text())
    path: list[tuple[float, float]] = []
    grey, stack = 0.0, []
    for operands, operator in ContentStream(page.get_contents(), reader).operations:
        numbers = [float(value) * MM_PER_POINT for value in operands if isinstance(value, int | float)]
        match operator:
            case b"cm":
                assert [float(v) for v in operands] == [1, 0, 0, 1, 0, 0], "the page is not scaled"
            case b"q":
                stack.append(grey)
            case b"Q":
                grey = stack.pop()
            case b"g":
                grey = float(operands[0])
            case b"m" | b"l":
                path.append((numbers[0], numbers[1]))
            case b"re":
                path = [(numbers[0], numbers[1]), (numbers[0] + numbers[2], numbers[1] + numbers[3])]
            case b"W" | b"W*":
                drawn.clips.append((*path[0], *path[1]))
            case b"f" | b"f*":
                drawn.polygons.append((grey, np.array(path)))
            case b"S":
                drawn.lines.append((path[0], path[-1]))
        if operator in (b"f", b"f*", b"S", b"n"):
            path = []
    return drawn


@pytest.fixture
def read_pdf():
    def read(path: Path) -> list[Drawn]:
        reader = pypdf.PdfReader(path)
        return [_read_pdf_page(page, reader) for page in reader.pages]

    return read


@pytest.fixture
def read_svg():
    def read(path: Path) -> Drawn:
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
        width, height = (root.attrib[key] for key in ("width", "height"))
        assert root.attrib["viewBox"] == f"0 0 {width.removesuffix('mm')} {height.removesuffix('mm')}"
        drawn = Drawn(float(width.removesuffix("mm")), float(height.removesuffix("mm")))
        for node in root.iter("{http://www.w3.org/2000/svg}polygon"):
            corners = np.array([[float(v) for v in pair.split(",")] for pair in node.attrib["points"].split()])
            corners[:, 1] = drawn.height - corners[:, 1]
            drawn.polygons.append((int(node.attrib["fill"][1:3], 16) / 255, corners))
        for node in root.iter("{http://www.w3.org/2000/svg}line"):
            x1, y1, x2, y2 = (float(node.attrib[key]) for key in ("x1", "y1", "x2", "y2"))
            drawn.lines.append(((x1, drawn.height - y1), (x2, drawn.height - y2)))
        return drawn

    return read


@pytest.fixture
def read_png():
    def read(path: Path) -> tuple[np.ndarray, float]:
        """The grey image and its pixels per metre, from the pHYs chunk."""
        content = path.read_bytes()
        at = content.index(b"pHYs") + 4
        across, along, unit = struct.unpack(">IIB", content[at : at + 9])
        assert (across, unit) == (along, 1)
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
        return image, float(across)

    return read
