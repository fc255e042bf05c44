"""The command protocol, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

import pytest

from app.clock import run_virtual
from drivers.autopilot.command_channel import CommandChannel, NoAnswerError


class Peer:
    """Notes what is sent and when, and answers the n-th send with the n-th entry: (delay, result), or None."""

    def __init__(self, *script: tuple[float, int] | None) -> None:
        self.sent: list[tuple[float, int, int]] = []
        self.channel = CommandChannel(self._send)
        self._script = list(script)

    async def _send(self, fields: Mapping[str, Any]) -> None:
        loop = asyncio.get_running_loop()
        self.sent.append((loop.time(), fields["command"], fields["confirmation"]))
        entry = self._script.pop(0) if self._script else None
        if entry is not None:
            ack = {"command": fields["command"], "result": entry[1]}
            loop.call_later(entry[0], self.channel.take_ack, ack)


def test_command_answered_is_sent_once() -> None:
    peer = Peer((0.1, 2))
    assert run_virtual(peer.channel.run({"command": 400})) == 2
    assert peer.sent == [(0.0, 400, 0)]


def test_command_unanswered_is_sent_again_with_its_confirmation() -> None:
    peer = Peer(None, None, (0.1, 0))
    assert run_virtual(peer.channel.run({"command": 400})) == 0
    assert peer.sent == [(0.0, 400, 0), (0.5, 400, 1), (1.0, 400, 2)]


def test_command_never_answered_ends_after_four_sends() -> None:
    peer = Peer()
    with pytest.raises(NoAnswerError):
        run_virtual(peer.channel.run({"command": 400}))
    assert [confirmation for _, _, confirmation in peer.sent] == [0, 1, 2, 3]


def test_command_that_may_be_wrong_a_moment_later_is_sent_once() -> None:
    peer = Peer()
    with pytest.raises(NoAnswerError):
        run_virtual(peer.channel.run({"command": 400}, sends=1))
    assert peer.sent == [(0.0, 400, 0)]


def test_command_in_progress_is_waited_for_and_not_sent_again() -> None:
    async def main() -> int:
        loop = asyncio.get_running_loop()
        loop.call_later(30.0, peer.channel.take_ack, {"command": 400, "result": 0})
        return await peer.channel.run({"command": 400})

    peer = Peer((0.1, 5))
    assert run_virtual(main()) == 0
    assert len(peer.sent) == 1


def test_commands_of_one_number_go_one_after_the_other() -> None:
    async def main() -> list[int]:
        return await asyncio.gather(*(peer.channel.run({"command": 176}) for _ in range(2)))

    peer = Peer((0.2, 0), (0.2, 2))
    assert run_virtual(main()) == [0, 2]
    assert [t_s for t_s, _, _ in peer.sent] == pytest.approx([0.0, 0.2])


def test_commands_of_two_numbers_go_at_once() -> None:
    async def main() -> list[int]:
        return await asyncio.gather(*(peer.channel.run({"command": number}) for number in (176, 400)))

    peer = Peer((0.2, 0), (0.1, 2))
    assert run_virtual(main()) == [0, 2]
    assert [t_s for t_s, _, _ in peer.sent] == [0.0, 0.0]


def test_answer_to_a_command_given_up_is_ignored() -> None:
    async def main() -> int:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.3):
                await peer.channel.run({"command": 176})
        await asyncio.sleep(0.5)
        return await peer.channel.run({"command": 176})

    peer = Peer((0.6, 4), (0.1, 0))
    assert run_virtual(main()) == 0
