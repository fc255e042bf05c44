"""PX4's multicopter land detector: three stages that each have to hold for LNDMC_TRIG_TIME.

Ground contact: little thrust while a descent is commanded and nothing moves. Maybe landed: hardly any thrust and no
rotation either. Landed: that, longer. It looks at thrust and speeds, never at a height, which is why a deck that
drives faster than LNDMC_XY_VEL_MAX is never ground to it. (PX4 divides the time by three and triples it again where a
range finder exists but is out of range, as in SIH; the figures measured there are with the whole time for each stage.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.simulator.params import Params

CONTACT_THRUST = 0.6
"""Ground contact: below this share of the way from least thrust to hover."""
MAYBE_LANDED_THRUST = 0.1
FREE_FALL_M_S2 = 2.0
FREE_FALL_TIME_S = 0.3
ROTATION_RELAXED = 2.5
"""Once landed, rotation and vertical speed may be this much larger."""


class Hysteresis:
    """True after a condition held for a time; false at once when it doesn't."""

    __slots__ = ("_since_s", "state")

    def __init__(self, state: bool = False) -> None:
        self.state = state
        self._since_s: float | None = None

    def update(self, condition: bool, now_s: float, time_s: float) -> bool:
        """The state now."""
        if not condition:
            self.state, self._since_s = False, None
        elif self._since_s is None:
            self._since_s = now_s
        if self._since_s is not None and now_s - self._since_s >= time_s:
            self.state = True
        return self.state


@dataclass(frozen=True, slots=True)
class LandInputs:
    """What the detector looks at.

    Attributes:
        armed: Motors armed.
        thrust: Demanded collective, fraction of the whole.
        climb_rate_controlled: A velocity loop runs, so a commanded descent can be told.
        velocity_demand_down: Vertical velocity of the setpoint, m/s; NaN: none.
        vertical_speed: Estimated, m/s.
        height_rate: Derivative of the estimated height, m/s.
        horizontal_speed: Estimated, m/s.
        tilt_rate: Rate about forward and right together, rad/s.
        specific_force: Size, m/s^2.
    """

    armed: bool
    thrust: float
    climb_rate_controlled: bool
    velocity_demand_down: float
    vertical_speed: float
    height_rate: float
    horizontal_speed: float
    tilt_rate: float
    specific_force: float


class LandDetector:
    """The three stages.

    Attributes:
        ground_contact: First stage.
        maybe_landed: Second stage.
        landed: Third stage.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._contact, self._maybe, self._landed = Hysteresis(True), Hysteresis(True), Hysteresis(True)
        self._falling = Hysteresis()

    @property
    def ground_contact(self) -> bool:
        """It touches something that stops its descent."""
        return self._contact.state

    @property
    def maybe_landed(self) -> bool:
        """It hardly needs thrust any more."""
        return self._maybe.state

    @property
    def landed(self) -> bool:
        """It has landed."""
        return self._landed.state

    def step(self, now_s: float, seen: LandInputs) -> None:
        """One turn."""
        get = self._params
        least, hover = get["MPC_THR_MIN"], get["MPC_THR_HOVER"]
        stage_s = get["LNDMC_TRIG_TIME"]
        relaxed = ROTATION_RELAXED if self.landed else 1.0
        falling = self._falling.update(seen.specific_force < FREE_FALL_M_S2, now_s, FREE_FALL_TIME_S)

        slowest = get["LNDMC_Z_VEL_MAX"]
        at_rest = min(abs(seen.vertical_speed), abs(seen.height_rate)) < slowest * relaxed
        at_rest = at_rest and seen.horizontal_speed <= get["LNDMC_XY_VEL_MAX"]
        contact = at_rest and seen.thrust <= least + CONTACT_THRUST * (hover - least)
        if seen.climb_rate_controlled and not self.maybe_landed and not self.landed:
            contact = contact and seen.velocity_demand_down >= 1.1 * slowest
        contact_state = self._contact.update(not seen.armed or contact, now_s, stage_s)

        idle = seen.thrust <= least + MAYBE_LANDED_THRUST * (hover - least)
        still = seen.tilt_rate <= math.radians(get["LNDMC_ROT_MAX"]) * relaxed
        maybe = not seen.armed or (idle and still and not falling and contact_state)
        maybe_state = self._maybe.update(maybe, now_s, stage_s)
        self._landed.update(not seen.armed or maybe_state, now_s, stage_s)
