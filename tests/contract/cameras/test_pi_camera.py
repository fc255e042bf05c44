"""The Pi's camera, on a picamera2 of the test's own that keeps to picamera2's documented interface."""

from __future__ import annotations

import asyncio
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import aclosing
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from app.config import CameraConfig
from app.errors import CameraError
from app.messages import Frame
from app.ports import Camera
from drivers.camera.picamera import PiCamera, cap_exposure, mid_exposure_s

SIZE_PX = (640, 480)
PADDING_PX = 64
PERIOD_S = 0.02
EXPOSURE_US = 4000


class Request:
    """One completed request: its planes hold its number."""

    def __init__(self, owner: FakePicamera2, number: int) -> None:
        self._owner, self._number = owner, number

    def get_metadata(self) -> dict[str, Any]:
        gains = {"AnalogueGain": 2.0, "DigitalGain": 1.25}
        return {"SensorTimestamp": time.monotonic_ns() - 30_000_000, "ExposureTime": EXPOSURE_US, **gains}

    def make_array(self, name: str) -> np.ndarray:
        assert name == "main"
        width, height = self._owner.stream_configuration()["size"]
        planes = np.full((height * 3 // 2, width + PADDING_PX), 255, np.uint8)
        planes[:height, :width] = self._number
        return planes

    def release(self) -> None:
        self._owner.held -= 1


class FakePicamera2:
    """Set `cameras`, `fault`, `frames`, `tunings` and `gives_px` before it is made; made ones are in `made`.

    A request that timed out stays queued, and stop() waits in line behind it; close() ends the queue first.
    """

    cameras: list[dict[str, Any]]
    fault: str | None
    frames: float
    tunings: dict[str, Any]
    gives_px: tuple[int, int] | None
    made: list[FakePicamera2]

    @staticmethod
    def global_camera_info() -> list[dict[str, Any]]:
        return FakePicamera2.cameras

    @staticmethod
    def load_tuning_file(name: str) -> dict[str, Any]:
        if name not in FakePicamera2.tunings:
            raise RuntimeError("Tuning file not found")
        tuning: dict[str, Any] = FakePicamera2.tunings[name]
        return tuning

    @staticmethod
    def find_tuning_algo(tuning: dict[str, Any], name: str) -> dict[str, Any]:
        found: dict[str, Any] = next(algo for algo in tuning["algorithms"] if name in algo)[name]
        return found

    def __init__(self, camera_num: int = 0, tuning: Any = None) -> None:
        if FakePicamera2.fault:
            raise RuntimeError(FakePicamera2.fault)
        self.tuning, self.held, self.count = tuning, 0, 0
        self.configuration: dict[str, Any] = {}
        self.calls: list[str] = []
        self.controls: list[dict[str, Any]] = []
        self.camera_controls = {"ExposureTime": (150, 100_000, 20_000), "AnalogueGain": (1.1, 6.0, 1.1)}
        self.refuses = False
        self.waits_s: list[float | None] = []
        self.queued = False
        FakePicamera2.made.append(self)

    def create_video_configuration(self, **settings: Any) -> dict[str, Any]:
        return settings

    def configure(self, configuration: dict[str, Any]) -> None:
        self.configuration = configuration

    def stream_configuration(self, name: str = "main") -> dict[str, Any]:
        return {"size": FakePicamera2.gives_px or self.configuration[name]["size"]}

    def set_controls(self, controls: dict[str, Any]) -> None:
        if self.refuses:
            raise RuntimeError("Control ExposureTime is not advertised by libcamera")
        self.controls.append(controls)

    def start(self) -> None:
        self.calls.append("start")

    def stop(self) -> None:
        if self.calls[-1] != "start":
            return
        if self.queued:
            threading.Event().wait()
        self.calls.append("stop")

    def close(self) -> None:
        self.queued = False
        self.stop()
        self.calls.append("close")

    def capture_request(self, wait: float | None = None) -> Request:
        self.waits_s.append(wait)
        if self.count >= FakePicamera2.frames:
            self.queued = True
            raise TimeoutError
        threading.Event().wait(PERIOD_S)
        self.held += 1
        self.count += 1
        return Request(self, self.count)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[FakePicamera2]]:
    module = ModuleType("picamera2")
    module.Picamera2 = FakePicamera2  # type: ignore[attr-defined]  # a stand-in
    monkeypatch.setitem(sys.modules, "picamera2", module)
    FakePicamera2.cameras = [{"Model": "imx219", "Num": 0, "Id": "/base/soc/i2c0mux/i2c@1/imx219@10"}]
    FakePicamera2.fault, FakePicamera2.frames, FakePicamera2.made = None, float("inf"), []
    FakePicamera2.gives_px = None
    agc = {"exposure_modes": {"normal": {"shutter": [100, 66666], "gain": [1.0, 8.0]}, "long": {}}}
    FakePicamera2.tunings = {"imx219.json": {"version": 2.0, "algorithms": [{"rpi.agc": agc}]}}
    yield FakePicamera2


async def first_of(camera: Camera) -> Frame:
    async with aclosing(camera.frames()) as stream:
        return await anext(stream)


def pi_camera(**changes: Any) -> PiCamera:
    return PiCamera(CameraConfig(driver="picamera2", lens="none.toml", **changes), SIZE_PX)


async def test_pi_camera_frame_is_the_grey_plane_at_mid_exposure(fake: type[FakePicamera2]) -> None:
    camera: Camera
    async with pi_camera(frame_rate_hz=50.0) as camera:
        frame = await first_of(camera)
        following = await first_of(camera)
    now_s = time.monotonic()
    assert frame.image.shape == (480, 640)
    assert (frame.image == frame.image[0, 0]).all()
    assert following.sequence > frame.sequence
    assert frame.exposure_s == 0.004
    # The sensor's time was 30 ms before the frame was taken; mid-exposure is 2 ms before that.
    assert 0.032 <= now_s - frame.t_capture_s < 1.0


async def test_pi_camera_is_asked_for_yuv_at_its_rate_with_the_exposure_capped(fake: type[FakePicamera2]) -> None:
    async with pi_camera(frame_rate_hz=50.0, exposure_max_ms=3.0) as camera:
        await first_of(camera)
    (made,) = fake.made
    assert made.configuration["main"] == {"size": (640, 480), "format": "YUV420"}
    assert made.configuration["controls"] == {"FrameDurationLimits": (20_000, 20_000), "AeEnable": True}
    modes = made.tuning["algorithms"][0]["rpi.agc"]["exposure_modes"]
    assert modes["normal"]["shutter"] == [100, 3000]
    assert "long" in modes


async def test_pi_camera_closed_has_given_every_buffer_back_and_released_the_camera(fake: type[FakePicamera2]) -> None:
    async with pi_camera() as camera:
        await first_of(camera)
    (made,) = fake.made
    assert (made.held, made.calls) == (0, ["start", "stop", "close"])


async def test_pi_camera_without_a_tuning_file_runs_with_the_systems_own(fake: type[FakePicamera2]) -> None:
    fake.tunings = {}
    async with pi_camera() as camera:
        await first_of(camera)
    assert fake.made[0].tuning is None


async def all_of(camera: Camera) -> None:
    async with asyncio.timeout(5.0):
        async for _ in camera.frames():
            pass


async def test_pi_camera_that_stops_giving_frames_is_an_error_and_is_released(fake: type[FakePicamera2]) -> None:
    fake.frames = 2
    async with pi_camera() as camera:
        with pytest.raises(CameraError, match="gave no frame for 1 s; check the ribbon cable"):
            await all_of(camera)
    assert fake.made[0].calls == ["start", "stop", "close"]


@pytest.mark.parametrize(
    ("rate_hz", "first_s", "next_s"),
    [(30.0, 5.0, 1.0), (2.0, 6.0, 1.5), (1.0, 12.0, 3.0)],
    ids=["fast", "slow", "slowest"],
)
async def test_pi_camera_is_given_the_time_of_several_frames(
    fake: type[FakePicamera2], rate_hz: float, first_s: float, next_s: float
) -> None:
    """Twelve to the first frame, three to each other; never less than 5 s and 1 s."""
    fake.frames = 1
    async with pi_camera(frame_rate_hz=rate_hz) as camera:
        with pytest.raises(CameraError, match=f"gave no frame for {next_s:g} s"):
            await all_of(camera)
    assert fake.made[0].waits_s == [first_s, next_s]


@pytest.mark.parametrize("gives_px", [(640, 400), (480, 480), (1280, 960)], ids=["lower", "narrower", "larger"])
async def test_pi_camera_with_images_of_another_size_than_the_lens_is_refused(
    fake: type[FakePicamera2], gives_px: tuple[int, int]
) -> None:
    fake.gives_px = gives_px
    says = f"images are {gives_px[0]}x{gives_px[1]}, the lens file is for 640x480; give the lens file of this image"
    async with pi_camera() as camera:
        with pytest.raises(CameraError, match=says):
            await all_of(camera)
    assert fake.made[0].held == 0


async def test_pi_camera_without_picamera2_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "picamera2", None)
    with pytest.raises(CameraError, match="apt install python3-picamera2"):
        async with pi_camera():
            pass


async def test_pi_camera_without_a_camera_says_so(fake: type[FakePicamera2]) -> None:
    fake.cameras = []
    with pytest.raises(CameraError, match="no camera on the Pi's connector"):
        async with pi_camera():
            pass


async def test_pi_camera_in_use_says_so(fake: type[FakePicamera2]) -> None:
    fake.fault = "Camera __init__ sequence did not complete."
    with pytest.raises(CameraError, match=r"does not open .*no other program uses it"):
        async with pi_camera():
            pass


@pytest.mark.parametrize(
    ("sensor_s", "exposure_us", "readout_s", "boottime_s", "expected_s"),
    [
        (100.0, 0.0, 0.0, 100.05, 100.0),
        (100.0, 8000.0, 0.0, 100.05, 99.996),  # half the exposure earlier
        (100.0, 8000.0, 0.020, 100.05, 100.006),  # the middle row: half the readout later
        (400.0, 0.0, 0.0, 400.05, 100.0),  # CLOCK_BOOTTIME, on a machine that slept for 300 s
        (100.0, 0.0, 0.0, 400.05, 100.0),  # CLOCK_MONOTONIC on that machine
    ],
)
def test_mid_exposure_is_of_the_middle_row_on_the_monotonic_clock(
    sensor_s: float, exposure_us: float, readout_s: float, boottime_s: float, expected_s: float
) -> None:
    t_s = mid_exposure_s(round(sensor_s * 1e9), exposure_us, readout_s, 100.05, boottime_s)
    assert t_s == pytest.approx(expected_s, abs=1e-6)


def test_exposure_is_capped_in_every_channel_of_a_newer_tuning() -> None:
    agc = {"channels": [{"exposure_modes": {"normal": {"shutter": [100, 66666]}}}, {}]}
    tuning = {"algorithms": [{"rpi.agc": agc}]}
    assert cap_exposure(tuning, agc, 5000) is tuning
    assert [c["exposure_modes"]["normal"]["shutter"] for c in agc["channels"]] == [[100, 5000], [100, 5000]]


async def test_pi_camera_frame_tells_its_exposure_and_its_whole_gain(fake: type[FakePicamera2]) -> None:
    async with pi_camera() as camera:
        frame = await first_of(camera)
    assert (frame.exposure_s, frame.gain) == (0.004, pytest.approx(2.0 * 1.25))


async def test_pi_camera_told_its_exposure_gives_picamera2_time_and_gain_and_leaves_the_rest(
    fake: type[FakePicamera2],
) -> None:
    async with pi_camera() as camera:
        control = camera.exposure_control
        control.set_exposure(0.00125, 2.5)
        assert fake.made[0].controls == [{"ExposureTime": 1250, "AnalogueGain": 2.5}]


@pytest.mark.parametrize(
    ("wanted", "told"),
    [((1e-6, 0.1), (150, 1.1)), ((1.0, 99.0), (8000, 6.0))],
    ids=["less than the sensor has", "more than the rig and the sensor allow"],
)
async def test_pi_camera_told_too_much_does_what_comes_nearest(
    fake: type[FakePicamera2], wanted: tuple[float, float], told: tuple[int, float]
) -> None:
    """The sensor: 150 us to 0.1 s, gain 1.1 to 6; the rig: at most 8 ms."""
    async with pi_camera(exposure_max_ms=8.0) as camera:
        camera.exposure_control.set_exposure(*wanted)
    assert fake.made[0].controls == [{"ExposureTime": told[0], "AnalogueGain": told[1]}]


async def test_pi_camera_longest_exposure_leaves_the_frame_rate_as_it_is(fake: type[FakePicamera2]) -> None:
    async with pi_camera(frame_rate_hz=100.0, exposure_max_ms=50.0) as camera:
        assert camera.exposure_control.limits.exposure_max_s < 0.01


async def test_pi_camera_exposes_by_itself_again(fake: type[FakePicamera2]) -> None:
    async with pi_camera() as camera:
        camera.exposure_control.set_auto()
    assert fake.made[0].controls == [{"AeEnable": True, "ExposureTime": 0, "AnalogueGain": 0.0}]


async def test_pi_camera_that_has_no_such_control_goes_on(fake: type[FakePicamera2]) -> None:
    async with pi_camera() as camera:
        fake.made[0].refuses = True
        camera.exposure_control.set_exposure(0.001, 1.0)
        frame = await first_of(camera)
    assert frame.exposure_s == 0.004


async def test_pi_camera_closed_takes_no_exposure(fake: type[FakePicamera2]) -> None:
    async with pi_camera() as camera:
        control = camera.exposure_control
    control.set_auto()
    assert fake.made[0].controls == []
