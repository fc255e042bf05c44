"""The height table by similar triangles: L = f s / H, whatever the frames' disturbances."""

import math

import numpy as np
import pytest

from app.calibration.board import NoView
from app.calibration.heights import make_table
from app.calibration.heights_judgement import judge_heights
from app.calibration.judgement import Verdict, overall
from app.calibration.sample import Sample, measure
from app.config import LensConfig
from app.errors import CalibrationError
from app.landmark import ContourSpec, Shape, build_landmark, paper_landmark
from app.messages import CameraPose, Detection, SeenContour
from app.vision.camera_model import lens_from_config

FOCAL_PX = 400.0
SIDE_M = math.sqrt(4 / math.sqrt(3) / 8) * 0.38
"""Of an equilateral triangle with an eighth of the area of a square of 38 cm."""
HEIGHTS = (0.4, 0.6, 1.0, 1.6, 2.4, 3.2)
LENS = lens_from_config(
    LensConfig(model="pinhole", width_px=640, height_px=480, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=319.5, cy_px=239.5)
)


def law(height_m):
    return FOCAL_PX * SIDE_M / height_m


def frames(heights=HEIGHTS, *, count=6, groups=((2.0, 1.0), (100.0, 1.0)), noise=0.002, seed=0):
    """Samples at each height: groups of (distance in px, factor on the length)."""
    rng = np.random.default_rng(seed)
    return [
        Sample(
            f"{height}-{distance:.0f}-{k}",
            height,
            law(height) * factor * (1 + noise * rng.standard_normal()),
            distance + rng.uniform(-2, 2),
        )
        for height in heights
        for distance, factor in groups
        for k in range(count)
    ]


def table(samples, **options):
    return make_table(samples, [], paper_landmark(), LENS, **options)


def check(found, name):
    return next(c for c in judge_heights(found) if c.name == name)


def test_table_holds_the_lengths_of_similar_triangles_in_both_groups():
    found = table(frames(groups=((2.0, 1.0), (100.0, 0.97))))
    assert [row.height_m for row in found.rows] == list(HEIGHTS)
    for row in found.rows:
        assert row.centred_px == pytest.approx(law(row.height_m), rel=0.003)
        assert row.offset_px == pytest.approx(0.97 * law(row.height_m), rel=0.003)
        assert row.frames == (6, 6)
    assert found.offset_distance_px == pytest.approx(100.0, abs=1.0)
    assert (found.side_m, found.focal_px) == (pytest.approx(SIDE_M), FOCAL_PX)


def test_table_from_a_good_record_is_good():
    found = table(frames())
    assert overall(judge_heights(found)) is Verdict.GOOD
    assert found.law_focal_px == pytest.approx(FOCAL_PX, rel=0.005)
    assert found.law_zero_m == pytest.approx(0.0, abs=0.005)


def test_outlier_in_a_row_is_left_out_and_named():
    samples = frames()
    samples[3] = Sample("bad.png", samples[3].height_m, samples[3].side_px * 1.3, samples[3].distance_px)
    found = table(samples)
    assert found.rows[0].centred_px == pytest.approx(law(0.4), rel=0.003)
    assert found.rows[0].frames == (5, 6)
    (refused,) = found.refused
    assert refused.name == "bad.png"
    assert "sigma from" in refused.reason


def test_height_that_was_measured_wrong_is_named():
    right = frames()
    wrong = [s if s.height_m != 1.6 else Sample(s.name, 1.8, s.side_px, s.distance_px) for s in right]
    found = check(table(wrong), "off the 1/H law")
    assert found.verdict is Verdict.NOT_GOOD  # 1.8 / 1.6 is 12.5% off
    assert found.advice == "measure the height of 1.8 m again"


def test_heights_measured_from_the_wrong_zero_are_named_with_the_way_and_amount():
    # Measured from the ground, while the landmark lies on a box 6 cm high.
    from_ground = [Sample(s.name, s.height_m + 0.06, s.side_px, s.distance_px) for s in frames()]
    found = table(from_ground)
    assert found.law_zero_m == pytest.approx(-0.06, abs=0.006)
    zero = check(found, "zero of the heights")
    assert zero.verdict is Verdict.NOT_GOOD
    assert zero.advice.endswith("cm too large")


def test_landmark_printed_too_small_shows_against_the_lens():
    small = [Sample(s.name, s.height_m, s.side_px * 0.9, s.distance_px) for s in frames()]
    found = check(table(small), "focal length against the lens file's")
    assert (found.figure, found.verdict) == ("10.0%", Verdict.NOT_GOOD)


def test_lengths_that_rise_with_height_are_not_good_and_name_the_pair():
    samples = frames()
    swapped = [
        Sample(s.name, {1.0: 1.05, 1.6: 1.0}.get(s.height_m, s.height_m), s.side_px, s.distance_px) for s in samples
    ]
    found = check(table(swapped), "falls with height")
    assert found.verdict is Verdict.NOT_GOOD
    assert "at 1 m" in found.figure
    assert "at 1.05 m" in found.figure


def test_groups_that_differ_much_are_named():
    found = check(table(frames(groups=((2.0, 1.0), (100.0, 0.8)))), "offset against centred")
    assert found.verdict is Verdict.NOT_GOOD


@pytest.mark.parametrize(("count", "verdict"), [(6, Verdict.GOOD), (3, Verdict.USABLE), (2, Verdict.NOT_GOOD)])
def test_number_of_heights_is_judged(count, verdict):
    assert check(table(frames(HEIGHTS[:count])), "heights").verdict is verdict


def test_frame_between_the_groups_is_refused_with_its_distance():
    samples = [*frames(), Sample("between.png", 1.0, law(1.0), 60.0)]
    assert [r.name for r in table(samples).refused] == ["between.png"]
    assert "60 px from the middle: in neither group" in table(samples).refused[0].reason


def test_height_without_an_offset_frame_gets_no_row():
    samples = [s for s in frames() if not (s.height_m == 2.4 and s.distance_px > 50)]
    found = table(samples)
    assert 2.4 not in [row.height_m for row in found.rows]
    assert NoView("height 2.4 m", "has no offset frame") in found.refused


def test_one_group_alone_is_refused_unless_told():
    centred = frames(groups=((2.0, 1.0),))
    with pytest.raises(CalibrationError, match=r"do not fall into two groups.*--centred-only"):
        table(centred)
    found = table(centred, centred_only=True)
    assert all(row.offset_px == row.centred_px for row in found.rows)
    assert found.offset_distance_px == FOCAL_PX
    assert overall(judge_heights(found)) is Verdict.GOOD


def test_distances_that_change_with_height_are_refused_and_never_count_as_centred():
    # The pad was moved 10 cm aside at every height: 100 px at 0.4 m, 12 px at 3.2 m.
    aside = [Sample(f"{h} aside", h, 0.9 * law(h), FOCAL_PX * 0.1 / h) for h in HEIGHTS]
    with pytest.raises(CalibrationError, match="in the middle and at one and the same distance from it"):
        table([*frames((0.4, 3.2), groups=((2.0, 1.0),)), *(s for s in aside if s.height_m in (0.4, 3.2))])
    found = table([*frames(groups=((2.0, 1.0),)), *aside])
    assert all(row.centred_px == pytest.approx(law(row.height_m), rel=0.003) for row in found.rows)


@pytest.mark.parametrize("samples", [[], frames((1.0,))])
def test_nothing_or_one_height_makes_no_table(samples):
    with pytest.raises(CalibrationError):
        table(samples)


def test_pad_without_a_triangle_makes_no_table():
    squares = build_landmark("squares", 0.4, (ContourSpec(Shape.SQUARE, 1.0), ContourSpec(Shape.SQUARE, 0.5)))
    with pytest.raises(CalibrationError, match="'squares' has no triangle"):
        make_table(frames(), [], squares, LENS)


# ------------------------------------------------------------------------------------------------------------ one frame
def seen(height_m, right_m=0.0):
    """T3 as the camera sees it from straight above: image up is forward."""
    corners = paper_landmark().contours[2].corners_m
    px = np.column_stack(
        [319.5 + FOCAL_PX * (corners[:, 1] + right_m) / height_m, 239.5 - FOCAL_PX * corners[:, 0] / height_m]
    )
    return Detection(0.0, 0, contours=(SeenContour(2, px),), code="33")


def tilted(degrees, sigma_deg=0.1):
    half = math.radians(degrees) / 2
    covariance = np.diag([1e-6] * 3 + [math.radians(sigma_deg) ** 2] * 3)
    return CameraPose(np.array([0.0, 0.0, 1.0]), np.array([math.cos(half), math.sin(half), 0.0, 0.0]), covariance, 0.1)


def test_measure_is_the_side_by_similar_triangles_and_the_centroids_distance():
    found = measure("a.png", 2.0, seen(2.0, right_m=0.5), tilted(0.0), paper_landmark(), LENS)
    assert isinstance(found, Sample)
    assert found.side_px == pytest.approx(FOCAL_PX * SIDE_M / 2.0)
    # T3's centroid lies 2.9469 cm behind the pad's centre.
    assert found.distance_px == pytest.approx(FOCAL_PX * math.hypot(0.5, 0.029469) / 2.0, rel=1e-4)


def test_tilted_camera_is_refused_with_its_tilt():
    found = measure("a.png", 2.0, seen(2.0), tilted(8.0), paper_landmark(), LENS)
    assert found.reason.startswith("the camera is tilted by 8.0 deg against the landmark, over 5")


@pytest.mark.parametrize(("degrees", "sigma_deg"), [(4.0, 0.1), (8.0, 3.0)])
def test_tilt_that_is_small_or_not_known_well_is_no_reason(degrees, sigma_deg):
    assert isinstance(measure("a", 2.0, seen(2.0), tilted(degrees, sigma_deg), paper_landmark(), LENS), Sample)


def test_frame_without_landmark_or_triangle_is_refused_in_words():
    missed = Detection(0.0, 0, reason="no dark square")
    assert measure("a", 1.0, missed, None, paper_landmark(), LENS) == NoView("a", "landmark not found: no dark square")
    squares = Detection(0.0, 0, contours=(SeenContour(0, np.zeros((4, 2))),), code="44")
    assert measure("a", 1.0, squares, None, paper_landmark(), LENS) == NoView("a", "the outer triangle was not found")
