"""Whole flights under virtual time: rendered frames in, setpoints out, judged by the simulator's truth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from app.clock import run_virtual
from app.config import PadMotionConfig, WorldConfig
from app.messages import CommandResult, FlightMode, OperatorAction, Phase
from app.wiring import CONFIGS, load_rig

STATIC = PadMotionConfig(north_m=2.0, east_m=-1.5, heading_deg=40.0)
CAR = PadMotionConfig(north_m=2.0, east_m=0.5, height_m=1.5, speed_m_s=3.75, start_after_s=8.0, deck_m=1.6)


async def land(flight):
    await flight.ready()
    flight.phone.ask(OperatorAction.LAND, 0.0)
    await flight.reach(Phase.TAKEOFF)
    await flight.reach(Phase.LANDED, Phase.HOLD, Phase.IDLE)


@pytest.mark.parametrize(
    ("motion", "ground", "error_m"),
    [pytest.param(STATIC, "lawn", 0.10, id="static"), pytest.param(CAR, "asphalt", 0.20, id="car")],
)
def test_flight_land_ordered_touches_down_on_the_pad(fly, motion, ground, error_m):
    flight = run_virtual(fly(WorldConfig(seed=3, ground=ground, motion=motion), land))
    assert flight.phase is Phase.LANDED
    touchdown, rest = flight.contacts[0], flight.contacts[-1]
    assert touchdown.kind == "touchdown"
    assert rest.kind == "rest"
    assert rest.on_deck
    assert touchdown.error_m < error_m
    assert touchdown.sink_m_s < 1.0
    assert flight.phone.answers[-1].result is CommandResult.ACCEPTED
    order = [Phase.TAKEOFF, Phase.SEARCH, Phase.HOVER, Phase.TRACK, Phase.LAND, Phase.LANDED]
    assert [phase for phase in flight.phases if phase is not Phase.IDLE] == order


def test_flight_pilot_changes_mode_alight_stops_commanding(fly):
    async def script(flight):
        await flight.ready()
        flight.phone.ask(OperatorAction.LAND, 0.0)
        await flight.reach(Phase.TRACK)
        flight.world.px4.set_mode(FlightMode.POSITION)
        await flight.reach(Phase.IDLE, timeout_s=2.0)

    flight = run_virtual(fly(WorldConfig(seed=4, motion=STATIC), script))
    assert flight.world.px4.commander.mode is FlightMode.POSITION
    assert flight.phone.answers[-1].result is CommandResult.CANCELLED
    assert flight.world.px4.commander.armed


def test_flight_camera_dies_while_tracking_vehicle_is_left_in_hold(fly):
    async def script(flight):
        await flight.ready()
        flight.phone.ask(OperatorAction.TRACK, 0.0)
        await flight.reach(Phase.TRACK)
        flight.world.frames_flow = False
        await flight.reach(Phase.HOLD, timeout_s=5.0)

    flight = run_virtual(fly(WorldConfig(seed=5, motion=STATIC), script))
    assert flight.world.px4.commander.mode is FlightMode.HOLD
    assert any("no camera frames" in text for text in flight.phone.texts)


def test_flight_no_pad_anywhere_searches_then_holds_and_says_so(fly):
    far = PadMotionConfig(north_m=200.0, east_m=0.0)
    rig = load_rig(CONFIGS / "simulator.toml")
    small = rig.config.guidance.model_copy(update={"search_radius_m": 4.0})
    rig = replace(rig, config=rig.config.model_copy(update={"guidance": small}))
    flight = run_virtual(fly(WorldConfig(seed=6, motion=far), _search_to_the_end, rig))
    assert flight.phase is Phase.HOLD
    assert flight.phone.answers[-1].result is CommandResult.FAILED
    assert any("pad not found" in text for text in flight.phone.texts)


async def _search_to_the_end(flight):
    await flight.ready()
    flight.phone.ask(OperatorAction.SEARCH, 0.0)
    await flight.reach(Phase.SEARCH)
    await flight.reach(Phase.HOLD, timeout_s=200.0)
