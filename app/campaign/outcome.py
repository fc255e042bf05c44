"""What a trial came to, told from the simulator's truth: a landing, or the named reason why not. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.messages import Phase
from app.wiring_virtual import Contact

SPEED_MAX_M_S = 1.0
"""Relative to the deck at first contact: above it a touchdown counts as a crash."""
FLY_AWAY_M_S = 2.0
"""A vehicle that still flies so fast when its mission is over and had the time to stop is on its way to nowhere."""
FLY_AWAY_HEIGHT_M = 45.0
"""So high it is on its way too: safety.height_max_m and PX4's return height are 30 m."""


AT_REST = frozenset({Phase.HOLD, Phase.IDLE})
"""Phases in which a mission is over and the vehicle should stand in the air."""


@dataclass(frozen=True, slots=True)
class TrialResult:
    """One trial.

    Attributes:
        scenario: Name.
        seed: That replays it.
        reason: Why it failed; None: it landed.
        touchdown_error_m: Of the vehicle's centre from the pad's at first contact, along the deck; None: no contact.
        touchdown_forward_m: Of that, forward.
        touchdown_right_m: Of that, to the right.
        touchdown_speed_m_s: Relative to the deck, just before.
        time_to_land_s: From the order to land to the motors' stop; None if it didn't land.
        tries: Approaches.
        simulated_s: How long the world ran.
        wall_s: How long that took.
    """

    scenario: str
    seed: int
    reason: str | None
    touchdown_error_m: float | None = None
    touchdown_forward_m: float | None = None
    touchdown_right_m: float | None = None
    touchdown_speed_m_s: float | None = None
    time_to_land_s: float | None = None
    tries: int = 0
    simulated_s: float = 0.0
    wall_s: float = 0.0

    @property
    def landed(self) -> bool:
        """A success."""
        return self.reason is None


@dataclass(frozen=True, slots=True)
class Ending:
    """How a trial stands when it ends.

    Attributes:
        contacts: From the truth, in their order.
        phase: Of the mission.
        words: The mission's own reason for being there.
        armed: The motors are armed.
        timed_out: Its time was up.
        speed_m_s: Of the vehicle over the ground.
        height_m: Of the vehicle over the ground.
    """

    contacts: tuple[Contact, ...]
    phase: Phase
    words: str
    armed: bool
    timed_out: bool
    speed_m_s: float
    height_m: float


def touchdown_of(contacts: tuple[Contact, ...]) -> Contact | None:
    """The first contact."""
    return next((contact for contact in contacts if contact.kind == "touchdown"), None)


def failure_of(ending: Ending, deck_tilt_max_deg: float) -> str | None:
    """The named reason of a failure, the gravest first; None: it landed on the pad."""
    crash = next((contact for contact in ending.contacts if contact.kind == "crash"), None)
    if crash is not None:
        return f"crash: {crash.detail}"
    for contact in ending.contacts:
        if contact.kind != "touchdown":
            continue
        if not contact.on_deck:
            return f"landed off the pad: {contact.error_m:.2f} m from its centre"
        if contact.impact_m_s > SPEED_MAX_M_S:
            return f"crash: touched down at {contact.impact_m_s:.2f} m/s, over {SPEED_MAX_M_S:g}"
    if ending.armed and ending.height_m > FLY_AWAY_HEIGHT_M:
        return f"fly-away: {ending.height_m:.0f} m high"
    if ending.armed and ending.phase in AT_REST and ending.speed_m_s > FLY_AWAY_M_S:
        return f"fly-away: {ending.speed_m_s:.1f} m/s in {ending.phase.value}"
    touchdown, rest = touchdown_of(ending.contacts), ending.contacts[-1] if ending.contacts else None
    if touchdown is not None and rest is not None and rest.kind == "rest" and not ending.armed:
        if not rest.on_deck:
            return "left the pad after touchdown"
        tilt_deg = math.degrees(touchdown.deck_tilt_rad)
        if tilt_deg > deck_tilt_max_deg:
            return f"deck tilted {tilt_deg:.1f} deg at contact, over {deck_tilt_max_deg:g}"
        if ending.phase is Phase.LANDED:
            return None
    words = ending.words.removeprefix(f"{ending.phase.value}: ")
    if ending.timed_out:
        return f"time out in {ending.phase.value}"
    return words or f"ended in {ending.phase.value}"
