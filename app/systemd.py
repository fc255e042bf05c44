"""Tell systemd that the service is ready and alive (sd_notify(3)); silent where no systemd listens."""

from __future__ import annotations

import os
import socket


class Watchdog:
    """Feeds systemd's watchdog. The control loop calls it, so that a loop that hangs is a service that is restarted.

    Args:
        address: Of systemd's notification socket; "" for none. A leading @ is an abstract socket.
    """

    def __init__(self, address: str | None = None) -> None:
        name = os.environ.get("NOTIFY_SOCKET", "") if address is None else address
        self._address = "\0" + name[1:] if name.startswith("@") else name
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if name else None
        self._turns = 0

    def ready(self) -> None:
        """The service is up."""
        self._send(b"READY=1")

    def alive(self) -> None:
        """One turn of the control loop was made; tells systemd at every tenth."""
        self._turns += 1
        if self._turns % 10 == 0:
            self._send(b"WATCHDOG=1")

    def busy(self, seconds: float) -> None:
        """The service is starting or going down and needs this long for it."""
        self._send(b"EXTEND_TIMEOUT_USEC=%d" % round(seconds * 1e6))

    def stopping(self, seconds: float) -> None:
        """Nobody feeds the watchdog any more: the service is going down, and needs this long for it.

        systemd then waits for its end instead: TimeoutStopSec, or as long as this, and kills it after that.
        """
        self._send(b"STOPPING=1")  # first: what is asked for before it is no time to stop in
        self.busy(seconds)

    def close(self) -> None:
        """The service is going down."""
        self._send(b"STOPPING=1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: bytes) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(message, self._address)
        except OSError:
            pass  # systemd is restarting or the socket is full: the next turn tells it again
