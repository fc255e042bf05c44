"""What holds for every test: it leaves no asyncio task behind."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator

import pytest

# As app.__main__ and a campaign's workers have it, before anything loads numpy: the last digits of a matrix product
# depend on how many threads it is spread over, and a flight's on them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_LEAKED: list[str] = []


def pytest_configure(config: pytest.Config) -> None:
    """Register what this file understands."""
    config.addinivalue_line("markers", "leaves_tasks: an event loop is brought down on purpose, with tasks in it")


@pytest.fixture(scope="session", autouse=True)
def _watch_runners() -> Iterator[None]:
    """Note the tasks that still run when an event loop's runner is closed: it would cancel them in silence."""
    close = asyncio.Runner.close

    def close_and_note(runner: asyncio.Runner) -> None:
        try:
            loop = runner.get_loop()
        except RuntimeError:  # closed already
            return close(runner)
        _LEAKED.extend(sorted(repr(task.get_coro()) for task in asyncio.all_tasks(loop)))
        return close(runner)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(asyncio.Runner, "close", close_and_note)
        yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    """Fail a test that leaks a task, once its own runner has been closed too."""
    try:
        return (yield)
    finally:
        leaked, _LEAKED[:] = list(_LEAKED), []
        if leaked and item.get_closest_marker("leaves_tasks") is None:
            pytest.fail(f"{item.name} left asyncio tasks running: {'; '.join(leaked)}", pytrace=False)
