"""Cases with their frames, kept between runs in a folder outside the checkout.

    import sys; sys.path.insert(0, "tests/bench")
    from store import load
    for case in load("hard-A", 100): ...

A frame is kept under a digest of the code that drew and rendered it: changed code renders anew, changed comments don't.
The folder: the environment variable ALIGHT_BENCH_CACHE, or ~/.cache/alight-bench.
"""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import sets
from optics import HERE, Array, Optics, lens
from prints import MARKERS
from render import render
from scenes import Scene, Truth
from sequences import draw_sequence, is_visible

SOURCES = ("covers", "grounds", "optics", "prints", "render", "scenes", "texture")


def cache_folder() -> Path:
    """Where frames are kept."""
    named = os.environ.get("ALIGHT_BENCH_CACHE")
    return Path(named).expanduser() if named else Path.home() / ".cache" / "alight-bench"


def _meaning(source: str) -> str:
    """The code without comments, docstrings and layout."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [  # type: ignore[attr-defined]  # these nodes have a body
                one for one in body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))
            ]
    return ast.dump(tree)


@lru_cache
def _digest(modules: tuple[str, ...]) -> str:
    text = "".join(_meaning((HERE / f"{name}.py").read_text(encoding="utf-8")) for name in modules)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass
class Case:
    """One frame of a set.

    Attributes:
        set_name: Of the set.
        index: Its number in it.
        kind: Height, band of the cone or kind of hardship.
        scene: What was drawn.
        truth: Where the marker is.
        optics: The lens.
        unseen: Of the part that is not looked at while tuning.
        t_s: Time in the sequence; 0 for a still.
    """

    set_name: str
    index: int
    kind: str
    scene: Scene
    truth: Truth
    optics: Optics
    unseen: bool
    t_s: float = 0.0
    _frames: dict[str, Array] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        """For messages and file names."""
        return f"{self.set_name}-{'u' if self.unseen else 't'}{self.index:04d}"

    @property
    def image(self) -> Array:
        """(480, 640) uint8 with Alight's landmark."""
        return self.frame("alight")

    def frame(self, marker: str) -> Array:
        """(480, 640) uint8 with one of the markers of prints.MARKERS, or "none"."""
        if marker not in self._frames:
            self.prepare((marker,))
        return self._frames[marker]

    def prepare(self, markers: Sequence[str] = MARKERS, keep: bool = True) -> None:
        """Render, or fetch, what is missing: several markers at once cost less than one by one.

        Args:
            markers: Which.
            keep: In memory too, not only in the folder.
        """
        folder = cache_folder() / _digest(SOURCES) / f"{self.set_name}-{'unseen' if self.unseen else 'tuning'}"
        paths = {m: folder / f"{self.index:04d}-{_scene_digest(self.scene)}-{m}.png" for m in markers}
        missing = [m for m in markers if m not in self._frames and not paths[m].exists()]
        if missing:
            folder.mkdir(parents=True, exist_ok=True)
            for marker, image in (render(self.scene, missing)).items():
                part = paths[marker].with_suffix(f".{os.getpid()}.png")
                if not cv2.imwrite(str(part), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
                    raise OSError(f"can't write {part}")
                part.replace(paths[marker])
        if keep:
            for marker in markers:
                if marker not in self._frames:
                    self._frames[marker] = np.asarray(cv2.imread(str(paths[marker]), cv2.IMREAD_GRAYSCALE), np.uint8)

    def forget(self) -> None:
        """Let go of the frames in memory."""
        self._frames.clear()


def _scene_digest(scene: Scene) -> str:
    """Of every number of the scene, so that a set that is drawn otherwise is rendered anew."""
    text = repr(scene) + np.round(scene.rotation, 12).tobytes().hex() + np.round(scene.translation, 12).tobytes().hex()
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def load(set_name: str, count: int, unseen: bool = False, kinds: Sequence[str] = ()) -> Iterator[Case]:
    """The first `count` cases of a set, in order.

    Args:
        set_name: Of sets.STILL_SETS.
        count: How many.
        unseen: From the part that is not looked at while tuning.
        kinds: Only these, if any are named (count is before they are picked).
    """
    for index in range(count):
        drawn = sets.draw(set_name, index, unseen)
        if kinds and drawn.kind not in kinds:
            continue
        yield Case(set_name, index, drawn.kind, drawn.scene, drawn.truth, lens(drawn.scene.lens), unseen)


def load_sequence(name: str, unseen: bool = False) -> Iterator[Case]:
    """The frames of a sequence, in order.

    Args:
        name: Of sequences.NAMES.
        unseen: From the part that is not looked at while tuning.
    """
    for drawn in draw_sequence(name, unseen):
        kind = "visible" if is_visible(drawn.truth) else "cut"
        optics = lens(drawn.scene.lens)
        yield Case(f"seq-{name}", drawn.index, kind, drawn.scene, drawn.truth, optics, unseen, drawn.t_s)
