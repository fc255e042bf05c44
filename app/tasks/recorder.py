"""The flight record: everything that travels between tasks, written as it comes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from app.channels import Window
from app.clock import Clock
from app.ports import Recorder

WAITING_EACH_S = 1.0
AFTERWARDS_S = 10.0
"""The motors' stop and what the mission says of it belong to the flight."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """One topic of the record.

    Attributes:
        topic: Its name there.
        items: Where its messages come from; what a full window pushes out is missing in the record, nothing else.
        wanted: Whether a message is worth its space now.
    """

    topic: str
    items: Window[Any]
    wanted: Callable[[], bool] = lambda: True


class Thinned:
    """Wants everything of a flight and of a moment after it; of a wait, one message in a while. A service that waits
    for a day would else make a record of gigabytes, which takes minutes to read.

    Args:
        flying: Whether it flies.
        clock: The clock.
    """

    def __init__(self, flying: Callable[[], bool], clock: Clock) -> None:
        self._flying = flying
        self._clock = clock
        self._all_until_s = self._next_s = float("-inf")

    def __call__(self) -> bool:
        """Whether the message that comes now is wanted."""
        now_s = self._clock.now_s()
        if self._flying():
            self._all_until_s = now_s + AFTERWARDS_S
        if now_s < self._next_s and now_s >= self._all_until_s:
            return False
        self._next_s = now_s + WAITING_EACH_S
        return True


async def run_recorder(*, recorder: Recorder, recorded: tuple[Recorded, ...], clock: Clock) -> None:
    """Record until cancelled."""
    async with asyncio.TaskGroup() as group:
        for source in recorded:
            group.create_task(_record(recorder, source, clock))


async def _record(recorder: Recorder, source: Recorded, clock: Clock) -> None:
    while True:
        message = await source.items.get()
        if source.wanted():
            recorder.write(source.topic, _time_s(message, clock), message)


def _time_s(message: Any, clock: Clock) -> float:
    """A message's own time; now, for one that carries none (a line for the phone)."""
    own = getattr(message, "t_capture_s", getattr(message, "t_s", None))
    return clock.now_s() if own is None else float(own)
