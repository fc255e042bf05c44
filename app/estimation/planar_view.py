"""How a plane lies before the camera: its map made metric, and the rotations that its view suggests.

From one point of the map and its derivative there follow both poses of a flat pattern, and the level one where the
vertical is known. They are starts for app.estimation.planar, exact for a plane without noise that is seen from afar.
Source: Collins and Bartoli, "Infinitesimal plane-based pose estimation", 2014.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.estimation.axes import Axes, Vector, at_right_angles, cross, dot, weighted
from app.messages import PlaneFit

GRAZING = 0.05
"""Least cosine between the line of sight and the vertical at which a level pad is a start."""

Matrix = tuple[Vector, Vector, Vector]


@dataclass(frozen=True, slots=True)
class PlaneView:
    """The map of a plane's fit, H scaled so that it is nearly [r1 r2 t], at the middle of what was seen.

    Attributes:
        columns: Columns of H S, see PlaneFit.
        rows: Rows of its inverse.
        radius_m: Root mean square distance of what was seen from its middle.
        sight: Unit vector from the camera to that middle.
        seen: What of the pad's forward and right axes is across the line of sight.
        along: How much of them is along it, but for a common sign.
    """

    columns: Matrix
    rows: Matrix
    radius_m: float
    sight: Vector
    seen: tuple[Vector, Vector]
    along: tuple[float, float]

    def both_poses(self) -> tuple[Axes, Axes]:
        """The two rotations whose weak perspective view at the middle is the fit's."""
        (f, r), (c1, c2), s = self.seen, self.along, self.sight
        return (
            Axes(weighted(1.0, f, c1, s, 0.0, s), weighted(1.0, r, c2, s, 0.0, s)),
            Axes(weighted(1.0, f, -c1, s, 0.0, s), weighted(1.0, r, -c2, s, 0.0, s)),
        )

    def level_pose(self, down: Vector) -> Axes | None:
        """The level pad with the heading that was seen; None where it is seen edge on."""
        slant = dot(self.sight, down)
        if slant < GRAZING:
            return None
        # The axes as seen, drawn out along the line of sight until they are level.
        f, r = (weighted(1.0, a, -dot(a, down) / slant, self.sight, 0.0, a) for a in self.seen)
        v = weighted(1.0, f, 1.0, cross(r, down), 0.0, f)
        length = math.sqrt(dot(v, v))
        if length < 1e-9:
            return None
        forward = (v[0] / length, v[1] / length, v[2] / length)
        return Axes(forward, cross(down, forward))


def plane_view(plane: PlaneFit) -> PlaneView:
    """A plane as it is seen.

    Raises:
        ValueError: It is no plane before the camera, or nothing of it was seen.
    """
    info, unit = plane.information.tolist(), plane.unit_m
    total = info[2][2] + info[5][5]
    if not (math.isfinite(total) and total > 0.0):
        raise ValueError("the plane's information is none")
    # Each thing seen at (a, b) adds its weight times (a, b, 1)(a, b, 1)' to the blocks d0..d2 and d3..d5.
    a, b = (info[0][2] + info[3][5]) / total, (info[1][2] + info[4][5]) / total
    spread = (info[0][0] + info[3][3] + info[1][1] + info[4][4]) / total - a * a - b * b
    (a0, b0, c0), (a1, b1, c1), (a2, b2, c2) = plane.rays_from_pad.tolist()
    m1, m2, m3 = (a0, a1, a2), (b0, b1, b2), (c0, c1, c2)
    minors = cross(m2, m3), cross(m3, m1), cross(m1, m2)
    det = dot(minors[2], m3)
    middle = weighted(a * unit, m1, b * unit, m2, 1.0, m3)
    # A sheet is only seen from its printed side: then the triple product is positive.
    far = math.copysign(math.sqrt(dot(middle, middle)), det)
    if not abs(far * det) > 0.0:
        raise ValueError("the plane is seen edge on")
    sight = (middle[0] / far, middle[1] / far, middle[2] / far)
    x = at_right_angles(sight)
    y = cross(sight, x)
    # Columns of the derivative of the image on the tangent plane: what of r1 and r2 is across, over the depth.
    px, py, qx, qy = dot(x, m1) / far, dot(y, m1) / far, dot(x, m2) / far, dot(y, m2) / far
    pp, qq, pq = px * px + py * py, qx * qx + qy * qy, px * qx + py * qy
    size2 = 0.5 * (pp + qq + math.hypot(pp - qq, 2.0 * pq))
    size = math.sqrt(size2)
    if not size > 0.0:
        raise ValueError("the plane is seen from infinitely far")
    scale = 1.0 / (size * far)
    k, volume = scale * unit, scale * det
    ku = volume * unit
    (u0, u1, u2), (v0, v1, v2), (w0, w1, w2) = minors
    return PlaneView(
        columns=((k * a0, k * a1, k * a2), (k * b0, k * b1, k * b2), (scale * c0, scale * c1, scale * c2)),
        rows=((u0 / ku, u1 / ku, u2 / ku), (v0 / ku, v1 / ku, v2 / ku), (w0 / volume, w1 / volume, w2 / volume)),
        radius_m=unit * math.sqrt(max(spread, 0.0)),
        sight=sight,
        seen=(
            weighted(px / size, x, py / size, y, 0.0, x),
            weighted(qx / size, x, qy / size, y, 0.0, x),
        ),
        # Unit vectors have along the line of sight what they lack across; at right angles, the signs are tied.
        along=(math.sqrt(max(0.0, 1.0 - pp / size2)), math.copysign(math.sqrt(max(0.0, 1.0 - qq / size2)), -pq)),
    )
