"""Runs of a landmark's contours: which can be told from each other, which settle the heading, and the heights at which
each is seen.

A run is contours next to each other, from the outermost of them inward. Near the pad only inner runs are whole in view;
from afar only outer ones are large enough. It knows nothing of how a landmark is chosen.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from app.landmark import Landmark
from app.review.pad_design.view import View

MIN_RUN = 2
"""Contours of the shortest run that the code table knows (Table I of the paper lists "43" and "33")."""
TRIPLE = 3
"""A run of this many contours must occur once only, by its code alone."""
CLEAR = 1.9
"""Pairs with the same code must differ by this factor in their area ratio. A measured ratio is off by a factor of 1.3
at most where a pair has 20 pixels, so it never lies nearer to the other's."""
MIN_GAP_PX = 1.0
"""A gap between two contours that appears narrower is lost to the lens's blur and the pixels'."""
INNER_PART = 0.5
"""Part of the smallest outermost side that the other contours of a run must have at least."""
OVERLAP = 1.2
"""The next run inside is seen up to this many times the height at which the one outside of it is cut, at least."""


@dataclass(frozen=True, slots=True)
class Clash:
    """Two runs of one landmark that can be taken for each other.

    Attributes:
        code: Of both.
        first: Index of the outermost contour of one.
        second: The same of the other.
        ratios: Area ratio of each, of pairs; None for longer runs.
    """

    code: str
    first: int
    second: int
    ratios: tuple[float, float] | None = None


def clashes(landmark: Landmark) -> tuple[Clash, ...]:
    """All pairs and triples of contours that occur twice: triples by their code, pairs by their area ratio too.

    Whether a run starts black or white doesn't count, although it helps: shadows and glare invert.
    """
    code = landmark.code
    found: list[Clash] = []
    for length in (MIN_RUN, TRIPLE):
        for a, b in itertools.combinations(range(len(code) - length + 1), 2):
            if code[a : a + length] != code[b : b + length]:
                continue
            if length == TRIPLE:
                found.append(Clash(code[a : a + length], a, b))
                continue
            ratios = (landmark.area_ratio(a), landmark.area_ratio(b))
            if max(ratios) < CLEAR * min(ratios):
                found.append(Clash(code[a : a + length], a, b, ratios))
    return tuple(found)


def settles_heading(code: str) -> bool:
    """Whether a run of that code looks the same after no turn.

    It does after a quarter or a third of one if squares or triangles alone are in it, and after none if both are.
    """
    return len(set(code)) > 1


@dataclass(frozen=True, slots=True)
class Proportions:
    """What of a landmark decides how it is seen; metres on the pad, for each contour.

    Attributes:
        code: Corner counts, outermost first.
        sides_m: Of a side.
        gaps_m: To the contour round it; of the outermost to the quiet zone's edge.
        radii_m: Of the circle round the pad's middle that holds it.
    """

    code: str
    sides_m: tuple[float, ...]
    gaps_m: tuple[float, ...]
    radii_m: tuple[float, ...]

    def scaled(self, factor: float) -> Proportions:
        """The same landmark at another size."""

        def times(lengths: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(length * factor for length in lengths)

        return Proportions(self.code, times(self.sides_m), times(self.gaps_m), times(self.radii_m))

    @property
    def detail_m(self) -> float:
        """The shortest side or narrowest gap that must be printed."""
        return min(*self.sides_m, *self.gaps_m)


def proportions(landmark: Landmark) -> Proportions:
    """Those of a landmark."""
    contours = landmark.contours
    zone_m = 0.5 * (landmark.quiet_zone_m - landmark.size_m)
    gaps = (float(landmark.gaps_m(k).min()) for k in range(1, len(contours)))
    radii = (float(np.hypot(*c.corners_m.T).max()) for c in contours)
    return Proportions(landmark.code, tuple(c.side_m for c in contours), (zone_m, *gaps), tuple(radii))


@dataclass(frozen=True, slots=True)
class Run:
    """Some neighbouring contours and the heights at which they are seen.

    Attributes:
        first: Index of its outermost contour.
        length: How many contours.
        code: Corner counts, outermost first.
        from_m: Height of the camera above the pad below which its outermost contour is not whole in view.
        to_m: Height above which it is too small, or one of its gaps too narrow.
    """

    first: int
    length: int
    code: str
    from_m: float
    to_m: float

    @property
    def is_seen(self) -> bool:
        """Whether there is a height at which it is seen at all."""
        return self.from_m < self.to_m


def run_heights(pad: Proportions, first: int, length: int, view: View, min_side_px: float) -> Run:
    """The heights of one run.

    Args:
        pad: The landmark's proportions.
        first: Index of the run's outermost contour.
        length: How many contours.
        view: Of the camera.
        min_side_px: What the outermost contour's side must appear as.
    """
    last = first + length
    highest = [view.highest_m(pad.sides_m[first], min_side_px)]
    highest += [view.highest_m(side, INNER_PART * min_side_px) for side in pad.sides_m[first + 1 : last]]
    highest += [view.highest_m(gap, MIN_GAP_PX) for gap in pad.gaps_m[first:last]]
    return Run(first, length, pad.code[first:last], view.lowest_m(pad.radii_m[first]), min(highest))


def all_runs(pad: Proportions, view: View, min_side_px: float) -> tuple[Run, ...]:
    """Every run of at least two contours, by its outermost contour, then its length."""
    count = len(pad.code)
    return tuple(
        run_heights(pad, first, length, view, min_side_px)
        for first in range(count)
        for length in range(MIN_RUN, count - first + 1)
    )


def heading_runs(code: str) -> tuple[tuple[int, int], ...]:
    """For each outermost contour the shortest run that settles the heading, as (first, length); none, if none does."""
    found = []
    for first in range(len(code) - 1):
        other = next((k for k in range(first + 1, len(code)) if code[k] != code[first]), None)
        if other is not None:
            found.append((first, other + 1 - first))
    return tuple(found)


def working_runs(pad: Proportions, view: View, min_side_px: float) -> tuple[Run, ...]:
    """The shortest run from each contour inward that settles the heading: what the detector lives on at each height."""
    return tuple(run_heights(pad, first, length, view, min_side_px) for first, length in heading_runs(pad.code))


Span = tuple[float, float]
"""From a height to a greater one, m."""


def covered(runs: tuple[Run, ...], overlap: float = 1.0) -> tuple[Span, ...]:
    """Heights at which at least one run is seen, from the highest down; nearer neighbours than `overlap` are apart."""
    spans = sorted(((run.from_m, run.to_m) for run in runs if run.is_seen), key=lambda span: -span[1])
    found: list[Span] = []
    for low, high in spans:
        if found and high >= found[-1][0] * overlap:
            found[-1] = (min(low, found[-1][0]), found[-1][1])
        else:
            found.append((low, high))
    return tuple(found)
