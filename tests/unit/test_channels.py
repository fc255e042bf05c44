"""Latest keeps the newest and counts what it drops; Events keeps all in order; a Topic reaches every subscriber."""

import asyncio

import pytest

from app.channels import Events, Latest, Topic


async def test_latest_two_puts_before_a_read_gives_the_newer_and_counts_one_dropped():
    queue: Latest[str] = Latest("frames")
    queue.put_newest("old")
    queue.put_newest("new")
    assert await queue.get() == "new"
    assert (queue.dropped, queue.empty(), queue.name) == (1, True, "frames")


async def test_latest_newest_stays_readable_after_the_queue_was_emptied():
    queue: Latest[int] = Latest("tracks")
    assert queue.newest is None
    queue.put_newest(7)
    await queue.get()
    assert (queue.newest, queue.dropped) == (7, 0)


async def test_latest_waiting_reader_is_woken_by_a_put():
    queue: Latest[int] = Latest("fixes")
    async with asyncio.TaskGroup() as group:
        reader = group.create_task(queue.get())
        group.create_task(_put(queue, 3))
    assert reader.result() == 3


async def _put(queue: Latest[int], item: int) -> None:
    queue.put_newest(item)


async def test_events_come_out_in_order():
    queue: Events[int] = Events("commands")
    queue.emit(1)
    queue.emit(2)
    queue.emit(3)
    assert await queue.get() == 1
    assert queue.drain() == [2, 3]
    assert queue.drain() == []


async def test_events_beyond_the_capacity_raise_and_lose_nothing():
    queue: Events[str] = Events("events", capacity=2)
    queue.emit("first")
    queue.emit("second")
    with pytest.raises(asyncio.QueueFull):
        queue.emit("third")
    assert queue.drain() == ["first", "second"]


async def test_topic_every_subscriber_gets_each_item_in_its_own_queue():
    topic: Topic[int] = Topic("state")
    slow, quick, log = topic.subscribe(), topic.subscribe(), topic.subscribe_all()
    topic.publish(1)
    assert await quick.get() == 1
    topic.publish(2)
    assert (await quick.get(), await slow.get()) == (2, 2)
    assert log.drain() == [1, 2]
    assert (quick.dropped, slow.dropped) == (0, 1)


async def test_topic_without_subscribers_takes_what_is_published():
    Topic[int]("nobody").publish(1)


async def test_topic_subscriber_that_comes_later_gets_only_what_follows():
    topic: Topic[str] = Topic("state")
    topic.publish("before")
    late = topic.subscribe()
    assert late.empty()
    topic.publish("after")
    assert await late.get() == "after"
