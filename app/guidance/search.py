"""The search pattern: an expanding square about an anchor (IAMSAR manual, volume III, section 3). Pure.

Legs of length s, s, 2s, 2s, 3s, 3s ... turning right each time, s being the spacing between parallel legs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from app.frames import Array
from app.guidance.limits import closing_speed_m_s, limit_norm

REACHED_M = 0.5
"""A corner counts as flown when the vehicle is this near; the camera sees much farther than that to each side."""
GAIN_1_S = 0.8


def expanding_square_m(spacing_m: float, radius_m: float) -> Array:
    """(n, 2) corners, north and east of the anchor, that begin at it; the last lies at `radius_m` or beyond."""
    corners = [np.zeros(2)]
    directions = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
    leg = 0
    while max(abs(corners[-1])) < radius_m:
        length_m = spacing_m * (leg // 2 + 1)
        corners.append(corners[-1] + length_m * np.array(directions[leg % 4]))
        leg += 1
    return np.array(corners)


@dataclass(slots=True)
class SearchPattern:
    """Flies the corners one after the other.

    Attributes:
        anchor_ned_m: (3,) centre.
        corners_m: (n, 2) relative to it.
        next_corner: Index of the corner that is flown to; n when all are flown.
    """

    anchor_ned_m: Array
    corners_m: Array
    next_corner: int = field(default=0)

    @property
    def finished(self) -> bool:
        """Every corner has been flown."""
        return self.next_corner >= len(self.corners_m)

    def velocity_ne_m_s(self, pos_ned_m: Array, speed_m_s: float, deceleration_m_s2: float) -> Array:
        """(2,) velocity to the next corner; zero when finished. Advances when a corner is reached."""
        while not self.finished:
            to_corner = self.anchor_ned_m[:2] + self.corners_m[self.next_corner] - pos_ned_m[:2]
            distance_m = float(np.linalg.norm(to_corner))
            if distance_m > REACHED_M:
                speed = closing_speed_m_s(distance_m, GAIN_1_S, speed_m_s, deceleration_m_s2)
                return limit_norm(to_corner, max(speed, 0.3))
            self.next_corner += 1
        return np.zeros(2)
