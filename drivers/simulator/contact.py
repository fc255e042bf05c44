"""The feet: springs, dampers and friction against the ground or the deck that carries the landmark.

Each of the four feet touches on its own, so that a vehicle with two feet off the deck's edge tips and falls. Friction
is Coulomb's with a bristle (a spring that breaks away at mu N; Haessig and Friedland 1991), so a vehicle at rest stays
where it is on a deck that drives.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivers.simulator.pad import PadState

if TYPE_CHECKING:
    from drivers.simulator.plant import RigidBody

FOOT_FORWARD_M = 0.16
FOOT_RIGHT_M = 0.16
FOOT_DOWN_M = 0.12
STIFFNESS_N_M = 1130.0
"""Of one foot: with 1.5 kg on four a natural frequency of 55 rad/s."""
DAMPING_N_S_M = 20.0
"""Of one foot: half of critical, so about a sixth of the speed comes back from a bounce."""
FRICTION = 0.7
BRISTLE_N_M = 900.0
BRISTLE_DAMPING_N_S_M = 8.0
EDGE_DEPTH_M = 0.08
"""A foot that is deeper than this under the deck came from its side and is not on it."""
NEAR_M = 0.6
"""Contact and ground effect are worked out below this clearance."""
TIPPED_COS = 0.5
"""Over 60 degrees of tilt on the ground: it lies on its rotors."""
HARD_M_S = 3.5
"""A faster impact breaks the vehicle."""
SIDE_M = 0.3
"""Decks higher than this have a side that a vehicle can strike."""

_POINTS = (
    (FOOT_FORWARD_M, FOOT_RIGHT_M, FOOT_DOWN_M),
    (FOOT_FORWARD_M, -FOOT_RIGHT_M, FOOT_DOWN_M),
    (-FOOT_FORWARD_M, FOOT_RIGHT_M, FOOT_DOWN_M),
    (-FOOT_FORWARD_M, -FOOT_RIGHT_M, FOOT_DOWN_M),
    (0.08, 0.0, 0.07),
    (-0.08, 0.0, 0.07),
)
"""What touches: four feet, and the belly's two ends for when a foot has nothing under it."""

NORTH, EAST, DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
"""The ground's axes."""

Wrench = tuple[float, float, float, float, float, float]


class Feet:
    """Contact of the four feet.

    Attributes:
        height_m: Of the body's origin over the feet.
        touching: How many feet touch something.
        on_deck: How many of them touch the deck.
        impact_m_s: Speed into the surface at the last first touch.
    """

    def __init__(self) -> None:
        self.height_m = FOOT_DOWN_M
        self.touching = 4
        self.on_deck = 0
        self.impact_m_s = 0.0
        self._bristle = [[0.0, 0.0] for _ in _POINTS]

    @staticmethod
    def sag_m(weight_n: float) -> float:
        """How far the springs give under a weight."""
        return weight_n / (4.0 * STIFFNESS_N_M)

    def clearance_m(self, body: RigidBody, pad: PadState) -> float:
        """Of the feet over what is under the body's origin, were the vehicle level."""
        forward, right = pad.offset_m(body.n, body.e)
        deck_down = pad.surface_down_m(body.n, body.e)
        over = max(abs(forward), abs(right)) <= pad.deck_half_m and body.d < deck_down
        return (deck_down if over else 0.0) - body.d - FOOT_DOWN_M

    def near(self, body: RigidBody, pad: PadState) -> bool:
        """Whether ground or deck may be felt."""
        if body.d > -(NEAR_M + FOOT_DOWN_M):
            return True
        if body.d < pad.down_m - self._rise_m(pad) - NEAR_M - FOOT_DOWN_M:
            self.touching = self.on_deck = 0
            return False
        reach = pad.deck_half_m * 1.5 + NEAR_M
        close = abs(body.n - pad.north_m) < reach and abs(body.e - pad.east_m) < reach
        if not close:
            self.touching = self.on_deck = 0
        return close

    @staticmethod
    def _rise_m(pad: PadState) -> float:
        """How far a corner of a tilted deck may stand over its middle."""
        return 0.0 if pad.is_level else 1.5 * pad.deck_half_m * math.sin(pad.tilt_rad)

    def forces(self, body: RigidBody, m: tuple[float, ...], pad: PadState, dt: float) -> Wrench:
        """Force along north, east, down (N) and torque about forward, right, down (N m)."""
        fn = fe = fd = tp = tq = tr = 0.0
        before = self.touching
        self.touching = self.on_deck = 0
        fastest = 0.0
        half, (forward_axis, right_axis, down_axis) = pad.deck_half_m, pad.axes
        highest = min(pad.down_m, 0.0) - self._rise_m(pad)
        for (x, y, z), bristle in zip(_POINTS, self._bristle, strict=True):
            foot_d = body.d + m[6] * x + m[7] * y + m[8] * z
            if foot_d < highest:
                bristle[0] = bristle[1] = 0.0
                continue
            foot_n = body.n + m[0] * x + m[1] * y + m[2] * z
            foot_e = body.e + m[3] * x + m[4] * y + m[5] * z
            along, across, under = pad.on_deck_m(foot_n, foot_e, foot_d)
            deck = abs(along) <= half and abs(across) <= half and under < EDGE_DEPTH_M
            depth = under if deck else foot_d
            if depth < 0.0:
                bristle[0] = bristle[1] = 0.0
                continue
            # Velocity of the foot in the body's axes is rates x arm.
            bx, by, bz = body.q * z - body.r * y, body.r * x - body.p * z, body.p * y - body.q * x
            rn = body.vn + m[0] * bx + m[1] * by + m[2] * bz
            re = body.ve + m[3] * bx + m[4] * by + m[5] * bz
            rd = body.vd + m[6] * bx + m[7] * by + m[8] * bz
            first, second, into = forward_axis, right_axis, down_axis
            if deck:
                own = pad.velocity_at(foot_n, foot_e, foot_d)
                rn, re, rd = rn - own[0], re - own[1], rd - own[2]
                self.on_deck += 1
            else:
                first, second, into = NORTH, EAST, DOWN
            self.touching += 1
            speed = into[0] * rn + into[1] * re + into[2] * rd
            fastest = max(fastest, speed)
            normal = max(0.0, STIFFNESS_N_M * depth + DAMPING_N_S_M * speed)
            slide = (
                first[0] * rn + first[1] * re + first[2] * rd,
                second[0] * rn + second[1] * re + second[2] * rd,
            )
            pf, ps = self._friction(bristle, *slide, FRICTION * normal, dt)
            pn = first[0] * pf + second[0] * ps - into[0] * normal
            pe = first[1] * pf + second[1] * ps - into[1] * normal
            pd = first[2] * pf + second[2] * ps - into[2] * normal
            # The force in the body's axes, then arm x force.
            gx = m[0] * pn + m[3] * pe + m[6] * pd
            gy = m[1] * pn + m[4] * pe + m[7] * pd
            gz = m[2] * pn + m[5] * pe + m[8] * pd
            tp += y * gz - z * gy
            tq += z * gx - x * gz
            tr += x * gy - y * gx
            fn += pn
            fe += pe
            fd += pd
        if before == 0 and self.touching:
            self.impact_m_s = fastest
        return fn, fe, fd, tp, tq, tr

    @staticmethod
    def _friction(bristle: list[float], vn: float, ve: float, limit_n: float, dt: float) -> tuple[float, float]:
        """Force along two axes of its surface on one foot that slides at (vn, ve) over it."""
        bristle[0] += vn * dt
        bristle[1] += ve * dt
        pn = -BRISTLE_N_M * bristle[0] - BRISTLE_DAMPING_N_S_M * vn
        pe = -BRISTLE_N_M * bristle[1] - BRISTLE_DAMPING_N_S_M * ve
        size = math.hypot(pn, pe)
        if size > limit_n:
            pn, pe = pn / size * limit_n, pe / size * limit_n
            bristle[0], bristle[1] = -pn / BRISTLE_N_M, -pe / BRISTLE_N_M
        return pn, pe

    def wreck(self, body: RigidBody, pad: PadState) -> str | None:
        """Why the vehicle is a wreck now, or None."""
        cos_tilt = 1.0 - 2.0 * (body.qx * body.qx + body.qy * body.qy)
        if self.touching and self.impact_m_s > HARD_M_S:
            return f"hit the ground at {self.impact_m_s:.1f} m/s"
        if cos_tilt < TIPPED_COS and self.clearance_m(body, pad) < 0.0:
            return "tipped over"
        if -pad.down_m > SIDE_M and body.d > pad.surface_down_m(body.n, body.e) + EDGE_DEPTH_M:
            forward, right = pad.offset_m(body.n, body.e)
            if max(abs(forward), abs(right)) < pad.deck_half_m:
                return "struck the side of the pad's carrier"
        return None
