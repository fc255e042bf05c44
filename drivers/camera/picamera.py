"""The Raspberry Pi's camera through picamera2: the Camera port. Grey images with the sensor's own times.

picamera2 and libcamera come from apt, not from PyPI, so they are imported when the camera is opened.

Its exposure can be told. A change takes about as many frames as there are buffers and three or four more (picamera2
issue 1278); each frame's metadata say what it really had (issue 340), so nothing here counts frames. Giving exposure
time and gain ends the automatic control by itself; AeEnable False with them would freeze what it had (issue 933).
The automatic control ignores changes under 2% (issue 1109).
"""

from __future__ import annotations

import asyncio
import importlib
import time
from collections.abc import AsyncIterator, Mapping
from types import TracebackType
from typing import Any, Self

import numpy as np

from app.config import CameraConfig
from app.errors import CameraError
from app.log import get_logger
from app.messages import ExposureLimits, Frame
from drivers.camera.newest import NewestFrame

BUFFERS = 4
FIRST_FRAME_S, FIRST_FRAMES = 5.0, 12
"""A camera that gave none in this time, or in that of so many frames, won't: at its first start libcamera keeps back
seven or eight, until its automatic exposure has settled."""
NEXT_FRAME_S, NEXT_FRAMES = 1.0, 3
"""The same once it has given one."""
EXPOSURE_MIN_US = 100
GAIN_MAX = 8.0
BLANKING_S = 1e-3
"""Between the end of an exposure and the next frame: a longer exposure would stretch the frame."""

_log = get_logger("camera")


def mid_exposure_s(
    sensor_ns: int, exposure_us: float, readout_s: float, monotonic_s: float, boottime_s: float
) -> float:
    """When the middle row of a frame was in the middle of its exposure, on CLOCK_MONOTONIC.

    SensorTimestamp is when the first row arrives: the end of its exposure (picamera2 issue 821). The middle row ends
    its own half a readout later. libcamera's documents call the clock CLOCK_BOOTTIME, its Raspberry Pi pipeline takes
    CLOCK_MONOTONIC (libcamera bug 254); the two part only where the machine was suspended, and a frame is then too
    young for one of them.

    Args:
        sensor_ns: SensorTimestamp.
        exposure_us: ExposureTime.
        readout_s: First row to last.
        monotonic_s: CLOCK_MONOTONIC now.
        boottime_s: CLOCK_BOOTTIME now.
    """
    arrival_s = sensor_ns / 1e9
    if arrival_s > monotonic_s:
        arrival_s -= boottime_s - monotonic_s
    return arrival_s - 0.5e-6 * exposure_us + 0.5 * readout_s


def cap_exposure(tuning: dict[str, Any], agc: dict[str, Any], exposure_max_us: int) -> dict[str, Any]:
    """A camera tuning whose automatic exposure goes no longer than a limit and raises the gain instead.

    Args:
        tuning: As picamera2 loads it; returned.
        agc: Its "rpi.agc" part, which is changed.
        exposure_max_us: The limit.
    """
    profile = {"shutter": [EXPOSURE_MIN_US, exposure_max_us], "gain": [1.0, GAIN_MAX]}
    for channel in agc.get("channels", [agc]):
        channel["exposure_modes"] = {**channel.get("exposure_modes", {}), "normal": profile}
    return tuning


def _within_sensor(limits: ExposureLimits, controls: Mapping[str, tuple[Any, Any, Any]]) -> ExposureLimits:
    """The limits narrowed to what the sensor tells of itself (picamera2's camera_controls: least, most, usual)."""
    exposure = controls.get("ExposureTime", (None, None, None))
    gain = controls.get("AnalogueGain", (None, None, None))
    shortest_s = max(limits.exposure_min_s, float(exposure[0] or 0) / 1e6)
    longest_s = limits.exposure_max_s if not exposure[1] else min(limits.exposure_max_s, float(exposure[1]) / 1e6)
    least = max(limits.gain_min, float(gain[0] or 0.0))
    most = limits.gain_max if not gain[1] else min(limits.gain_max, float(gain[1]))
    return ExposureLimits(shortest_s, max(shortest_s, longest_s), least, max(least, most))


class PiCamera:
    """The first camera on the Pi's connector.

    Args:
        config: Frame rate, longest exposure and readout time.
        size_px: (width, height) of the images, as in the lens file.
    """

    def __init__(self, config: CameraConfig, size_px: tuple[int, int]) -> None:
        self._config = config
        self._size_px = size_px
        self._camera: Any = None
        self._reader: NewestFrame | None = None
        self._sequence = 0
        longest_s = min(config.exposure_max_ms / 1e3, 1.0 / config.frame_rate_hz - BLANKING_S)
        self._limits = ExposureLimits(EXPOSURE_MIN_US / 1e6, max(EXPOSURE_MIN_US / 1e6, longest_s), 1.0, GAIN_MAX)

    async def __aenter__(self) -> Self:
        """Open and start the camera.

        Raises:
            CameraError: picamera2 is missing, there is no camera, or it doesn't open.
        """
        self._camera = await asyncio.to_thread(self._open)
        self._sequence = 0
        self._reader = NewestFrame(self._grab, self._release)
        self._reader.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop and release the camera."""
        reader, self._reader = self._reader, None
        if reader is not None:
            await reader.stop()

    def frames(self) -> AsyncIterator[Frame]:
        """Frames as they come: (height, width) grey.

        Raises:
            CameraError: The camera is closed, gives images of another size, or stopped giving any.
        """
        if self._reader is None:
            raise CameraError("the Pi camera is closed", "open it first")
        return self._reader.frames()

    @property
    def exposure_control(self) -> Self:
        """Every camera of the Pi can be told."""
        return self

    @property
    def limits(self) -> ExposureLimits:
        """What the sensor, as far as it tells, and the frame rate allow."""
        return self._limits

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        """Expose so. picamera2 takes it with the next request that it queues."""
        limits = self._limits
        exposure_us = round(1e6 * min(limits.exposure_max_s, max(limits.exposure_min_s, exposure_s)))
        self._set({"ExposureTime": exposure_us, "AnalogueGain": min(limits.gain_max, max(limits.gain_min, gain))})

    def set_auto(self) -> None:
        """Expose by itself again: 0 is how both are given back, whatever libcamera calls its modes."""
        self._set({"AeEnable": True, "ExposureTime": 0, "AnalogueGain": 0.0})

    def _set(self, controls: dict[str, Any]) -> None:
        camera = self._camera
        if camera is None:
            return
        try:
            camera.set_controls(controls)
        except RuntimeError as fault:  # a control that this sensor has not: its frames tell what it does instead
            _log.error("exposure.not_set", fault=str(fault), **controls)

    def _open(self) -> Any:
        try:
            kind: Any = importlib.import_module("picamera2").Picamera2
        except ImportError as fault:
            raise CameraError(
                f"picamera2 can't be imported ({fault})",
                "apt install python3-picamera2, and make the venv with --system-site-packages",
            ) from None
        cameras = kind.global_camera_info()
        if not cameras:
            raise CameraError(
                "no camera on the Pi's connector", "check the ribbon cable, and camera_auto_detect in config.txt"
            )
        try:
            camera = kind(tuning=self._tuning(kind, str(cameras[0].get("Model", ""))))
        except (RuntimeError, OSError) as fault:
            raise CameraError(f"the Pi camera does not open ({fault})", "see that no other program uses it") from None
        try:
            period_us = round(1e6 / self._config.frame_rate_hz)
            camera.configure(
                camera.create_video_configuration(
                    main={"size": self._size_px, "format": "YUV420"},
                    controls={"FrameDurationLimits": (period_us, period_us), "AeEnable": True},
                    buffer_count=BUFFERS,
                )
            )
            self._limits = _within_sensor(self._limits, getattr(camera, "camera_controls", {}))
            camera.start()
        except (RuntimeError, OSError, ValueError) as fault:
            camera.close()
            width, height = self._size_px
            raise CameraError(
                f"the Pi camera does not start at {width}x{height}, {self._config.frame_rate_hz:g} Hz ({fault})",
                "give a size and a rate that it has",
            ) from None
        return camera

    def _tuning(self, kind: Any, model: str) -> dict[str, Any] | None:
        """The sensor's own tuning with the exposure capped, or None where the system has no file for it."""
        try:
            tuning = kind.load_tuning_file(f"{model}.json")
            agc = kind.find_tuning_algo(tuning, "rpi.agc")
        except (RuntimeError, KeyError, StopIteration):
            _log.warning("exposure.not_capped", model=model, exposure_max_ms=self._config.exposure_max_ms)
            return None
        return cap_exposure(tuning, agc, round(self._config.exposure_max_ms * 1000.0))

    # --------------------------------------------------------------------------------------------- the camera's thread
    def _grab(self) -> Frame | None:
        least_s, frames = (NEXT_FRAME_S, NEXT_FRAMES) if self._sequence else (FIRST_FRAME_S, FIRST_FRAMES)
        limit_s = max(least_s, frames / self._config.frame_rate_hz)
        try:
            request = self._camera.capture_request(wait=limit_s)
        except TimeoutError:
            raise CameraError(
                f"the Pi camera gave no frame for {limit_s:.3g} s", "check the ribbon cable, and restart"
            ) from None
        try:
            metadata: Mapping[str, Any] = request.get_metadata()
            planes = request.make_array("main")
        finally:
            request.release()
        width, height = self._camera.stream_configuration("main")["size"]  # libcamera may have adjusted what was asked
        if (width, height) != self._size_px:
            raise CameraError(
                f"the Pi camera: images are {width}x{height}, the lens file is for "
                f"{self._size_px[0]}x{self._size_px[1]}",
                "give the lens file of this image size",
            )
        # YUV420: the first `height` rows are Y; a row may be longer than the image is wide.
        grey = np.ascontiguousarray(planes[:height, :width])
        exposure_us = float(metadata.get("ExposureTime", 0.0))
        t_capture_s = mid_exposure_s(
            int(metadata["SensorTimestamp"]),
            exposure_us,
            self._config.readout_ms / 1000.0,
            time.monotonic(),
            time.clock_gettime(time.CLOCK_BOOTTIME),
        )
        self._sequence += 1
        gain = float(metadata.get("AnalogueGain", 0.0)) * float(metadata.get("DigitalGain", 1.0))
        return Frame(
            t_capture_s, self._sequence - 1, grey, exposure_s=exposure_us / 1e6, gain=gain if gain > 0.0 else None
        )

    def _release(self) -> None:
        """close() alone: it ends picamera2's event loop and then stops the camera by itself. stop() would ask that
        loop, and wait for ever behind the request for a frame that never came (picamera2 issue 1264).
        """
        camera, self._camera = self._camera, None
        camera.close()
