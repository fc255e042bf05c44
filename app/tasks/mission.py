"""The mission's loop: gathers what is seen, calls the state machine, and passes on what it decides."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass

from app.channels import Events, Latest, Topic
from app.clock import Clock
from app.config import EstimationConfig, MissionConfig, SafetyConfig
from app.estimation.target import is_confident
from app.log import get_logger
from app.messages import (
    ActionResult,
    CameraStatus,
    CommandAnswer,
    CommandResult,
    Detection,
    GoalOrder,
    GuidanceStatus,
    Hazard,
    MissionReport,
    OperatorCommand,
    OperatorText,
    PadTrack,
    Phase,
    Response,
    Severity,
    TrackCheck,
    VehicleState,
    Verdict,
)
from app.mission.endings import is_wound_down
from app.mission.machine import step
from app.mission.rounds import DRIVES_M_S
from app.mission.states import MissionInputs, MissionState, Transition
from app.mission.transitions import guidance_of
from app.safety.disarm import may_force_disarm
from app.safety.monitors import Debounce, SafetyInputs, TrackRestarts, debounce, judge
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
    camera: Latest[CameraStatus]
    track_checks: Latest[TrackCheck]
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


async def run_mission(
    *, queues: MissionQueues, settings: MissionSettings, clock: Clock, stopping: Callable[[], bool] = lambda: False
) -> None:
    """Step the state machine 20 times a second until cancelled; a command that is running then is answered too.

    Args:
        queues: What it reads and writes.
        settings: Of the rig.
        clock: The time.
        stopping: Whether the application is to end: this then returns once the vehicle needs the mission no more.
    """
    state = MissionState(since_s=clock.now_s())
    reason = "started"
    memory, restarts = Debounce(), TrackRestarts()
    warned: frozenset[Hazard] = frozenset()
    try:
        while True:
            now_s = clock.now_s()
            restarts = restarts.see(queues.tracks.newest, now_s)
            seen = _seen(state, queues, len(restarts.times_s))
            memory, confirmed = debounce(memory, judge(seen, now_s, settings.safety), now_s)
            verdict = next((v for v in confirmed if v.response is not Response.WARN), None)
            warned = _warn(confirmed, warned, queues.texts)
            seen_now = _inputs(queues, settings, verdict, now_s, stopping=stopping())
            transition = step(state, seen_now, now_s, settings.mission)
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
            queues.reports.publish(_report(state, seen_now, reason, now_s))
            if seen_now.stopping and is_wound_down(state):
                return
            await asyncio.sleep(PERIOD_S)
    finally:
        if state.command is not None:
            queues.answers.emit(CommandAnswer(state.command.number, CommandResult.CANCELLED))


def _seen(state: MissionState, queues: MissionQueues, restarts_lately: int) -> SafetyInputs:
    detection = queues.detections.newest
    return SafetyInputs(
        vehicle=queues.vehicle.newest,
        home_ned_m=state.home_ned_m,
        last_frame_s=None if detection is None else detection.t_capture_s,
        camera=queues.camera.newest,
        track=queues.tracks.newest,
        track_restarts_lately=restarts_lately,
        track_check=queues.track_checks.newest,
    )


def _warn(confirmed: tuple[Verdict, ...], warned: frozenset[Hazard], texts: Topic[OperatorText]) -> frozenset[Hazard]:
    """Tell the operator of each hazard that only wants a warning, once while it lasts."""
    now = {verdict.hazard: verdict for verdict in confirmed if verdict.response is Response.WARN}
    for hazard, verdict in now.items():
        if hazard not in warned:
            log.warning("hazard.warned", hazard=hazard.value, detail=verdict.detail)
            texts.publish(OperatorText(verdict.detail, Severity.WARNING))
    return frozenset(now)


def _report(state: MissionState, seen: MissionInputs, reason: str, now_s: float) -> MissionReport:
    guidance = guidance_of(state, seen)
    landing = state.phase in (Phase.LAND, Phase.PRECLAND) and guidance is not None
    track = seen.track
    return MissionReport(
        now_s,
        state.phase,
        state.goal.kind,
        reason,
        state.tries,
        state.command.action.name.lower() if state.command is not None else None,
        committed=landing and guidance is not None and guidance.committed,
        contact=landing and guidance is not None and guidance.contact,
        may_force_disarm=landing and seen.may_force_disarm,
        pad_drives=track is not None and math.hypot(track.vel_ned_m_s[0], track.vel_ned_m_s[1]) > DRIVES_M_S,
    )


def _inputs(
    queues: MissionQueues, settings: MissionSettings, verdict: Verdict | None, now_s: float, *, stopping: bool
) -> MissionInputs:
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
        stopping=stopping,
    )


def _pass_on(transition: Transition, queues: MissionQueues, now_s: float) -> None:
    queues.orders.publish(GoalOrder(now_s, transition.state.goal, transition.state.home_ned_m))
    if transition.action is not None or transition.cancels:
        queues.requests.emit(ActionRequest(transition.action, transition.action_height_m, now_s))
    for answer in transition.answers:
        queues.answers.emit(answer)
    for text in transition.texts:
        queues.texts.publish(text)
