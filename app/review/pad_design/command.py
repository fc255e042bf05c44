"""The designer as a command: from a camera and a request to a pad, its table, its file and its picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from app.config import LensConfig, VisionConfig
from app.errors import LandmarkError
from app.review.pad_design.advice import remedies, shortfalls
from app.review.pad_design.pad_file import check_writable, write_pad_file
from app.review.pad_design.picture import check_picture, draw_design
from app.review.pad_design.proposal import Design, Request, propose
from app.review.pad_design.view import View, view_of
from app.review.pad_design.words import to_json, to_text
from app.vision.camera_model import lens_from_config

SEEN_SIDE_PX = 12.0
"""Sides of the outermost contour from which on the detector finds a pad on its worst background, if it is set to look
for them."""


def request_of(
    ceiling_m: float, floor_m: float, *, max_size_cm: float, min_side_px: float | None, detail_mm: float
) -> Request:
    """A request in the units of the command line; min_side_px is what the detector finds if None is given."""
    side_px = max(SEEN_SIDE_PX, VisionConfig().min_side_px) if min_side_px is None else min_side_px
    return Request(ceiling_m, floor_m, max_size_cm / 100.0, side_px, detail_mm / 1000.0)


@dataclass(frozen=True, slots=True)
class Answer:
    """What a request came to.

    Attributes:
        design: The pad, or the one that comes nearest.
        camera: Name of the camera.
        short: What it falls short of; empty if it is met.
        advice: What would do instead.
        written: Files that were written.
    """

    design: Design
    camera: str
    short: tuple[str, ...]
    advice: tuple[str, ...]
    written: tuple[Path, ...]

    def to_text(self) -> str:
        """For people."""
        words = to_text(self.design, self.camera, self.short, self.advice)
        return "\n".join([words, *(f"wrote {path}" for path in self.written)])

    def to_json(self) -> str:
        """For programs, one line."""
        return to_json(self.design, self.camera, self.short, self.advice)


def design_pad(
    camera_file: LensConfig,
    camera: str,
    request: Request,
    *,
    tilt_deg: float,
    offset: float,
    out: Path | None = None,
    draw: Path | None = None,
    overwrite: bool = False,
) -> Answer:
    """Design a pad.

    Args:
        camera_file: Of the camera.
        camera: Its name, for people.
        request: What the pad is wanted for.
        tilt_deg: Angle of the camera off the vertical to allow for.
        offset: How far off the middle the pad may lie, as a part of the view.
        out: Pad file to write; one that falls short is not written.
        draw: Picture to draw; drawn in either case.
        overwrite: Replace a pad file that is there.

    Raises:
        LandmarkError: The request is no range of heights, or a file can't be written.
        ConfigError: The camera can't see any pad.
    """
    if request.floor_m >= request.ceiling_m:
        raise LandmarkError(
            f"a floor of {request.floor_m:g} m is not under a ceiling of {request.ceiling_m:g} m",
            "give a --floor lower than the --ceiling",
        )
    if out is not None:
        check_writable(out, overwrite=overwrite)
    if draw is not None:
        check_picture(draw)

    lens = lens_from_config(camera_file)

    def view_at(tilt_rad: float, part: float) -> View:
        return view_of(lens, tilt_rad=tilt_rad, offset=part)

    design = propose(view_at(math.radians(tilt_deg), offset), request)
    written: list[Path] = []
    if out is not None and design.is_met:
        write_pad_file(design, out, camera, overwrite=overwrite)
        written.append(out)
    if draw is not None:
        draw_design(design, draw, camera)
        written.append(draw)
    return Answer(design, camera, shortfalls(design), remedies(design, view_at), tuple(written))
