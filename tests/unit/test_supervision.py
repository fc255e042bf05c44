"""How often a part that fails is started again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial

import pytest

from app.channels import Topic
from app.clock import run_virtual
from app.messages import OperatorText
from app.supervision import GOOD_RUN_S, RESTARTS_MAX, supervise

FAILURES = 2 * RESTARTS_MAX


class HiccupError(Exception):
    """What a part fails of."""


class Part:
    """Runs for a time and fails, again and again; in the end it ends in good order."""

    def __init__(self, runs_s: Callable[[int], float]) -> None:
        self._runs_s = runs_s
        self.runs = 0

    async def run(self) -> None:
        self.runs += 1
        await asyncio.sleep(self._runs_s(self.runs))
        if self.runs <= FAILURES:
            raise HiccupError("one odd frame")


def supervised(part: Part, *, vital: bool = True) -> list[str]:
    """What the phone is told."""

    async def main() -> list[str]:
        texts: Topic[OperatorText] = Topic("texts")
        told = texts.subscribe_all()
        await supervise("camera", part.run, proven=lambda: True, texts=texts, vital=vital)
        return [text.text for text in told.drain()]

    return run_virtual(main())


def lasting(runs_s: float, number: int) -> float:
    return runs_s


def test_part_with_a_hiccup_a_day_is_started_again_each_time():
    part = Part(partial(lasting, 86400.0))
    assert supervised(part) == ["camera failed, restart 1"] * FAILURES
    assert part.runs == FAILURES + 1


def test_part_that_runs_well_for_less_than_five_minutes_each_time_ends_all():
    part = Part(partial(lasting, GOOD_RUN_S - 1.0))
    with pytest.raises(HiccupError):
        supervised(part)
    assert part.runs == RESTARTS_MAX + 1


def test_part_that_is_not_vital_is_given_up_after_as_many_restarts():
    part = Part(partial(lasting, 1.0))
    assert supervised(part, vital=False)[-1] == "camera failed for good"
    assert part.runs == RESTARTS_MAX + 1


def test_good_run_between_failures_gives_all_restarts_back():
    """Four short runs, one of five minutes, and then the short ones to the end."""
    part = Part(lambda number: GOOD_RUN_S if number == 5 else 1.0)
    with pytest.raises(HiccupError):
        supervised(part)
    assert part.runs == 5 + RESTARTS_MAX
