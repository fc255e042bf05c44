"""Camera frames: from the driver to the queue."""

from __future__ import annotations

from app.channels import Topic
from app.messages import Frame
from app.ports import Camera


async def run_camera(*, camera: Camera, frames: Topic[Frame]) -> None:
    """Publish frames until the source ends.

    Raises:
        CameraError: The camera failed.
    """
    async for frame in camera.frames():
        frames.publish(frame)
