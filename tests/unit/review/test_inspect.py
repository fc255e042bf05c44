"""`alight detect` behind the command: what it tells of frames, and what it draws."""

import json
import math

import cv2
import numpy as np
import pytest

from app.config import VisionConfig
from app.errors import ImageError
from app.messages import Frame
from app.review.inspect import inspect
from app.vision.camera_model import lens_from_config

KEYS = [
    "frame",
    "detected",
    "code",
    "reason",
    "score",
    "corners_px",
    "t_cam_from_pad_m",
    "q_cam_from_pad_wxyz",
    "sigma_m",
    "paper",
    "ms",
]


class Source:
    def __init__(self, images, is_video=False):
        self.images = images
        self.is_video = is_video

    def frames(self):
        for k, (name, image) in enumerate(self.images.items()):
            yield Frame(t_capture_s=k / 30, sequence=k, image=image, name=name)


@pytest.fixture(scope="module")
def drawn(scene):
    """A landmark at 1 m, half a metre to the front, turned by 90 degrees; and a lawn."""
    view = scene.view(1.0, forward_m=0.5, pad_yaw_deg=90)
    return {"pad.png": scene.draw(view), "lawn.png": scene.draw(scene.view(1.0), polygons=[])}


@pytest.fixture
def look(scene):
    def run(*sources, lens=None, **options):
        return list(
            inspect(
                sources,
                lens=lens_from_config((lens or scene.fisheye).config),
                landmark=scene.landmark,
                vision=VisionConfig(),
                **options,
            )
        )

    return run


def test_json_line_of_a_detected_frame_has_every_field(look, drawn):
    found, _ = look(Source(drawn))
    line = json.loads(found.to_json())
    assert list(line) == KEYS
    assert (line["frame"], line["detected"], line["code"], line["reason"]) == ("pad.png", True, "44334", None)
    assert line["score"] > 0.8
    assert line["ms"] > 0
    # The pad lies 0.5 m towards the top of the image and 1 m below; its forward axis is image right.
    np.testing.assert_allclose(line["t_cam_from_pad_m"], [0.0, -0.5, 1.0], atol=2e-3)
    quarter = math.sqrt(0.5)
    rotation_of_forward_to_right_and_right_to_down = [1.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(
        line["q_cam_from_pad_wxyz"], rotation_of_forward_to_right_and_right_to_down, atol=0.01 * quarter
    )
    assert all(0 < s < 0.02 for s in line["sigma_m"])
    assert line["paper"]["h_m"] == pytest.approx(1.0, abs=0.01)
    assert line["paper"]["theta_rad"] == pytest.approx(math.pi / 2, abs=0.01)


def test_corners_are_those_of_the_outermost_contour_from_front_left_on(look, drawn, scene):
    found, _ = look(Source(drawn))
    truth = scene.corners_px(scene.view(1.0, forward_m=0.5, pad_yaw_deg=90), 0, scene.fisheye)
    np.testing.assert_allclose(json.loads(found.to_json())["corners_px"], truth, atol=0.2)


def test_json_line_of_a_frame_without_landmark_has_nulls_and_a_reason(look, drawn):
    _, missed = look(Source(drawn))
    line = json.loads(missed.to_json())
    assert list(line) == KEYS
    assert (line["frame"], line["detected"]) == ("lawn.png", False)
    assert line["reason"]
    assert {line[k] for k in KEYS if k not in {"frame", "detected", "reason", "ms"}} == {None}


def test_corners_that_were_not_seen_come_from_the_pose(look, scene):
    view = scene.view(0.18, forward_m=0.03, pad_yaw_deg=20)
    (found,) = look(Source({"cut.png": scene.draw(view, lens=scene.pinhole)}), lens=scene.pinhole)
    line = json.loads(found.to_json())
    assert line["detected"]
    assert "0" not in {str(c.index) for c in found.detection.contours}
    np.testing.assert_allclose(line["corners_px"], scene.corners_px(view, 0, scene.pinhole), atol=4.0)


@pytest.mark.parametrize("method", ["pnp", "paper"])
def test_both_methods_agree_below_a_level_camera(look, drawn, method):
    found, _ = look(Source(drawn), method=method)
    np.testing.assert_allclose(found.pose.t_cam_from_pad_m, [0.0, -0.5, 1.0], atol=0.01)


def test_method_paper_without_its_triangle_says_so(look, scene):
    polygons = scene.polygons()
    # Far away only the two squares stand out.
    image = scene.draw(scene.view(6.0), polygons=polygons, seed=3)
    (found,) = look(Source({"far.png": image}), method="paper")
    assert (found.pose is None) == (found.reason is not None)


@pytest.mark.parametrize(
    ("is_video", "sequence", "carried"),
    [(True, None, True), (False, None, False), (True, False, False), (False, True, True)],
)
def test_sequence_is_the_default_for_video_and_can_be_chosen(look, drawn, is_video, sequence, carried):
    twice = Source({"0": drawn["pad.png"], "1": drawn["pad.png"]}, is_video)
    found = look(twice, sequence=sequence)
    assert (found[1].detection.roi_px is not None) == carried


def test_memory_ends_with_its_source(look, drawn):
    one, two = (Source({name: drawn["pad.png"]}, is_video=True) for name in "ab")
    assert [f.detection.roi_px for f in look(one, two)] == [None, None]


def test_text_names_the_frame_and_what_was_seen(look, drawn):
    found, missed = look(Source(drawn))
    assert found.to_text().startswith("pad.png: 44334, score 1.0")
    assert "along the axis 1.0" in found.to_text() or "along the axis 0.99" in found.to_text()
    assert missed.to_text().startswith("lawn.png: not found (")


def test_pictures_are_written_with_a_caption_below(look, drawn, tmp_path):
    look(Source(drawn), draw=tmp_path / "out")
    picture = cv2.imread(str(tmp_path / "out" / "pad.png"))
    assert (tmp_path / "out" / "lawn.png").exists()
    height, width, _ = picture.shape
    assert width == 640
    assert height > 480
    # Something coloured was drawn on what was grey.
    inside = picture[:480].astype(int)
    assert (np.ptp(inside, axis=2) > 60).sum() > 200


def test_picture_of_a_video_frame_has_a_name_fit_for_a_file(look, drawn, tmp_path):
    look(Source({"clip.mp4:000017": drawn["pad.png"]}, is_video=True), draw=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["clip.mp4-000017.png"]


def test_folder_that_cannot_be_written_is_an_error_that_names_it(look, drawn, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(ImageError, match="can't be written"):
        look(Source(drawn), draw=blocked / "out")


def test_image_of_another_size_is_an_error_that_names_it(look):
    with pytest.raises(ImageError, match=r"small\.png: 64x48 pixels, the camera file says 640x480"):
        look(Source({"small.png": np.zeros((48, 64), np.uint8)}))
