"""Exposure control, one suite for the simulator's cameras: the one in process and the one behind a socket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path

import pytest

from app.clock import LoopClock, run_virtual
from app.config import CameraConfig, LensConfig, LightConfig, PadMotionConfig, WorldConfig
from app.landmark import paper_landmark
from app.messages import Frame
from app.ports import Camera
from drivers.camera.synthetic import SyntheticCamera
from drivers.simulator.frame_server import FrameServer
from drivers.simulator.launcher import SimulatorProcess
from drivers.simulator.shutter import Exposure
from drivers.simulator.virtual import SimulatedCamera, SimulatedWorld
from drivers.simulator.wire import pack_order, unpack_order

WORLD = WorldConfig(
    seed=3, noise_dn=0.0, motion=PadMotionConfig(north_m=50.0), light=LightConfig(level=0.1), exposure_delay_frames=2
)
LENS = LensConfig(model="pinhole", width_px=160, height_px=120, fx_px=120.0, fy_px=120.0, cx_px=79.5, cy_px=59.5)
RIG = 'pad = "pad.toml"\n[camera]\ndriver = "synthetic"\nlens = "lens.toml"\n'
PAD = """
name = "test"
size_cm = 38.0
[[contour]]
shape = "square"
area_ratio = 1.0
[[contour]]
shape = "square"
area_ratio = 0.5
"""


@asynccontextmanager
async def in_process(_: Path) -> AsyncIterator[Camera]:
    world = SimulatedWorld(WORLD, paper_landmark(), LENS, CameraConfig(driver="synthetic", lens="-"), LoopClock())
    running = asyncio.create_task(world.run())
    try:
        async with SimulatedCamera(world) as camera:
            yield camera
    finally:
        running.cancel()
        await asyncio.wait([running])


@asynccontextmanager
async def behind_a_socket(folder: Path) -> AsyncIterator[Camera]:
    lens = "\n".join(f"{k} = {v!r}" for k, v in LENS.model_dump().items() if k != "distortion").replace("'", '"')
    for name, text in (("rig.toml", RIG), ("pad.toml", PAD), ("lens.toml", lens)):
        (folder / name).write_text(text)
    simulator = SimulatorProcess(folder / "rig.toml", folder / "frames", world=WORLD, companion="127.0.0.1:24598")
    async with simulator, SyntheticCamera(str(folder / "frames")) as camera:
        yield camera


async def frame_with(camera: Camera, exposure_s: float, gain: float) -> tuple[Frame, int]:
    """The first frame that was exposed so, and how many came before it."""
    passed = 0
    async with aclosing(camera.frames()) as frames:
        async for frame in frames:
            if (frame.exposure_s, frame.gain) == pytest.approx((exposure_s, gain)):
                return frame, passed
            passed += 1
            assert passed < 30
    raise AssertionError("no frames")


async def obeys(camera: Camera) -> None:
    async with aclosing(camera.frames()) as frames:
        first = await anext(frames)
    assert first.exposure_s == pytest.approx(WORLD.exposure_ms / 1e3)
    assert first.gain is not None
    control = camera.exposure_control
    assert control is not None
    control.set_exposure(1e-3, 1.0)
    dark, passed = await frame_with(camera, 1e-3, 1.0)
    assert passed >= 1
    control.set_exposure(2e-3, 2.0)
    bright, _ = await frame_with(camera, 2e-3, 2.0)
    # The response is the square root of the light.
    ratio = (bright.image.astype(float) ** 2).mean() / (dark.image.astype(float) ** 2).mean()
    assert ratio == pytest.approx(4.0, rel=0.05)
    control.set_exposure(99.0, 99.0)
    await frame_with(camera, control.limits.exposure_max_s, control.limits.gain_max)
    control.set_auto()
    async with aclosing(camera.frames()) as frames:
        async for frame in frames:
            if frame.exposure_s == pytest.approx(WORLD.exposure_ms / 1e3):
                return


def test_simulated_camera_obeys(tmp_path: Path) -> None:
    async def main() -> None:
        async with in_process(tmp_path) as camera:
            await obeys(camera)

    run_virtual(main())


async def test_camera_of_the_simulators_process_obeys(tmp_path: Path) -> None:
    async with asyncio.timeout(60.0), behind_a_socket(tmp_path) as camera:
        await obeys(camera)


async def test_simulator_whose_application_goes_exposes_by_itself_again(tmp_path: Path) -> None:
    told: asyncio.Queue[Exposure | None] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    server = FrameServer(tmp_path / "frames", lambda order: loop.call_soon_threadsafe(told.put_nowait, order) and None)
    try:
        async with asyncio.timeout(10.0):
            async with SyntheticCamera(str(tmp_path / "frames")) as camera:
                camera.set_exposure(0.002, 3.0)
                assert await told.get() == Exposure(0.002, 3.0)
            assert await told.get() is None
    finally:
        await asyncio.to_thread(server.close)


@pytest.mark.parametrize("order", [None, Exposure(0.001, 2.5)])
def test_exposure_survives_the_wire(order: Exposure | None) -> None:
    assert unpack_order(pack_order(order)) == order


def test_exposure_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="not an exposure"):
        unpack_order(b"nope" + bytes(16))
