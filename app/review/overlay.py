"""Draws on a camera image what the detector saw in it, for people. Pure."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from app.estimation.pose import cam_from_pad
from app.frames import Array, Transform
from app.landmark import Landmark
from app.messages import CameraPose, Detection, Image
from app.vision.camera_model import Lens

COLOURS = ((60, 200, 255), (80, 220, 120), (255, 170, 60), (220, 110, 230), (90, 90, 255), (200, 200, 60))
"""BGR, one a contour, outermost first, again from the first after the last."""
REFUSED, PAPER = (90, 120, 255), (255, 255, 255)
AXES = (
    ("x", (1.0, 0.0, 0.0), (80, 80, 255)),
    ("y", (0.0, 1.0, 0.0), (90, 220, 90)),
    ("-z", (0, 0, -0.5), (255, 150, 80)),
)
"""Of the pad frame: forward, right, and up, which is drawn half as long."""
POINTS_A_SIDE = 12
"""Sides are drawn through the lens, so that they bend as the image's do."""
SUBPIXEL_BITS = 4


def to_colour(image: Image) -> Image:
    """(h, w, 3) BGR copy of a grey or BGR image."""
    return image.copy() if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def draw_line(
    canvas: Image, points_px: Array, colour: tuple[int, int, int], *, closed: bool = True, width: int = 1
) -> None:
    """Draw a line through points (n, 2), closed or not; points that are not known draw nothing."""
    if len(points_px) > 1 and np.isfinite(points_px).all():
        whole: NDArray[np.int32] = np.round(np.clip(points_px, -2e4, 2e4) * (1 << SUBPIXEL_BITS)).astype(np.int32)
        cv2.polylines(canvas, [whole], closed, colour, width, cv2.LINE_AA, SUBPIXEL_BITS)


def _through_lens(corners_m: Array, pose: Transform, lens: Lens, closed: bool) -> Array:
    """(n, 2) pixels of a line through points of the pad frame (n, 3), its sides cut into short pieces."""
    ends = np.roll(corners_m, -1, axis=0) if closed else corners_m[1:]
    starts = corners_m if closed else corners_m[:-1]
    part = np.linspace(0.0, 1.0, POINTS_A_SIDE, endpoint=False)[None, :, None]
    points = (starts[:, None, :] * (1 - part) + ends[:, None, :] * part).reshape(-1, 3)
    if not closed:
        points = np.vstack([points, corners_m[-1]])
    px, valid = lens.project(pose.apply(points))
    inside: Array = px[valid & (np.abs(px) < 4096).all(axis=1)]
    return inside


def _draw_axes(canvas: Image, transform: Transform, lens: Lens, landmark: Landmark) -> None:
    for name, direction, colour in AXES:
        tip = 0.5 * landmark.size_m * np.array(direction)
        line = _through_lens(np.vstack([np.zeros(3), tip]), transform, lens, closed=False)
        draw_line(canvas, line, colour, closed=False, width=2)
        if len(line):
            at = (round(float(line[-1, 0])) + 4, round(float(line[-1, 1])) + 4)
            cv2.putText(canvas, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)


def draw_overlay(image: Image, detection: Detection, pose: CameraPose | None, lens: Lens, landmark: Landmark) -> Image:
    """The image with what was seen on it.

    Args:
        image: (h, w) grey or (h, w, 3) BGR, of the lens's size.
        detection: Of this image.
        pose: Of the landmark, where known: its drawing is laid over the image, and its axes.
        lens: Of the camera.
        landmark: What was looked for.

    Returns:
        (h, w, 3) BGR: found contours and corners in colour, the rest of the drawing thin.
    """
    canvas = to_colour(image)
    if pose is not None:
        transform = cam_from_pad(pose)
        for contour in landmark.contours:
            flat = np.column_stack([contour.corners_m, np.zeros(len(contour.corners_m))])
            draw_line(canvas, _through_lens(flat, transform, lens, closed=True), PAPER)
        _draw_axes(canvas, transform, lens, landmark)
    for seen in detection.contours:
        colour = COLOURS[seen.index % len(COLOURS)]
        if pose is None:
            draw_line(canvas, seen.corners_px, colour, width=2)
        for u, v in seen.corners_px:
            centre = (round(float(u) * (1 << SUBPIXEL_BITS)), round(float(v) * (1 << SUBPIXEL_BITS)))
            cv2.circle(canvas, centre, 4 << SUBPIXEL_BITS, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    if detection.roi_px is not None:
        u0, v0, u1, v1 = detection.roi_px
        cv2.rectangle(canvas, (u0, v0), (u1 - 1, v1 - 1), (120, 120, 120), 1)
    return canvas


def write_lines(canvas: Image, lines: list[tuple[str, tuple[int, int, int]]]) -> None:
    """Write lines of text, each in its colour, into the upper left corner, dark-rimmed to be read on any ground."""
    for k, (line, colour) in enumerate(lines):
        at = (10, 24 + 20 * k)
        for shift in ((-1, 0), (1, 0), (0, -1), (0, 1)):  # a bolder rim would run wider than the text on it
            rim = (at[0] + shift[0], at[1] + shift[1])
            cv2.putText(canvas, line, rim, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        cv2.putText(canvas, line, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
