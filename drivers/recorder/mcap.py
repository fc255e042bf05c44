"""The flight record as an MCAP file: the Recorder port. Foxglove Studio opens it.

A thread of its own compresses and writes; the caller only puts into a bounded queue, and what finds it full is dropped
and counted. The file is flushed twice a second, so that what a crash costs is half a second, and put onto the disk
every two seconds, so that a battery that is pulled costs no more than that.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import queue
import threading
import time
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mcap.writer import CompressionType, Writer

from app.errors import RecorderError
from app.log import get_logger
from app.messages import Frame
from drivers.recorder.encoding import FRAME_SCHEMA_NAME, encode, encode_frame, nanoseconds, schema_of

QUEUE_ITEMS = 2048
QUEUE_FRAMES = 16
"""Images are the weight: 16 of 640 x 480 are 5 MB."""
FLUSH_S = 0.5
SYNC_S = 2.0
"""What was flushed is in the kernel's memory only, which it writes within half a minute if nobody asks. While a slow
card takes its time, images that find the queue full are dropped."""
NOT_SYNCED = frozenset({errno.EINVAL, errno.ENOSYS, errno.ENOTSUP})
"""Of files that can't be put onto a disk, and need not: pipes, some network file systems."""
CHUNK_BYTES = 256 * 1024
CLOSE_S = 5.0

_log = get_logger("recorder")
_Item = tuple[str, float, Any]


class McapRecorder:
    """Writes messages to an MCAP file.

    Args:
        path: The file; its directory is made.
        jpeg_quality: Of the images, 10 to 100.
        frame_rate_hz: Images kept a second; 0 for none.

    Attributes:
        written: Messages in the file.
        dropped: Messages that found the queue full or the disk failing.
    """

    def __init__(self, path: Path, *, jpeg_quality: int = 80, frame_rate_hz: float = 30.0) -> None:
        self.path = path
        self.written = 0
        self.dropped = 0
        self._quality = jpeg_quality
        # A little early still counts, or a camera's jitter would cost every other frame.
        self._frame_interval_s = 0.9 / frame_rate_hz if frame_rate_hz > 0 else float("inf")
        self._next_frame_s = float("-inf")
        self._frames_allowed = threading.Semaphore(QUEUE_FRAMES)
        self._queue: queue.Queue[_Item | None] = queue.Queue(QUEUE_ITEMS)
        self._channels: dict[tuple[str, type], int] = {}
        self._schemas: dict[str, int] = {}
        self._thread: threading.Thread | None = None
        self._failed = False

    async def __aenter__(self) -> Self:
        """Create the file.

        Raises:
            RecorderError: It can't be written.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            stream = self.path.open("wb")
        except OSError as fault:
            raise RecorderError(
                f"{self.path}: the flight record can't be written ({fault.strerror})",
                "give a directory that can be written under recorder.directory, or leave it empty for no record",
            ) from None
        writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="", library="alight")
        # Times in the file are monotonic: this tells what time of day they were.
        started = {"utc": datetime.now(UTC).isoformat(), "monotonic_s": repr(time.monotonic())}
        writer.add_metadata("alight.start", started)
        self._thread = threading.Thread(target=self._run, args=(writer, stream), name="recorder", daemon=True)
        self._thread.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write what waits, and close the file with its index."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        await asyncio.to_thread(self._finish, thread)
        _log.info("record.closed", path=str(self.path), written=self.written, dropped=self.dropped)

    def _finish(self, thread: threading.Thread) -> None:
        try:
            self._queue.put(None, timeout=CLOSE_S)
        except queue.Full:
            self._failed = True
        thread.join(timeout=CLOSE_S)

    def write(self, topic: str, t_s: float, message: Any) -> None:
        """Record a message (a dataclass) under a topic. Never blocks: it is dropped if the disk doesn't keep up."""
        if self._thread is None or self._failed:
            self.dropped += 1
            return
        if isinstance(message, Frame):
            if t_s < self._next_frame_s:
                return
            self._next_frame_s = t_s + self._frame_interval_s
            if not self._frames_allowed.acquire(blocking=False):
                self.dropped += 1
                return
        try:
            self._queue.put_nowait((topic, t_s, message))
        except queue.Full:
            self.dropped += 1
            if isinstance(message, Frame):
                self._frames_allowed.release()

    # ---------------------------------------------------------------------------------------------- the writing thread
    def _run(self, writer: Any, stream: Any) -> None:
        try:
            self._write_all(writer, stream)
            writer.finish()
            _sync(stream)
        except OSError as fault:
            self._failed = True
            _log.error("record.failed", path=str(self.path), fault=fault.strerror)
        finally:
            with contextlib.suppress(OSError):  # a full disk is full for what still waits, too
                stream.close()

    def _write_all(self, writer: Any, stream: Any) -> None:
        flush_s = time.monotonic() + FLUSH_S
        sync_s = time.monotonic() + SYNC_S
        while not self._failed:
            try:
                item = self._queue.get(timeout=max(0.0, flush_s - time.monotonic()))
            except queue.Empty:
                item = ("", 0.0, None)
            if item is None:
                return
            if item[0]:
                self._write_one(writer, *item)
            if time.monotonic() >= flush_s:
                writer.flush()
                if time.monotonic() >= sync_s:
                    _sync(stream)
                    sync_s = time.monotonic() + SYNC_S
                flush_s = time.monotonic() + FLUSH_S

    def _write_one(self, writer: Any, topic: str, t_s: float, message: Any) -> None:
        is_frame = isinstance(message, Frame)
        if is_frame:
            self._frames_allowed.release()
        try:
            data = encode_frame(message, self._quality) if is_frame else encode(message)
        except (TypeError, ValueError) as fault:
            self.dropped += 1
            _log.error("message.not_recorded", topic=topic, fault=str(fault))
            return
        t_ns = nanoseconds(t_s)
        writer.add_message(self._channel(writer, topic, type(message)), t_ns, data, t_ns, self.written)
        self.written += 1

    def _channel(self, writer: Any, topic: str, kind: type) -> int:
        key = (topic, kind)
        if key not in self._channels:
            name = FRAME_SCHEMA_NAME if kind is Frame else f"alight.{kind.__name__}"
            if name not in self._schemas:
                self._schemas[name] = writer.register_schema(name, "jsonschema", schema_of(kind))
            self._channels[key] = writer.register_channel(topic, "json", self._schemas[name])
        return self._channels[key]


def _sync(stream: Any) -> None:
    """Put a file onto the disk.

    Raises:
        OSError: The disk fails.
    """
    stream.flush()
    sync = getattr(os, "fdatasync", os.fsync)  # macOS has no fdatasync
    try:
        sync(stream.fileno())
    except OSError as fault:
        if fault.errno not in NOT_SYNCED:
            raise
