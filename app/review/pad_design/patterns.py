"""The landmarks that a design chooses from, at a size of one metre: codes, area ratios, and how far inner contours are
moved to the middle.

The paper's five contours come first, with its ratios (2, 4, 2, 4). Longer codes go on as long as no run of three occurs
twice and no three triangles follow each other; where a pair's code occurs again its ratio is doubled. With two squares
outermost, seven contours are the most that two shapes allow. (Eight and nine are possible with a triangle in the
outermost square, but its white is thin from what lies in it: such a pad is lost under 28 pixels, the paper's under 12.
Nor is there a use: seven cover heights of 1 to 250 through a lens of 66 degrees, of 1 to 480 through a fisheye.)
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from app.errors import LandmarkError
from app.landmark import ContourSpec, Landmark, Shape, build_landmark
from app.review.pad_design.runs import TRIPLE, Proportions, clashes, heading_runs, proportions, settles_heading

COUNTS = range(5, 8)
"""How many contours a pad may have: the paper's five, and as many as can be told apart."""
PAPER_CODE = "44334"
BASE_RATIO = {"44": 2.0, "43": 4.0, "33": 2.0, "34": 4.0}
"""Area ratio of a pair, from outside in: the paper's. A square in a triangle can't have less than 2.01."""
MIDDLE_GAP = 0.08
"""A contour that is moved to the middle keeps this part of its parent's side as a gap: what the paper's triangles have
between them (0.0845), less a little."""
DIGITS = 4
"""Offsets are rounded to this many digits of a metre, at a size of one."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """A landmark to choose.

    Attributes:
        landmark: At a size of one metre.
        specs: What it was built of.
        unit: Its proportions.
        moved: 0: contours as equal gaps place them; 1: moved to the middle as far as no gap gets narrower by it;
            2: further.
    """

    landmark: Landmark
    specs: tuple[ContourSpec, ...]
    unit: Proportions
    moved: int

    @property
    def is_paper(self) -> bool:
        """Whether it is the paper's landmark."""
        ratios = tuple(self.landmark.area_ratio(k) for k in range(len(self.specs) - 1))
        same = all(abs(a - b) < 1e-9 for a, b in zip(ratios, (2.0, 4.0, 2.0, 4.0), strict=False))
        return self.landmark.code == PAPER_CODE and same and self.moved == 0


@cache
def codes(count: int) -> tuple[str, ...]:
    """Codes of so many contours, from outside in.

    No run of three occurs twice; three triangles don't follow each other, since a third of a turn maps them on
    themselves; the innermost pair is one of each, or the innermost contour would be of no use near the ground. Two
    squares and a triangle come first, as in the paper: found from afar, and with a heading.
    """
    found = [code for code in _grown(PAPER_CODE[:TRIPLE], count) if settles_heading(code[-2:])]
    return tuple(sorted(found, key=lambda code: (not code.startswith(PAPER_CODE), code)))


def _grown(code: str, count: int) -> Iterator[str]:
    """All codes that begin like this one, with no run of three twice and no three triangles."""
    if len(code) == count:
        yield code
        return
    for corners in "34":
        longer = code + corners
        if longer.endswith("333") or (len(longer) >= TRIPLE and longer[-TRIPLE:] in code):
            continue
        yield from _grown(longer, count)


def _ratio_lists(code: str) -> Iterator[tuple[float, ...]]:
    """Area ratios for a code: the base ratio for one of a pair's occurrences, twice it for another, and so on, in every
    order. If a triangle's in a square occurs once only, it may be twice as small too: it has more room then.
    """
    pairs = [code[k : k + 2] for k in range(len(code) - 1)]
    kinds = list(dict.fromkeys(pairs))
    choices: list[list[tuple[float, ...]]] = []
    for kind in kinds:
        ladder = [BASE_RATIO[kind] * 2.0**k for k in range(pairs.count(kind))]
        orders = list(itertools.permutations(ladder))
        if kind == "43" and len(ladder) == 1:
            orders.append((2.0 * ladder[0],))
        choices.append(orders)
    for chosen in itertools.product(*choices):
        left = {kind: iter(ratios) for kind, ratios in zip(kinds, chosen, strict=True)}
        yield tuple(next(left[pair]) for pair in pairs)


@cache
def patterns(count: int) -> tuple[Pattern, ...]:
    """All landmarks with so many contours, the most like the paper's first."""
    found: list[Pattern] = []
    for code in codes(count):
        for ratios in _ratio_lists(code):
            areas = [1.0, *itertools.accumulate((1.0 / ratio for ratio in ratios), lambda a, b: a * b)]
            shapes = (Shape.SQUARE if corners == "4" else Shape.TRIANGLE for corners in code)
            specs = tuple(ContourSpec(shape, area) for shape, area in zip(shapes, areas, strict=True))
            try:
                plain = build_landmark(code, 1.0, specs)
            except LandmarkError:
                continue
            if clashes(plain):
                continue
            found += _variants(plain, specs)
    return tuple(sorted(found, key=lambda p: p.moved))


def _variants(plain: Landmark, specs: tuple[ContourSpec, ...]) -> list[Pattern]:
    """A landmark as equal gaps place it, and with the contours that are seen last moved to the middle."""
    found = [Pattern(plain, specs, proportions(plain), 0)]
    for moved in (1, 2):
        offsets = _to_the_middle(plain, further=moved == 2)
        shifted = tuple(
            ContourSpec(spec.shape, spec.area_ratio, round(offset, DIGITS))
            for spec, offset in zip(specs, offsets, strict=True)
        )
        if shifted != found[-1].specs:
            landmark = build_landmark(plain.name, 1.0, shifted)
            found.append(Pattern(landmark, shifted, proportions(landmark), moved))
    return found


def _to_the_middle(plain: Landmark, *, further: bool) -> list[float]:
    """Forward offset of each contour that brings those seen last to the pad's middle, as far as there is room.

    Only triangles in squares move: equal gaps leave more room before their apex than beside them. They move until it
    is as narrow as those, or (further) as MIDDLE_GAP of the square's side.
    """
    last, _ = heading_runs(plain.code)[-1]
    needed = -float(plain.contours[last].centroid_m[0])
    offsets = [0.0] * len(plain.contours)
    for k in range(1, last + 1):
        if plain.code[k - 1 : k + 1] != "43" or needed <= 0.0:
            continue
        gaps, side = plain.gaps_m(k), plain.contours[k - 1].side_m
        least = min(MIDDLE_GAP * side, float(gaps.min())) if further else float(gaps.min())
        # The front side of a square is the first one; its corners begin at the front left.
        offsets[k] = max(0.0, min(needed, float(gaps[0]) - least))
        needed -= offsets[k]
    return offsets
