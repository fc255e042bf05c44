"""Arming, modes and failsafes, as PX4's commander has them.

The mode that was asked for (`intent`) and the mode that is flown (`mode`) differ while a failsafe acts; when its cause
goes away PX4 returns to the intent by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from app.messages import FlightMode
from drivers.simulator.params import Params

READY_AFTER_S = 3.0
"""From the start until the estimator is aligned and arming is allowed."""
STREAM_GAP_S = 0.5
"""Setpoints have to come at 2 Hz or faster,"""
STREAM_TIME_S = 0.5
"""for this long, before OFFBOARD is accepted."""
LOSS_MODES = {
    0: FlightMode.POSITION,
    1: FlightMode.ALTITUDE,
    2: FlightMode.MANUAL,
    3: FlightMode.RETURN,
    4: FlightMode.LAND,
    5: FlightMode.HOLD,
}
"""COM_OBL_RC_ACT; 6 is termination, 7 disarms."""
NOT_ARMABLE = (FlightMode.LAND, FlightMode.RETURN)


class Result(IntEnum):
    """MAV_RESULT, as far as it is answered here."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Text:
    """A line that PX4 tells the ground station.

    Attributes:
        number: Counts up from 1.
        severity: MAV_SEVERITY.
        text: At most 50 characters.
    """

    number: int
    severity: int
    text: str


class Commander:
    """The state that the autopilot's users see.

    Attributes:
        armed: Motors are armed.
        intent: The mode that was asked for.
        mode: The mode that is flown.
        taken_off: It has left the ground since it was armed.
        texts: The newest things told, oldest first, each with its number, which counts up.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._now_s = 0.0
        self._armed_at_s = 0.0
        self._landed_since_s: float | None = None
        self._stream_since_s: float | None = None
        self._last_setpoint_s: float | None = None
        self.armed = False
        self.intent = FlightMode.HOLD
        self.mode = FlightMode.HOLD
        self.taken_off = False
        self.texts: list[Text] = []
        self._told = 0

    @property
    def ready(self) -> bool:
        """Arming checks pass."""
        return self._now_s >= READY_AFTER_S

    @property
    def offboard_available(self) -> bool:
        """A live stream of setpoints, long enough."""
        if self._last_setpoint_s is None or self._stream_since_s is None:
            return False
        fresh = self._now_s - self._last_setpoint_s < STREAM_GAP_S
        return fresh and self._last_setpoint_s - self._stream_since_s >= STREAM_TIME_S

    def setpoint_arrived(self) -> None:
        """A complete offboard setpoint came in."""
        last = self._last_setpoint_s
        if last is None or self._now_s - last > STREAM_GAP_S:
            self._stream_since_s = self._now_s
        self._last_setpoint_s = self._now_s

    def arm(self, force: bool = False) -> Result:
        """Arm the motors, if the checks pass or are overridden."""
        if self.armed:
            return Result.ACCEPTED
        why = None
        if not self.ready:
            why = "Arming denied: vehicle is not ready"
        elif self.mode is FlightMode.OFFBOARD and not self.offboard_available:
            why = "Arming denied: no offboard signal"
        elif self.mode in NOT_ARMABLE:
            why = f"Arming denied: mode {self.mode.value}"
        if why and not force:
            self._say(2, why)
            return Result.TEMPORARILY_REJECTED
        self.armed, self._armed_at_s, self.taken_off, self._landed_since_s = True, self._now_s, False, None
        self._say(6, "Armed by external command")
        return Result.ACCEPTED

    def disarm(self, landed: bool, force: bool = False) -> Result:
        """Stop the motors: refused in the air, unless forced."""
        if not self.armed:
            return Result.ACCEPTED
        if not landed and not force:
            self._say(2, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self._stop("Kill" if force and not landed else "Disarmed by external command")
        return Result.ACCEPTED

    def set_mode(self, mode: FlightMode) -> Result:
        """Change the intent: a user's, a companion's or the pilot's own choice."""
        if mode is FlightMode.OFFBOARD and not self.offboard_available:
            self._say(2, "Switching to Offboard is currently not available")
            return Result.TEMPORARILY_REJECTED
        self.intent = self.mode = mode
        return Result.ACCEPTED

    def step(self, now_s: float, landed: bool) -> None:
        """Failsafes and disarming by itself. now_s: seconds since the autopilot started."""
        self._now_s = now_s
        if not self.armed:
            return
        self.taken_off = self.taken_off or not landed
        self._watch_offboard()
        self._disarm_on_ground(landed)

    def _watch_offboard(self) -> None:
        if self.intent is not FlightMode.OFFBOARD:
            return
        last = self._last_setpoint_s
        lost = last is None or self._now_s - last > self._params["COM_OF_LOSS_T"]
        if lost and self.mode is FlightMode.OFFBOARD:
            action = int(self._params["COM_OBL_RC_ACT"])
            if action == 7:
                self._stop("Failsafe: disarmed, no offboard signal")
                return
            self.mode = LOSS_MODES.get(action, FlightMode.HOLD)
            self._say(3, f"Failsafe: no offboard signal, {self.mode.value}")
        elif not lost and self.mode is not FlightMode.OFFBOARD:
            self.mode = FlightMode.OFFBOARD
            self._say(6, "Failsafe cleared, offboard again")

    def _disarm_on_ground(self, landed: bool) -> None:
        if not landed:
            self._landed_since_s = None
            return
        if self._landed_since_s is None:
            self._landed_since_s = self._now_s
        if self.taken_off:
            wait_s = self._params["COM_DISARM_LAND"]
            if wait_s > 0 and self._now_s - self._landed_since_s >= wait_s:
                self._stop("Disarmed by landing")
        else:
            wait_s = self._params["COM_DISARM_PRFLT"]
            if wait_s > 0 and self._now_s - self._armed_at_s >= wait_s:
                self._stop("Disarmed by auto preflight disarming")

    def _stop(self, why: str) -> None:
        self.armed = False
        if self.mode is not self.intent:
            self.intent = self.mode
        self._say(6, why)

    def _say(self, severity: int, text: str) -> None:
        self._told += 1
        self.texts.append(Text(self._told, severity, text[:50]))
        del self.texts[:-20]
