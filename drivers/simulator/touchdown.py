"""When and where the vehicle came down, told from the truth. It is for the review after the flight, never for the
application.

A touchdown is the first touch after the vehicle was clear of everything for a while; a bounce is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.simulator.pad import PadState

CLEAR_FOR_S = 0.5
"""A touch counts as a new touchdown after this time without one."""
CLEAR_BY_M = 0.3
"""... in which the vehicle rose this high over where it stood."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The vehicle against the pad at one instant.

    Attributes:
        kind: "touchdown", "rest" (the motors stopped) or "crash".
        t_s: When.
        on_deck: It stands on the square that can be landed on.
        error_m: Distance of the body's origin from the landmark's centre, along the deck.
        forward_m: Of that, along the deck's forward axis.
        right_m: Of that, along the deck's right.
        relative_speed_m_s: Horizontal speed relative to the pad.
        sink_m_s: Speed downward, just before.
        tilt_rad: Of the vehicle.
        detail: Of a crash: what happened.
        deck_tilt_rad: Of the deck.
        impact_m_s: Speed relative to the deck's point under the vehicle, all three axes, just before.
    """

    kind: str
    t_s: float
    on_deck: bool
    error_m: float
    forward_m: float
    right_m: float
    relative_speed_m_s: float
    sink_m_s: float
    tilt_rad: float
    detail: str = ""
    deck_tilt_rad: float = 0.0
    impact_m_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Seen:
    """The truth that is looked at.

    Attributes:
        t_s: When.
        pos: (north, east, down), m.
        vel: (north, east, down), m/s.
        tilt_rad: Of the vehicle.
        touching: A foot touches something.
        on_deck: It is the pad's deck.
        armed: The motors are armed.
        crashed: Why it is a wreck, or None.
        clearance_m: Of the feet over what is below.
    """

    t_s: float
    pos: tuple[float, float, float]
    vel: tuple[float, float, float]
    tilt_rad: float
    touching: bool
    on_deck: bool
    armed: bool
    crashed: str | None
    clearance_m: float


class TouchdownWatch:
    """Turns a stream of truth into contacts."""

    def __init__(self) -> None:
        self._airborne = False
        self._clear_since_s: float | None = None
        self._flown = False
        self._armed = False
        self._crashed = False
        self._sink = 0.0
        self._impact = 0.0

    def step(self, seen: Seen, pad: PadState) -> list[Contact]:
        """Contacts that happened since the last call."""
        found: list[Contact] = []
        if not seen.touching:
            if self._clear_since_s is None:
                self._clear_since_s = seen.t_s
            if seen.t_s - self._clear_since_s >= CLEAR_FOR_S and seen.clearance_m >= CLEAR_BY_M:
                self._airborne = self._flown = True
            self._sink = seen.vel[2]
            self._impact = math.dist(seen.vel, pad.velocity_at(*seen.pos))
        else:
            self._clear_since_s = None
            if self._airborne:
                found.append(self._contact("touchdown", seen, pad))
                self._airborne = False
        if self._armed and not seen.armed and self._flown:
            found.append(self._contact("rest", seen, pad))
        self._armed = seen.armed
        if seen.crashed is not None and not self._crashed:
            self._crashed = True
            found.append(self._contact("crash", seen, pad))
        return found

    def _contact(self, kind: str, seen: Seen, pad: PadState) -> Contact:
        forward, right, _ = pad.on_deck_m(*seen.pos)
        own = pad.velocity_at(*seen.pos)
        return Contact(
            kind,
            seen.t_s,
            seen.on_deck,
            math.hypot(forward, right),
            forward,
            right,
            math.hypot(seen.vel[0] - own[0], seen.vel[1] - own[1]),
            self._sink,
            seen.tilt_rad,
            seen.crashed or "",
            pad.tilt_rad,
            self._impact,
        )
