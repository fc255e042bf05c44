"""What PX4's own precision landing is told, and when it counts as committed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.config import GuidanceConfig, SafetyConfig
from app.guidance.precland import PrecisionLanding
from app.messages import Goal, GoalKind, LandedState, PadTrack, VehicleState

GOAL = Goal(GoalKind.PRECLAND, 2.5, number=4)


def vehicle(height_m: float, north_m: float = 0.0, t_s: float = 100.0, **changes: Any) -> VehicleState:
    return VehicleState(
        t_s, np.array([5.0 + north_m, -1.0, -height_m]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), **changes
    )


def track(t_s: float = 100.0, **changes: Any) -> PadTrack:
    """A pad at (5, -1, 0), heading 0.4 rad."""
    figures: dict[str, Any] = {"pos_ned_m": np.array([5.0, -1.0, 0.0]), "vel_ned_m_s": np.zeros(3), **changes}
    return PadTrack(
        t_s, covariance=np.eye(6) * 1e-4, yaw_ned_rad=0.4, yaw_rate_rad_s=0.0, t_last_fix_s=t_s, fixes_accepted=50,
        **figures,
    )  # fmt: skip


@pytest.fixture
def landing() -> PrecisionLanding:
    return PrecisionLanding(GuidanceConfig(commit_height_m=0.45), SafetyConfig(track_stale_s=0.5))


def test_target_is_the_pad_as_it_is_now(landing: PrecisionLanding):
    target, status = landing.step(GOAL, track(99.9, vel_ned_m_s=np.array([0.2, 0.0, 0.0])), vehicle(2.0), 100.0)
    assert target is not None
    np.testing.assert_allclose(target.pos_ned_m, [5.02, -1.0, 0.0])
    assert (target.t_s, target.yaw_ned_rad) == pytest.approx((100.0, 0.4))
    assert status.goal_number == 4
    assert status.height_above_pad_m == pytest.approx(2.0)
    assert status.horizontal_error_m == pytest.approx(0.02)
    assert not status.committed


@pytest.mark.parametrize("age_s", [0.4, 0.6])
def test_target_of_a_stale_track_is_not_told_above_the_commit(landing: PrecisionLanding, age_s: float):
    target, status = landing.step(GOAL, track(100.0 - age_s), vehicle(2.0), 100.0)
    assert (target is not None) is (age_s < 0.5)
    assert (status.horizontal_error_m is not None) is (age_s < 0.5)


def test_target_that_is_no_number_is_not_told(landing: PrecisionLanding):
    bad = track(pos_ned_m=np.array([np.nan, 0.0, 0.0]))
    assert landing.step(GOAL, bad, vehicle(2.0), 100.0)[0] is None


@pytest.mark.parametrize(
    ("height_m", "north_m", "committed"),
    [(0.46, 0.0, False), (0.44, 0.39, True), (0.44, 0.41, False), (0.1, 0.0, True)],
)
def test_landing_is_committed_low_over_the_pad(
    landing: PrecisionLanding, height_m: float, north_m: float, committed: bool
):
    assert landing.step(GOAL, track(), vehicle(height_m, north_m), 100.0)[1].committed is committed


def test_committed_landing_goes_on_with_the_pad_out_of_sight(landing: PrecisionLanding):
    landing.step(GOAL, track(), vehicle(0.3), 100.0)
    target, status = landing.step(GOAL, track(), vehicle(0.1, t_s=103.0), 103.0)
    assert target is not None
    np.testing.assert_allclose(target.pos_ned_m, [5.0, -1.0, 0.0])
    assert status.committed


def test_pad_out_of_sight_stays_where_it_was_whatever_speed_the_track_believes(landing: PrecisionLanding):
    drifting = track(vel_ned_m_s=np.array([0.0, 0.1, 0.2]))
    landing.step(GOAL, drifting, vehicle(0.3), 100.0)
    target, status = landing.step(GOAL, drifting, vehicle(0.1, t_s=110.0), 110.0)
    assert target is not None
    # Half a second is what a track may be old: 5 and 10 cm, not the metres of ten seconds.
    np.testing.assert_allclose(target.pos_ned_m, [5.0, -0.95, 0.1], atol=1e-9)
    assert status.committed


def test_commit_outlasts_a_height_that_drifts_once_px4_says_that_it_has_landed(landing: PrecisionLanding):
    landing.step(GOAL, track(), vehicle(0.3), 100.0)
    _, status = landing.step(GOAL, track(), vehicle(1.5, t_s=104.0, landed=LandedState.ON_GROUND), 104.0)
    assert status.committed


@pytest.mark.parametrize("again", [GOAL, Goal(GoalKind.PRECLAND, 2.5, number=5)], ids=["climbed", "new goal"])
def test_commit_ends_with_a_climb_or_another_goal(landing: PrecisionLanding, again: Goal):
    landing.step(GOAL, track(), vehicle(0.3), 100.0)
    height_m = 1.0 if again is GOAL else 0.6
    _, status = landing.step(again, track(102.0), vehicle(height_m, t_s=102.0), 102.0)
    assert not status.committed


def test_contact_is_px4s_own_word_in_a_committed_landing(landing: PrecisionLanding):
    landing.step(GOAL, track(), vehicle(0.3), 100.0)
    landing.step(GOAL, track(), vehicle(0.1, t_s=101.0, landed=LandedState.ON_GROUND), 101.0)
    _, status = landing.step(GOAL, track(), vehicle(0.1, t_s=102.5, landed=LandedState.ON_GROUND), 102.5)
    assert status.contact
    assert status.contact_held_s == pytest.approx(1.5)


def test_jump_of_px4s_frame_takes_the_target_along(landing: PrecisionLanding):
    landing.step(GOAL, track(), vehicle(0.3), 100.0)
    jumped = vehicle(0.3, north_m=2.0, t_s=100.02, frame_resets=1)
    target, _ = landing.step(GOAL, track(), jumped, 100.02)
    assert target is not None
    np.testing.assert_allclose(target.pos_ned_m, [7.0, -1.0, 0.0], atol=1e-9)
