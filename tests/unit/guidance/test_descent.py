"""The cone, its hysteresis, the commit and the sink speed, by numbers worked by hand from the paper's cone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.config import GuidanceConfig
from app.guidance.descent import (
    Descent,
    cone_radius_m,
    feel_deck,
    predicted_error_m,
    sink_speed_m_s,
    step_descent,
    touchdown_in_s,
)

CONFIG = GuidanceConfig(
    cone_height_m=3.0,
    cone_radius_m=3.0,
    touchdown_radius_m=0.1,
    commit_height_m=0.5,
    commit_speed_m_s=0.4,
    descend_speed_m_s=0.8,
    touchdown_speed_m_s=0.6,
)


@pytest.mark.parametrize(
    ("height_m", "radius_m"),
    [
        (10.0, 3.0),  # above it, as wide as at its top
        (3.0, 3.0),  # the paper: 3 m high, 6 m across
        (1.75, 1.55),  # half way between 0.5 and 3 m: between 0.1 and 3 m
        (1.0, 0.68),  # a fifth of the way: 0.1 + 0.2 * 2.9
        (0.5, 0.1),
        (0.0, 0.1),
        (-1.0, 0.1),
    ],
)
def test_cone_radius_by_hand(height_m, radius_m):
    assert cone_radius_m(height_m, CONFIG) == pytest.approx(radius_m)


@pytest.mark.parametrize(
    ("error_m", "from_outside", "from_inside"), [(1.2, True, True), (1.4, False, True), (1.6, False, False)]
)
def test_cone_is_entered_at_four_fifths_and_left_at_the_whole(error_m, from_outside, from_inside):
    assert step_descent(Descent(False), error_m, 1.75, 0.0, CONFIG, 0.0).in_cone is from_outside
    assert step_descent(Descent(True), error_m, 1.75, 0.0, CONFIG, 0.0).in_cone is from_inside


WAITED = Descent(in_cone=True, waiting_since_s=0.0)
"""At 100 s it has waited at the commit height for long."""


@pytest.mark.parametrize(
    ("error_m", "height_m", "speed_m_s", "committed"),
    [
        (0.05, 0.49, 0.1, True),
        (0.05, 0.51, 0.1, False),
        (0.11, 0.49, 0.1, False),
        (0.05, 0.49, 0.41, False),
        (0.05, -3.0, 0.1, True),
    ],
)
def test_commit_needs_height_place_and_speed_at_once(error_m, height_m, speed_m_s, committed):
    assert step_descent(WAITED, error_m, height_m, speed_m_s, CONFIG, 100.0).committed is committed


@pytest.mark.parametrize(
    ("waited_s", "error_m", "committed"),
    # The touchdown circle is 0.1 m; of that six tenths at first, all of it after three seconds.
    [(0.0, 0.059, True), (0.0, 0.061, False), (1.5, 0.079, True), (1.5, 0.081, False), (3.0, 0.099, True)],
)
def test_commit_waits_for_a_calm_moment_but_not_for_long(waited_s, error_m, committed):
    arrived = step_descent(Descent(in_cone=True), 0.099, 0.49, 0.0, CONFIG, 50.0)
    assert not arrived.committed
    assert step_descent(arrived, error_m, 0.49, 0.0, CONFIG, 50.0 + waited_s).committed is committed


def test_wait_for_a_calm_moment_goes_on_over_a_bounce_out_of_the_cone():
    arrived = step_descent(Descent(in_cone=True), 0.099, 0.49, 0.0, CONFIG, 50.0)
    outside = step_descent(arrived, 0.3, 0.49, 0.0, CONFIG, 51.0)
    assert not outside.in_cone
    back = step_descent(outside, 0.05, 0.49, 0.0, CONFIG, 53.0)
    assert step_descent(back, 0.099, 0.49, 0.0, CONFIG, 53.0).committed


COMMITTED = Descent(in_cone=True, committed=True)


@pytest.mark.parametrize(
    ("predicted_m", "committed"),
    [(0.09, True), (0.11, False)],  # the touchdown circle is 0.1 m
)
def test_commit_needs_the_predicted_place_too(predicted_m, committed):
    assert step_descent(WAITED, 0.05, 0.49, 0.1, CONFIG, 100.0, predicted_m).committed is committed


@pytest.mark.parametrize(
    ("error_ne_m", "relative_ne_m_s", "predicted_m"),
    [((0.0, 0.0), (0.0, 0.0), 0.0), ((0.03, 0.0), (0.2, 0.0), 0.10), ((0.07, 0.0), (-0.2, 0.0), 0.0)],
)
def test_predicted_error_adds_what_the_relative_velocity_does_in_a_third_of_a_second(
    error_ne_m, relative_ne_m_s, predicted_m
):
    assert predicted_error_m(np.array(error_ne_m), np.array(relative_ne_m_s)) == pytest.approx(predicted_m)


@pytest.mark.parametrize(("lean_deg", "committed"), [(3.9, True), (4.1, False)])
def test_commit_waits_for_a_calm_deck(lean_deg, committed):
    assert step_descent(WAITED, 0.0, 0.49, 0.0, CONFIG, 100.0, 0.0, math.radians(lean_deg)).committed is committed


@pytest.mark.parametrize(
    ("clear_m", "sink_m_s", "seconds"),
    [
        pytest.param(0.36, 0.6, 0.6, id="sinking already"),
        pytest.param(0.36, 0.0, 1.0, id="at rest: 0.4 s until it sinks"),
        pytest.param(0.36, 0.3, 0.8, id="half way there"),
        pytest.param(0.36, -0.5, 1.0, id="the deck falls away"),
        pytest.param(0.36, 1.5, 0.6, id="the deck comes up: the command slows it"),
        pytest.param(-0.1, 0.6, 0.0, id="on it"),
    ],
)
def test_touchdown_is_expected_after_the_way_down_and_the_lag(clear_m, sink_m_s, seconds):
    assert touchdown_in_s(clear_m, sink_m_s, 0.6) == pytest.approx(seconds)


@pytest.mark.parametrize("height_m", [0.28, 0.1, -1.0])
def test_commit_near_the_deck_outlasts_everything(height_m):
    assert step_descent(COMMITTED, 99.0, height_m, 99.0, CONFIG, 100.0, 99.0, 1.0).committed


@pytest.mark.parametrize(
    ("was_m", "unseen_s", "kept"),
    [
        pytest.param(0.2, 0.4, True, id="low and not seen since: a wrong velocity, not a climb"),
        pytest.param(0.2, 0.1, False, id="low, and seen to be high again"),
        pytest.param(0.4, 0.4, False, id="never low"),
    ],
)
def test_commit_that_was_low_is_taken_back_by_what_is_seen_alone(was_m, unseen_s, kept):
    before = step_descent(COMMITTED, 0.0, was_m, 0.0, CONFIG, 100.0)
    assert before.committed
    assert step_descent(before, 1.0, 0.35, 3.7, CONFIG, 100.02, 1.0, unseen_s=unseen_s).committed is kept


@pytest.mark.parametrize(
    ("speed_m_s", "predicted_m", "lean_deg", "kept"),
    [
        pytest.param(0.5, 0.14, 5.9, True, id="within one and a half times each limit"),
        pytest.param(0.61, 0.14, 5.9, False, id="fast"),
        pytest.param(0.5, 0.16, 5.9, False, id="off"),
        pytest.param(0.5, 0.14, 6.1, False, id="leaning"),
    ],
)
def test_commit_that_would_miss_is_taken_back_while_it_is_high_enough(speed_m_s, predicted_m, lean_deg, kept):
    found = step_descent(COMMITTED, 0.05, 0.29, speed_m_s, CONFIG, 100.0, predicted_m, math.radians(lean_deg))
    assert found.committed is kept


@pytest.mark.parametrize(
    ("height_m", "contact", "kept"),
    [
        pytest.param(0.44, True, True, id="felt the deck"),
        pytest.param(0.46, True, False, id="held up by a gust"),
        pytest.param(0.44, False, False, id="felt nothing"),
    ],
)
def test_commit_that_felt_the_deck_outlasts_the_wrong_figures_that_come_of_it(height_m, contact, kept):
    felt = feel_deck(COMMITTED, height_m, contact=contact)
    later = feel_deck(felt, 0.6, contact=False)
    assert step_descent(later, 1.0, 0.6, 2.0, CONFIG, 100.0, 1.0, 0.2).committed is kept


def test_contact_before_the_commit_is_not_the_deck():
    assert feel_deck(Descent(in_cone=True), 0.1, contact=True) == Descent(in_cone=True)


def test_sink_once_committed_is_the_touchdown_speed_all_the_way():
    held = COMMITTED
    assert sink_speed_m_s(held, 0.05, CONFIG) == sink_speed_m_s(held, 9.0, CONFIG) == 0.6


@pytest.mark.parametrize("height_m", [0.2, 0.5, 1.0, 3.0, 50.0])
def test_sink_outside_the_cone_is_nothing(height_m):
    assert sink_speed_m_s(Descent(in_cone=False), height_m, CONFIG) == 0.0


def test_sink_high_in_the_cone_is_the_descent_speed():
    assert sink_speed_m_s(Descent(in_cone=True), 3.0, CONFIG) == 0.8


@pytest.mark.parametrize("height_m", [0.45, 0.3, 0.0])
def test_sink_below_the_commit_height_without_a_commit_climbs_back(height_m):
    assert -0.5 <= sink_speed_m_s(Descent(in_cone=True), height_m, CONFIG) < 0.0


@given(st.floats(0.5, 20.0), st.floats(0.5, 20.0))
def test_sink_in_the_cone_falls_towards_the_commit_height(a, b):
    low, high = sorted((a, b))
    inside = Descent(in_cone=True)
    slow, fast = sink_speed_m_s(inside, low, CONFIG), sink_speed_m_s(inside, high, CONFIG)
    assert slow <= fast <= 0.8


@given(st.floats(0.0, 20.0), st.floats(0.0, 20.0))
def test_cone_never_widens_downward(a, b):
    low, high = sorted((a, b))
    assert cone_radius_m(low, CONFIG) <= cone_radius_m(high, CONFIG) <= 3.0


FIGURES = {"error_m": 0.02, "height_m": 0.4, "relative_speed_m_s": 0.1, "predicted_m": 0.02, "lean_rad": 0.0}


def stepped(memory: Descent, **changes: float) -> Descent:
    figures = {**FIGURES, **changes}
    speed_m_s, lean_rad = figures["relative_speed_m_s"], figures["lean_rad"]
    return step_descent(
        memory, figures["error_m"], figures["height_m"], speed_m_s, CONFIG, 9.0, figures["predicted_m"], lean_rad
    )


def test_commit_is_made_where_every_figure_is_known_and_small():
    assert stepped(Descent(in_cone=True)).committed


@pytest.mark.parametrize("unknown", list(FIGURES))
def test_commit_is_not_made_while_a_figure_is_not_a_number(unknown):
    assert not stepped(Descent(in_cone=True), **{unknown: math.nan}).committed


@pytest.mark.parametrize("unknown", ["relative_speed_m_s", "predicted_m", "lean_rad"])
def test_commit_is_taken_back_above_the_deck_once_a_figure_is_not_a_number(unknown):
    assert not stepped(Descent(in_cone=True, committed=True), **{unknown: math.nan}).committed


def test_commit_whose_height_is_not_a_number_is_kept_and_nothing_climbs():
    assert stepped(Descent(in_cone=True, committed=True), height_m=math.nan, predicted_m=math.nan).committed


@pytest.mark.parametrize("in_cone", [True, False])
def test_height_that_is_not_a_number_is_outside_the_cone_and_sinks_nothing(in_cone):
    memory = Descent(in_cone=in_cone)
    assert not stepped(memory, height_m=math.nan).in_cone
    assert sink_speed_m_s(memory, math.nan, CONFIG) == 0.0


@pytest.mark.parametrize(("clear_m", "sink_m_s"), [(math.nan, 0.5), (0.3, math.nan)])
def test_touchdown_that_cannot_be_told_is_not_now(clear_m, sink_m_s):
    assert math.isnan(touchdown_in_s(clear_m, sink_m_s, 0.6))
