"""`alight calibrate height`: from frames of the landmark at known heights, or a live camera, to a height table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
from rich.console import Console

from app.calibrate import Target, finish, frames_of, now, tell
from app.calibrate_live import take_station
from app.calibration.board import NoView
from app.calibration.heights import make_table
from app.calibration.heights_judgement import judge_heights
from app.calibration.judgement import overall
from app.calibration.sample import Sample, measure
from app.config import VisionConfig
from app.errors import CalibrationError
from app.estimation.fix import pose_estimator
from app.estimation.height_table import HeightTableConfig
from app.landmark import Landmark
from app.review.calibration.drawing import draw_heights
from app.review.calibration.files import check_free, height_table_text
from app.review.calibration.sources import read_heights
from app.review.calibration.words import height_lines, refused_lines
from app.vision.camera_model import Lens, lens_from_config
from app.vision.detector import Detector
from app.wiring import load_rig, make_camera, read_landmark, read_lens


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
    for frame, folder in frames_of(paths, max_frames, console):
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
    tell(console, [f"the landmark's triangle was measured in {len(samples)} of {len(samples) + len(refused)} frames"])
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
    tell(
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
            tell(console, [f"  {height:g} m: {len(new)} frames, {words}"])
        else:
            tell(console, [f"  {height:g} m: nothing was measured", *refused_lines(refused[-len(taken) :])])
    return _make_table(samples, refused, rig.landmark, rig.lens, centred_only, target, str(rig_path.name), console)


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
        tell(console, refused_lines(refused))
        raise
    checks = judge_heights(table)
    tell(console, [*refused_lines(table.refused), *height_lines(table)])
    if target.draw is not None:
        title = f"{target.out.stem}: {len(table.rows)} heights, {overall(checks).words}"
        tell(console, [f"drawn: {draw_heights(table, title, target.draw)}"])
    text = height_table_text(table, checks, target.out.stem, origin, now())
    return finish(checks, target, console, lambda: text, kind=HeightTableConfig)


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
        tell(console, [f"  {words!r} is no height in metres"])
