"""Images, folders and videos that the user has, as frames. No Camera port: nothing here happens in real time.

Frames are grey (decisions/0005). An image's own orientation tag is ignored: the lens file is about its pixels.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from app.errors import ImageError
from app.messages import Frame, Image

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm", ".pnm", ".jp2"})
VIDEO_SUFFIXES = frozenset({".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".mjpeg", ".mjpg", ".h264", ".mpg", ".ts"})
DEFAULT_RATE_HZ = 30.0
"""Of a video that doesn't tell, and of images read as a sequence."""


@dataclass(frozen=True, slots=True)
class Stills:
    """Image files that follow each other.

    Attributes:
        paths: In order.
        is_video: No.
    """

    paths: tuple[Path, ...]
    is_video: bool = False

    def frames(self) -> Iterator[Frame]:
        """The images, each read when its turn comes.

        Raises:
            ImageError: A file is no image.
        """
        for k, path in enumerate(self.paths):
            yield Frame(t_capture_s=k / DEFAULT_RATE_HZ, sequence=k, image=read_image(path), name=path.name)


@dataclass(frozen=True, slots=True)
class Video:
    """A video file.

    Attributes:
        path: The file.
        is_video: Yes.
    """

    path: Path
    is_video: bool = True

    def frames(self) -> Iterator[Frame]:
        """Its frames, with their times at its own frame rate; named "clip.mp4:000017", from 0.

        Raises:
            ImageError: It is no video, or holds no frame.
        """
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        capture = cv2.VideoCapture(str(self.path))
        try:
            rate = capture.get(cv2.CAP_PROP_FPS) if capture.isOpened() else 0.0
            rate = rate if rate > 0 else DEFAULT_RATE_HZ
            count = 0
            while True:
                read, image = capture.read() if capture.isOpened() else (False, None)
                if not read or image is None:
                    break
                name = f"{self.path.name}:{count:06d}"
                yield Frame(t_capture_s=count / rate, sequence=count, image=_grey(np.asarray(image)), name=name)
                count += 1
        finally:
            capture.release()
        if count == 0:
            raise ImageError(f"{self.path}: no video that can be read", "give an image, a folder of images or a video")


def _grey(image: np.ndarray) -> Image:
    """(h, w) uint8 of a decoded image."""
    if image.ndim == 3:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    return np.asarray(image, dtype=np.uint8)


def read_image(path: Path) -> Image:
    """(h, w) uint8 grey.

    Raises:
        ImageError: The file is missing, can't be read or is no image.
    """
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise ImageError(f"{path}: can't be read ({error.strerror})", "give an image that can be read") from None
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) if data.size else None
    if image is None:
        raise ImageError(f"{path}: not an image", "give PNG, JPEG, TIFF, BMP or WebP files")
    return np.asarray(image, dtype=np.uint8)


def _in_order(path: Path) -> tuple[tuple[int, int | str], ...]:
    """Sorts names so that 2.png comes before 10.png."""
    parts = re.split(r"(\d+)", path.name.lower())
    return tuple((0, int(p)) if p.isdigit() else (1, p) for p in parts if p)


def _expand(path: Path) -> list[Path]:
    """The files that a path stands for."""
    if not path.exists():
        raise ImageError(f"{path}: no such file or folder", "give images, folders of images or videos")
    if not path.is_dir():
        return [path]
    known = IMAGE_SUFFIXES | VIDEO_SUFFIXES
    try:
        files = sorted((p for p in path.iterdir() if p.is_file() and p.suffix.lower() in known), key=_in_order)
    except OSError as error:
        raise ImageError(f"{path}: can't be read ({error.strerror})", "give a folder that can be read") from None
    if not files:
        raise ImageError(f"{path}: no image or video in this folder", "give a folder with .png, .jpg or .mp4 files")
    return files


def open_sources(paths: Sequence[Path]) -> list[Stills | Video]:
    """What to read, in order: neighbouring images together, each video by itself.

    Raises:
        ImageError: A path doesn't exist, or a folder holds nothing.
    """
    sources: list[Stills | Video] = []
    for file in (file for path in paths for file in _expand(path)):
        if file.suffix.lower() in VIDEO_SUFFIXES:
            sources.append(Video(file))
        elif sources and isinstance(last := sources[-1], Stills):
            sources[-1] = Stills((*last.paths, file))
        else:
            sources.append(Stills((file,)))
    return sources
