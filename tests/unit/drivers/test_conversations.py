"""Who is told what, by the time that passes: the parts of the command protocol that need no socket."""

from __future__ import annotations

import math
from typing import Any

import pytest

from app.messages import CommandAnswer, CommandResult, OperatorAction
from drivers.operator.conversations import Conversations, screen_text

OWN, PHONE = (1, 191), (255, 190)


def order(param1: float | None, param2: float | None = None, **changes: Any) -> dict[str, Any]:
    named = {"target_system": 1, "target_component": 191, "command": 31010, "confirmation": 0}
    return {**named, "param1": param1, "param2": param2, **changes}


@pytest.fixture
def conversations() -> Conversations:
    return Conversations(OWN)


@pytest.mark.parametrize(
    ("param2", "height_m"), [(None, None), (0.0, None), (float("nan"), None), (0.5, 0.5), (50, 50)]
)
def test_order_height_left_open_is_the_configured_one(
    conversations: Conversations, param2: float | None, height_m: float | None
) -> None:
    decision = conversations.take(order(2.0, param2), PHONE, 10.0)
    assert decision.command is not None
    assert decision.command.height_m == height_m


@pytest.mark.parametrize("param1", [None, float("nan"), float("inf"), 0.0, -1.0, 5.5, 6.0])
def test_order_that_names_no_action_is_denied(conversations: Conversations, param1: float | None) -> None:
    decision = conversations.take(order(param1), PHONE, 10.0)
    assert decision.command is None
    assert decision.ack is not None
    assert decision.ack.result is CommandResult.DENIED


@pytest.mark.parametrize(
    ("param3", "param4", "north_m_s", "east_m_s"),
    [(4.0, 0.0, 4.0, 0.0), (4.0, 90.0, 0.0, 4.0), (2.0, -150.0, -math.sqrt(3.0), -1.0), (25.0, 180.0, -25.0, 0.0)],
)
def test_order_says_how_the_pad_drives(conversations: Conversations, param3, param4, north_m_s, east_m_s) -> None:
    decision = conversations.take(order(1.0, param3=param3, param4=param4), PHONE, 10.0)
    assert decision.command is not None
    assert decision.command.pad_drives_ne_m_s == pytest.approx((north_m_s, east_m_s))


@pytest.mark.parametrize("param3", [None, 0.0, float("nan")])
def test_order_that_leaves_the_pads_speed_open_says_nothing_of_it(conversations: Conversations, param3) -> None:
    decision = conversations.take(order(1.0, param3=param3, param4=45.0), PHONE, 10.0)
    assert decision.command is not None
    assert decision.command.pad_drives_ne_m_s is None


@pytest.mark.parametrize(("param3", "param4"), [(4.0, None), (4.0, float("nan")), (-1.0, 0.0), (26.0, 0.0)])
def test_order_for_a_pad_that_drives_nowhere_or_too_fast_is_denied_with_words(
    conversations: Conversations, param3, param4
) -> None:
    decision = conversations.take(order(1.0, param3=param3, param4=param4), PHONE, 10.0)
    assert decision.command is None
    assert decision.ack is not None
    assert decision.ack.result is CommandResult.DENIED
    assert decision.text is not None
    assert "pad" in decision.text.lower()


def test_order_pending_is_said_again_every_half_second_until_the_outcome(conversations: Conversations) -> None:
    decision = conversations.take(order(1.0), PHONE, 10.0)
    assert decision.command is not None
    assert conversations.due(10.4) == []
    assert [ack.result for ack in conversations.due(10.5)] == [CommandResult.IN_PROGRESS]
    assert conversations.due(10.9) == []
    conversations.answer(CommandAnswer(decision.command.number, CommandResult.IN_PROGRESS, 130), 11.0)
    assert [ack.progress_percent for ack in conversations.due(11.5)] == [100]
    conversations.answer(CommandAnswer(decision.command.number, CommandResult.FAILED), 11.6)
    assert conversations.due(60.0) == []


@pytest.mark.parametrize(
    ("answered", "confirmation", "after_s", "again"),
    [
        (False, 0, 5.0, False),  # pending: pressed again, or a retransmission
        (False, 1, 5.0, False),
        (True, 0, 0.3, False),  # over a second route
        (True, 1, 3.0, False),  # a retransmission whose answer was lost
        (True, 0, 3.0, True),  # pressed again after the outcome
        (True, 1, 20.0, True),  # too late to be a retransmission
    ],
)
def test_order_that_comes_twice_is_given_twice_only_when_it_is_a_new_one(
    conversations: Conversations, answered: bool, confirmation: int, after_s: float, again: bool
) -> None:
    first = conversations.take(order(1.0), PHONE, 10.0)
    assert first.command is not None
    final = CommandResult.ACCEPTED if answered else CommandResult.IN_PROGRESS
    conversations.answer(CommandAnswer(first.command.number, final), 10.1)
    second = conversations.take(order(1.0, confirmation=confirmation), PHONE, 10.0 + after_s)
    assert (second.command is not None) is again
    assert second.ack is not None
    assert second.ack.result is (CommandResult.IN_PROGRESS if again else final)


@pytest.mark.parametrize("action", [OperatorAction.HOLD, OperatorAction.ABORT])
def test_order_that_stops_the_vehicle_is_obeyed_again_though_it_may_be_a_retransmission(
    conversations: Conversations, action: OperatorAction
) -> None:
    other = (254, 190)
    first = conversations.take(order(float(action)), PHONE, 10.0)
    assert first.command is not None
    conversations.answer(CommandAnswer(first.command.number, CommandResult.ACCEPTED), 10.1)
    assert conversations.take(order(1.0), other, 12.0).command is not None  # somebody else lets it land
    second = conversations.take(order(float(action), confirmation=1), PHONE, 15.0)  # whose first copy was lost
    assert second.command is not None
    assert second.command.action is action


def test_order_with_another_height_is_a_new_one(conversations: Conversations) -> None:
    conversations.take(order(2.0, 2.5), PHONE, 10.0)
    assert conversations.take(order(2.0, 3.0), PHONE, 10.1).command is not None


@pytest.mark.parametrize("command", [512, 520])
def test_command_that_mavsdk_answers_itself_is_left_to_it(conversations: Conversations, command: int) -> None:
    assert conversations.take(order(1.0, command=command), PHONE, 10.0).ack is None


@pytest.mark.parametrize("sender", [OWN, (0, 190), (255, 0)])
def test_order_from_ourselves_or_from_nobody_is_ignored(conversations: Conversations, sender: tuple[int, int]) -> None:
    decision = conversations.take(order(1.0), sender, 10.0)
    assert (decision.command, decision.ack) == (None, None)


def test_cancel_of_nothing_gives_no_order(conversations: Conversations) -> None:
    assert conversations.take_cancel(order(None), PHONE, 10.0).command is None


def test_cancel_that_is_refused_tells_the_refusal(conversations: Conversations) -> None:
    conversations.take(order(1.0), PHONE, 10.0)
    hold = conversations.take_cancel(order(None), PHONE, 11.0).command
    assert hold is not None
    assert hold.action is OperatorAction.HOLD
    ack = conversations.answer(CommandAnswer(hold.number, CommandResult.TEMPORARILY_REJECTED), 11.1)
    assert ack is not None
    assert ack.result is CommandResult.TEMPORARILY_REJECTED


@pytest.mark.parametrize("length", [49, 50, 51, 400])
def test_screen_text_never_exceeds_fifty_characters(length: int) -> None:
    assert len(screen_text("y" * length)) == min(length, 50)
