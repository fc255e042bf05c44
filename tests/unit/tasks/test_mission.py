"""The mission's loop: commands in, answers, texts, requests and orders out; the last word to a running command."""

from __future__ import annotations

import asyncio
import itertools
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest

from app.channels import Events, Topic
from app.clock import run_virtual
from app.config import EstimationConfig, MissionConfig, SafetyConfig
from app.errors import OperatorError
from app.messages import (
    ActionResult,
    AutopilotAction,
    CameraStatus,
    CommandAnswer,
    CommandResult,
    Detection,
    GoalKind,
    GoalOrder,
    GuidanceStatus,
    LandedState,
    MissionReport,
    OperatorAction,
    OperatorCommand,
    OperatorText,
    PadTrack,
    ParameterFinding,
    Phase,
    Severity,
    TrackCheck,
    VehicleState,
)
from app.tasks.actions import ActionRequest, run_actions
from app.tasks.mission import MissionQueues, MissionSettings, run_mission
from app.tasks.operator import parameter_texts, run_operator

SETTINGS = MissionSettings(MissionConfig(), EstimationConfig(), SafetyConfig())


@dataclass
class Bench:
    """The mission with its queues."""

    vehicle: Topic[VehicleState]
    detections: Topic[Detection]
    commands: Topic[OperatorCommand]
    results: Events[ActionResult]
    orders: Events[GoalOrder]
    requests: Events[ActionRequest]
    answers: Events[CommandAnswer]
    texts: Events[OperatorText]
    reports: Events[MissionReport]
    queues: MissionQueues

    @classmethod
    def make(cls) -> Bench:
        vehicle: Topic[VehicleState] = Topic("vehicle")
        tracks: Topic[PadTrack] = Topic("tracks")
        statuses: Topic[GuidanceStatus] = Topic("statuses")
        detections: Topic[Detection] = Topic("detections")
        commands: Topic[OperatorCommand] = Topic("commands")
        orders: Topic[GoalOrder] = Topic("orders")
        texts: Topic[OperatorText] = Topic("texts")
        reports: Topic[MissionReport] = Topic("reports")
        queues = MissionQueues(
            vehicle.subscribe(),
            tracks.subscribe(),
            statuses.subscribe(),
            detections.subscribe(),
            Topic[CameraStatus]("camera_status").subscribe(),
            Topic[TrackCheck]("track_checks").subscribe(),
            commands.subscribe_all(),
            Events("results"),
            orders,
            Events("requests"),
            Events("answers"),
            texts,
            reports,
        )
        return cls(
            vehicle,
            detections,
            commands,
            queues.results,
            orders.subscribe_all(4096),
            queues.requests,
            queues.answers,
            texts.subscribe_all(),
            reports.subscribe_all(4096),
            queues,
        )

    async def feed(self, fakes: Any, seconds: float, **changes: Any) -> None:
        """Vehicle states and empty detections at 100 Hz."""
        until_s = fakes.clock.now_s() + seconds
        while fakes.clock.now_s() < until_s - 1e-9:
            now_s = fakes.clock.now_s()
            self.vehicle.publish(fakes.vehicle(t_capture_s=now_s, **changes))
            self.detections.publish(Detection(now_s, 0))
            await asyncio.sleep(0.01)


def fly(fakes: Any, scenario: Any) -> Bench:
    async def main() -> Bench:
        bench = Bench.make()
        async with fakes.running(run_mission(queues=bench.queues, settings=SETTINGS, clock=fakes.clock)):
            await scenario(bench)
        return bench

    return run_virtual(main(), start_s=50.0)


def land(number: int = 1) -> OperatorCommand:
    return OperatorCommand(50.0, OperatorAction.LAND, None, (255, 190), number)


def test_mission_renews_its_order_twenty_times_a_second(fakes: Any):
    orders = fly(fakes, lambda b: b.feed(fakes, 1.0)).orders.drain()
    assert 20 <= len(orders) <= 21
    assert all(b.t_s - a.t_s == pytest.approx(0.05) for a, b in itertools.pairwise(orders))
    assert {order.goal.kind for order in orders} == {GoalKind.NONE}


def test_mission_that_is_ordered_to_land_asks_to_arm_and_answers(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.feed(fakes, 0.2)
        bench.commands.publish(land())
        await bench.feed(fakes, 0.2)
        assert bench.answers.get_nowait() == CommandAnswer(1, CommandResult.IN_PROGRESS, 10)
        assert bench.requests.get_nowait().action is AutopilotAction.ARM
        assert bench.texts.get_nowait().text == "takeoff: commanded"
        assert bench.requests.empty()

    fly(fakes, scenario)


def test_mission_that_ends_answers_the_running_command(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.feed(fakes, 0.2)
        bench.commands.publish(land())
        await bench.feed(fakes, 0.2)

    answers = fly(fakes, scenario).answers.drain()
    assert [answer.result for answer in answers] == [CommandResult.IN_PROGRESS, CommandResult.CANCELLED]


def test_mission_that_ends_without_a_command_answers_nothing(fakes: Any):
    assert fly(fakes, lambda b: b.feed(fakes, 0.5)).answers.empty()


def test_mission_without_camera_frames_begins_nothing(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.feed(fakes, 0.2)
        for _ in range(130):  # vehicle states only
            bench.vehicle.publish(fakes.vehicle(t_capture_s=fakes.clock.now_s()))
            await asyncio.sleep(0.01)
        bench.commands.publish(land())
        await asyncio.sleep(0.1)

    bench = fly(fakes, scenario)
    assert [answer.result for answer in bench.answers.drain()] == [CommandResult.TEMPORARILY_REJECTED]
    assert bench.requests.empty()


def test_mission_takes_commands_one_by_one_and_answers_each(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.feed(fakes, 0.2)
        for number in range(1, 6):
            bench.commands.publish(OperatorCommand(50.0, OperatorAction.HOLD, None, (255, 190), number))
        await bench.feed(fakes, 0.5)

    answers = fly(fakes, scenario).answers.drain()
    assert [(a.number, a.result) for a in answers] == [(n, CommandResult.DENIED) for n in range(1, 6)]


def test_mission_whose_vehicle_falls_silent_stops_commanding_within_its_limit(fakes: Any):
    async def scenario(bench: Bench) -> None:
        await bench.feed(fakes, 0.2)
        bench.commands.publish(land())
        await bench.feed(fakes, 0.2)
        bench.results.emit(ActionResult(AutopilotAction.ARM, ok=True))
        await bench.feed(fakes, 0.5, armed=True, landed=LandedState.IN_AIR)
        await asyncio.sleep(0.6)

    bench = fly(fakes, scenario)
    assert bench.reports.drain()[-1].phase is Phase.SUSPENDED
    assert bench.orders.drain()[-1].goal.kind is GoalKind.NONE
    # It may go on; the phone's answer comes at the end of the mission's task.
    assert [a.result for a in bench.answers.drain()] == [CommandResult.IN_PROGRESS, CommandResult.CANCELLED]


# -------------------------------------------------------------------------------------------------- actions, operator
def act(fakes: Any, *asked: tuple[float, AutopilotAction | None], refuses: set[AutopilotAction] = frozenset()) -> Any:
    """The autopilot, whose actions take a second each, and the results, after requests at these times."""

    async def main() -> tuple[Any, list[ActionResult]]:
        requests: Events[ActionRequest] = Events("requests")
        results: Events[ActionResult] = Events("results")
        autopilot = fakes.Autopilot()
        autopilot.takes_s, autopilot.refuses = 1.0, refuses
        async with fakes.running(run_actions(requests=requests, results=results, autopilot=autopilot)):
            loop = asyncio.get_running_loop()
            for at_s, action in asked:
                loop.call_at(at_s, requests.emit, ActionRequest(action, asked_s=at_s))
            await asyncio.sleep(5.0)
            return autopilot, results.drain()

    return run_virtual(main())


def test_action_runs_beside_the_loops_and_is_answered(fakes: Any):
    autopilot, told = act(fakes, (0.5, AutopilotAction.ARM), (2.0, AutopilotAction.HOLD), refuses={AutopilotAction.ARM})
    assert [(result.action, result.ok) for result in told] == [
        (AutopilotAction.ARM, False),
        (AutopilotAction.HOLD, True),
    ]
    assert told[0].detail == "PX4 refused to arm"
    assert autopilot.asked_s == [0.5, 2.0]


def test_new_action_ends_the_one_that_runs_without_a_result(fakes: Any):
    autopilot, told = act(fakes, (0.5, AutopilotAction.ARM), (1.0, AutopilotAction.DISARM))
    assert [action for _, action in autopilot.ended] == [AutopilotAction.ARM]
    assert autopilot.ended[0][0] == pytest.approx(1.0)
    assert [result.action for result in told] == [AutopilotAction.DISARM]


def test_request_without_an_action_ends_the_one_that_runs(fakes: Any):
    autopilot, told = act(fakes, (0.5, AutopilotAction.OFFBOARD), (1.0, None))
    assert [action for _, action in autopilot.ended] == [AutopilotAction.OFFBOARD]
    assert told == []


def test_operator_passes_orders_answers_and_texts_on(fakes: Any):
    async def main() -> tuple[Any, list[OperatorCommand]]:
        link = fakes.Operator()
        commands: Topic[OperatorCommand] = Topic("commands")
        answers: Events[CommandAnswer] = Events("answers")
        texts: Events[OperatorText] = Events("texts")
        taken = commands.subscribe_all()
        async with fakes.running(run_operator(link=link, commands=commands, answers=answers, texts=texts)):
            link.orders.emit(land(7))
            answers.emit(CommandAnswer(7, CommandResult.ACCEPTED))
            texts.emit(OperatorText("landed"))
            await asyncio.sleep(0.1)
        return link, taken.drain()

    link, taken = run_virtual(main())
    assert (taken, link.answers, link.texts) == ([land(7)], [CommandAnswer(7, CommandResult.ACCEPTED)], ["landed"])


def test_operator_whose_phone_is_out_of_reach_goes_on(fakes: Any):
    async def main() -> Any:
        link = fakes.Operator()
        commands: Topic[OperatorCommand] = Topic("commands")
        answers: Events[CommandAnswer] = Events("answers")
        texts: Events[OperatorText] = Events("texts")
        async with fakes.running(run_operator(link=link, commands=commands, answers=answers, texts=texts)):
            link.reachable = False
            with pytest.raises(OperatorError):
                await link.say(OperatorText("lost"))
            answers.emit(CommandAnswer(1, CommandResult.IN_PROGRESS))
            texts.emit(OperatorText("lost"))
            await asyncio.sleep(0.1)
            link.reachable = True
            answers.emit(CommandAnswer(1, CommandResult.ACCEPTED))
            texts.emit(OperatorText("found"))
            await asyncio.sleep(0.1)
        return link

    link = run_virtual(main())
    assert (link.answers, link.texts) == ([CommandAnswer(1, CommandResult.ACCEPTED)], ["found"])


def test_phone_is_told_each_critical_parameter_and_how_many_others_differ():
    finding = partial(ParameterFinding, words="", brief="COM_OF_LOSS_T is 2, must be 0.5")
    texts = parameter_texts([finding("A", critical=True), finding("B", critical=False), finding("C", critical=False)])
    assert [(text.text, text.severity) for text in texts] == [
        ("COM_OF_LOSS_T is 2, must be 0.5", Severity.CRITICAL),
        ("PX4 parameters differ: 2, run alight check", Severity.WARNING),
    ]
    assert parameter_texts([]) == []
