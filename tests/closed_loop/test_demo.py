"""The whole of it over MAVLink, in real time: `alight demo` as a person runs it."""

from __future__ import annotations

import json
import subprocess
import sys

import cv2
import pytest


@pytest.mark.timeout(240)
def test_demo_static_lands_over_mavlink_and_writes_what_it_promises(tmp_path):
    command = [sys.executable, "-m", "app", "demo", "--experiment", "static", "--headless", "--seed", "7"]
    done = subprocess.run([*command, "--out", tmp_path], capture_output=True, text=True, timeout=220, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (result,) = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["experiments"]
    assert (result["name"], result["outcome"]) == ("static", "landed")
    assert (
        result["touchdown_error_m"] < 0.15
    )  # a busy machine costs frames; the figure of a quiet one is measured apart
    assert set(result["time_in_state_s"]) >= {"takeoff", "search", "hover", "track", "land"}
    for picture in ("vertical-velocity", "height", "distance", "original-and-binary"):
        image = cv2.imread(str(tmp_path / "static" / f"static-{picture}.png"))
        assert image is not None
        assert image.std() > 5.0
    video = cv2.VideoCapture(str(tmp_path / "static" / "static.mp4"))
    flown_s = sum(result["time_in_state_s"].values()) - result["time_in_state_s"]["landed"]
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) > 0.8 * 30.0 * flown_s  # images are kept while it flies
    video.release()
