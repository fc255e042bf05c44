"""MAVLink's command protocol on the commanding side: send, send again, wait for the final COMMAND_ACK.

Our own, because MAVSDK's send_command blocks a thread that neither cancellation nor closing the link ever frees: an
action without an answer would keep the process from ending. Knows no link: it is given how to send and what arrives.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from app.messages import CommandResult

SENDS = 4
RESEND_S = 0.5
"""As MAVSDK does it: four sends in two seconds."""


class NoAnswerError(Exception):
    """Nothing answered a command, however often it was sent."""


class CommandChannel:
    """Commands to one autopilot; two that have the same number go one after the other, as their answers look alike.

    Args:
        send: Sends the fields of a COMMAND_LONG.
    """

    def __init__(self, send: Callable[[Mapping[str, Any]], Awaitable[None]]) -> None:
        self._send = send
        self._answers: dict[int, asyncio.Queue[int]] = {}
        self._turns: defaultdict[int, asyncio.Lock] = defaultdict(asyncio.Lock)

    def take_ack(self, fields: Mapping[str, Any]) -> None:
        """Take a COMMAND_ACK that is meant for us; one that nothing waits for is ignored."""
        answers = self._answers.get(int(fields["command"]))
        if answers is not None:
            answers.put_nowait(int(fields["result"]))

    async def run(self, fields: Mapping[str, Any], sends: int = SENDS) -> int:
        """Send a COMMAND_LONG and return the MAV_RESULT of its final answer.

        Once IN_PROGRESS has come it is not sent again and waited for without limit: bound the call.

        Args:
            fields: Of the COMMAND_LONG.
            sends: How often at most; 1 for a command that may be wrong half a second later.

        Raises:
            NoAnswerError: No answer came to so many sends.
        """
        command = int(fields["command"])
        async with self._turns[command]:
            answers = self._answers[command] = asyncio.Queue()
            try:
                result = await self._first_answer(fields, answers, sends)
                while result == CommandResult.IN_PROGRESS:
                    result = await answers.get()
                return result
            finally:
                del self._answers[command]

    async def _first_answer(self, fields: Mapping[str, Any], answers: asyncio.Queue[int], sends: int) -> int:
        for confirmation in range(sends):
            await self._send({**fields, "confirmation": confirmation})
            try:
                async with asyncio.timeout(RESEND_S):
                    return await answers.get()
            except TimeoutError:
                continue
        raise NoAnswerError
