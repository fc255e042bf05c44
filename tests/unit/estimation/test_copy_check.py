"""A pad that copies the vehicle's own motion, from geometry: what a camera sees while the vehicle shakes over a pad."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from app.estimation.copy_check import CopyCheck, likely_cause
from app.frames import Array, rotation_from_quaternion
from app.messages import PadFix, TrackCheck

RATE_HZ = 30.0
HEIGHT_M = 2.5


def quaternion(roll: float, pitch: float) -> Array:
    """(4,) roll about forward, then pitch about right, heading north."""
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    return np.array([cp * cr, cp * sr, sp * cr, -sp * sr])


@dataclass
class Shaking:
    """A vehicle over a pad that shakes in roll and pitch by some degrees, at two frequencies, and moves accordingly."""

    tilt_deg: float = 2.0

    def attitude(self, t_s: float) -> Array:
        tilt = math.radians(self.tilt_deg)
        roll = tilt * (math.sin(5.0 * t_s) + 0.5 * math.sin(11.0 * t_s + 1.0))
        pitch = tilt * (math.sin(6.1 * t_s + 0.4) + 0.5 * math.sin(9.0 * t_s))
        return quaternion(roll, pitch)

    def pos_m(self, t_s: float) -> Array:
        """g tan(tilt), integrated twice; north from pitch (nose up: backwards), east from roll."""
        tilt, g = math.radians(self.tilt_deg), 9.80665
        north = g * tilt * (math.sin(6.1 * t_s + 0.4) / 6.1**2 + 0.5 * math.sin(9.0 * t_s) / 81.0)
        east = -g * tilt * (math.sin(5.0 * t_s) / 25.0 + 0.5 * math.sin(11.0 * t_s + 1.0) / 121.0)
        return np.array([north, east, -HEIGHT_M])


def judge(
    seconds: float,
    *,
    vehicle: Shaking | None = None,
    late_s: float = 0.0,
    frozen_at_s: float = math.inf,
    mount_deg: float = 0.0,
    pad_acceleration_m_s2: float = 0.0,
    pad_shaking_m: float = 0.0,
    noise_m: float = 0.005,
) -> list[TrackCheck]:
    """What the check says at each fix of a camera that is late, frozen from a time on, or turned about its axis."""
    vehicle, check, rng = vehicle or Shaking(), CopyCheck(), np.random.default_rng(1)
    angle = math.radians(mount_deg)
    turned = np.array([[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0, 0, 1]])
    said = []
    for k in range(round(seconds * RATE_HZ)):
        t_s = k / RATE_HZ
        seen_s = min(t_s - late_s, frozen_at_s)
        north = 0.5 * pad_acceleration_m_s2 * seen_s**2 + pad_shaking_m * math.sin(7.3 * seen_s)
        pad = np.array([north, 0.2, 0.0])
        body = rotation_from_quaternion(vehicle.attitude(seen_s)).T @ (pad - vehicle.pos_m(seen_s))
        measured = turned @ (body + rng.normal(0.0, noise_m, 3))
        q = vehicle.attitude(t_s)
        from_vehicle = rotation_from_quaternion(q) @ measured
        fix = PadFix(
            t_s,
            vehicle.pos_m(t_s) + from_vehicle,
            from_vehicle,
            np.eye(3) * noise_m**2,
            0.0,
            0.02,
            "44",
            travelled_ned_m=vehicle.pos_m(t_s),
        )
        said.append(check.update(fix, q))
    return said


@pytest.mark.parametrize(
    "flight",
    [
        {},
        {"noise_m": 0.03},
        {"pad_acceleration_m_s2": 3.0},
        {"pad_shaking_m": 0.03},
        {"late_s": 0.02},
        {"mount_deg": 5.0},
    ],
    ids=["at rest", "noisy", "braking", "shaking", "20 ms late", "mount 5 deg off"],
)
def test_pad_that_is_seen_right_is_not_suspected(flight):
    said = judge(8.0, **flight)
    assert not any(check.cause for check in said)
    assert any(check.copy_ratio is not None for check in said)  # there was motion to judge by


def test_ratio_of_a_frozen_image_is_one():
    """Every fix then moves with the vehicle, whatever that does."""
    ratios = [check.copy_ratio for check in judge(4.0, frozen_at_s=0.0, noise_m=0.0)]
    assert ratios[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("mount_deg", [30.0, 45.0, 90.0, -120.0, 180.0])
def test_ratio_of_a_turned_camera_is_the_chord_of_its_angle(mount_deg):
    ratio = judge(6.0, mount_deg=mount_deg, noise_m=0.0)[-1].copy_ratio
    assert ratio == pytest.approx(2.0 * math.sin(math.radians(abs(mount_deg)) / 2.0), rel=0.15)


@pytest.mark.parametrize(
    "flight",
    [{"frozen_at_s": 0.0}, {"late_s": 0.3}, {"mount_deg": 45.0}, {"mount_deg": 90.0}, {"mount_deg": 180.0}],
    ids=str,
)
def test_pad_that_copies_the_vehicle_is_named_within_three_seconds(flight):
    said = judge(6.0, **flight)
    first = next(k for k, check in enumerate(said) if check.cause)
    assert first / RATE_HZ <= 3.0
    assert all(check.cause for check in said[first:])
    assert all(len(check.cause) <= 40 for check in said)


def test_image_that_freezes_in_flight_is_named_within_three_seconds_of_it():
    said = judge(10.0, frozen_at_s=5.0)
    first = next(k for k, check in enumerate(said) if check.cause)
    assert 5.0 < first / RATE_HZ <= 8.0


def test_single_step_of_the_attitude_is_not_taken_for_a_copy():
    """Two degrees at once, as an estimator corrects itself: one event, however long it stays in the window."""
    check, vehicle = CopyCheck(), Shaking(tilt_deg=0.3)
    said = []
    for k in range(round(6.0 * RATE_HZ)):
        t_s = k / RATE_HZ
        seen = rotation_from_quaternion(vehicle.attitude(t_s)).T @ -vehicle.pos_m(t_s)
        q = vehicle.attitude(t_s)
        if t_s > 3.0:  # PX4 believes in a roll that is not there
            q = quaternion(math.radians(1.4), 0.0)
        from_vehicle = rotation_from_quaternion(q) @ seen
        fix = PadFix(t_s, from_vehicle, from_vehicle, np.eye(3), 0.0, 0.02, "44", travelled_ned_m=vehicle.pos_m(t_s))
        said.append(check.update(fix, q))
    assert not any(c.cause for c in said[: round(4.3 * RATE_HZ)])


def test_vehicle_that_does_not_move_gives_no_judgement():
    said = judge(5.0, vehicle=Shaking(tilt_deg=0.02), frozen_at_s=0.0)
    assert all(check.copy_ratio is None and not check.cause for check in said)


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (1.0 + 0.0j, "image frozen or late, or camera turned?"),
        (2.0 + 0.0j, "image frozen or late, or camera turned?"),
        (1.0 - 1.0j, "camera mount is turned by 90 deg?"),
        (0.2929 - 0.7071j, "camera mount is turned by 45 deg?"),
    ],
)
def test_cause_is_the_mount_where_the_angle_says_so(ratio, words):
    assert likely_cause(ratio) == words
