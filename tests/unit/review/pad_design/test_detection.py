"""The detector on pads that were designed: found all over the heights that a design claims, at the edge of its view.

Frames are drawn by the tests' own renderer.
"""

import math

import numpy as np
import pytest

from app.config import VisionConfig
from app.messages import Frame
from app.review.pad_design.command import request_of
from app.review.pad_design.proposal import propose
from app.review.pad_design.view import view_of
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector

TILT_DEG, OFFSET = 10.0, 0.2


@pytest.mark.parametrize("part", [0.0, 0.45, 1.0])
@pytest.mark.parametrize(
    ("camera", "ceiling_m", "floor_m", "max_size_cm", "count"),
    [
        ("fisheye", 5.0, 0.3, 38.0, 5),
        ("fisheye", 12.0, 0.1, 200.0, 7),
        ("pinhole", 12.0, 0.3, 200.0, 5),
        ("pinhole", 12.0, 0.1, 200.0, 7),
    ],
)
def test_designed_pad_is_found_from_floor_to_ceiling(scene, camera, ceiling_m, floor_m, max_size_cm, count, part):
    lens = getattr(scene, camera)
    view = view_of(lens_from_config(lens.config), tilt_rad=math.radians(TILT_DEG), offset=OFFSET)
    design = propose(view, request_of(ceiling_m, floor_m, max_size_cm=max_size_cm, min_side_px=None, detail_mm=1.0))
    assert (design.is_met, len(design.specs)) == (True, count)
    height_m = floor_m * (ceiling_m / floor_m) ** part
    off_m = OFFSET * math.tan(view.usable_rad) * height_m
    at = scene.view(height_m, forward_m=0.6 * off_m, right_m=-0.8 * off_m, pad_yaw_deg=37, roll_deg=6, pitch_deg=-8)
    image = scene.draw(at, landmark=design.landmark, lens=lens)
    found = Detector(design.landmark, lens_from_config(lens.config), VisionConfig()).detect(
        Frame(t_capture_s=0.0, sequence=0, image=image, name="drawn"), still=True
    )
    assert found.detected, found.reason
    assert len(found.contours) >= 2
    for contour in found.contours:
        true = scene.corners_px(at, contour.index, lens, design.landmark)
        if ((true >= 0) & (true <= (lens.width - 1, lens.height - 1))).all():
            np.testing.assert_allclose(contour.corners_px, true, atol=2.0)
