"""The second renderer's geometry against the benchmark's own, and what a user is told when it can't work."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace

import cv2
import numpy as np
import povray
import pytest
from povray_folder import FolderError, load_folder
from povray_sensor import sense
from sets import draw

needs_povray = pytest.mark.skipif(shutil.which("povray") is None, reason="POV-Ray is not here: apt-get install povray")


@needs_povray
def test_points_of_known_place_fall_where_the_lenses_say():
    assert povray.check() < 0.06


@needs_povray
def test_scene_that_povray_refuses_says_so():
    with pytest.raises(povray.PovrayError, match="refused"):
        povray.trace("#version 3.7; nonsense", 0)


def test_missing_povray_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(povray.PovrayError, match="apt-get install povray"):
        povray.trace("", 0)


def test_sensor_moves_no_edge():
    # A step at 320.5 px, blurred and moved: where it crosses half its height is where it was.
    scene = draw("hard-B", 4).scene
    light = np.full((480, 640), 0.02, np.float32)
    light[:, 321:] = 0.2
    still = {"noise": 0.0, "gamma": 1.0, "jpeg": None, "vignette": 0.0, "veil": 0.0, "black_level": 0.0, "meter": 0.0}
    scene = replace(scene, **still, motion_px=(5.0, 2.0), exposure=0.7)
    row = sense(light, scene, np.random.default_rng(1))[240].astype(float)
    middle = (row[:200].mean() + row[-200:].mean()) / 2
    k = int(np.argmax(row > middle))
    crossing = k - (row[k] - middle) / (row[k] - row[k - 1])
    assert crossing == pytest.approx(320.5, abs=0.05)


def test_folder_without_a_list_says_how_to_make_one(tmp_path):
    with pytest.raises(FolderError, match=r"povray\.py"):
        load_folder(tmp_path)


def test_folder_of_a_frame_without_landmark_has_no_corners(tmp_path):
    record = {
        "file": "none-A-1-0000.png",
        "set": "none-A",
        "index": 0,
        "kind": "none",
        "lens": "A",
        "marker": False,
        "rotation": np.eye(3).tolist(),
        "translation": [0.0, 0.0, 2.0],
        "corners_px": None,
        "side_px": 40.0,
        "visible": 1.0,
        "hidden": 0.0,
        "height": 2.0,
        "light": "noon",
        "ground": "lawn",
    }
    (tmp_path / "truth.json").write_text(json.dumps({"frames": [record]}))
    cv2.imwrite(str(tmp_path / "none-A-1-0000.png"), np.full((480, 640), 7, np.uint8))
    (case,) = load_folder(tmp_path)["pov-none-A"]
    assert math.isnan(case.truth.corners_px[0, 0])
    assert int(case.frame("alight").mean()) == 7
    with pytest.raises(FolderError, match="no other marker"):
        case.frame("aruco4")
