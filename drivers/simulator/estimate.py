"""PX4's own estimate of itself: the truth with errors that wander as a GNSS, a barometer and a compass make them.

Sizes are those measured on PX4 SITL: position 0.1 to 0.4 m horizontally and 0.3 to 1.0 m vertically, velocity 0.06 to
0.15 m/s. Position errors are Gauss-Markov behind one more lag, so the reported position has no steps. The origin is
where the vehicle started.

Without GNSS (optical flow, visual odometry) the horizontal velocity has a slow error beside the quick one, and the
position is what that velocity integrates to: it drifts without bound.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from drivers.simulator.plant import RigidBody
from drivers.simulator.wind import GaussMarkov

HORIZONTAL_SIGMA_M = 0.20
HORIZONTAL_TIME_S = 30.0
VERTICAL_SIGMA_M = 0.45
VERTICAL_TIME_S = 60.0
POSITION_LAG_S = 2.0
VELOCITY_SIGMA_M_S = (0.07, 0.07, 0.08)
VELOCITY_TIME_S = 0.8
DRIFT_SIGMA_M_S = 0.08
DRIFT_TIME_S = 25.0
"""Without GNSS: 1 to 2% of the way at a walk, which is what such odometry is good for."""
TILT_SIGMA_RAD = math.radians(0.35)
TILT_TIME_S = 6.0
YAW_SIGMA_RAD = math.radians(1.0)
YAW_TIME_S = 40.0
RATE_SIGMA_RAD_S = 0.01
RATE_TIME_S = 0.02


@dataclass(slots=True)
class Estimate:
    """What the flight controller believes, in its local frame (north, east, down from the start).

    Attributes:
        n: Position, m.
        e: Position.
        d: Position.
        vn: Velocity, m/s.
        ve: Velocity.
        vd: Velocity.
        d_rate: Rate of change of d, m/s: PX4's z_deriv, free of the velocity's own error.
        q: Attitude w, x, y, z.
        roll: Attitude, rad.
        pitch: Attitude.
        yaw: Attitude.
        rates: Body rates, rad/s.
    """

    n: float = 0.0
    e: float = 0.0
    d: float = 0.0
    vn: float = 0.0
    ve: float = 0.0
    vd: float = 0.0
    d_rate: float = 0.0
    q: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Estimator:
    """Adds the errors to the truth.

    Args:
        start: The vehicle where its estimator starts.
        seed: Of the errors.
        scale: Multiplies all errors; 0 reports the truth.
        gnss: False: position is the integral of velocity.

    Attributes:
        estimate: The newest.
    """

    def __init__(self, start: RigidBody, seed: int, scale: float = 1.0, *, gnss: bool = True) -> None:
        source = random.Random(seed)
        self.estimate = Estimate()
        self._origin = (start.n, start.e, start.d)

        def process(sigma: float, time_s: float) -> GaussMarkov:
            return GaussMarkov(scale * sigma, time_s, source)

        self._position = (
            process(HORIZONTAL_SIGMA_M, HORIZONTAL_TIME_S),
            process(HORIZONTAL_SIGMA_M, HORIZONTAL_TIME_S),
            process(VERTICAL_SIGMA_M, VERTICAL_TIME_S),
        )
        self._lagged = [0.0, 0.0, 0.0]
        self._velocity = tuple(process(sigma, VELOCITY_TIME_S) for sigma in VELOCITY_SIGMA_M_S)
        self._roll, self._pitch = process(TILT_SIGMA_RAD, TILT_TIME_S), process(TILT_SIGMA_RAD, TILT_TIME_S)
        self._yaw = process(YAW_SIGMA_RAD, YAW_TIME_S)
        self._rates = tuple(process(RATE_SIGMA_RAD_S, RATE_TIME_S) for _ in range(3))
        self._drift = None if gnss else (process(DRIFT_SIGMA_M_S, DRIFT_TIME_S), process(DRIFT_SIGMA_M_S, DRIFT_TIME_S))
        self._drifted = [0.0, 0.0]

    def step(self, dt: float, body: RigidBody) -> Estimate:
        """Advance the errors by dt seconds and report the vehicle."""
        report = self.estimate
        share = dt / (POSITION_LAG_S + dt)
        lagged = self._lagged
        drift_d = 0.0
        for k in range(3):
            change = share * (self._position[k].step(dt) - lagged[k])
            lagged[k] += change
            drift_d = change / dt
        slip_n, slip_e = self._velocity[0].step(dt), self._velocity[1].step(dt)
        away_n, away_e = lagged[0], lagged[1]
        if self._drift is not None:
            slip_n, slip_e = slip_n + self._drift[0].step(dt), slip_e + self._drift[1].step(dt)
            self._drifted[0] += slip_n * dt
            self._drifted[1] += slip_e * dt
            away_n, away_e = self._drifted
        report.n = body.n - self._origin[0] + away_n
        report.e = body.e - self._origin[1] + away_e
        report.d = body.d - self._origin[2] + lagged[2]
        report.vn = body.vn + slip_n
        report.ve = body.ve + slip_e
        report.vd = body.vd + self._velocity[2].step(dt)
        report.d_rate = body.vd + drift_d
        report.rates = (
            body.p + self._rates[0].step(dt),
            body.q + self._rates[1].step(dt),
            body.r + self._rates[2].step(dt),
        )
        self._attitude(body, self._roll.step(dt), self._pitch.step(dt), self._yaw.step(dt))
        return report

    def _attitude(self, body: RigidBody, roll: float, pitch: float, yaw: float) -> None:
        """The true attitude turned by small errors: tilt in the body's axes, heading about the vertical."""
        w, x, y, z = body.qw, body.qx, body.qy, body.qz
        a, b = 0.5 * roll, 0.5 * pitch
        w, x, y, z = w - x * a - y * b, x + w * a - z * b, y + w * b + z * a, z + x * b - y * a
        c, s = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        w, x, y, z = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
        k = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        k = -k if w < 0.0 else k
        w, x, y, z = w * k, x * k, y * k, z * k
        report = self.estimate
        report.q = (w, x, y, z)
        report.roll = math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
        report.pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - x * z))))
        report.yaw = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
