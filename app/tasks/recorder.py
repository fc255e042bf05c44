"""The flight record: everything that travels between tasks, written as it comes."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from app.channels import Window
from app.ports import Recorder


@dataclass(frozen=True, slots=True)
class Recorded:
    """One topic of the record.

    Attributes:
        topic: Its name there.
        items: Where its messages come from; what a full window pushes out is missing in the record, nothing else.
    """

    topic: str
    items: Window[Any]


async def run_recorder(*, recorder: Recorder, recorded: tuple[Recorded, ...]) -> None:
    """Record until cancelled."""
    async with asyncio.TaskGroup() as group:
        for source in recorded:
            group.create_task(_record(recorder, source))


async def _record(recorder: Recorder, source: Recorded) -> None:
    while True:
        message = await source.items.get()
        t_s = message.t_capture_s if hasattr(message, "t_capture_s") else message.t_s
        recorder.write(source.topic, t_s, message)
