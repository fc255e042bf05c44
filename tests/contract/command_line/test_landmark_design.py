"""`alight landmark design`: its table, JSON, pad file and picture, and what it says to bad input."""

import json

import cv2
import pytest

from app.wiring import CONFIGS

FISHEYE = CONFIGS / "cameras" / "pi-fisheye-640.toml"
ASKED = ("landmark", "design", "--camera", FISHEYE)
PAPERS = (*ASKED, "--ceiling", "5", "--floor", "0.3", "--max-size-cm", "38")


def test_design_prints_the_pad_and_the_heights_of_each_run(alight):
    done = alight(*PAPERS)
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == "pad: paper-38cm, 5 contours, code 44334, side 38 cm, quiet zone 46 cm"
    table = lines[lines.index("") + 1 :]
    assert [line.split("  ")[0] for line in table[:5]] == ["contours in view", "S1 S2 T3", "S2 T3", "T3 T4 S5", "T4 S5"]
    # S1's corner is 19 * sqrt(2) cm from the middle; 0.8 of tan(1.1 rad - 10 deg) heights are in view.
    assert "25.3 cm" in table[1]
    assert "finest line to print: 12 mm" in lines
    assert "prints on: 7 pages of a4, 5 pages of a3, 7 pages of letter" in lines


def test_design_writes_a_pad_file_that_can_be_printed_and_named(alight, tmp_path):
    pad, sheet = tmp_path / "pad.toml", tmp_path / "pad.svg"
    done = alight(*ASKED, "--ceiling", "12", "--floor", "0.1", "--out", pad)
    assert (done.code, done.out.splitlines()[-1]) == (0, f"wrote {pad}")
    assert alight("landmark", "--config", pad, "--out", sheet).out == f"{sheet}\n"
    assert "code 4433434" in sheet.read_text(encoding="utf-8")


def test_design_never_replaces_a_pad_file_unless_told_to(alight, tmp_path):
    pad = tmp_path / "pad.toml"
    pad.write_text("mine", encoding="utf-8")
    error = alight(*PAPERS, "--out", pad).error
    assert f"{pad}: exists already; give another name, or --overwrite" in error
    assert pad.read_text(encoding="utf-8") == "mine"
    assert alight(*PAPERS, "--out", pad, "--overwrite").code == 0
    assert 'name = "paper-38cm"' in pad.read_text(encoding="utf-8")


def test_design_that_falls_short_says_what_would_do_ends_with_1_and_writes_no_pad(alight, tmp_path):
    pad = tmp_path / "pad.toml"
    done = alight(*ASKED, "--ceiling", "12", "--floor", "0.3", "--max-size-cm", "38", "--out", pad)
    assert (done.code, done.err) == (1, "")
    assert done.out.startswith("nearest pad: ")
    assert "not met: the ceiling of 12 m is out of reach" in done.out
    assert "what would do: a larger pad: --max-size-cm 76" in done.out
    assert not pad.exists()


def test_design_json_is_one_line_with_every_run(alight):
    done = alight(*PAPERS, "--json")
    assert (done.code, done.err, done.out.count("\n")) == (0, "", 1)
    found = json.loads(done.out)
    assert (found["met"], found["code"], found["size_cm"], found["not_met"]) == (True, "44334", 38.0, [])
    assert [contour["name"] for contour in found["contours"]] == ["S1", "S2", "T3", "T4", "S5"]
    assert len(found["runs"]) == 10
    shortest = [run["code"] for run in found["runs"] if run["shortest_that_does"]]
    assert shortest == ["443", "43", "334", "34"]
    ((low, high),) = found["covered_m"]
    assert low < 0.3
    assert high > 5.0


def test_design_draws_a_picture(alight, tmp_path):
    path = tmp_path / "design.png"
    assert alight(*PAPERS, "--draw", path).code == 0
    image = cv2.imread(str(path))
    assert image.shape == (676, 1560, 3)  # 12 x 5.2 inches at 130 dots per inch
    assert image.min() < 60
    assert (image[0, 0] == 255).all()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--ceiling", "0.2", "--floor", "0.3"], "a floor of 0.3 m is not under a ceiling of 0.2 m; give a --floor"),
        (["--ceiling", "5"], "missing option '--floor'"),
        (["--ceiling", "5", "--floor", "0.3", "--tilt", "60"], "leaves nothing|nothing of a view"),
        (["--ceiling", "5", "--floor", "0.3", "--offset", "1"], "invalid value for '--offset'"),
        (
            ["--ceiling", "5", "--floor", "0.3", "--out", "pad.txt"],
            "pad.txt: a pad file is a .toml; give --out pad.toml",
        ),
        (["--ceiling", "5", "--floor", "0.3", "--out", "no/pad.toml"], "no/pad.toml: no such folder (no)"),
        (["--ceiling", "5", "--floor", "0.3", "--draw", "pad.jpg"], "the drawing is a .png; give --draw pad.png"),
    ],
)
def test_design_with_bad_input_says_what_to_do(alight, arguments, says):
    camera = CONFIGS / "cameras" / "pi-camera3-640.toml"
    error = alight("landmark", "design", "--camera", camera, *arguments).error
    assert any(words in error for words in says.split("|"))


def test_landmark_options_before_design_are_refused(alight, tmp_path):
    error = alight("landmark", "--out", tmp_path / "pad.pdf", "design", "--ceiling", "5", "--floor", "1").error
    assert "options of 'design' come after it" in error
    assert list(tmp_path.iterdir()) == []
