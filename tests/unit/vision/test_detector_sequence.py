"""The detector in a sequence: the landmark is followed, lost, found again, and not followed into what isn't it."""

import numpy as np
import pytest

from app.config import VisionConfig
from app.messages import Frame
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector
from app.vision.threshold import Search


def frame(image, sequence=0):
    return Frame(t_capture_s=sequence / 30, sequence=sequence, image=image, name="drawn")


def detector(scene, lens, **config):
    return Detector(scene.landmark, lens_from_config(lens.config), VisionConfig(**config))


def corner_errors_px(scene, detection, view, lens):
    return np.concatenate(
        [np.linalg.norm(c.corners_px - scene.corners_px(view, c.index, lens), axis=1) for c in detection.contours]
    )


def approach(scene, count, gain=lambda k: 1.0):
    for k in range(count):
        view = scene.view(2.0 - 0.02 * k, forward_m=0.3 - 0.02 * k, right_m=0.01 * k, pad_yaw_deg=2 * k, roll_deg=3)
        yield view, frame(scene.draw(view, gain=gain(k), seed=k), k)


def test_landmark_is_followed_from_its_second_frame_on(scene):
    seeing = detector(scene, scene.fisheye)
    how = []
    for _, one in approach(scene, 6):
        assert seeing.detect(one).detected
        how.append(seeing.attempt.how)
    assert how == ["threshold"] + ["followed"] * 5


@pytest.mark.parametrize(("lens_name", "height_m"), [("fisheye", 0.6), ("fisheye", 3.0), ("pinhole", 2.0)])
@pytest.mark.parametrize("px_per_frame", [3.0, 10.0])
def test_landmark_is_followed_through_motion(scene, lens_name, height_m, px_per_frame):
    lens, seeing, far = getattr(scene, lens_name), detector(scene, getattr(scene, lens_name)), []
    step_m = px_per_frame * height_m / lens.f
    for k in range(10):
        view = scene.view(
            height_m, forward_m=0.8 * step_m * k, right_m=0.6 * step_m * (k - 5), pad_yaw_deg=20 + 0.5 * k
        )
        found = seeing.detect(frame(scene.draw(view, lens=lens, seed=k), k))
        assert found.detected, found.reason
        far.append(corner_errors_px(scene, found, view, lens).max())
    assert seeing.attempt.how == "followed"
    assert max(far) < 0.2


def test_landmark_that_changes_its_way_at_once_is_followed_or_found(scene):
    seeing = detector(scene, scene.fisheye)
    found = []
    for k in range(12):
        away = min(k, 6) - max(0, k - 6)
        found.append(seeing.detect(frame(scene.draw(scene.view(1.5, forward_m=0.05 * away), seed=k), k)).detected)
    assert found == [True] * 12


def test_sequence_is_as_exact_as_a_still(scene):
    seeing = detector(scene, scene.fisheye)
    errors = [
        corner_errors_px(scene, seeing.detect(one), view, scene.fisheye).max() for view, one in approach(scene, 6)
    ]
    assert max(errors) < 0.3


@pytest.mark.parametrize(("before", "after"), [(1.0, 1 / 3), (1 / 3, 1.0), (1.0, 0.5), (1.0, 1.15)])
@pytest.mark.parametrize("height_m", [0.8, 3.0])
def test_step_of_brightness_does_not_end_the_track(scene, height_m, before, after):
    seeing = detector(scene, scene.fisheye)
    found = []
    for k in range(6):
        image = scene.draw(scene.view(height_m, right_m=0.01 * k), gain=before if k < 3 else after, seed=k)
        found.append(seeing.detect(frame(image, k)).detected)
    assert found == [True] * 6


def test_slow_dusk_is_followed_by_the_threshold(scene):
    seeing = detector(scene, scene.fisheye)
    found = [seeing.detect(one) for _, one in approach(scene, 12, lambda k: 0.85**k)]
    assert [d.detected for d in found] == [True] * 12
    assert found[-1].threshold < 0.5 * found[1].threshold


def test_landmark_out_of_sight_leads_through_the_levels_of_search(scene):
    levels = {"sweep_from": 60, "sweep_to": 120, "sweep_step": 60, "wide_from": 20, "wide_to": 220, "wide_step": 100}
    limits = {"misses_before_sweep": 1, "sweeps_before_wide": 1, "wide_sweeps_before_lost": 1}
    seeing = detector(scene, scene.fisheye, **limits, **levels)
    _, first = next(approach(scene, 1))
    lawn = scene.draw(scene.view(2.0), polygons=[])
    seeing.detect(first)
    searches, regions = [], []
    for k in range(1, 9):
        regions.append(seeing.detect(frame(lawn, k)).roi_px)
        searches.append(seeing.threshold.search)
    # One miss is borne; then two levels, then three, then afresh.
    assert searches == [Search.TRACK] + [Search.SWEEP] * 2 + [Search.WIDE] * 3 + [Search.FRESH] * 2
    # First it is sought where it was, and in the end in the whole frame.
    assert regions[0] is not None
    assert regions[-1] is None


def test_track_ends_where_the_landmark_is_gone(scene):
    seeing = detector(scene, scene.fisheye)
    led = [seeing.detect(one).detected for _, one in approach(scene, 3)]
    lawn = scene.draw(scene.view(2.0), polygons=[])
    after = [seeing.detect(frame(lawn, 3 + k)).detected for k in range(7)]
    assert led == [True] * 3
    assert after == [False] * 7
    assert seeing.track is None


def test_landmark_that_was_lost_is_found_again_where_it_was(scene):
    seeing = detector(scene, scene.fisheye)
    pad, lawn = scene.draw(scene.view(2.0, forward_m=0.4)), scene.draw(scene.view(2.0), polygons=[])
    found = [seeing.detect(frame(image, k)).detected for k, image in enumerate([pad, pad, lawn, lawn, lawn, pad])]
    assert found == [True, True, False, False, False, True]


@pytest.mark.parametrize(
    "decoy", [{"upside_down": (2,)}, {"upside_down": (2, 3)}, {"without": (2, 3, 4)}, {"without": (3, 4)}], ids=str
)
@pytest.mark.parametrize("height_m", [0.6, 1.2, 2.5])
def test_decoy_in_the_landmarks_place_ends_the_track(scene, changed, height_m, decoy):
    seeing = detector(scene, scene.fisheye)
    view = scene.view(height_m, pad_yaw_deg=30, right_m=0.1)
    pad, other = scene.draw(view), scene.draw(view, polygons=changed(**decoy))
    found = [seeing.detect(frame(image, k)).detected for k, image in enumerate([pad] * 2 + [other] * 3)]
    assert found == [True] * 2 + [False] * 3


def test_landmark_that_comes_back_far_away_is_found_again(scene):
    seeing = detector(scene, scene.fisheye)
    near = scene.draw(scene.view(2.0, forward_m=1.0, right_m=1.0))
    away = scene.draw(scene.view(2.0, forward_m=-1.2, right_m=-1.5))
    assert seeing.detect(frame(near)).detected
    found = [seeing.detect(frame(away, k)).detected for k in range(1, 12)]
    assert any(found)


@pytest.mark.parametrize("height_m", [0.8, 2.0])
def test_predicted_position_leads_there(scene, height_m):
    seeing = detector(scene, scene.fisheye)
    far = 0.5 * height_m
    seeing.detect(frame(scene.draw(scene.view(height_m, forward_m=far, right_m=far))))
    # By a turn of the camera of 8 degrees: 30 pixels.
    view = scene.view(height_m, forward_m=far, right_m=far, roll_deg=8)
    middle = scene.corners_px(view, 0, scene.fisheye).mean(axis=0)
    found = seeing.detect(frame(scene.draw(view), 1), predicted_px=(float(middle[0]), float(middle[1])))
    assert found.detected, found.reason
    assert seeing.attempt.how == "followed"
    assert corner_errors_px(scene, found, view, scene.fisheye).max() < 0.3


def test_wrong_prediction_does_not_lose_it(scene):
    seeing = detector(scene, scene.fisheye)
    image = scene.draw(scene.view(1.0, forward_m=0.3))
    found = [seeing.detect(frame(image, k), predicted_px=(600.0, 30.0)).detected for k in range(3)]
    assert found == [True] * 3


def test_reset_forgets_the_sequence(scene):
    seeing = detector(scene, scene.fisheye)
    (_, first), (_, second) = approach(scene, 2)
    seeing.detect(first)
    seeing.reset()
    assert seeing.track is None
    assert seeing.detect(second).detected
    assert seeing.attempt.how == "threshold"


def test_still_leaves_the_sequence_as_it_was(scene):
    seeing = detector(scene, scene.fisheye)
    (_, first), (_, second) = approach(scene, 2)
    seeing.detect(first)
    track = seeing.track
    seeing.detect(frame(scene.draw(scene.view(2.0), polygons=[])), still=True)
    assert seeing.track is track
    assert seeing.detect(second).detected
    assert seeing.attempt.how == "followed"


def off_middle(scene, view, image):
    """How far each pixel is from the middle of the landmark, in its outer sides."""
    corners = scene.corners_px(view, 0, scene.fisheye)
    v, u = np.indices(image.shape)
    off = np.hypot(u - corners[:, 0].mean(), v - corners[:, 1].mean())
    return off / np.linalg.norm(corners[1] - corners[0])


def glaring(scene, view, image, radius):
    """The image with a mirrored sun over the middle of the landmark: light that falls off as a Gaussian does, and
    saturates what is black within so many outer sides.
    """
    return np.clip(image + 255.0 * np.exp(2.0 - 2.0 * (off_middle(scene, view, image) / radius) ** 2), 0, 255).astype(
        np.uint8
    )


def papered(scene, view, image, radius):
    """The image with a saturated disc over the middle of the landmark, so many outer sides in radius: white paper."""
    return np.where(off_middle(scene, view, image) < radius, 255, image).astype(np.uint8)


def hidden_from_the_fourth(scene, height_m, hide, count):
    """What a detector makes of frames of a moving pad whose inside is hidden from the fourth on."""
    seeing, found = detector(scene, scene.fisheye), []
    for k in range(count):
        view = scene.view(height_m, forward_m=0.1, right_m=0.002 * k, pad_yaw_deg=20)
        image = scene.draw(view, seed=k)
        found.append(seeing.detect(frame(image if k < 3 else hide(scene, view, image, 0.33), k)))
    return found


@pytest.mark.parametrize("height_m", [0.8, 1.6])
def test_glare_over_the_inside_does_not_end_a_track_for_a_second(scene, height_m):
    found = hidden_from_the_fourth(scene, height_m, glaring, 40)
    assert [d.detected for d in found[:33]] == [True] * 33
    assert found[20].code == "44"
    # After a second of glare nothing vouches for the heading any more.
    assert not any(d.detected for d in found[34:])


@pytest.mark.parametrize("height_m", [0.8, 1.6])
def test_white_paper_over_the_inside_ends_a_track(scene, height_m):
    """It looks like a glare, but that would light up the black round it too."""
    found = hidden_from_the_fourth(scene, height_m, papered, 10)
    assert [d.detected for d in found] == [True] * 3 + [False] * 7


@pytest.mark.parametrize("gain", [1.8, 2.6])
def test_overexposed_blank_in_the_place_of_the_inside_ends_a_track(scene, changed, gain):
    """All white is saturated and blur makes the ring's rims brighter, as a glare would, but on all sides alike."""
    seeing, found = detector(scene, scene.fisheye), []
    for k in range(8):
        view = scene.view(1.8, forward_m=0.1, right_m=0.002 * k, pad_yaw_deg=20)
        blank = {"polygons": changed(without=(2, 3, 4)), "gain": gain} if k > 2 else {}
        found.append(seeing.detect(frame(scene.draw(view, seed=k, blur_px=1.3, **blank), k)))
    assert [d.detected for d in found] == [True] * 3 + [False] * 5


@pytest.mark.parametrize("height_m", [2.2, 2.5])
def test_blank_that_shines_in_the_place_of_a_small_landmarks_inside_ends_its_track(scene, changed, height_m):
    """33 and 37 px: with its lines blurred away, little tells a landmark under a glare from a blank under one."""
    seeing, found = detector(scene, scene.fisheye), []
    for k in range(8):
        view = scene.view(height_m, forward_m=0.1, right_m=0.002 * k, pad_yaw_deg=20)
        image = scene.draw(view, seed=k, blur_px=1.1, **({"polygons": changed(without=(2, 3, 4))} if k > 2 else {}))
        found.append(seeing.detect(frame(image if k < 3 else glaring(scene, view, image, 0.4), k)))
    assert [d.detected for d in found] == [True] * 3 + [False] * 5


def test_glare_over_the_inside_of_what_was_not_seen_before_is_refused(scene):
    view = scene.view(0.8, forward_m=0.1, pad_yaw_deg=20)
    seeing = detector(scene, scene.fisheye)
    assert not seeing.detect(frame(glaring(scene, view, scene.draw(view), 0.33))).detected


def test_side_shorter_than_the_limit_ends_a_track(scene):
    seeing = detector(scene, scene.fisheye, min_side_px=40)
    near, far = scene.draw(scene.view(2.0)), scene.draw(scene.view(2.1))
    # 215 * 0.38 / 2.0 = 40.9 px, and 38.9.
    assert seeing.detect(frame(near)).detected
    assert not seeing.detect(frame(far, 1)).detected
