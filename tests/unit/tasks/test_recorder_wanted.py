"""What is not worth its space is not written."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import numpy as np
import pytest

from app.channels import Topic
from app.clock import LoopClock, run_virtual
from app.messages import OperatorText, VehicleState
from app.tasks.recorder import Recorded, Thinned, run_recorder


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


def test_thinned_topic_has_all_of_a_flight_and_one_message_a_second_of_a_wait(fakes: Any):
    """100 messages a second: 4 s of waiting, 3 s of flying and what comes after it, then 6 s of waiting."""

    async def main() -> list[float]:
        recorder, topic = fakes.Recorder(), Topic[VehicleState]("vehicle")
        start_s = fakes.clock.now_s()

        def flying() -> bool:
            return 4.0 <= fakes.clock.now_s() - start_s < 7.0

        source = Recorded("vehicle", topic.subscribe_window(8), Thinned(flying, fakes.clock))
        async with fakes.running(run_recorder(recorder=recorder, recorded=(source,), clock=fakes.clock)):
            for k in range(2300):
                topic.publish(fakes.vehicle(t_capture_s=k / 100))
                await asyncio.sleep(0.01)
        return [t_s for _, t_s in recorder.written]

    times = np.array(run_virtual(main()))
    waiting, flight, after = times < 3.985, (times > 3.995) & (times < 16.985), times > 17.0
    assert waiting.sum() == 4
    assert flight.sum() == pytest.approx(1300, abs=2)
    assert 5 <= after.sum() <= 7
