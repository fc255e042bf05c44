"""What the benchmark counts as right, what it keeps between runs, and whether its peers' corners are in order."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from detectors import ENTRIES, Answer, planar_pose
from judge import judge, summary
from optics import lens
from report import claim_table
from scenes import attitude, translation_at, truth
from sets import draw
from store import Case, load

needs_apriltag = pytest.mark.skipif(
    importlib.util.find_spec("pupil_apriltags") is None, reason="pupil-apriltags is not here: make bench installs it"
)


@pytest.fixture
def case() -> Case:
    """A frame that is never rendered: 1.5 m over the pad, a little aside."""
    drawn = draw("heights-B", 13)
    return Case("heights-B", 13, drawn.kind, drawn.scene, drawn.truth, lens("B"), False)


def turned(case: Case, degrees: float) -> Answer:
    """The true pose, turned about the pad's normal."""
    turn = cv2.Rodrigues(np.array([0.0, 0.0, math.radians(degrees)]))[0]
    return Answer(case.truth.corners_px, case.truth.rotation @ turn, case.truth.translation, 1.0, 0.5)


def test_true_answer_is_right_without_error(case):
    verdict = judge(case, turned(case, 0.0))
    assert verdict.outcome == "right"
    assert (verdict.corner_px, verdict.distance, verdict.yaw_deg) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_answer_five_degrees_off_is_right_and_its_error_known(case):
    verdict = judge(case, turned(case, 5.0))
    assert verdict.outcome == "right"
    assert verdict.yaw_deg == pytest.approx(5.0)


def test_answer_a_quarter_turn_off_is_wrong(case):
    assert judge(case, turned(case, 90.0)).outcome == "wrong"


def test_answer_without_pose_is_judged_by_its_corners(case):
    corners = case.truth.corners_px
    assert judge(case, Answer(corners, None, None, 1.0, 0.0)).outcome == "right"
    assert judge(case, Answer(np.roll(corners, 1, axis=0), None, None, 1.0, 0.0)).outcome == "wrong"


def test_answer_three_percent_too_far_has_that_error(case):
    truth_ = case.truth
    verdict = judge(case, Answer(truth_.corners_px, truth_.rotation, truth_.translation * 1.03, 1.0, 0.5))
    assert verdict.distance == pytest.approx(0.03)


def test_error_of_a_claimed_deviation_in_each_direction_has_a_square_of_one(case):
    sigma = np.array([0.01, 0.02, 0.03, 0.1, 0.1, 0.1])
    turn = cv2.Rodrigues(np.full(3, 0.1))[0]
    place = case.truth.translation + sigma[:3]
    answer = Answer(case.truth.corners_px, turn @ case.truth.rotation, place, 1.0, 0.5, np.diag(sigma**2))
    verdict = judge(case, answer)
    assert (verdict.place_square, verdict.pose_square) == pytest.approx((1.0, 1.0))
    doubled = judge(case, replace(answer, translation=place + sigma[:3]))
    assert (doubled.place_square, doubled.pose_square) == pytest.approx((4.0, 2.5))


def test_answer_that_claims_nothing_has_no_square(case):
    assert math.isnan(judge(case, turned(case, 0.0)).pose_square)


def test_table_of_claims_counts_what_is_in_the_band(case):
    right = judge(case, turned(case, 0.0))
    squares = [replace(right, place_square=p, pose_square=p, side_px=s) for p, s in ((0.5, 20), (2.2, 20), (3.0, 300))]
    rows = claim_table({"cone": {"alight": squares}}, "alight").splitlines()
    cells = {row.split("|")[1].strip(): [c.strip() for c in row.split("|")[2:-1]] for row in rows[2:]}
    # 95% of chi squared: 2.605 a degree for three, 2.099 for six.
    assert cells["stills"] == ["3", "67", "1.90", "2.20", "33", "2.20"]
    assert cells["0..25 px side"][:2] == ["2", "100"]
    assert cells["over 200 px side"][:2] == ["1", "0"]
    assert "sequences" not in cells


def test_nothing_seen_is_missed_and_counts_in_the_rate(case):
    seen, missed = judge(case, turned(case, 0.0)), judge(case, Answer(None, None, None, 1.0, 0.0))
    assert missed.outcome == "missed"
    assert summary([seen, missed, missed, missed])["rate"] == pytest.approx(25.0)


@pytest.mark.parametrize("name", ["A", "B"])
def test_planar_pose_of_true_corners_is_the_true_pose(name):
    rotation = attitude(0.2, 1.0, 2.0)
    translation = translation_at(name, rotation, np.array([250.0, 300.0]), 0.8)
    pose = planar_pose(truth(name, rotation, translation).corners_px, lens(name))
    assert pose is not None
    assert pose[0] == pytest.approx(rotation, abs=1e-6)
    assert pose[1] == pytest.approx(translation, abs=1e-6)


@pytest.fixture
def easy(tmp_path, monkeypatch) -> Case:
    """A large, clear marker, rendered into a folder of the test."""
    monkeypatch.setenv("ALIGHT_BENCH_CACHE", str(tmp_path))
    rotation = attitude(0.1, 1.0, 2.0)
    translation = translation_at("B", rotation, np.array([300.0, 250.0]), 1.2)
    # Plainly lit on plain ground.
    scene = draw("heights-B", 13).scene
    scene = replace(scene, rotation=rotation, translation=translation, shake=(0.0, 0.0, 0.0), motion_px=(0.0, 0.0))
    light = replace(scene.light, sun=0.0, shadows=(), glares=())
    scene = replace(
        scene, light=light, noise=1.0, exposure=1.0, meter=0.0, ground="asphalt", litter_count=0, blur_px=0.5
    )
    return Case("easy", 0, "easy", scene, truth("B", rotation, translation), lens("B"), False)


@pytest.mark.parametrize("name", ["alight", "aruco4", "aruco6"])
def test_detector_finds_an_easy_marker_with_its_corners_in_order(easy, name):
    entry = ENTRIES[name]
    verdict = judge(easy, entry.make(easy.optics, True).look(easy.frame(entry.marker), 0.0, 0))
    assert verdict.outcome == "right"
    assert verdict.corner_px < 2.0


@needs_apriltag
@pytest.mark.parametrize("name", ["apriltag1", "apriltag2"])
def test_apriltag_finds_an_easy_marker_with_its_corners_in_order(easy, name):
    entry = ENTRIES[name]
    verdict = judge(easy, entry.make(easy.optics, True).look(easy.frame(entry.marker), 0.0, 0))
    assert verdict.outcome == "right"
    assert verdict.corner_px < 1.0


def test_frame_is_rendered_once_and_then_read(easy, tmp_path):
    first = easy.image
    easy.forget()
    (path,) = tmp_path.rglob("*-alight.png")
    assert np.array_equal(easy.image, first)
    assert cv2.imwrite(str(path), 255 - first)
    easy.forget()
    assert np.array_equal(easy.image, 255 - first)


def test_loaded_cases_are_those_of_the_set_whatever_their_count():
    few, many = list(load("hard-A", 2)), list(load("hard-A", 12, kinds=("glare",)))
    assert [c.index for c in few] == [0, 1]
    assert [c.index for c in many] == [1, 11]
    assert few[1].scene.seed == many[0].scene.seed
