"""The queues between tasks. `Latest` keeps the newest item, `Window` the newest few, and both count what they drop;
`Events` keeps all, in order.

A publisher holds a `Topic` and each consumer its own queue, made by `subscribe`, so that one slow consumer never
takes an item from another.
"""

from __future__ import annotations

import asyncio
from typing import Generic, TypeVar

T = TypeVar("T")


class Window(asyncio.Queue[T], Generic[T]):
    """A queue of the newest `length` items: when it is full, a newer item pushes the oldest out.

    Attributes:
        name: What it carries, for logs.
        dropped: How many items were pushed out unread.
        newest: The newest item ever put, read or not; None before the first.
    """

    def __init__(self, name: str, length: int) -> None:
        super().__init__(maxsize=length)
        self.name = name
        self.dropped = 0
        self.newest: T | None = None

    def put_newest(self, item: T) -> None:
        """Put an item, pushing the oldest unread one out if there is no room."""
        if self.full():
            self.get_nowait()
            self.dropped += 1
        self.newest = item
        self.put_nowait(item)

    def drain(self) -> list[T]:
        """Everything that waits now, oldest first, without waiting."""
        return [self.get_nowait() for _ in range(self.qsize())]


class Latest(Window[T], Generic[T]):
    """A queue of one: a newer item overwrites an unread one."""

    def __init__(self, name: str) -> None:
        super().__init__(name, 1)


class Events(asyncio.Queue[T], Generic[T]):
    """First in, first out; full is an error, since an event must never be lost in silence.

    Attributes:
        name: What it carries, for logs.
    """

    def __init__(self, name: str, capacity: int = 256) -> None:
        super().__init__(maxsize=capacity)
        self.name = name

    def emit(self, item: T) -> None:
        """Put an event.

        Raises:
            asyncio.QueueFull: The consumer is `capacity` events behind: a fault, not a load to absorb.
        """
        self.put_nowait(item)

    def drain(self) -> list[T]:
        """Everything that waits now, oldest first, without waiting."""
        return [self.get_nowait() for _ in range(self.qsize())]


class Topic(Generic[T]):
    """One publisher's end: what it publishes reaches every subscriber's own queue."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._windows: list[Window[T]] = []
        self._events: list[Events[T]] = []

    def subscribe(self) -> Latest[T]:
        """A new queue that holds the newest item."""
        queue: Latest[T] = Latest(self.name)
        self._windows.append(queue)
        return queue

    def subscribe_window(self, length: int) -> Window[T]:
        """A new queue that holds the newest `length` items."""
        queue: Window[T] = Window(self.name, length)
        self._windows.append(queue)
        return queue

    def subscribe_all(self, capacity: int = 256) -> Events[T]:
        """A new queue that holds every item, in order."""
        queue: Events[T] = Events(self.name, capacity)
        self._events.append(queue)
        return queue

    def publish(self, item: T) -> None:
        """Give an item to every subscriber."""
        for window in self._windows:
            window.put_newest(item)
        for events in self._events:
            events.emit(item)
