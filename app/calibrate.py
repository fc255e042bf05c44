"""`alight calibrate`: from images, videos, flight records or a live camera to a camera file or a height table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import cv2
from rich.console import Console

from app.calibrate_live import collect_live, take_station
from app.calibration.board import Board, NoView
from app.calibration.collect import Collector, other_boards
from app.calibration.coverage import CELL_CORNERS, choose, sharp_enough
from app.calibration.heights import Sample, make_table, measure
from app.calibration.heights_judgement import judge_heights
from app.calibration.judgement import Check, Verdict, judge_lens, overall
from app.calibration.lens import VIEWS_MIN, calibrate_lens
from app.calibration.parameters import ModelName
from app.config import LensConfig, Section, VisionConfig
from app.errors import CalibrationError
from app.estimation.fix import pose_estimator
from app.estimation.height_table import HeightTableConfig
from app.landmark import Landmark
from app.messages import Frame
from app.review.calibration.drawing import draw_heights, draw_lens, write_views
from app.review.calibration.files import (
    camera_text,
    check_free,
    height_table_text,
    write_checked,
)
from app.review.calibration.sources import RecordedFrames, read_heights, thinned
from app.review.calibration.words import (
    coverage_lines,
    height_lines,
    judgement_lines,
    lens_lines,
    refused_lines,
    view_lines,
)
from app.review.inspect import FrameSource
from app.vision.camera_model import Lens, lens_from_config
from app.vision.detector import Detector
from app.wiring import load_rig, make_camera, open_camera, open_sources, read_landmark, read_lens


@dataclass(frozen=True, slots=True)
class Target:
    """Where results go, and what may be done there.

    Attributes:
        out: File to write.
        draw: Folder for pictures; None for none.
        force: Write it even if it is judged not good.
        overwrite: Replace a file that is there.
    """

    out: Path
    draw: Path | None = None
    force: bool = False
    overwrite: bool = False


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
        for k, (frame, _) in enumerate(_with_progress(paths, max_frames, console)):
            collector.look(frame)
            if k % 100 == 99 and not console.is_terminal:
                _tell(console, [f"  {k + 1} frames looked at, the board in {len(collector.views)}"])
        origin = ", ".join(path.name for path in paths)
    _tell(console, [f"{board}: found in {len(collector.views)} of {collector.looked_at} frames"])
    sharp, blurred = sharp_enough(collector.views)
    chosen, spare = choose(sharp)
    refused = [*collector.refused, *blurred, *spare]
    if len(chosen) < VIEWS_MIN:
        _tell(console, refused_lines(refused))
        if collector.size_px is not None and chosen:
            _tell(console, coverage_lines(collector.counts(chosen), collector.lit()))
        raise _too_few(collector, len(chosen))
    found = calibrate_lens(chosen, model)
    refused += found.dropped
    counts, lit = collector.counts(found.used), collector.lit()
    checks = judge_lens(found, counts >= CELL_CORNERS, lit, len(chosen))
    _tell(console, [*refused_lines(refused), *view_lines(found)[:8]])
    if len(found.used) > 8:
        _tell(console, [f"  and {len(found.used) - 8} more views with smaller errors"])
    _tell(console, [f"corners in {len(found.used)} views, by cells of the image:", *coverage_lines(counts, lit)])
    _tell(console, [f"{found.fitted.model.name} lens:", *lens_lines(found)])
    if target.draw is not None:
        title = f"{target.out.stem}: {found.fitted.model.name}, {len(found.used)} views, {overall(checks).words}"
        write_views(found, refused, target.draw)
        _tell(console, [f"drawn: {draw_lens(found, lit, title, target.draw)}"])
    return _finish(checks, target, console, lambda: camera_text(found, checks, board, origin, _now()), kind=LensConfig)


def run_height(
    paths: Sequence[Path],
    heights: str,
    camera: Path | None,
    pad: Path | None,
    max_frames: int,
    centred_only: bool,
    target: Target,
    console: Console,
) -> bool:
    """Make a height table from frames at known heights, tell about it, and write it.

    Args:
        paths: Images, folders, videos and flight records.
        heights: CSV file, or pattern on names.
        camera: Camera file.
        pad: Pad file; None for the paper's landmark.
        max_frames: Of each video.
        centred_only: There is no second group.
        target: Where to write.
        console: Where to tell.

    Returns:
        Whether the file was written.

    Raises:
        AlightError: Something can't be read or written, or there is nothing to make a table from.
    """
    check_free(target.out, target.overwrite)
    for given, what, do in (
        (paths, "nothing to make a table from", "give images, folders, videos or flight records, or --live RIG.toml"),
        (heights, "no heights", "give --heights: a CSV file, or a pattern on the files' names"),
        (camera, "no lens", "give --camera: the camera file"),
    ):
        if not given:
            raise CalibrationError(what, do)
    known = read_heights(heights)
    lens, landmark = lens_from_config(read_lens(Path(camera or ""))), read_landmark(pad)
    cv2.setNumThreads(1)
    poses = pose_estimator(landmark, lens, "pnp")
    samples: list[Sample] = []
    refused: list[NoView] = []
    detector = Detector(landmark, lens, VisionConfig())
    for frame, folder in _with_progress(paths, max_frames, console):
        height = known.of(frame, folder)
        if height is None:
            refused.append(NoView(frame.name, "no height is known for it"))
            continue
        detection = detector.detect(frame, still=True)
        pose = poses.estimate(detection).camera if detection.detected else None
        found = measure(frame.name, height, detection, pose, landmark, lens)
        if isinstance(found, Sample):
            samples.append(found)
        else:
            refused.append(found)
    _tell(console, [f"the landmark's triangle was measured in {len(samples)} of {len(samples) + len(refused)} frames"])
    origin = ", ".join(path.name for path in paths)
    return _make_table(samples, refused, landmark, lens, centred_only, target, origin, console)


def run_height_live(
    rig_path: Path, ask: Callable[[str], str], frames: int, centred_only: bool, target: Target, console: Console
) -> bool:
    """The same from a rig's camera: asks for the height of each station, and looks at some frames there.

    Args:
        rig_path: Of the rig.
        ask: Shows words and returns what the person answers.
        frames: To take at each station.
        centred_only: There is no second group.
        target: Where to write.
        console: Where to tell.

    Raises:
        AlightError: See run_height.
    """
    check_free(target.out, target.overwrite)
    rig = load_rig(rig_path)
    cv2.setNumThreads(1)
    samples: list[Sample] = []
    refused: list[NoView] = []
    _tell(
        console,
        [
            "hold the camera level over the landmark, at each height once with the landmark in the middle of the image",
            "and once at the same distance in pixels from it; heights are from the landmark's face to the lens",
        ],
    )
    while (height := _asked_height(ask, console)) is not None:
        taken = take_station(make_camera(rig), rig, height, frames)
        new = [item for item in taken if isinstance(item, Sample)]
        samples += new
        refused += [item for item in taken if isinstance(item, NoView)]
        if new:
            sides = sorted(item.side_px for item in new)
            away = sorted(item.distance_px for item in new)
            words = f"{sides[len(sides) // 2]:.2f} px, {away[len(away) // 2]:.0f} px from the middle"
            _tell(console, [f"  {height:g} m: {len(new)} frames, {words}"])
        else:
            _tell(console, [f"  {height:g} m: nothing was measured", *refused_lines(refused[-len(taken) :])])
    return _make_table(samples, refused, rig.landmark, rig.lens, centred_only, target, str(rig_path.name), console)


# --------------------------------------------------------------------------------------------------------------- parts
def _make_table(
    samples: Sequence[Sample],
    refused: Sequence[NoView],
    landmark: Landmark,
    lens: Lens,
    centred_only: bool,
    target: Target,
    origin: str,
    console: Console,
) -> bool:
    try:
        table = make_table(samples, refused, landmark, lens, centred_only=centred_only)
    except CalibrationError:
        _tell(console, refused_lines(refused))
        raise
    checks = judge_heights(table)
    _tell(console, [*refused_lines(table.refused), *height_lines(table)])
    if target.draw is not None:
        title = f"{target.out.stem}: {len(table.rows)} heights, {overall(checks).words}"
        _tell(console, [f"drawn: {draw_heights(table, title, target.draw)}"])
    text = height_table_text(table, checks, target.out.stem, origin, _now())
    return _finish(checks, target, console, lambda: text, kind=HeightTableConfig)


def _finish(
    checks: Sequence[Check],
    target: Target,
    console: Console,
    text: Callable[[], str],
    *,
    kind: type[Section],
) -> bool:
    """Judge, and write or not."""
    _tell(console, judgement_lines(checks))
    if overall(checks) is Verdict.NOT_GOOD and not target.force:
        _tell(console, [f"{target.out} is not written; --force writes it all the same"])
        return False
    write_checked(target.out, text(), kind)
    _tell(console, [f"written: {target.out}"])
    return True


def _with_progress(paths: Sequence[Path], max_frames: int, console: Console) -> Iterator[tuple[Frame, str]]:
    """All frames with the name of the folder that each comes from, and a count on a terminal."""
    sources = list(_sources(paths))
    count = 0
    with console.status("looking at frames") as status:
        for source, folder in sources:
            for frame in thinned(source, max_frames):
                count += 1
                status.update(f"looking at frame {count}: {frame.name}")
                yield frame, folder


def _sources(paths: Sequence[Path]) -> Iterator[tuple[FrameSource, str]]:
    for path in paths:
        folder = (path if path.is_dir() else path.resolve().parent).resolve().name
        if path.suffix.lower() == ".mcap":
            yield RecordedFrames(path), folder
        else:
            for source in open_sources([path]):
                yield source, folder


def _too_few(collector: Collector, usable: int) -> CalibrationError:
    """Why there is nothing to calibrate from."""
    what = f"{usable} usable view(s) of the board in {collector.looked_at} frames, at least {VIEWS_MIN} are needed"
    if not collector.views:
        hint = other_boards(collector.board, collector.without)
        return CalibrationError(what, hint or "show the whole board, flat, sharp and well lit, with white round it")
    if len(collector.views) >= VIEWS_MIN:
        return CalibrationError(what, "the views are blurred or alike: hold the board still, at many places and tilts")
    return CalibrationError(what, "record more: the board sharp, tilted, and all over the image")


def _asked_height(ask: Callable[[str], str], console: Console) -> float | None:
    """A height in metres; None when the person is done."""
    while True:
        try:
            words = ask("height in m (empty: done): ").strip()
        except EOFError:
            return None
        if not words:
            return None
        try:
            height = float(words.replace(",", "."))
        except ValueError:
            height = 0.0
        if 0.0 < height <= 200.0:
            return height
        _tell(console, [f"  {words!r} is no height in metres"])


def _now() -> str:
    return f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"


def _tell(console: Console, lines: Sequence[str]) -> None:
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
