"""Parameters of the simulated flight controller, with PX4's own names, types and defaults for a multicopter."""

from __future__ import annotations

DEFAULTS: dict[str, float | int] = {
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_OBL_RC_ACT": 5,
    "COM_OF_LOSS_T": 1.0,
    "COM_RC_IN_MODE": 4,
    "COM_RC_OVERRIDE": 1,
    "LNDMC_ROT_MAX": 20.0,
    "LNDMC_TRIG_TIME": 1.0,
    "LNDMC_XY_VEL_MAX": 1.5,
    "LNDMC_Z_VEL_MAX": 0.25,
    "MAV_SYS_ID": 1,
    "MC_PITCH_P": 6.5,
    "MC_ROLL_P": 6.5,
    "MC_YAW_P": 2.8,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_ACC_DOWN_MAX": 3.0,
    "MPC_ACC_HOR": 3.0,
    "MPC_ACC_UP_MAX": 4.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_LAND_ALT1": 10.0,
    "MPC_LAND_ALT2": 5.0,
    "MPC_LAND_SPEED": 0.7,
    "MPC_THR_HOVER": 0.5,
    "MPC_THR_MIN": 0.12,
    "MPC_TILTMAX_AIR": 45.0,
    "MPC_TILTMAX_LND": 12.0,
    "MPC_TKO_RAMP_T": 3.0,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_P": 0.95,
    "MPC_XY_TRAJ_P": 0.5,
    "MPC_XY_VEL_D_ACC": 0.2,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_Z_P": 1.0,
    "MPC_Z_VEL_D_ACC": 0.0,
    "MPC_Z_VEL_I_ACC": 2.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_P_ACC": 4.0,
    "MPC_Z_V_AUTO_DN": 1.5,
    "MPC_Z_V_AUTO_UP": 3.0,
    "NAV_MC_ALT_RAD": 0.8,
    "RTL_RETURN_ALT": 30.0,
}
"""Those that it flies by. A float's default is written with a point; an int is an INT32 on the link."""

NO_EFFECT: dict[str, float | int] = {
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "CBRK_FLIGHTTERM": 121212,
    "COM_FAIL_ACT_T": 5.0,
    "COM_LKDOWN_TKO": 3.0,
    "COM_LOW_BAT_ACT": 0,
    "COM_POSCTL_NAVL": 0,
    "COM_RCL_EXCEPT": 0,
    "COM_RC_LOSS_T": 0.5,
    "COM_RC_STICK_OV": 30.0,
    "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 2,
    "RTL_CONE_ANG": 45,
    "RTL_DESCEND_ALT": 10.0,
    "RTL_LAND_DELAY": 0.0,
    "RTL_TYPE": 0,
}
"""Those that Alight reads back and a ground station may set, of failsafes that it does not have."""


class Params:
    """Values by name. Setting an unknown name is refused; a name keeps its type."""

    def __init__(self) -> None:
        self._values = DEFAULTS | NO_EFFECT

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def names(self) -> list[str]:
        """All names, in the order of their index on the link."""
        return list(self._values)

    def is_int(self, name: str) -> bool:
        """Whether it is an INT32 (else a REAL32)."""
        return isinstance(self._values[name], int)

    def set(self, name: str, value: float) -> bool:
        """Set one; False if there is no such parameter."""
        if name not in self._values:
            return False
        self._values[name] = int(value) if self.is_int(name) else float(value)
        return True
