"""PX4's messages to one state, by hand-worked numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.messages import FlightMode, LandedState, VehicleState
from drivers.autopilot.px4_modes import MAIN_SUB, mode_from_custom
from drivers.autopilot.telemetry import VehicleTelemetry

ALL_VALID = 0x3F


def attitude(boot_ms: int, **changes: Any) -> dict[str, Any]:
    still = {"rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0}
    return {"time_boot_ms": boot_ms, "q1": 1.0, "q2": 0.0, "q3": 0.0, "q4": 0.0, **still, **changes}


def position(boot_ms: int, north_m: float = 0.0, **changes: Any) -> dict[str, Any]:
    rest = {"y": 0.0, "z": -4.0, "vx": 0.0, "vy": 0.0, "vz": 0.0}
    return {"time_boot_ms": boot_ms, "x": north_m, **rest, **changes}


def taken(telemetry: VehicleTelemetry, boot_ms: int, arrival_s: float, **changes: Any) -> VehicleState:
    state = telemetry.take("ATTITUDE_QUATERNION", attitude(boot_ms, **changes), arrival_s)
    assert state is not None
    return state


@pytest.fixture
def telemetry() -> VehicleTelemetry:
    telemetry = VehicleTelemetry()
    telemetry.take("ESTIMATOR_STATUS", {"flags": ALL_VALID}, 50.0)
    return telemetry


def test_state_position_is_carried_to_the_attitudes_time(telemetry: VehicleTelemetry) -> None:
    telemetry.take("LOCAL_POSITION_NED", position(1000, 10.0, vx=4.0, vz=-1.0), 101.0)
    state = taken(telemetry, 1020, 101.020)
    assert state.t_capture_s == pytest.approx(101.020)
    np.testing.assert_allclose(state.pos_ned_m, [10.08, 0.0, -4.02])
    np.testing.assert_allclose(state.vel_ned_m_s, [4.0, 0.0, -1.0])
    assert state.connected
    assert state.local_position_ok


def test_state_time_is_the_attitudes_not_its_arrival(telemetry: VehicleTelemetry) -> None:
    taken(telemetry, 1000, 101.0)
    assert taken(telemetry, 1010, 101.150).t_capture_s == pytest.approx(101.010)


def test_state_with_an_old_position_is_not_vouched_for(telemetry: VehicleTelemetry) -> None:
    telemetry.take("LOCAL_POSITION_NED", position(1000), 101.0)
    assert not taken(telemetry, 1400, 101.4).local_position_ok


@pytest.mark.parametrize(
    ("flags", "ok"),
    [
        (0x27 | 0x08, True),  # relative position alone
        (0x27 | 0x10, True),  # absolute position alone
        (0x27, False),  # neither
        (0x3F & ~0x02, False),  # no horizontal velocity
        (0x3F & ~0x20, False),  # no height
    ],
)
def test_state_is_vouched_for_by_the_estimators_flags(flags: int, ok: bool) -> None:
    telemetry = VehicleTelemetry()
    telemetry.take("ESTIMATOR_STATUS", {"flags": flags}, 100.0)
    telemetry.take("LOCAL_POSITION_NED", position(1000), 101.0)
    assert taken(telemetry, 1000, 101.0).local_position_ok is ok


def test_state_keeps_its_order_in_time_when_a_quicker_message_moves_the_clock(telemetry: VehicleTelemetry) -> None:
    late = taken(telemetry, 1000, 101.100)
    assert telemetry.take("ATTITUDE_QUATERNION", attitude(1010), 101.012) is None
    after = taken(telemetry, 1120, 101.122)
    assert after.t_capture_s > late.t_capture_s
    assert after.t_capture_s == pytest.approx(101.122)


@pytest.mark.parametrize("changes", [{"q1": None}, {"q1": 0.0}, {"q3": float("nan")}])
def test_attitude_that_is_none_gives_no_state(telemetry: VehicleTelemetry, changes: dict[str, Any]) -> None:
    assert telemetry.take("ATTITUDE_QUATERNION", attitude(1000, **changes), 101.0) is None


def test_position_that_is_not_finite_is_not_vouched_for(telemetry: VehicleTelemetry) -> None:
    telemetry.take("LOCAL_POSITION_NED", position(1000, x=None), 101.0)
    assert not taken(telemetry, 1000, 101.0).local_position_ok


def test_mode_of_current_mode_outranks_a_heartbeat_of_the_same_moment(telemetry: VehicleTelemetry) -> None:
    telemetry.take("CURRENT_MODE", {"custom_mode": 6 << 16}, 101.0)
    telemetry.take("HEARTBEAT", {"base_mode": 0x81, "custom_mode": 4 << 16 | 3 << 24}, 101.1)
    state = taken(telemetry, 1000, 101.2)
    assert (state.mode, state.armed) == (FlightMode.OFFBOARD, True)


def test_mode_of_a_heartbeat_counts_where_current_mode_has_ceased(telemetry: VehicleTelemetry) -> None:
    telemetry.take("CURRENT_MODE", {"custom_mode": 6 << 16}, 101.0)
    telemetry.take("HEARTBEAT", {"base_mode": 1, "custom_mode": 4 << 16 | 3 << 24}, 102.0)
    assert taken(telemetry, 1000, 102.0).mode is FlightMode.HOLD


@pytest.mark.parametrize(
    ("code", "landed"),
    [
        (0, LandedState.UNKNOWN),
        (1, LandedState.ON_GROUND),
        (2, LandedState.IN_AIR),
        (3, LandedState.TAKING_OFF),
        (4, LandedState.LANDING),
    ],
)
def test_landed_state_is_the_land_detectors(telemetry: VehicleTelemetry, code: int, landed: LandedState) -> None:
    telemetry.take("EXTENDED_SYS_STATE", {"landed_state": code, "vtol_state": 0}, 101.0)
    assert taken(telemetry, 1000, 101.0).landed is landed


@pytest.mark.parametrize(
    ("health", "remaining", "armable", "fraction"), [(1 << 28, 55, True, 0.55), (0xFFFF, -1, False, None)]
)
def test_system_status_tells_armable_and_battery(
    telemetry: VehicleTelemetry, health: int, remaining: int, armable: bool, fraction: float | None
) -> None:
    fields = {"onboard_control_sensors_health": health, "battery_remaining": remaining}
    telemetry.take("SYS_STATUS", fields, 101.0)
    state = taken(telemetry, 1000, 101.0)
    assert (state.armable, state.battery_fraction) == (armable, fraction)


def test_restart_of_the_autopilot_voids_the_position_and_counts(telemetry: VehicleTelemetry) -> None:
    telemetry.take("LOCAL_POSITION_NED", position(90_000), 190.0)
    before = taken(telemetry, 90_000, 190.0)
    after = taken(telemetry, 2_000, 200.0)
    assert (before.frame_resets, after.frame_resets) == (0, 1)
    assert not after.local_position_ok


def test_without_attitude_the_state_is_the_last_one_with_its_own_time(telemetry: VehicleTelemetry) -> None:
    assert telemetry.without_attitude(connected=False) is None
    last = taken(telemetry, 1000, 101.0)
    again = telemetry.without_attitude(connected=False)
    assert again is not None
    assert (again.t_capture_s, again.connected) == (last.t_capture_s, False)


@pytest.mark.parametrize("mode", sorted(MAIN_SUB))
def test_mode_there_and_back_is_the_same(mode: FlightMode) -> None:
    main, sub = MAIN_SUB[mode]
    assert mode_from_custom(main << 16 | sub << 24) is mode


@pytest.mark.parametrize(
    ("custom_mode", "mode"),
    [
        (50593792, FlightMode.HOLD),  # as a PX4 SITL sent it in AUTO.LOITER
        (393216, FlightMode.OFFBOARD),
        (4 << 16 | 8 << 24, FlightMode.OTHER),  # follow me
        (7 << 16, FlightMode.OTHER),  # stabilized
        (0, FlightMode.UNKNOWN),
    ],
)
def test_mode_of_a_custom_mode_is_px4s(custom_mode: int, mode: FlightMode) -> None:
    assert mode_from_custom(custom_mode) is mode
