"""What counts as right, and the figures of many frames.

A detection counts if the corners of the outer black square come within max(3 px, 8% of its side) of the truth in the
mean, and its heading within 15 degrees. Any other detection is wrong, and is counted apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from detectors import Answer
from optics import Array
from scenes import Truth
from store import Case

CORNER_LIMIT_PX = 3.0
CORNER_LIMIT_PART = 0.08
HEADING_LIMIT_DEG = 15.0


@dataclass(frozen=True)
class Verdict:
    """One detector on one frame.

    Attributes:
        name: Of the case.
        set_name: Of the case.
        kind: Of the case.
        outcome: "right", "wrong" or "missed".
        side_px: The marker's.
        visible: Part of it in the image.
        corner_px: Mean error of the corners; not a number where missed.
        distance: Relative error of the distance, positive: too far.
        yaw_deg: Error of the heading.
        detect_ms: Processor time.
        pose_ms: Processor time.
        incidence_deg: Between the line of sight to the marker's middle and the normal of its plane.
        motion_px: How far the marker moves in the image during the exposure.
        place_square: Square of the translation's error over the covariance that is claimed for it, a degree of freedom:
            1 in the mean where the claim is honest. Not a number where there is no claim.
        pose_square: The same of all six.
    """

    name: str
    set_name: str
    kind: str
    outcome: str
    side_px: float
    visible: float
    corner_px: float
    distance: float
    yaw_deg: float
    detect_ms: float
    pose_ms: float
    incidence_deg: float = math.nan
    motion_px: float = math.nan
    place_square: float = math.nan
    pose_square: float = math.nan


def _squares(answer: Answer, truth: Truth) -> tuple[float, float]:
    """Verdict.place_square and pose_square."""
    if answer.covariance is None or answer.rotation is None or answer.translation is None:
        return math.nan, math.nan
    turned = cv2.Rodrigues(answer.rotation @ truth.rotation.T)[0].ravel()
    error = np.concatenate([answer.translation - truth.translation, turned])
    place, pose = (float(error[:n] @ np.linalg.solve(answer.covariance[:n, :n], error[:n])) / n for n in (3, 6))
    return place, pose


def _corner_error(corners: Array, truth: Truth) -> float:
    known = np.isfinite(truth.corners_px).all(axis=1)
    error = np.linalg.norm(corners - truth.corners_px, axis=1)[known]
    return float(np.nan_to_num(error, nan=np.inf).mean()) if known.any() else math.inf


def heading_error_deg(rotation: Array, truth: Truth) -> float:
    """Of the pad's forward axis about the pad's normal, positive clockwise seen from above."""
    seen = truth.rotation.T @ rotation
    return math.degrees(math.atan2(seen[1, 0], seen[0, 0]))


def _heading_of_corners_deg(corners: Array, truth: Truth) -> float:
    """The same in the image, where there is no pose: of the line from the back's middle to the front's."""
    ways = [c[0] + c[1] - c[2] - c[3] for c in (corners, truth.corners_px)]
    turn = math.atan2(ways[0][1], ways[0][0]) - math.atan2(ways[1][1], ways[1][0])
    return math.degrees((turn + math.pi) % (2 * math.pi) - math.pi)


def judge(case: Case, answer: Answer) -> Verdict:
    """Compare an answer with the truth."""
    true = case.truth
    outcome, corner, distance, yaw = "missed", math.nan, math.nan, math.nan
    if answer.corners_px is not None:
        corner = _corner_error(answer.corners_px, true)
        if answer.rotation is not None and answer.translation is not None:
            away = float(np.linalg.norm(true.translation))
            distance = float(np.linalg.norm(answer.translation)) / away - 1.0
            yaw = heading_error_deg(answer.rotation, true)
        turn = yaw if math.isfinite(yaw) else _heading_of_corners_deg(answer.corners_px, true)
        limit = max(CORNER_LIMIT_PX, CORNER_LIMIT_PART * true.side_px)
        outcome = "right" if corner < limit and abs(turn) < HEADING_LIMIT_DEG else "wrong"
    return Verdict(
        case.name,
        case.set_name,
        case.kind,
        outcome,
        true.side_px,
        true.visible,
        corner,
        distance,
        yaw,
        answer.detect_ms,
        answer.pose_ms,
        math.degrees(
            math.acos(float(true.rotation[:, 2] @ true.translation) / float(np.linalg.norm(true.translation)))
        ),
        math.hypot(*case.scene.motion_px),
        *_squares(answer, true),
    )


def _quantiles(values: list[float]) -> tuple[float, float]:
    known = np.array([v for v in values if math.isfinite(v)])
    return (float(np.quantile(known, 0.5)), float(np.quantile(known, 0.9))) if len(known) else (math.nan, math.nan)


def rate(verdicts: list[Verdict], outcome: str = "right") -> float:
    """Percent of the frames."""
    return 100.0 * sum(v.outcome == outcome for v in verdicts) / len(verdicts) if verdicts else math.nan


def summary(verdicts: list[Verdict]) -> dict[str, Any]:
    """Figures of many frames: rates in percent, errors of what was right, processor times of all frames."""
    right = [v for v in verdicts if v.outcome == "right"]
    bias = [v.distance * 100 for v in right if math.isfinite(v.distance)]
    return {
        "frames": len(verdicts),
        "rate": rate(verdicts),
        "wrong": sum(v.outcome == "wrong" for v in verdicts),
        "distance_percent": _quantiles([abs(v.distance) * 100 for v in right]),
        "distance_bias_percent": float(np.median(bias)) if bias else math.nan,
        "yaw_deg": _quantiles([abs(v.yaw_deg) for v in right]),
        "corner_px": _quantiles([v.corner_px for v in right]),
        "ms": _quantiles([v.detect_ms + v.pose_ms for v in verdicts]),
        "detect_ms": _quantiles([v.detect_ms for v in verdicts]),
        "pose_ms": _quantiles([v.pose_ms for v in right]),
    }
