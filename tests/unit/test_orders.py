"""Orders, one after the other, under virtual time. The first one's waiting is told by test_flying."""

from __future__ import annotations

import asyncio

from app.clock import LoopClock, run_virtual
from app.messages import OperatorAction
from app.orders import Caller, Order

CLOCK = LoopClock()


class Phone:
    """Hears what it is told to, after a second; `track` is never answered."""

    def __init__(self, *heard: str) -> None:
        self.heard = list(heard)
        self.asked: list[tuple[float, OperatorAction]] = []
        self.hung_up: list[OperatorAction] = []

    async def __call__(self, action: OperatorAction) -> str:
        self.asked.append((round(CLOCK.now_s(), 1), action))
        try:
            await asyncio.sleep(1e6 if action is OperatorAction.TRACK else 1.0)
        except asyncio.CancelledError:
            self.hung_up.append(action)
            raise
        return self.heard.pop(0)


def call(phone: Phone, second_at_s: float, for_s: float) -> None:
    """TRACK at once, LAND at a time; the mission begins after 2 s."""

    async def main() -> None:
        later = Order(OperatorAction.LAND, lambda: CLOCK.now_s() >= second_at_s)
        caller = Caller((Order(OperatorAction.TRACK), later), phone)
        while CLOCK.now_s() < for_s:
            caller.turn(CLOCK.now_s(), ready=CLOCK.now_s() >= 1.0, begun=CLOCK.now_s() >= 2.0)
            await asyncio.sleep(0.25)
        await caller.hang_up()

    run_virtual(main())


def test_second_order_is_given_once_when_its_time_comes_and_ends_the_first_call():
    phone = Phone("land: accepted")
    call(phone, 7.0, 30.0)
    assert [action for _, action in phone.asked] == [OperatorAction.TRACK, OperatorAction.LAND]
    assert 7.0 <= phone.asked[1][0] <= 7.3
    assert phone.hung_up == [OperatorAction.TRACK]


def test_second_order_waits_for_the_mission_to_begin():
    phone = Phone("land: accepted")
    call(phone, 0.0, 10.0)
    assert [action for _, action in phone.asked] == [OperatorAction.TRACK, OperatorAction.LAND]
    assert phone.asked[1][0] >= 2.0


def test_second_order_that_is_refused_is_given_again_a_second_later():
    phone = Phone("land refused: no autopilot", "land: accepted")
    call(phone, 4.0, 30.0)
    times = [t for t, action in phone.asked if action is OperatorAction.LAND]
    assert len(times) == 2
    assert 2.0 <= times[1] - times[0] <= 2.6
