"""Images, folders and videos of the user, as frames."""

import subprocess
import sys

import cv2
import numpy as np
import pytest

from app.errors import ImageError
from drivers.camera.images import Stills, Video, open_sources, read_image


def write(path, value=100, size=(32, 24)):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((size[1], size[0], 3), value, np.uint8))
    return path


@pytest.fixture
def clip(tmp_path):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (64, 48))
    for k in range(5):
        writer.write(np.full((48, 64, 3), 40 * k, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tiff", ".webp"])
def test_image_is_read_as_grey(tmp_path, suffix):
    image = read_image(write(tmp_path / f"a{suffix}", 100))
    assert (image.shape, image.dtype) == ((24, 32), np.uint8)
    assert abs(int(image.mean()) - 100) <= 1


def test_sixteen_bit_image_is_read_as_eight(tmp_path):
    cv2.imwrite(str(tmp_path / "deep.png"), np.full((24, 32), 0x8000, np.uint16))
    assert read_image(tmp_path / "deep.png").dtype == np.uint8


def test_folder_is_read_in_the_order_of_its_numbers(tmp_path):
    for name in ("10.png", "2.png", "1.png", "note.txt"):
        write(tmp_path / name) if name.endswith("png") else (tmp_path / name).write_text("x")
    (source,) = open_sources([tmp_path])
    assert [f.name for f in source.frames()] == ["1.png", "2.png", "10.png"]


def test_neighbouring_images_are_one_source_and_a_video_its_own(tmp_path, clip):
    first, second, last = (write(tmp_path / "i" / f"{n}.png") for n in "abc")
    sources = open_sources([first, second, clip, last])
    assert [type(s) for s in sources] == [Stills, Video, Stills]
    assert [s.is_video for s in sources] == [False, True, False]
    assert [f.sequence for f in sources[0].frames()] == [0, 1]


def test_video_frames_have_their_names_and_times(clip):
    frames = list(Video(clip).frames())
    assert [f.name for f in frames] == [f"clip.avi:{k:06d}" for k in range(5)]
    np.testing.assert_allclose([f.t_capture_s for f in frames], [0.0, 0.05, 0.1, 0.15, 0.2])
    np.testing.assert_allclose([f.image.mean() for f in frames], [0, 40, 80, 120, 160], atol=4)


def test_missing_path_is_an_error_that_names_it(tmp_path):
    with pytest.raises(ImageError, match=r"nowhere\.png: no such file or folder"):
        open_sources([tmp_path / "nowhere.png"])


def test_empty_folder_is_an_error_that_names_it(tmp_path):
    with pytest.raises(ImageError, match="no image or video in this folder"):
        open_sources([tmp_path])


@pytest.mark.parametrize("content", [b"", b"this is a letter, not a picture", b"\x89PNG\r\n\x1a\n broken"])
def test_file_that_is_no_image_is_an_error_that_names_it(tmp_path, content):
    path = tmp_path / "letter.png"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=r"letter\.png: not an image; give"):
        list(open_sources([path])[0].frames())


@pytest.mark.parametrize("content", [b"", b"this is a letter, not a film"])
def test_file_that_is_no_video_is_an_error_that_names_it(tmp_path, content):
    path = tmp_path / "letter.mp4"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=r"letter\.mp4: no video that can be read"):
        list(open_sources([path])[0].frames())


def test_decoder_says_nothing_of_its_own_about_a_broken_video(tmp_path):
    path = tmp_path / "letter.mp4"
    path.write_bytes(b"this is a letter, not a film")
    program = (
        "import sys; from pathlib import Path; from app.errors import ImageError; "
        "from drivers.camera.images import Video\n"
        "try: list(Video(Path(sys.argv[1])).frames())\n"
        "except ImageError: print('refused')"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("refused\n", "")


def test_file_without_a_known_ending_is_taken_for_an_image(tmp_path):
    path = tmp_path / "frame"
    path.write_bytes(write(tmp_path / "a.png").read_bytes())
    assert next(open_sources([path])[0].frames()).image.shape == (24, 32)
