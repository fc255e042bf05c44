"""`alight` in this process, and rig files that can be made wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import structlog

from app.__main__ import main
from app.landmark import paper_landmark
from app.wiring import CONFIGS


@dataclass(frozen=True)
class Done:
    """What a command left: its exit code and its two outputs."""

    code: int
    out: str
    err: str

    @property
    def error(self) -> str:
        """The one line of an error that a person can mend."""
        assert self.code == 2, self
        (line,) = self.err.splitlines()
        assert line.startswith("alight: error: ")
        return line


Alight = Callable[..., Done]


@pytest.fixture
def alight(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Iterator[Alight]:
    """Run `alight` with arguments, to its end. What is written below Python's own streams counts too."""
    interval_s, threads = sys.getswitchinterval(), cv2.getNumThreads()

    def run(*arguments: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["alight", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        return Done(int(ended.value.code or 0), *capfd.readouterr())

    yield run
    sys.setswitchinterval(interval_s)
    cv2.setNumThreads(threads)
    structlog.reset_defaults()


@pytest.fixture(scope="session")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of grey, 640x480."""
    path = tmp_path_factory.mktemp("video") / "grey.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (640, 480))
    for _ in range(60):
        writer.write(np.full((480, 640, 3), 120, np.uint8))
    writer.release()
    return path


@pytest.fixture
def rig(tmp_path: Path, video: Path) -> Callable[..., Path]:
    """Writes a rig file: a video file for a camera, and nobody at the links. Sections are given as TOML text."""

    def write(head: str = "", **sections: str) -> Path:
        text = {
            "camera": f'driver = "opencv"\nsource = "{video}"\nlens = "{CONFIGS}/cameras/pi-camera3-640.toml"',
            "autopilot": 'address = "udpin://127.0.0.1:24711"\nconnect_timeout_s = 0.5',
            "operator": 'address = "udpin://127.0.0.1:24712"',
            "recorder": f'directory = "{tmp_path}/flights"',
            **sections,
        }
        path = tmp_path / "rig.toml"
        tables = "\n".join(f"[{name}]\n{lines}" for name, lines in text.items())
        path.write_text((head or f'pad = "{CONFIGS}/pads/paper-38cm.toml"') + "\n" + tables + "\n", encoding="utf-8")
        return path

    return write


@pytest.fixture
def pad_image(tmp_path: Path) -> Path:
    """The paper's landmark as a pinhole camera (f = 495 px) sees it from 1 m straight above, forward being up."""
    fine = 8  # drawn eight times as large and averaged: OpenCV draws polygons half a pixel too wide
    image = np.full((480 * fine, 640 * fine), 110, np.uint8)
    landmark = paper_landmark()
    half = landmark.quiet_zone_m / 2
    zone = np.array([[half, -half], [half, half], [-half, half], [-half, -half]])
    for corners_m, grey in [(zone, 225), *((c.corners_m, 25 if c.black else 225) for c in landmark.contours)]:
        px = np.column_stack([319.5 + 495.0 * corners_m[:, 1], 239.5 - 495.0 * corners_m[:, 0]])
        cv2.fillPoly(image, [np.round(fine * (px + 0.5) - 0.5).astype(np.int32)], grey)
    path = tmp_path / "images" / "pad.png"
    path.parent.mkdir()
    cv2.imwrite(str(path), cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA))
    return path
