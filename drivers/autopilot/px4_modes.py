"""PX4's flight modes as it codes them in `custom_mode` (px4_custom_mode.h) and takes them in MAV_CMD_DO_SET_MODE."""

from __future__ import annotations

from app.messages import FlightMode

_AUTO = 4
_MAIN = {
    1: FlightMode.MANUAL,
    2: FlightMode.ALTITUDE,
    3: FlightMode.POSITION,
    6: FlightMode.OFFBOARD,
}
_SUB_OF_AUTO = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
    9: FlightMode.PRECLAND,
}

MAIN_SUB: dict[FlightMode, tuple[int, int]] = {
    **{mode: (main, 0) for main, mode in _MAIN.items()},
    **{mode: (_AUTO, sub) for sub, mode in _SUB_OF_AUTO.items()},
}
"""(main, sub) of a mode: parameters 2 and 3 of MAV_CMD_DO_SET_MODE."""


def mode_from_custom(custom_mode: int) -> FlightMode:
    """The flight mode of a `custom_mode`: byte 2 is the main mode, byte 3 the sub mode. PX4 never has 0: UNKNOWN."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main == 0:
        return FlightMode.UNKNOWN
    if main == _AUTO:
        return _SUB_OF_AUTO.get(sub, FlightMode.OTHER)
    return _MAIN.get(main, FlightMode.OTHER)
