"""What PX4 says in words: STATUSTEXT, its events, and what its arming checks find wrong."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from contextlib import aclosing
from typing import Any

from mavsdk.exceptions import MavsdkError

from app.log import get_logger
from drivers.mavsdk_session import messages

AUTOPILOT_COMPONENT = 1
SEVERITY_NOTICE = 5
"""What is less urgent than MAV_SEVERITY_NOTICE is left out."""
SOON_S = 0.4
"""PX4 gives its reason right after its refusal."""
REPORT_S = 1.0

_log = get_logger("autopilot")


class Px4Words:
    """Keeps the newest words.

    Args:
        direct: MavlinkDirectAsync of the autopilot: PX4 sends STATUSTEXT only where a ground station listens.
        events: EventsAsync of the autopilot: this comes on a companion's link too.
    """

    def __init__(self, direct: Any, events: Any) -> None:
        self._direct = direct
        self._events = events
        self._words: deque[tuple[float, str]] = deque(maxlen=16)
        self._spoke = asyncio.Event()

    async def run(self) -> None:
        """Listen until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._read_statustexts(), name="autopilot-statustext")
            group.create_task(self._read_events(), name="autopilot-events")

    async def since(self, start_s: float) -> list[str]:
        """What was said from a time (time.monotonic) on; if nothing yet, what is said soon."""
        try:
            async with asyncio.timeout(SOON_S):
                while not any(t_s >= start_s for t_s, _ in self._words):
                    self._spoke.clear()
                    await self._spoke.wait()
        except TimeoutError:
            return []
        return list(dict.fromkeys(words for t_s, words in self._words if t_s >= start_s))

    async def arming_problems(self) -> list[str]:
        """The three gravest faults that PX4's arming checks find, gravest first; none where it doesn't tell."""
        try:
            async with asyncio.timeout(REPORT_S):
                report = await self._events.get_health_and_arming_checks_report()
        except (TimeoutError, MavsdkError):
            return []
        problems = report.current_mode_intention.problems or report.all_problems
        gravest = sorted(problems, key=lambda problem: int(problem.log_level))
        return list(dict.fromkeys(problem.message for problem in gravest if problem.message))[:3]

    async def _read_statustexts(self) -> None:
        async with aclosing(messages(self._direct, "STATUSTEXT")) as stream:
            async for message in stream:
                if message.component_id == AUTOPILOT_COMPONENT and int(message.fields["severity"]) <= SEVERITY_NOTICE:
                    self._note(str(message.fields["text"]).strip("\x00 \t\n"))

    async def _read_events(self) -> None:
        async with aclosing(self._events.subscribe_events()) as stream:
            async for event in stream:
                if int(event.log_level) <= SEVERITY_NOTICE:
                    self._note(event.message.strip())

    def _note(self, words: str) -> None:
        words = "; ".join(line.strip("- ") for line in words.splitlines())
        self._words.append((time.monotonic(), words))
        self._spoke.set()
        _log.info("autopilot.said", words=words)
