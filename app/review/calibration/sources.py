"""Frames for a calibration: videos thinned out, flight records, and the heights at which frames were taken."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from app.errors import CalibrationError
from app.messages import Frame
from app.review.inspect import FrameSource
from app.review.record_reader import read_record

HEIGHT_MAX_M = 200.0
NUMBER = r"(?P<value>\d+(?:[.,]\d+)?)"
UNITS_M = {"height_m": 1.0, "m": 1.0, "height": 1.0, "height_cm": 0.01, "cm": 0.01, "height_mm": 0.001, "mm": 0.001}
"""What stands in the braces of a pattern, and its unit."""


def thinned(source: FrameSource, most: int) -> Iterator[Frame]:
    """The frames of a source; of a video at most so many, evenly over its length.

    Raises:
        ImageError: It can't be read.
    """
    if not source.is_video:
        yield from source.frames()
        return
    count = sum(1 for _ in source.frames())
    step = max(1, math.ceil(count / most))
    for k, frame in enumerate(source.frames()):
        if k % step == 0:
            yield frame


@dataclass(frozen=True, slots=True)
class RecordedFrames:
    """The images of a flight record.

    Attributes:
        path: Of the record.
        is_video: Yes.
    """

    path: Path
    is_video: bool = True

    def frames(self) -> Iterator[Frame]:
        """In order; times count from the first, names are "flight.mcap:000017".

        Raises:
            RecorderError: It is no record.
            CalibrationError: It holds no image.
        """
        first_s: float | None = None
        for k, recorded in enumerate(r for r in read_record(self.path) if isinstance(r.message, Frame)):
            assert isinstance(recorded.message, Frame)
            if first_s is None:
                first_s = recorded.message.t_capture_s
            t_s = recorded.message.t_capture_s - first_s
            yield replace(recorded.message, t_capture_s=t_s, name=f"{self.path.name}:{k:06d}")
        if first_s is None:
            raise CalibrationError(f"{self.path}: no image in this record", "give one that was made with images")


class Span(NamedTuple):
    """A row of the heights' file: a file, or a part of it, at one height."""

    file: str
    height_m: float
    from_s: float
    to_s: float


@dataclass(frozen=True, slots=True)
class Heights:
    """At which height which frame was taken.

    Attributes:
        spans: From a CSV file.
        pattern: On names of files and folders; None with spans.
        scale_m: Of the pattern's number.
    """

    spans: tuple[Span, ...] = ()
    pattern: re.Pattern[str] | None = None
    scale_m: float = 1.0

    def of(self, frame: Frame, folder: str) -> float | None:
        """The height of a frame in metres, or None; folder: the name of the one that its file is in."""
        file = frame.name.rpartition(":")[0] if re.search(r":\d{6}$", frame.name) else frame.name
        if self.pattern is not None:
            found = self.pattern.search(file) or self.pattern.search(folder)
            return None if found is None else float(found["value"].replace(",", ".")) * self.scale_m
        for span in self.spans:
            named = Path(span.file).name
            if named in (file, frame.name) and span.from_s <= frame.t_capture_s <= span.to_s:
                return span.height_m
        return None


def read_heights(text: str) -> Heights:
    """Heights from a CSV file or a pattern on names.

    A CSV file has the columns file and height_m, and from_s and to_s where a video or record holds several heights
    (seconds from its first frame). A pattern has {m}, {cm} or {mm} where the name has the number: "pad-{cm}cm".

    Raises:
        CalibrationError: It is neither, or a row is wrong.
    """
    path = Path(text)
    if "{" in text and not path.is_file():
        return _from_pattern(text)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.DictReader(stream, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as fault:
        words = getattr(fault, "strerror", None) or fault
        raise CalibrationError(
            f"--heights {text}: can't be read ({words})", "give a CSV file, or a pattern with {m}, {cm} or {mm} in it"
        ) from None
    if not rows or not {"file", "height_m"} <= set(rows[0]):
        raise CalibrationError(
            f"--heights {text}: no columns file and height_m", "begin it with a line such as: file,height_m"
        )
    return Heights(tuple(_span(path, k, row) for k, row in enumerate(rows, start=2)))


def _from_pattern(text: str) -> Heights:
    before, unit, after = re.split(r"[{}]", text, maxsplit=2) if text.count("{") == text.count("}") == 1 else ("",) * 3
    if unit not in UNITS_M:
        raise CalibrationError(f"--heights {text}: not a pattern", "put one of {m}, {cm} or {mm} where the number is")
    edge = r"(?<![\d.,])" if not before else ""
    pattern = re.compile(edge + re.escape(before).replace(r"\*", ".*") + NUMBER + re.escape(after).replace(r"\*", ".*"))
    return Heights(pattern=pattern, scale_m=UNITS_M[unit])


def _span(path: Path, line: int, row: dict[str, str | None]) -> Span:
    def number(key: str, otherwise: float) -> float:
        text = row.get(key)
        if text is None or not text.strip():
            return otherwise
        try:
            return float(text)
        except ValueError:
            raise CalibrationError(f"{path}, line {line}: {key} = {text!r}", "give a number") from None

    height = number("height_m", math.nan)
    if not 0.0 < height <= HEIGHT_MAX_M:
        raise CalibrationError(
            f"{path}, line {line}: height_m = {row.get('height_m')!r}", f"give metres, up to {HEIGHT_MAX_M:g}"
        )
    return Span((row.get("file") or "").strip(), height, number("from_s", -math.inf), number("to_s", math.inf))
