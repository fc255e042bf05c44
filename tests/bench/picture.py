"""Pictures of what went wrong: the frame with the truth in green and the answer in red."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from detectors import Answer
from judge import Verdict
from optics import Array
from store import Case


def _outline(picture: Array, corners: Array, colour: tuple[int, int, int]) -> None:
    """A square with a dot at its front-left corner."""
    if not np.isfinite(corners).all() or np.abs(corners).max() > 4000:
        return
    ring = np.round(corners * 16).astype(np.int32)
    cv2.polylines(picture, [ring], True, colour, 1, cv2.LINE_AA, 4)
    cv2.circle(picture, (int(ring[0, 0]), int(ring[0, 1])), 3 * 16, colour, 1, cv2.LINE_AA, 4)


def draw_verdict(folder: Path, detector: str, case: Case, image: Array, answer: Answer, verdict: Verdict) -> Path:
    """Write a picture; its path."""
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    _outline(picture, case.truth.corners_px, (0, 220, 0))
    if answer.corners_px is not None:
        _outline(picture, answer.corners_px, (0, 0, 255))
    scene, true = case.scene, case.truth
    text = (
        f"{detector} {verdict.outcome}: {case.kind}, {scene.ground}, {scene.light.name}, side {true.side_px:.0f} px, "
        f"{true.visible:.2f} in view"
    )
    cv2.rectangle(picture, (0, 0), (picture.shape[1], 18), (0, 0, 0), -1)
    cv2.putText(picture, text, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{case.name}-{detector}-{verdict.outcome}.png"
    if not cv2.imwrite(str(path), picture):
        raise OSError(f"can't write {path}")
    return path
