"""Table I: which codes are the landmark. A code is the corner counts of nested contours, outermost first ("4433").

Every contiguous run of the landmark's own code with at least two contours is legal (see the landmark's page on why this
is wider than the paper's list), at each place where it occurs.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.landmark import Landmark

MIN_RUN = 2


@dataclass(frozen=True, slots=True)
class Alignment:
    """Nested polygons [start, start + length) are the landmark's contours [first, first + length)."""

    start: int
    first: int
    length: int


def legal_codes(landmark: Landmark) -> frozenset[str]:
    """All runs of the landmark's code with at least two contours."""
    code = landmark.code
    return frozenset(code[a:b] for a in range(len(code)) for b in range(a + MIN_RUN, len(code) + 1))


def alignments(corners: tuple[int, ...], outermost_black: bool, landmark: Landmark) -> list[Alignment]:
    """Ways to read nested polygons as a legal run, longest first; runs inside a longer one that fits are left out.

    Args:
        corners: Corner count of each nested polygon, outermost first; 0 for what is no polygon.
        outermost_black: Colour inside the outermost; the others alternate.
        landmark: What is looked for.
    """
    mine = tuple(c.shape.corners for c in landmark.contours)
    found: list[Alignment] = []
    for shift in range(-len(corners) + MIN_RUN, len(mine) - MIN_RUN + 1):
        # corners[i] is compared with mine[i + shift]; colours agree for every second shift only.
        start = max(0, -shift)
        if (outermost_black == (start % 2 == 0)) != landmark.contours[start + shift].black:
            continue
        end = min(len(corners), len(mine) - shift)
        run = start
        for i in range(start, end + 1):
            if i < end and corners[i] == mine[i + shift]:
                continue
            if i - run >= MIN_RUN:
                found.append(Alignment(run, run + shift, i - run))
            run = i + 1
    return sorted(found, key=lambda a: (-a.length, a.first))
