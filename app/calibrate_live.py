"""Calibration from a camera that runs: views of a board as they add something, frames of the landmark at a height."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager

from rich.console import Console
from rich.live import Live
from rich.text import Text

from app.calibration.board import NoView, View
from app.calibration.collect import Collector
from app.calibration.coverage import VIEWS_MAX
from app.calibration.sample import Sample, measure
from app.errors import CameraError
from app.estimation.fix import pose_estimator
from app.messages import Frame
from app.ports import Camera
from app.review.calibration.words import coverage_lines
from app.tasks.compute import Compute, InThread, in_place
from app.vision.detector import Detector
from app.wiring import Rig

STATION_S = 20.0
"""At one height: whatever was measured until then is taken."""


def collect_live(camera: Camera, collector: Collector, console: Console) -> None:
    """Collect views until they cover the image, or Ctrl-C.

    Raises:
        CameraError: The camera doesn't open, or stopped.
    """
    asyncio.run(_until_interrupted(camera, collector, console))


async def _until_interrupted(camera: Camera, collector: Collector, console: Console) -> None:
    compute = InThread()
    task = asyncio.create_task(gather_views(camera, collector, console, compute))
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGINT, task.cancel)
    try:
        await asyncio.wait([task])
        if not task.cancelled():
            task.result()
    finally:
        loop.remove_signal_handler(signal.SIGINT)
        compute.close()


async def gather_views(camera: Camera, collector: Collector, console: Console, compute: Compute = in_place) -> None:
    """Look at frames until nothing is missing, there are VIEWS_MAX views, or the camera's frames end.

    Raises:
        CameraError: The camera doesn't open, or stopped.
    """
    live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
    if live is not None:
        live.start()
    try:
        async with camera, _frames(camera) as frames:
            async for frame in frames:
                found = await compute(lambda frame=frame: collector.look_live(frame))  # type: ignore[misc]  # mypy can't infer the default argument
                missing = collector.missing()
                if live is not None:
                    live.update(Text("\n".join(_lines(collector, found, missing))), refresh=True)
                elif isinstance(found, View):
                    words = f"  view {len(collector.views)}: {len(found.px)} corners; {'; '.join(missing) or 'enough'}"
                    console.print(words, highlight=False, markup=False, soft_wrap=True)
                if not missing or len(collector.views) >= VIEWS_MAX:
                    return
    finally:
        if live is not None:
            live.stop()


@asynccontextmanager
async def _frames(camera: Camera) -> AsyncIterator[AsyncIterator[Frame]]:
    """A camera's frames, closed before the camera is, also when not all of them were wanted."""
    frames = camera.frames()
    try:
        yield frames
    finally:
        if isinstance(frames, AsyncGenerator):
            await frames.aclose()


def _lines(collector: Collector, found: View | NoView, missing: list[str]) -> list[str]:
    """What a person sees while views are collected."""
    seen = found.reason if isinstance(found, NoView) else "taken"
    return [
        f"{len(collector.views)} views of {collector.looked_at} frames; now: {seen}",
        *coverage_lines(collector.counts(), collector.lit()),
        *(f"  {words}" for words in missing),
        "Ctrl-C ends it with the views that there are",
    ]


def take_station(camera: Camera, rig: Rig, height_m: float, frames: int) -> list[Sample | NoView]:
    """Look at the landmark at one height.

    Args:
        camera: Not open yet.
        rig: Lens and landmark.
        height_m: Of the camera above the landmark.
        frames: To measure.

    Returns:
        Samples, and frames that gave none.

    Raises:
        CameraError: The camera doesn't open, or stopped before a frame came.
    """
    return asyncio.run(_station(camera, rig, height_m, frames))


async def _station(camera: Camera, rig: Rig, height_m: float, frames: int) -> list[Sample | NoView]:
    detector = Detector(rig.landmark, rig.lens, rig.config.vision)
    poses = pose_estimator(rig.landmark, rig.lens, "pnp")
    taken: list[Sample | NoView] = []
    measured = 0
    try:
        async with asyncio.timeout(STATION_S), camera, _frames(camera) as frames_now:
            async for frame in frames_now:
                detection = detector.detect(frame)
                pose = poses.estimate(detection).camera if detection.detected else None
                name = f"{height_m:g} m, frame {frame.sequence}"
                found = measure(name, height_m, detection, pose, rig.landmark, rig.lens)
                taken.append(found)
                measured += isinstance(found, Sample)
                if measured >= frames:
                    break
    except TimeoutError:
        pass  # what there is will have to do
    if not taken:
        raise CameraError("the camera gave no frame", "look at its connection")
    return taken
