"""The pad's heading and the rate at which it turns: a filter of two states. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.frames import Array, wrap_angle_rad

YAW_RATE_SIGMA_RAD_S2 = 0.3
"""White angular acceleration of the pad: a car at 13.5 km/h on a bend of 30 m turns at 0.125 rad/s, within half a
second of steering."""
QUARTER_TURN_RAD = math.pi / 2.0
STANDS_OUT_SIGMAS = 2.0
"""A rate of turn, and a motion, counts by what it stands out of so many of its deviations."""


def shrunk(square: float, variance: float) -> float:
    """What an estimate of this square is multiplied by so that noise counts for nothing (a positive-part James-Stein
    estimate).
    """
    return 0.0 if square == 0.0 else max(0.0, 1.0 - STANDS_OUT_SIGMAS**2 * variance / square)


@dataclass(frozen=True, slots=True)
class Heading:
    """What is known of it.

    Attributes:
        mean: (2,) heading, rad, and its rate, rad/s.
        covariance: (2, 2) of them.
        rejected: Headings that were left out in a row.
    """

    mean: Array
    covariance: Array
    rejected: int = 0

    @classmethod
    def start(cls, yaw_rad: float, sigma_rad: float) -> Heading:
        """At rest, with a rate known to 0.5 rad/s."""
        return cls(np.array([yaw_rad, 0.0]), np.diag([sigma_rad**2, 0.25]))

    @property
    def turn_rad_s(self) -> float:
        """The rate, less what may be noise."""
        rate, variance = float(self.mean[1]), float(self.covariance[1, 1])
        return shrunk(rate * rate, variance) * rate

    def update(self, yaw_rad: float, sigma_rad: float, dt_s: float, gate_sigma: float, restart_after: int) -> Heading:
        """The same dt_s later, with a heading measured to sigma_rad; the restart_after-th outlier in a row starts anew.

        A heading far off while the position fits is a mistaken quarter turn: it is left out, however unsure the filter
        has grown, for it would be taken for a rate of turn. If it lasts, the mistake was ours.
        """
        step = np.array([[1.0, dt_s], [0.0, 1.0]])
        q = YAW_RATE_SIGMA_RAD_S2**2
        noise = q * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
        mean = step @ self.mean
        covariance = step @ self.covariance @ step.T + noise
        innovation = wrap_angle_rad(yaw_rad - float(mean[0]))
        s = float(covariance[0, 0]) + sigma_rad**2
        rejected = 0
        if innovation**2 <= gate_sigma**2 * s and abs(innovation) <= QUARTER_TURN_RAD / 2:
            gain = covariance[:, 0] / s
            mean = mean + gain * innovation
            covariance = covariance - np.outer(gain, covariance[0])
        else:
            rejected = self.rejected + 1
            if rejected >= restart_after:
                return Heading.start(yaw_rad, sigma_rad)
        return Heading(np.array([wrap_angle_rad(float(mean[0])), float(mean[1])]), covariance, rejected)
