from functools import reduce

import pytest

from app.config import VisionConfig
from app.vision.threshold import Search, ThresholdState, after_miss, after_success, ladder, threshold_now

CONFIG = VisionConfig(
    otsu_band=40,
    misses_before_sweep=2,
    sweep_from=60,
    sweep_to=180,
    sweep_step=60,
    sweeps_before_wide=2,
    wide_from=20,
    wide_to=220,
    wide_step=50,
    wide_sweeps_before_lost=1,
)
TRACK = ThresholdState(Search.TRACK, level=120)


def after_misses(state, count):
    return reduce(lambda s, _: after_miss(s, CONFIG), range(count), state)


def test_fresh_threshold_is_otsu_of_the_whole_frame():
    assert threshold_now(ThresholdState(), CONFIG, 97) == 97


def test_threshold_after_success_is_otsu_of_the_region():
    state = after_success(ThresholdState(), CONFIG, roi_level=120, global_level=100)
    assert (state.search, threshold_now(state, CONFIG, 55)) == (Search.TRACK, 120)


@pytest.mark.parametrize(("roi", "expected"), [(140, 140), (141, 100), (60, 60), (59, 100)])
def test_region_threshold_outside_the_band_gives_way_to_the_global_one(roi, expected):
    state = after_success(ThresholdState(), CONFIG, roi_level=roi, global_level=100)
    assert threshold_now(state, CONFIG, 0) == expected


@pytest.mark.parametrize("misses", [0, 1, 2])
def test_track_keeps_its_threshold_for_the_allowed_misses(misses):
    state = after_misses(TRACK, misses)
    assert (state.search, threshold_now(state, CONFIG, 33)) == (Search.TRACK, 120)


def test_misses_beyond_the_limit_start_a_sweep_in_fixed_steps():
    begin = after_misses(TRACK, 3)
    levels = [threshold_now(after_misses(begin, k), CONFIG, 33) for k in range(3)]
    assert begin.search is Search.SWEEP
    assert levels == [60, 120, 180]


def test_fruitless_sweeps_go_over_to_the_wide_range():
    begin = after_misses(TRACK, 3 + 2 * 3)
    levels = [threshold_now(after_misses(begin, k), CONFIG, 33) for k in range(5)]
    assert begin.search is Search.WIDE
    assert levels == [20, 70, 120, 170, 220]


def test_fruitless_wide_sweep_is_completely_lost_and_starts_afresh():
    state = after_misses(TRACK, 3 + 2 * 3 + 5)
    assert (state.search, state.times_lost) == (Search.FRESH, 1)
    assert threshold_now(state, CONFIG, 33) == 33


@pytest.mark.parametrize("misses", [1, 4, 8, 11])
def test_success_at_any_level_of_search_returns_to_track(misses):
    state = after_success(after_misses(TRACK, misses), CONFIG, 90, 100)
    assert (state.search, state.level, state.misses, state.sweeps) == (Search.TRACK, 90, 0, 0)


@pytest.mark.parametrize(
    ("first", "last", "step", "levels"),
    [(70, 190, 30, (70, 100, 130, 160, 190)), (20, 50, 20, (20, 40, 50)), (90, 30, 30, (90, 60, 30)), (5, 5, 9, (5,))],
)
def test_ladder_runs_from_end_to_end(first, last, step, levels):
    assert ladder(first, last, step) == levels
