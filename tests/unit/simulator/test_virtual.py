"""The in-process simulator under virtual time: the ports' contract, and the same flight every time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager

import numpy as np
import pytest

from app.clock import LoopClock, run_virtual
from app.config import CameraConfig, LensConfig, PadMotionConfig, WorldConfig
from app.errors import AutopilotError, CameraError
from app.landmark import paper_landmark
from app.messages import AutopilotAction, FlightMode, LandedState, Setpoint, VehicleState
from drivers.autopilot.simulated import SimulatedAutopilot
from drivers.simulator.virtual import SimulatedCamera, SimulatedWorld

LENS = LensConfig(model="pinhole", width_px=160, height_px=120, fx_px=120.0, fy_px=120.0, cx_px=79.5, cy_px=59.5)
CAMERA = CameraConfig(driver="synthetic", lens="-")


@asynccontextmanager
async def simulation(
    seed: int = 1, clock_error_s: float = 0.0
) -> AsyncIterator[tuple[SimulatedWorld, SimulatedAutopilot]]:
    config = WorldConfig(seed=seed, motion=PadMotionConfig(), camera_latency_s=0.04, camera_clock_error_s=clock_error_s)
    world = SimulatedWorld(config, paper_landmark(), LENS, CAMERA, LoopClock())
    task = asyncio.create_task(world.run())
    try:
        async with SimulatedAutopilot(world) as autopilot:
            yield world, autopilot
    finally:
        task.cancel()
        await asyncio.wait([task])


async def newest(autopilot: SimulatedAutopilot) -> VehicleState:
    async with aclosing(autopilot.states()) as states:
        return await anext(states)


async def stream(autopilot: SimulatedAutopilot, velocity: tuple[float, float, float], seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        await autopilot.send_setpoint(Setpoint(0.0, np.array(velocity), np.zeros(3), 0.0))
        await asyncio.sleep(0.02)


async def hop(seed: int) -> SimulatedWorld:
    async with simulation(seed) as (world, autopilot):
        await asyncio.sleep(3.2)
        await autopilot.execute(AutopilotAction.ARM)
        await autopilot.execute(AutopilotAction.TAKEOFF, height_m=3.0)
        await asyncio.sleep(4.0)
        return world


async def fly() -> VehicleState:
    async with simulation() as (_, autopilot):
        await asyncio.sleep(3.2)
        await autopilot.execute(AutopilotAction.ARM)
        await autopilot.execute(AutopilotAction.TAKEOFF, height_m=3.0)
        await asyncio.sleep(8.0)
        await stream(autopilot, (0.0, 0.0, 0.0), 1.0)
        await autopilot.execute(AutopilotAction.OFFBOARD)
        await stream(autopilot, (1.5, 0.5, 0.0), 4.0)
        return await newest(autopilot)


def test_simulated_autopilot_flies_setpoints_under_virtual_time() -> None:
    state = run_virtual(fly())
    assert state.mode is FlightMode.OFFBOARD
    assert state.armed
    assert state.landed is LandedState.IN_AIR
    assert state.vel_ned_m_s[:2] == pytest.approx([1.5, 0.5], abs=0.4)
    assert -state.pos_ned_m[2] == pytest.approx(3.0, abs=0.4)


def test_simulated_flight_of_the_same_seed_is_the_same_flight() -> None:
    truths = [run_virtual(hop(seed)).truth() for seed in (2, 2, 3)]
    assert truths[0] == truths[1]
    assert truths[0] != truths[2]


def test_simulated_autopilot_refusal_carries_the_autopilots_words() -> None:
    async def main() -> None:
        async with simulation() as (_, autopilot):
            with pytest.raises(AutopilotError, match="not ready"):
                await autopilot.execute(AutopilotAction.ARM)
            with pytest.raises(AutopilotError, match="Offboard is currently not available"):
                await autopilot.execute(AutopilotAction.OFFBOARD)

    run_virtual(main())


def test_simulated_autopilot_with_the_link_cut_tells_not_connected() -> None:
    async def main() -> tuple[VehicleState, VehicleState]:
        async with simulation() as (world, autopilot), aclosing(autopilot.states()) as states:
            before = await anext(states)
            world.telemetry_flows = False
            after = await anext(states)
            while after.connected:
                after = await anext(states)
            return before, after

    before, after = run_virtual(main())
    assert before.connected
    assert after.t_capture_s - before.t_capture_s < 0.02


def test_simulated_autopilot_without_a_running_world_does_not_open() -> None:
    async def main() -> None:
        world = SimulatedWorld(WorldConfig(), paper_landmark(), LENS, CAMERA, LoopClock())
        with pytest.raises(AutopilotError, match="stands still"):
            async with SimulatedAutopilot(world):
                pass

    run_virtual(main())


def test_simulated_camera_gives_thirty_frames_a_second_after_its_latency() -> None:
    async def main() -> list[tuple[float, float]]:
        clock = LoopClock()
        times = []
        async with simulation() as (world, _), SimulatedCamera(world) as camera:
            async with aclosing(camera.frames()) as frames:
                async for frame in frames:
                    times.append((frame.t_capture_s, clock.now_s()))
                    if len(times) == 31:
                        return times
        raise AssertionError("no frames")

    times = run_virtual(main())
    assert times[-1][0] - times[0][0] == pytest.approx(1.0, abs=0.01)
    assert all(0.0399 <= now - captured < 0.05 for captured, now in times)


def test_simulated_camera_that_is_stopped_fails() -> None:
    async def main() -> None:
        async with simulation() as (world, _), SimulatedCamera(world) as camera:
            async with aclosing(camera.frames()) as frames:
                await anext(frames)
                world.frames_flow = False
                with pytest.raises(CameraError, match="no frame"):
                    while True:
                        await anext(frames)

    run_virtual(main())


def test_frames_are_told_earlier_than_they_were_exposed_by_the_clocks_error_and_come_no_later():
    async def first(error_s: float) -> tuple[float, float]:
        async with simulation(clock_error_s=error_s) as (world, _):
            async with aclosing(SimulatedCamera(world).frames()) as frames:
                frame = await anext(frames)
                return frame.t_capture_s, LoopClock().now_s()

    told_s, came_s = run_virtual(first(0.0))
    off_s, late_s = run_virtual(first(0.03))
    assert off_s == pytest.approx(told_s - 0.03, abs=1e-6)
    assert late_s == pytest.approx(came_s, abs=1e-6)
