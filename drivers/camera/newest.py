"""A thread that takes frames from a camera and hands the newest to the event loop; what is not taken in time is lost.

Both real cameras sit behind this: a blocking call for a frame on one side, an async iterator on the other.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Callable

from app.errors import CameraError
from app.log import get_logger
from app.messages import Frame

STOP_S = 5.0
"""A blocking call may last this long; beyond it the thread is left to end by itself."""

_log = get_logger("camera")


class NewestFrame:
    """Runs `grab` again and again on a thread.

    Args:
        grab: Waits a bounded time for a frame and returns it; None at the end of the source. Raises CameraError.
        close: Releases the camera, on the same thread, whatever happened. The end of the frames is told before: the
            release of a camera that has failed may fail too, or never return.

    Attributes:
        dropped: Frames that were overwritten unread.
    """

    def __init__(self, grab: Callable[[], Frame | None], close: Callable[[], None]) -> None:
        self._grab = grab
        self._close = close
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._newest: Frame | None = None
        self._error: CameraError | None = None
        self._ended = False
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self.dropped = 0

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    async def stop(self) -> None:
        """Stop the thread and wait until the camera is released, but not for ever."""
        self._stopping.set()
        self._end(None)
        await asyncio.to_thread(self._thread.join, STOP_S)
        if self._thread.is_alive():
            _log.error("camera.not_released", fault=f"it takes longer than {STOP_S:g} s")

    def wait_s(self, seconds: float) -> None:
        """For `grab`: wait, but not beyond a stop."""
        self._stopping.wait(max(0.0, seconds))

    async def frames(self) -> AsyncIterator[Frame]:
        """Frames as they come.

        Raises:
            CameraError: The camera failed.
        """
        while True:
            await self._changed.wait()
            self._changed.clear()
            frame, self._newest = self._newest, None
            if frame is not None:
                yield frame
            if self._ended and self._newest is None:
                if self._error is not None:
                    raise self._error
                self._changed.set()  # for whoever asks again
                return

    # --------------------------------------------------------------------------------------------- the camera's thread
    def _run(self) -> None:
        error: CameraError | None = None
        try:
            while not self._stopping.is_set():
                frame = self._grab()
                if frame is None:
                    break
                self._tell(self._put, frame)
        except CameraError as fault:
            error = fault
        except Exception as fault:
            error = CameraError(f"the camera failed ({type(fault).__name__}: {fault})", "see the log, and restart it")
        finally:
            self._tell(self._end, error)
            self._release()

    def _release(self) -> None:
        try:
            self._close()
        except Exception as fault:
            _log.error("camera.not_released", fault=f"{type(fault).__name__}: {fault}")

    def _tell(self, call: Callable[..., None], *args: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody listens any more
            self._loop.call_soon_threadsafe(call, *args)

    # -------------------------------------------------------------------------------------------------- the event loop
    def _put(self, frame: Frame) -> None:
        self.dropped += self._newest is not None
        self._newest = frame
        self._changed.set()

    def _end(self, error: CameraError | None) -> None:
        self._error = self._error or error
        self._ended = True
        self._changed.set()
