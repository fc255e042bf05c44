"""Gives frames to whoever connects to the camera's Unix socket, and takes from there how the camera shall expose.

A slow reader gets the newest frame, not all. When the one who told the exposure goes, the camera exposes by itself
again.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from pathlib import Path

from drivers.simulator.shutter import Exposure
from drivers.simulator.wire import ORDER_BYTES, unpack_order

SEND_TIMEOUT_S = 2.0
ACCEPT_TIMEOUT_S = 0.2
Tell = Callable[[Exposure | None], None]


def _ignore(_: Exposure | None) -> None:
    """A camera whose exposure is nobody's business."""


class _Reader:
    """One connected application: a thread that sends it the newest packet, and one that takes its orders."""

    def __init__(self, connection: socket.socket, tell: Tell) -> None:
        self._connection = connection
        self._connection.settimeout(SEND_TIMEOUT_S)
        self._tell = tell
        self._ready = threading.Condition()
        self._packet: tuple[bytes, bytes] | None = None
        self._open = True
        self._threads = [
            threading.Thread(target=self._run, name="frame-reader", daemon=True),
            threading.Thread(target=self._take_orders, name="frame-orders", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def alive(self) -> bool:
        return self._open

    def offer(self, packet: tuple[bytes, bytes]) -> None:
        with self._ready:
            self._packet = packet
            self._ready.notify()

    def close(self) -> None:
        with self._ready:
            self._open = False
            self._ready.notify()
        for thread in self._threads:
            thread.join(SEND_TIMEOUT_S + 1.0)

    def _take_orders(self) -> None:
        """Until the other end closes, or this one does."""
        received, told = b"", False
        with contextlib.suppress(OSError, ValueError):
            while self._open:
                try:
                    part = self._connection.recv(ORDER_BYTES - len(received))
                except TimeoutError:
                    continue
                if not part:
                    break
                received += part
                if len(received) == ORDER_BYTES:
                    self._tell(unpack_order(received))
                    received, told = b"", True
        if told:
            self._tell(None)

    def _run(self) -> None:
        with self._connection:
            self._send_all()
            # Wakes the other thread, which waits for orders.
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)

    def _send_all(self) -> None:
        while True:
            with self._ready:
                while self._packet is None and self._open:
                    self._ready.wait()
                if not self._open:
                    return
                packet, self._packet = self._packet, None
            try:
                for part in packet or ():
                    self._connection.sendall(part)
            except OSError:
                self._open = False
                return


class FrameServer:
    """Listens on a Unix socket.

    Args:
        path: Of the socket; a stale one is replaced.
        tell: Takes how the camera shall expose; None: by itself. Called on other threads.
    """

    def __init__(self, path: Path, tell: Tell = _ignore) -> None:
        self._path = path
        self._tell = tell
        path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        self._listener.listen(4)
        self._listener.settimeout(ACCEPT_TIMEOUT_S)
        self._readers: list[_Reader] = []
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._accept, name="frame-server", daemon=True)
        self._thread.start()

    def publish(self, header: bytes, pixels: bytes) -> None:
        """Offer a frame to everybody that is connected."""
        with self._lock:
            self._readers = [reader for reader in self._readers if reader.alive]
            for reader in self._readers:
                reader.offer((header, pixels))

    def close(self) -> None:
        """Stop listening and drop everybody."""
        self._closing.set()
        self._thread.join(ACCEPT_TIMEOUT_S + 1.0)
        self._listener.close()
        with self._lock:
            for reader in self._readers:
                reader.close()
            self._readers = []
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        while not self._closing.is_set():
            with contextlib.suppress(TimeoutError):
                connection, _ = self._listener.accept()
                with self._lock:
                    self._readers.append(_Reader(connection, self._tell))
