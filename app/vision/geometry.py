"""What the detector works out once from a landmark's drawing: corners, points along its sides, widths between contours,
and the drawing as a picture to correlate with. Everything that depends on a pad's shapes and ratios is read here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Contour, Landmark, Shape, gaps_m

SAMPLES_PER_SIDE = 10
SLANTED = 0.1
"""Sine of the angle to either axis from which a side counts as slanted."""
SIDE_MARGIN = 0.09
"""Part of a side at each end that is not looked at: corners are rounded by blur."""
PATCH = 32
"""Cells along the rectified patch."""
NODES = 9
"""Points along the patch that go through the lens; between them pixels are interpolated. For a landmark of 60 px that
is wrong by less than a hundredth of a pixel."""
PATCH_EXTENT = 1.3
"""Its side, in sides of the outermost contour: the quiet zone shows, and a little of what lies round it."""
INSIDE_TURNED_RAD = math.radians(20.0)
"""A rival has all inside the second contour turned by so much."""
JUDGED_EXTENT = 1.12
"""The middle part of it that is correlated: what lies beyond may be anything."""
SURROUND = 8.0
"""What lies round the quiet zone (grass) varies by this many times the noise on the landmark."""
BLOB_GRID = PATCH // 2
"""Samples along the patch of which small landmarks are told at a first glance."""
WINDOW = 5
"""Cells along the window in which a place is compared."""
SHOWS = 0.1
"""Standard deviation of a drawing in a window, black 0 and white 1, from which it tells something."""
LIKE = 0.65
"""Squared correlation in a window that counts as agreement."""
PSF_SIGMA_PX = 0.75
"""Blur of a sharp lens and of the pixel's own area."""
BLUR_SIGMA_PX2 = 1.5
"""How much more variance of blur, in squared pixels, is expected along each direction."""
GRADIENT_SIGMA = 0.3
"""Gradient of the light over half a patch, as a part of the contrast."""
TONE_SIGMA = 0.4
"""Bend of the tone curve between black and white, as a part of the contrast."""
NOISE_PART = 0.1
"""Noise on a pixel, as a part of the contrast, against which these expectations weigh."""
BLURS_PER_OCTAVE = 4.0
RIVALS_KEPT = 6
"""Blurs whose rivals are kept, oldest out first: each is 12 MB, and a flight runs through twenty of them."""
FINE = 4
"""Points along a cell when the drawing is made."""


class Template:
    """The drawing on the cells of the rectified patch, blurred.

    Attributes:
        white: (PATCH, PATCH) how much of each cell is white print, 0 black to 1.
        outside: (PATCH, PATCH) how much of it lies outside the quiet zone.
        sigma_cells: Its blur.
    """

    def __init__(self, drawings: Array, sigma_cells: float) -> None:
        self.white, self.outside = drawings
        self.sigma_cells = sigma_cells
        self._slopes: tuple[Array, Array] | None = None
        self._kept: tuple[NDArray[np.intp], Array, Array] | None = None

    @cached_property
    def _derivatives(self) -> Array:
        """(2, 2, PATCH, PATCH) of white and outside by row and by column, per cell."""
        return np.stack([np.stack(np.gradient(drawing)) for drawing in (self.white, self.outside)])

    @cached_property
    def appearance(self) -> Array:
        """(cells, 9) what the grey of a patch is made of: white print; outside; half the second derivatives of the
        white print by row twice, by column twice and by both; its tone curve's bend; its gradient forward and right;
        one.
        """
        by_row, by_column = self._derivatives[0]
        row_row, row_column = np.gradient(by_row)
        column_column = np.gradient(by_column)[1]
        x, y = _cell_centres()
        white = self.white.ravel()
        inside = 1.0 - self.outside.ravel()
        terms = [white, self.outside.ravel(), 0.5 * row_row.ravel(), 0.5 * column_column.ravel(), row_column.ravel()]
        bend = 4.0 * white * (1.0 - white) * inside
        return np.column_stack([*terms, bend, white * x, white * y, np.ones(white.size)])

    def at(self, cells: NDArray[np.intp]) -> tuple[Array, Array]:
        """Appearance (k, 9) of some cells, and the inverse (9, 9) of its held normal equations; kept for next time."""
        kept = self._kept
        if kept is None or not np.array_equal(kept[0], cells):
            terms = self.appearance[cells]
            held = terms.T @ terms + np.diag(1e-6 * len(cells) + self.hold)
            kept = (cells, terms, np.asarray(np.linalg.inv(held), dtype=np.float64))
            self._kept = kept
        return kept[1], kept[2]

    @cached_property
    def hold(self) -> Array:
        """(9,) how strongly each term of the appearance is held near 0, against one cell's grey."""
        cell_px = PSF_SIGMA_PX / self.sigma_cells
        blur = (NOISE_PART * cell_px**2 / (0.5 * BLUR_SIGMA_PX2)) ** 2
        tone, gradient = (NOISE_PART / TONE_SIGMA) ** 2, (NOISE_PART / GRADIENT_SIGMA) ** 2
        return np.array([0.0, 0.0, blur, blur, blur, tone, gradient, gradient, 0.0])

    @cached_property
    def trust(self) -> Array:
        """(cells,) weights: what lies round the quiet zone may be anything."""
        return np.asarray(1.0 / (1.0 + (SURROUND * self.outside.ravel()) ** 2), dtype=np.float64)

    @cached_property
    def design(self) -> Array:
        """(8 + 8 + 9, cells): slopes of white, slopes of outside, appearance: all that an alignment needs."""
        return np.ascontiguousarray(np.concatenate([*(s.T for s in self.slopes()), self.appearance.T]))

    @cached_property
    def weighted_design(self) -> Array:
        """Design times trust."""
        return np.ascontiguousarray(self.design * self.trust)

    @cached_property
    def gram(self) -> Array:
        """(25, 25) weighted_design design^T of the whole patch."""
        result: Array = self.weighted_design @ self.design.T
        return result

    def slopes(self) -> tuple[Array, Array]:
        """(cells, 8) each: derivatives of white and outside by the terms of a homography (a b c; d e f; g h).

        Coordinates are half sides of the patch, forward and right; the drawing is sampled at the moved place.
        """
        if self._slopes is None:
            half = PATCH / 2.0
            x, y = _cell_centres()
            found = []
            for by_row, by_column in self._derivatives:
                along, across = (-by_row * half).ravel(), (by_column * half).ravel()
                radial = along * x + across * y
                terms = [along * x, along * y, along, across * x, across * y, across, -radial * x, -radial * y]
                found.append(np.column_stack(terms))
            self._slopes = found[0], found[1]
        return self._slopes


class Windows:
    """Drawings in a small window round each cell.

    Attributes:
        white: (n, PATCH, PATCH) how white each cell is.
        mean: (n, PATCH, PATCH) in the windows.
        safe: (n, PATCH, PATCH) variance in the windows, never 0.
        shows: (n, PATCH, PATCH) where a drawing tells something.
        differs: (n, PATCH, PATCH) where the first one and each would not be taken for each other.
    """

    def __init__(self, white: Array) -> None:
        def mean(values: Array) -> Array:
            return np.stack([cv2.blur(v, (WINDOW, WINDOW)) for v in values])

        self.white = white
        self.mean = mean(white)
        variance = mean(white * white) - self.mean**2
        self.safe: Array = np.maximum(variance, 1e-6)
        self.shows: NDArray[np.bool_] = variance > SHOWS * SHOWS
        both = mean(white * white[0]) - self.mean * self.mean[0]
        alike = (both > 0) & (both * both >= LIKE * self.safe * self.safe[0])
        self.differs: NDArray[np.bool_] = np.where(self.shows & self.shows[0], ~alike, self.shows != self.shows[0])


class Rivals:
    """Other drawings that the landmark must not be taken for, at one blur.

    Attributes:
        names: What they are, for people.
        must_differ: (n,) where a rival can't be told from the landmark, nothing is known: it is the landmark turned.
        templates: As seen; the first one is the landmark itself.
        contour: (n,) the outermost one that differs.
    """

    def __init__(
        self, names: list[str], must_differ: list[bool], templates: list[Template], contour: list[int]
    ) -> None:
        self.names = names
        self.contour = np.array(contour)
        self.must_differ = np.array(must_differ)
        self.templates = templates
        self._kept: tuple[NDArray[np.intp], Array, Array] | None = None

    @cached_property
    def windows(self) -> Windows:
        """What each shows place by place."""
        return Windows(np.stack([t.white for t in self.templates]))

    @cached_property
    def averaged(self) -> Array:
        """(n, PATCH, PATCH) how white each cell and its neighbours are."""
        return np.stack([cv2.blur(t.white, (3, 3)) for t in self.templates])

    @cached_property
    def _appearances(self) -> Array:
        """(n, 9, cells)."""
        return np.stack([t.appearance.T for t in self.templates])

    def left(self, values: Array, cells: NDArray[np.intp]) -> Array:
        """(n, k) sums of squares that each drawing leaves of some greys, with the appearance that suits it best.

        Args:
            values: (cells, k) k lists of greys.
            cells: Where they are; in most patches the same ones, whose part of the work is kept.
        """
        kept = self._kept
        if kept is None or not np.array_equal(kept[0], cells):
            terms = self._appearances[:, :, cells]
            normal = terms @ terms.transpose(0, 2, 1)
            inverse = np.linalg.inv(normal + np.diag(1e-6 * len(cells) + self.templates[0].hold))
            kept = cells, terms.reshape(-1, len(cells)), inverse @ (2.0 * np.eye(len(normal[0])) - normal @ inverse)
            self._kept = kept
        _, rows, solved = kept
        side = (rows @ values).reshape(len(solved), -1, values.shape[1])
        result: Array = (values * values).sum(axis=0) - (side * (solved @ side)).sum(axis=1)
        return result


@cache
def _cell_centres() -> tuple[Array, Array]:
    """(cells,) forward and right of the cells, in half sides of the patch."""
    cell = 1.0 - (2.0 * np.arange(PATCH) + 1.0) / PATCH
    x, y = np.meshgrid(cell, -cell, indexing="ij")
    return x.ravel(), y.ravel()


@cache
def _cycles(corners: int) -> NDArray[np.intp]:
    count = np.arange(corners)
    return (count[:, None] + count) % corners


@cache
def _turns(corners: int) -> Array:
    angle = 2.0 * math.pi * np.arange(corners) / corners
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=1)


class LandmarkGeometry:
    """Arrays of one landmark. Sides and corners are listed contour by contour, outermost first.

    Attributes:
        landmark: The drawing.
        corners: (c, 2) all corners, metres.
        corner_contour: (c,) whose corner it is.
        slices: For each contour, its part of `corners` (and of the sides: a polygon has as many).
        following: (c,) index of the corner that the side of each corner leads to.
        previous: (c,) index of the side that ends at each corner; the side with the corner's own index starts there.
        side_points: (c, m, 2) points along each side, metres.
        side_normals: (c, 2) outward.
        side_sign: (c,) +1 where grey rises outward (a black contour), -1 where it falls.
        sides_m: (contours,) length of a side of each contour.
        size_m: The outermost's.
        area_ratios: (contours - 1,) area of each contour over that of the next one in it.
        gap_m: (c,) distance from each side to the nearest other edge of the drawing.
        patch_points: (PATCH * PATCH, 2) centres of the cells of the rectified patch, front row first, left to right.
        patch_nodes: (NODES * NODES, 2) points spread evenly over them, from the first cell's centre to the last's.
        between_nodes: (PATCH, NODES) weights that interpolate linearly from nodes to cells, along either axis.
        point_slanted: (points,) whether a point lies on a side along neither axis: squares in squares have none.
    """

    def __init__(self, landmark: Landmark) -> None:
        self.landmark = landmark
        contours = landmark.contours
        self.corners: Array = np.concatenate([c.corners_m for c in contours])
        counts = [len(c.corners_m) for c in contours]
        ends = np.cumsum(counts)
        self.slices = [slice(int(e) - n, int(e)) for n, e in zip(counts, ends, strict=True)]
        self.corner_contour: NDArray[np.intp] = np.repeat(np.arange(len(contours)), counts)
        self.previous: NDArray[np.intp] = np.concatenate(
            [np.roll(np.arange(s.start, s.stop), 1) for s in self.slices]
        ).astype(np.intp)
        self.following: NDArray[np.intp] = np.concatenate(
            [np.roll(np.arange(s.start, s.stop), -1) for s in self.slices]
        ).astype(np.intp)
        edge = self.corners[self.following] - self.corners
        length = np.hypot(edge[:, 0], edge[:, 1])
        # Corners run clockwise seen from above: the outward normal of an edge (forward, right) is (right, -forward).
        self.side_normals: Array = np.column_stack([edge[:, 1], -edge[:, 0]]) / length[:, None]
        at = np.linspace(SIDE_MARGIN, 1.0 - SIDE_MARGIN, SAMPLES_PER_SIDE)
        self.side_points: Array = self.corners[:, None] + edge[:, None] * at[:, None]
        self.side_sign: Array = np.array([1.0 if contours[k].black else -1.0 for k in self.corner_contour])
        self.gap_m: Array = self._gaps()
        half = 0.5 * PATCH_EXTENT * landmark.size_m
        cell = half * (1.0 - (2.0 * np.arange(PATCH) + 1.0) / PATCH)
        forward, right = np.meshgrid(cell, -cell, indexing="ij")
        self.patch_points: Array = np.column_stack([forward.ravel(), right.ravel()])
        at = np.linspace(cell[0], cell[-1], NODES)
        node_forward, node_right = np.meshgrid(at, -at, indexing="ij")
        self.patch_nodes: Array = np.column_stack([node_forward.ravel(), node_right.ravel()])
        place = np.linspace(0.0, NODES - 1.0, PATCH)
        self.between_nodes: Array = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(NODES)))
        self.sides_m: Array = np.array([c.side_m for c in contours])
        self.size_m: float = landmark.size_m
        self.area_ratios: Array = np.array([landmark.area_ratio(k) for k in range(len(contours) - 1)])
        self.unit_m: float = 0.5 * landmark.size_m
        flat = self.side_points.reshape(-1, 2) / self.unit_m
        self.unit_points: Array = np.column_stack([flat, np.ones(len(flat))])
        self.unit_tangents: Array = np.repeat(edge / length[:, None], SAMPLES_PER_SIDE, axis=0)
        self.unit_gaps: Array = np.repeat(self.gap_m / self.unit_m, SAMPLES_PER_SIDE)
        self.point_sign: Array = np.repeat(self.side_sign, SAMPLES_PER_SIDE)
        self.point_contour: NDArray[np.intp] = np.repeat(self.corner_contour, SAMPLES_PER_SIDE)
        self.point_slanted: NDArray[np.bool_] = np.abs(self.unit_tangents).min(axis=1) > SLANTED
        self._templates: dict[int, Template] = {}
        self._rivals: dict[int, Rivals] = {}
        self._inners: dict[int, LandmarkGeometry] = {}
        self._cells: dict[int | None, NDArray[np.intp]] = {}
        self._insides: dict[int, NDArray[np.bool_]] = {}

    def point_slice(self, run: range) -> slice:
        """The points along the sides of neighbouring contours."""
        start, stop = self.slices[run.start].start, self.slices[run.stop - 1].stop
        return slice(start * SAMPLES_PER_SIDE, stop * SAMPLES_PER_SIDE)

    @cached_property
    def centroids(self) -> Array:
        """(contours, 2) forward, right, of each contour."""
        return np.stack([c.centroid_m for c in self.landmark.contours])

    def cycles(self, corners: int) -> NDArray[np.intp]:
        """(corners, corners) the ways to count a polygon's corners from each of them on."""
        return _cycles(corners)

    def turns(self, corners: int) -> Array:
        """(corners, 2, 2) matrices that turn row vectors (forward, right) by whole parts of a circle."""
        return _turns(corners)

    def turns_about(self, contour: int) -> list[Array]:
        """(3, 3) maps of the pad's plane that turn a contour into itself: (forward, right, 1) to the same."""
        centre = self.centroids[contour]
        found = []
        for turn in self.turns(len(self.landmark.contours[contour].corners_m)):
            matrix = np.eye(3)
            matrix[:2, :2] = turn.T
            matrix[:2, 2] = centre - turn.T @ centre
            found.append(matrix)
        return found

    @cached_property
    def outer_gap_m(self) -> Array:
        """(contours,) distance of each contour from the one round it (the quiet zone's edge for the outermost)."""
        zone = 0.5 * (self.landmark.quiet_zone_m - self.landmark.size_m)
        pairs = itertools.pairwise(self.landmark.contours)
        return np.array([zone, *(float(gaps_m(a.corners_m, b.corners_m).min()) for a, b in pairs)])

    def _gaps(self) -> Array:
        outer = self.outer_gap_m
        inner = np.append(outer[1:], 0.25 * self.landmark.contours[-1].side_m)
        return np.asarray(np.minimum(outer, inner)[self.corner_contour], dtype=np.float64)

    @cached_property
    def perimeter_ratios(self) -> tuple[float, ...]:
        """Length round each contour over that round the next one in it."""
        lengths = [c.side_m * c.shape.corners for c in self.landmark.contours]
        return tuple(a / b for a, b in itertools.pairwise(lengths))

    def inner_centre_m(self, first: int) -> Array:
        """(2,) forward, right: where `inner` has its origin, the middle of the contour's bounding box."""
        corners = self.landmark.contours[first].corners_m
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)), dtype=np.float64)

    def inner(self, first: int) -> LandmarkGeometry:
        """The drawing from a black contour on, with its origin in the middle of it, on the white that is round it."""
        if first not in self._inners:
            self._inners[first] = self._from(first)
        return self._inners[first]

    def _from(self, first: int) -> LandmarkGeometry:
        contours = self.landmark.contours
        white, centre = contours[first - 1], self.inner_centre_m(first)
        shifted = tuple(replace(c, corners_m=c.corners_m - centre) for c in contours[first:])
        room = contours[first].side_m + 2.0 * float(self.outer_gap_m[first])
        zone = min(room, white.side_m) if white.shape is Shape.TRIANGLE else white.side_m
        return LandmarkGeometry(Landmark(f"{self.landmark.name} from {contours[first].name}", shifted, zone))

    @cached_property
    def points_of(self) -> NDArray[np.intp]:
        """(contours,) how many points lie along the sides of each."""
        return np.bincount(self.point_contour)

    @cached_property
    def turns_visibly(self) -> NDArray[np.bool_]:
        """(contours,) whether a contour looks different when the landmark is turned by a quarter."""
        round_m = 1e-6 * self.size_m
        return np.array(
            [c.shape is not Shape.SQUARE or float(np.abs(c.centroid_m).max()) > round_m for c in self.landmark.contours]
        )

    @cached_property
    def square_part(self) -> float:
        """Area of the outermost contour over that of the judged cells."""
        cell_m = PATCH_EXTENT * self.size_m / PATCH
        return self.landmark.contours[0].area_m2 / (cell_m**2 * len(self.cells(None)))

    def _drawn(self, contours: Sequence[tuple[Array, bool]]) -> NDArray[np.float32]:
        """(2, n, n) with FINE x FINE points a cell: 1 where white is printed; 1 outside the quiet zone.

        Args:
            contours: Corners (k, 2) and whether the inside is black, outermost first.
        """
        n = FINE * PATCH
        half = 0.5 * PATCH_EXTENT * self.landmark.size_m
        at = half * (1.0 - (2.0 * np.arange(n) + 1.0) / n)
        forward, right = np.meshgrid(at, -at, indexing="ij")
        points = np.column_stack([forward.ravel(), right.ravel()])
        outside = np.abs(points).max(axis=1) > 0.5 * self.landmark.quiet_zone_m
        white = ~outside
        for corners, black in contours:
            white = np.where(gaps_to_points(corners, points) > 0, not black, white)
        return np.stack([white, outside]).reshape(2, n, n).astype(np.float32)

    @cached_property
    def _drawings(self) -> list[tuple[str, int, NDArray[np.float32]]]:
        """The landmark first, then its variants: name, which contour differs, and drawing of _drawn."""
        own = [(c.corners_m, c.black) for c in self.landmark.contours]
        found = [("as drawn", 0, self._drawn(own))]
        for k, contour in enumerate(self.landmark.contours):
            changes: list[tuple[str, Array]] = []
            if k > 0:
                found.append((f"without {contour.name}", k, self._drawn(own[:k])))
            if contour.shape is Shape.TRIANGLE:
                changes.append(("upside down", 2.0 * contour.centroid_m - contour.corners_m))
            if contour.shape is Shape.TRIANGLE or (k == 0 and len(own) > 1):
                changes.append(("a disc", contour.centroid_m + _regular(24, contour.area_m2, 0.0)))
            for word, factor in (("larger", 1.3), ("smaller", 0.7)) if k > 0 else ():
                changes.append((word, contour.centroid_m + factor * (contour.corners_m - contour.centroid_m)))
            if contour is self.landmark.contours[-1]:
                changes += [*_other_shapes(contour), *_other_places(contour)]
            for name, corners in changes:
                changed = [*own[:k], (corners, contour.black), *own[k + 1 :]]
                found.append((f"with {contour.name} {name}", k, self._drawn(changed)))
        if len(own) > 2:
            for name, sign in (("clockwise", 1.0), ("counterclockwise", -1.0)):
                c, s = math.cos(sign * INSIDE_TURNED_RAD), math.sin(sign * INSIDE_TURNED_RAD)
                centre, turn = self.landmark.contours[2].centroid_m, np.array([[c, s], [-s, c]])
                inside = [(centre + (corners - centre) @ turn, black) for corners, black in own[2:]]
                found.append((f"with {self.landmark.contours[2].name} turned {name}", 2, self._drawn(own[:2] + inside)))
        return found

    def template(self, sigma_cells: float) -> Template:
        """The drawing as seen with a blur (standard deviation) of that many cells, to the nearest of BLURS_PER_OCTAVE
        in an octave.
        """
        key = self._blur_key(sigma_cells)
        if key not in self._templates:
            self._templates[key] = self._drawn_at(key, 0)
        return self._templates[key]

    def _drawn_at(self, key: int, variant: int) -> Template:
        """The landmark (0) or a rival at a blur."""
        sigma = 0.25 * 2.0 ** (key / BLURS_PER_OCTAVE)
        return Template(self._blurred(sigma, variant), sigma)

    @staticmethod
    def _blur_key(sigma_cells: float) -> int:
        return max(0, round(BLURS_PER_OCTAVE * math.log2(max(sigma_cells, 0.25) / 0.25)))

    def rivals(self, sigma_cells: float) -> Rivals:
        """What the picture must not be taken for, at a blur of that many cells; the last RIVALS_KEPT are kept."""
        key = self._blur_key(sigma_cells)
        if key in self._rivals:
            self._rivals[key] = self._rivals.pop(key)
        else:
            own = self.template(sigma_cells)
            names, differ, templates, contour = ["as drawn"], [False], [own], [0]
            turns = self.landmark.contours[0].shape is Shape.SQUARE and bool(self.turns_visibly.any())
            for quarters in (1, 2, 3):
                names.append(f"turned by {90 * quarters} degrees")
                differ.append(turns)
                turned = np.rot90(np.stack([own.white, own.outside]), quarters, axes=(1, 2))
                templates.append(Template(turned, own.sigma_cells))
                contour.append(0)
            for variant, (name, which, _) in enumerate(self._drawings):
                if variant > 0:
                    names.append(name)
                    differ.append(False)
                    templates.append(self._drawn_at(key, variant))
                    contour.append(which)
            self._rivals[key] = Rivals(names, differ, templates, contour)
            if len(self._rivals) > RIVALS_KEPT:
                del self._rivals[next(iter(self._rivals))]
        return self._rivals[key]

    @cached_property
    def patch_part(self) -> float:
        """Side of the patch in sides of the outermost contour."""
        return PATCH_EXTENT

    @cached_property
    def _blob_cells(self) -> NDArray[np.bool_]:
        """(BLOB_GRID, BLOB_GRID) samples that are compared: the quiet zone's inner part and what it holds."""
        at = PATCH_EXTENT * (1.0 - (2.0 * np.arange(BLOB_GRID) + 1.0) / BLOB_GRID)
        near = np.abs(at) < min(JUDGED_EXTENT, self.landmark.quiet_zone_m / self.size_m)
        return np.asarray(near[:, None] & near)

    @cached_property
    def blob_grid(self) -> Array:
        """(m, 2) those samples' places, forward and right, in half sides of the outermost contour."""
        at = PATCH_EXTENT * (1.0 - (2.0 * np.arange(BLOB_GRID) + 1.0) / BLOB_GRID)
        forward, right = np.meshgrid(at, -at, indexing="ij")
        return np.column_stack([forward[self._blob_cells], right[self._blob_cells]])

    def blob_templates(self, sigma_cells: float) -> Array:
        """(4, m) the drawing at those samples, of mean 0 and length 1, turned so that its corner k takes the place of
        the first one.
        """
        white = self.template(sigma_cells).white
        half = BLOB_GRID
        small = white.reshape(half, PATCH // half, half, PATCH // half).mean(axis=(1, 3))
        rows = np.stack([np.rot90(small, turn)[self._blob_cells] for turn in range(4)])
        rows -= rows.mean(axis=1, keepdims=True)
        result: Array = rows / np.sqrt((rows * rows).sum(axis=1, keepdims=True))
        return result

    def _blurred(self, sigma_cells: float, variant: int) -> Array:
        """(2, PATCH, PATCH) both drawings with a blur of that many cells."""
        sigma = sigma_cells * FINE
        drawing = self._drawings[variant][2]
        blurred = [cv2.GaussianBlur(d, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE) for d in drawing]
        cells = np.stack(blurred).reshape(2, PATCH, FINE, PATCH, FINE).mean(axis=(2, 4))
        return np.asarray(cells, dtype=np.float64)

    @cached_property
    def judged(self) -> NDArray[np.bool_]:
        """(PATCH, PATCH) cells that lie on the landmark or close to it, inside the quiet zone."""
        half = 0.5 * min(JUDGED_EXTENT * self.landmark.size_m, self.landmark.quiet_zone_m)
        near = np.abs(self.patch_points).max(axis=1) < half
        return np.asarray(near, dtype=np.bool_).reshape(PATCH, PATCH)

    def cells(self, inside_of: int | None) -> NDArray[np.intp]:
        """Flat indices of the cells that are judged: all of them, or those inside a contour."""
        if inside_of not in self._cells:
            chosen = self.judged if inside_of is None else self.judged & self.inside(inside_of)
            self._cells[inside_of] = np.flatnonzero(chosen)
        return self._cells[inside_of]

    def inside(self, index: int) -> NDArray[np.bool_]:
        """(PATCH, PATCH) cells whose centre lies inside a contour."""
        if index not in self._insides:
            depth = gaps_to_points(self.landmark.contours[index].corners_m, self.patch_points)
            self._insides[index] = (depth > 0).reshape(PATCH, PATCH)
        return self._insides[index]


def _regular(count: int, area_m2: float, first_deg: float) -> Array:
    """(count, 2) corners of a regular polygon about 0, clockwise."""
    radius = math.sqrt(area_m2 / (0.5 * count * math.sin(2.0 * math.pi / count)))
    angle = math.radians(first_deg) + 2.0 * math.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _other_shapes(contour: Contour) -> list[tuple[str, Array]]:
    """What a contour may be replaced by: other polygons, as large as it or larger, clockwise."""
    found: list[tuple[str, Array]] = []
    kinds = [("a disc", 24, 0.0), ("a diamond", 4, 0.0), ("a square", 4, 45.0)]
    kinds += [("a triangle", 3, 0.0), ("a triangle, inverted", 3, 180.0)]
    for name, count, first_deg in kinds:
        if name == f"a {contour.shape.value}":
            continue
        arm = _regular(count, contour.area_m2, first_deg)
        found += [(name, contour.centroid_m + arm), (f"{name}, larger,", contour.centroid_m + 1.25 * arm)]
    return found


def _other_places(contour: Contour) -> list[tuple[str, Array]]:
    """Where a contour may be moved to, by half of its side."""
    step = 0.5 * contour.side_m
    ways = {"forward": (step, 0.0), "back": (-step, 0.0), "right": (0.0, step), "left": (0.0, -step)}
    return [(f"moved {name}", contour.corners_m + np.array(way)) for name, way in ways.items()]


def gaps_to_points(corners: Array, points: Array) -> Array:
    """(n,) depth of points (n, 2) inside a clockwise convex polygon (k, 2), in its unit; negative outside."""
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    result: Array = (points @ normal.T - np.sum(normal * corners, axis=1)).min(axis=1)
    return result
