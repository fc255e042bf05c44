"""What is said of calibrations that are good, one-sided, flat, noisy or few."""

from dataclasses import replace

import numpy as np
import pytest

from app.calibration.judgement import Verdict, at_least, at_most, judge_lens, overall, tilts_deg
from app.calibration.lens import calibrate_lens


def judge(views, model):
    found = calibrate_lens(views, model)
    counts = found.grid.counts(np.concatenate([v.px for v in found.used]))
    lit = np.ones(counts.shape, dtype=bool)
    checks = judge_lens(found, counts >= 2, lit, len(views))
    return {check.name: check for check in checks}, overall(checks)


def full_views(bench, camera, count=24):
    """Views that also go where a random wave seldom does: the corners of the image."""
    rng = np.random.default_rng(11)
    views = list(bench.wave(camera, count))
    width, height = bench.size
    while len(views) < count + 20:
        near, far, widest = (0.5, 0.8, 0.75) if camera.model == "pinhole" else (0.2, 0.35, 1.6)
        pose = bench.hold(
            rng.uniform(0, 6.3),
            rng.uniform(0.5, 1.0) * widest,
            rng.uniform(near, far),
            tuple(rng.uniform(-0.5, 0.5, 3)),
        )
        if ((bench.board.corners_m @ pose[0].T + pose[1])[:, 2] < 0.05).any() and camera.model == "pinhole":
            continue
        view = bench.view_of(camera, pose, f"edge {len(views)}", rng.normal(0, 0.1, (54, 2)))
        inside = ((view.px > 2) & (view.px < np.array([width, height]) - 3)).all(axis=1)
        if inside.sum() >= 20:  # as a board of markers is seen, in part
            views.append(replace(view, index=view.index[inside], corners_m=view.corners_m[inside], px=view.px[inside]))
    return views


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_views_all_over_the_image_near_far_and_tilted_are_good(bench, lens):
    camera = getattr(bench, lens)
    checks, verdict = judge(full_views(bench, camera), camera.model)
    assert verdict is Verdict.GOOD, [c for c in checks.values() if c.verdict]
    assert not any(check.advice for check in checks.values())


def test_views_on_one_side_are_not_good_and_name_the_empty_edge(bench):
    left = bench.wave(bench.fisheye, 12, inside=lambda px: float(px[:, 0].max()) < 330)
    checks, verdict = judge(left, "equidistant")
    assert verdict is Verdict.NOT_GOOD
    assert checks["right edge"].verdict is Verdict.NOT_GOOD
    assert checks["right edge"].advice == "fill the right edge of the image"
    assert checks["coverage"].verdict is Verdict.NOT_GOOD


def test_board_that_was_never_tilted_through_a_pinhole_is_not_good(bench):
    rng = np.random.default_rng(4)
    views = []
    for k in range(12):
        rotation, _ = bench.hold(0.0, 0.0, 0.5, (rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), 0.0))
        t = np.array([rng.uniform(-0.3, 0.05), rng.uniform(-0.22, 0.05), rng.uniform(0.45, 0.8)])
        views.append(bench.view_of(bench.straight, (rotation, t), f"flat {k}", rng.normal(0, 0.1, (54, 2))))
    checks, verdict = judge(views, "pinhole")
    assert verdict is Verdict.NOT_GOOD
    assert checks["tilt up and down"].verdict is Verdict.NOT_GOOD
    assert checks["tilt up and down"].advice.startswith("tilt the board more, its upper side")


def test_tilts_are_those_that_the_board_was_held_at(bench):
    tilts = np.radians([[20.0, 0.0], [-20.0, 0.0], [0.0, 30.0], [0.0, -30.0], [0.0, 0.0], [10.0, 10.0], [-15.0, 5.0]])
    views = [
        bench.view_of(bench.straight, bench.hold(0.0, 0.0, 0.4 + 0.05 * k, (a, b, 0.0)), f"{k}", 0.0)
        for k, (a, b) in enumerate(tilts)
    ]
    found = calibrate_lens(views, "pinhole")
    # About x, the board's lower side goes away and its normal up; about y, its right side comes near.
    expected = np.degrees(np.column_stack([tilts[:5, 1], -tilts[:5, 0]]))
    np.testing.assert_allclose(tilts_deg(found)[:5], expected, atol=0.2)


@pytest.mark.parametrize(("noise", "verdict"), [(0.1, Verdict.GOOD), (0.45, Verdict.USABLE), (0.8, Verdict.NOT_GOOD)])
def test_error_is_judged_by_its_limits(bench, noise, verdict):
    # A distance has both coordinates' noise: 0.14, 0.64 and 1.13 px against 0.35 and 0.8.
    checks, _ = judge(bench.wave(bench.fisheye, 12, noise=noise), "equidistant")
    assert checks["error (rms)"].verdict is verdict


def test_few_views_are_not_good(bench):
    checks, verdict = judge(bench.wave(bench.fisheye, 8), "equidistant")
    assert checks["views"].verdict is Verdict.NOT_GOOD
    assert verdict is Verdict.NOT_GOOD


def test_stretched_image_is_named(bench):
    squeezed = replace(bench.fisheye, fx=215.0, fy=215.0 * 0.9)
    checks, _ = judge(bench.wave(squeezed, 12), "equidistant")
    assert checks["fx against fy"].verdict is Verdict.NOT_GOOD
    assert "aspect ratio" in checks["fx against fy"].advice


def test_fisheye_taken_for_a_pinhole_is_not_good(bench):
    mild = bench.wave(bench.fisheye, 15, inside=lambda px: float(np.hypot(*(px - [324, 236]).T).max()) < 260)
    checks, verdict = judge(mild, "pinhole")
    assert verdict is Verdict.NOT_GOOD
    assert checks["held-out error over it"].verdict is Verdict.NOT_GOOD


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(15.0, Verdict.GOOD), (14.9, Verdict.USABLE), (10.0, Verdict.USABLE), (9.9, Verdict.NOT_GOOD)],
)
def test_limits_belong_to_the_better_side(value, verdict):
    assert at_least("n", value, (15.0, 10.0), "{:.1f}", "more").verdict is verdict
    assert at_most("n", -value, (-15.0, -10.0), "{:.1f}", "less").verdict is verdict
