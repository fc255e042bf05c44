"""The mission's loop: gathers what is seen, calls the state machine, and passes on what it decides."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from app.channels import Events, Latest, Topic
from app.clock import Clock
from app.config import EstimationConfig, MissionConfig, SafetyConfig
from app.estimation.target import is_confident
from app.log import get_logger
from app.messages import (
    ActionResult,
    CommandAnswer,
    CommandResult,
    Detection,
    GoalOrder,
    GuidanceStatus,
    MissionReport,
    OperatorCommand,
    OperatorText,
    PadTrack,
    VehicleState,
    Verdict,
)
from app.mission.machine import step
from app.mission.states import MissionInputs, MissionState, Transition
from app.safety.disarm import may_force_disarm
from app.safety.monitors import Vigil, confirm, judge
from app.tasks.actions import ActionRequest

log = get_logger("mission")

PERIOD_S = 0.05


@dataclass(frozen=True, slots=True)
class MissionQueues:
    """What the mission reads and writes."""

    vehicle: Latest[VehicleState]
    tracks: Latest[PadTrack]
    statuses: Latest[GuidanceStatus]
    detections: Latest[Detection]
    commands: Events[OperatorCommand]
    results: Events[ActionResult]
    orders: Topic[GoalOrder]
    requests: Events[ActionRequest]
    answers: Events[CommandAnswer]
    texts: Topic[OperatorText]
    reports: Topic[MissionReport]


@dataclass(frozen=True, slots=True)
class MissionSettings:
    """The sections of the configuration that the mission reads, and whether PX4 is to fly a landing."""

    mission: MissionConfig
    estimation: EstimationConfig
    safety: SafetyConfig
    px4_lands: bool = False


async def run_mission(*, queues: MissionQueues, settings: MissionSettings, clock: Clock) -> None:
    """Step the state machine 20 times a second until cancelled; a command that is running then is answered too."""
    state = MissionState(since_s=clock.now_s())
    reason = "started"
    vigil = Vigil()
    try:
        while True:
            now_s = clock.now_s()
            vigil, verdict = confirm(vigil, _judge(state, queues, settings, now_s), now_s)
            transition = step(state, _inputs(queues, settings, verdict, now_s), now_s, settings.mission)
            if transition.reason is not None:
                reason = transition.texts[0].text if transition.texts else transition.reason.value
                log.info(
                    "phase.entered",
                    phase=transition.state.phase.value,
                    before=state.phase.value,
                    reason=transition.reason.value,
                    tries=transition.state.tries,
                )
            state = transition.state
            _pass_on(transition, queues, now_s)
            command = state.command.action.name.lower() if state.command is not None else None
            queues.reports.publish(MissionReport(now_s, state.phase, state.goal.kind, reason, state.tries, command))
            await asyncio.sleep(PERIOD_S)
    finally:
        if state.command is not None:
            queues.answers.emit(CommandAnswer(state.command.number, CommandResult.CANCELLED))


def _judge(state: MissionState, queues: MissionQueues, settings: MissionSettings, now_s: float) -> Verdict | None:
    detection = queues.detections.newest
    last_frame_s = None if detection is None else detection.t_capture_s
    return judge(queues.vehicle.newest, state.home_ned_m, last_frame_s, now_s, settings.safety)


def _inputs(queues: MissionQueues, settings: MissionSettings, verdict: Verdict | None, now_s: float) -> MissionInputs:
    vehicle, track, guidance = queues.vehicle.newest, queues.tracks.newest, queues.statuses.newest
    usable = (
        track is not None
        and is_confident(track, settings.estimation)
        and now_s - track.t_last_fix_s <= settings.safety.track_stale_s
    )
    allowed = vehicle is not None and guidance is not None and may_force_disarm(vehicle, track, guidance, now_s)
    return MissionInputs(
        vehicle=vehicle,
        track=track,
        track_usable=usable,
        guidance=guidance,
        verdict=verdict,
        command=None if queues.commands.empty() else queues.commands.get_nowait(),
        results=tuple(queues.results.drain()),
        may_force_disarm=allowed,
        px4_lands=settings.px4_lands,
    )


def _pass_on(transition: Transition, queues: MissionQueues, now_s: float) -> None:
    queues.orders.publish(GoalOrder(now_s, transition.state.goal))
    if transition.action is not None:
        queues.requests.emit(ActionRequest(transition.action, transition.action_height_m))
    for answer in transition.answers:
        queues.answers.emit(answer)
    for text in transition.texts:
        queues.texts.publish(text)
