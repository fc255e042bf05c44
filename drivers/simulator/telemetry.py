"""What PX4 streams: a builder for each MAVLink message, from the flight controller's own estimate, never the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from app.messages import FlightMode, LandedState
from drivers.simulator.estimate import Estimate
from drivers.simulator.px4 import Px4

HOME_LATITUDE_DEG = 47.397742
HOME_LONGITUDE_DEG = 8.545594
HOME_ALTITUDE_M = 488.0
"""Zurich, where PX4's simulations start."""
EARTH_RADIUS_M = 6371000.0
"""PX4's map projection takes this sphere."""
BATTERY_V = 16.2
BATTERY_DRAIN_1_S = 1.0 / 1200.0
"""Twenty minutes of flight."""

CUSTOM_MODES: dict[FlightMode, tuple[int, int]] = {
    FlightMode.MANUAL: (1, 0),
    FlightMode.ALTITUDE: (2, 0),
    FlightMode.POSITION: (3, 0),
    FlightMode.TAKEOFF: (4, 2),
    FlightMode.HOLD: (4, 3),
    FlightMode.MISSION: (4, 4),
    FlightMode.RETURN: (4, 5),
    FlightMode.LAND: (4, 6),
    FlightMode.PRECLAND: (4, 9),
    FlightMode.OFFBOARD: (6, 0),
}
"""PX4's main and sub mode."""
FLOWN: frozenset[FlightMode] = frozenset(CUSTOM_MODES) - {FlightMode.MISSION, FlightMode.PRECLAND, FlightMode.MANUAL}
"""Modes that this flight controller can fly."""

_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)
_LANDED = {
    LandedState.ON_GROUND: 1,
    LandedState.IN_AIR: 2,
    LandedState.TAKING_OFF: 3,
    LandedState.LANDING: 4,
}


def custom_mode(mode: FlightMode) -> int:
    """PX4's custom_mode of HEARTBEAT."""
    main, sub = CUSTOM_MODES[mode]
    return main << 16 | sub << 24


def mode_of(main: int, sub: int) -> FlightMode | None:
    """The mode of a main and sub mode; None if this flight controller doesn't fly it."""
    for mode, numbers in CUSTOM_MODES.items():
        if numbers[0] == main and (main != 4 or numbers[1] == sub):
            return mode if mode in FLOWN else None
    return None


class Telemetry:
    """Builders of the messages.

    Args:
        px4: Whose estimate is told.

    Attributes:
        builders: By message id.
    """

    def __init__(self, px4: Px4) -> None:
        self._px4 = px4
        self._flown_s = 0.0
        self._last_s = 0.0
        self.builders: dict[int, Callable[[], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self.sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw_int,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self.attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self.local_position_ned,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position_int,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.gps_global_origin,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self.position_target_local_ned,
            mavlink.MAVLINK_MSG_ID_ALTITUDE: self.altitude,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery_status,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self.estimator_status,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.extended_sys_state,
            mavlink.MAVLINK_MSG_ID_ODOMETRY: self.odometry,
            mavlink.MAVLINK_MSG_ID_CURRENT_MODE: self.current_mode,
        }

    @property
    def _ms(self) -> int:
        return int(self._px4.uptime_s * 1e3) & 0xFFFFFFFF

    @property
    def _us(self) -> int:
        return int(self._px4.uptime_s * 1e6)

    @property
    def battery_fraction(self) -> float:
        """What is left, drained while armed."""
        now_s = self._px4.uptime_s
        if self._px4.commander.armed:
            self._flown_s += now_s - self._last_s
        self._last_s = now_s
        return max(0.0, 1.0 - self._flown_s * BATTERY_DRAIN_1_S)

    def _global(self, now: Estimate) -> tuple[int, int]:
        """Latitude and longitude in 1e-7 degrees."""
        latitude = HOME_LATITUDE_DEG + math.degrees(now.n / EARTH_RADIUS_M)
        shrink = math.cos(math.radians(HOME_LATITUDE_DEG))
        longitude = HOME_LONGITUDE_DEG + math.degrees(now.e / (EARTH_RADIUS_M * shrink))
        return round(latitude * 1e7), round(longitude * 1e7)

    def heartbeat(self) -> Any:
        """HEARTBEAT."""
        commander = self._px4.commander
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if commander.mode in (FlightMode.MANUAL, FlightMode.ALTITUDE, FlightMode.POSITION):
            mode |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        else:
            mode |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if commander.armed:
            mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        status = mavlink.MAV_STATE_STANDBY
        if commander.armed:
            status = mavlink.MAV_STATE_ACTIVE if commander.mode is commander.intent else mavlink.MAV_STATE_CRITICAL
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, mode, custom_mode(commander.mode), status, 3
        )

    def sys_status(self) -> Any:
        """SYS_STATUS: sensors are there and well; the pre-arm bit once arming is allowed."""
        health = _SENSORS if self._px4.commander.ready else _SENSORS & ~mavlink.MAV_SYS_STATUS_PREARM_CHECK
        left = self.battery_fraction
        millivolts = round(1e3 * (BATTERY_V - 1.6 * (1.0 - left)))
        amperes = 1200 if self._px4.commander.armed else 50
        return mavlink.MAVLink_sys_status_message(
            _SENSORS, _SENSORS, health, 250, millivolts, amperes, round(100 * left), 0, 0, 0, 0, 0, 0
        )

    def system_time(self) -> Any:
        """SYSTEM_TIME, without an absolute time: there is none in the simulation."""
        return mavlink.MAVLink_system_time_message(0, self._ms)

    def gps_raw_int(self) -> Any:
        """GPS_RAW_INT: a 3D fix at the estimate."""
        now = self._px4.estimate
        latitude, longitude = self._global(now)
        speed = round(100 * math.hypot(now.vn, now.ve))
        course = round(100 * (math.degrees(math.atan2(now.ve, now.vn)) % 360.0))
        altitude = round(1e3 * (HOME_ALTITUDE_M - now.d))
        return mavlink.MAVLink_gps_raw_int_message(
            self._us, 3, latitude, longitude, altitude, 70, 110, speed, course, 16
        )

    def attitude(self) -> Any:
        """ATTITUDE."""
        now = self._px4.estimate
        return mavlink.MAVLink_attitude_message(self._ms, now.roll, now.pitch, now.yaw, *now.rates)

    def attitude_quaternion(self) -> Any:
        """ATTITUDE_QUATERNION."""
        now = self._px4.estimate
        return mavlink.MAVLink_attitude_quaternion_message(self._ms, *now.q, *now.rates)

    def local_position_ned(self) -> Any:
        """LOCAL_POSITION_NED."""
        now = self._px4.estimate
        return mavlink.MAVLink_local_position_ned_message(self._ms, now.n, now.e, now.d, now.vn, now.ve, now.vd)

    def global_position_int(self) -> Any:
        """GLOBAL_POSITION_INT."""
        now = self._px4.estimate
        latitude, longitude = self._global(now)
        heading = round(100 * (math.degrees(now.yaw) % 360.0)) % 36000
        return mavlink.MAVLink_global_position_int_message(
            self._ms,
            latitude,
            longitude,
            round(1e3 * (HOME_ALTITUDE_M - now.d)),
            round(-1e3 * now.d),
            round(100 * now.vn),
            round(100 * now.ve),
            round(100 * now.vd),
            heading,
        )

    def gps_global_origin(self) -> Any:
        """GPS_GLOBAL_ORIGIN."""
        return mavlink.MAVLink_gps_global_origin_message(
            round(HOME_LATITUDE_DEG * 1e7), round(HOME_LONGITUDE_DEG * 1e7), round(HOME_ALTITUDE_M * 1e3), self._us
        )

    def vfr_hud(self) -> Any:
        """VFR_HUD."""
        now = self._px4.estimate
        speed = math.hypot(now.vn, now.ve)
        heading = round(math.degrees(now.yaw)) % 360
        return mavlink.MAVLink_vfr_hud_message(
            speed, speed, heading, round(100 * self._px4.collective), HOME_ALTITUDE_M - now.d, -now.vd
        )

    def position_target_local_ned(self) -> Any:
        """POSITION_TARGET_LOCAL_NED: the setpoint that is flown."""
        demand = self._px4.demand
        return mavlink.MAVLink_position_target_local_ned_message(
            self._ms, 1, 0, *demand.position, *demand.velocity, *demand.acceleration, demand.yaw, demand.yaw_rate
        )

    def altitude(self) -> Any:
        """ALTITUDE."""
        up = -self._px4.estimate.d
        return mavlink.MAVLink_altitude_message(self._us, up, HOME_ALTITUDE_M + up, up, up, math.nan, math.nan)

    def battery_status(self) -> Any:
        """BATTERY_STATUS."""
        left = self.battery_fraction
        cell = round(1e3 * (BATTERY_V - 1.6 * (1.0 - left)) / 4.0)
        amperes = 1200 if self._px4.commander.armed else 50
        cells = [cell] * 4 + [0xFFFF] * 6
        return mavlink.MAVLink_battery_status_message(0, 0, 1, 2500, cells, amperes, 0, -1, round(100 * left), 0, 1)

    def autopilot_version(self) -> Any:
        """AUTOPILOT_VERSION of a PX4 v1.16."""
        capabilities = (
            mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        )
        version = 1 << 24 | 16 << 16 | 255
        return mavlink.MAVLink_autopilot_version_message(
            capabilities, version, version, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0x26AC, 0x0010, 0x414C4947
        )

    def estimator_status(self) -> Any:
        """ESTIMATOR_STATUS: all that is needed is valid once ready."""
        flags = 0x033F if self._px4.commander.ready else 0x0001
        return mavlink.MAVLink_estimator_status_message(self._us, flags, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.3, 0.6)

    def home_position(self) -> Any:
        """HOME_POSITION: the start."""
        return mavlink.MAVLink_home_position_message(
            round(HOME_LATITUDE_DEG * 1e7),
            round(HOME_LONGITUDE_DEG * 1e7),
            round(HOME_ALTITUDE_M * 1e3),
            *(0.0, 0.0, 0.0),
            [1.0, 0.0, 0.0, 0.0],
            *(0.0, 0.0, 0.0),
            self._us,
        )

    def extended_sys_state(self) -> Any:
        """EXTENDED_SYS_STATE: the land detector."""
        return mavlink.MAVLink_extended_sys_state_message(0, _LANDED[self._px4.landed_state])

    def odometry(self) -> Any:
        """ODOMETRY: pose in the local frame, velocity in the body's."""
        now = self._px4.estimate
        w, x, y, z = now.q
        n, e, d = now.vn, now.ve, now.vd
        forward = (1 - 2 * (y * y + z * z)) * n + 2 * (x * y + w * z) * e + 2 * (x * z - w * y) * d
        right = 2 * (x * y - w * z) * n + (1 - 2 * (x * x + z * z)) * e + 2 * (y * z + w * x) * d
        down = 2 * (x * z + w * y) * n + 2 * (y * z - w * x) * e + (1 - 2 * (x * x + y * y)) * d
        unknown = [math.nan] + [0.0] * 20
        return mavlink.MAVLink_odometry_message(
            *(self._us, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD),
            *(now.n, now.e, now.d, [w, x, y, z], forward, right, down, *now.rates),
            *(unknown, unknown, 0, mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT, 100),
        )

    def current_mode(self) -> Any:
        """CURRENT_MODE: the mode that is flown and the one that was asked for."""
        commander = self._px4.commander
        return mavlink.MAVLink_current_mode_message(0, custom_mode(commander.mode), custom_mode(commander.intent))
