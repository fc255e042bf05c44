"""The target estimator against a batch least squares, by hand-computed steps, and for the truth of its covariance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.config import EstimationConfig
from app.estimation.target import TargetEstimator, is_confident, predict
from app.messages import PadFix, PadTrack

CONFIG = EstimationConfig(acceleration_m_s2=1.0, gate_sigma=4.0, rejections_before_restart=8, fixes_before_confident=5)
FRAME_S = 1.0 / 30.0


def fix(t_s: float, pos=(0.0, 0.0, 0.0), sigma_m: float = 0.02, yaw_deg: float = 0.0, **changes: Any) -> PadFix:
    made = PadFix(
        t_capture_s=t_s,
        pad_pos_ned_m=np.array(pos, dtype=np.float64),
        pad_from_vehicle_ned_m=np.array(pos, dtype=np.float64),
        covariance_ned_m2=np.eye(3) * sigma_m**2,
        pad_yaw_ned_rad=math.radians(yaw_deg),
        yaw_sigma_rad=math.radians(1.0),
        code="4433",
    )
    return replace(made, **changes)


def run(estimator: TargetEstimator, fixes: list[PadFix]) -> PadTrack:
    tracks = [estimator.update(one) for one in fixes]
    return tracks[-1]


def driving(seconds: float, *, vel=(3.0, -1.5, 0.0), from_s: float = 100.0) -> list[PadFix]:
    """Exact fixes of a pad at constant velocity."""
    times = np.arange(round(seconds / FRAME_S)) * FRAME_S
    return [fix(from_s + t, tuple(np.array(vel) * t)) for t in times]


def test_track_that_is_not_a_number_accepts_no_fix_and_is_begun_anew():
    """However it came about: a distance that is not a number is not inside the gate."""
    estimator = TargetEstimator(CONFIG)
    begun = run(estimator, driving(1.0))
    estimator._track = replace(begun, pos_ned_m=np.full(3, math.nan))
    tracks = [estimator.update(one) for one in driving(0.4, from_s=101.0)]
    assert [track.fixes_rejected_in_row for track in tracks[:7]] == list(range(1, 8))
    assert np.isfinite(tracks[8].pos_ned_m).all()
    assert np.isfinite(tracks[-1].covariance).all() and tracks[-1].fixes_accepted == 5


# ------------------------------------------------------------------------------------------------------------- by hand
def test_first_fix_starts_the_track_where_it_is_at_rest_and_unsure_of_its_speed():
    track = TargetEstimator(CONFIG).update(fix(100.0, (4.0, 5.0, 0.5), sigma_m=0.1))
    np.testing.assert_array_equal(track.pos_ned_m, [4.0, 5.0, 0.5])
    np.testing.assert_array_equal(track.vel_ned_m_s, 0.0)
    np.testing.assert_allclose(np.diag(track.covariance), [0.01, 0.01, 0.01, 25.0, 25.0, 1.0])
    assert (track.fixes_accepted, track.t_last_fix_s) == (1, 100.0)


def test_second_fix_by_hand():
    """One axis, a second later, sigma 1 m, white acceleration of 1: predicted variance 1 + 25 + 1/3, covariance
    25 + 1/2, velocity 25 + 1; innovation 2 m with variance 26.333 + 1. Gains 26.333 / 27.333 and 25.5 / 27.333.
    """
    estimator = TargetEstimator(CONFIG)
    estimator.update(fix(100.0, sigma_m=1.0))
    track = estimator.update(fix(101.0, (2.0, 0.0, 0.0), sigma_m=1.0))
    p, c, v = 1.0 + 25.0 + 1.0 / 3.0, 25.0 + 0.5, 25.0 + 1.0
    assert track.pos_ned_m[0] == pytest.approx(2.0 * p / (p + 1.0))
    assert track.vel_ned_m_s[0] == pytest.approx(2.0 * c / (p + 1.0))
    assert track.covariance[0, 0] == pytest.approx(p / (p + 1.0))
    assert track.covariance[3, 3] == pytest.approx(v - c * c / (p + 1.0))


def test_prediction_by_hand():
    track = TargetEstimator(CONFIG).update(fix(100.0, (1.0, 2.0, 3.0), sigma_m=0.1))
    ahead = predict(replace(track, vel_ned_m_s=np.array([4.0, -2.0, 0.5])), 100.5, 2.0)
    np.testing.assert_allclose(ahead.pos_ned_m, [3.0, 1.0, 3.25])
    # 0.01 + 25 * 0.5^2 + 2^2 * 0.5^3 / 3; downward a quarter of the density on 1 (m/s)^2
    assert ahead.covariance[0, 0] == pytest.approx(0.01 + 6.25 + 4.0 * 0.125 / 3.0)
    assert ahead.covariance[0, 3] == pytest.approx(25.0 * 0.5 + 4.0 * 0.25 / 2.0)
    assert ahead.covariance[2, 2] == pytest.approx(0.01 + 0.25 + 1.0 * 0.125 / 3.0)
    assert ahead.t_last_fix_s == 100.0


def test_track_carried_on_keeps_its_velocity_and_turns():
    track = TargetEstimator(CONFIG).update(fix(100.0, yaw_deg=170.0))
    later = replace(track, vel_ned_m_s=np.array([1.0, 0.0, 0.0]), yaw_rate_rad_s=math.radians(40.0)).at(100.5)
    np.testing.assert_allclose(later.pos_ned_m, [0.5, 0.0, 0.0])
    assert math.degrees(later.yaw_ned_rad) == pytest.approx(-170.0)


def test_fix_that_is_not_newer_changes_nothing():
    estimator = TargetEstimator(CONFIG)
    before = run(estimator, driving(1.0))
    assert estimator.update(fix(before.t_capture_s, (9.0, 9.0, 9.0))) is before
    assert estimator.update(fix(before.t_capture_s - 0.1, (9.0, 9.0, 9.0))) is before


def test_track_of_a_driving_pad_finds_its_velocity():
    track = run(TargetEstimator(CONFIG), driving(2.0))
    np.testing.assert_allclose(track.vel_ned_m_s, [3.0, -1.5, 0.0], atol=0.01)
    np.testing.assert_allclose(track.at(102.0).pos_ned_m, [6.0, -3.0, 0.0], atol=0.01)


# --------------------------------------------------------------------------------------------------- a second opinion
def batch(fixes: list[PadFix], density: float) -> tuple[np.ndarray, np.ndarray]:
    """All states at once by weighted least squares: prior, transitions and fixes as rows. The last state and its
    covariance must be the filter's.
    """
    n = len(fixes)
    rows, values = [], []

    def add(block: dict[int, np.ndarray], value: np.ndarray, covariance: np.ndarray) -> None:
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        row = np.zeros((len(value), 6 * n))
        for k, part in block.items():
            row[:, 6 * k : 6 * k + 6] = whiten @ part
        rows.append(row)
        values.append(whiten @ value)

    prior = np.zeros((6, 6))
    prior[:3, :3] = fixes[0].covariance_ned_m2
    prior[3:, 3:] = np.diag([25.0, 25.0, 1.0])
    add({0: np.eye(6)}, np.concatenate([fixes[0].pad_pos_ned_m, np.zeros(3)]), prior)
    for k in range(1, n):
        dt = fixes[k].t_capture_s - fixes[k - 1].t_capture_s
        f = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
        q = np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), density**2 * np.diag([1.0, 1.0, 0.25]))
        add({k - 1: -f, k: np.eye(6)}, np.zeros(6), q)
        add({k: np.eye(3, 6)}, fixes[k].pad_pos_ned_m, fixes[k].covariance_ned_m2)
    a, b = np.vstack(rows), np.concatenate(values)
    covariance = np.linalg.inv(a.T @ a)
    return np.linalg.lstsq(a, b, rcond=None)[0][-6:], covariance[-6:, -6:]


@pytest.mark.parametrize("seed", range(4))
def test_track_is_the_batch_least_squares_solution(seed):
    rng = np.random.default_rng(seed)
    t_s, fixes = 100.0, []
    for _ in range(25):
        t_s += float(rng.uniform(0.02, 0.3))
        root = rng.normal(0.0, 0.05, (3, 3))
        covariance = root @ root.T + np.eye(3) * 1e-3
        place = np.array([2.0, -1.0, 0.1]) * (t_s - 100.0) + rng.multivariate_normal(np.zeros(3), covariance)
        fixes.append(fix(t_s, tuple(place), covariance_ned_m2=covariance))
    track = run(TargetEstimator(CONFIG.model_copy(update={"gate_sigma": 20.0})), fixes)
    state, covariance = batch(fixes, CONFIG.acceleration_m_s2)
    assert track.fixes_accepted == 25
    np.testing.assert_allclose(np.concatenate([track.pos_ned_m, track.vel_ned_m_s]), state, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(track.covariance, covariance, rtol=1e-5, atol=1e-9)


# ------------------------------------------------------------------------------------------- does it know what it knows
def chi2_band(dof: int) -> tuple[float, float]:
    """The middle 95% of a chi-squared variable (Wilson and Hilferty, 1931)."""
    a = 2.0 / (9.0 * dof)
    return tuple(dof * (1.0 - a + z * math.sqrt(a)) ** 3 for z in (-1.95996, 1.95996))  # type: ignore[return-value]  # a pair


@pytest.mark.parametrize(("density", "sigma_m", "rate_hz"), [(1.0, 0.02, 30.0), (3.0, 0.1, 10.0), (0.3, 0.3, 30.0)])
def test_covariance_is_true_over_many_drives(density, sigma_m, rate_hz):
    """Normalised estimation error squared of 60 pads that drive as the model says: 360 degrees of freedom."""
    config = CONFIG.model_copy(update={"acceleration_m_s2": density})
    dt, trials, total = 1.0 / rate_hz, 60, 0.0
    rng = np.random.default_rng(11)
    q = np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), density**2 * np.diag([1.0, 1.0, 0.25]))
    f = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    root = np.linalg.cholesky(q)
    for _ in range(trials):
        truth = np.concatenate([rng.normal(0.0, 10.0, 3), rng.normal(0.0, [5.0, 5.0, 1.0])])
        estimator = TargetEstimator(config)
        for k in range(45):
            seen = truth[:3] + rng.normal(0.0, sigma_m, 3)
            track = estimator.update(fix(100.0 + k * dt, tuple(seen), sigma_m=sigma_m))
            last = truth
            truth = f @ truth + root @ rng.standard_normal(6)
        error = np.concatenate([track.pos_ned_m, track.vel_ned_m_s]) - last
        total += float(error @ np.linalg.solve(track.covariance, error))
    low, high = chi2_band(6 * trials)
    assert low <= total <= high


def test_covariance_stays_symmetric_and_positive_over_a_long_flight():
    rng = np.random.default_rng(2)
    estimator = TargetEstimator(CONFIG)
    for k in range(1200):
        track = estimator.update(fix(100.0 + k * FRAME_S, tuple(rng.normal(0.0, 1e-3, 3)), sigma_m=1e-3))
    np.testing.assert_allclose(track.covariance, track.covariance.T, atol=1e-15)
    assert np.linalg.eigvalsh(track.covariance).min() > 0.0


def test_covariance_after_ten_minutes_without_the_pad_still_works():
    estimator = TargetEstimator(CONFIG)
    run(estimator, driving(2.0))
    track = run(estimator, driving(2.0, from_s=702.0))
    np.testing.assert_allclose(track.vel_ned_m_s, [3.0, -1.5, 0.0], atol=0.02)
    assert np.linalg.eigvalsh(track.covariance).min() > 0.0


# --------------------------------------------------------------------------------------------------- outliers, restart
def test_outlier_is_counted_and_left_out():
    estimator = TargetEstimator(CONFIG)
    before = run(estimator, driving(2.0))
    after = estimator.update(fix(102.0, (7.0, -3.0, 0.0)))
    assert (after.fixes_rejected_in_row, after.fixes_accepted, after.t_last_fix_s) == (1, 60, before.t_last_fix_s)
    np.testing.assert_array_equal(after.pos_ned_m, before.pos_ned_m)


@pytest.mark.parametrize(("sigmas", "accepted"), [(3.8, True), (4.2, False)])
def test_gate_lies_at_four_sigma_of_the_innovation(sigmas, accepted):
    estimator = TargetEstimator(CONFIG)
    before = run(estimator, [fix(100.0 + k * FRAME_S) for k in range(90)])
    t_s = before.t_capture_s + FRAME_S
    variance = predict(before, t_s, CONFIG.acceleration_m_s2).covariance[1, 1] + 0.02**2
    after = estimator.update(fix(t_s, (0.0, sigmas * math.sqrt(variance), 0.0)))
    assert (after.fixes_rejected_in_row == 0) is accepted


def test_outlier_between_good_fixes_is_forgotten():
    estimator = TargetEstimator(CONFIG)
    fixes = driving(3.0)
    spoilt = [fix(f.t_capture_s, (99.0, 0.0, 0.0)) if k % 5 == 4 and k > 30 else f for k, f in enumerate(fixes)]
    track = run(estimator, [*spoilt, fix(103.0, (9.0, -4.5, 0.0))])
    np.testing.assert_allclose(track.pos_ned_m, [9.0, -4.5, 0.0], atol=0.02)
    assert track.fixes_rejected_in_row == 0


@pytest.mark.parametrize(("outliers", "restarted"), [(7, False), (8, True)])
def test_enough_outliers_in_a_row_start_a_new_track(outliers, restarted):
    estimator = TargetEstimator(CONFIG)
    run(estimator, driving(2.0))
    track = run(estimator, [fix(102.0 + k * FRAME_S, (50.0, 50.0, 0.0)) for k in range(outliers)])
    assert (track.fixes_accepted == 1) is restarted
    assert not is_confident(track, CONFIG) if restarted else is_confident(track, CONFIG)


def test_reset_forgets_the_track():
    estimator = TargetEstimator(CONFIG)
    run(estimator, driving(1.0))
    estimator.reset()
    assert estimator.track is None
    assert estimator.update(fix(101.0, (50.0, 0.0, 0.0))).fixes_accepted == 1


def test_confidence_takes_enough_fixes_and_a_known_speed():
    estimator = TargetEstimator(CONFIG)
    told = [is_confident(estimator.update(one), CONFIG) for one in driving(1.0)]
    assert told[:4] == [False] * 4 and all(told[10:])
    coarse = TargetEstimator(CONFIG)
    assert not is_confident(run(coarse, [fix(100.0 + k * FRAME_S, sigma_m=1.0) for k in range(6)]), CONFIG)


# ------------------------------------------------------------------------------------------------------------- heading
def test_heading_turns_through_south_without_a_jump():
    """A pad that turns at 10 degrees a second from 170 to -170 degrees."""
    estimator = TargetEstimator(CONFIG)
    off = []
    for k in range(61):
        truth_deg = 170.0 + 10.0 * k * FRAME_S
        track = estimator.update(fix(100.0 + k * FRAME_S, yaw_deg=math.remainder(truth_deg, 360.0)))
        off.append(abs(math.remainder(track.yaw_ned_rad - math.radians(truth_deg), math.tau)))
    assert max(off) < math.radians(1.5)
    assert math.degrees(track.yaw_rate_rad_s) == pytest.approx(10.0, abs=2.0)
    assert -math.pi <= track.yaw_ned_rad < math.pi


@pytest.mark.parametrize("wrong_deg", [90.0, 180.0, -90.0])
def test_heading_off_by_a_quarter_turn_is_left_out_and_the_place_is_taken(wrong_deg):
    estimator = TargetEstimator(CONFIG)
    fixes = driving(2.0)
    run(estimator, fixes)
    track = estimator.update(fix(102.0, (6.0, -3.0, 0.0), yaw_deg=wrong_deg))
    assert abs(track.yaw_ned_rad) < math.radians(1.0)
    assert track.t_last_fix_s == 102.0


@pytest.mark.parametrize("rate_hz", [30.0, 10.0, 4.0])
@pytest.mark.parametrize("wrong_deg", [90.0, 180.0, -90.0])
def test_heading_that_began_wrong_is_mended_after_eight_fixes_without_a_spin(wrong_deg, rate_hz):
    estimator = TargetEstimator(CONFIG)
    estimator.update(fix(100.0, yaw_deg=wrong_deg))
    tracks = [estimator.update(fix(100.0 + k / rate_hz)) for k in range(1, 60)]
    assert max(abs(track.yaw_ned_rad) for track in tracks[8:]) < math.radians(1.0)
    assert max(abs(track.yaw_rate_rad_s) for track in tracks) < math.radians(5.0)


# ---------------------------------------------------------------------------------- PX4's velocity against its position
def test_velocity_carries_the_error_of_px4s_velocity():
    """PX4 believes in 0.1 m/s north while the vehicle, and its position, stand still over a pad at rest. A command of
    0.1 m/s is what keeps it there, so that is the velocity that the track must have.
    """
    estimator = TargetEstimator(CONFIG)
    for k in range(120):
        travelled = np.array([0.1 * k * FRAME_S, 0.0, 0.0])
        track = estimator.update(fix(100.0 + k * FRAME_S, (2.0, 0.0, 2.5), travelled_ned_m=travelled))
    np.testing.assert_allclose(track.vel_ned_m_s, [0.1, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(track.pos_ned_m, [2.0, 0.0, 2.5], atol=0.01)


# ------------------------------------------------------------------------------------------------------ time and turn
def mistimed(offset_s: float, seconds: float, pad_vel, noise_m: float = 0.005) -> list[PadFix]:
    """Fixes of a pad that drives straight on, from frames exposed so much later than they say; the vehicle sways by
    0.6 m along each axis at 0.5 Hz, level, in a frame in which PX4 is never wrong. PX4's attitude makes a fix less sure
    than its noise.
    """
    noise, w = np.random.default_rng(5), 2.0 * math.pi * 0.5
    phases = np.array([0.0, 1.0, 2.0])

    def vehicle(t: float) -> tuple[np.ndarray, np.ndarray]:
        sway = 0.6 * np.sin(w * t + phases)
        return (np.array(pad_vel) * t + sway + (0.0, 0.0, -1.0), np.array(pad_vel) + 0.6 * w * np.cos(w * t + phases))

    fixes = []
    for t in np.arange(round(seconds / FRAME_S)) * FRAME_S:
        at, vel = vehicle(t)
        seen = np.array(pad_vel) * (t + offset_s) - vehicle(t + offset_s)[0] + noise_m * noise.standard_normal(3)
        told = fix(100.0 + t, tuple(at + seen), sigma_m=0.02, pad_from_vehicle_ned_m=seen)
        fixes.append(replace(told, travelled_ned_m=at, shift_ned_m_s=vel))
    return fixes


@pytest.mark.parametrize("offset_s", [0.04, -0.03, 0.0])
@pytest.mark.parametrize("pad_vel", [(0.0, 0.0, 0.0), (3.5, -1.5, 0.0), (-12.0, 7.0, 0.0)])
def test_frames_that_are_exposed_later_than_they_say_show_by_how_much(offset_s, pad_vel):
    estimator = TargetEstimator(CONFIG)
    tracks = [estimator.update(one) for one in mistimed(offset_s, 20.0, pad_vel)]
    last = tracks[-1]
    assert last.delay_s == pytest.approx(offset_s, abs=0.004 + 0.3 * abs(offset_s))
    assert abs(last.delay_s - offset_s) < 2.5 * last.delay_sigma_s < 0.025
    # What is left of the offset moves a driving pad along its way, and the vehicle with it.
    within_m = 0.02 + 0.002 * float(np.linalg.norm(pad_vel))
    np.testing.assert_allclose(last.pos_ned_m, np.array(pad_vel) * (last.t_capture_s - 100.0), atol=within_m)


def test_known_offset_leaves_the_pads_velocity_calm():
    """A driving pad's velocity and the offset enter a fix as a product: taken apart wrongly they shake each other."""
    estimator = TargetEstimator(CONFIG)
    tracks = [estimator.update(one) for one in mistimed(0.04, 30.0, (3.5, -1.5, 0.0))]
    off = [np.abs(t.vel_ned_m_s - (3.5, -1.5, 0.0)).max() for t in tracks[150:]]
    assert max(off) < 0.25
    assert tracks[-1].fixes_accepted == len(tracks)


@pytest.mark.parametrize("speed_m_s", [0.0, 1.0, 3.75, 14.0])
@pytest.mark.parametrize("told_sigma_m", [0.005, 0.03])
def test_no_offset_is_learnt_where_nothing_moves_or_the_vehicle_follows_the_pad(speed_m_s, told_sigma_m):
    """A minute of it, on a bench or over a car: noise is no sign of an offset, and its error stays what it was."""
    estimator, noise = TargetEstimator(CONFIG), np.random.default_rng(3)
    velocity = np.array([speed_m_s, 0.0, 0.0])
    for k in range(1800):
        at = velocity * k * FRAME_S
        seen = (0.0, 0.0, 2.5) + 0.005 * noise.standard_normal(3)
        told = fix(100.0 + k * FRAME_S, tuple(at + seen), sigma_m=told_sigma_m, pad_from_vehicle_ned_m=seen)
        last = estimator.update(replace(told, travelled_ned_m=at, shift_ned_m_s=velocity))
    assert abs(last.delay_s) < 0.001
    assert last.delay_sigma_s >= 0.99 * CONFIG.delay_sigma_s
    np.testing.assert_allclose(last.vel_ned_m_s, velocity, atol=0.3)


def followed(seconds: float, path, rate_hz: float = 30.0) -> list[PadFix]:
    """Fixes of a pad on a path (time -> position, velocity), 3 m under a vehicle that follows it exactly."""
    noise, fixes = np.random.default_rng(4), []
    for t in np.arange(round(seconds * rate_hz)) / rate_hz:
        at, vel = (np.array(v) for v in path(t))
        seen = (0.0, 0.0, 3.0) + 0.01 * noise.standard_normal(3)
        told = fix(100.0 + t, tuple(at + seen), sigma_m=0.03, pad_from_vehicle_ned_m=seen)
        heading = math.atan2(vel[1], vel[0])
        fixes.append(replace(told, travelled_ned_m=at, shift_ned_m_s=vel, pad_yaw_ned_rad=heading))
    return fixes


def on_a_circle(t: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """6 m/s, radius 15 m."""
    a = 6.0 / 15.0 * t
    return (15.0 * math.cos(a), 15.0 * math.sin(a), 0.0), (-6.0 * math.sin(a), 6.0 * math.cos(a), 0.0)


def stop_and_go(t: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Between 0 and 6 m/s, by 3 m/s^2: 2 s up, 2 s down."""
    turns, part = divmod(t, 4.0)
    if part < 2.0:
        return (12.0 * turns + 1.5 * part**2, 0.0, 0.0), (3.0 * part, 0.0, 0.0)
    left = 4.0 - part
    return (12.0 * (turns + 1.0) - 1.5 * left**2, 0.0, 0.0), (3.0 * left, 0.0, 0.0)


@pytest.mark.parametrize("path", [on_a_circle, stop_and_go])
def test_no_offset_is_learnt_from_a_pad_that_turns_or_brakes_under_a_vehicle_that_follows_it(path):
    assert abs(run(TargetEstimator(CONFIG), followed(60.0, path)).delay_s) < 0.002


def shaken(seconds: float, late_s: float, *, hertz: float, roll_rad: float, from_s: float = 100.0, fps: float = 30.0):
    """Fixes of a pad at rest, 3 m under a vehicle that rolls to and fro in its place; frames are exposed so much later
    than they say. A generator: it is sent the offset that the next fix is to be made with.
    """
    noise, w = np.random.default_rng(6), 2.0 * math.pi * hertz

    def roll(t: float) -> float:
        return roll_rad * math.sin(w * t)

    delay_s = 0.0
    for k in range(round(seconds * fps)):
        t = from_s + k / fps
        a = roll(t + delay_s) - roll(t + late_s)
        way = 3.0 * np.array([0.0, -math.sin(a), math.cos(a)]) + 0.01 * noise.standard_normal(3)
        turning = np.array([roll_rad * w * math.cos(w * (t + delay_s)), 0.0, 0.0])
        told = fix(t + delay_s, tuple(way), sigma_m=0.03, pad_from_vehicle_ned_m=way, delay_s=delay_s)
        delay_s = yield replace(told, travelled_ned_m=np.zeros(3), shift_ned_m_s=np.cross(turning, way))


def settle(estimator: TargetEstimator, fixes) -> PadTrack:
    one = next(fixes)
    while True:
        track = estimator.update(one)
        try:
            one = fixes.send(estimator.delay_s)
        except StopIteration:
            return track


@pytest.mark.parametrize(
    ("late_s", "hertz", "roll_rad", "fps"),
    [(0.05, 4.0, 0.1, 30.0), (-0.05, 3.0, 0.1, 30.0), (0.03, 2.0, 0.15, 60.0), (0.04, 1.5, 0.1, 10.0)],
)
def test_offset_is_found_though_the_track_begins_while_the_vehicle_shakes(late_s, hertz, roll_rad, fps):
    """Its first fixes contradict each other by up to 0.4 m, and few frames a second leave it unsure between them."""
    last = settle(TargetEstimator(CONFIG), shaken(25.0, late_s, hertz=hertz, roll_rad=roll_rad, fps=fps))
    assert last.delay_s == pytest.approx(late_s, abs=0.004)
    assert last.fixes_accepted > 5.0 * fps
    assert math.hypot(*last.vel_ned_m_s[:2]) < 0.3


def test_offset_that_changes_is_found_anew():
    """A camera that was started again: what was known to a millisecond is 70 off, and the track contradicts it."""
    estimator = TargetEstimator(CONFIG)
    settle(estimator, shaken(10.0, 0.03, hertz=2.0, roll_rad=0.15))
    assert estimator.delay_s == pytest.approx(0.03, abs=0.004)
    last = settle(estimator, shaken(25.0, -0.04, hertz=2.0, roll_rad=0.15, from_s=111.0))
    assert last.delay_s == pytest.approx(-0.04, abs=0.004)


@pytest.mark.parametrize(("gap_s", "goes_on"), [(3.9, True), (4.1, False), (60.0, False)])
def test_track_without_a_fix_for_long_is_begun_anew_at_the_next(gap_s, goes_on):
    """Else one fix of whatever it is would be a track that fifty fixes have proven."""
    estimator = TargetEstimator(CONFIG)
    fixes = driving(2.0, vel=(0.0, 0.0, 0.0))
    before = run(estimator, fixes)
    after = estimator.update(fix(fixes[-1].t_capture_s + gap_s, (0.02, 0.0, 0.0)))
    assert after.fixes_accepted == (before.fixes_accepted + 1 if goes_on else 1)


def test_an_offset_that_is_ruled_out_is_not_looked_for():
    estimator = TargetEstimator(CONFIG.model_copy(update={"delay_sigma_s": 0.0}))
    last = [estimator.update(one) for one in mistimed(0.04, 5.0, (0.0, 0.0, 0.0))][-1]
    assert (last.delay_s, last.delay_sigma_s) == (0.0, 0.0)


def test_the_offset_outlasts_the_track():
    estimator = TargetEstimator(CONFIG)
    known = run(estimator, mistimed(0.04, 10.0, (0.0, 0.0, 0.0))).delay_s
    estimator.reset()
    again = [
        estimator.update(replace(one, t_capture_s=one.t_capture_s + 50.0)) for one in mistimed(0.04, 0.2, (0, 0, 0))
    ]
    assert again[-1].delay_s == pytest.approx(known, abs=0.25 * known)


def on_a_bend(seconds: float, radius_m: float, speed_m_s: float) -> list[PadFix]:
    """Exact fixes of a pad that drives round a circle about 0, clockwise, heading along it."""
    rate = speed_m_s / radius_m
    times = np.arange(round(seconds / FRAME_S)) * FRAME_S
    where = [(radius_m * math.cos(rate * t), radius_m * math.sin(rate * t), 0.0) for t in times]
    return [
        fix(100.0 + t, at, yaw_deg=math.degrees(rate * t + math.pi / 2), yaw_sigma_rad=math.radians(0.5))
        for t, at in zip(times, where, strict=True)
    ]


def test_pad_on_a_bend_is_predicted_along_it():
    radius_m, speed_m_s, ahead_s = 12.0, 5.0, 0.5
    fixes = on_a_bend(6.0, radius_m, speed_m_s)
    track = run(TargetEstimator(CONFIG), fixes)
    angle = speed_m_s / radius_m * (fixes[-1].t_capture_s - 100.0 + ahead_s)
    there = np.array([math.cos(angle), math.sin(angle), 0.0]) * radius_m
    ahead = track.at(track.t_capture_s + ahead_s)
    # Straight on it would be 0.26 m off: half of the acceleration, 2.08 m/s2, times the time squared.
    np.testing.assert_allclose(ahead.pos_ned_m, there, atol=0.08)
    way = np.array([-math.sin(angle), math.cos(angle), 0.0]) * speed_m_s
    np.testing.assert_allclose(ahead.vel_ned_m_s, way, atol=0.25)  # straight on: 1.04
    np.testing.assert_allclose(predict(track, track.t_capture_s + ahead_s).pos_ned_m, ahead.pos_ned_m)


def test_heading_that_only_jitters_is_no_turn():
    noise = np.random.default_rng(3)
    estimator = TargetEstimator(CONFIG)
    rates = [estimator.update(replace(one, pad_yaw_ned_rad=math.radians(noise.normal()))).turn_rate_rad_s
             for one in driving(20.0)]  # fmt: skip
    assert max(abs(rate) for rate in rates) < 0.02
