"""Who asked for what, and what they were told: the MAVLink command protocol on the side that is commanded. Pure.

COMMAND_ACK names the command, not the request, so a phone that gives a second order cannot tell two answers apart:
its newest order is the one that is answered. Orders arrive more than once, by retransmission or over two routes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from app.messages import CommandAnswer, CommandResult, OperatorAction, OperatorCommand

ACTION_COMMAND = 31010
"""MAV_CMD_USER_1: parameter 1 is an OperatorAction, parameter 2 a height in metres (0 or NaN: the configured one)."""
ANSWERED_BY_MAVSDK = frozenset({512, 520})
"""REQUEST_MESSAGE and REQUEST_AUTOPILOT_CAPABILITIES: a second answer would contradict MAVSDK's own."""
HEIGHT_MIN_M, HEIGHT_MAX_M = 0.5, 50.0
"""As mission.track_height_m in the configuration."""
PAD_SPEED_MAX_M_S = 25.0
"""As guidance.speed_max_m_s may be."""
REPEAT_S = 0.5
"""Between two IN_PROGRESS: QGroundControl waits 3 s for an answer, and each IN_PROGRESS restarts that."""
SAME_ORDER_S = 0.5
"""The same order unconfirmed within this time came over a second route."""
RETRANSMISSION_S = 10.0
"""A retransmission is this much younger than its order at most."""
OBEYED_AGAIN = frozenset({OperatorAction.HOLD, OperatorAction.ABORT})
"""Orders that stop the vehicle: one that may be a second order whose first copy was lost is obeyed. What came between,
another phone's order maybe, must not go on because the same was said seconds ago."""

Sender = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Ack:
    """A COMMAND_ACK.

    Attributes:
        to: (system id, component id) that it goes to.
        command: The MAV_CMD that is answered.
        result: MAV_RESULT.
        progress_percent: 0..100 with IN_PROGRESS.
    """

    to: Sender
    command: int
    result: CommandResult
    progress_percent: int = 0


@dataclass(frozen=True, slots=True)
class Decision:
    """What follows from a message: an order for the application, an answer to the phone, a line on its screen."""

    command: OperatorCommand | None = None
    ack: Ack | None = None
    text: str = ""


@dataclass(frozen=True, slots=True)
class _Conversation:
    """The newest order of one sender; it was to cancel the one before if `cancels`."""

    order: OperatorCommand
    ack: Ack
    said_s: float
    cancels: bool = False

    @property
    def pending(self) -> bool:
        return self.ack.result is CommandResult.IN_PROGRESS


class Conversations:
    """The orders under way.

    Args:
        own: (system id, component id) that orders must name: what is sent to all is not for us.
    """

    def __init__(self, own: Sender) -> None:
        self._own = own
        self._numbers = itertools.count(1)
        self._by_sender: dict[Sender, _Conversation] = {}

    def take(self, fields: Mapping[str, Any], sender: Sender, now_s: float) -> Decision:
        """Take a COMMAND_LONG or COMMAND_INT.

        Args:
            fields: By their MAVLink names; NaN as None.
            sender: Who sent it.
            now_s: On our clock.
        """
        if not self._for_us(fields, sender):
            return Decision()
        command = int(fields["command"])
        if command != ACTION_COMMAND:
            if command in ANSWERED_BY_MAVSDK:
                return Decision()
            return Decision(ack=Ack(sender, command, CommandResult.UNSUPPORTED))
        action, height_m = _action(fields.get("param1")), _number(fields.get("param2"))
        if action is None:
            return Decision(ack=self._denied(sender), text=f"Unknown action {fields.get('param1')}")
        if height_m is not None and not HEIGHT_MIN_M <= height_m <= HEIGHT_MAX_M:
            text = f"Height {height_m:g} m not in {HEIGHT_MIN_M:g}..{HEIGHT_MAX_M:g}"
            return Decision(ack=self._denied(sender), text=text)
        speed_m_s, heading_deg = _number(fields.get("param3")), fields.get("param4")
        drives: tuple[float, float] | None = None
        if speed_m_s is not None:
            if heading_deg is None or not math.isfinite(float(heading_deg)):
                return Decision(ack=self._denied(sender), text="A pad that drives wants its heading (parameter 4)")
            if not 0.0 < speed_m_s <= PAD_SPEED_MAX_M_S:
                text = f"Pad speed {speed_m_s:g} m/s not in 0..{PAD_SPEED_MAX_M_S:g}"
                return Decision(ack=self._denied(sender), text=text)
            heading = math.radians(float(heading_deg))
            drives = (speed_m_s * math.cos(heading), speed_m_s * math.sin(heading))
        before = self._by_sender.get(sender)
        asked = (action, height_m, drives)
        if before is not None and (before.order.action, before.order.height_m, before.order.pad_drives_ne_m_s) == asked:
            age_s = now_s - before.order.t_s
            repeated = int(fields.get("confirmation", 0)) > 0 and action not in OBEYED_AGAIN
            if before.pending or age_s < SAME_ORDER_S or (repeated and age_s < RETRANSMISSION_S):
                return Decision(ack=before.ack)
        return self._begin(OperatorCommand(now_s, action, height_m, sender, next(self._numbers), drives))

    def take_cancel(self, fields: Mapping[str, Any], sender: Sender, now_s: float) -> Decision:
        """Take a COMMAND_CANCEL: an order to hold, whose success is told as CANCELLED.

        With nothing under way, the last answer is told again.
        """
        if not self._for_us(fields, sender) or int(fields["command"]) != ACTION_COMMAND:
            return Decision()
        before = self._by_sender.get(sender)
        if before is None or not before.pending or before.cancels:
            return Decision(ack=before.ack if before is not None else None)
        hold = OperatorCommand(now_s, OperatorAction.HOLD, None, sender, next(self._numbers))
        return self._begin(hold, cancels=True)

    def answer(self, answer: CommandAnswer, now_s: float) -> Ack | None:
        """What to send for the application's answer; None if that order is no longer its sender's newest one."""
        for sender, conversation in self._by_sender.items():
            if conversation.order.number != answer.number:
                continue
            result = answer.result
            if conversation.cancels and result is CommandResult.ACCEPTED:
                result = CommandResult.CANCELLED
            ack = Ack(sender, ACTION_COMMAND, result, max(0, min(100, answer.progress_percent)))
            self._by_sender[sender] = replace(conversation, ack=ack, said_s=now_s)
            return ack
        return None

    def due(self, now_s: float) -> list[Ack]:
        """The IN_PROGRESS that are to be said again now."""
        due = []
        for sender, conversation in self._by_sender.items():
            if conversation.pending and now_s - conversation.said_s >= REPEAT_S:
                self._by_sender[sender] = replace(conversation, said_s=now_s)
                due.append(conversation.ack)
        return due

    def _begin(self, order: OperatorCommand, *, cancels: bool = False) -> Decision:
        ack = Ack(order.sender, ACTION_COMMAND, CommandResult.IN_PROGRESS)
        self._by_sender[order.sender] = _Conversation(order, ack, order.t_s, cancels)
        return Decision(command=order, ack=ack)

    def _for_us(self, fields: Mapping[str, Any], sender: Sender) -> bool:
        named = (int(fields["target_system"]), int(fields["target_component"]))
        return named == self._own and sender != self._own and 0 not in sender

    @staticmethod
    def _denied(sender: Sender) -> Ack:
        return Ack(sender, ACTION_COMMAND, CommandResult.DENIED)


def _number(value: Any) -> float | None:
    """A parameter, None where it is left open: NaN, null or 0."""
    if value is None or not math.isfinite(float(value)) or float(value) == 0.0:
        return None
    return float(value)


def _action(value: Any) -> OperatorAction | None:
    number = _number(value)
    if number is None or number != int(number) or int(number) not in set(OperatorAction):
        return None
    return OperatorAction(int(number))


def screen_text(text: str) -> str:
    """A line as STATUSTEXT takes it: at most 50 printable ASCII characters. MAVSDK would send a longer one empty."""
    printable = "".join(c if " " <= c <= "~" else "?" for c in text.replace("\n", " ").strip())
    return printable if len(printable) <= 50 else printable[:47] + "..."
