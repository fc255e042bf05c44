"""Cameras that OpenCV opens: USB devices, network streams, and video files at their own pace. The Camera port.

Frames are grey, as everywhere (decisions/0005).
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
from app.messages import Frame
from drivers.camera.newest import NewestFrame

OPEN_TIMEOUT_MS = 8000
READ_TIMEOUT_MS = 3000


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
        return Frame(t_capture_s, index, grey.astype(np.uint8, copy=False), name=name)

    def _release(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
