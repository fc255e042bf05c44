"""The control loop: its period, and when it is silent. No setpoint outlives what it rests on."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import numpy as np
import pytest

from app.channels import Topic
from app.clock import run_virtual
from app.config import EstimationConfig, GuidanceConfig, SafetyConfig
from app.guidance.envelope import Envelope
from app.guidance.precland import PrecisionLanding
from app.guidance.velocity import VelocityController
from app.messages import (
    ControlTurn,
    FlightMode,
    Goal,
    GoalKind,
    GoalOrder,
    GuidanceStatus,
    PadTrack,
    Setpoint,
    VehicleState,
)
from app.tasks.control import run_control

SAFETY = SafetyConfig(setpoint_gap_max_s=0.3, vehicle_state_stale_s=0.5, track_stale_s=0.5)
ENVELOPE = Envelope(
    speed_max_m_s=8.0, climb_max_m_s=3.0, sink_max_m_s=3.5, acceleration_max_m_s2=6.0, floor_m=2.5, ceiling_m=30.0
)
STAY, HOVER = Goal(GoalKind.STAY, number=1), Goal(GoalKind.HOVER, 3.0, number=1)


class Bench:
    """The loop with its queues; `hold` keeps topics fresh until the times given."""

    def __init__(self, fakes: Any, controller: VelocityController | None = None) -> None:
        self.fakes, self.autopilot = fakes, fakes.Autopilot()
        self.orders: Topic[GoalOrder] = Topic("orders")
        self.tracks: Topic[PadTrack] = Topic("tracks")
        self.vehicle: Topic[VehicleState] = Topic("vehicle")
        self.statuses: Topic[GuidanceStatus] = Topic("statuses")
        self.turns: Topic[ControlTurn] = Topic("turns")
        self.seen_turns = self.turns.subscribe_all(4096)
        self.alive = 0
        self.state = fakes.vehicle()
        self.loop = run_control(
            orders=self.orders.subscribe(),
            tracks=self.tracks.subscribe(),
            vehicle=self.vehicle.subscribe(),
            statuses=self.statuses,
            turns=self.turns,
            controller=controller or VelocityController(GuidanceConfig(), SAFETY),
            precland=PrecisionLanding(GuidanceConfig(), SAFETY),
            autopilot=self.autopilot,
            envelope=ENVELOPE,
            safety=SAFETY,
            estimation=EstimationConfig(fixes_before_confident=5),
            rate_hz=50.0,
            clock=fakes.clock,
            alive=self.count,
        )

    def count(self) -> None:
        self.alive += 1

    async def fly(
        self,
        seconds: float,
        goal: Goal = STAY,
        *,
        orders_s: float = 1e9,
        states_s: float = 1e9,
        pad: PadTrack | None = None,
        home_ned_m: np.ndarray | None = None,
    ) -> None:
        """Feed the loop every 10 ms; no order after `orders_s`, no vehicle state after `states_s`."""
        until_s = self.fakes.clock.now_s() + seconds
        while self.fakes.clock.now_s() < until_s - 1e-9:
            now_s = self.fakes.clock.now_s()
            if now_s <= orders_s:
                self.orders.publish(GoalOrder(now_s, goal, home_ned_m))
            if now_s <= states_s:
                self.vehicle.publish(self.fakes.vehicle_at(self.state, now_s))
            if pad is not None:
                self.tracks.publish(self.fakes.track(now_s, float(pad.pos_ned_m[0]), pad.fixes_accepted))
            await asyncio.sleep(0.01)

    def sent_s(self) -> np.ndarray:
        return np.array([t_s for t_s, _ in self.autopilot.setpoints])


def fly(fakes: Any, scenario: Any, controller: VelocityController | None = None) -> Bench:
    async def main() -> Bench:
        bench = Bench(fakes, controller)
        async with fakes.running(bench.loop):
            await scenario(bench)
        return bench

    return run_virtual(main(), start_s=10.0)


def test_control_sends_fifty_setpoints_a_second_and_is_alive_at_each_turn(fakes: Any):
    bench = fly(fakes, lambda b: b.fly(2.0))
    np.testing.assert_allclose(np.diff(bench.sent_s()), 0.02, atol=1e-9)
    assert 98 <= len(bench.autopilot.setpoints) <= 100
    assert bench.alive == bench.seen_turns.qsize()


def test_control_is_silent_without_an_order(fakes: Any):
    bench = fly(fakes, lambda b: b.fly(1.0, orders_s=0.0))
    assert bench.autopilot.setpoints == [] and bench.alive >= 49


def test_control_is_silent_when_the_order_says_so(fakes: Any):
    assert fly(fakes, lambda b: b.fly(1.0, Goal())).autopilot.setpoints == []


def test_control_falls_silent_when_the_mission_no_longer_renews_its_order(fakes: Any):
    bench = fly(fakes, lambda b: b.fly(2.0, orders_s=11.0))
    assert 11.0 + 0.26 <= bench.sent_s().max() <= 11.0 + 0.3
    assert bench.alive >= 98


def test_control_falls_silent_when_the_vehicle_state_is_old(fakes: Any):
    bench = fly(fakes, lambda b: b.fly(2.0, states_s=11.0))
    assert 11.0 + 0.46 <= bench.sent_s().max() <= 11.0 + 0.5


@pytest.mark.parametrize(
    "bad",
    [
        {"pos_ned_m": np.array([0.0, math.nan, 0.0])},
        {"vel_ned_m_s": np.full(3, math.inf)},
        {"q_ned_from_body_wxyz": np.full(4, math.nan)},
        {"q_ned_from_body_wxyz": np.zeros(4)},
    ],
)
def test_control_is_silent_on_a_vehicle_state_that_is_not_finite(fakes: Any, bad):
    async def scenario(bench: Bench) -> None:
        await bench.fly(0.5)
        bench.state = fakes.vehicle(**bad)
        await bench.fly(0.5)
        bench.state = fakes.vehicle()
        await bench.fly(0.5)

    sent_s = fly(fakes, scenario).sent_s()
    assert not np.any((sent_s > 10.51) & (sent_s < 11.0))
    assert np.any(sent_s > 11.0)


def test_control_after_a_blocked_link_makes_up_for_nothing(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.fly(0.5)
        bench.autopilot.send_takes_s = 0.2
        await bench.fly(0.2)
        bench.autopilot.send_takes_s = 0.0
        await bench.fly(0.5)

    gaps = np.diff(fly(fakes, scenario).sent_s())
    assert gaps.max() == pytest.approx(0.2, abs=0.021)
    assert np.sum(gaps < 0.0199) <= 2


def test_control_follows_no_track_that_has_just_begun(fakes: Any):
    far = fakes.track(0.0, north_m=5.0, fixes=4)
    bench = fly(fakes, lambda b: b.fly(1.0, HOVER, pad=far))
    assert max(abs(float(s.vel_ned_m_s[0])) for _, s in bench.autopilot.setpoints) == 0.0


def test_control_follows_a_track_of_enough_fixes(fakes: Any):
    far = fakes.track(0.0, north_m=5.0, fixes=5)
    bench = fly(fakes, lambda b: b.fly(1.0, HOVER, pad=far))
    assert bench.autopilot.setpoints[-1][1].vel_ned_m_s[0] > 1.0


def test_control_begins_the_next_flight_from_rest_and_from_the_heading_it_finds(fakes: Any):
    """After a flight towards a pad and a pause without a goal, the first setpoint knows nothing of that flight."""

    async def scenario(bench: Bench) -> None:
        await bench.fly(2.0, HOVER, pad=fakes.track(0.0, north_m=9.0))
        await bench.fly(0.1, Goal(number=2))
        half = math.pi / 4
        bench.state = fakes.vehicle(q_ned_from_body_wxyz=np.array([math.cos(half), 0.0, 0.0, math.sin(half)]))
        await bench.fly(0.1, Goal(GoalKind.STAY, number=3))

    bench = fly(fakes, scenario)
    first = next(s for t_s, s in bench.autopilot.setpoints if t_s > 12.1)
    np.testing.assert_array_equal(first.vel_ned_m_s, 0.0)
    assert first.yaw_ned_rad == pytest.approx(math.pi / 2, abs=math.radians(1.0))  # it turns to the pad from there


def test_control_tells_the_latency_of_each_fix_once(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.fly(0.2, HOVER)
        bench.tracks.publish(fakes.track(fakes.clock.now_s() - 0.05))
        await bench.fly(0.2, HOVER)

    turns = fly(fakes, scenario).seen_turns.drain()
    told = [turn.fix_latency_s for turn in turns if turn.fix_latency_s is not None]
    assert len(told) == 1 and 0.05 <= told[0] <= 0.071


PRECLAND = Goal(GoalKind.PRECLAND, 2.0, number=3)


def test_control_tells_px4_the_pad_twenty_times_a_second_while_px4_lands(fakes: Any):
    async def scenario(bench: Bench) -> None:
        bench.state = fakes.vehicle(mode=FlightMode.PRECLAND)
        await bench.fly(2.0, PRECLAND, pad=fakes.track(10.0, 1.0))

    bench = fly(fakes, scenario)
    times = np.array([t_s for t_s, _ in bench.autopilot.targets])
    assert 38 <= len(times) <= 41
    assert np.diff(times).max() <= 0.06 + 1e-9
    np.testing.assert_allclose([target.pos_ned_m[0] for _, target in bench.autopilot.targets], 1.0, atol=1e-9)
    assert bench.autopilot.setpoints == []


def test_control_flies_on_until_px4_has_taken_the_landing_over(fakes: Any):
    async def scenario(bench: Bench) -> None:
        pad = fakes.track(10.0, 1.0)
        bench.state = fakes.vehicle(mode=FlightMode.OFFBOARD)
        await bench.fly(1.0, PRECLAND, pad=pad)
        bench.state = fakes.vehicle(mode=FlightMode.PRECLAND)
        await bench.fly(0.5, PRECLAND, pad=pad)
        bench.state = fakes.vehicle(mode=FlightMode.OFFBOARD)  # as PX4 disarms, it goes back to this
        await bench.fly(0.5, PRECLAND, pad=pad)

    bench = fly(fakes, scenario)
    assert bench.sent_s().max() == pytest.approx(11.0, abs=0.03)
    np.testing.assert_allclose(np.diff(bench.sent_s()), 0.02, atol=1e-9)
    assert max(t_s for t_s, _ in bench.autopilot.targets) > 11.9


@pytest.mark.parametrize("stops", [{"orders_s": 11.0}, {"states_s": 11.0}], ids=["mission hangs", "vehicle unknown"])
def test_control_tells_px4_nothing_once_orders_or_states_are_old(fakes: Any, stops: dict[str, float]):
    async def scenario(bench: Bench) -> None:
        bench.state = fakes.vehicle(mode=FlightMode.PRECLAND)
        await bench.fly(3.0, PRECLAND, pad=fakes.track(10.0, 1.0), **stops)

    assert 10.9 <= max(t_s for t_s, _ in fly(fakes, scenario).autopilot.targets) <= 11.55


class Absurd(VelocityController):
    """Returns one setpoint, whatever is asked."""

    def __init__(self, vel: tuple[float, float, float]) -> None:
        super().__init__(GuidanceConfig(), SAFETY)
        self.vel = np.array(vel)

    def step(
        self, goal: Goal, track: PadTrack | None, vehicle: VehicleState, now_s: float
    ) -> tuple[Setpoint | None, GuidanceStatus]:
        return Setpoint(now_s, self.vel, np.zeros(3), 0.0), GuidanceStatus(now_s, goal.number)


@pytest.mark.parametrize(
    ("wanted", "home_down_m", "sent"),
    [
        pytest.param((0.0, 50.0, 0.0), 2.0, (0.0, 8.0, 0.0), id="fast"),
        pytest.param((0.0, 0.0, -50.0), 2.0, (0.0, 0.0, -3.0), id="climbing"),
        pytest.param((0.0, 0.0, 50.0), 7.0, (0.0, 0.0, 3.5), id="sinking 10 m over home"),
        pytest.param((0.0, 0.0, 50.0), -1.0, (0.0, 0.0, 0.0), id="sinking 2 m over home, with no track"),
        pytest.param((0.0, 0.0, -50.0), 30.0, (0.0, 0.0, 0.0), id="climbing 33 m over home"),
    ],
)
def test_control_sends_no_setpoint_outside_of_the_envelope(fakes: Any, wanted, home_down_m, sent):
    """The vehicle is 3 m over the frame's origin."""
    home = np.array([0.0, 0.0, home_down_m])
    setpoints = fly(fakes, lambda b: b.fly(0.5, home_ned_m=home), Absurd(wanted)).autopilot.setpoints
    assert setpoints
    np.testing.assert_allclose([s.vel_ned_m_s for _, s in setpoints], [sent] * len(setpoints), atol=1e-9)


def test_control_is_silent_where_a_setpoint_is_not_finite(fakes: Any):
    bench = fly(fakes, lambda b: b.fly(0.5), Absurd((0.0, math.nan, 0.0)))
    assert bench.autopilot.setpoints == [] and bench.alive >= 24
