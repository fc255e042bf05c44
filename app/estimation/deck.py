"""The deck's attitude over time: how far a boat leans now and in half a second. Pure.

Two filters of two states each, on the north and the east part of the deck's normal and their rates; the angular
acceleration is white noise of the size that waves make: 8 degrees at a period of 7 s is 6.5 degrees/s2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.frames import Array

ANGULAR_SIGMA_RAD_S2 = math.radians(7.0)
RATE_SIGMA_AT_START_RAD_S = math.radians(8.0)
GAP_MAX_S = 1.0
"""Without a fix for so long the deck leans anyhow: begin anew."""


@dataclass(frozen=True, slots=True)
class DeckTilt:
    """The deck's lean.

    Attributes:
        t_s: The time that it is valid at.
        mean: (2, 2) rows: lean, its rate; columns: north, east part of the normal, rad.
        covariance: (2, 2) of (lean, rate), the same for both parts.
    """

    t_s: float
    mean: Array
    covariance: Array

    def at(self, t_s: float) -> DeckTilt:
        """Carried to another time."""
        dt = t_s - self.t_s
        step = np.array([[1.0, dt], [0.0, 1.0]])
        age = abs(dt)
        noise = ANGULAR_SIGMA_RAD_S2**2 * np.array([[age**3 / 3, age**2 / 2], [age**2 / 2, age]])
        return DeckTilt(t_s, step @ self.mean, step @ self.covariance @ step.T + noise)

    def update(self, normal_ne: Array, sigma_rad: float, t_s: float) -> DeckTilt:
        """With a measured normal's north and east part."""
        if not 0.0 < t_s - self.t_s <= GAP_MAX_S:
            return start(normal_ne, sigma_rad, t_s)
        predicted = self.at(t_s)
        s = float(predicted.covariance[0, 0]) + sigma_rad**2
        gain = predicted.covariance[:, 0] / s
        mean = predicted.mean + np.outer(gain, normal_ne - predicted.mean[0])
        return DeckTilt(t_s, mean, predicted.covariance - np.outer(gain, predicted.covariance[0]))


def start(normal_ne: Array, sigma_rad: float, t_s: float) -> DeckTilt:
    """From one measurement."""
    mean = np.array([normal_ne, np.zeros(2)], dtype=np.float64)
    return DeckTilt(t_s, mean, np.diag([sigma_rad**2, RATE_SIGMA_AT_START_RAD_S**2]))
