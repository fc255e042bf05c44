"""The frames that povray.py left in a folder, as cases of the benchmark."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from optics import Array, lens
from scenes import Light, Scene, Truth
from store import Case


class FolderError(Exception):
    """A folder that holds no such set; its text says what to do."""


@dataclass
class FolderCase(Case):
    """A frame of a folder. It shows Alight's landmark, or (kind "none") none at all: then any detection is wrong."""

    file: Path = Path()

    @property
    def name(self) -> str:
        """Its file's."""
        return self.file.stem

    def frame(self, marker: str) -> Array:
        """(480, 640) uint8."""
        self.prepare((marker,))
        return self._frames[marker]

    def prepare(self, markers: Sequence[str] = ("alight",), keep: bool = True) -> None:
        """Read it."""
        if set(markers) != {"alight"}:
            raise FolderError(f"{self.file.parent} holds frames with Alight's landmark alone: ask for no other marker")
        if "alight" not in self._frames:
            image = cv2.imread(str(self.file), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise FolderError(f"{self.file} is missing or no image: render the folder again with povray.py")
            self._frames["alight"] = np.asarray(image, np.uint8)


def _corners(value: list[list[float | None]] | None) -> Array:
    if value is None:
        return np.full((4, 2), math.nan)
    return np.array([[math.nan if x is None else x for x in corner] for corner in value])


def _case(folder: Path, record: dict[str, Any]) -> FolderCase:
    rotation, translation = np.array(record["rotation"]), np.array(record["translation"])
    truth = Truth(
        rotation, translation, _corners(record["corners_px"]), record["side_px"], record["visible"], record["height"]
    )
    scene = Scene(0, 0, record["lens"], rotation, translation, Light(record["light"]), ground=record["ground"])
    return FolderCase(
        set_name=f"pov-{record['set']}",
        index=record["index"],
        kind=record["kind"],
        scene=scene,
        truth=truth,
        optics=lens(record["lens"]),
        unseen=True,
        file=folder / record["file"],
    )


def load_folder(folder: Path) -> dict[str, list[FolderCase]]:
    """Cases by set, in order.

    Raises:
        FolderError: There is no truth.json in it, or it is none of povray.py's.
    """
    listing = folder / "truth.json"
    try:
        records = json.loads(listing.read_text())["frames"]
    except FileNotFoundError as fault:
        raise FolderError(f"no {listing}: render a set with `python tests/bench/povray.py {folder}`") from fault
    except (json.JSONDecodeError, KeyError, TypeError) as fault:
        raise FolderError(f"{listing} is not a list of frames by povray.py: render the folder again") from fault
    cases: dict[str, list[FolderCase]] = {}
    for case in _in_order(folder, records):
        cases.setdefault(case.set_name, []).append(case)
    return cases


def _in_order(folder: Path, records: list[dict[str, Any]]) -> Iterator[FolderCase]:
    for record in sorted(records, key=lambda one: (one["set"], one["index"])):
        yield _case(folder, record)
