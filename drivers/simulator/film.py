"""The camera's timing in real time: frames are drawn in a thread of their own and given out when they are due.

Drawing never delays the vehicle: an instant that comes while the last one is still being drawn is dropped, as a camera
drops frames that nobody fetches.
"""

from __future__ import annotations

import queue
import threading
import time
from typing import Protocol

from drivers.simulator.frame_server import FrameServer
from drivers.simulator.shutter import Exposure, Shot, Shutter
from drivers.simulator.wire import FrameHeader
from drivers.simulator.world import Truth


class Draws(Protocol):
    """What draws a frame."""

    def shoot(self, truth: Truth, told: Exposure | None) -> Shot:
        """The frame of an instant, exposed as told; None: by itself."""
        ...


class Film:
    """Two threads: one draws, one delivers.

    Args:
        renderer: Draws.
        server: Takes the frames.
        shutter: What the camera has been told.
        latency_s: From mid-exposure to delivery.
        clock_error_s: How much earlier than their exposure the frames' times are.

    Attributes:
        drawn: Frames so far.
        dropped: Instants that were not drawn, the last one not being finished.
        late_s: Longest time that a frame came after it was due.
        failure: What ended the drawing, or None.
    """

    def __init__(
        self, renderer: Draws, server: FrameServer, shutter: Shutter, latency_s: float, clock_error_s: float = 0.0
    ) -> None:
        self._renderer, self._server, self._shutter = renderer, server, shutter
        self._latency_s, self._clock_error_s = latency_s, clock_error_s
        self._instants: queue.Queue[tuple[int, float, Truth, Exposure | None] | None] = queue.Queue(maxsize=2)
        self._frames: queue.Queue[tuple[FrameHeader, bytes] | None] = queue.Queue(maxsize=64)
        self._sequence = 0
        self.drawn = 0
        self.dropped = 0
        self.late_s = 0.0
        self.failure: Exception | None = None
        self._threads = [
            threading.Thread(target=self._draw, name="film-draw", daemon=True),
            threading.Thread(target=self._deliver, name="film-deliver", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def expose(self, t_capture_s: float, truth: Truth) -> None:
        """Take a frame of an instant; t_capture_s: its time on CLOCK_MONOTONIC."""
        self._sequence += 1
        told = self._shutter.next()
        try:
            self._instants.put_nowait((self._sequence, t_capture_s, truth, told))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Finish what is being drawn and end both threads."""
        if self.failure is None:
            self._instants.put(None)
        for thread in self._threads:
            thread.join(5.0)

    def _draw(self) -> None:
        try:
            self._draw_all()
        except Exception as error:  # the process's main loop ends with it
            self.failure = error
        self._frames.put(None)

    def _draw_all(self) -> None:
        while (instant := self._instants.get()) is not None:
            sequence, t_capture_s, truth, told = instant
            shot = self._renderer.shoot(truth, told)
            self.drawn += 1
            height, width = shot.image.shape
            told_s = t_capture_s - self._clock_error_s
            header = FrameHeader(sequence, told_s, shot.exposure.exposure_s, shot.exposure.gain, width, height)
            self._frames.put((header, shot.image.tobytes()))

    def _deliver(self) -> None:
        while (frame := self._frames.get()) is not None:
            header, pixels = frame
            wait_s = header.t_capture_s + self._clock_error_s + self._latency_s - time.monotonic()
            if wait_s > 0.0:
                time.sleep(wait_s)
            else:
                self.late_s = max(self.late_s, -wait_s)
            self._server.publish(header.pack(), pixels)
