"""The phone over MAVLink: the OperatorLink port, as component 191 of the drone's system.

Over an address of its own, in a MAVSDK instance of its own (what comes in there can't be taken for the autopilot), or
through the autopilot's link, where PX4 forwards the phone's messages. Which answer follows from which message is
decided in conversations; this file moves them.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import aclosing
from types import TracebackType
from typing import Any, Protocol, Self

from mavsdk.asyncio.plugins.mavlink_direct_server import MavlinkDirectServerError, MavlinkMessage

from app.channels import Events
from app.config import OperatorConfig
from app.errors import OperatorError
from app.log import get_logger
from app.messages import CommandAnswer, OperatorCommand, OperatorText, Severity
from drivers.mavsdk_session import COMPONENT_ID, MavsdkSession, RawMessage, encode, messages
from drivers.operator.conversations import REPEAT_S, Ack, Conversations, Decision, screen_text

_log = get_logger("operator")


class HasSession(Protocol):
    """An open autopilot link: what it shares with the phone's."""

    @property
    def session(self) -> MavsdkSession:
        """The MAVSDK instance."""
        ...

    @property
    def system_id(self) -> int:
        """The drone's."""
        ...


class MavlinkOperator:
    """The phone's commands and answers. Its times are CLOCK_MONOTONIC.

    Args:
        config: The address; empty for the autopilot's own link.
        autopilot: Opened before this and closed after it: gives the system id, and the link where config has none.
            None for a link without an autopilot.
        system_id: Ours where there is no autopilot.
    """

    def __init__(self, config: OperatorConfig, autopilot: HasSession | None = None, *, system_id: int = 1) -> None:
        if not config.address and autopilot is None:
            raise OperatorError("operator.address is empty and there is no MAVLink autopilot", "give an address")
        self._config = config
        self._autopilot = autopilot
        self._system_id = system_id
        self._own_session: MavsdkSession | None = None
        self._server: Any = None
        self._background: asyncio.Task[None] | None = None
        self._orders: Events[OperatorCommand | None] = Events("operator orders")
        self._conversations = Conversations((system_id, COMPONENT_ID))

    async def __aenter__(self) -> Self:
        """Listen.

        Raises:
            OperatorError: The address can't work.
        """
        if self._autopilot is not None:
            self._system_id = self._autopilot.system_id
        self._conversations = Conversations((self._system_id, COMPONENT_ID))
        if self._config.address:
            self._own_session = MavsdkSession(self._config.address, self._system_id, OperatorError)
            await self._own_session.open()
            session = self._own_session
        elif self._autopilot is not None:
            session = self._autopilot.session
        try:
            self._server = await session.server()
        except BaseException:
            await self._close()
            raise
        self._background = asyncio.create_task(self._run(), name="operator")
        self._background.add_done_callback(self._on_background_done)
        _log.info("operator.opened", address=self._config.address or "through the autopilot", system_id=self._system_id)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop listening."""
        await self._close()

    async def _close(self) -> None:
        background, self._background = self._background, None
        if background is not None:
            background.cancel()
            await asyncio.wait({background})
        self._server = None
        if self._own_session is not None:
            await self._own_session.close()

    def _on_background_done(self, task: asyncio.Task[None]) -> None:
        self._orders.emit(None)
        if not task.cancelled() and task.exception() is not None:
            _log.error("operator.failed", error=repr(task.exception()))

    async def commands(self) -> AsyncIterator[OperatorCommand]:
        """Orders as they arrive, each once.

        Raises:
            OperatorError: The link was closed.
        """
        while (order := await self._orders.get()) is not None:
            yield order
        raise OperatorError("the link to the phone was closed", "start again")

    async def answer(self, answer: CommandAnswer) -> None:
        """Send an answer; IN_PROGRESS goes on being said until another. One to an order since replaced is left out."""
        ack = self._conversations.answer(answer, time.monotonic())
        if ack is not None:
            await self._send_ack(ack)

    async def say(self, text: OperatorText) -> None:
        """Show a line on every phone."""
        fields = {"severity": int(text.severity), "text": screen_text(text.text), "id": 0, "chunk_seq": 0}
        await self._send("STATUSTEXT", (0, 0), fields)

    # ------------------------------------------------------------------------------------------------------ background
    async def _run(self) -> None:
        async with asyncio.TaskGroup() as group:
            for name in ("COMMAND_LONG", "COMMAND_INT", "COMMAND_CANCEL"):
                group.create_task(self._read(name), name=f"operator-{name}")
            group.create_task(self._hold_mavsdk_back(), name="operator-subscription")
            group.create_task(self._repeat(), name="operator-repeat")

    async def _read(self, name: str) -> None:
        async with aclosing(messages(self._server, name)) as stream:
            async for message in stream:
                await self._act(self._decide(message))

    def _decide(self, message: RawMessage) -> Decision:
        sender, now_s = (message.system_id, message.component_id), time.monotonic()
        if message.name == "COMMAND_CANCEL":
            return self._conversations.take_cancel(message.fields, sender, now_s)
        return self._conversations.take(message.fields, sender, now_s)

    async def _act(self, decision: Decision) -> None:
        if decision.command is not None:
            order = decision.command
            self._orders.emit(order)
        if decision.ack is not None:
            await self._send_ack(decision.ack)
        if decision.text:
            await self.say(OperatorText(decision.text, Severity.WARNING))

    async def _hold_mavsdk_back(self) -> None:
        """While a command is subscribed to, MAVSDK leaves its answer to us; the messages themselves are read raw."""
        async with aclosing(self._server.subscribe_command(31010)) as stream:
            async for _ in stream:
                pass

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(REPEAT_S / 4.0)
            for ack in self._conversations.due(time.monotonic()):
                await self._send_ack(ack)

    async def _send_ack(self, ack: Ack) -> None:
        fields = {
            "command": ack.command,
            "result": int(ack.result),
            "progress": ack.progress_percent,
            "result_param2": 0,
            "target_system": ack.to[0],
            "target_component": ack.to[1],
        }
        await self._send("COMMAND_ACK", ack.to, fields)

    async def _send(self, name: str, to: tuple[int, int], fields: dict[str, Any]) -> None:
        if self._server is None:
            raise OperatorError("the link to the phone is closed", "open it first")
        try:
            await self._server.send_message(MavlinkMessage(name, 0, 0, *to, encode(fields)))
        except MavlinkDirectServerError as fault:
            # No phone has been heard on the address yet: nobody to tell.
            _log.debug("operator.not_sent", message=name, fault=fault.result.name)
