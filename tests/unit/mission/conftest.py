"""Values that the mission sees, made short: a vehicle, a track, the controller's word, a state in a given phase."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.config import MissionConfig
from app.messages import (
    FlightMode,
    Goal,
    GoalKind,
    GuidanceStatus,
    LandedState,
    OperatorAction,
    OperatorCommand,
    PadTrack,
    Phase,
    VehicleState,
)
from app.mission.states import MissionInputs, MissionState, Suspended

GOAL_OF = {
    Phase.SEARCH: GoalKind.SEARCH,
    Phase.HOVER: GoalKind.HOVER,
    Phase.TRACK: GoalKind.TRACK,
    Phase.LAND: GoalKind.LAND,
    Phase.PRECLAND: GoalKind.PRECLAND,
}
MODE_OF = {
    Phase.TAKEOFF: FlightMode.TAKEOFF,
    Phase.HOLD: FlightMode.HOLD,
    Phase.RETURN: FlightMode.RETURN,
    Phase.FALLBACK_LAND: FlightMode.LAND,
    Phase.PRECLAND: FlightMode.PRECLAND,
}


class Make:
    """Makes values; every figure that a test does not name is harmless."""

    config = MissionConfig()

    @staticmethod
    def vehicle(**changes: Any) -> VehicleState:
        """Armed, in the air, in offboard, 4 m up."""
        state = VehicleState(
            t_capture_s=100.0,
            pos_ned_m=np.array([1.0, 2.0, -4.0]),
            vel_ned_m_s=np.zeros(3),
            q_ned_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            armed=True,
            mode=FlightMode.OFFBOARD,
            landed=LandedState.IN_AIR,
            armable=True,
            local_position_ok=True,
            battery_fraction=0.8,
        )
        return replace(state, **changes)

    @classmethod
    def on_ground(cls, **changes: Any) -> VehicleState:
        """Disarmed, in hold, armable."""
        ground = {"armed": False, "mode": FlightMode.HOLD, "landed": LandedState.ON_GROUND, "pos_ned_m": np.zeros(3)}
        return cls.vehicle(**{**ground, **changes})

    @staticmethod
    def track(**changes: Any) -> PadTrack:
        """A pad at rest, seen at 100 s."""
        track = PadTrack(
            t_capture_s=100.0,
            pos_ned_m=np.array([1.0, 2.0, 0.0]),
            vel_ned_m_s=np.zeros(3),
            covariance=np.eye(6) * 0.01,
            yaw_ned_rad=0.0,
            yaw_rate_rad_s=0.0,
            t_last_fix_s=100.0,
            fixes_accepted=50,
        )
        return replace(track, **changes)

    @staticmethod
    def settled(state: MissionState, now_s: float = 100.0, **changes: Any) -> GuidanceStatus:
        """The controller's word on the state's goal: over the pad, at rest to it, at the goal's height."""
        word = GuidanceStatus(
            t_s=now_s,
            goal_number=state.goal.number,
            horizontal_error_m=0.05,
            height_above_pad_m=state.goal.height_m,
            relative_speed_m_s=0.05,
        )
        return replace(word, **changes)

    @staticmethod
    def command(action: OperatorAction, number: int = 2, height_m: float | None = None) -> OperatorCommand:
        """A command of the phone."""
        return OperatorCommand(100.0, action, height_m, (255, 190), number)

    @classmethod
    def state(cls, phase: Phase, **changes: Any) -> MissionState:
        """A state well inside a phase, entered at 95 s, with LAND (number 1) under way where one can be."""
        active = phase in GOAL_OF or phase is Phase.TAKEOFF
        height_m = 0.0 if phase is Phase.LAND else 2.5
        state = MissionState(
            phase=phase,
            since_s=95.0,
            goal=Goal(GOAL_OF.get(phase, GoalKind.NONE), height_m, np.zeros(3), 7),
            command=cls.command(OperatorAction.LAND, number=1) if active else None,
            home_ned_m=None if phase in (Phase.IDLE, Phase.LANDED) else np.zeros(3),
            offboard_seen=phase in GOAL_OF and phase is not Phase.PRECLAND,
            takeoff_accepted=active,
            entry_mode=FlightMode.TAKEOFF if active else FlightMode.HOLD,
            handed_over=phase in (Phase.HOLD, Phase.RETURN, Phase.FALLBACK_LAND, Phase.PRECLAND),
            arm_asked=active or phase is Phase.DISARM,
            armed_seen=active,
            takeoff_seen=active,
        )
        if phase is Phase.SUSPENDED:
            state = replace(
                state,
                suspended=Suspended(Phase.HOVER, Goal(GoalKind.HOVER, 2.5, np.zeros(3), 6), 0),
                offboard_seen=True,
            )
        return replace(state, **changes)

    @classmethod
    def inputs(cls, state: MissionState, **changes: Any) -> MissionInputs:
        """What is seen when all goes well in that state: on the ground in IDLE and LANDED, else in the air."""
        if state.phase in (Phase.IDLE, Phase.LANDED):
            vehicle = cls.on_ground()
        elif state.phase is Phase.DISARM:
            vehicle = cls.on_ground(armed=True)
        else:
            vehicle = cls.vehicle(mode=MODE_OF.get(state.phase, FlightMode.OFFBOARD))
        steering = state.phase in (Phase.HOVER, Phase.TRACK, Phase.LAND, Phase.PRECLAND)
        seen = MissionInputs(
            vehicle=vehicle,
            track=cls.track() if steering else None,
            track_usable=steering,
            guidance=cls.settled(state),
        )
        return replace(seen, **changes)


@pytest.fixture(scope="session")
def make() -> type[Make]:
    """Makes what the mission sees."""
    return Make
