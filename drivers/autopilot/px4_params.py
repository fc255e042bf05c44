"""PX4's parameters over MAVLink: read by name, within a time limit, and compared with what they have to be.

Our own PARAM_REQUEST_READ: the calls of MAVSDK's Param plugin block a thread that neither cancellation nor closing the
link frees. PX4 answers each with a PARAM_VALUE, in which an INT32 stands as its four bytes in the float field.
"""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping
from contextlib import aclosing
from typing import Any

from app.log import get_logger
from app.messages import ParameterFinding
from drivers.autopilot.px4_param_file import ParameterCheck
from drivers.mavsdk_session import RawMessage

INT32, REAL32 = 6, 9
"""MAV_PARAM_TYPE: PX4 has no other types."""
ROUNDS = 3
"""Times that a parameter without an answer is asked for."""
ROUND_S = 0.6
"""Wait for the answers of a round: a serial link at 57600 baud carries 40 of them in 0.3 s."""
SPACING_S = 0.004
"""Between requests, so that PX4's receive buffer holds them."""
READ_MAX_S = ROUNDS * (ROUND_S + 0.4)
"""The whole reading takes no longer than this."""

_log = get_logger("autopilot")


def parameter_value(fields: Mapping[str, Any]) -> float:
    """The value in a PARAM_VALUE of PX4.

    Args:
        fields: By their MAVLink names; a float that is NaN is None.

    Returns:
        The value; NaN for an INT32 whose bytes are a NaN as a float, which MAVSDK does not pass on: a small negative
        number, mostly.
    """
    raw = fields["param_value"]
    if raw is None:
        return math.nan
    if int(fields["param_type"]) != INT32:
        return float(raw)
    return float(struct.unpack("<i", struct.pack("<f", float(raw)))[0])


class Px4Parameters:
    """Reads the parameters of a check when the link opens, and again when asked.

    Args:
        check: What is read and how it has to be; None: nothing is read.
        request: Asks PX4 for the parameter of a name.
    """

    def __init__(self, check: ParameterCheck | None, request: Callable[[str], Awaitable[None]]) -> None:
        self._check = check
        self._request = request
        self._names = frozenset(one.name for one in check.wanted) if check is not None else frozenset()
        self._values: dict[str, float] = {}
        self._unanswered: set[str] = set()
        self._answered = asyncio.Event()
        self._wanted = asyncio.Event()
        self._was_read = asyncio.Event()
        self._told: tuple[str, ...] = ()

    @property
    def findings(self) -> tuple[ParameterFinding, ...]:
        """What is not as it has to be, critical ones first."""
        return self._check.findings(self._values) if self._check is not None else ()

    def read_again(self) -> None:
        """Read all of them now: PX4 restarted, or may have been given other values."""
        self._wanted.set()

    def reason_not_to_arm(self) -> str:
        """The critical findings where the check says that they prevent arming; "" if there is no such reason.

        A reason also has the parameters read again, so that new values are known at the next try.
        """
        if self._check is None or not self._check.must_match:
            return ""
        critical = [finding.brief for finding in self.findings if finding.critical]
        if critical:
            self.read_again()
        return "; ".join(critical)

    async def wait_until_read(self) -> None:
        """Until the first reading is over, complete or not; READ_MAX_S at most."""
        if self._check is None:
            return
        try:
            async with asyncio.timeout(READ_MAX_S):
                await self._was_read.wait()
        except TimeoutError:
            return

    async def run(self, stream: AsyncGenerator[RawMessage, None], system_id: int) -> None:
        """Read now, and whenever asked; take every value that PX4 sends by itself. Never ends by itself.

        Args:
            stream: The PARAM_VALUE messages of the link.
            system_id: PX4's.
        """
        if self._check is None:
            await stream.aclose()
            return
        async with asyncio.TaskGroup() as group:
            group.create_task(self._take(stream, system_id), name="autopilot-parameter-values")
            group.create_task(self._keep_reading(), name="autopilot-parameter-reads")

    async def _take(self, stream: AsyncGenerator[RawMessage, None], system_id: int) -> None:
        async with aclosing(stream):
            async for message in stream:
                name = str(message.fields["param_id"]).rstrip("\x00")
                if name in self._names and (message.system_id, message.component_id) == (system_id, 1):
                    self._values[name] = parameter_value(message.fields)
                    self._unanswered.discard(name)
                    self._answered.set()

    async def _keep_reading(self) -> None:
        while True:
            self._wanted.clear()
            await self._read()
            self._was_read.set()
            self._tell()
            await self._wanted.wait()

    async def _read(self) -> None:
        """Ask for all, then again for those without an answer; what is still without one afterwards is unknown."""
        self._unanswered = set(self._names)
        try:
            async with asyncio.timeout(READ_MAX_S):
                for _ in range(ROUNDS):
                    await self._ask()
        except TimeoutError:
            pass
        for name in self._unanswered:
            self._values.pop(name, None)

    async def _ask(self) -> None:
        """One round."""
        for name in sorted(self._unanswered):
            await self._request(name)
            await asyncio.sleep(SPACING_S)
        try:
            async with asyncio.timeout(ROUND_S):
                while self._unanswered:
                    self._answered.clear()
                    await self._answered.wait()
        except TimeoutError:
            return

    def _tell(self) -> None:
        """Log what differs, and again when that changes."""
        told, self._told = self._told, tuple(finding.brief for finding in self.findings)
        if self._told and self._told != told:
            _log.warning("parameters.differ", count=len(self._told), findings="; ".join(self._told))
        if told and not self._told:
            _log.info("parameters.match")
