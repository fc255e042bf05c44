"""Cameras that OpenCV opens, on video files that the test writes; a device and a stream that are not there."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import aclosing
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.config import CameraConfig
from app.errors import CameraError
from app.messages import Frame
from app.ports import Camera
from drivers.camera.opencv import OpenCvCamera

RATE_HZ = 50.0
FRAMES = 12


def config(source: str, **changes: float) -> CameraConfig:
    return CameraConfig(driver="opencv", lens="none.toml", source=source, **changes)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Twelve frames at 50 Hz, each of one grey level: 20 times its index."""
    path = tmp_path / "flight.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, (64, 48))
    for k in range(FRAMES):
        writer.write(np.full((48, 64, 3), 20 * k, np.uint8))
    writer.release()
    return path


async def frames_of(camera: Camera) -> list[Frame]:
    return [frame async for frame in camera.frames()]


async def test_video_file_gives_its_frames_at_its_own_rate_and_ends(video: Path) -> None:
    async with OpenCvCamera(config(str(video)), (64, 48)) as camera:
        frames = await frames_of(camera)
        elapsed_s = time.monotonic() - frames[0].t_capture_s
    assert frames[-1].sequence == FRAMES - 1
    times = {f.sequence: f.t_capture_s - frames[0].t_capture_s for f in frames}
    assert times[FRAMES - 1] == pytest.approx((FRAMES - 1) / RATE_HZ)
    assert elapsed_s >= times[FRAMES - 1]
    assert {f.image.shape for f in frames} == {(48, 64)}
    levels = [round(float(f.image.mean()) / 20.0) for f in frames]
    assert levels == [f.sequence for f in frames]
    assert frames[-1].name == f"{video}#{FRAMES - 1}"


async def test_slow_reader_gets_the_newest_frame(video: Path) -> None:
    async with OpenCvCamera(config(str(video))) as camera:
        async with aclosing(camera.frames()) as stream:
            first = await anext(stream)
            # The file plays in real time: a slow reader is slow in real time.
            await asyncio.sleep(5.5 / RATE_HZ)
            second = await anext(stream)
    assert second.sequence >= first.sequence + 4


async def test_video_of_another_size_than_the_lens_is_refused(video: Path) -> None:
    async with OpenCvCamera(config(str(video)), (640, 480)) as camera:
        with pytest.raises(CameraError, match="images are 64x48, the lens file is for 640x480"):
            await frames_of(camera)


async def test_closing_in_the_middle_of_a_file_stops_its_thread(video: Path) -> None:
    camera = OpenCvCamera(config(str(video)))
    async with camera:
        async with aclosing(camera.frames()) as stream:
            await anext(stream)
    assert "camera" not in [thread.name for thread in threading.enumerate()]
    with pytest.raises(CameraError, match="closed"):
        await frames_of(camera)


@pytest.fixture
def not_a_video(tmp_path: Path) -> Path:
    path = tmp_path / "notes.mp4"
    path.write_text("this is no video")
    return path


async def test_file_that_is_no_video_does_not_open(not_a_video: Path) -> None:
    with pytest.raises(CameraError, match=r"notes\.mp4: the camera does not open; give a video file"):
        async with OpenCvCamera(config(str(not_a_video))):
            pass


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("", "camera.source is empty"),
        ("no-such-file.mp4", r"no-such-file\.mp4: no such file"),
        ("97", "97: the camera does not open; plug it in"),
        ("/dev/video97", "/dev/video97: the camera does not open; plug it in"),
    ],
)
async def test_source_that_is_not_there_is_an_error_that_names_it(source: str, says: str) -> None:
    with pytest.raises(CameraError, match=says):
        async with OpenCvCamera(config(source)):
            pass


@pytest.fixture
def closed_port() -> Iterator[int]:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))  # bound and not listening: connections are refused
        yield int(held.getsockname()[1])


async def test_stream_that_nobody_serves_does_not_open(closed_port: int) -> None:
    with pytest.raises(CameraError, match="does not open; check the address"):
        async with OpenCvCamera(config(f"rtsp://127.0.0.1:{closed_port}/stream")):
            pass
