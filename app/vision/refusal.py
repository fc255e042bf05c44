"""Why a candidate is not the landmark: one name, with the figure and its limit in words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Refusal(IntEnum):
    """The tests in the order in which a candidate meets them; the later, the nearer it came."""

    NO_NEST = 0
    TOO_SMALL = 1
    CUT_BY_BORDER = 2
    NOT_CONVEX = 3
    CORNERS = 4
    CODE = 5
    AREA_RATIO = 6
    NOT_CONCENTRIC = 7
    SHAPE = 8
    CONTRAST = 9
    CORRELATION = 10
    INNER_CORRELATION = 11
    HEADING = 12
    SIDES = 13


@dataclass(frozen=True, slots=True)
class Rejection:
    """One candidate's refusal.

    Attributes:
        test: Which test it failed.
        text: The same with figure and limit: "area ratio S1:S2 3.1 outside 1.6..2.5".
    """

    test: Refusal
    text: str
