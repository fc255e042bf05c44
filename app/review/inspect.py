"""`alight detect`: the detector and both pose methods on images of the user, told as JSON, as text and as pictures.

A user's images come without the vehicle's attitude: the paper's method takes the camera to look straight down, and the
pose fit has no prior. In a sequence the pose before decides where the image can't tell the two poses of a flat pattern
apart.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from app.config import VisionConfig
from app.estimation.fix import Method, PoseEstimator, pose_estimator
from app.estimation.height_table import HeightTable
from app.estimation.pose import pad_normal_cam, predicted_corners_px
from app.frames import Array
from app.landmark import Landmark
from app.messages import CameraPose, Detection, Frame, PaperPose
from app.review.inspect_drawing import draw_inspected, write_picture
from app.vision.camera_model import Lens
from app.vision.detector import Detector

NO_TRIANGLE = "detected, but the outer triangle that method paper needs was not found: try --method pnp"
NO_POSE = "detected, but its corners determine no pose"


class FrameSource(Protocol):
    """Where frames come from."""

    @property
    def is_video(self) -> bool:
        """Whether its frames follow each other in time."""
        ...

    def frames(self) -> Iterator[Frame]:
        """Its frames."""
        ...


def _rounded(values: Array | None, digits: int) -> list[Any] | None:
    """Numbers for JSON; null where not known."""
    if values is None:
        return None
    flat = [None if not math.isfinite(v) else round(float(v), digits) for v in np.ravel(values)]
    if values.ndim == 1:
        return flat
    width = values.shape[1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


@dataclass(frozen=True, slots=True)
class InspectedFrame:
    """One frame's result.

    Attributes:
        name: File, and frame in it.
        detection: What the detector says.
        pose: By the chosen method.
        paper: The paper's own outputs.
        corners_px: (4, 2) of the outermost contour: front-left, front-right, back-right, back-left; from the pose where
            they were not seen.
        reason: Why not, or what is missing.
        ms: Detection and pose.
    """

    name: str
    detection: Detection
    pose: CameraPose | None
    paper: PaperPose | None
    corners_px: Array | None
    reason: str | None
    ms: float

    def to_json(self) -> str:
        """One line; fields that are not known are null."""
        detected, pose, paper = self.detection.detected, self.pose, self.paper
        sigma = None if pose is None else np.sqrt(np.maximum(np.diag(pose.covariance)[:3], 0.0))
        line = {
            "frame": self.name,
            "detected": detected,
            "code": self.detection.code,
            "reason": self.reason,
            "score": round(self.detection.score, 3) if detected else None,
            "corners_px": _rounded(self.corners_px, 3),
            "t_cam_from_pad_m": None if pose is None else _rounded(pose.t_cam_from_pad_m, 5),
            "q_cam_from_pad_wxyz": None if pose is None else _rounded(pose.q_cam_from_pad_wxyz, 6),
            "sigma_m": _rounded(sigma, 5),
            "paper": None
            if paper is None
            else {
                "x_c_m": round(paper.x_c_m, 5),
                "y_c_m": round(paper.y_c_m, 5),
                "h_m": round(paper.h_m, 5),
                "theta_rad": round(paper.theta_rad, 6),
            },
            "ms": round(self.ms, 3),
        }
        return json.dumps(line, allow_nan=False)

    def to_text(self) -> str:
        """One line for people."""
        if not self.detection.detected:
            return f"{self.name}: not found ({self.reason})"
        where = self.reason or ""
        if self.pose is not None:
            x, y, z = (float(v) for v in self.pose.t_cam_from_pad_m)
            where = f"right {x:+.3f} m, image down {y:+.3f} m, along the axis {z:.3f} m"
        return f"{self.name}: {self.detection.code}, score {self.detection.score:.2f}, {where} ({self.ms:.1f} ms)"


def _inspect_frame(
    frame: Frame, detector: Detector, poses: PoseEstimator, still: bool, before: CameraPose | None
) -> InspectedFrame:
    """Detection and pose of one frame; before is the pose of the one before it in a sequence."""
    begin = time.perf_counter()
    detection = detector.detect(frame, still=still)
    found = poses.estimate(detection, expected_normal_cam=None if before is None else pad_normal_cam(before))
    ms = (time.perf_counter() - begin) * 1e3
    reason = detection.reason
    if detection.detected and found.camera is None:
        reason = NO_TRIANGLE if poses.method == "paper" and found.paper is None else NO_POSE
    corners = next((c.corners_px for c in detection.contours if c.index == 0), None)
    if corners is None and found.camera is not None:
        corners = predicted_corners_px(found.camera, poses.landmark, poses.lens)
    return InspectedFrame(frame.name, detection, found.camera, found.paper, corners, reason, ms)


def inspect(
    sources: Iterable[FrameSource],
    *,
    lens: Lens,
    landmark: Landmark,
    vision: VisionConfig,
    method: Method = "pnp",
    sequence: bool | None = None,
    draw: Path | None = None,
    table: HeightTable | None = None,
) -> Iterator[InspectedFrame]:
    """Look at frames one after the other.

    Args:
        sources: Where they come from. A detector's memory ends with its source.
        lens: Of the camera.
        landmark: What to look for.
        vision: [vision].
        method: How the pose is worked out.
        sequence: Threshold and region carry over (True), or each frame stands alone (False); None: as the source is.
        draw: Folder for pictures of what was seen; None for none.
        table: The paper's height table; worked out from the lens without one.

    Raises:
        ImageError: A file is no image, not of the lens's size, or a picture can't be written.
    """
    poses = pose_estimator(landmark, lens, method, table)
    for source in sources:
        detector = Detector(landmark, lens, vision)
        in_sequence = source.is_video if sequence is None else sequence
        before: CameraPose | None = None
        for frame in source.frames():
            inspected = _inspect_frame(frame, detector, poses, not in_sequence, before)
            before = inspected.pose if in_sequence else None
            if draw is not None:
                picture = draw_inspected(
                    frame.image, inspected.detection, inspected.pose, inspected.reason, detector.attempt, lens, landmark
                )
                write_picture(picture, draw, frame.name)
            yield inspected
