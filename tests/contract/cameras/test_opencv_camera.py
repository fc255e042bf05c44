"""Cameras that OpenCV opens, on video files that the test writes; a device and a stream that are not there."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import aclosing
from pathlib import Path
from typing import Any

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


class Device:
    """A V4L2 device as OpenCV shows it: set() says yes to everything, get() tells what the driver made of it."""

    def __init__(self, *, manual: bool = True, takes_exposure: bool = True) -> None:
        self.properties = {cv2.CAP_PROP_AUTO_EXPOSURE: 3.0, cv2.CAP_PROP_EXPOSURE: 157.0}
        self._fixed = set() if takes_exposure else {cv2.CAP_PROP_EXPOSURE}
        self._fixed |= set() if manual else {cv2.CAP_PROP_AUTO_EXPOSURE}
        self.set_after: list[tuple[int, float]] = []
        self.tells = True

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's own name
        return True

    def set(self, name: int, value: float) -> bool:
        if name in (cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_EXPOSURE):
            self.set_after.append((name, value))
            if name not in self._fixed:
                self.properties[name] = value if name == cv2.CAP_PROP_AUTO_EXPOSURE else max(3.0, min(value, 2047.0))
        return True

    def get(self, name: int) -> float:
        return self.properties.get(name, 0.0) if self.tells else 0.0

    def grab(self) -> bool:
        threading.Event().wait(0.005)
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((48, 64, 3), np.uint8)

    def release(self) -> None:
        pass


@pytest.fixture
def plug_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[Device], OpenCvCamera]:
    """An OpenCV camera on a device of the test's own."""

    def make(device: Device) -> OpenCvCamera:
        monkeypatch.setattr(cv2, "VideoCapture", lambda *_: device)
        return OpenCvCamera(config("0", exposure_max_ms=8.0))

    return make


async def frame_that(camera: OpenCvCamera, fits: Callable[[Frame], bool]) -> Frame:
    async with asyncio.timeout(5.0), aclosing(camera.frames()) as stream:
        async for frame in stream:
            if fits(frame):
                return frame
    raise AssertionError("no frames")


async def test_device_that_takes_an_exposure_tells_its_limits_and_is_left_automatic(plug_in: Any) -> None:
    device = Device()
    async with plug_in(device) as camera:
        limits = camera.exposure_control.limits
    assert (limits.exposure_min_s, limits.exposure_max_s) == pytest.approx((0.0003, 0.008))
    assert (limits.gain_min, limits.gain_max) == (1.0, 1.0)
    assert device.properties[cv2.CAP_PROP_AUTO_EXPOSURE] == 3.0


async def test_device_told_an_exposure_says_nothing_of_it_until_it_has_settled(plug_in: Any) -> None:
    async with plug_in(Device()) as camera:
        before = await frame_that(camera, lambda _: True)
        camera.exposure_control.set_exposure(0.00249, 1.0)
        after = await frame_that(camera, lambda f: f.exposure_s is not None)
    assert (before.exposure_s, before.gain) == (None, None)
    assert (after.exposure_s, after.gain) == (pytest.approx(0.0025), 1.0)
    assert after.sequence >= before.sequence + 4


async def test_device_told_what_its_driver_bends_tells_what_the_driver_made_of_it(plug_in: Any) -> None:
    async with plug_in(Device()) as camera:
        camera.exposure_control.set_exposure(0.0001, 1.0)
        frame = await frame_that(camera, lambda f: f.exposure_s is not None)
    assert frame.exposure_s == pytest.approx(0.0003)


async def test_device_given_back_exposes_by_itself(plug_in: Any) -> None:
    device = Device()
    async with plug_in(device) as camera:
        camera.exposure_control.set_exposure(0.002, 1.0)
        await frame_that(camera, lambda f: f.exposure_s is not None)
        camera.exposure_control.set_auto()
        await frame_that(camera, lambda f: f.exposure_s is None)
    assert device.properties[cv2.CAP_PROP_AUTO_EXPOSURE] == 3.0


async def refused(camera: OpenCvCamera, device: Device) -> None:
    """Tell an exposure of 2 ms that can't be read back, up to the first frame after it."""
    known = len(device.set_after)
    device.tells = False
    camera.exposure_control.set_exposure(0.002, 1.0)
    await frame_that(camera, lambda _: len(device.set_after) >= known + 2)
    await frame_that(camera, lambda _: True)


async def test_device_whose_exposure_cannot_be_read_back_exposes_by_itself(plug_in: Any) -> None:
    device = Device()
    async with plug_in(device) as camera:
        await refused(camera, device)
        mode, told = device.properties[cv2.CAP_PROP_AUTO_EXPOSURE], len(device.set_after)
        after = await frame_that(camera, lambda _: True)
        later = await frame_that(camera, lambda f: f.sequence > after.sequence + 10)
    assert mode == 3.0
    assert (later.exposure_s, later.gain) == (None, None)
    assert len(device.set_after) == told


async def test_device_whose_exposure_could_not_be_read_back_is_told_once_more_later(
    plug_in: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.camera.opencv.REFUSED_S", 0.05)
    device = Device()
    async with plug_in(device) as camera:
        await refused(camera, device)
        device.tells = True
        frame = await frame_that(camera, lambda f: f.exposure_s is not None)
        mode = device.properties[cv2.CAP_PROP_AUTO_EXPOSURE]
    assert (frame.exposure_s, frame.gain) == (pytest.approx(0.002), 1.0)
    assert mode == 1.0


@pytest.mark.parametrize("device", [Device(manual=False), Device(takes_exposure=False)], ids=["no manual", "fixed"])
async def test_device_that_takes_no_exposure_says_so(plug_in: Any, device: Device) -> None:
    async with plug_in(device) as camera:
        assert camera.exposure_control is None
        with pytest.raises(CameraError, match="can't be told"):
            _ = camera.limits


async def test_video_file_takes_no_exposure(video: Path) -> None:
    async with OpenCvCamera(config(str(video))) as camera:
        assert camera.exposure_control is None
