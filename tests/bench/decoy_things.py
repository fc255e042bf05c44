"""Decoys that lie about in the world: helipads, tags, signs, road markings, windows, boards, targets.

It owns their shapes; what a decoy is and how it is drawn is in decoys.py.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from decoys import (
    BLACK,
    MARGIN,
    PRINT_PX,
    WHITE,
    Drawing,
    Family,
    Plane,
    Poly,
    Shape,
    disc,
    kind,
    nest,
    regular,
    scaled,
    square,
    triangle,
    turned,
)


def box(left: float, top: float, right: float, bottom: float) -> Poly:
    """An upright rectangle."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _letter_h(height: float, grey: float) -> tuple[Shape, ...]:
    w, t = 0.33 * height, 0.16 * height
    bars = [box(-w, -height / 2, -w + t, height / 2), box(w - t, -height / 2, w, height / 2), box(-w, -t / 2, w, t / 2)]
    return tuple((bar, grey) for bar in bars)


def _cross(length: float, thick: float, grey: float, turn_deg: float = 0.0) -> tuple[Shape, ...]:
    bars = (box(-length / 2, -thick / 2, length / 2, thick / 2), box(-thick / 2, -length / 2, thick / 2, length / 2))
    return tuple((turned(bar, turn_deg), grey) for bar in bars)


def _text(words: list[str], *, frame: bool, dark: bool) -> Plane:
    """Lines of lettering on a square, grey 0..1."""
    paper, ink = (BLACK, WHITE) if dark else (WHITE, BLACK)
    canvas: Plane = np.full((PRINT_PX, PRINT_PX), paper, np.float32)
    step = PRINT_PX / (len(words) + 1)
    for k, word in enumerate(words):
        (width, height), _ = cv2.getTextSize(word, cv2.FONT_HERSHEY_DUPLEX, 1.0, 1)
        size = min(0.8 * PRINT_PX / width, 0.55 * step / height)
        at = (int(PRINT_PX / 2 - width * size / 2), int(step * (k + 1) + height * size / 2))
        layer = np.zeros((PRINT_PX, PRINT_PX), np.uint8)
        cv2.putText(layer, word, at, cv2.FONT_HERSHEY_DUPLEX, size, (255,), max(1, round(3 * size)), cv2.LINE_AA)
        canvas += (ink - canvas) * (layer.astype(np.float32) / 255)
    if frame:
        cv2.rectangle(canvas, (20, 20), (PRINT_PX - 20, PRINT_PX - 20), ink, 22)
    return canvas


# ------------------------------------------------------------------------------------------------ landing targets
@kind("helipad-circle", Family.THING)
def _helipad_circle(source: np.random.Generator) -> Drawing:
    ring = (disc(0.5), WHITE), (disc(float(source.uniform(0.40, 0.45))), 0.25)
    return Drawing((*ring, *_letter_h(0.5, WHITE)), board=float(source.choice([0.0, 1.2])), board_grey=0.25)


@kind("helipad-square", Family.THING)
def _helipad_square(source: np.random.Generator) -> Drawing:
    dark = bool(source.random() < 0.5)
    rim, field = (BLACK, WHITE) if dark else (WHITE, 0.2)
    shapes = (square(1.0), rim), (square(float(source.uniform(0.65, 0.9))), field), *_letter_h(0.45, rim)
    return Drawing(shapes, board=MARGIN if dark else 0.0)


@kind("helipad-triangle", Family.THING)
def _helipad_triangle(source: np.random.Generator) -> Drawing:
    outer = triangle(1.1, (0.0, 0.1))
    inner = scaled(outer, 0.8)
    letter = tuple((p + np.array([0.0, 0.12]), g) for p, g in _letter_h(0.3, BLACK))
    return Drawing(((square(1.2), WHITE), (outer, BLACK), (inner, WHITE), *letter), board=1.3)


@kind("hospital-pad", Family.THING)
def _hospital_pad(source: np.random.Generator) -> Drawing:
    red = 0.3
    return Drawing(((square(1.0), red), *_cross(0.9, 0.3, WHITE), *_letter_h(0.26, red)), board=0.0)


@kind("landing-pad-v", Family.THING)
def _landing_pad_v(source: np.random.Generator) -> Drawing:
    """A square in a ring in a square, with a triangle as an arrow: other drones' landing pads."""
    shapes = (square(1.0), BLACK), (disc(0.46), WHITE), (disc(0.4), BLACK)
    inner = triangle(float(source.uniform(0.3, 0.6))), WHITE
    return Drawing((*shapes, inner, (square(0.12), BLACK)))


@kind("bullseye", Family.THING)
def _bullseye(source: np.random.Generator) -> Drawing:
    count = int(source.integers(2, 6))
    rings = [disc(0.5 * (1 - k / count)) for k in range(count)]
    return Drawing(nest(([square(1.0)] if source.random() < 0.3 else []) + rings))


@kind("cross", Family.THING)
def _plus(source: np.random.Generator) -> Drawing:
    thick = float(source.uniform(0.1, 0.35))
    return Drawing(_cross(1.0, thick, BLACK, float(source.choice([0.0, 45.0]))))


@kind("cross-in-square", Family.THING)
def _cross_in_square(source: np.random.Generator) -> Drawing:
    turn = float(source.choice([0.0, 45.0]))
    return Drawing((*nest([square(1.0), square(0.7)]), *_cross(0.5, 0.14, BLACK, turn)))


@kind("checker-target", Family.THING)
def _checker_target(source: np.random.Generator) -> Drawing:
    """A surveyor's target: two black quarters, of a disc or a square."""
    quarters = (box(-0.5, -0.5, 0, 0), BLACK), (box(0, 0, 0.5, 0.5), BLACK)
    if source.random() < 0.5:
        return Drawing(((square(1.0), WHITE), *quarters))
    return Drawing(((disc(0.5), BLACK), (disc(0.42), WHITE), *((p * 0.55, g) for p, g in quarters)))


# ----------------------------------------------------------------------------------------------------------- tags
FAMILIES = {
    "aruco-4x4": cv2.aruco.DICT_4X4_250,
    "aruco-5x5": cv2.aruco.DICT_5X5_250,
    "aruco-6x6": cv2.aruco.DICT_6X6_250,
    "aruco-7x7": cv2.aruco.DICT_7X7_250,
    "aruco-original": cv2.aruco.DICT_ARUCO_ORIGINAL,
    "aruco-mip-36h12": cv2.aruco.DICT_ARUCO_MIP_36H12,
    "apriltag-16h5": cv2.aruco.DICT_APRILTAG_16H5,
    "apriltag-25h9": cv2.aruco.DICT_APRILTAG_25H9,
    "apriltag-36h10": cv2.aruco.DICT_APRILTAG_36H10,
    "apriltag-36h11": cv2.aruco.DICT_APRILTAG_36H11,
}


def _modules(cells: Plane, margin: int) -> Plane:
    """A grid of cells (1: white) with a white margin, at the print's resolution, in the print's greys."""
    framed = np.pad(cells, margin, constant_values=1.0)
    big = cv2.resize(framed, (PRINT_PX, PRINT_PX), interpolation=cv2.INTER_NEAREST)
    return np.asarray(BLACK + (WHITE - BLACK) * big, np.float32)


def _tag(source: np.random.Generator, family: int) -> Drawing:
    dictionary = cv2.aruco.getPredefinedDictionary(family)
    count = dictionary.markerSize + 2
    ids = min(len(dictionary.bytesList), 30)
    cells = cv2.aruco.generateImageMarker(dictionary, int(source.integers(ids)), count) > 127
    return Drawing(picture=_modules(cells.astype(np.float32), 1), board=(count + 2) / count)


for _name, _family in FAMILIES.items():
    kind(_name, Family.THING)(lambda source, family=_family: _tag(source, family))  # type: ignore[misc]  # mypy can't infer the default argument


@kind("nested-tag", Family.THING)
def _nested_tag(source: np.random.Generator) -> Drawing:
    """A tag with another in its middle, as fractal markers are built."""
    cells = source.integers(0, 2, (10, 10)).astype(np.float32)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    cells[3:7, 3:7] = 1
    fine = np.kron(cells, np.ones((6, 6), np.float32))
    inner = source.integers(0, 2, (18, 18)).astype(np.float32)
    inner[[0, 1, -1, -2], :] = inner[:, [0, 1, -1, -2]] = 0
    inner[6:12, 6:12] = 1
    inner[8:10, 8:10] = 0
    fine[21:39, 21:39] = inner
    return Drawing(picture=_modules(fine, 6), board=1.2)


@kind("qr-code", Family.THING)
def _qr_code(source: np.random.Generator) -> Drawing:
    words = "https://" + "".join(source.choice(list("abcdefghij0123456789/."), int(source.integers(4, 60))))
    code = cv2.QRCodeEncoder.create().encode(words) > 127
    rows = np.flatnonzero(~code.all(axis=1))
    inner = code[rows[0] : rows[-1] + 1, rows[0] : rows[-1] + 1]
    return Drawing(picture=_modules(inner.astype(np.float32), 3), board=(inner.shape[0] + 6) / inner.shape[0])


@kind("data-matrix", Family.THING)
def _data_matrix(source: np.random.Generator) -> Drawing:
    n = int(source.choice([10, 14, 20]))
    cells = source.integers(0, 2, (n, n)).astype(np.float32)
    cells[:, 0], cells[-1, :] = 0, 0
    cells[0, :], cells[:, -1] = np.arange(n) % 2, np.arange(n)[::-1] % 2
    return Drawing(picture=_modules(cells, 2), board=(n + 4) / n)


@kind("chessboard", Family.THING)
def _chessboard(source: np.random.Generator) -> Drawing:
    n = int(source.integers(3, 10))
    cells = np.indices((n, n)).sum(axis=0) % 2
    return Drawing(picture=_modules(cells.astype(np.float32), 1), board=(n + 2) / n)


@kind("charuco", Family.THING)
def _charuco(source: np.random.Generator) -> Drawing:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((5, 5), 1.0, 0.7, dictionary)
    picture = board.generateImage((PRINT_PX, PRINT_PX), marginSize=40)
    return Drawing(picture=np.asarray(BLACK + (WHITE - BLACK) * picture / 255.0, np.float32), board=1.14)


# ------------------------------------------------------------------------------------------------ roads and signs
@kind("arrow", Family.THING)
def _arrow(source: np.random.Generator) -> Drawing:
    head = triangle(0.7, (0.0, -0.1))
    shaft = box(-0.12, 0.0, 0.12, 0.5)
    if source.random() < 0.5:
        return Drawing(((head, WHITE), (shaft, WHITE)), board=0.0)
    return Drawing(((square(1.0), BLACK), (scaled(head, 0.8), WHITE), (shaft * 0.8, WHITE)))


@kind("road-marking", Family.THING)
def _road_marking(source: np.random.Generator) -> Drawing:
    which = int(source.integers(5))
    if which == 0:  # zebra
        shapes = tuple((box(-0.5, -0.5 + k * 0.2, 0.5, -0.4 + k * 0.2), WHITE) for k in range(5))
    elif which == 1:  # parking bays
        shapes = ((square(1.0), WHITE), (box(-0.45, -0.45, -0.02, 0.5), 0.2), (box(0.02, -0.45, 0.45, 0.5), 0.2))
    elif which == 2:  # give way: a row of triangles
        shapes = tuple((triangle(0.18, (-0.4 + 0.2 * k, 0.0)), WHITE) for k in range(5))
    elif which == 3:  # give-way triangle
        outer = turned(triangle(1.0), 180)
        shapes = ((outer, WHITE), (scaled(outer, 0.7), 0.2))
    else:  # box junction
        lines = [turned(box(-0.5, d - 0.02, 0.5, d + 0.02), 45) for d in np.linspace(-0.3, 0.3, 4)]
        shapes = ((square(1.0), WHITE), (square(0.92), 0.2), *((p, WHITE) for p in lines))
    return Drawing(shapes, board=0.0)


@kind("warning-sign", Family.THING)
def _warning_sign(source: np.random.Generator) -> Drawing:
    """A warning triangle with an exclamation mark, often on a square or in a frame."""
    outer = triangle(0.95, (0.0, 0.1))
    inside = ((scaled(outer, 0.72), WHITE), (box(-0.04, -0.12, 0.04, 0.12), BLACK), (disc(0.045, (0.0, 0.2)), BLACK))
    sign = ((outer, BLACK), *inside)
    if source.random() < 0.5:
        return Drawing(((square(1.0), BLACK), (square(0.92), WHITE), *((p * 0.8, g) for p, g in sign)))
    return Drawing(sign, board=float(source.choice([0.0, 1.15])))


@kind("logo", Family.THING)
def _logo(source: np.random.Generator) -> Drawing:
    """Triangles and squares in squares, as companies draw them."""
    which = int(source.integers(5))
    tri = triangle(0.5, (0.0, 0.05))
    if which == 0:  # play button
        return Drawing(nest([square(1.0), turned(tri, 90, (0.0, 0.05))]))
    if which == 1:  # eye in a triangle
        return Drawing(
            nest([square(1.0), triangle(0.95, (0.0, 0.1)), triangle(0.7, (0.0, 0.1)), disc(0.09, (0.0, 0.1))])
        )
    if which == 2:  # four triangles in a frame
        points = tuple((triangle(0.26, (x, y)), BLACK) for x in (-0.17, 0.17) for y in (-0.13, 0.19))
        return Drawing((*nest([square(1.0), square(0.75)]), *points))
    if which == 3:  # triangle with a triangular hole upside down
        return Drawing(
            (
                *nest([square(1.0), square(0.8)]),
                (triangle(0.66, (0.0, 0.08)), BLACK),
                (turned(triangle(0.33), 180) + np.array([0.0, 0.08]), WHITE),
            )
        )
    stack = [square(0.3, (-0.2, 0.2)), square(0.3, (0.2, 0.2)), triangle(0.36, (0.0, -0.2))]
    return Drawing((*nest([square(1.0), square(0.84)]), *((p, BLACK) for p in stack)))


@kind("text-sign", Family.THING)
def _text_sign(source: np.random.Generator) -> Drawing:
    words = list(source.choice(["EXIT", "NO", "PARKING", "A4", "DANGER", "24", "H", "KEEP CLEAR", "TAXI", "07"], 3))
    lines = [str(w) for w in words[: int(source.integers(1, 4))]]
    picture = _text(lines, frame=bool(source.random() < 0.6), dark=bool(source.random() < 0.5))
    return Drawing(picture=picture, board=1.0)


@kind("page-of-print", Family.THING)
def _page(source: np.random.Generator) -> Drawing:
    canvas: Plane = np.full((PRINT_PX, PRINT_PX), WHITE, np.float32)
    for y in range(40, PRINT_PX - 40, 24):
        x = 40
        while x < PRINT_PX - 60:
            width = int(source.integers(10, 60))
            cv2.rectangle(canvas, (x, y), (min(x + width, PRINT_PX - 40), y + 11), 0.2, -1)
            x += width + 9
    at = source.integers(60, PRINT_PX - 260, 2)
    cv2.rectangle(canvas, (int(at[0]), int(at[1])), (int(at[0]) + 200, int(at[1]) + 200), BLACK, -1)
    cv2.rectangle(canvas, (int(at[0]) + 25, int(at[1]) + 25), (int(at[0]) + 175, int(at[1]) + 175), 0.7, -1)
    return Drawing(picture=canvas, board=1.0)


# ---------------------------------------------------------------------------------------------------- built things
@kind("windows", Family.THING)
def _windows(source: np.random.Generator) -> Drawing:
    n = int(source.integers(2, 5))
    shapes: list[Shape] = [(square(1.0), float(source.uniform(0.4, 0.8)))]
    for i in range(n):
        for j in range(n):
            at = (-0.5 + (i + 0.5) / n, -0.5 + (j + 0.5) / n)
            shapes += [(square(0.72 / n, at), WHITE), (square(0.6 / n, at), BLACK)]
            if source.random() < 0.4:
                shapes.append((square(0.3 / n, at), 0.6))
    return Drawing(tuple(shapes), board=1.0)


@kind("grate", Family.THING)
def _grate(source: np.random.Generator) -> Drawing:
    n = int(source.integers(3, 8))
    shapes: list[Shape] = [(square(1.0), 0.35), (square(0.94), 0.5)]
    shapes += [(box(-0.4, -0.42 + k * 0.84 / n, 0.4, -0.42 + (k + 0.6) * 0.84 / n), BLACK) for k in range(n)]
    return Drawing(tuple(shapes), board=0.0)


@kind("manhole", Family.THING)
def _manhole(source: np.random.Generator) -> Drawing:
    frame: tuple[Shape, ...] = ((square(1.0), 0.3), (square(0.9), 0.5)) if source.random() < 0.5 else ()
    lid: tuple[Shape, ...] = ((disc(0.42), BLACK), (disc(0.38), 0.4))
    studs = tuple((square(0.04, (0.25 * math.cos(a), 0.25 * math.sin(a))), BLACK) for a in np.arange(8) * math.pi / 4)
    return Drawing((*frame, *lid, *studs, (square(0.1), BLACK)), board=0.0)


@kind("crate", Family.THING)
def _crate(source: np.random.Generator) -> Drawing:
    rim, plank = 0.2, 0.55
    shapes: list[Shape] = [(square(1.0), rim), (square(0.8), plank)]
    if source.random() < 0.6:
        shapes += [(turned(box(-0.53, -0.05, 0.53, 0.05), 45), rim)]
    shapes.append((square(float(source.uniform(0.15, 0.3))), BLACK))
    return Drawing(tuple(shapes), board=0.0)


@kind("solar-panel", Family.THING)
def _solar_panel(source: np.random.Generator) -> Drawing:
    n = int(source.integers(3, 7))
    cells = [
        (box(-0.47 + i * 0.94 / n, -0.47 + j * 0.94 / n, -0.48 + (i + 1) * 0.94 / n, -0.48 + (j + 1) * 0.94 / n), BLACK)
        for i in range(n)
        for j in range(n)
    ]
    return Drawing(((square(1.0), 0.7), *cells), board=0.0)


@kind("picture-frame", Family.THING)
def _picture_frame(source: np.random.Generator) -> Drawing:
    """A black frame with a mount round a picture of nothing in particular: windows and screens look so too."""
    picture = cv2.GaussianBlur(source.standard_normal((PRINT_PX, PRINT_PX)).astype(np.float32), (0, 0), 22)
    picture = np.clip(0.45 + 0.25 * picture / picture.std(), BLACK, WHITE)
    frame: Plane = np.full((PRINT_PX, PRINT_PX), WHITE, np.float32)
    for side, inside in ((0.84, BLACK), (0.84 * math.sqrt(0.5), WHITE), (float(source.uniform(0.4, 0.52)), picture)):
        edge = round(PRINT_PX * (1 - side) / 2)
        middle = slice(edge, PRINT_PX - edge)
        frame[middle, middle] = inside if isinstance(inside, float) else inside[middle, middle]
    return Drawing(picture=frame, board=1.19)


@kind("confetti", Family.THING)
def _confetti(source: np.random.Generator) -> Drawing:
    """Many small nests of squares and triangles at random: a chance of everything but the landmark."""
    shapes: list[Shape] = []
    for _ in range(int(source.integers(15, 60))):
        at = source.uniform(-0.45, 0.45, 2)
        size, turn = float(source.uniform(0.04, 0.22)), float(source.uniform(0, 360))
        for k in range(int(source.integers(1, 5))):
            poly = square(size * 0.7**k) if source.random() < 0.6 else triangle(size * 0.75**k)
            shapes.append((turned(poly, turn) + at, BLACK if k % 2 == 0 else WHITE))
    return Drawing(tuple(shapes), board=1.0)


@kind("polygon-ring", Family.THING)
def _polygon_ring(source: np.random.Generator) -> Drawing:
    """A stop sign's octagon, hexagons, pentagons, stars."""
    n = int(source.choice([5, 6, 8]))
    outer = regular(n, 0.54, turn_deg=180 / n)
    star = np.vstack(
        [np.stack([regular(5, 0.3, turn_deg=-90)[k], regular(5, 0.12, turn_deg=-54)[k]]) for k in range(5)]
    )
    return Drawing(((outer, BLACK), (scaled(outer, 0.8), WHITE), (star, BLACK)))
