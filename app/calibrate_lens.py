"""`alight calibrate lens`: from images, videos, flight records or a live camera to a camera file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
from rich.console import Console

from app.calibrate import Target, finish, frames_of, now, tell
from app.calibrate_live import collect_live
from app.calibration.board import Board
from app.calibration.collect import Collector, other_boards
from app.calibration.coverage import CELL_CORNERS, choose, sharp_enough
from app.calibration.judgement import judge_lens, overall
from app.calibration.lens import VIEWS_MIN, calibrate_lens
from app.calibration.parameters import ModelName
from app.config import LensConfig
from app.errors import CalibrationError
from app.review.calibration.drawing import draw_lens, write_views
from app.review.calibration.files import camera_text, check_free
from app.review.calibration.words import coverage_lines, lens_lines, refused_lines, view_lines
from app.wiring import open_camera


def run_lens(
    paths: Sequence[Path],
    live: str | None,
    board: Board,
    model: ModelName,
    max_frames: int,
    target: Target,
    console: Console,
) -> bool:
    """Calibrate a lens, tell about it, and write its camera file.

    Args:
        paths: Images, folders, videos and flight records; not with `live`.
        live: A rig file, device number or URL.
        board: That they show.
        model: Kind of lens.
        max_frames: Of each video.
        target: Where to write.
        console: Where to tell.

    Returns:
        Whether the file was written.

    Raises:
        AlightError: Something can't be read or written, or there is nothing to calibrate from.
    """
    check_free(target.out, target.overwrite)
    if bool(paths) == bool(live):
        raise CalibrationError("nothing to calibrate from" if not paths else "paths and --live", "give one of the two")
    cv2.setNumThreads(1)
    collector = Collector(board)
    if live:
        collect_live(open_camera(live), collector, console)
        origin = "a live camera"
    else:
        for k, (frame, _) in enumerate(frames_of(paths, max_frames, console)):
            collector.look(frame)
            if k % 100 == 99 and not console.is_terminal:
                tell(console, [f"  {k + 1} frames looked at, the board in {len(collector.views)}"])
        origin = ", ".join(path.name for path in paths)
    tell(console, [f"{board}: found in {len(collector.views)} of {collector.looked_at} frames"])
    sharp, blurred = sharp_enough(collector.views)
    chosen, spare = choose(sharp)
    refused = [*collector.refused, *blurred, *spare]
    if len(chosen) < VIEWS_MIN:
        tell(console, refused_lines(refused))
        if collector.size_px is not None and chosen:
            tell(console, coverage_lines(collector.counts(chosen), collector.lit()))
        raise _too_few(collector, len(chosen))
    found = calibrate_lens(chosen, model)
    refused += found.dropped
    counts, lit = collector.counts(found.used), collector.lit()
    checks = judge_lens(found, counts >= CELL_CORNERS, lit, len(chosen))
    tell(console, [*refused_lines(refused), *view_lines(found)[:8]])
    if len(found.used) > 8:
        tell(console, [f"  and {len(found.used) - 8} more views with smaller errors"])
    tell(console, [f"corners in {len(found.used)} views, by cells of the image:", *coverage_lines(counts, lit)])
    tell(console, [f"{found.fitted.model.name} lens:", *lens_lines(found)])
    if target.draw is not None:
        title = f"{target.out.stem}: {found.fitted.model.name}, {len(found.used)} views, {overall(checks).words}"
        write_views(found, refused, target.draw)
        tell(console, [f"drawn: {draw_lens(found, lit, title, target.draw)}"])
    return finish(checks, target, console, lambda: camera_text(found, checks, board, origin, now()), kind=LensConfig)


def _too_few(collector: Collector, usable: int) -> CalibrationError:
    """Why there is nothing to calibrate from."""
    what = f"{usable} usable view(s) of the board in {collector.looked_at} frames, at least {VIEWS_MIN} are needed"
    if not collector.views:
        hint = other_boards(collector.board, collector.without)
        return CalibrationError(what, hint or "show the whole board, flat, sharp and well lit, with white round it")
    if len(collector.views) >= VIEWS_MIN:
        return CalibrationError(what, "the views are blurred or alike: hold the board still, at many places and tilts")
    return CalibrationError(what, "record more: the board sharp, tilted, and all over the image")
