"""Frames of videos and records thinned, and heights from files and names."""

import math

import numpy as np
import pytest

from app.errors import CalibrationError, RecorderError
from app.messages import Frame
from app.review.calibration.sources import RecordedFrames, read_heights, thinned


class Source:
    def __init__(self, count, is_video):
        self.count, self.is_video = count, is_video

    def frames(self):
        for k in range(self.count):
            yield Frame(
                k / 10, k, np.zeros((1, 1), np.uint8), name=f"clip.mp4:{k:06d}" if self.is_video else f"{k}.png"
            )


def frame(name, t_s=0.0):
    return Frame(t_s, 0, np.zeros((1, 1), np.uint8), name=name)


@pytest.mark.parametrize(("count", "most", "taken"), [(10, 20, 10), (100, 20, 20), (101, 20, 17)])
def test_video_is_thinned_evenly(count, most, taken):
    numbers = [f.sequence for f in thinned(Source(count, True), most)]
    assert len(numbers) == taken
    assert len(set(np.diff(numbers))) == 1


def test_stills_are_all_looked_at():
    assert len(list(thinned(Source(50, False), 20))) == 50


def test_heights_of_a_csv_file_belong_to_files_and_spans(tmp_path):
    path = tmp_path / "heights.csv"
    path.write_text("file,height_m,from_s,to_s\na.png,0.5,,\nclip.mp4,1.0,0,2\nclip.mp4,2.5,2.5,4\n")
    heights = read_heights(str(path))
    assert heights.of(frame("a.png"), "") == 0.5
    assert heights.of(frame("clip.mp4:000003", 1.5), "") == 1.0
    assert heights.of(frame("clip.mp4:000030", 3.0), "") == 2.5
    assert heights.of(frame("clip.mp4:000022", 2.2), "") is None
    assert heights.of(frame("b.png"), "") is None


@pytest.mark.parametrize(
    ("pattern", "name", "folder", "height"),
    [
        ("{m}m", "pad-1.63m.png", "", 1.63),
        ("{cm}cm", "pad 30cm left.png", "", 0.30),
        ("pad-{mm}", "pad-790-2.png", "", 0.79),
        ("h{m}_", "x.png", "h2.5_offset", 2.5),
        ("{m}m", "clip-2m.mp4:000017", "", 2.0),
        ("h{height_cm}", "h 30.png", "other", None),
        ("{m}m", "3,5m.png", "", 3.5),
    ],
)
def test_heights_of_a_pattern_come_from_the_name_of_file_or_folder(pattern, name, folder, height):
    assert read_heights(pattern).of(frame(name), folder) == (None if height is None else pytest.approx(height))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("file,height\na,1\n", "no columns file and height_m"),
        ("", "no columns file and height_m"),
        ("file,height_m\na,tall\n", "line 2: height_m = 'tall'; give a number"),
        ("file,height_m\na,1\nb,-1\n", "line 3: height_m = '-1'; give metres"),
        ("file,height_m\na,nan\n", "line 2: height_m = 'nan'; give metres"),
        ("file,height_m,from_s\na,1,now\n", "line 2: from_s = 'now'; give a number"),
    ],
)
def test_wrong_heights_file_is_refused_with_the_line(tmp_path, text, says):
    path = tmp_path / "heights.csv"
    path.write_text(text)
    with pytest.raises(CalibrationError) as error:
        read_heights(str(path))
    assert says in str(error.value)


@pytest.mark.parametrize("text", ["nowhere.csv", "pad-{feet}", "{m}{cm}", "}{"])
def test_neither_file_nor_pattern_is_refused_with_both_ways(text):
    with pytest.raises(CalibrationError, match=r"\{m\}"):
        read_heights(text)


def test_heights_are_never_not_numbers():
    assert math.isfinite(read_heights("{m}m").of(frame("0.5m.png"), ""))


def test_file_that_is_no_record_is_refused(tmp_path):
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(RecorderError, match="not an MCAP file"):
        list(RecordedFrames(path).frames())
