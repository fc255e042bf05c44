"""Virtual time jumps from timer to timer, exactly and without waiting; the real clock is the kernel's monotonic one."""

import asyncio
import time

import pytest

from app.clock import LoopClock, MonotonicClock, run_virtual


def test_virtual_time_an_hour_of_sleep_takes_no_time_and_lands_on_the_hour():
    async def sleep_an_hour() -> float:
        await asyncio.sleep(3600.0)
        return LoopClock().now_s()

    began = time.monotonic()
    assert run_virtual(sleep_an_hour()) == 3600.0
    assert time.monotonic() - began < 5.0


def test_virtual_time_starts_where_it_is_told():
    async def now() -> float:
        return LoopClock().now_s()

    assert run_virtual(now(), start_s=100.0) == 100.0


def test_virtual_time_periodic_tasks_wake_in_the_order_of_their_timers():
    woken: list[tuple[str, float]] = []

    async def tick(name: str, period_s: float, times: int) -> None:
        for k in range(times):
            await asyncio.sleep((k + 1) * period_s - LoopClock().now_s())
            woken.append((name, LoopClock().now_s()))

    async def both() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(tick("slow", 0.5, 2))
            group.create_task(tick("fast", 0.2, 4))

    run_virtual(both())
    assert [name for name, _ in woken] == ["fast", "fast", "slow", "fast", "fast", "slow"]
    assert [t for _, t in woken] == pytest.approx([0.2, 0.4, 0.5, 0.6, 0.8, 1.0])


def test_virtual_time_time_out_fires_at_its_virtual_instant():
    async def wait_too_long() -> float:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(2.5):
                await asyncio.Event().wait()
        return LoopClock().now_s()

    assert run_virtual(wait_too_long()) == 2.5


def test_virtual_time_same_flight_twice_gives_the_same_instants():
    async def instants() -> list[float]:
        seen = []
        for k in range(200):
            await asyncio.sleep(0.02 + k * 1e-5)
            seen.append(LoopClock().now_s())
        return seen

    assert run_virtual(instants()) == run_virtual(instants())


@pytest.mark.leaves_tasks
def test_virtual_time_when_all_wait_for_ever_says_so_instead_of_hanging():
    async def deadlock() -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="no timer is set"):
        run_virtual(deadlock())


def test_monotonic_clock_reads_the_clock_that_camera_timestamps_use():
    before = time.clock_gettime(time.CLOCK_MONOTONIC)
    now_s = MonotonicClock().now_s()
    assert before <= now_s <= time.clock_gettime(time.CLOCK_MONOTONIC)
