"""Starts the simulator's process for the application, waits until it is ready, and stops it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from app.config import CameraConfig, WorldConfig
from app.errors import AlightError

READY_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 8.0


class SimulatorProcess:
    """The simulator as an async context manager: inside it, frames and MAVLink flow.

    Args:
        config: The rig file.
        frames: Unix socket to give frames on: the source of the synthetic camera.
        truth: File for the truth, complete after the context is left.
        world: In place of the rig's [simulator].
        camera: In place of the rig's [camera].
        companion: host:port that MAVLink goes to, in place of the rig's.
        ground_station: host:port of a second link.

    Raises:
        AlightError: It didn't become ready; its own last words are told.
    """

    def __init__(
        self,
        config: Path,
        frames: Path,
        truth: Path | None = None,
        *,
        world: WorldConfig | None = None,
        camera: CameraConfig | None = None,
        companion: str | None = None,
        ground_station: str | None = None,
    ) -> None:
        self._arguments = ["--config", str(config), "--frames", str(frames), "--watch-stdin"]
        for name, value in (
            ("--truth", truth),
            ("--world", world.model_dump_json() if world else None),
            ("--camera", camera.model_dump_json() if camera else None),
            ("--companion", companion),
            ("--ground-station", ground_station),
        ):
            if value is not None:
                self._arguments += [name, str(value)]
        self._process: asyncio.subprocess.Process | None = None
        self._errors: asyncio.Task[bytes] | None = None

    @property
    def pid(self) -> int:
        """Of the process, once it runs."""
        assert self._process is not None
        return self._process.pid

    async def __aenter__(self) -> Self:
        """Start it and wait until it is ready."""
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "drivers.simulator",
            *self._arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,  # a terminal's Ctrl-C is for the application, whose last orders need a vehicle
        )
        assert self._process.stdout is not None and self._process.stderr is not None
        self._errors = asyncio.create_task(self._process.stderr.read())
        try:
            async with asyncio.timeout(READY_TIMEOUT_S):
                line = await self._process.stdout.readline()
            if line and json.loads(line).get("ready"):
                return self
            async with asyncio.timeout(STOP_TIMEOUT_S):
                await self._process.wait()
                words = (await self._errors).decode(errors="replace").strip()
        except TimeoutError:
            words = f"not ready after {READY_TIMEOUT_S:.0f} s"
        except BaseException:
            await self._stop()
            raise
        await self._stop()
        raise AlightError(f"the simulator didn't start: {_why(words)}", "mend that")

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop it; its log of the truth is complete then."""
        await self._stop()

    async def _stop(self) -> None:
        process = self._process
        if process is None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            async with asyncio.timeout(STOP_TIMEOUT_S):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
        if self._errors is not None:
            await asyncio.wait([self._errors])
        self._process = None


def _why(words: str) -> str:
    """The reason in the process's last line (a log event in JSON), or the line itself."""
    last = words.splitlines()[-1] if words else "it ended without a word"
    with contextlib.suppress(ValueError, AttributeError):
        return str(json.loads(last)["why"])
    return last
