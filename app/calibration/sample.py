"""What one frame of the landmark at a known height says.

It is what estimation.paper measures in flight: the longest side of the outer triangle in a virtual camera without
distortion, of the lens's own focal length, that looks straight down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.calibration.board import NoView
from app.estimation.height_table import outer_triangle
from app.estimation.paper import equation_3, equation_4, longest_side_px
from app.frames import rotation_from_quaternion
from app.landmark import Landmark
from app.messages import CameraPose, Detection
from app.vision.camera_model import Lens

TILT_MAX_DEG = 5.0
"""A camera tilted by more sees one end of the triangle nearer than the other; a frame is refused beyond this by two
sigma."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One frame of the landmark at a known height.

    Attributes:
        name: Of the frame.
        height_m: Of the camera above the landmark.
        side_px: Longest side of the outer triangle.
        distance_px: Of the triangle's centroid from the middle of the image.
    """

    name: str
    height_m: float
    side_px: float
    distance_px: float


def measure(
    name: str, height_m: float, detection: Detection, pose: CameraPose | None, landmark: Landmark, lens: Lens
) -> Sample | NoView:
    """What one frame says, or why it says nothing.

    Args:
        name: Of the frame.
        height_m: At which it was taken.
        detection: Of the landmark in it.
        pose: Fitted to the detection: tells whether the camera looked straight down.
        landmark: What was looked for.
        lens: Of the camera.
    """
    if not detection.detected:
        return NoView(name, f"landmark not found: {detection.reason}")
    triangle = outer_triangle(landmark)
    seen = None if triangle is None else next((c for c in detection.contours if c.index == triangle[0]), None)
    if seen is None:
        return NoView(name, "the outer triangle was not found")
    if pose is not None:
        normal = rotation_from_quaternion(pose.q_cam_from_pad_wxyz)[:, 2]
        tilt = math.degrees(math.acos(min(1.0, abs(float(normal[2])))))
        sigma = math.degrees(math.sqrt(max(0.0, float(np.diag(pose.covariance)[3:5].max()))))
        if tilt - 2.0 * sigma > TILT_MAX_DEG:
            words = f"the camera is tilted by {tilt:.1f} deg against the landmark, over {TILT_MAX_DEG:g}"
            return NoView(name, f"{words} (or the camera file is not this camera's)")
    rays = lens.rays(seen.corners_px)
    if not (rays[:, 2] > 0.05).all():
        return NoView(name, "the outer triangle lies too far from the camera's axis")
    vertices = rays[:, :2] / rays[:, 2:] * lens.focal_px
    distance = math.hypot(equation_3(vertices), equation_4(vertices))
    return Sample(name, height_m, longest_side_px(vertices), distance)
