"""The pictures of `alight detect --draw`: the overlay, what was refused and why, the binary image, and a caption."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np

from app.errors import ImageError
from app.frames import Array
from app.landmark import Landmark
from app.messages import CameraPose, Detection, Image
from app.review.overlay import draw_line, draw_overlay
from app.vision.camera_model import Lens
from app.vision.detector import Attempt

Colour = tuple[int, int, int]
WHITE, GREY, GREEN, AMBER, RED = (
    (240, 240, 240),
    (165, 165, 165),
    (110, 220, 110),
    (60, 170, 255),
    (90, 90, 255),
)
BACKGROUND = (32, 28, 26)
SHOWN_REFUSED = 5
"""Refused candidates that are drawn and explained: those that came nearest."""
THUMBNAIL_PX = 200
LINE_PX = 20
FONT = cv2.FONT_HERSHEY_SIMPLEX


def _text(canvas: Image, text: str, at: tuple[int, int], colour: Colour, size: float = 0.45) -> None:
    cv2.putText(canvas, text, at, FONT, size, colour, 1, cv2.LINE_AA)


def _refused(attempt: Attempt) -> list[tuple[tuple[Array, ...], str]]:
    """Outlines and words of the refused candidates that came nearest, the nearest first."""
    ranked = sorted(
        (c for c in attempt.candidates if c.rejection is not None),
        key=lambda c: -int(c.rejection.test if c.rejection is not None else 0),
    )
    return [(c.outlines_px, f"{c.code}: {c.rejection.text if c.rejection else ''}") for c in ranked[:SHOWN_REFUSED]]


def _lines(
    detection: Detection, pose: CameraPose | None, reason: str | None, refused: list[str]
) -> list[tuple[str, Colour]]:
    """The caption."""
    lines: list[tuple[str, Colour]] = []
    if detection.detected:
        lines.append((f"found {detection.code}   score {detection.score:.2f}   threshold {detection.threshold}", GREEN))
        if pose is not None:
            x, y, z = (float(v) for v in pose.t_cam_from_pad_m)
            sigma = np.sqrt(np.diag(pose.covariance)[:3]) * 1e3
            lines.append((f"right {x:+.3f}  down {y:+.3f}  ahead {z:.3f} m", WHITE))
            lines.append(
                (f"sigma {sigma[0]:.1f} {sigma[1]:.1f} {sigma[2]:.1f} mm   fit {pose.reprojection_px:.2f} px", GREY)
            )
    else:
        lines.append((f"not found at threshold {detection.threshold}", RED))
    if reason is not None:
        lines.append((reason, WHITE))
    lines += [(f"{k + 1}  {text}", AMBER) for k, text in enumerate(refused)]
    return lines


def _wrapped(lines: list[tuple[str, Colour]], width_px: int) -> list[tuple[str, Colour]]:
    """Lines broken between words to fit a width."""
    out: list[tuple[str, Colour]] = []
    for text, colour in lines:
        row = ""
        for word in text.split(" "):
            longer = f"{row} {word}" if row else word
            if row and cv2.getTextSize(longer, FONT, 0.45, 1)[0][0] > width_px:
                out.append((row, colour))
                longer = f"    {word}"
            row = longer
        out.append((row, colour))
    return out


def draw_inspected(
    image: Image,
    detection: Detection,
    pose: CameraPose | None,
    reason: str | None,
    attempt: Attempt | None,
    lens: Lens,
    landmark: Landmark,
) -> Image:
    """(h + caption, w, 3) BGR: the image with what was seen on it, over a caption and the binary image.

    Args:
        image: (h, w) grey or (h, w, 3) BGR.
        detection: Of this image.
        pose: Of the landmark, where known.
        reason: Why it was not found, or what is missing.
        attempt: The detector's last, for the binary image and what was refused.
        lens: Of the camera.
        landmark: What was looked for.
    """
    canvas = draw_overlay(image, detection, pose, lens, landmark)
    words: list[str] = []
    thumbnail: Image | None = None
    if attempt is not None:
        for k, (outlines, text) in enumerate(_refused(attempt)):
            for outline in outlines:
                draw_line(canvas, outline, AMBER)
            if outlines and np.isfinite(outlines[0]).all():
                corner = outlines[0].max(axis=0)
                _text(canvas, str(k + 1), (int(corner[0]) + 2, int(corner[1]) + 10), AMBER)
            words.append(text)
        if attempt.binary is not None:
            height, width = attempt.binary.shape
            scale = min(1.0, THUMBNAIL_PX / width)
            size = (max(1, round(width * scale)), max(1, round(height * scale)))
            small = cv2.resize(255 - attempt.binary, size, interpolation=cv2.INTER_AREA)
            thumbnail = np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return _with_caption(canvas, _lines(detection, pose, reason, words), thumbnail)


def _with_caption(canvas: Image, lines: list[tuple[str, Colour]], thumbnail: Image | None) -> Image:
    """The picture over its caption; the binary image stands in the lower right corner."""
    width = canvas.shape[1]
    beside = 0 if thumbnail is None or width < 3 * THUMBNAIL_PX // 2 else thumbnail.shape[1] + 16
    rows = _wrapped(lines, width - 20 - beside)
    height = 14 + LINE_PX * len(rows)
    if thumbnail is not None and beside:
        height = max(height, thumbnail.shape[0] + 16 + LINE_PX)
    caption = np.full((height, width, 3), BACKGROUND, dtype=np.uint8)
    for k, (text, colour) in enumerate(rows):
        _text(caption, text, (10, 20 + LINE_PX * k), colour)
    if thumbnail is not None and beside:
        left = width - thumbnail.shape[1] - 8
        caption[8 : 8 + thumbnail.shape[0], left : left + thumbnail.shape[1]] = thumbnail
        _text(caption, "binary image", (left, 8 + thumbnail.shape[0] + 14), GREY, 0.4)
    return np.vstack([canvas, caption])


def write_picture(picture: Image, folder: Path, name: str) -> Path:
    """Write a picture as folder/name.png, its name made fit for a file.

    Raises:
        ImageError: It can't be written.
    """
    stem = re.sub(r"[^\w.\-]+", "-", name)
    path = folder / f"{stem}.png" if Path(stem).suffix.lower() != ".png" else folder / stem
    try:
        folder.mkdir(parents=True, exist_ok=True)
        done, data = cv2.imencode(".png", picture)
        if not done:
            raise OSError(0, "not encoded")
        path.write_bytes(data.tobytes())
    except OSError as error:
        text = f"{path}: can't be written ({error.strerror or error})"
        raise ImageError(text, "give --draw a folder that can be written to") from None
    return path
