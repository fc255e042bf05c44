"""A text stream that is written by a thread of its own, so that no write to it ever waits.

A terminal that is stopped (Ctrl-S), a pager, a full pipe: whoever writes to them directly waits until somebody reads,
and an event loop that waits sends no setpoint. Here a write only puts the text into a bounded queue. What finds no room
is left out and counted, and the count is told in its place once there is room again. What can't be written (a closed
pipe, a full disk) is left out too.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
from collections import deque
from collections.abc import Callable
from typing import TextIO

LIMIT_CHARS = 256 * 1024
"""Of text that waits: about a thousand log events."""
ROOM = 0.5
"""After text was left out, the queue takes text again once no more than this part of it is filled: whoever reads
slowly gets long stretches with a few gaps, not a gap behind every line."""
CLOSE_S = 2.0
"""At the end, what still waits is written for this long, and left out after that."""
LOOK_S = 0.5


def plain_note(lines: int) -> str:
    """The line that tells how many were left out."""
    return f"({lines} lines were left out: nobody read them)\n"


class BackgroundStream:
    """As much of a text stream as structlog, rich and the standard library write to. Its writes never wait or fail.

    Args:
        stream: Where the text goes. If it has a file descriptor that is written to directly: a thread that waits in
            Python's own buffer would hold its lock, and the interpreter could not end.
        note: Makes the line that tells how many lines were left out.
        limit_chars: Of the queue.
    """

    def __init__(
        self, stream: TextIO, note: Callable[[int], str] = plain_note, *, limit_chars: int = LIMIT_CHARS
    ) -> None:
        self.stream = stream
        self._note = note
        self._limit_chars = limit_chars
        self._changed = threading.Condition()
        self._texts: deque[str] = deque()
        self._chars = 0
        self._left_out = 0
        self._writing = False
        self._closed = False
        self._thread: threading.Thread | None = None
        self._descriptor = _descriptor(stream)
        with contextlib.suppress(OSError, ValueError):
            stream.flush()  # what was written to it before comes first

    # ------------------------------------------------------------------------------------------------------ the stream
    def write(self, text: str) -> int:
        """Take text to be written; it is left out, and its lines are counted, while there is no room."""
        with self._changed:
            self._tell_left_out()
            if self._left_out or self._chars + len(text) > self._limit_chars or self._closed:
                self._left_out += max(1, text.count("\n"))
            else:
                self._append(text)
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="output", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        return len(text)

    def flush(self) -> None:
        """Nothing: it is written as soon as the other side takes it. See close()."""

    def isatty(self) -> bool:
        """Whether a person may look at it."""
        return self.stream.isatty()

    def fileno(self) -> int:
        """The descriptor below."""
        return self.stream.fileno()

    @property
    def encoding(self) -> str:
        """Of the stream below."""
        return self.stream.encoding

    @property
    def is_behind(self) -> bool:
        """Whether something still waits to be written: the other side takes less than it is given."""
        with self._changed:
            return bool(self._texts) or self._writing

    def close(self, timeout_s: float = CLOSE_S) -> bool:
        """Write what waits, for at most so long, and end the thread.

        Returns:
            Whether everything was written. Otherwise the rest is lost, and a thread still waits in its last write; it
            does not keep the process from ending.
        """
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            if self._thread is None:
                return True
            done = self._changed.wait_for(lambda: not self._texts and not self._writing, timeout_s)
            self._texts.clear()
            return done

    # ------------------------------------------------------------------------------------------------------ the thread
    def _append(self, text: str) -> None:
        self._texts.append(text)
        self._chars += len(text)

    def _tell_left_out(self) -> None:
        """Put the count of what was left out into its place, once there is room."""
        if self._left_out and self._chars <= ROOM * self._limit_chars:
            self._append(self._note(self._left_out))
            self._left_out = 0

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._texts or self._closed)
                if not self._texts:
                    return
                text = self._texts.popleft()
                self._writing = True
            try:
                self._put(text)
            finally:
                with self._changed:
                    self._chars -= len(text)
                    self._writing = False
                    self._tell_left_out()
                    self._changed.notify_all()

    def _put(self, text: str) -> None:
        with contextlib.suppress(Exception):  # whatever is wrong with a log, it must not end what it tells about
            if self._descriptor is None:
                self.stream.write(text)
                self.stream.flush()
                return
            data = text.encode(self.stream.encoding or "utf-8", "backslashreplace")
            while data:
                try:
                    data = data[os.write(self._descriptor, data) :]
                except BlockingIOError:  # somebody has made it non-blocking
                    select.select([], [self._descriptor], [], LOOK_S)


def _descriptor(stream: TextIO) -> int | None:
    try:
        return stream.fileno()
    except (OSError, ValueError, AttributeError):
        return None  # it is in memory
