"""The camera's view of a flight as a video, and the images that are taken from it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from app.config import VisionConfig
from app.errors import RecorderError
from app.messages import Frame, Phase, PlaneFit
from app.review.flight import collect_flight
from app.review.record_reader import read_record
from app.review.video import binary_of, detection_of, middle_of_descent, write_video
from app.vision.camera_model import lens_from_config


@pytest.fixture(scope="module")
def lens(scene):
    return lens_from_config(scene.fisheye.config)


@pytest.fixture(scope="module")
def view(scene):
    """The landmark 1 m straight below, its forward axis up in the image."""
    return scene.draw(scene.view(1.0))


def frames_of(path):
    video = cv2.VideoCapture(str(path))
    found = []
    while (read := video.read())[0]:
        found.append(read[1].astype(int))
    rate = video.get(cv2.CAP_PROP_FPS)
    video.release()
    return found, rate


def coloured(image):
    return int((np.ptp(image, axis=2) > 60).sum())


def test_video_has_each_frame_with_what_was_seen_in_it(items, record, scene, lens, view, tmp_path):
    corners = scene.corners_px(scene.view(1.0), 0, scene.fisheye)
    path = record(
        [
            items.report(0.9, Phase.TRACK, "track: settled over the pad"),
            items.frame(1.0, 0, view),
            items.detection(1.0, 0, reason="no dark square"),
            items.frame(1.1, 1, view),
            items.detection(1.1, 1, corners),
            items.fix(1.1, 0.0, 0.0, 1.0),
        ]
    )
    write_video(path, tmp_path / "out.mp4", scene.landmark, lens)
    (missed, found), rate = frames_of(tmp_path / "out.mp4")
    assert rate == pytest.approx(30.0)
    assert missed.shape == found.shape == (480, 640, 3)
    around = np.s_[150:330, 220:420]
    assert coloured(missed[around]) == 0
    assert coloured(found[around]) > 100
    # The phase is written in the upper left corner of both.
    assert missed[8:30, 10:200].max() > 225
    assert found[8:30, 10:200].max() > 225


def test_video_of_a_frame_that_was_never_looked_at_shows_it_as_it_is(items, record, scene, lens, view, tmp_path):
    path = record([items.frame(1.0, 0, view)])
    write_video(path, tmp_path / "out.mp4", scene.landmark, lens)
    ((only,), _) = frames_of(tmp_path / "out.mp4")
    assert np.abs(only[..., 0] - view).mean() < 8  # MPEG-4 of a lawn


def test_video_of_a_record_without_frames_is_none(items, record, scene, lens, tmp_path):
    write_video(record(items.landing()), tmp_path / "out.mp4", scene.landmark, lens)
    assert not (tmp_path / "out.mp4").exists()


def test_video_that_cannot_be_written_is_an_error_that_names_it(items, record, scene, lens, view, tmp_path, capfd):
    path = record([items.frame(1.0, 0, view)])
    with pytest.raises(RecorderError, match=r"nowhere/out\.mp4: the video can't be written"):
        write_video(path, tmp_path / "nowhere" / "out.mp4", scene.landmark, lens)
    capfd.readouterr()  # the codec's own words


def test_video_of_a_record_that_is_missing_is_an_error(scene, lens, tmp_path):
    with pytest.raises(RecorderError, match=r"none\.mcap: can't be read"):
        write_video(tmp_path / "none.mcap", tmp_path / "out.mp4", scene.landmark, lens)


def test_record_read_without_images_has_all_else(items, record, view):
    path = record([items.frame(1.0, 0, view), items.fix(1.0, 0.0, 0.0, 1.0)])
    assert [r.kind for r in read_record(path)] == ["Frame", "PadFix"]
    assert [r.kind for r in read_record(path, images=False)] == ["PadFix"]


def test_middle_of_a_descent_is_the_frame_at_which_a_landing_came_through_1_5_m(items, record):
    heights = {1.0: 1.5, 3.0: 2.2, 3.1: 1.9, 3.2: 1.55, 3.3: 1.2}  # the first of them before the landing began
    small = np.zeros((48, 64), np.uint8)
    path = record(
        [
            items.report(2.0, Phase.LAND, "land: track steady"),
            *(items.fix(t, 0.0, 0.0, height) for t, height in heights.items()),
            *(items.frame(t, k, small) for k, t in enumerate(heights)),
        ]
    )
    frame = middle_of_descent(path, collect_flight(read_record(path)))
    assert (frame.t_capture_s, frame.sequence) == (3.2, 3)


def test_flight_without_a_landing_has_no_middle_of_a_descent(items, record):
    path = record([items.fix(1.0, 0.0, 0.0, 1.5), items.frame(1.0, 0, np.zeros((48, 64), np.uint8))])
    assert middle_of_descent(path, collect_flight(read_record(path))) is None


def test_binary_image_of_a_frame_is_black_and_white_as_the_landmark_is(scene, lens, view):
    binary = binary_of(Frame(0.0, 0, view), scene.landmark, lens, VisionConfig())
    assert set(np.unique(binary)) == {0, 255}
    # Dark and bright parts of the outermost ring fall on opposite sides of the threshold.
    half = scene.landmark.size_m / 2
    ring = 215.0 * np.arctan(0.97 * half)  # equidistant: pixels from the centre, 1 m up
    quiet = 215.0 * np.arctan(1.04 * half)
    assert binary[round(239.5 - ring), 319] != binary[round(239.5 - quiet), 319]


def test_plane_of_a_recorded_detection_is_read_back(items, record, scene):
    rng = np.random.default_rng(0)
    plane = PlaneFit(rng.normal(size=(3, 3)), np.diag(rng.uniform(1.0, 2.0, 8)), 0.19, 0.07)
    _, seen = items.detection(1.0, 3, scene.corners_px(scene.view(1.0), 0, scene.fisheye))
    path = record([("detections", replace(seen, plane=plane)), items.detection(1.1, 4)])
    with_plane, without = (detection_of(fields) for _, _, _, fields in read_record(path))
    np.testing.assert_allclose(with_plane.plane.rays_from_pad, plane.rays_from_pad)
    np.testing.assert_allclose(with_plane.plane.information, plane.information)
    assert (with_plane.plane.unit_m, with_plane.plane.residual_px) == (0.19, 0.07)
    assert without.plane is None
