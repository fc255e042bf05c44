"""The wind that blows on the simulated vehicle: a steady part and gusts.

Gusts are first order Gauss-Markov (Ornstein-Uhlenbeck) per axis, smoothed by one more first order lag so that the
acceleration they cause is continuous: the shape of the Dryden model's longitudinal spectrum (MIL-HDBK-1797) with one
correlation time for all airspeeds.
"""

from __future__ import annotations

import math
import random

CORRELATION_S = 1.6
"""Of the gusts: a scale of about 10 m (low over open ground) at 6 m/s."""
SMOOTHING_S = 0.25
VERTICAL_FRACTION = 0.5
"""Vertical gusts over horizontal ones near the ground."""


class GaussMarkov:
    """A scalar Ornstein-Uhlenbeck process with exact discretisation, started at zero.

    Args:
        sigma: Its standard deviation once it has forgotten its start.
        time_constant_s: Its correlation time.
        source: Where its randomness comes from.
    """

    __slots__ = ("_decay", "_drive", "_dt", "_gauss", "_sigma", "_tau", "value")

    def __init__(self, sigma: float, time_constant_s: float, source: random.Random) -> None:
        self.value = 0.0
        self._sigma = sigma
        self._tau = time_constant_s
        self._gauss = source.gauss
        self._dt = -1.0
        self._decay = 1.0
        self._drive = 0.0

    def step(self, dt: float) -> float:
        """Advance by dt seconds and return the new value."""
        if dt != self._dt:
            self._dt = dt
            self._decay = math.exp(-dt / self._tau)
            self._drive = self._sigma * math.sqrt(1.0 - self._decay * self._decay)
        self.value = self._decay * self.value + self._drive * self._gauss(0.0, 1.0)
        return self.value


class Wind:
    """Velocity of the air over the ground.

    Args:
        speed_m_s: Of the steady part.
        from_deg: Where it comes from, clockwise from north.
        gust_m_s: Standard deviation of the gusts along each horizontal axis.
        seed: Of the gusts.
    """

    def __init__(self, speed_m_s: float, from_deg: float, gust_m_s: float, seed: int) -> None:
        source = random.Random(seed)
        # Smoothing an OU process of time constant T by a lag of S leaves T / (T + S) of its variance.
        sigma = gust_m_s * math.sqrt((CORRELATION_S + SMOOTHING_S) / CORRELATION_S)
        self._steady = (
            -speed_m_s * math.cos(math.radians(from_deg)),
            -speed_m_s * math.sin(math.radians(from_deg)),
        )
        self._raw = tuple(GaussMarkov(sigma * k, CORRELATION_S, source) for k in (1.0, 1.0, VERTICAL_FRACTION))
        self._gust = [0.0, 0.0, 0.0]

    def step(self, dt: float) -> tuple[float, float, float]:
        """Advance by dt seconds; (north, east, down) velocity of the air in m/s."""
        share = dt / (SMOOTHING_S + dt)
        gust = self._gust
        for k in range(3):
            gust[k] += share * (self._raw[k].step(dt) - gust[k])
        return self._steady[0] + gust[0], self._steady[1] + gust[1], gust[2]
