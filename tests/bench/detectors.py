"""The detectors under test behind one face: a frame in, corners and pose out, with the processor time of each step.

Each peer gets the raw frame, as a user would give it. Its corners go through the true lens into the same planar pose
solver (IPPE: Collins and Bartoli, "Infinitesimal plane-based pose estimation", 2014), so what is compared is the
detectors. Alight's pose is its own, without the vehicle's attitude.
"""

from __future__ import annotations

import atexit
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import cv2
import numpy as np
from optics import Array, Optics
from prints import CORNERS_M, TAG_ID

from app.config import LensConfig, VisionConfig, read_config
from app.estimation.fix import pose_estimator
from app.estimation.pose import cam_from_pad
from app.landmark import paper_landmark
from app.messages import Frame
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector

APRILTAG_CORNERS = (1, 0, 3, 2)
"""Where the library's corners stand in prints.CORNERS_M: OpenCV prints the family upside down."""
APRILTAG_ORIGIN_PX = 0.5
"""Its pixel centres are at halves."""


@dataclass(frozen=True)
class Answer:
    """What a detector says of a frame.

    Attributes:
        corners_px: (4, 2) of the outer black square, in the order of prints.CORNERS_M; None: it saw nothing.
        rotation: (3, 3) cam_from_pad, or None.
        translation: (3,) metres, or None.
        detect_ms: Processor time of the detection.
        pose_ms: Processor time of the pose.
        covariance: (6, 6) of the translation, and of a turn about the camera's axes, rad; None: it claims none.
    """

    corners_px: Array | None
    rotation: Array | None
    translation: Array | None
    detect_ms: float
    pose_ms: float
    covariance: Array | None = None


class Contestant(Protocol):
    """A detector, ready for one lens."""

    def look(self, image: Array, t_s: float, number: int) -> Answer:
        """At a frame (480, 640) uint8."""
        ...


def planar_pose(corners_px: Array, optics: Optics) -> tuple[Array, Array] | None:
    """cam_from_pad rotation and translation from four corners; None where they determine none."""
    rays = optics.rays(corners_px)
    if (rays[:, 2] < 0.05).any():
        return None
    flat = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    points = np.column_stack([CORNERS_M, np.zeros(4)])
    try:
        found = cv2.solvePnPGeneric(points, flat, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    except cv2.error:
        return None
    if not found[0]:
        return None
    translation = np.asarray(found[2][0], np.float64).ravel()
    rotation = np.asarray(cv2.Rodrigues(found[1][0])[0])
    return (rotation, translation) if np.isfinite(translation).all() else None


class Alight:
    """This project's."""

    def __init__(self, optics: Optics, still: bool) -> None:
        landmark = paper_landmark()
        lens = lens_from_config(read_config(optics.camera_file, LensConfig))
        self._optics, self._still = optics, still
        self._detector = Detector(landmark, lens, VisionConfig())
        self._poses = pose_estimator(landmark, lens, "pnp")

    def look(self, image: Array, t_s: float, number: int) -> Answer:
        """See Contestant."""
        frame = Frame(t_s, number, image)
        start = time.process_time()
        detection = self._detector.detect(frame, still=self._still)
        seen = time.process_time()
        pose = self._poses.estimate(detection).camera
        end = time.process_time()
        times = ((seen - start) * 1e3, (end - seen) * 1e3)
        if not detection.detected:
            return Answer(None, None, None, *times)
        if pose is None:
            corners = next((c.corners_px for c in detection.contours if c.index == 0), np.full((4, 2), np.nan))
            return Answer(corners, None, None, *times)
        pad = cam_from_pad(pose)
        points = np.column_stack([CORNERS_M, np.zeros(4)]) @ pad.rotation.T + pad.translation
        return Answer(self._optics.project(points), pad.rotation, pad.translation, *times, pose.covariance)


class Peer:
    """A detector that gives four corners."""

    def __init__(self, optics: Optics, find: Callable[[Array], Array | None]) -> None:
        self._optics, self._find = optics, find

    def look(self, image: Array, t_s: float, number: int) -> Answer:
        """See Contestant."""
        start = time.process_time()
        corners = self._find(image)
        seen = time.process_time()
        pose = None if corners is None else planar_pose(corners, self._optics)
        end = time.process_time()
        rotation, translation = pose if pose is not None else (None, None)
        return Answer(corners, rotation, translation, (seen - start) * 1e3, (end - seen) * 1e3)


def _aruco(dictionary: int, parameters: Any) -> Callable[[Array], Array | None]:
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(dictionary), parameters)

    def find(image: Array) -> Array | None:
        corners, ids, _ = detector.detectMarkers(image)
        ours = [
            c.reshape(4, 2) for c, i in zip(corners, [] if ids is None else ids.ravel(), strict=True) if i == TAG_ID
        ]
        if not ours:
            return None
        return np.asarray(max(ours, key=lambda c: cv2.contourArea(c)), np.float64)

    return find


def _small_aruco() -> Any:
    """For sides of a few pixels: more windows, short perimeters, all of the code's correction, corners to sub-pixel.

    Each value was the best of those tried for this detector on the tuning part.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = 3
    parameters.adaptiveThreshWinSizeMax = 23
    parameters.adaptiveThreshWinSizeStep = 4
    parameters.adaptiveThreshConstant = 5
    parameters.minMarkerPerimeterRate = 0.01
    parameters.minCornerDistanceRate = 0.02
    parameters.minDistanceToBorder = 1
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
    parameters.errorCorrectionRate = 1.0
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 3
    return parameters


@lru_cache
def _apriltags(decimate: float) -> Any:
    """One for the whole process: its destructor reads the tag family after freeing it, so it is never destroyed."""
    from pupil_apriltags import Detector as AprilTags  # type: ignore[import-untyped]  # it has no types, and only the bench has it

    detector = AprilTags(families="tag36h11", nthreads=1, quad_decimate=decimate)
    detector.tag_detector_ptr.contents.decode_sharpening = 0.25  # the library's default, which its binding cuts to 0
    atexit.register(setattr, detector, "tag_detector_ptr", None)
    return detector


def _apriltag(decimate: float) -> Callable[[Array], Array | None]:
    detector = _apriltags(decimate)

    def find(image: Array) -> Array | None:
        ours = [d for d in detector.detect(image) if d.tag_id == TAG_ID]
        if not ours:
            return None
        best = max(ours, key=lambda d: d.decision_margin)
        return np.asarray(best.corners, np.float64)[list(APRILTAG_CORNERS)] - APRILTAG_ORIGIN_PX

    return find


@dataclass(frozen=True)
class Entry:
    """A detector of the table.

    Attributes:
        title: For people.
        marker: Which of prints.MARKERS it looks for.
        sequences: Whether it is run on sequences.
        make: Lens, and whether frames stand alone -> ready to look.
    """

    title: str
    marker: str
    sequences: bool
    make: Callable[[Optics, bool], Contestant]


ENTRIES: dict[str, Entry] = {
    "alight": Entry("Alight", "alight", True, Alight),
    "aruco4": Entry(
        "ArUco 4x4, default",
        "aruco4",
        True,
        lambda optics, _: Peer(optics, _aruco(cv2.aruco.DICT_4X4_50, cv2.aruco.DetectorParameters())),
    ),
    "aruco6": Entry(
        "ArUco 6x6, tuned for small",
        "aruco6",
        False,
        lambda optics, _: Peer(optics, _aruco(cv2.aruco.DICT_6X6_50, _small_aruco())),
    ),
    "apriltag1": Entry("AprilTag 36h11, decimate 1", "apriltag", True, lambda optics, _: Peer(optics, _apriltag(1.0))),
    "apriltag2": Entry("AprilTag 36h11, decimate 2", "apriltag", True, lambda optics, _: Peer(optics, _apriltag(2.0))),
}
