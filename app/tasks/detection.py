"""Detection: frames in, detections out, in vision's own thread."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

from app.channels import Latest, Topic
from app.messages import Detection, Frame
from app.tasks.compute import Compute
from app.vision.detector import Detector


async def run_detection(
    *, frames: Latest[Frame], detections: Topic[Detection], detector: Detector, compute: Compute
) -> None:
    """Detect the landmark in the newest frame, again and again."""
    while True:
        frame = await frames.get()
        detections.publish(await compute(partial(_timed, detector, frame)))


def _timed(detector: Detector, frame: Frame) -> Detection:
    """The detection with the processor time that this thread spent on it."""
    start_s = time.thread_time()
    detection = detector.detect(frame)
    return replace(detection, elapsed_s=time.thread_time() - start_s)
