"""The exposure loop: pairs frames with their detections, tells the camera, and gives it back at the end."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np

from app.channels import Topic
from app.clock import run_virtual
from app.config import ExposureConfig, LensConfig
from app.landmark import paper_landmark
from app.messages import Detection, ExposureCommand, ExposureLimits, Frame
from app.tasks.compute import in_place
from app.tasks.exposure import run_exposure
from app.vision.camera_model import lens_from_config
from app.vision.exposure import ExposureSteering

LENS = LensConfig(model="pinhole", width_px=64, height_px=64, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=31.5)


class Control:
    """A camera's control that keeps what it is told."""

    limits = ExposureLimits(1e-4, 1e-2, 1.0, 8.0)

    def __init__(self) -> None:
        self.told: list[tuple[float, float] | None] = []

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        self.told.append((exposure_s, gain))

    def set_auto(self) -> None:
        self.told.append(None)


def frame(number: int, grey: int, exposure_s: float | None) -> Frame:
    image = np.full((64, 64), grey, np.uint8)
    return Frame(number / 30, number, image, exposure_s, gain=None if exposure_s is None else 1.0)


def steer(fakes: Any, shown: list[tuple[Frame, int]]) -> tuple[Control, list[ExposureCommand]]:
    """Frames, each with the number that its detection carries."""

    async def main() -> tuple[Control, list[ExposureCommand]]:
        control = Control()
        frames: Topic[Frame] = Topic("frames")
        detections: Topic[Detection] = Topic("detections")
        commands: Topic[ExposureCommand] = Topic("exposures")
        kept = commands.subscribe_all()
        loop = run_exposure(
            control=control,
            frames=frames.subscribe_window(8),
            detections=detections.subscribe(),
            commands=commands,
            steering=ExposureSteering(paper_landmark(), lens_from_config(LENS), ExposureConfig(), 8e-3),
            compute=in_place,
            clock=fakes.clock,
        )
        async with fakes.running(loop):
            for one, number in shown:
                frames.publish(one)
                await asyncio.sleep(0.01)
                detections.publish(Detection(one.t_capture_s, number))
                await asyncio.sleep(0.02)
        return control, kept.drain()

    return run_virtual(main())


def test_exposure_of_a_dark_frame_is_told_and_published_and_given_back_at_the_end(fakes: Any):
    control, commands = steer(fakes, [(frame(1, 20, 1e-3), 1)])
    assert [c.sequence for c in commands] == [1]
    assert commands[0].exposure_s > 1e-3
    assert control.told == [(commands[0].exposure_s, commands[0].gain), None]


def test_exposure_is_told_once_while_the_light_stays(fakes: Any):
    _, commands = steer(fakes, [(frame(k, 80, 1e-3), k) for k in range(1, 20)])
    assert len(commands) == 1


def test_exposure_of_a_detection_without_its_frame_is_not_guessed(fakes: Any):
    control, commands = steer(fakes, [(frame(1, 20, 1e-3), 7)])
    assert (control.told, commands) == ([None], [])
