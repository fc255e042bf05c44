"""What the commands of `alight calibrate` share: where results go, frames with a count, lines told, files written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from app.calibration.judgement import Check, Verdict, overall
from app.config import Section
from app.messages import Frame
from app.review.calibration.files import write_checked
from app.review.calibration.sources import RecordedFrames, thinned
from app.review.calibration.words import judgement_lines
from app.review.inspect import FrameSource
from app.wiring import open_sources


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


def finish(
    checks: Sequence[Check],
    target: Target,
    console: Console,
    text: Callable[[], str],
    *,
    kind: type[Section],
) -> bool:
    """Judge, and write or not."""
    tell(console, judgement_lines(checks))
    if overall(checks) is Verdict.NOT_GOOD and not target.force:
        tell(console, [f"{target.out} is not written; --force writes it all the same"])
        return False
    write_checked(target.out, text(), kind)
    tell(console, [f"written: {target.out}"])
    return True


def frames_of(paths: Sequence[Path], max_frames: int, console: Console) -> Iterator[tuple[Frame, str]]:
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


def now() -> str:
    """Date and time for a file's comment."""
    return f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"


def tell(console: Console, lines: Sequence[str]) -> None:
    """Print lines as they are."""
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
