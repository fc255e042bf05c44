"""What the person with the phone asks for: one order after the other, each when its time has come."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

from app.errors import AlightError
from app.messages import OperatorAction

READY_TIMEOUT_S = 60.0
ASK_AGAIN_S = 1.0
"""A phone whose order was refused (not ready, no frames yet) asks again."""
HEAR_TIMEOUT_S = 10.0


def at_once() -> bool:
    """The time of an order that waits for nothing."""
    return True


@dataclass(frozen=True, slots=True)
class Order:
    """One order.

    Attributes:
        action: What is asked for.
        when: Whether its time has come; looked at a few times a second, after the order before it was taken.
    """

    action: OperatorAction
    when: Callable[[], bool] = at_once


class Caller:
    """Gives the orders: the first until the mission begins, each later one until it is not refused.

    Args:
        orders: In their turn; none: somebody else's phone will.
        phone: Asks for an action and returns the last line that was heard.
    """

    def __init__(self, orders: tuple[Order, ...], phone: Callable[[OperatorAction], Coroutine[Any, Any, str]]) -> None:
        self._orders = orders
        self._phone = phone
        self._taken = 0
        self._call: asyncio.Task[str] | None = None
        self._refused, self._refused_s = "the vehicle did not become ready to arm", 0.0
        self._start_s: float | None = None

    def turn(self, now_s: float, *, ready: bool, begun: bool) -> None:
        """Speak, if it is time to.

        Args:
            now_s: The time.
            ready: The vehicle would take an order to begin.
            begun: A mission flies.

        Raises:
            AlightError: No mission began within READY_TIMEOUT_S.
        """
        self._start_s = now_s if self._start_s is None else self._start_s
        if not self._orders:
            return
        if not begun and self._taken == 0:
            self._ask_to_begin(now_s, ready)
            return
        self._taken = max(self._taken, 1)
        if self._taken > 1 and self._call is not None and self._call.done() and "refused" in self._call.result():
            self._taken -= 1  # the order that was last given
            self._call, self._refused_s = None, now_s
        if self._taken == len(self._orders) or now_s - self._refused_s < ASK_AGAIN_S:
            return
        order = self._orders[self._taken]
        if order.when():
            if self._call is not None:
                self._call.cancel()
            self._speak(order)
            self._taken += 1

    def _ask_to_begin(self, now_s: float, ready: bool) -> None:
        if self._call is not None and self._call.done():
            self._refused, self._refused_s, self._call = self._call.result(), now_s, None
        order = self._orders[0]
        if self._call is None and ready and order.when() and now_s - self._refused_s > ASK_AGAIN_S:
            self._speak(order)
        if now_s - (self._start_s or 0.0) > READY_TIMEOUT_S:
            raise AlightError(
                f"no flight began within {READY_TIMEOUT_S:.0f} s: {self._refused}", "look at the log with --verbose"
            )

    def _speak(self, order: Order) -> None:
        self._call = asyncio.create_task(self._phone(order.action), name="phone")

    async def hear_out(self) -> None:
        """Wait until the phone has heard how the mission ended: it ends by itself then."""
        if self._call is not None:
            await asyncio.wait([self._call], timeout=HEAR_TIMEOUT_S)

    async def hang_up(self) -> None:
        """End a call that still goes on."""
        if self._call is not None:
            self._call.cancel()
            await asyncio.wait([self._call])
