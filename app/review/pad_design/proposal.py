"""Chooses a pad: the smallest size, and few contours, that are seen over the heights that were asked for.

The paper's landmark is taken wherever it suffices at its own size or a smaller one. Heights and details are
proportional to a pad's size, so each pattern gives a range of sizes: from below by the ceiling and by what can be
printed, from above by the floor and by what can be carried. Where no pattern does, the one that comes nearest is given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

from app.errors import ConfigError
from app.landmark import ContourSpec, Landmark, build_landmark
from app.review.pad_design.patterns import COUNTS, Pattern, patterns
from app.review.pad_design.runs import OVERLAP, Proportions, Run, Span, covered, proportions, working_runs
from app.review.pad_design.view import View

HEADROOM = 1.05
"""A pad is seen this much above the ceiling and below the floor."""
PAPER_SIZE_M = 0.38
SMALLEST_M = 0.02
"""Pad files describe no smaller one."""
HANDY_M = 0.10
"""A smaller pad is proposed only where the floor asks for it."""
MM = 0.001
CONTOUR_COST = 0.1
"""One contour more is worth a pad that is smaller by a tenth, no more: each is one more to print and to take for
another."""
MOVED_COST = 0.05
"""The same for contours that are moved to the middle."""
_PLAIN = View(half_angle_rad=math.pi / 4, tilt_rad=0.0, offset=0.0, scale_px=1.0)
"""Reach and scale are 1: heights through another view are these over its reach, and times its scale."""


@dataclass(frozen=True, slots=True)
class Request:
    """What a pad is wanted for.

    Attributes:
        ceiling_m: Height of the camera above the pad up to which it must be seen.
        floor_m: Height down to which it must.
        max_size_m: Largest side of the outermost contour.
        min_side_px: Smallest appearance of the outermost contour's side that the detector finds.
        detail_m: Narrowest line that can be printed.
    """

    ceiling_m: float
    floor_m: float
    max_size_m: float
    min_side_px: float
    detail_m: float


@dataclass(frozen=True, slots=True)
class Design:
    """A pad, and the heights at which its runs are seen.

    Attributes:
        specs: Its contours, offsets in metres.
        landmark: The same, drawn.
        pad: Its proportions, metres.
        runs: The shortest run from each contour inward that settles the heading.
        spans: Heights at which at least one of them is seen, from the highest down.
        request: What was asked for.
        view: Of the camera.
        pattern: What it was made from.
    """

    specs: tuple[ContourSpec, ...]
    landmark: Landmark
    pad: Proportions
    runs: tuple[Run, ...]
    spans: tuple[Span, ...]
    request: Request
    view: View
    pattern: Pattern

    @property
    def reaches_ceiling(self) -> bool:
        """Whether it is seen from as high as was asked for."""
        return self.spans[0][1] >= self.request.ceiling_m

    @property
    def reaches_floor(self) -> bool:
        """Whether it is seen down to the height that was asked for."""
        return self.spans[0][0] <= self.request.floor_m

    @property
    def is_printable(self) -> bool:
        """Whether no line is narrower than can be printed."""
        return self.pad.detail_m >= self.request.detail_m - 1e-9

    @property
    def is_met(self) -> bool:
        """Whether it does all that was asked for."""
        return self.reaches_ceiling and self.reaches_floor and self.is_printable


@dataclass(frozen=True, slots=True)
class Ends:
    """How a pattern is seen at a size of one metre through one view.

    Attributes:
        pattern: Which.
        top: Greatest height at which it is seen, m.
        bottom: Lowest height down to which it is seen without a break, m.
    """

    pattern: Pattern
    top: float
    bottom: float

    def sizes(self, request: Request) -> tuple[float, float]:
        """(least, greatest) size in metres that does what was asked for; none does if the first is the larger."""
        least = max(HEADROOM * request.ceiling_m / self.top, request.detail_m / self.pattern.unit.detail_m, SMALLEST_M)
        greatest = min(request.floor_m / HEADROOM / self.bottom, request.max_size_m)
        return least, greatest

    def size_for(self, request: Request) -> float | None:
        """The size to take; None: none does."""
        least, greatest = self.sizes(request)
        if self.pattern.is_paper and least <= PAPER_SIZE_M <= greatest:
            return PAPER_SIZE_M
        for size in (_rounded_up(max(least, HANDY_M)), _rounded_up(least), math.ceil(least / MM - 1e-9) * MM):
            if least <= size <= greatest:
                return size
        return None


def _rounded_up(size_m: float) -> float:
    """To a whole centimetre, from one metre on to five."""
    step = 0.01 if size_m <= 1.0 else 0.05
    return round(math.ceil(size_m / step - 1e-9) * step, 6)


@cache
def _unscaled(count: int, min_side_px: float) -> tuple[tuple[Pattern, tuple[Run, ...]], ...]:
    """Every pattern with its working runs at a size of one metre, through a view of reach and scale 1."""
    return tuple((pattern, working_runs(pattern.unit, _PLAIN, min_side_px)) for pattern in patterns(count))


@lru_cache(maxsize=64)
def ends(count: int, view: View, min_side_px: float) -> tuple[Ends, ...]:
    """How each pattern with so many contours is seen; those that are not seen at all are left out."""
    found: list[Ends] = []
    for pattern, runs in _unscaled(count, min_side_px):
        seen = tuple(
            Run(run.first, run.length, run.code, run.from_m / view.reach, run.to_m * view.scale_px) for run in runs
        )
        spans = covered(seen, OVERLAP)
        if spans:
            found.append(Ends(pattern, spans[0][1], spans[0][0]))
    return tuple(found)


def can_be_met(view: View, request: Request) -> bool:
    """Whether some pad does what is asked for."""
    return any(one.size_for(request) is not None for count in COUNTS for one in ends(count, view, request.min_side_px))


def propose(view: View, request: Request) -> Design:
    """The pad for a request, or the one that comes nearest.

    Raises:
        ConfigError: The camera sees no pad at any height.
    """
    best: tuple[float, Ends, float] | None = None
    nearest: tuple[tuple[float, ...], Ends, float] | None = None
    smallest = max(HEADROOM * request.ceiling_m / view.highest_m(1.0, request.min_side_px), SMALLEST_M)
    for count in COUNTS:
        least_cost = math.log(smallest) + CONTOUR_COST * (count - COUNTS[0])
        if best is not None and least_cost > best[0]:
            break
        for one in ends(count, view, request.min_side_px):
            size = one.size_for(request)
            if size is not None:
                cost = _cost(one.pattern, size)
                if best is None or cost < best[0] - 1e-9:
                    best = (cost, one, size)
            elif best is None:
                size = max(SMALLEST_M, math.floor(min(one.sizes(request)[0], request.max_size_m) / MM + 1e-9) * MM)
                short = _shortfalls(one, size, request)
                if nearest is None or short < nearest[0]:
                    nearest = (short, one, size)
    if best is not None:
        return design_of(best[1].pattern, best[2], view, request)
    if nearest is None:
        raise ConfigError(
            f"a contour with sides of {request.min_side_px:g} px is not whole in view of this camera at any height",
            "give a smaller --min-side-px, --tilt or --offset, or another camera",
        )
    return design_of(nearest[1].pattern, nearest[2], view, request)


def _cost(pattern: Pattern, size_m: float) -> float:
    """What a pad costs its user: size by its logarithm, contours, contours that are not where equal gaps place them."""
    if pattern.is_paper and size_m <= PAPER_SIZE_M:
        return -math.inf
    return math.log(size_m) + CONTOUR_COST * (len(pattern.specs) - COUNTS[0]) + MOVED_COST * pattern.moved


def _shortfalls(one: Ends, size: float, request: Request) -> tuple[float, ...]:
    """By what factors (logarithms, in steps of 2%) it misses the ceiling, what can be printed, and the floor."""

    def missed(wanted: float, given: float) -> float:
        return round(50.0 * max(0.0, math.log(wanted / given)))

    return (
        missed(request.ceiling_m, size * one.top),
        missed(request.detail_m, size * one.pattern.unit.detail_m),
        missed(size * one.bottom, request.floor_m),
        float(len(one.pattern.specs)),
        float(one.pattern.moved),
        -size * one.pattern.unit.detail_m,
    )


def design_of(pattern: Pattern, size_m: float, view: View, request: Request) -> Design:
    """A pattern at a size, and how it is seen.

    Raises:
        LandmarkError: It can't be drawn (none of `patterns` at a size that pad files describe).
    """
    specs = tuple(
        ContourSpec(
            spec.shape,
            spec.area_ratio,
            round(spec.offset_forward_m * size_m, 7),
            round(spec.offset_right_m * size_m, 7),
        )
        for spec in pattern.specs
    )
    name = "paper" if pattern.is_paper else f"nested-{len(specs)}"
    landmark = build_landmark(f"{name}-{size_m * 100:.4g}cm", size_m, specs, round(size_m * 46.0 / 38.0, 4))
    pad = proportions(landmark)
    runs = working_runs(pad, view, request.min_side_px)
    return Design(specs, landmark, pad, runs, covered(runs, OVERLAP), request, view, pattern)
