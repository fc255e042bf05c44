"""The deck's lean: followed and predicted on waves that are written down here."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.estimation.deck import GAP_MAX_S, start
from app.messages import PadTrack

AMPLITUDE_RAD, OMEGA_RAD_S = math.radians(8.0), 2.0 * math.pi / 7.0


def lean(t_s: float) -> np.ndarray:
    return AMPLITUDE_RAD * np.array([math.sin(OMEGA_RAD_S * t_s), 0.5 * math.cos(OMEGA_RAD_S * t_s)])


def test_deck_is_followed_and_predicted_half_a_second_ahead_within_two_degrees():
    rng, sigma = np.random.default_rng(5), math.radians(1.5)
    deck = start(lean(0.0), sigma, 0.0)
    now, ahead = [], []
    for k in range(1, 900):
        t_s = k / 30.0
        deck = deck.update(lean(t_s) + rng.normal(0.0, sigma, 2), sigma, t_s)
        now.append(deck.mean[0] - lean(t_s))
        ahead.append(deck.at(t_s + 0.5).mean[0] - lean(t_s + 0.5))
    settled = slice(90, None)
    assert math.degrees(np.sqrt(np.mean(np.square(now[settled])))) < 0.6
    assert math.degrees(np.sqrt(np.mean(np.square(ahead[settled])))) < 2.0


def test_deck_that_was_not_seen_for_long_begins_anew():
    deck = start(lean(0.0), 0.02, 0.0).update(np.array([0.1, 0.0]), 0.02, 2.0 * GAP_MAX_S)
    assert deck.mean.tolist() == [[0.1, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("ahead_s", "lean_deg"),
    [(0.0, 5.0 - 0.5), (1.0, math.hypot(3.0 + 1.0, 4.0) - 0.5), (-3.0, 4.0 - 0.5)],
)
def test_track_tells_the_lean_ahead_less_what_it_is_unsure_by(ahead_s, lean_deg):
    track = PadTrack(
        t_capture_s=10.0,
        pos_ned_m=np.zeros(3),
        vel_ned_m_s=np.zeros(3),
        covariance=np.eye(6),
        yaw_ned_rad=0.0,
        yaw_rate_rad_s=0.0,
        t_last_fix_s=10.0,
        fixes_accepted=9,
        lean_ne_rad=(math.radians(3.0), math.radians(4.0)),
        lean_rate_ne_rad_s=(math.radians(1.0), 0.0),
        lean_sigma_rad=math.radians(0.5),
    )
    assert math.degrees(track.lean_rad(ahead_s)) == pytest.approx(lean_deg)
    assert math.degrees(track.at(10.0 + ahead_s).lean_rad(0.0)) == pytest.approx(lean_deg)


@pytest.mark.parametrize("unknown", ["lean_ne_rad", "lean_rate_ne_rad_s"])
@pytest.mark.parametrize("part", [0, 1])
def test_track_whose_lean_is_not_a_number_is_as_far_from_level_as_can_be(unknown, part):
    lean = tuple(math.nan if k == part else 0.0 for k in range(2))
    track = PadTrack(10.0, np.zeros(3), np.zeros(3), np.eye(6), 0.0, 0.0, 10.0, 9, **{unknown: lean})
    assert track.lean_rad(0.5) == math.inf


@pytest.mark.parametrize(("ahead_s", "sigma_rad"), [(math.nan, 0.0), (0.5, math.nan), (0.5, math.inf)])
def test_track_whose_lean_cannot_be_told_ahead_is_not_level(ahead_s, sigma_rad):
    track = PadTrack(10.0, np.zeros(3), np.zeros(3), np.eye(6), 0.0, 0.0, 10.0, 9, lean_sigma_rad=sigma_rad)
    assert track.lean_rad(ahead_s) == math.inf
