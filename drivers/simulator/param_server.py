"""PX4's parameters over MAVLink: integers travel as their bytes in the float field, as PX4 does it."""

from __future__ import annotations

import struct
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from drivers.simulator.params import Params


class ParamServer:
    """Answers of the parameter protocol."""

    def __init__(self, params: Params) -> None:
        self._params = params

    def read(self, name: str, index: int) -> Any:
        """PARAM_VALUE of one, by index or (index -1) by name; None if there is none."""
        names = self._params.names()
        if 0 <= index < len(names):
            return self._value(names[index])
        return self._value(name) if name in self._params else None

    def everything(self) -> list[Any]:
        """PARAM_VALUE of all."""
        return [self._value(name) for name in self._params.names()]

    def write(self, name: str, value: float, kind: int) -> Any:
        """Set one and echo it; None if there is none of that name and type."""
        if name not in self._params:
            return None
        is_int = kind == mavlink.MAV_PARAM_TYPE_INT32
        if is_int == self._params.is_int(name):
            self._params.set(name, struct.unpack("<i", struct.pack("<f", value))[0] if is_int else value)
        return self._value(name)

    def _value(self, name: str) -> Any:
        params = self._params
        names = params.names()
        is_int = params.is_int(name)
        value = struct.unpack("<f", struct.pack("<i", int(params[name])))[0] if is_int else params[name]
        kind = mavlink.MAV_PARAM_TYPE_INT32 if is_int else mavlink.MAV_PARAM_TYPE_REAL32
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(names), names.index(name))
