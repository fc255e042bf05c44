"""What is not worth its space is not written."""

from __future__ import annotations

import asyncio
import contextlib

from app.channels import Topic
from app.clock import LoopClock, run_virtual
from app.messages import OperatorText
from app.tasks.recorder import Recorded, run_recorder


class _Kept:
    def __init__(self):
        self.texts = []

    def write(self, topic, t_s, message):
        self.texts.append((topic, t_s, message.text))


async def _record_three():
    topic, kept, wanted = Topic("texts"), _Kept(), [False]
    source = Recorded("texts", topic.subscribe_window(8), lambda: wanted[0])
    task = asyncio.create_task(run_recorder(recorder=kept, recorded=(source,), clock=LoopClock()))
    for number, want in enumerate([False, True, False]):
        wanted[0] = want
        topic.publish(OperatorText(f"{number}"))
        await asyncio.sleep(1.0)
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    return kept.texts


def test_recorder_writes_only_what_is_wanted_when_it_comes():
    assert run_virtual(_record_three()) == [("texts", 1.0, "1")]
