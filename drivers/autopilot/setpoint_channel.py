"""Setpoints on their way to the wire: each once, at once or never. It knows no MAVLink: it is given how to send.

The age of a setpoint is looked at on the sending thread, last of all, so that a process that was stopped and goes on,
or a machine that was too busy, sends nothing of what it had decided before.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from app.log import get_logger

AGE_MAX_S = 0.2
"""An older setpoint is not sent."""
CLOSE_MAX_S = 2.0
"""A link that takes nothing for so long is closed under what waits for it."""

_log = get_logger("autopilot")


class SetpointChannel:
    """Sends on one thread of its own, so that a setpoint never waits behind other calls in the loop's executor.

    Attributes:
        sent: Setpoints given to the wire.
        dropped: Setpoints that were too old, or came while the one before was still being sent.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="setpoint")
        self._busy = False
        self._call: Future[str] | None = None
        self._failing = False
        self.sent = 0
        self.dropped = 0

    async def send(self, put: Callable[[], str], t_s: float) -> None:
        """Send a setpoint if it is fresh and the one before has left.

        A link that takes nothing is no error: it is logged at its first time, and PX4 acts on the missing setpoints.

        Args:
            put: Blocking; puts the setpoint on the wire and returns "" or what went wrong.
            t_s: When it was computed (time.monotonic).
        """
        if self._busy:
            self.dropped += 1
            return
        self._busy = True
        call = self._call = self._thread.submit(self._put_if_fresh, put, t_s)
        call.add_done_callback(self._on_done)
        try:
            async with asyncio.timeout(AGE_MAX_S):
                fault = await asyncio.wrap_future(call)
        except TimeoutError:
            fault = "blocked"
        if fault and not self._failing:
            _log.warning("setpoint.not_sent", fault=fault)
        self._failing = bool(fault)

    async def close(self) -> None:
        """Take no more, and wait until what is being sent has left: the link must not go away under it."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        if self._call is not None and not self._call.done():
            await asyncio.wait([asyncio.wrap_future(self._call)], timeout=CLOSE_MAX_S)

    def _on_done(self, _: Future[str]) -> None:
        """On whichever thread the call ended or was cancelled."""
        self._busy = False

    def _put_if_fresh(self, put: Callable[[], str], t_s: float) -> str:
        if time.monotonic() - t_s > AGE_MAX_S:
            self.dropped += 1
            return "too old"
        fault = put()
        self.sent += not fault
        return fault
