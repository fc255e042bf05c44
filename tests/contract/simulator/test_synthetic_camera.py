"""Frames over the simulator's socket, and the simulator's own process."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest

from app.config import PadMotionConfig, RigConfig, WorldConfig, read_config
from app.errors import AlightError, CameraError
from drivers.camera import synthetic
from drivers.camera.synthetic import SyntheticCamera
from drivers.simulator.frame_server import FrameServer
from drivers.simulator.launcher import SimulatorProcess
from drivers.simulator.wire import FrameHeader, unpack

RIG = """
pad = "pad.toml"
[camera]
driver = "synthetic"
lens = "lens.toml"
"""
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
LENS = """
model = "pinhole"
width_px = 320
height_px = 240
fx_px = 250.0
fy_px = 250.0
cx_px = 159.5
cy_px = 119.5
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    for name, text in (("rig.toml", RIG), ("pad.toml", PAD), ("lens.toml", LENS)):
        (tmp_path / name).write_text(text)
    return tmp_path / "rig.toml"


@pytest.fixture
async def server(tmp_path: Path) -> AsyncIterator[FrameServer]:
    one = FrameServer(tmp_path / "frames")
    yield one
    await asyncio.to_thread(one.close)


def test_frame_header_survives_the_wire() -> None:
    header = FrameHeader(7, 123.456789, 0.002, 1.5, 640, 480)
    assert unpack(header.pack()) == header


@pytest.mark.parametrize("data", [b"nope" + bytes(36), FrameHeader(1, 0.0, 0.0, 1.0, 0, 480).pack()])
def test_frame_header_that_is_none_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="not a frame"):
        unpack(data)


async def test_camera_gives_the_newest_frame_as_it_was_sent(server: FrameServer, tmp_path: Path) -> None:
    image = np.arange(64 * 80, dtype=np.uint8).reshape(64, 80)
    async with SyntheticCamera(str(tmp_path / "frames")) as camera:
        frames = camera.frames()
        sent = 0

        async def send_until_read() -> None:
            nonlocal sent
            while True:
                sent += 1
                server.publish(FrameHeader(sent, 10.0 + sent, 0.003, 2.5, 80, 64).pack(), image.tobytes())
                await asyncio.sleep(0.01)

        sender = asyncio.create_task(send_until_read())
        frame = await anext(frames)
        sender.cancel()
        await asyncio.wait([sender])
        await frames.aclose()
    assert (frame.image == image).all()
    assert frame.t_capture_s == 10.0 + frame.sequence
    assert (frame.exposure_s, frame.gain) == (0.003, 2.5)
    assert frame.image.flags.writeable


async def test_camera_whose_simulator_ends_says_so(tmp_path: Path) -> None:
    server = FrameServer(tmp_path / "frames")
    async with SyntheticCamera(str(tmp_path / "frames")) as camera:
        await asyncio.to_thread(server.close)
        with pytest.raises(CameraError, match="ended"):
            await anext(camera.frames())


async def test_camera_without_a_simulator_does_not_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthetic, "OPEN_TIMEOUT_S", 0.1)
    with pytest.raises(CameraError, match="no simulator gives frames"):
        async with SyntheticCamera(str(tmp_path / "nothing")):
            pass


async def test_camera_whose_simulator_falls_silent_says_so(
    server: FrameServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(synthetic, "FRAME_TIMEOUT_S", 0.1)
    async with SyntheticCamera(str(tmp_path / "frames")) as camera:
        with pytest.raises(CameraError, match="no frame"):
            await anext(camera.frames())


async def test_simulator_process_gives_frames_in_time_and_leaves_the_truth(rig: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    world = WorldConfig(seed=9, motion=PadMotionConfig(height_m=1.6), camera_latency_s=0.05)
    simulator = SimulatorProcess(rig, tmp_path / "frames", truth, world=world, companion="127.0.0.1:24599")
    async with simulator, SyntheticCamera(str(tmp_path / "frames")) as camera:
        ages, sequences = [], []
        async for frame in camera.frames():
            ages.append(time.monotonic() - frame.t_capture_s)
            sequences.append(frame.sequence)
            if len(ages) == 20:
                break
    assert frame.image.shape == (240, 320)
    assert min(ages) == pytest.approx(0.05, abs=0.02)
    assert sequences == sorted(set(sequences))
    lines = [json.loads(line) for line in truth.read_text().splitlines()]
    assert lines[0]["seed"] == 9
    assert lines[-1]["kind"] == "end"
    assert lines[1]["pad_pos_ned_m"][2] == -1.6


async def test_simulator_process_takes_another_camera_than_the_rigs(rig: Path, tmp_path: Path) -> None:
    camera = read_config(rig, RigConfig).camera.model_copy(update={"frame_rate_hz": 8.0})
    frames = tmp_path / "frames"
    simulator = SimulatorProcess(rig, frames, world=WorldConfig(), camera=camera, companion="127.0.0.1:24599")
    times = []
    async with simulator, SyntheticCamera(str(frames)) as seen:
        async for frame in seen.frames():
            times.append((frame.sequence, frame.t_capture_s))
            if len(times) == 5:
                break
    (first, first_s), (last, last_s) = times[0], times[-1]
    assert (last - first) / (last_s - first_s) == pytest.approx(8.0, rel=0.02)


async def test_simulator_process_with_a_wrong_file_tells_why(tmp_path: Path) -> None:
    with pytest.raises(AlightError, match="no such file"):
        async with SimulatorProcess(tmp_path / "missing.toml", tmp_path / "frames"):
            pass
