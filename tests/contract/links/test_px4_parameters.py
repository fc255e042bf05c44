"""PX4's parameters over the link: read when it opens, compared, told, and what they prevent."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from app.config import AutopilotConfig, SafetyConfig
from app.errors import AutopilotError
from app.messages import AutopilotAction
from drivers.autopilot.px4_mavsdk import Px4Autopilot
from drivers.autopilot.px4_param_file import ParameterCheck, WantedParameter
from drivers.autopilot.px4_params import READ_MAX_S

INT32, REAL32 = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32
ARM = 400
WANTED = (
    WantedParameter("COM_OF_LOSS_T", 0.5, (), "why"),
    WantedParameter("COM_OBL_RC_ACT", 5.0, (), "why"),
    WantedParameter("COM_RC_OVERRIDE", 3.0, (), "why"),
    WantedParameter("CBRK_FLIGHTTERM", 121212.0, (), "why"),
    WantedParameter("BAT_CRIT_THR", 0.12, (), "why"),
)
GOOD: dict[str, float | int] = {
    "COM_OF_LOSS_T": 0.5,
    "COM_OBL_RC_ACT": 5,
    "COM_RC_OVERRIDE": 3,
    "CBRK_FLIGHTTERM": 121212,
    "BAT_CRIT_THR": 0.12,
}


class Parameters:
    """Of the autopilot: answers PARAM_REQUEST_READ by name, ints as their bytes. `lost` answers are left out first."""

    def __init__(self, autopilot: Any, lost: int = 0) -> None:
        self.values = dict(GOOD)
        self._lost = lost
        self._station = autopilot.station
        self._before = self._station.on_message
        self._station.on_message = self._answer

    @property
    def requests(self) -> list[str]:
        return [m.param_id for _, m in self._station.of_kind("PARAM_REQUEST_READ")]

    def send(self, name: str, value: float, component: int = 1) -> None:
        is_int = isinstance(value, int)
        raw = struct.unpack("<f", struct.pack("<i", value))[0] if is_int else value
        message = self._station.mav.param_value_encode(name.encode(), raw, INT32 if is_int else REAL32, 1, 0)
        mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
        self._station.socket.sendto(message.pack(mav), self._station.remote)

    def _answer(self, message: Any) -> None:
        self._before(message)
        if message.get_type() != "PARAM_REQUEST_READ" or message.param_id not in self.values:
            return
        assert (message.target_system, message.target_component, message.param_index) == (1, 1, -1)
        if self._lost > 0:
            self._lost -= 1
        else:
            self.send(message.param_id, self.values[message.param_id])


@pytest.fixture
def make_link(port: int) -> Callable[..., Px4Autopilot]:
    def make(must_match: bool = True) -> Px4Autopilot:
        config = AutopilotConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=10.0)
        return Px4Autopilot(config, ParameterCheck("alight.params", WANTED, SafetyConfig(), must_match))

    return make


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(8.0):
        while not condition():
            await asyncio.sleep(0.02)


def armings(autopilot: Any) -> int:
    return sum(command.command == ARM for command in autopilot.commands)


async def test_parameters_that_are_right_are_read_once_and_arming_is_allowed(autopilot: Any, make_link: Any) -> None:
    parameters = Parameters(autopilot)
    async with make_link() as link:
        assert link.parameter_findings == ()
        await link.execute(AutopilotAction.ARM)
    assert sorted(parameters.requests) == sorted(GOOD)
    assert armings(autopilot) == 1


async def test_parameters_whose_answers_are_lost_are_asked_for_again(autopilot: Any, make_link: Any) -> None:
    parameters = Parameters(autopilot, lost=7)
    async with make_link() as link:
        assert link.parameter_findings == ()
    assert len(parameters.requests) == 5 + 5 + 2


async def test_parameter_that_differs_is_found_and_does_not_prevent_arming(autopilot: Any, make_link: Any) -> None:
    Parameters(autopilot).values["CBRK_FLIGHTTERM"] = 0
    async with make_link() as link:
        assert [finding.brief for finding in link.parameter_findings] == ["CBRK_FLIGHTTERM is 0, must be 121212"]
        await link.execute(AutopilotAction.ARM)
    assert armings(autopilot) == 1


async def test_critical_parameter_that_differs_prevents_arming_in_words(autopilot: Any, make_link: Any) -> None:
    Parameters(autopilot).values["COM_OBL_RC_ACT"] = 0
    async with make_link() as link:
        with pytest.raises(AutopilotError, match=r"COM_OBL_RC_ACT is 0, must be 5; load deploy/px4/alight\.params"):
            await link.execute(AutopilotAction.ARM)
        await link.execute(AutopilotAction.HOLD)
    assert armings(autopilot) == 0


async def test_critical_parameter_that_differs_is_a_warning_where_the_rig_says_so(
    autopilot: Any, make_link: Any
) -> None:
    Parameters(autopilot).values["COM_OBL_RC_ACT"] = 0
    async with make_link(must_match=False) as link:
        assert [finding.critical for finding in link.parameter_findings] == [True]
        await link.execute(AutopilotAction.ARM)
    assert armings(autopilot) == 1


async def test_parameters_are_read_again_after_they_prevented_arming(autopilot: Any, make_link: Any) -> None:
    parameters = Parameters(autopilot)
    parameters.values["COM_RC_OVERRIDE"] = 1
    async with make_link() as link:
        parameters.values["COM_RC_OVERRIDE"] = 3
        with pytest.raises(AutopilotError, match="COM_RC_OVERRIDE is 1"):
            await link.execute(AutopilotAction.ARM)
        await until(lambda: link.parameter_findings == ())
        await link.execute(AutopilotAction.ARM)
    assert armings(autopilot) == 1


async def test_parameter_that_px4_sends_by_itself_is_taken(autopilot: Any, make_link: Any) -> None:
    parameters = Parameters(autopilot)
    async with make_link() as link:
        parameters.send("COM_OF_LOSS_T", 2.0)
        await until(lambda: link.parameter_findings != ())
        assert link.parameter_findings[0].brief == "COM_OF_LOSS_T is 2, must be 0.5"


async def test_parameter_of_another_component_is_not_px4s(autopilot: Any, make_link: Any) -> None:
    parameters = Parameters(autopilot)
    async with make_link() as link:
        parameters.send("COM_OF_LOSS_T", 60.0, component=154)
        parameters.send("BAT_CRIT_THR", 0.05)  # behind it on the same link
        await until(lambda: link.parameter_findings != ())
        assert [finding.name for finding in link.parameter_findings] == ["BAT_CRIT_THR"]


async def test_parameters_without_any_answer_open_the_link_within_a_time_limit_and_prevent_arming(
    autopilot: Any, make_link: Any
) -> None:
    start_s = time.monotonic()
    async with make_link() as link:
        opened_s = time.monotonic() - start_s
        with pytest.raises(AutopilotError, match="PX4 does not tell its failsafe parameters"):
            await link.execute(AutopilotAction.ARM)
    assert opened_s < READ_MAX_S + 4.0
    assert armings(autopilot) == 0


async def test_link_closes_while_parameters_are_read(autopilot: Any, make_link: Any) -> None:
    start_s = time.monotonic()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(1.0), make_link():
            pass
    assert time.monotonic() - start_s < 6.0


async def test_parameters_are_read_again_after_px4_restarted(autopilot: Any, make_link: Any) -> None:
    parameters = Parameters(autopilot)
    async with make_link() as link:
        parameters.values["COM_OF_LOSS_T"] = 1.0
        autopilot.boot_offset_s = time.monotonic() - 1.0
        await until(lambda: link.parameter_findings != ())
        assert link.parameter_findings[0].brief == "COM_OF_LOSS_T is 1, must be 0.5"
