"""Cameras that OpenCV opens: USB devices, network streams, and video files at their own pace. The Camera port.

Frames are grey, as everywhere (decisions/0005).

The exposure of a USB device can be told where its driver has both controls: V4L2 counts it in 0.1 ms and has no common
unit of gain, so its gain stays as it is. OpenCV's set() says yes even if the driver refuses, so what counts is what is
read back. A stream and a file can't be told.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from app.config import CameraConfig
from app.errors import CameraError
from app.log import get_logger
from app.messages import ExposureLimits, Frame
from drivers.camera.newest import NewestFrame

OPEN_TIMEOUT_MS = 8000
READ_TIMEOUT_MS = 3000
EXPOSURE_UNIT_S = 1e-4
"""Of V4L2_CID_EXPOSURE_ABSOLUTE (the kernel's documentation of camera controls)."""
MANUAL, AUTOMATIC = 1.0, 3.0
"""V4L2_EXPOSURE_MANUAL; V4L2_EXPOSURE_APERTURE_PRIORITY, in which a USB camera sets the time by itself."""
SETTLING_FRAMES = 4
"""After a change, frames whose exposure isn't known: some are under way, some cameras take two or three more."""
REFUSED_S = 10.0
"""A device that did not take its exposure exposes by itself for so long, then it is told again."""

_log = get_logger("camera")


class OpenCvCamera:
    """A camera at `config.source`: a device number or /dev path, a URL, or a video file.

    A live frame's time is its arrival less `config.latency_s`. A file starts when it is opened, and its frames come,
    and have their times, at its own frame rate.

    Args:
        config: Source, frame rate and latency.
        size_px: (width, height) that the lens file is for; another size is an error, since its geometry would be wrong.
            None takes what comes.
    """

    def __init__(self, config: CameraConfig, size_px: tuple[int, int] | None = None) -> None:
        self._config = config
        self._size_px = size_px
        self._source = config.source
        self._is_device = self._source.isdigit() or self._source.startswith("/dev/")
        self._is_file = not self._is_device and "://" not in self._source
        self._capture: cv2.VideoCapture | None = None
        self._reader: NewestFrame | None = None
        self._sequence = 0
        self._start_s = 0.0
        self._file_rate_hz = config.frame_rate_hz
        self._limits: ExposureLimits | None = None
        self._wanted_s: float | None = None
        self._told_s: float | None = None
        self._exposure_s: float | None = None
        self._settling = 0
        self._again_s: float | None = None

    async def __aenter__(self) -> Self:
        """Open the source.

        Raises:
            CameraError: It doesn't open.
        """
        self._capture = await asyncio.to_thread(self._open)
        self._sequence = 0
        self._start_s = time.monotonic()
        self._reader = NewestFrame(self._grab, self._release)
        self._reader.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop reading and release the source."""
        reader, self._reader = self._reader, None
        if reader is not None:
            await reader.stop()

    def frames(self) -> AsyncIterator[Frame]:
        """Frames as they come; ends with a file.

        Raises:
            CameraError: The camera is closed, gives images of another size, or stopped giving any.
        """
        if self._reader is None:
            raise CameraError(f"{self._source}: the camera is closed", "open it first")
        return self._reader.frames()

    @property
    def exposure_control(self) -> Self | None:
        """None: it is no device, or its driver does not take an exposure."""
        return None if self._limits is None else self

    @property
    def limits(self) -> ExposureLimits:
        """What it can be told; its gain is fixed, and called 1."""
        if self._limits is None:
            raise CameraError(f"{self._source}: its exposure can't be told", "leave it to the camera")
        return self._limits

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        """Expose so; the camera's thread tells the driver before its next frame."""
        self._wanted_s = exposure_s

    def set_auto(self) -> None:
        """Expose by itself again."""
        self._wanted_s = None

    def _open(self) -> cv2.VideoCapture:
        if not self._source:
            raise CameraError("camera.source is empty", "give a device number, a URL or a video file")
        if self._is_file and not Path(self._source).is_file():
            raise CameraError(f"{self._source}: no such file", "give a video file, a device number or a URL")
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what it would print is said by the error
        if self._is_device:
            device: int | str = int(self._source) if self._source.isdigit() else self._source
            capture = cv2.VideoCapture(device, cv2.CAP_V4L2)
        else:
            limits = [
                cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
                OPEN_TIMEOUT_MS,
                cv2.CAP_PROP_READ_TIMEOUT_MSEC,
                READ_TIMEOUT_MS,
            ]
            capture = cv2.VideoCapture(self._source, cv2.CAP_FFMPEG, [] if self._is_file else limits)
        if not capture.isOpened():
            capture.release()
            raise CameraError(f"{self._source}: the camera does not open", self._advice())
        if self._is_device:
            if self._size_px is not None:
                capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size_px[0])
                capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size_px[1])
            capture.set(cv2.CAP_PROP_FPS, self._config.frame_rate_hz)
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
            self._limits = self._exposure_limits(capture)
        elif self._is_file:
            rate_hz = float(capture.get(cv2.CAP_PROP_FPS))
            self._file_rate_hz = rate_hz if math.isfinite(rate_hz) and rate_hz > 0 else self._config.frame_rate_hz
        return capture

    def _advice(self) -> str:
        if self._is_device:
            return "plug it in, see that no other program uses it, and that this user is in the group video"
        return "give a video file that plays" if self._is_file else "check the address, and that the stream plays"

    # --------------------------------------------------------------------------------------------- the camera's thread
    def _grab(self) -> Frame | None:
        capture, reader = self._capture, self._reader
        if capture is None or reader is None:
            return None
        index = self._sequence
        self._tell_exposure(capture)
        got = capture.grab()
        arrival_s = time.monotonic()
        ok, image = capture.retrieve() if got else (False, None)
        if not ok or image is None:
            if self._is_file and index > 0:
                return None
            raise CameraError(
                f"{self._source}: the camera gave no frame" + ("" if index == 0 else " any more"), self._advice()
            )
        self._sequence += 1
        height, width = image.shape[:2]
        if self._size_px is not None and (width, height) != self._size_px:
            raise CameraError(
                f"{self._source}: images are {width}x{height}, the lens file is for "
                f"{self._size_px[0]}x{self._size_px[1]}",
                "give the lens file of this image size",
            )
        t_capture_s, name = arrival_s - self._config.latency_s, ""
        if self._is_file:
            t_capture_s, name = self._start_s + index / self._file_rate_hz, f"{self._source}#{index}"
            reader.wait_s(t_capture_s - time.monotonic())
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
        exposure_s = self._exposure_s if self._settling == 0 else None
        return Frame(
            t_capture_s,
            index,
            grey.astype(np.uint8, copy=False),
            exposure_s,
            name,
            gain=None if exposure_s is None else 1.0,
        )

    def _exposure_limits(self, capture: cv2.VideoCapture) -> ExposureLimits | None:
        """What the device takes, tried out and read back; None: it doesn't take any."""
        before = capture.get(cv2.CAP_PROP_AUTO_EXPOSURE)
        longest_s = min(self._config.exposure_max_ms / 1e3, 1.0 / self._config.frame_rate_hz)
        longest = max(1.0, math.floor(longest_s / EXPOSURE_UNIT_S))
        try:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL)
            taken = []
            for value in (1.0, longest):
                capture.set(cv2.CAP_PROP_EXPOSURE, value)
                taken.append(capture.get(cv2.CAP_PROP_EXPOSURE))
            if capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) != MANUAL or not 0.0 < taken[0] < taken[1]:
                return None
            return ExposureLimits(taken[0] * EXPOSURE_UNIT_S, taken[1] * EXPOSURE_UNIT_S)
        finally:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, before if before > 0 else AUTOMATIC)

    def _tell_exposure(self, capture: cv2.VideoCapture) -> None:
        """Pass on what was asked for since the last frame, and note what the driver made of it.

        If that can't be read back, the device goes back to automatic, and is told once more later: left in manual, it
        would keep an exposure that nobody knows, and from whose frames no other can be worked out.
        """
        wanted_s = self._wanted_s
        waits = wanted_s is not None and self._again_s is not None and time.monotonic() < self._again_s
        if wanted_s == self._told_s or self._limits is None or waits:
            self._settling = max(0, self._settling - 1)
            return
        if wanted_s is None:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, AUTOMATIC)
            self._exposure_s = None
        else:
            if self._told_s is None:
                capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL)
            capture.set(cv2.CAP_PROP_EXPOSURE, max(1.0, round(wanted_s / EXPOSURE_UNIT_S)))
            self._exposure_s = capture.get(cv2.CAP_PROP_EXPOSURE) * EXPOSURE_UNIT_S
            if self._exposure_s <= 0.0:
                if self._again_s is None:
                    _log.error("exposure.not_set", source=self._source, exposure_ms=1e3 * wanted_s)
                capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, AUTOMATIC)
                self._exposure_s = wanted_s = None
                self._again_s = time.monotonic() + REFUSED_S
            elif self._again_s is not None:
                _log.info("exposure.set_again", source=self._source, exposure_ms=1e3 * self._exposure_s)
                self._again_s = None
        self._told_s = wanted_s
        self._settling = SETTLING_FRAMES

    def _release(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
