"""The thread behind both real cameras, when a camera can't even be released: its failure is told all the same."""

from __future__ import annotations

import asyncio
import threading
from typing import NoReturn

import pytest

from app.errors import CameraError
from drivers.camera.newest import NewestFrame


def gone() -> NoReturn:
    raise CameraError("the camera is gone", "plug it in")


def broken() -> NoReturn:
    raise RuntimeError("device busy")


async def failure_of(reader: NewestFrame) -> None:
    """Wait for the camera's error."""
    with pytest.raises(CameraError, match="the camera is gone"):
        async with asyncio.timeout(2.0):
            async for _ in reader.frames():
                pass


async def test_camera_whose_release_never_returns_tells_its_failure_and_can_be_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("drivers.camera.newest.STOP_S", 0.05)
    released = threading.Event()
    reader = NewestFrame(gone, lambda: released.wait(10.0) and None)
    reader.start()
    try:
        await failure_of(reader)
        async with asyncio.timeout(2.0):
            await reader.stop()
    finally:
        released.set()


async def test_camera_whose_release_fails_tells_its_failure(capfd: pytest.CaptureFixture[str]) -> None:
    reader = NewestFrame(gone, broken)
    reader.start()
    await failure_of(reader)
    await reader.stop()
    printed = capfd.readouterr()
    assert "camera.not_released" in printed.out + printed.err
    assert "device busy" in printed.out + printed.err


async def test_camera_is_released_once_its_event_loop_is_closed() -> None:
    taken, released = threading.Event(), threading.Event()

    async def leave() -> None:
        NewestFrame(lambda: taken.wait(5.0) and None, released.set).start()

    def elsewhere() -> None:
        with asyncio.Runner() as runner:
            runner.run(leave())
        taken.set()

    await asyncio.to_thread(elsewhere)
    assert await asyncio.to_thread(released.wait, 5.0)
