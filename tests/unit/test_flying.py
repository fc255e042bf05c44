"""Attending a flight, under virtual time: when the phone speaks, when it is over, and what else ends it."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app import flying
from app.channels import Topic
from app.clock import LoopClock, run_virtual
from app.errors import AlightError
from app.flying import Ended, Plan, Seen
from app.messages import Detection, GoalKind, MissionReport, OperatorAction, Phase, VehicleState
from app.orders import Order

CLOCK = LoopClock()


class Bench:
    """An application that runs until told otherwise, a display that shows nothing, and a phone that is refused."""

    def __init__(self, **plan: Any) -> None:
        rig = SimpleNamespace(
            config=SimpleNamespace(operator=SimpleNamespace(address="udpin://127.0.0.1:1"), simulator=None)
        )
        self.plan = Plan("test", rig, None, **plan)  # type: ignore[arg-type]  # a stand-in
        self.reports: Topic[MissionReport] = Topic("reports")
        self.vehicle: Topic[VehicleState] = Topic("vehicle")
        self.asked_s: list[float] = []
        self.heard: list[str] = []
        self.shown = 0
        self.answers_after_s: float | None = 0.2
        self.detections: Topic[Detection] = Topic("detections")
        self.seen = Seen(self.reports.subscribe(), self.vehicle.subscribe(), self.detections.subscribe())

    def refresh(self, now_s: float) -> None:
        self.shown += 1

    def is_in(self, phase: Phase, command: str | None = None) -> None:
        self.reports.publish(MissionReport(CLOCK.now_s(), phase, GoalKind.NONE, "", 0, command))

    def is_ready(self) -> None:
        zeros = np.zeros(3)
        self.vehicle.publish(VehicleState(CLOCK.now_s(), zeros, zeros, np.array([1.0, 0, 0, 0]), armable=True))

    async def phone(self, address: str, order: OperatorAction) -> str:
        self.asked_s.append(CLOCK.now_s())
        try:
            await asyncio.sleep(1e6 if self.answers_after_s is None else self.answers_after_s)
        except asyncio.CancelledError:
            self.heard.append("cancelled")
            raise
        self.heard.append("answered")
        return "refused: not ready"


@pytest.fixture
def attend(monkeypatch):
    """Attend a bench through a scenario: (how it ended, when)."""

    def run(bench: Bench, scenario: Any, runs_s: float = 1e6) -> tuple[Ended, float]:
        monkeypatch.setattr(flying, "time", SimpleNamespace(monotonic=CLOCK.now_s))
        monkeypatch.setattr(flying, "_phone", bench.phone)

        async def main() -> tuple[Ended, float]:
            running = asyncio.create_task(asyncio.sleep(runs_s))
            acting = asyncio.create_task(scenario(bench))
            try:
                ended = await flying._attend(bench.plan, running, bench.seen, bench)  # type: ignore[arg-type]  # a stand-in
                return ended, CLOCK.now_s()
            finally:
                running.cancel()
                await acting
                await asyncio.gather(running, return_exceptions=True)

        return run_virtual(main())

    return run


async def mission(bench: Bench, end: Phase = Phase.LANDED) -> None:
    bench.is_in(Phase.IDLE)
    bench.is_ready()
    await asyncio.sleep(5.0)
    bench.is_in(Phase.TRACK, "land")
    await asyncio.sleep(5.0)
    bench.is_in(end)


@pytest.mark.parametrize("end", [Phase.LANDED, Phase.HOLD, Phase.IDLE])
def test_attend_once_ends_a_while_after_the_mission(attend, end):
    ended, at_s = attend(Bench(once=True), lambda bench: mission(bench, end))
    assert ended is Ended.OVER
    assert 11.5 <= at_s <= 12.5


def test_attend_once_goes_on_while_a_command_still_runs(attend):
    async def holding(bench: Bench) -> None:
        bench.is_in(Phase.TRACK, "land")
        await asyncio.sleep(1.0)
        bench.is_in(Phase.HOLD, "land")
        await asyncio.sleep(20.0)
        bench.is_in(Phase.HOLD)

    assert attend(Bench(once=True), holding)[1] > 22.0


def test_attend_without_once_goes_on_until_the_application_ends(attend):
    bench = Bench()
    ended, at_s = attend(bench, mission, runs_s=100.0)
    assert (ended, at_s) == (Ended.OVER, 100.0)
    assert bench.shown > 300


def test_attend_ends_when_its_time_is_up(attend):
    ended, at_s = attend(Bench(once=True, timeout_s=30.0), lambda bench: asyncio.sleep(0))
    assert ended is Ended.TIMED_OUT
    assert at_s == pytest.approx(30.0, abs=0.5)


def test_phone_speaks_when_the_vehicle_is_ready_and_hears_the_end(attend):
    async def getting_ready(bench: Bench) -> None:
        bench.is_in(Phase.IDLE)
        await asyncio.sleep(3.0)
        await mission(bench)

    bench = Bench(orders=(Order(OperatorAction.LAND),), once=True)
    bench.answers_after_s = 12.0
    ended, _ = attend(bench, getting_ready)
    assert ended is Ended.OVER
    (asked_s,) = bench.asked_s
    assert 3.0 <= asked_s <= 3.5
    assert bench.heard == ["answered"]


def test_phone_that_was_refused_asks_again_until_the_mission_begins(attend):
    bench = Bench(orders=(Order(OperatorAction.LAND),), once=True)
    attend(bench, mission)
    assert len(bench.asked_s) > 2
    assert (np.diff(bench.asked_s) > 1.0).all()
    assert max(bench.asked_s) < 5.5


def test_flight_that_does_not_begin_is_an_error_with_what_the_phone_was_told(attend):
    async def waiting(bench: Bench) -> None:
        bench.is_in(Phase.IDLE)
        bench.is_ready()

    bench = Bench(orders=(Order(OperatorAction.LAND),), once=True)
    with pytest.raises(AlightError, match="no flight began within 60 s: refused: not ready"):
        attend(bench, waiting)


def test_vehicle_that_never_gets_ready_is_an_error_that_says_so(attend):
    bench = Bench(orders=(Order(OperatorAction.LAND),), once=True)
    with pytest.raises(AlightError, match="the vehicle did not become ready to arm"):
        attend(bench, lambda bench: asyncio.sleep(0))
    assert bench.asked_s == []


def px4_bench() -> Bench:
    bench = Bench(orders=(Order(OperatorAction.LAND),), once=True)
    world = SimpleNamespace(vehicle="px4", px4_truth_address="udpin:127.0.0.1:19410")
    bench.plan.rig.config.simulator = world
    return bench


def test_px4_without_ground_truth_is_told_with_its_address_and_what_to_start(attend):
    async def waiting(bench: Bench) -> None:
        bench.is_in(Phase.IDLE)
        bench.is_ready()

    with pytest.raises(AlightError, match=r"udpin:127\.0\.0\.1:19410 within 20 s; start PX4 with PX4_SIM_MODEL=sihsim"):
        attend(px4_bench(), waiting)


def test_px4_that_flies_already_is_refused(attend):
    async def flying_already(bench: Bench) -> None:
        bench.is_in(Phase.IDLE)
        zeros = np.zeros(3)
        bench.vehicle.publish(VehicleState(0.0, zeros, zeros, np.array([1.0, 0, 0, 0]), armable=True, armed=True))

    bench = px4_bench()
    with pytest.raises(AlightError, match="PX4 is armed already; land and disarm it"):
        attend(bench, flying_already)
    assert bench.asked_s == []


def test_phone_that_is_still_speaking_is_ended_with_the_application(attend):
    async def ready(bench: Bench) -> None:
        bench.is_in(Phase.IDLE)
        bench.is_ready()

    bench = Bench(orders=(Order(OperatorAction.LAND),))
    bench.answers_after_s = None
    attend(bench, ready, runs_s=5.0)
    assert bench.heard == ["cancelled"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
async def test_signal_stops_the_application_and_is_remembered(number):
    stopped = asyncio.Event()
    before = signal.getsignal(number)
    came = flying._stop_on_signals(SimpleNamespace(stop=stopped.set))  # type: ignore[arg-type]  # a stand-in
    try:
        signal.raise_signal(number)
        async with asyncio.timeout(5.0):
            await stopped.wait()
        assert came == [number]
    finally:
        for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().remove_signal_handler(each)
        signal.signal(number, before)


async def test_terminal_that_hangs_up_is_outlived_where_that_was_asked_for():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        flying._stop_on_signals(SimpleNamespace(stop=None))  # type: ignore[arg-type]  # a stand-in
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        for each in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().remove_signal_handler(each)
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(("folder", "files"), [(None, (None, None)), (Path("a"), ("a/flight.mcap", "a/truth.jsonl"))])
def test_plan_names_its_files_in_its_folder(folder, files):
    plan = Plan("test", None, folder)  # type: ignore[arg-type]  # a stand-in
    assert (plan.record and str(plan.record), plan.truth and str(plan.truth)) == files
