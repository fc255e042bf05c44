"""The camera of the simulator, as the application sees it: frames from a Unix socket, newest only; it obeys."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Self

import numpy as np

from app.channels import Latest
from app.errors import CameraError
from app.messages import ExposureLimits, Frame
from drivers.simulator.shutter import LIMITS, Exposure
from drivers.simulator.wire import HEADER_BYTES, pack_order, unpack

OPEN_TIMEOUT_S = 5.0
FRAME_TIMEOUT_S = 3.0
RETRY_S = 0.05
BUFFER_BYTES = 1 << 20


class SyntheticCamera:
    """app.ports.Camera on the simulator's frames.

    Args:
        source: Path of the simulator's socket.

    Raises:
        CameraError: On opening: nobody gives frames there. From frames(): they ended.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._newest: Latest[Frame | CameraError] = Latest("synthetic frames")
        self._reader: asyncio.Task[None] | None = None
        self._writer: asyncio.StreamWriter | None = None

    async def __aenter__(self) -> Self:
        """Connect."""
        try:
            async with asyncio.timeout(OPEN_TIMEOUT_S):
                stream, self._writer = await self._connect()
        except TimeoutError:
            raise CameraError(
                f"no simulator gives frames on {self._source!r}", "start it, or choose another camera driver"
            ) from None
        self._reader = asyncio.create_task(self._read(stream), name="synthetic camera")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect."""
        if self._reader is not None:
            self._reader.cancel()
            await asyncio.wait([self._reader])
        if self._writer is not None:
            self._writer.close()
            with contextlib.suppress(OSError):
                await self._writer.wait_closed()

    @property
    def exposure_control(self) -> Self:
        """The simulator's camera obeys."""
        return self

    @property
    def limits(self) -> ExposureLimits:
        """What it can be told."""
        return LIMITS

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        """Expose so, a few frames from now."""
        self._order(Exposure(exposure_s, gain).within(LIMITS))

    def set_auto(self) -> None:
        """Expose by itself again."""
        self._order(None)

    def _order(self, exposure: Exposure | None) -> None:
        # A simulator that is gone shows in the frames, which end.
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(pack_order(exposure))

    async def frames(self) -> AsyncIterator[Frame]:
        """Frames as they come; CameraError when the simulator ends or falls silent."""
        while True:
            try:
                async with asyncio.timeout(FRAME_TIMEOUT_S):
                    item = await self._newest.get()
            except TimeoutError:
                raise CameraError(
                    f"the simulator gave no frame for {FRAME_TIMEOUT_S:.0f} s", "look at its own log"
                ) from None
            if isinstance(item, CameraError):
                raise item
            yield item

    async def _connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        while True:
            try:
                return await asyncio.open_unix_connection(self._source, limit=BUFFER_BYTES)
            except OSError:
                await asyncio.sleep(RETRY_S)

    async def _read(self, stream: asyncio.StreamReader) -> None:
        try:
            while True:
                header = unpack(await stream.readexactly(HEADER_BYTES))
                pixels = await stream.readexactly(header.image_bytes)
                image = np.frombuffer(pixels, dtype=np.uint8).reshape(header.height, header.width).copy()
                self._newest.put_newest(
                    Frame(header.t_capture_s, header.sequence, image, header.exposure_s, gain=header.gain)
                )
        except (asyncio.IncompleteReadError, OSError, ValueError) as error:
            self._newest.put_newest(CameraError(f"the simulator's frames ended ({error})", "look at its own log"))
