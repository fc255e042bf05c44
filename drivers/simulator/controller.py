"""PX4's cascade from a position, velocity and acceleration setpoint to body rates and thrust.

The control law is the one PX4 documents for its multicopters (P on position, PID on velocity giving an acceleration,
thrust direction from it, quaternion attitude control giving rates) with PX4's default gains, read from params.py; so
step responses have PX4's shape: for a horizontal step of velocity about 0.2 s until it moves, 63% at 0.7 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.simulator.estimate import Estimate
from drivers.simulator.params import Params
from drivers.simulator.plant import GRAVITY_M_S2

NAN = math.nan
DERIVATIVE_CUTOFF_HZ = 5.0
"""PX4's MPC_VELD_LP: low pass of the measured acceleration."""
HORIZONTAL_THRUST_MARGIN = 0.3
"""PX4's MPC_THR_XY_MARG."""
RATE_MAX_RAD_S = (math.radians(220.0), math.radians(220.0), math.radians(200.0))
"""PX4's MC_ROLLRATE_MAX, MC_PITCHRATE_MAX, MC_YAWRATE_MAX."""

Vector = tuple[float, float, float]
NO_VECTOR: Vector = (NAN, NAN, NAN)


@dataclass(frozen=True, slots=True)
class Demand:
    """A setpoint in the local frame; NaN marks what is not controlled.

    Attributes:
        position: North, east, down, m.
        velocity: m/s.
        acceleration: m/s^2.
        yaw: rad; NaN keeps the heading.
        yaw_rate: rad/s, fed forward; NaN for none.
    """

    position: Vector = NO_VECTOR
    velocity: Vector = NO_VECTOR
    acceleration: Vector = NO_VECTOR
    yaw: float = NAN
    yaw_rate: float = NAN

    @property
    def complete(self) -> bool:
        """Each axis has something to follow, as PX4 asks."""
        return all(
            not (math.isnan(p) and math.isnan(v) and math.isnan(a))
            for p, v, a in zip(self.position, self.velocity, self.acceleration, strict=True)
        )


@dataclass(frozen=True, slots=True)
class Limits:
    """What bounds the controller at this time.

    Attributes:
        speed_up: m/s; negative during the take-off ramp: the vehicle is pushed onto the ground.
        speed_down: m/s.
        tilt: rad.
        thrust_min: Fraction of the whole thrust.
    """

    speed_up: float
    speed_down: float
    tilt: float
    thrust_min: float


def _or_zero(value: float) -> float:
    return 0.0 if math.isnan(value) else value


class PositionController:
    """From a demand to a thrust vector.

    Attributes:
        thrust: (3,) demanded thrust, north east down, as a fraction of the whole thrust.
        collective: Its size.
        yaw: Demanded heading, rad.
        yaw_rate: Demanded rate, rad/s.
        velocity_demand: (3,) the demand after the position loop and the limits, m/s.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._integral = [0.0, 0.0, 0.0]
        self._last_velocity: Vector | None = None
        self._slope = [0.0, 0.0, 0.0]
        self.thrust: Vector = (0.0, 0.0, 0.0)
        self.yaw = 0.0
        self.yaw_rate = 0.0
        self.velocity_demand: Vector = (0.0, 0.0, 0.0)

    @property
    def collective(self) -> float:
        """Size of the demanded thrust."""
        n, e, d = self.thrust
        return math.sqrt(n * n + e * e + d * d)

    def reset(self) -> None:
        """Forget the integrals (PX4 does so on the ground)."""
        self._integral = [0.0, 0.0, 0.0]

    def update(self, dt: float, demand: Demand, now: Estimate, limits: Limits) -> None:
        """One turn of the loop."""
        velocity = self._velocity_demand(demand, now, limits)
        self.velocity_demand = velocity
        measured = self._measure(dt, demand, now)
        self._velocity_loop(dt, velocity, measured, demand, limits)
        self.yaw = now.yaw if math.isnan(demand.yaw) else demand.yaw
        self.yaw_rate = _or_zero(demand.yaw_rate)

    def _velocity_demand(self, demand: Demand, now: Estimate, limits: Limits) -> Vector:
        """Velocity fed forward plus the position loop's; the position loop has the right of way at the limit."""
        get = self._params
        gains = (get["MPC_XY_P"], get["MPC_XY_P"], get["MPC_Z_P"])
        here = (now.n, now.e, now.d)
        loop = [_or_zero((p - x) * k) for p, x, k in zip(demand.position, here, gains, strict=True)]
        total = [
            p if math.isnan(v) and not math.isnan(demand.position[k]) else v + p
            for k, (v, p) in enumerate(zip(demand.velocity, loop, strict=True))
        ]
        fastest = get["MPC_XY_VEL_MAX"]
        if math.hypot(_or_zero(total[0]), _or_zero(total[1])) > fastest:
            size = math.hypot(loop[0], loop[1])
            if size >= fastest:
                total[0], total[1] = loop[0] / size * fastest, loop[1] / size * fastest
            else:
                extra = (total[0] - loop[0], total[1] - loop[1])
                share = _largest_share((loop[0], loop[1]), extra, fastest)
                total[0], total[1] = loop[0] + share * extra[0], loop[1] + share * extra[1]
        if not math.isnan(total[2]):
            total[2] = max(-limits.speed_up, min(limits.speed_down, total[2]))
        return total[0], total[1], total[2]

    def _measure(self, dt: float, demand: Demand, now: Estimate) -> Vector:
        """The velocity that the loop closes on, and its low-passed slope (in self._slope)."""
        down = now.vd
        wanted = demand.velocity[2]
        if math.isnan(demand.position[2]) and not math.isnan(wanted) and abs(wanted) > 1e-7:
            # With no height to hold PX4 trusts the derivative of its height more than its vertical velocity.
            weight = min(1.0, abs(wanted) / self._params["MPC_LAND_SPEED"])
            down = weight * now.d_rate + (1.0 - weight) * now.vd
        velocity = (now.vn, now.ve, down)
        if self._last_velocity is not None:
            share = dt / (dt + 1.0 / (2.0 * math.pi * DERIVATIVE_CUTOFF_HZ))
            for k in range(3):
                self._slope[k] += share * ((velocity[k] - self._last_velocity[k]) / dt - self._slope[k])
        self._last_velocity = velocity
        return velocity

    def _velocity_loop(self, dt: float, wanted: Vector, measured: Vector, demand: Demand, limits: Limits) -> None:
        """PID on velocity, thrust from acceleration, anti-windup."""
        get, integral = self._params, self._integral
        integral[2] = max(-GRAVITY_M_S2, min(GRAVITY_M_S2, integral[2]))
        p = (get["MPC_XY_VEL_P_ACC"], get["MPC_XY_VEL_P_ACC"], get["MPC_Z_VEL_P_ACC"])
        d = (get["MPC_XY_VEL_D_ACC"], get["MPC_XY_VEL_D_ACC"], get["MPC_Z_VEL_D_ACC"])
        error = [w - v for w, v in zip(wanted, measured, strict=True)]
        acceleration = [0.0, 0.0, 0.0]
        for k in range(3):
            loop = error[k] * p[k] + integral[k] - self._slope[k] * d[k]
            feed = demand.acceleration[k]
            acceleration[k] = _or_zero(feed) if math.isnan(loop) else loop + _or_zero(feed)
        hover = get["MPC_THR_HOVER"]
        thrust = _thrust_of(acceleration, hover, limits)
        if (thrust[2] >= -limits.thrust_min and error[2] >= 0.0) or (thrust[2] <= -1.0 and error[2] <= 0.0):
            error[2] = 0.0
        size = math.hypot(thrust[0], thrust[1])
        kept = min(size, HORIZONTAL_THRUST_MARGIN)
        thrust[2] = max(thrust[2], -math.sqrt(1.0 - kept * kept))
        room = math.sqrt(max(0.0, 1.0 - thrust[2] * thrust[2]))
        if size > room:
            thrust[0], thrust[1] = thrust[0] / size * room, thrust[1] / size * room
        made = (thrust[0] * GRAVITY_M_S2 / hover, thrust[1] * GRAVITY_M_S2 / hover)
        if math.hypot(acceleration[0], acceleration[1]) > math.hypot(*made):
            back = 2.0 / p[0]
            error[0] -= back * (acceleration[0] - made[0])
            error[1] -= back * (acceleration[1] - made[1])
        gains = (get["MPC_XY_VEL_I_ACC"], get["MPC_XY_VEL_I_ACC"], get["MPC_Z_VEL_I_ACC"])
        for k in range(3):
            integral[k] += _or_zero(error[k]) * gains[k] * dt
        if math.isnan(wanted[0]) or math.isnan(wanted[1]):
            integral[0] = integral[1] = 0.0
        self.thrust = (thrust[0], thrust[1], thrust[2])


def _largest_share(base: tuple[float, float], extra: tuple[float, float], limit: float) -> float:
    """The largest s in 0..1 with |base + s extra| <= limit, |base| being under it."""
    a = extra[0] ** 2 + extra[1] ** 2
    b = base[0] * extra[0] + base[1] * extra[1]
    c = base[0] ** 2 + base[1] ** 2 - limit**2
    return (-b + math.sqrt(max(0.0, b * b - a * c))) / a if a > 0.0 else 0.0


def _thrust_of(acceleration: list[float], hover: float, limits: Limits) -> list[float]:
    """Thrust vector (fraction of the whole) of an acceleration: gravity straight down, tilt limited."""
    x, y = -acceleration[0], -acceleration[1]
    z = GRAVITY_M_S2  # MPC_ACC_DECOUPLE: the direction doesn't follow the vertical acceleration
    side = math.hypot(x, y)
    most = z * math.tan(limits.tilt)
    if side > most:
        x, y, side = x / side * most, y / side * most, most
    norm = math.sqrt(side * side + z * z)
    bx, by, bz = x / norm, y / norm, z / norm
    down = acceleration[2] * hover / GRAVITY_M_S2 - hover
    collective = min(down / bz, -limits.thrust_min)
    return [bx * collective, by * collective, bz * collective]


def attitude_rates(thrust: Vector, yaw: float, yaw_rate: float, now: Estimate, params: Params) -> Vector:
    """Body rates (rad/s) that turn the vehicle's thrust along `thrust` and its nose to `yaw`.

    Tilt first, heading with the lesser gain: the reduced attitude control of Brescianini, Hehn and D'Andrea,
    "Nonlinear Quadrocopter Attitude Control" (2013), which PX4 uses.
    """
    size = math.sqrt(thrust[0] ** 2 + thrust[1] ** 2 + thrust[2] ** 2)
    wn, we, wd = (-thrust[0] / size, -thrust[1] / size, -thrust[2] / size) if size > 1e-6 else (0.0, 0.0, 1.0)
    w, x, y, z = now.q
    # The wanted body-down axis in the body's axes.
    bx = (1 - 2 * (y * y + z * z)) * wn + 2 * (x * y + w * z) * we + 2 * (x * z - w * y) * wd
    by = 2 * (x * y - w * z) * wn + (1 - 2 * (x * x + z * z)) * we + 2 * (y * z + w * x) * wd
    bz = 2 * (x * z + w * y) * wn + 2 * (y * z - w * x) * we + (1 - 2 * (x * x + y * y)) * wd
    # Shortest rotation from (0, 0, 1) to it: axis (-by, bx, 0) / sin; 2 sin(angle / 2) along it.
    k = math.sqrt(2.0 / max(1e-6, 1.0 + bz))
    p = params["MC_ROLL_P"] * -by * k
    q = params["MC_PITCH_P"] * bx * k
    turn = (yaw - now.yaw + math.pi) % (2.0 * math.pi) - math.pi
    r = params["MC_YAW_P"] * turn
    # The rate fed forward is about the vertical: its share about each body axis is the last row of ned_from_body.
    p += 2 * (x * z - w * y) * yaw_rate
    q += 2 * (y * z + w * x) * yaw_rate
    r += (1 - 2 * (x * x + y * y)) * yaw_rate
    limit_p, limit_q, limit_r = RATE_MAX_RAD_S
    return (max(-limit_p, min(limit_p, p)), max(-limit_q, min(limit_q, q)), max(-limit_r, min(limit_r, r)))
