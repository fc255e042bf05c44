"""One monotonic clock in seconds, injected; and an event loop whose time is virtual.

Under `run_virtual` the loop's time jumps to the next timer whenever nothing is ready, so the same coroutines that fly
a vehicle run as fast as the machine allows and to the same result each time. Nothing under it may wait on a thread or
a socket: those live in real time.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


class Clock(Protocol):
    """Seconds of a monotonic clock that all messages of one process share."""

    def now_s(self) -> float:
        """The time now."""
        ...


class MonotonicClock:
    """CLOCK_MONOTONIC: the clock that camera timestamps on Linux use too."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start, never set back."""
        return time.monotonic()


class LoopClock:
    """The time of the running event loop: real under asyncio.run, virtual under run_virtual."""

    def now_s(self) -> float:
        """The running loop's time."""
        return asyncio.get_running_loop().time()


LAST_WAKE_S = 0.5
"""Real seconds, when nothing else can happen any more."""


class _VirtualSelector(selectors.SelectSelector):
    """Never blocks: where a real selector would sleep, the virtual time jumps."""

    def __init__(self, advance: Callable[[float], None]) -> None:
        super().__init__()
        self._advance = advance

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            # The loop's own end waits for its executor's threads, which wake it through a socket: real, but short.
            ready = super().select(LAST_WAKE_S)
            if ready:
                return ready
            raise RuntimeError("virtual time: every task waits and no timer is set, so nothing would ever happen")
        if timeout > 0:
            self._advance(timeout)
        return super().select(0)


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock moves only when every task is waiting, and then straight to the next timer."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        super().__init__(_VirtualSelector(self._jump))

    def time(self) -> float:
        """Virtual seconds."""
        return self._now_s

    def _jump(self, timeout_s: float) -> None:
        scheduled: list[asyncio.TimerHandle] = getattr(self, "_scheduled", [])
        # Straight to the timer, not by the rounded time-out: the same instants on every machine. The loop keeps its
        # timers as a heap, the next one first.
        self._now_s = max(self._now_s, scheduled[0].when()) if scheduled else self._now_s + timeout_s


def run_virtual(main: Coroutine[Any, Any, T], start_s: float = 0.0) -> T:
    """Run a coroutine to its end under virtual time, and return what it returns."""
    with asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(start_s)) as runner:
        return runner.run(main)
