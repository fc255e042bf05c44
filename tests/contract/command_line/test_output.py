"""What commands print where: help, JSON lines, and what is left when nobody reads it, or somebody presses Ctrl-C."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from app.wiring import CONFIGS

LENS = CONFIGS / "cameras" / "pi-camera3-640.toml"
KEYS = "frame detected code reason score corners_px t_cam_from_pad_m q_cam_from_pad_wxyz sigma_m paper ms".split()
ALIGHT = [sys.executable, "-m", "app"]


@pytest.mark.parametrize("arguments", [[], ["--help"]])
def test_help_lists_every_command_with_a_line(alight, arguments):
    done = alight(*arguments)
    assert (done.code, done.err) == (0, "")
    listed = dict(line.split(maxsplit=1) for line in done.out.partition("Commands:")[2].splitlines() if line.strip())
    assert list(listed) == ["demo", "run", "phone", "check", "campaign", "detect", "landmark", "calibrate"]
    assert all(words.endswith(".") for words in listed.values())


@pytest.mark.parametrize("command", ["demo", "run", "phone", "check", "campaign", "landmark", "detect"])
def test_help_of_a_command_tells_its_options(alight, command):
    done = alight(command, "--help")
    assert done.code == 0
    assert done.out.startswith(f"Usage: alight {command}")


def test_detect_json_prints_one_line_an_image_with_every_key_and_nothing_else(pad_image, tmp_path):
    (tmp_path / "images" / "notes.txt").write_text("not an image")
    blank = b"P5 640 480 255\n" + bytes([120]) * (640 * 480)
    (tmp_path / "images" / "blank.pgm").write_bytes(blank)
    command = [*ALIGHT, "detect", "--json", "--camera", LENS, "--draw", tmp_path / "out", pad_image.parent]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    missed, found = (json.loads(line) for line in done.stdout.splitlines())
    assert list(missed) == list(found) == KEYS
    assert (missed["frame"], missed["detected"]) == ("blank.pgm", False)
    assert missed["reason"]
    assert (found["frame"], found["detected"], found["code"], found["reason"]) == ("pad.png", True, "44334", None)
    # 1 m below the camera and 38 cm wide: corners 495 * 0.19 px from the centre, front-left first.
    half = 495.0 * 0.19
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + [319.5, 239.5]
    np.testing.assert_allclose(found["corners_px"], square, atol=0.3)
    np.testing.assert_allclose(found["t_cam_from_pad_m"], [0.0, 0.0, 1.0], atol=5e-3)
    assert set(found["paper"]) == {"x_c_m", "y_c_m", "h_m", "theta_rad"}
    assert found["paper"]["h_m"] == pytest.approx(1.0, abs=0.01)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["blank.pgm.png", "pad.png"]


def test_detect_without_json_prints_a_line_for_people(alight, pad_image):
    done = alight("detect", "--camera", LENS, pad_image)
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("pad.png: 44334, score ")


def test_detect_json_of_a_bad_image_keeps_the_lines_before_it(alight, pad_image):
    bad = pad_image.with_name("text.png")
    bad.write_text("no image")
    done = alight("detect", "--json", "--camera", LENS, pad_image, bad)
    assert "text.png: not an image" in done.error
    assert [json.loads(line)["frame"] for line in done.out.splitlines()] == ["pad.png"]


def test_landmark_prints_the_files_that_it_wrote(alight, tmp_path):
    done = alight("landmark", "--out", tmp_path / "pad.svg")
    assert (done.code, done.out) == (0, f"{tmp_path}/pad.svg\n")


def test_output_that_nobody_reads_ends_quietly(pad_image):
    read, write = os.pipe()
    os.close(read)
    try:
        command = [*ALIGHT, "detect", "--json", "--camera", LENS, pad_image]
        done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.timeout(120)
def test_ctrl_c_in_a_demo_ends_all_of_it_and_writes_what_was_flown(tmp_path):
    (tmp_path / "result.json").write_text('{"experiments": [{"outcome": "landed"}]}')
    command = [*ALIGHT, "demo", "--headless", "--out", tmp_path]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, env=environment
    ) as demo:
        try:
            assert demo.stdout is not None
            assert any("takeoff: commanded" in line for line in iter(demo.stdout.readline, ""))
            assert not (tmp_path / "result.json").exists()  # an old result must not be taken for this flight's
            os.killpg(demo.pid, signal.SIGINT)  # as a terminal does: the whole group gets it
            words, error = demo.communicate(timeout=30)
        finally:
            demo.kill()
    assert (demo.returncode, error) == (130, "alight: interrupted\n"), words
    assert "car" not in words
    (entry,) = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["experiments"]
    # The motors were off beyond doubt before it ended.
    assert (entry["name"], entry["outcome"], entry["reason"]) == ("static", "idle", "idle: disarmed")
    last = (tmp_path / "static" / "truth.jsonl").read_text(encoding="utf-8").splitlines()[-1]
    assert json.loads(last)["kind"] == "end"  # the simulator was there to the last order, and was ended in order
