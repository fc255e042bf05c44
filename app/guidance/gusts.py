"""What gusts do to the vehicle, from how it leans and how it moves; the feed-forward that takes them out. Pure.

The thrust of a vehicle that flies level accelerates it by g tan(lean) where it leans to; what it speeds up by beyond
that is the air's doing (a disturbance observer, after Ohnishi 1987). PX4's own integral holds against the steady part
of the wind, within seconds, and its velocity and position errors against the rest: a gust of 2 m/s pushes the vehicle
15 cm off the pad before they have caught up. The acceleration that is found here is fed forward in their place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.frames import Array, rotation_from_quaternion

GRAVITY_M_S2 = 9.80665
FAST_S = 0.2
"""Time constant of the estimate: PX4's velocity errs by 0.07 m/s for 0.8 s at a time, which it takes for a gust of
0.2 m/s2, a quarter of what a gust of 2 m/s does."""
SLOW_S = 5.0
"""What lasts longer is PX4's integral's (MPC_XY_VEL_I_ACC / MPC_XY_VEL_P_ACC is 1 / 4.5 s), and none of it is fed
forward: the wind of a drive, an attitude that is off by a third of a degree."""
GAP_MAX_S = 0.3


@dataclass(frozen=True, slots=True)
class Gusts:
    """The memory of the observer.

    Attributes:
        t_s: Of the vehicle's state that it was last given.
        vel_ne_m_s: (2,) velocity that thrust and the estimate explain.
        push_ne_m_s2: (2,) what the air does.
        steady_ne_m_s2: (2,) of that, what lasts.
    """

    t_s: float
    vel_ne_m_s: Array
    push_ne_m_s2: Array
    steady_ne_m_s2: Array

    @property
    def gust_ne_m_s2(self) -> Array:
        """(2,) what the air does beyond what lasts."""
        return self.push_ne_m_s2 - self.steady_ne_m_s2


def thrust_ne_m_s2(q_ned_from_body_wxyz: Array) -> Array:
    """(2,) horizontal acceleration by the thrust of a vehicle that keeps its height: g tan(lean)."""
    down_axis = rotation_from_quaternion(q_ned_from_body_wxyz)[:, 2]
    return -GRAVITY_M_S2 * down_axis[:2] / max(0.5, float(down_axis[2]))


def step_gusts(memory: Gusts | None, q_ned_from_body_wxyz: Array, vel_ne_m_s: Array, t_s: float) -> Gusts:
    """The next memory, from a vehicle in the air; after a gap, or from none, it begins anew with all that it sees taken
    for lasting.
    """
    thrust = thrust_ne_m_s2(q_ned_from_body_wxyz)
    if memory is not None and t_s == memory.t_s:
        return memory
    if memory is None or not 0.0 < t_s - memory.t_s <= GAP_MAX_S:
        # At constant velocity the air holds against the thrust.
        return Gusts(t_s, np.array(vel_ne_m_s) + FAST_S * thrust, -thrust, -thrust)
    dt_s = t_s - memory.t_s
    explained = memory.vel_ne_m_s + dt_s * (thrust + memory.push_ne_m_s2)
    push = (vel_ne_m_s - explained) / FAST_S
    steady = memory.steady_ne_m_s2 + dt_s / (SLOW_S + dt_s) * (push - memory.steady_ne_m_s2)
    return Gusts(t_s, explained, push, steady)
