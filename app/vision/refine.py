"""The whole landmark fitted to its edges in the image: where the grey crosses from black to white along every side of
the drawing that is in view, and the one map of the pad's plane that explains all of these crossings, robustly.

Each point along a side has its own black and white, so a shadow or a glare that crosses the landmark moves nothing.
Blur, exposure and print make all black a little large or small together; contours that are black inside and those that
are white inside feel it with opposite signs, so it is one more unknown of the fit and doesn't act on the scale.

It owns measurement and fit; what is good enough is judged elsewhere.
Source: Drummond and Cipolla, "Real-time visual tracking of complex structures", 2002 (edges searched along normals);
Holland and Welsch, "Robust regression using iteratively reweighted least-squares", 1977.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.messages import Image
from app.vision.camera_model import Lens
from app.vision.geometry import SAMPLES_PER_SIDE, LandmarkGeometry

STEPS = 9
"""Grey values across a side."""
_S = np.linspace(-1.0, 1.0, STEPS)
_S32 = _S.astype(np.float32)
_HALF = STEPS // 2
FINE_REACH_PX = 2.2
"""How far they reach from an edge known to a fraction of a pixel: over the blur of lens and pixel."""
ROOM_PART = 0.45
"""Of the distance to the nearest other edge of the drawing: so far to each side is looked."""
WIDE_PX = 2.0
"""With this much room black and white are seen as they are."""
NARROWEST_PX = 1.2
"""A side with less room is not measured."""
MOST_HIDDEN = 0.6
"""Part of an edge's distance that blur may hide; a ramp from end to end hides all of it."""
MIN_CONTRAST = 8.0
CONTRAST_PART = 0.2
"""An edge must have this part of the median contrast of all: in the shade it is fainter."""
STEP_PART = 0.5
"""An edge is dark on one side and bright on the other: the means of both sides differ by this part of all that the
grey varies. Ideal ones reach 0.75 to 0.9, texture seldom half of that."""
FAR_STEP_PART = 0.12
"""While it is sought far off it doesn't lie in the middle."""
AGREES_PX = 0.8
AGREES_PART = 0.01
"""An edge point is confirmed if it lies this near to the fit, and this part of its own side in addition (bent prints,
lens errors)."""
BIAS_SIGMA_PX = 0.3
"""What all black may be large by, in the image."""
SCATTER_MIN_PX = 0.05
"""Edge points never are better than this."""
SOFT = 0.5
"""While edges are sought far off, those that lie this part of the way are not outliers yet."""
NEARLY_ALL = 0.9
RELINEARISE_PX = 3.2
"""Edges that moved by less in a step are still where their normals and derivatives were taken."""
FAR_OUT_PX = -1e4
CUTOFF = 3.0
"""Tukey's biweight ends at this many times the scatter."""
HOLD_PERSPECTIVE = 1e-5
"""Holds the two perspective terms unless the edges say otherwise, as a part of the information on the shift."""
RIGID_SIGMA = 0.01
"""The pad's two axes are at right angles and equally long; a lens that is not quite as its file says bends that by
so much. It steadies the fit where few edges are seen, and is no part of the information."""


@dataclass(frozen=True, slots=True)
class Edges:
    """What a fit saw along the sides.

    Attributes:
        in_view: (contours,) points whose surroundings lie in the image and can be resolved.
        confirmed: (contours,) those of them that show the edge where the fit puts it, with the drawing's sign.
        contrast: Median step of grey across the confirmed edges.
        level: Median grey half way up them.
        scatter_px: Root mean square distance of the confirmed points from the fit.
        step_px: Largest move of an edge in the last step.
        side_px: Side of the outermost contour in the image, about.
        bent: How far the pad's two axes are from right angles and equal lengths.
        slanted_in_view: Of the points in view, those on sides that no square has (see LandmarkGeometry.point_slanted).
        slanted_confirmed: Of these, the confirmed ones.
    """

    in_view: NDArray[np.intp]
    confirmed: NDArray[np.intp]
    contrast: float
    level: float
    scatter_px: float
    step_px: float
    side_px: float
    bent: float
    slanted_in_view: int
    slanted_confirmed: int

    @property
    def share(self) -> float:
        """Part of all points in view that are confirmed."""
        return float(self.confirmed.sum()) / max(1, int(self.in_view.sum()))


@dataclass(frozen=True, slots=True)
class EdgeFit:
    """The plane and what it rests on.

    Attributes:
        rays_from_pad: (3, 3), see app.messages.PlaneFit.
        information: (8, 8), see there.
        edges: What was seen.
    """

    rays_from_pad: Array
    information: Array
    edges: Edges


def _crossings(rising: Array, level: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Where profiles (STEPS, n) that rise from black to white cross a level (n,), in -1..1, nearest to the middle;
    whether they do; and how much they rise from the grey before to the grey after it.
    """
    below = rising < level
    crosses = below[:-1] & ~below[1:]
    # The crossing nearest to the middle: intervals in the order of their distance from it.
    order = crosses[_NEAREST]
    first = order.argmax(axis=0)
    columns = np.arange(len(level))
    found = order[first, columns]
    at = _NEAREST[first]
    before, after = rising[at, columns], rising[at + 1, columns]
    rise = np.where(found, after - before, 1.0)
    where = _S[at] + (level - before) / rise * (2.0 / (STEPS - 1))
    return where, found, rise


_NEAREST = np.argsort(np.abs(np.arange(STEPS - 1) - (_HALF - 0.5)), kind="stable")


class _Points:
    """Points along the sides of some neighbouring contours of a landmark."""

    def __init__(self, geometry: LandmarkGeometry, run: range) -> None:
        part = geometry.point_slice(run)
        self.unit = geometry.unit_points[part]
        self.tangent = geometry.unit_tangents[part]
        self.gap = geometry.unit_gaps[part]
        self.sign = geometry.point_sign[part]
        self.contour = geometry.point_contour[part]
        self.slanted = geometry.point_slanted[part]
        self.slack = geometry.sides_m[self.contour] * (AGREES_PART / geometry.unit_m)


@dataclass(frozen=True, slots=True)
class _Lines:
    """The sides as a map puts them into the image.

    Attributes:
        px: (n, 2) where its points are, in pixels of the image that is looked at.
        normal: (n, 2) outward.
        room: (n,) pixels that may be looked at on either side.
        valid: (n,) whether the lens sees them and there is room.
        jacobian: (n, 9) how they move along the normal: by d of PlaneFit, and with all black.
        unit_px: Length of the unit of d in the image.
    """

    px: Array
    normal: Array
    room: Array
    valid: NDArray[np.bool_]
    jacobian: Array
    unit_px: float


def _lines(view: tuple[int, int], matrix: Array, points: _Points, lens: Lens) -> _Lines:
    """Put the sides into the image; matrix is rays_from_pad S of PlaneFit, view the frame's pixel at image[0, 0]."""
    px, slope, valid = lens.project_with_jacobian(points.unit @ matrix.T)
    if not valid.all():
        px, slope = np.where(valid[:, None], px, FAR_OUT_PX), np.where(valid[:, None, None], slope, 1.0)
    plane = (slope.reshape(-1, 3) @ matrix[:, :2]).reshape(-1, 2, 2)
    along = plane[:, :, 0] * points.tangent[:, :1] + plane[:, :, 1] * points.tangent[:, 1:]
    length = np.sqrt(along[:, 0] * along[:, 0] + along[:, 1] * along[:, 1])
    normal = np.empty_like(along)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal[:, 0], normal[:, 1] = along[:, 1] / length, -along[:, 0] / length
        area = np.abs(plane[:, 0, 0] * plane[:, 1, 1] - plane[:, 0, 1] * plane[:, 1, 0])
        room = area / length * points.gap * ROOM_PART
    by_ray = (normal[:, :1] * slope[:, 0] + normal[:, 1:] * slope[:, 1]) @ matrix
    jacobian = (by_ray[:, :, None] * points.unit[:, None, :]).reshape(-1, 9)
    jacobian[:, 8] = points.sign
    unit_px = 0.0
    if valid.all():
        unit_px = math.sqrt(float(area.sum()) / len(area))
    else:
        normal, room = np.where(valid[:, None], normal, 0.0), np.where(valid, room, 0.0)
        jacobian = np.where(valid[:, None], jacobian, 0.0)
        if valid.any():
            unit_px = math.sqrt(float(area[valid].mean()))
    return _Lines(px - view, normal, room, valid & (room >= NARROWEST_PX), jacobian, unit_px)


@dataclass(frozen=True, slots=True)
class _Measured:
    """One look along the normals.

    Attributes:
        offset: (n,) pixels outward from where the map puts the edge to where it was seen.
        found: (n,) whether it was.
        in_view: (n,) whether it could have been.
        contrast: (n,) grey levels.
        level: (n,) grey half way up.
    """

    offset: Array
    found: NDArray[np.bool_]
    in_view: NDArray[np.bool_]
    contrast: Array
    level: Array


def _measure(image: Image, lines: _Lines, shift: Array | None, points: _Points, reach_px: float) -> _Measured:
    """Look across the sides; shift (n,) is how far outward of the lines they are expected."""
    reach = np.minimum(lines.room, reach_px)
    height, width = image.shape
    centre = lines.px if shift is None else lines.px + lines.normal * shift[:, None]
    at = centre.astype(np.float32)
    across = (lines.normal * reach[:, None]).astype(np.float32)
    half = np.array([0.5 * (width - 1), 0.5 * (height - 1)], dtype=np.float32)
    inside = np.abs(at - half) + np.abs(across) <= half
    in_view = lines.valid & inside[:, 0] & inside[:, 1]
    # One step outward of all sides after the other: numpy reduces such rows ten times as fast as short columns.
    u = at[:, 0] + _S32[:, None] * across[:, 0]
    v = at[:, 1] + _S32[:, None] * across[:, 1]
    grey = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rising = grey * points.sign
    low, high = rising[: _HALF + 1].min(axis=0), rising[_HALF:].max(axis=0)
    contrast = high - low
    level = 0.5 * (low + high)
    wide = lines.room >= WIDE_PX
    if not wide.all():
        clear = in_view & wide & (contrast >= MIN_CONTRAST)
        if clear.any():
            # A band of two or three pixels never gets as black or as white as it is; its edges still cross the middle.
            middle = _median((points.sign * level)[clear])
            held = np.minimum(np.maximum(points.sign * middle, low + 0.1 * contrast), high - 0.1 * contrast)
            level = np.where(wide, level, held)
    where, crosses, rise = _crossings(rising, level)
    step = _BOTH_SIDES @ rising
    step_part = STEP_PART if reach_px <= FINE_REACH_PX else FAR_STEP_PART
    found = in_view & crosses & (contrast >= MIN_CONTRAST) & (step >= step_part * contrast)
    if found.any():
        found &= contrast >= CONTRAST_PART * _median(contrast[found])
    offset = where * _stretch(rising, rise, found & wide) * reach
    if shift is not None:
        offset += shift
    return _Measured(np.where(found, offset, 0.0), found, in_view, contrast, level * points.sign)


def _stretch(rising: Array, rise: Array, wide: NDArray[np.bool_]) -> Array:
    """(n,) how much further out an edge lies than its profile says, where blur reaches over the profile's ends.

    Black and white are taken for what both ends show. While an edge lies d outside the middle one end is nearer to it,
    and half way between them is no longer half way up: with E' the edge's slope it is seen at d less the integral of
    g = (E'(-reach) + E'(reach)) / (2 E'(0)) over d. The ends' geometric mean stands for g where d was nothing. All of
    a side's points have one blur, so one g; narrow sides don't use their ends' greys.
    """
    slopes = np.concatenate([_AT_ENDS @ rising, rise[None]]) * wide
    inner, outer, middle = np.maximum(slopes.reshape(3, -1, SAMPLES_PER_SIDE).sum(axis=2), 0.0)
    ends = 0.25 * (inner + outer) + 0.5 * np.sqrt(inner * outer)
    part = np.minimum(ends, MOST_HIDDEN * middle) / np.maximum(middle, 1e-9)
    return np.where(wide, np.repeat(1.0 / (1.0 - part), SAMPLES_PER_SIDE), 1.0)


_AT_ENDS = np.zeros((2, STEPS))
_AT_ENDS[0, :3], _AT_ENDS[1, -3:] = (-1.5, 2.0, -0.5), (0.5, -2.0, 1.5)
"""Takes a profile to its slopes at both ends, per step: what its last two steps rise, carried on by half a step."""
_BOTH_SIDES = np.concatenate([np.full(_HALF, -1.0), [0.0], np.full(_HALF, 1.0)]) / _HALF
"""Takes a profile to the mean of its outer part less that of its inner part."""


def _median(values: Array) -> float:
    """The upper median; 0 of nothing. For so few values a sort is faster than numpy's median."""
    return float(np.sort(values)[len(values) // 2]) if len(values) else 0.0


@dataclass(frozen=True, slots=True)
class _Step:
    """One solution of the linear problem.

    Attributes:
        d: (8,) the warp.
        residual: (n,) what it leaves, pixels.
        weight: (n,) robust weights.
        scatter_px: Of the points that count.
        information: (8, 8).
    """

    d: Array
    residual: Array
    weight: Array
    scatter_px: float
    information: Array


def _rigidity(matrix: Array) -> tuple[Array, Array]:
    """(2, 8) and (2,): how the angle and the lengths of the pad's two axes change with d, and how far off they are."""
    g = matrix.T @ matrix
    (g00, g01, g02), (_, g11, g12), _ = g.tolist()
    unit = 2.0 / (g00 + g11)
    slope = np.array(
        [
            [g01, g00, 0.0, g11, g01, 0.0, g12, g02],
            [2.0 * g00, -2.0 * g01, 0.0, 2.0 * g01, -2.0 * g11, 0.0, 2.0 * g02, -2.0 * g12],
        ]
    )
    return slope * unit, np.array([g01 * unit, (g00 - g11) * unit])


def _solve(
    measured: _Measured, rows: Array, stiffness: tuple[Array, Array], rounds: int, least_px: float
) -> _Step | None:
    """Robust least squares for the warp and the common error of all black; None where the points determine nothing.

    Args:
        measured: Offsets.
        rows: (n, 9) _Lines.jacobian.
        stiffness: Of _rigidity.
        rounds: Of weighing.
        least_px: Points that are off by so much are no outliers.
    """
    weight = measured.found.astype(np.float64)
    count = float(weight.sum())
    if count < 9:
        return None
    offset, residual = measured.offset, measured.offset
    scatter = max(least_px, 1.5 * _median(np.abs(residual[measured.found])))
    solution = np.zeros(9)
    normal = np.zeros((9, 9))
    rigid, bent = stiffness
    stiff, stiff_side = rigid.T @ rigid, rigid.T @ bent
    for _ in range(rounds):
        weighted = (rows * weight[:, None]).T
        normal = weighted @ rows
        side = weighted @ offset
        held = normal.copy()
        hold = HOLD_PERSPECTIVE * (normal[2, 2] + normal[5, 5])
        held[6, 6] += hold
        held[7, 7] += hold
        held[8, 8] += (scatter / BIAS_SIGMA_PX) ** 2
        held.reshape(-1)[::10] += 1e-9 * count
        firm = (scatter / RIGID_SIGMA) ** 2
        held[:8, :8] += firm * stiff
        side[:8] -= firm * stiff_side
        try:
            solution = np.asarray(np.linalg.solve(held, side), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        residual = offset - rows @ solution
        off = np.abs(residual)
        scatter = max(least_px, 1.5 * _median(off[measured.found]))
        t = off * (1.0 / (CUTOFF * scatter))
        weight = np.maximum(0.0, 1.0 - t * t) ** 2 * measured.found
    total = float(weight.sum())
    if total < 9 or not math.isfinite(total):
        return None
    spread = math.sqrt(float(weight @ (residual * residual)) / total * count / max(1.0, count - 9.0))
    variance = max(spread, SCATTER_MIN_PX) ** 2
    bias = normal[8, 8] + variance / BIAS_SIGMA_PX**2
    information = (normal[:8, :8] - np.outer(normal[:8, 8], normal[8, :8]) / bias) / variance
    return _Step(solution[:8], residual, weight, spread, information)


def warp(d: Array) -> Array:
    """(3, 3) W(d) of PlaneFit."""
    return np.array([[1.0 + d[0], d[1], d[2]], [d[3], 1.0 + d[4], d[5]], [d[6], d[7], 1.0]])


def fit_edges(
    image: Image,
    rays_from_pad: Array,
    geometry: LandmarkGeometry,
    lens: Lens,
    run: range,
    reach_px: tuple[float, ...],
    origin: tuple[int, int] = (0, 0),
    *,
    alone: bool = False,
    easy_px: float = 0.0,
) -> EdgeFit | None:
    """Fit the drawing to its edges, from a map that is nearly right.

    Args:
        image: (height, width) grey of the frame, or of a region of it.
        rays_from_pad: (3, 3) where to begin.
        geometry: Of the landmark.
        lens: Of the camera.
        run: Contours to begin with; in each further step their neighbours are taken in too.
        reach_px: For each step, how far from the map an edge may be.
        origin: (u0, v0) of the region.
        alone: No neighbours are taken in.
        easy_px: A step that moved no edge further and found nearly all of them is the last one.

    Returns:
        The fit, with what the last step saw of all contours of the landmark that it had taken in; None where nothing
        holds it.
    """
    unit_m = geometry.unit_m
    scale = np.array([unit_m, unit_m, 1.0])
    matrix = rays_from_pad * scale
    count = len(geometry.landmark.contours)
    points = _Points(geometry, run)
    lines: _Lines | None = None
    shift: Array | None = None
    base, stiffness = matrix, _rigidity(matrix)
    measured: _Measured | None = None
    solved: _Step | None = None
    moved = 0.0
    for k, reach in enumerate(reach_px):
        last = k == len(reach_px) - 1
        if k > 0 and not alone and (run.start > 0 or run.stop < count):
            run = range(count) if last else range(max(0, run.start - 1), min(count, run.stop + 1))
            points, lines = _Points(geometry, run), None
        if lines is None or moved > RELINEARISE_PX:
            base, shift = matrix, None
            lines, stiffness = _lines(origin, matrix, points, lens), _rigidity(matrix)
        measured = _measure(image, lines, shift, points, reach)
        least_px = max(SCATTER_MIN_PX, SOFT * (reach - FINE_REACH_PX))
        solved = _solve(measured, lines.jacobian, stiffness, 3 if last else 2, least_px)
        if solved is None or not float(np.abs(solved.d).max()) < 0.5:
            return None
        matrix = base @ warp(solved.d)
        before, shift = shift, lines.jacobian[:, :8] @ solved.d
        moved = float(np.abs((shift if before is None else shift - before)[measured.in_view]).max(initial=0.0))
        limit = AGREES_PX + lines.unit_px * points.slack
        good = measured.found & (np.abs(solved.residual) <= limit)
        if (
            reach <= FINE_REACH_PX
            and moved < easy_px
            and np.count_nonzero(good) >= NEARLY_ALL * np.count_nonzero(measured.in_view)
        ):
            break
    if measured is None or solved is None or lines is None:
        return None
    edges = Edges(
        np.bincount(points.contour[measured.in_view], minlength=count),
        np.bincount(points.contour[good], minlength=count),
        _median(measured.contrast[good]),
        _median(measured.level[good]),
        solved.scatter_px,
        moved,
        2.0 * lines.unit_px * (1.0 + 0.5 * float(solved.d[0] + solved.d[4])),
        float(np.abs(_rigidity(matrix)[1]).max()),
        int(np.count_nonzero(measured.in_view & points.slanted)),
        int(np.count_nonzero(good & points.slanted)),
    )
    return EdgeFit(matrix / scale, solved.information, edges)
