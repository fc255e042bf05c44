"""Exposure: what the frames and detections say of the light becomes what the camera is told."""

from __future__ import annotations

from functools import partial

from app.channels import Latest, Topic, Window
from app.clock import Clock
from app.log import get_logger
from app.messages import Detection, ExposureCommand, Frame
from app.ports import ExposureControl
from app.tasks.compute import Compute
from app.vision.exposure import ExposureState, ExposureSteering

log = get_logger("exposure")


async def run_exposure(
    *,
    control: ExposureControl,
    frames: Window[Frame],
    detections: Latest[Detection],
    commands: Topic[ExposureCommand],
    steering: ExposureSteering,
    compute: Compute,
    clock: Clock,
) -> None:
    """Steer until cancelled; then the camera exposes by itself again."""
    state = ExposureState()
    limits = control.limits
    known: dict[int, Frame] = {}
    log.info("exposure.steered", shortest_ms=1e3 * limits.exposure_min_s, gain_max=limits.gain_max)
    try:
        while True:
            detection = await detections.get()
            known |= {frame.sequence: frame for frame in frames.drain()}
            frame = known.get(detection.sequence)
            known = {number: other for number, other in known.items() if number > detection.sequence}
            if frame is None:
                continue
            state, command = await compute(partial(steering.step, state, frame, detection, limits, clock.now_s()))
            if command is not None:
                control.set_exposure(command.exposure_s, command.gain)
                commands.publish(command)
    finally:
        control.set_auto()
