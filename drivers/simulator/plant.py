"""The quadrotor as a rigid body: attitude, thrust, drag in the wind, feet on the ground or on the pad's deck.

A pure stepper in plain floats (a step costs tens of microseconds, small arrays would cost ten times that). Its inputs
are what a flight controller's mixer achieves: body rates and a collective thrust. World axes: north, east, down from
the vehicle's start, ground at 0 down. The feet's springs and friction are in contact.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.simulator.contact import Feet
from drivers.simulator.pad import PadState

GRAVITY_M_S2 = 9.80665
CONTACT_SUBSTEPS = 4
"""The feet's springs need a finer step than flight."""
ROTOR_SPAN_M = 0.12
"""Radius in the ground effect of Cheeseman and Bennett (ARC R&M 3021): thrust grows by 1 / (1 - (R / 4z)^2)."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """The vehicle's figures.

    Attributes:
        mass_kg: Mass.
        inertia_kg_m2: About forward, right, down.
        thrust_max_n: All motors together, so hover is at half of it.
        motor_lag_s: First order lag of the thrust (SIH's SIH_T_TAU).
        rate_lag_s: First order lag of the body rates under their own control loop.
        angular_acceleration_max_rad_s2: Of that loop, about forward, right, down.
        drag_linear_n_s_m: Force per speed through the air with the rotors at hover speed (rotor drag; it goes with
            the rotors' speed, Kai, Allibert, Hua and Hamel 2017, so rotors that stand have none).
        drag_quadratic_n_s2_m2: Force per squared speed (body drag).
        angular_damping_n_m_s: Torque per rate.
    """

    mass_kg: float = 1.5
    inertia_kg_m2: tuple[float, float, float] = (0.025, 0.025, 0.040)
    thrust_max_n: float = 30.0
    motor_lag_s: float = 0.05
    rate_lag_s: float = 0.045
    angular_acceleration_max_rad_s2: tuple[float, float, float] = (50.0, 50.0, 8.0)
    drag_linear_n_s_m: float = 0.38
    drag_quadratic_n_s2_m2: float = 0.02
    angular_damping_n_m_s: float = 0.002

    @property
    def hover_thrust(self) -> float:
        """Fraction of the whole thrust that carries the weight."""
        return self.mass_kg * GRAVITY_M_S2 / self.thrust_max_n


@dataclass(slots=True)
class RigidBody:
    """Position, velocity, attitude and body rates, in plain floats.

    Attributes:
        n: North, metres.
        e: East.
        d: Down.
        vn: Velocity, m/s.
        ve: Velocity.
        vd: Velocity.
        qw: Attitude ned_from_body.
        qx: Attitude.
        qy: Attitude.
        qz: Attitude.
        p: Rate about forward, rad/s.
        q: Rate about right.
        r: Rate about down.
    """

    n: float = 0.0
    e: float = 0.0
    d: float = 0.0
    vn: float = 0.0
    ve: float = 0.0
    vd: float = 0.0
    qw: float = 1.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    p: float = 0.0
    q: float = 0.0
    r: float = 0.0

    def rotation(self) -> tuple[float, float, float, float, float, float, float, float, float]:
        """ned_from_body, row by row."""
        w, x, y, z = self.qw, self.qx, self.qy, self.qz
        return (
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        )  # fmt: skip

    def turn(self, dt: float) -> None:
        """Integrate the attitude by the body rates over dt (exact for a constant rate)."""
        p, q, r = self.p, self.q, self.r
        rate = math.sqrt(p * p + q * q + r * r)
        half = 0.5 * rate * dt
        k = 0.5 * dt if half < 1e-9 else math.sin(half) / rate
        cw, cx, cy, cz = math.cos(half), p * k, q * k, r * k
        w, x, y, z = self.qw, self.qx, self.qy, self.qz
        nw = w * cw - x * cx - y * cy - z * cz
        nx = w * cx + x * cw + y * cz - z * cy
        ny = w * cy - x * cz + y * cw + z * cx
        nz = w * cz + x * cy - y * cx + z * cw
        scale = 1.0 / math.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
        self.qw, self.qx, self.qy, self.qz = nw * scale, nx * scale, ny * scale, nz * scale


class Plant:
    """The vehicle, at rest on the ground at the start.

    Attributes:
        body: Its state.
        airframe: Its figures.
        feet: Its contact with ground and deck.
        specific_force: (3,) acceleration without gravity in the body's axes: what an accelerometer reads.
        crashed: Why it is a wreck (tipped over, hit hard, struck the side of the pad's carrier), or None.
    """

    def __init__(self, airframe: Airframe | None = None, heading_rad: float = 0.0) -> None:
        self.airframe = airframe or Airframe()
        self.feet = Feet()
        sag = self.feet.sag_m(self.airframe.mass_kg * GRAVITY_M_S2)
        self.body = RigidBody(
            d=sag - self.feet.height_m, qw=math.cos(heading_rad / 2.0), qz=math.sin(heading_rad / 2.0)
        )
        self.specific_force = (0.0, 0.0, -GRAVITY_M_S2)
        self.crashed: str | None = None
        self._thrust_n = 0.0
        self._motors_on = False
        self._rates = (0.0, 0.0, 0.0)
        self._thrust_fraction = 0.0

    @property
    def height_m(self) -> float:
        """Of the feet over the ground, were the vehicle level."""
        return -self.body.d - self.feet.height_m

    def command(self, motors_on: bool, rates: tuple[float, float, float], thrust: float) -> None:
        """What the flight controller asks: body rates in rad/s and a fraction of the whole thrust."""
        self._motors_on = motors_on
        self._rates = rates
        self._thrust_fraction = min(1.0, max(0.0, thrust))

    def step(self, dt: float, wind: tuple[float, float, float], pad: PadState) -> None:
        """Advance by dt seconds in a wind (north, east, down, m/s), over ground and pad."""
        near = self.feet.near(self.body, pad)
        steps = CONTACT_SUBSTEPS if near else 1
        for _ in range(steps):
            self._substep(dt / steps, wind, pad, near)
        if self.crashed is None and near:
            self.crashed = self.feet.wreck(self.body, pad)

    def _substep(self, dt: float, wind: tuple[float, float, float], pad: PadState, near: bool) -> None:
        """One semi-implicit Euler step of the rigid body."""
        body, frame = self.body, self.airframe
        motors = self._motors_on and self.crashed is None
        wanted_n = self._thrust_fraction * frame.thrust_max_n if motors else 0.0
        self._thrust_n += (wanted_n - self._thrust_n) * min(1.0, dt / frame.motor_lag_s)
        m = body.rotation()
        lift = -self._thrust_n
        if near:
            z = max(self.feet.clearance_m(body, pad) + self.feet.height_m, ROTOR_SPAN_M)
            lift /= 1.0 - (ROTOR_SPAN_M / (4.0 * z)) ** 2
        an, ae, ad = wind[0] - body.vn, wind[1] - body.ve, wind[2] - body.vd
        spin = math.sqrt(max(0.0, self._thrust_n) / (frame.mass_kg * GRAVITY_M_S2))  # rotor speed, 1 at hover
        drag = frame.drag_linear_n_s_m * spin + frame.drag_quadratic_n_s2_m2 * math.sqrt(an * an + ae * ae + ad * ad)
        fn, fe, fd = m[2] * lift + drag * an, m[5] * lift + drag * ae, m[8] * lift + drag * ad
        tp, tq, tr = self._control_torque()
        if near:
            push = self.feet.forces(body, m, pad, dt)
            fn, fe, fd = fn + push[0], fe + push[1], fd + push[2]
            tp, tq, tr = tp + push[3], tq + push[4], tr + push[5]
        mass = frame.mass_kg
        gn, ge, gd = fn / mass, fe / mass, fd / mass
        self.specific_force = (
            m[0] * gn + m[3] * ge + m[6] * gd,
            m[1] * gn + m[4] * ge + m[7] * gd,
            m[2] * gn + m[5] * ge + m[8] * gd,
        )
        body.vn += gn * dt
        body.ve += ge * dt
        body.vd += (gd + GRAVITY_M_S2) * dt
        body.n += body.vn * dt
        body.e += body.ve * dt
        body.d += body.vd * dt
        ix, iy, iz = frame.inertia_kg_m2
        p, q, r = body.p, body.q, body.r
        body.p += (tp - (iz - iy) * q * r) / ix * dt
        body.q += (tq - (ix - iz) * r * p) / iy * dt
        body.r += (tr - (iy - ix) * p * q) / iz * dt
        body.turn(dt)

    def _control_torque(self) -> tuple[float, float, float]:
        """Torque of the rate loop about the body's axes; it fades with the thrust that it is made from."""
        body, frame = self.body, self.airframe
        damping = frame.angular_damping_n_m_s
        # Differences of thrust can't exceed the thrust itself: full authority from 30% of hover upward.
        authority = min(1.0, self._thrust_n / (0.3 * frame.hover_thrust * frame.thrust_max_n))
        lag_s = frame.rate_lag_s

        def torque(wanted: float, rate: float, inertia: float, limit: float) -> float:
            reach = limit * authority
            return max(-reach, min(reach, (wanted - rate) / lag_s)) * inertia - damping * rate

        (p, q, r), (ix, iy, iz) = self._rates, frame.inertia_kg_m2
        limit_p, limit_q, limit_r = frame.angular_acceleration_max_rad_s2
        return torque(p, body.p, ix, limit_p), torque(q, body.q, iy, limit_q), torque(r, body.r, iz, limit_r)
