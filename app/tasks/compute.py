"""Where heavy functions run: in a pool of their own, or in place under virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, TypeVar

T = TypeVar("T")


class Compute(Protocol):
    """Runs a function that takes milliseconds."""

    async def __call__(self, function: Callable[[], T]) -> T:
        """Run it and return what it returns."""
        ...


async def in_place(function: Callable[[], T]) -> T:
    """Run it here and now: deterministic, and the only way under virtual time."""
    return function()


class InThread:
    """One thread of vision's own, so that a busy frame delays no telemetry and no setpoint."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="vision")

    async def __call__(self, function: Callable[[], T]) -> T:
        """Run it in the thread."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, function)

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=False, cancel_futures=True)
