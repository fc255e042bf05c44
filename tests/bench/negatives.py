"""Count false detections: thousands of frames in which there is no landmark, each alone and in a sequence.

    python tests/bench/negatives.py --count 10000 --seed 1 [--unseen] [--workers 1] [--json FILE] [--keep DIR]

Each frame is shown as a still, and three times over to a detector in a sequence, which mostly has just tracked the
landmark at that very place: a landmark that is gone must not be reported. Exit code 1 if anything was.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import photos
from decoys import KINDS, Family
from negative_frames import Negative, frame
from negative_scene import Grey
from optics import lens
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from app.config import LensConfig, VisionConfig, read_config
from app.landmark import paper_landmark
from app.messages import Detection, Frame
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector

STILL, COLD, AFTER = MODES = ("still", "sequence", "after the landmark")


@dataclass(frozen=True, slots=True)
class FalseDetection:
    """One false detection.

    Attributes:
        index: Of the frame.
        mode: "still", "sequence" (that started cold) or "after the landmark".
        kind: What lies where the detection is.
        side_px: Of what lies there; 0 for a bare ground or a photograph.
        code: That the detector gave.
        score: That the detector gave.
        corners_px: Of the outermost contour that it claims.
        picture: Where it was kept, or "".
    """

    index: int
    mode: str
    kind: str
    side_px: float
    code: str
    score: float
    corners_px: list[list[float]]
    picture: str = ""


@dataclass(slots=True)
class Judged:
    """What the detector made of one frame.

    Attributes:
        index: Of the frame.
        kinds: In it.
        false: Detections.
        led: Whether a landmark was shown first.
        tracked: Whether it was found then.
        still_ms: Processor time of the still.
        sequence_ms: Processor time of a frame of the sequence.
    """

    index: int
    kinds: tuple[str, ...]
    false: list[FalseDetection] = field(default_factory=list)
    led: bool = False
    tracked: bool = False
    still_ms: float = 0.0
    sequence_ms: float = 0.0


_DETECTORS: dict[str, Detector] = {}


def _detector(lens_name: str) -> Detector:
    if lens_name not in _DETECTORS:
        camera = lens_from_config(read_config(lens(lens_name).camera_file, LensConfig))
        _DETECTORS[lens_name] = Detector(paper_landmark(), camera, VisionConfig())
    return _DETECTORS[lens_name]


def _frame(image: Grey, sequence: int) -> Frame:
    return Frame(sequence / 30.0, sequence, image)


def _claim(negative: Negative, mode: str, image: Grey, detection: Detection, keep: Path | None) -> FalseDetection:
    corners = detection.contours[0].corners_px
    u, v = (float(x) for x in corners.mean(axis=0))
    kind = negative.kind_at((u, v))
    side = next((p.side_px for k, p in zip(negative.kinds, negative.places, strict=False) if k == kind), 0.0)
    name = ""
    if keep is not None:
        stem = f"{negative.index:06d}-{mode.replace(' ', '-')}-{kind.replace(': ', '-')}"
        drawn = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        for contour in detection.contours:
            cv2.polylines(
                drawn, [np.round(contour.corners_px * 8).astype(np.int32)], True, (0, 0, 255), 1, cv2.LINE_AA, 3
            )
        text = f"{kind} {side:.0f} px: {detection.code} {detection.score:.2f}"
        cv2.putText(drawn, text, (6, 470), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 255), 1, cv2.LINE_AA)
        keep.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(keep / f"{stem}.png"), image)
        cv2.imwrite(str(keep / f"{stem}-drawn.png"), drawn)
        name = f"{stem}.png"
    return FalseDetection(
        negative.index, mode, kind, side, detection.code or "", detection.score, np.round(corners, 2).tolist(), name
    )


def judge(negative: Negative, detector: Detector, keep: Path | None = None, only: str = "") -> Judged:
    """Show one frame to the detector: alone and in its sequence, or `only` "stills" or "sequences"."""
    result = Judged(negative.index, negative.kinds)
    if only != "sequences":
        _judge_still(result, negative, detector, keep)
    if only != "stills":
        _judge_sequence(result, negative, detector, keep)
    return result


def _judge_still(result: Judged, negative: Negative, detector: Detector, keep: Path | None) -> None:
    detector.reset()
    started = time.thread_time()
    seen = detector.detect(_frame(negative.still, 0), still=True)
    result.still_ms = 1e3 * (time.thread_time() - started)
    if seen.detected:
        result.false.append(_claim(negative, STILL, negative.still, seen, keep))


def _judge_sequence(result: Judged, negative: Negative, detector: Detector, keep: Path | None) -> None:
    detector.reset()
    for k, image in enumerate(negative.lead):
        result.led = True
        result.tracked = detector.detect(_frame(image, k)).detected
    mode = AFTER if result.tracked else COLD
    started = time.thread_time()
    claims = []
    for k, image in enumerate(negative.after):
        seen = detector.detect(_frame(image, len(negative.lead) + k))
        if seen.detected:
            claims.append((image, seen))
    result.sequence_ms = 1e3 * (time.thread_time() - started) / len(negative.after)
    result.false += [_claim(negative, mode, image, seen, keep) for image, seen in claims[:1]]


def judge_index(index: int, seed: int, unseen: bool, folder: Path | None, keep: Path | None, only: str) -> Judged:
    """Make a frame and judge it."""
    cv2.setNumThreads(1)
    negative = frame(index, seed, unseen, folder)
    return judge(negative, _detector(negative.lens), keep, only)


def _judge_all(indices: range, workers: int, one: partial[Judged]) -> Iterator[Judged]:
    if workers == 1:
        yield from map(one, indices)
        return
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(one, indices, chunksize=8)


def _family(kind: str) -> str:
    return KINDS[kind][0].value if kind in KINDS else kind.partition(":")[0]


def _wrong(judged: list[Judged]) -> Counter[tuple[str, str]]:
    return Counter((claim.kind, claim.mode) for one in judged for claim in one.false)


def _tables(judged: list[Judged]) -> Iterator[Table]:
    """Frames and false detections by family, and by the kinds that were taken for the landmark."""
    shown = Counter(kind for one in judged for kind in set(one.kinds))
    wrong = _wrong(judged)
    families = Counter(family for one in judged for family in {_family(kind) for kind in one.kinds})
    for title, names in (("family", sorted(families)), ("kind", sorted({kind for kind, _ in wrong}))):
        if not names:
            continue
        table = Table(title=f"false detections by {title}", box=None, title_justify="left")
        table.add_column(title, no_wrap=True)
        for head in ("frames", *MODES):
            table.add_column(head, justify="right")
        for name in names:
            of = [k for k in shown if (k if title == "kind" else _family(k)) == name]
            figures = [str(sum(wrong[kind, mode] for kind in of)) for mode in MODES]
            table.add_row(name, str(shown[name] if title == "kind" else families[name]), *figures)
        yield table


def _summary(judged: list[Judged]) -> dict[str, float | int]:
    """The figures under the table."""
    frames_wrong = {one.index for one in judged for claim in one.false if _family(claim.kind) != Family.ARGUABLE}
    arguable = {one.index for one in judged for claim in one.false if _family(claim.kind) == Family.ARGUABLE}
    return {
        "frames": len(judged),
        "frames_with_a_false_detection": len(frames_wrong),
        "frames_arguable": len(arguable - frames_wrong),
        "led_by_the_landmark": sum(one.led for one in judged),
        "of_these_tracked": sum(one.tracked for one in judged),
        "still_ms_p50": round(float(np.median([one.still_ms for one in judged])), 3),
        "still_ms_p95": round(float(np.percentile([one.still_ms for one in judged], 95)), 3),
        "sequence_ms_p50": round(float(np.median([one.sequence_ms for one in judged])), 3),
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="index of the first frame: with --count 1, that one again")
    parser.add_argument("--unseen", action="store_true", help="the part that nobody tunes on")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write every figure and every false detection here")
    parser.add_argument("--keep", type=Path, help="folder for a picture of every false detection, plain and drawn")
    parser.add_argument("--only", choices=["stills", "sequences"], default="", help="both by default")
    parser.add_argument("--photos", type=Path, default=photos.DEFAULT, help="folder of photographs")
    parser.add_argument("--no-photos", action="store_true", help="bare grounds in place of photographs")
    arguments = parser.parse_args()
    if arguments.count < 1 or arguments.workers < 1 or arguments.first < 0:
        parser.error("--count and --workers must be at least 1, --first at least 0")
    return arguments


def main() -> int:
    """Run it."""
    arguments = _arguments()
    console, progress_to = Console(), Console(stderr=True)
    folder = None if arguments.no_photos else arguments.photos
    try:
        if folder is not None:
            photos.photos(folder, arguments.unseen)
    except photos.NoPhotosError as fault:
        console.print(f"{fault}; or go without them: --no-photos", markup=False)
        return 2
    one = partial(
        judge_index,
        seed=arguments.seed,
        unseen=arguments.unseen,
        folder=folder,
        keep=arguments.keep,
        only=arguments.only,
    )
    indices = range(arguments.first, arguments.first + arguments.count)
    judged: list[Judged] = []
    started = time.monotonic()
    with Progress(console=progress_to, transient=True) as progress:
        bar = progress.add_task("frames without a landmark", total=len(indices))
        for result in _judge_all(indices, arguments.workers, one):
            judged.append(result)
            progress.advance(bar)
    judged.sort(key=lambda result: result.index)
    summary = _summary(judged)
    for table in _tables(judged):
        console.print(table)
    part = "unseen" if arguments.unseen else "seen"
    console.print(f"\n{part} part, seed {arguments.seed}, {time.monotonic() - started:.0f} s", markup=False)
    for name, figure in summary.items():
        console.print(f"{name.replace('_', ' '):32} {figure}", markup=False)
    if arguments.json is not None:
        claims = [asdict(claim) for result in judged for claim in result.false]
        shown = Counter(kind for one in judged for kind in set(one.kinds))
        record = {"seed": arguments.seed, "unseen": arguments.unseen, **summary, "kinds": shown, "false": claims}
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(record, indent=1) + "\n")
    return 1 if summary["frames_with_a_false_detection"] else 0


if __name__ == "__main__":
    sys.exit(main())
