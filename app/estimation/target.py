"""The target estimator: a Kalman filter in ned on the pad's position, velocity and heading. Pure.

Constant velocity with white acceleration (Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking
and Navigation", 6.3.2: discretised continuous white noise acceleration); where the pad's heading turns at a rate that
stands out of its error the velocity turns with it (11.7.1: coordinated turn, the rate taken from the heading's own
filter). The filter stands at the capture time of the last fix; whoever needs the pad at another time predicts from
there, so the camera's latency costs no accuracy.

Frames may be exposed later or earlier than their times say, for the camera's and PX4's clocks are matched over links
with delays of their own. Such an offset d shows when the vehicle moves or turns: the fix is made with the vehicle's
pose of d ago, and lies d (v + w x r) off a pad at rest (v, w the vehicle's velocity and turning, r the way to the pad).
It is a seventh state that all tracks share (after Li and Mourikis, "Online temporal calibration for camera-IMU
systems", 2014). What is known of it goes into the time of the next fix, which is made with the pose of then; the filter
sees what is left.

Between two fixes the vehicle is dead-reckoned with PX4's velocity, not with its position. The two disagree: velocity
is off by 0.04 to 0.15 m/s for about a second at a time, and next to none of it shows in the position (measured on PX4
SITL: slope 0.2 to 0.35, correlation 0.3). Since PX4's velocity loop holds the velocity that PX4 believes in, the
velocity that keeps a vehicle over the pad is the pad's own plus PX4's error; dead reckoning with PX4's velocity makes
exactly that sum the filter's velocity state, and the feed-forward takes the error out as soon as vision shows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.config import EstimationConfig
from app.estimation.deck import DeckTilt
from app.estimation.deck import start as start_deck
from app.estimation.heading import Heading, shrunk
from app.frames import Array, rotation_from_yaw
from app.messages import PadFix, PadTrack

VELOCITY_SIGMA_AT_START_M_S = 5.0
"""A pad that was just seen for the first time may drive at any speed that a vehicle can follow."""
DELAY_MAX_S = 0.1
"""No camera's time is further off; what looks so is something else."""
DELAY_NEAREST_M = 0.4
"""Nearer to the pad the vehicle soon stands on it, and PX4's velocity is no measure of how it moves."""
DELAY_SPEED_SIGMA_M_S = 0.7
"""As long as the pad's speed is less known than this the offset can't be told from it: their product is measured."""
DELAY_FIXES = 10
"""Nothing is learnt of it from the first fixes of a track: what they are off by went into the pad's velocity."""
SLOW_S = 4.0
"""Time constant of the pad's velocity by which the offset is weighed: in a shorter one the noise of the last fixes is
left, and against that of the next one it would pass for an offset."""
FORGOTTEN_S = 4.0
"""A track without a fix for so long is begun anew: where the pad was then proves nothing of what is seen now."""
DOUBT = 2.0
"""Where fixes contradict a track until it is begun anew, the offset may be what was wrong: its deviation grows by so
much, and is as at the start at least."""
DELAY_DRIFT_S = 0.5e-3
"""Random walk of the offset, a second to each root of a second."""


@dataclass(frozen=True, slots=True)
class _Delay:
    """The frames' time offset: its mean, variance, and (6,) covariance with the track."""

    mean_s: float
    variance_s2: float
    with_track: Array


class TargetEstimator:
    """Turns fixes into a track.

    Args:
        config: [estimation].
    """

    def __init__(self, config: EstimationConfig) -> None:
        self._config = config
        self._track: PadTrack | None = None
        self._heading = Heading(np.zeros(2), np.eye(2))
        self._last_fix: PadFix | None = None
        self._deck: DeckTilt | None = None
        self._delay = _Delay(0.0, config.delay_sigma_s**2, np.zeros(6))
        self._slow_vel_ned_m_s = np.zeros(3)

    @property
    def track(self) -> PadTrack | None:
        """The track at the last accepted fix; None before the first."""
        return self._track

    @property
    def delay_s(self) -> float:
        """By how much later than they say the frames are exposed, as far as that is known."""
        return self._delay.mean_s

    def reset(self) -> None:
        """Forget the track: after a reset of PX4's local frame, or when the search begins anew."""
        self._track = None

    def update(self, fix: PadFix) -> PadTrack:
        """Take a fix at its capture time; an outlier is counted and left out, and enough of them in a row start anew.

        A fix that is older than the track's last one is left out.
        """
        track = self._track
        if track is None or fix.t_capture_s - track.t_last_fix_s > FORGOTTEN_S:
            return self._start(fix)
        if fix.t_capture_s <= track.t_capture_s:
            return track
        predicted = predict(track, fix.t_capture_s, self._config.acceleration_m_s2)
        predicted = replace(predicted, pos_ned_m=predicted.pos_ned_m + self._slip_m(fix))
        prior, look = self._joint(track, predicted, fix)
        s_matrix = look @ prior @ look.T + fix.covariance_ned_m2
        innovation = fix.pad_pos_ned_m - predicted.pos_ned_m
        if fix.shift_ned_m_s is not None:
            left_s = self._delay.mean_s - fix.delay_s
            innovation = innovation - left_s * (predicted.vel_ned_m_s - fix.shift_ned_m_s)
        distance2 = float(innovation @ np.linalg.solve(s_matrix, innovation))
        if not distance2 <= self._config.gate_sigma**2:  # so put, NaN is an outlier
            rejected = track.fixes_rejected_in_row + 1
            if rejected >= self._config.rejections_before_restart:
                self._doubt()
                return self._start(fix)
            self._track = replace(track, fixes_rejected_in_row=rejected)
            return self._track
        gain = prior @ look.T @ np.linalg.inv(s_matrix)
        # Of the track, not of its prediction: with few frames a second that one is never sure.
        unsure = (
            float(np.trace(track.covariance[3:, 3:])) > DELAY_SPEED_SIGMA_M_S**2 or track.fixes_accepted < DELAY_FIXES
        )
        if unsure or float(np.linalg.norm(fix.pad_from_vehicle_ned_m)) < DELAY_NEAREST_M:
            gain[6] = 0.0  # Schmidt's: what is known of it counts, nothing is learnt
        else:
            # Where nothing moves, or the vehicle follows the pad, an offset doesn't show, and noise would pass for one;
            # so would what the pad's velocity has changed by since.
            changed = predicted.vel_ned_m_s - self._slow_vel_ned_m_s
            variance = float(np.trace(predicted.covariance[3:, 3:]) + changed @ changed)
            gain[6] *= shrunk(float(look[:, 6] @ look[:, 6]), variance)
        correction = gain @ innovation
        keep = np.eye(7) - gain @ look
        posterior = keep @ prior @ keep.T + gain @ fix.covariance_ned_m2 @ gain.T  # Joseph's form
        covariance = posterior[:6, :6]
        delay_s = max(-DELAY_MAX_S, min(DELAY_MAX_S, self._delay.mean_s + float(correction[6])))
        self._delay = _Delay(delay_s, float(posterior[6, 6]), posterior[:6, 6])
        velocity = predicted.vel_ned_m_s + correction[3:6]
        dt_s = fix.t_capture_s - track.t_capture_s
        part = 1.0 if unsure else dt_s / (SLOW_S + dt_s)
        self._slow_vel_ned_m_s = self._slow_vel_ned_m_s + part * (velocity - self._slow_vel_ned_m_s)
        config = self._config
        self._heading = self._heading.update(
            fix.pad_yaw_ned_rad, fix.yaw_sigma_rad, dt_s, config.gate_sigma, config.rejections_before_restart
        )
        self._last_fix = fix
        self._update_deck(fix)
        self._track = PadTrack(
            t_capture_s=fix.t_capture_s,
            pos_ned_m=predicted.pos_ned_m + correction[:3],
            vel_ned_m_s=velocity,
            covariance=covariance,
            yaw_ned_rad=float(self._heading.mean[0]),
            yaw_rate_rad_s=float(self._heading.mean[1]),
            t_last_fix_s=fix.t_capture_s,
            fixes_accepted=track.fixes_accepted + 1,
            turn_rate_rad_s=self._heading.turn_rad_s,
            delay_s=self._delay.mean_s,
            delay_sigma_s=math.sqrt(self._delay.variance_s2),
            **self._lean(),
        )
        return self._track

    def _joint(self, track: PadTrack, predicted: PadTrack, fix: PadFix) -> tuple[Array, Array]:
        """(7, 7) covariance of the predicted track and the offset, and (3, 7) how a fix depends on them.

        How it depends on the offset is worked out with the pad's velocity of a while before: that of now has the noise
        of the last fixes in it, against which the next one stands out, and the product of the two would pass for an
        offset.
        """
        dt_s = fix.t_capture_s - track.t_capture_s
        prior = np.empty((7, 7))
        prior[:6, :6] = predicted.covariance
        prior[:6, 6] = prior[6, :6] = _step(track, dt_s) @ self._delay.with_track
        drift = DELAY_DRIFT_S**2 * dt_s if self._config.delay_sigma_s > 0.0 else 0.0
        prior[6, 6] = self._delay.variance_s2 + drift
        look = np.eye(3, 7)
        if fix.shift_ned_m_s is not None:
            look[:, 3:6] = (self._delay.mean_s - fix.delay_s) * np.eye(3)
            look[:, 6] = self._slow_vel_ned_m_s - fix.shift_ned_m_s
        return prior, look

    def _update_deck(self, fix: PadFix) -> None:
        if fix.pad_normal_ned is None:
            return
        level = fix.pad_normal_ned[:2]
        if self._deck is None:
            self._deck = start_deck(level, fix.normal_sigma_rad, fix.t_capture_s)
        else:
            self._deck = self._deck.update(level, fix.normal_sigma_rad, fix.t_capture_s)

    def _lean(self) -> dict[str, Any]:
        """The deck's part of a track."""
        if self._deck is None:
            return {}
        lean, rate = self._deck.mean.tolist()
        return {
            "lean_ne_rad": (lean[0], lean[1]),
            "lean_rate_ne_rad_s": (rate[0], rate[1]),
            "lean_sigma_rad": math.sqrt(float(self._deck.covariance[0, 0])),
        }

    def _doubt(self) -> None:
        """The offset is less sure than it was taken to be."""
        before = self._delay.variance_s2
        if self._config.delay_sigma_s > 0.0:
            after = min((DELAY_MAX_S / 2.0) ** 2, max(DOUBT**2 * before, self._config.delay_sigma_s**2))
            self._delay = replace(self._delay, variance_s2=max(before, after))

    def _start(self, fix: PadFix) -> PadTrack:
        self._last_fix = fix
        self._slow_vel_ned_m_s = np.zeros(3)
        self._deck = None
        variance, with_track = self._delay.variance_s2, np.zeros(6)
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = fix.covariance_ned_m2
        if fix.shift_ned_m_s is not None:
            # The fix lies d (shift - v) off, and next to nothing is known of the pad's velocity v.
            with_track[:3] = variance * fix.shift_ned_m_s
            covariance[:3, :3] += np.outer(with_track[:3], fix.shift_ned_m_s)
            covariance[:2, :2] += variance * VELOCITY_SIGMA_AT_START_M_S**2 * np.eye(2)
        self._delay = replace(self._delay, with_track=with_track)
        covariance[3:, 3:] = np.eye(3) * VELOCITY_SIGMA_AT_START_M_S**2
        covariance[5, 5] = 1.0  # decks heave; nothing that can be landed on climbs at 5 m/s
        self._heading = Heading.start(fix.pad_yaw_ned_rad, fix.yaw_sigma_rad)
        self._track = PadTrack(
            t_capture_s=fix.t_capture_s,
            pos_ned_m=fix.pad_pos_ned_m,
            vel_ned_m_s=np.zeros(3),
            covariance=covariance,
            yaw_ned_rad=fix.pad_yaw_ned_rad,
            yaw_rate_rad_s=0.0,
            t_last_fix_s=fix.t_capture_s,
            fixes_accepted=1,
        )
        return self._track

    def _slip_m(self, fix: PadFix) -> Array:
        """(3,) how far PX4's position moved since the last accepted fix beyond what its velocity says."""
        last = self._last_fix
        if last is None or last.travelled_ned_m is None or fix.travelled_ned_m is None:
            return np.zeros(3)
        moved = (fix.pad_pos_ned_m - fix.pad_from_vehicle_ned_m) - (last.pad_pos_ned_m - last.pad_from_vehicle_ned_m)
        return moved - (fix.travelled_ned_m - last.travelled_ned_m)


def predict(track: PadTrack, t_s: float, acceleration_m_s2: float = 0.0) -> PadTrack:
    """The track at a later time, its covariance grown by white acceleration of the given density (m/s2 per root Hz)."""
    dt = t_s - track.t_capture_s
    step = _step(track, dt)
    q = acceleration_m_s2**2 * np.array([1.0, 1.0, 0.25])  # decks move up and down less than vehicles speed up
    covariance = step @ track.covariance @ step.T
    age = abs(dt)
    covariance[:3, :3] += np.diag(q) * age**3 / 3
    covariance[:3, 3:] += np.diag(q) * age**2 / 2
    covariance[3:, :3] += np.diag(q) * age**2 / 2
    covariance[3:, 3:] += np.diag(q) * age
    return replace(track.at(t_s), covariance=covariance)


def _step(track: PadTrack, dt_s: float) -> Array:
    """(6, 6) how position and velocity so much later depend on those of the track."""
    step = np.eye(6)
    step[:3, 3:] = dt_s * rotation_from_yaw(0.5 * dt_s * track.turn_rate_rad_s)
    step[3:, 3:] = rotation_from_yaw(dt_s * track.turn_rate_rad_s)
    return step


def is_confident(track: PadTrack, config: EstimationConfig) -> bool:
    """Whether a track may be followed: enough fixes, and a velocity known to better than 1 m/s."""
    speed_sigma = math.sqrt(float(track.covariance[3, 3] + track.covariance[4, 4]))
    return track.fixes_accepted >= config.fixes_before_confident and speed_sigma < 1.0
