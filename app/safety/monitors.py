"""Monitors: what the vehicle, the camera, the track and the links say becomes verdicts. Pure.

Each monitor is a function from SafetyInputs to at most one verdict; MONITORS lists them. A verdict says what must
happen; the mission state machine does it. Each hazard has a timer of its own (Debounce), so that one that flickers
never resets another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from app.config import SafetyConfig
from app.frames import Array, is_inside, is_rotation, rotation_from_quaternion, tilt_rad
from app.messages import CameraStatus, Hazard, PadTrack, Response, TrackCheck, VehicleState, Verdict

MODE_AGE_MAX_S = 1.5
"""HEARTBEAT, the slowest source of the mode, comes once a second."""
BATTERY_AGE_MAX_S = 3.0
ESTIMATOR_AGE_MAX_S = 3.0
FROZEN_S = 0.25
"""Eight frames at 30 a second. A sensor has noise: two images in a row are never equal."""
TRACK_RESTARTS_MAX, TRACK_RESTARTS_S = 3, 10.0
"""So many restarts of a track in so long are no outliers: the frames' times or the lens are wrong."""


@dataclass(frozen=True, slots=True)
class SafetyInputs:
    """All that the monitors look at.

    Attributes:
        vehicle: Newest state; None before the first.
        home_ned_m: (3,) where this flight began, on the ground; None before it has.
        last_frame_s: Capture time of the newest detection; None before the first.
        camera: What is known of the camera's frames; None before the first judgement.
        track: Newest track; None without one.
        track_restarts_lately: Restarts of the track in the last TRACK_RESTARTS_S.
        track_check: Whether the track copies the vehicle's own motion; None before the first judgement.
    """

    vehicle: VehicleState | None
    home_ned_m: Array | None = None
    last_frame_s: float | None = None
    camera: CameraStatus | None = None
    track: PadTrack | None = None
    track_restarts_lately: int = 0
    track_check: TrackCheck | None = None


Monitor = Callable[[SafetyInputs, VehicleState, float, SafetyConfig], Verdict | None]


def judge(seen: SafetyInputs, now_s: float, config: SafetyConfig) -> tuple[Verdict, ...]:
    """Every hazard that is there now, gravest first, at most one verdict each.

    Args:
        seen: What is known.
        now_s: The time.
        config: [safety].
    """
    vehicle = seen.vehicle
    if vehicle is None or not vehicle.connected:
        return (Verdict(Hazard.LINK_LOST, "no heartbeat from the autopilot"),)
    verdicts = [verdict for monitor in MONITORS if (verdict := monitor(seen, vehicle, now_s, config)) is not None]
    order = list(Hazard)
    return tuple(sorted(verdicts, key=lambda verdict: order.index(verdict.hazard)))


def _vehicle_state(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    age_s = now_s - vehicle.t_capture_s
    if not age_s <= config.vehicle_state_stale_s:  # so put, NaN is stale
        return Verdict(Hazard.VEHICLE_STATE_STALE, f"attitude {age_s:.1f} s old")
    return None


def _mode(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    for what, age_s in (("mode", vehicle.mode_age_s), ("arming state", vehicle.armed_age_s)):
        if not age_s <= MODE_AGE_MAX_S:
            return Verdict(Hazard.MODE_UNKNOWN, f"PX4's {what} is {_age(age_s)}")
    return None


def _position(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if not vehicle.estimator_age_s <= ESTIMATOR_AGE_MAX_S:
        return Verdict(Hazard.POSITION_LOST, f"PX4's estimator status is {_age(vehicle.estimator_age_s)}")
    if not vehicle.local_position_ok or not np.isfinite([*vehicle.pos_ned_m, *vehicle.vel_ned_m_s]).all():
        return Verdict(Hazard.POSITION_LOST, "PX4 has no local position")
    return None


def _tilt(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if not is_rotation(vehicle.q_ned_from_body_wxyz):
        return Verdict(Hazard.TILT_EXCESSIVE, "PX4's attitude is not a rotation")
    tilt_deg = math.degrees(tilt_rad(rotation_from_quaternion(vehicle.q_ned_from_body_wxyz)))
    if not tilt_deg <= config.tilt_max_deg:
        return Verdict(Hazard.TILT_EXCESSIVE, f"tilt {tilt_deg:.0f} over {config.tilt_max_deg:.0f} deg")
    return None


def _battery(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    battery, unknown = vehicle.battery_fraction, Response(config.battery_unknown_action)
    if not vehicle.battery_age_s <= BATTERY_AGE_MAX_S:
        return Verdict(Hazard.BATTERY_UNKNOWN, f"battery level is {_age(vehicle.battery_age_s)}", unknown)
    if battery is None or not math.isfinite(battery):
        return Verdict(Hazard.BATTERY_UNKNOWN, "PX4 tells no battery level", unknown)
    if battery < config.battery_min_fraction:
        return Verdict(Hazard.BATTERY_LOW, f"battery {battery:.0%} under {config.battery_min_fraction:.0%}")
    return None


def _distance(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if seen.home_ned_m is None:
        return None
    away = vehicle.pos_ned_m - seen.home_ned_m
    distance_m = math.hypot(away[0], away[1])
    if not math.isfinite(distance_m):
        return Verdict(Hazard.TOO_FAR, "distance from home is not known")
    if distance_m > config.distance_from_home_max_m:
        return Verdict(Hazard.TOO_FAR, f"{distance_m:.0f} m away, over {config.distance_from_home_max_m:.0f}")
    return None


def _height(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if seen.home_ned_m is None:
        return None
    height_m = -float(vehicle.pos_ned_m[2] - seen.home_ned_m[2])
    if not math.isfinite(height_m):
        return Verdict(Hazard.TOO_HIGH, "height over home is not known")
    if height_m > config.height_max_m:
        return Verdict(Hazard.TOO_HIGH, f"{height_m:.0f} m high, over {config.height_max_m:.0f}")
    return None


def _fence(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if seen.home_ned_m is None or not config.fence_ne_m:
        return None
    north, east, _ = (vehicle.pos_ned_m - seen.home_ned_m).tolist()
    if is_inside((north, east), config.fence_ne_m):
        return None
    return Verdict(Hazard.FENCE_LEFT, f"outside the fence, {north:.0f} m N {east:.0f} m E")


def _estimator(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if vehicle.gnss_glitch:
        return Verdict(Hazard.ESTIMATOR_BAD, "PX4 says that GNSS jumps")
    ratio = vehicle.estimator_test_ratio
    if ratio is not None and not ratio <= 1.0:
        return Verdict(Hazard.ESTIMATOR_BAD, f"PX4's estimator rejects data, {ratio:.1f} over 1")
    return None


def _wind(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    """A lean that lasts (CONFIRM_S) holds against the air: what is left of it is the reserve against a gust."""
    if not is_rotation(vehicle.q_ned_from_body_wxyz):
        return None
    tilt_deg = math.degrees(tilt_rad(rotation_from_quaternion(vehicle.q_ned_from_body_wxyz)))
    if not tilt_deg <= config.tilt_max_deg - config.tilt_reserve_deg:
        return Verdict(Hazard.WIND_EXCESSIVE, f"leans {tilt_deg:.0f} deg for long: too much wind")
    return None


def _frames(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    """By arrival too, where arrivals are known: a frame's own time may be wrong, and lie ahead."""
    times_s = (seen.last_frame_s,) if seen.camera is None else (seen.last_frame_s, seen.camera.new_frame_s)
    if not all(t_s is not None and now_s - t_s <= config.frames_stale_s for t_s in times_s):
        return Verdict(Hazard.FRAMES_STALE, "no camera frames")
    return None


def _frozen(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if seen.camera is None or seen.camera.frozen_s < FROZEN_S:
        return None
    return Verdict(Hazard.FRAMES_FROZEN, f"camera repeats one image for {seen.camera.frozen_s:.1f} s")


def _image(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if seen.camera is None or not seen.camera.image_fault:
        return None
    return Verdict(Hazard.FRAMES_UNUSABLE, f"camera image is {seen.camera.image_fault}")


def _camera_time(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    if seen.camera is not None and seen.camera.time_fault:
        return Verdict(Hazard.CAMERA_TIME_WRONG, seen.camera.time_fault)
    if seen.track is not None and seen.track.delay_at_limit:
        return Verdict(Hazard.CAMERA_TIME_WRONG, f"frame times are {seen.track.delay_s * 1e3:.0f} ms or more off")
    if seen.track_restarts_lately >= TRACK_RESTARTS_MAX:
        return Verdict(Hazard.CAMERA_TIME_WRONG, f"{seen.track_restarts_lately} track restarts in 10 s")
    return None


def _copied(seen: SafetyInputs, vehicle: VehicleState, now_s: float, config: SafetyConfig) -> Verdict | None:
    check = seen.track_check
    if check is None or not check.cause:
        return None
    return Verdict(Hazard.PAD_COPIES_VEHICLE, check.cause)


def _age(age_s: float) -> str:
    return f"{age_s:.1f} s old" if math.isfinite(age_s) else "not known"


MONITORS: tuple[Monitor, ...] = (
    _vehicle_state,
    _mode,
    _position,
    _tilt,
    _battery,
    _distance,
    _height,
    _fence,
    _estimator,
    _wind,
    _frames,
    _frozen,
    _image,
    _camera_time,
    _copied,
)

CONFIRM_S: dict[Hazard, float] = {
    Hazard.POSITION_LOST: 0.3,
    Hazard.TILT_EXCESSIVE: 0.3,
    Hazard.TOO_FAST: 0.5,
    Hazard.BATTERY_LOW: 2.0,
    Hazard.BATTERY_UNKNOWN: 2.0,
    Hazard.FENCE_LEFT: 0.3,
    Hazard.TOO_FAR: 0.3,
    Hazard.TOO_HIGH: 0.3,
    Hazard.ESTIMATOR_BAD: 1.0,
    Hazard.WIND_EXCESSIVE: 3.0,
    Hazard.FRAMES_UNUSABLE: 1.0,
}
"""A hazard must stand this long: PX4's position flag was seen to drop for a single report, a battery sags under a
punch of thrust, a gust tilts. What is measured by an age already has its time in it."""
LEAK = 0.5
"""While a hazard is not there, its timer runs back at this part of its speed: one that is there for more than a third
of the time is confirmed, and one that shows now and then never is."""
STEP_S = 0.05
"""Of the mission's loop: a hazard that is seen for the first time has been there for one step at most."""


@dataclass(frozen=True, slots=True)
class TrackRestarts:
    """The memory of how often the track was begun anew lately.

    Attributes:
        count: Of the newest track, since the application started.
        times_s: When each restart of the last TRACK_RESTARTS_S was seen.
    """

    count: int = 0
    times_s: tuple[float, ...] = ()

    def see(self, track: PadTrack | None, now_s: float) -> TrackRestarts:
        """The next memory."""
        times_s = tuple(t_s for t_s in self.times_s if now_s - t_s < TRACK_RESTARTS_S)
        if track is None or track.restarts <= self.count:
            return TrackRestarts(self.count, times_s)
        return TrackRestarts(track.restarts, (*times_s, *[now_s] * (track.restarts - self.count)))


@dataclass(frozen=True, slots=True)
class Debounce:
    """The memory of `debounce`: a leaky timer for each hazard.

    Attributes:
        t_s: Of the last step; None before the first.
        stood_s: How long each hazard has stood, less what has leaked; hazards at 0 are left out.
    """

    t_s: float | None = None
    stood_s: Mapping[Hazard, float] = field(default_factory=dict)


def debounce(memory: Debounce, verdicts: tuple[Verdict, ...], now_s: float) -> tuple[Debounce, tuple[Verdict, ...]]:
    """The next memory, and the verdicts whose hazards have stood for long enough, gravest first."""
    dt_s = 0.0 if memory.t_s is None else max(0.0, now_s - memory.t_s)
    there = {verdict.hazard for verdict in verdicts}
    stood: dict[Hazard, float] = {}
    for hazard in there | set(memory.stood_s):
        needed_s = CONFIRM_S.get(hazard, 0.0)
        before_s = memory.stood_s.get(hazard)
        if hazard not in there:
            left_s = (before_s or 0.0) - LEAK * dt_s
            if left_s > 0.0:
                stood[hazard] = left_s
        else:
            stood[hazard] = min(needed_s, min(dt_s, STEP_S) if before_s is None else before_s + dt_s)
    confirmed = tuple(v for v in verdicts if stood[v.hazard] >= CONFIRM_S.get(v.hazard, 0.0))
    return Debounce(now_s, stood), confirmed
