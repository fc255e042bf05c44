"""The camera's view of a flight as a video with what was seen drawn on it, and single images of it."""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from app.config import VisionConfig
from app.errors import RecorderError
from app.estimation.pose import estimate_camera_pose, pad_normal_cam
from app.landmark import Landmark
from app.messages import CameraPose, Detection, Frame, Image, PlaneFit, SeenContour
from app.review.flight import Flight
from app.review.overlay import REFUSED, draw_overlay, write_lines
from app.review.record_reader import read_record
from app.vision.camera_model import Lens
from app.vision.detector import Detector

FRAME_RATE_HZ = 30.0
BRIGHT, CALM = (255, 255, 255), (190, 230, 255)
DESCENT_HEIGHT_M = 1.5


def detection_of(fields: dict[str, Any]) -> Detection:
    """A recorded detection."""
    contours = tuple(
        SeenContour(int(c["index"]), np.array(c["corners_px"], dtype=np.float64)) for c in fields["contours"]
    )
    roi, plane = fields["roi_px"], fields.get("plane")
    return Detection(
        t_capture_s=fields["t_capture_s"],
        sequence=fields["sequence"],
        contours=contours,
        code=fields["code"],
        reason=fields["reason"],
        score=fields["score"],
        threshold=fields["threshold"],
        roi_px=None if roi is None else (roi[0], roi[1], roi[2], roi[3]),
        plane=None
        if plane is None
        else PlaneFit(
            np.array(plane["rays_from_pad"], dtype=np.float64),
            np.array(plane["information"], dtype=np.float64),
            plane["unit_m"],
            plane["residual_px"],
        ),
    )


def write_video(record: Path, out: Path, landmark: Landmark, lens: Lens) -> None:
    """Write an MP4 of a flight's frames with the detections of those frames, the phase, height and distance.

    A record without frames gets none.

    Raises:
        RecorderError: The record can't be read, or the video can't be written.
    """
    detections: dict[int, Detection] = {}
    reports: list[tuple[float, str]] = []
    fixes: dict[float, tuple[float, float]] = {}
    for topic, t_s, _, message in read_record(record, images=False):
        if isinstance(message, Frame):
            continue
        if topic == "detections":
            detections[message["sequence"]] = detection_of(message)
        elif topic == "reports":
            reports.append((t_s, str(message["reason"])))
        elif topic == "fixes":
            north, east, down = message["pad_from_vehicle_ned_m"]
            fixes[round(message["t_capture_s"] - message.get("delay_s", 0.0), 6)] = (down, float(np.hypot(north, east)))
    times = [t for t, _ in reports]
    writer: cv2.VideoWriter | None = None
    pose: CameraPose | None = None
    try:
        for _, t_s, _, frame in read_record(record):
            if not isinstance(frame, Frame):
                continue
            writer = writer or _open_video(out, lens.size_px)
            at = bisect_right(times, t_s) - 1
            phase = reports[at][1] if at >= 0 else ""
            detection = detections.get(frame.sequence) or Detection(frame.t_capture_s, frame.sequence)
            pose = _pose(detection, pose, lens, landmark)
            writer.write(_draw(frame, detection, pose, fixes.get(round(frame.t_capture_s, 6)), phase, lens, landmark))
    finally:
        if writer is not None:
            writer.release()


def _open_video(out: Path, size_px: tuple[int, int]) -> cv2.VideoWriter:
    writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), FRAME_RATE_HZ, size_px)
    if not writer.isOpened():
        raise RecorderError(f"{out}: the video can't be written", "give a folder that can be written")
    return writer


def _pose(detection: Detection, before: CameraPose | None, lens: Lens, landmark: Landmark) -> CameraPose | None:
    """The pose to be drawn; the one of the frame before keeps it from flipping."""
    if not detection.detected:
        return None
    expected = None if before is None else pad_normal_cam(before)
    return estimate_camera_pose(detection, landmark, lens, expected_normal_cam=expected)


def _draw(
    frame: Frame,
    detection: Detection,
    pose: CameraPose | None,
    fix: tuple[float, float] | None,
    phase: str,
    lens: Lens,
    landmark: Landmark,
) -> Image:
    canvas = draw_overlay(frame.image, detection, pose, lens, landmark)
    lines = [(phase, BRIGHT)]
    if fix is not None:
        lines.append((f"{fix[0]:.2f} m over the pad, {fix[1]:.2f} m off", CALM))
    if detection.detected:
        lines.append((f"{detection.code}  score {detection.score:.2f}  threshold {detection.threshold}", CALM))
    elif detection.reason:
        lines.append((detection.reason, REFUSED))
    write_lines(canvas, lines)
    return canvas


def middle_of_descent(record: Path, flight: Flight) -> Frame | None:
    """The frame nearest to the moment at which a landing came through 1.5 m over the pad; None without a landing."""
    begun_s = next((t for t, phase, _ in flight.phases if phase == "land"), np.inf)
    descending = flight.fix_t_s >= begun_s
    if not descending.any():
        return None
    at_s = float(flight.fix_t_s[descending][np.argmin(np.abs(flight.fix_height_m[descending] - DESCENT_HEIGHT_M))])
    nearest: Frame | None = None
    for _, _, _, frame in read_record(record):
        if isinstance(frame, Frame) and (
            nearest is None or abs(frame.t_capture_s - at_s) < abs(nearest.t_capture_s - at_s)
        ):
            nearest = frame
    return nearest


def binary_of(frame: Frame, landmark: Landmark, lens: Lens, vision: VisionConfig) -> Image:
    """(h, w) the binary image that the detector makes of a frame that stands alone."""
    detector = Detector(landmark, lens, vision)
    detector.detect(frame, still=True)
    assert detector.attempt is not None
    assert detector.attempt.binary is not None, "a frame that stands alone is looked at through its binary image"
    return detector.attempt.binary
