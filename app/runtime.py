"""The application: opens the ports, starts the tasks, and goes down in order.

Critical tasks (telemetry, control, mission, operator, actions) end the application when they fail; camera, detection,
pose and recorder are started again a bounded number of times, and a flight goes on without its record. Whatever ends
it, a vehicle that Alight was steering is told to hold (supervision.py has how).
"""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from app.channels import Events, Topic
from app.clock import Clock
from app.config import RigConfig
from app.errors import AlightError
from app.estimation.copy_check import CopyCheck
from app.estimation.target import TargetEstimator
from app.estimation.vehicle_history import VehicleHistory
from app.guidance.envelope import envelope_of
from app.guidance.precland import PrecisionLanding
from app.guidance.velocity import VelocityController
from app.log import get_logger
from app.messages import (
    ActionResult,
    CameraStatus,
    CommandAnswer,
    ControlTurn,
    Detection,
    ExposureCommand,
    Frame,
    GoalOrder,
    GuidanceStatus,
    MissionReport,
    OperatorCommand,
    OperatorText,
    PadFix,
    PadTrack,
    Phase,
    TrackCheck,
    VehicleState,
)
from app.ports import Autopilot, Camera, OperatorLink, Recorder
from app.supervision import answer_last, first_error, hold_vehicle, supervise
from app.systemd import Watchdog
from app.tasks.actions import ActionRequest, run_actions
from app.tasks.camera import run_camera
from app.tasks.compute import Compute
from app.tasks.control import run_control
from app.tasks.detection import run_detection
from app.tasks.exposure import run_exposure
from app.tasks.mission import MissionQueues, MissionSettings, run_mission
from app.tasks.operator import parameter_texts, run_operator
from app.tasks.pose import FixMaker, run_pose
from app.tasks.recorder import Recorded, Thinned, run_recorder
from app.tasks.telemetry import run_telemetry
from app.vision.detector import Detector
from app.vision.exposure import ExposureSteering

log = get_logger("runtime")

T = TypeVar("T")

METERED_FRAMES = 8
"""Frames that wait for their detection, to be metered with it."""
EXECUTOR_THREADS = 16
"""MAVSDK's calls wait in the loop's default executor: a few hanging actions must not use it up."""
WIND_DOWN_MAX_S = 20.0
"""8 s to finish a landing, and then PX4's answer to a landing or a hold, asked for three times."""
CLOSING_S = 20.0
"""systemd waits this long for everything to be closed: the record alone may take 10 s. The hold's time comes on top."""


@dataclass(frozen=True, slots=True)
class Parts:
    """What the application is made of.

    Attributes:
        config: The rig.
        camera: Makes a camera; called again for each restart.
        autopilot: The vehicle.
        operator: The phone.
        recorder: The flight record, or None.
        detector: Vision.
        make_fix: Pose.
        clock: The time.
        compute: Where vision runs.
        exposure: Steers the camera's exposure; None: the camera exposes by itself.
    """

    config: RigConfig
    camera: Callable[[], Camera]
    autopilot: Autopilot
    operator: OperatorLink
    recorder: Recorder | None
    detector: Detector
    make_fix: FixMaker
    clock: Clock
    compute: Compute
    exposure: ExposureSteering | None = None


class Application:
    """One flight computer's worth of tasks.

    Args:
        parts: What it is made of.

    The topics are public: whoever wants to watch subscribes before `run`.
    """

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._stop = asyncio.Event()
        self.frames: Topic[Frame] = Topic("frames")
        self.detections: Topic[Detection] = Topic("detections")
        self.camera_status: Topic[CameraStatus] = Topic("camera_status")
        self.track_checks: Topic[TrackCheck] = Topic("track_checks")
        self.exposures: Topic[ExposureCommand] = Topic("exposures")
        self.fixes: Topic[PadFix] = Topic("fixes")
        self.tracks: Topic[PadTrack] = Topic("tracks")
        self.vehicle: Topic[VehicleState] = Topic("vehicle")
        self.orders: Topic[GoalOrder] = Topic("orders")
        self.statuses: Topic[GuidanceStatus] = Topic("statuses")
        self.turns: Topic[ControlTurn] = Topic("turns")
        self.reports: Topic[MissionReport] = Topic("reports")
        self.commands: Topic[OperatorCommand] = Topic("commands")
        self.texts: Topic[OperatorText] = Topic("texts")
        self._answers: Events[CommandAnswer] = Events("answers")
        self._last_report = self.reports.subscribe()
        self._last_vehicle = self.vehicle.subscribe()
        self._last_frame = self.frames.subscribe()
        self._metered_frames = self.frames.subscribe_window(METERED_FRAMES)
        self._metered_detections = self.detections.subscribe()
        self._opened_camera: Camera | None = None

    def stop(self) -> None:
        """Ask for an orderly end: hold if Alight is steering, then stop."""
        self._stop.set()

    async def run(self) -> None:
        """Open everything, fly until `stop`, close everything.

        Raises:
            AlightError: A port doesn't open, or a critical part failed.
        """
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(EXECUTOR_THREADS, "mavsdk"))
        watchdog = Watchdog()
        try:
            async with AsyncExitStack() as stack:
                links = await self._unless_stopped(self._open(stack))
                if links is not None:
                    await self._fly_and_hold(*links, watchdog)
        finally:
            watchdog.close()

    async def _open(self, stack: AsyncExitStack) -> tuple[Autopilot, OperatorLink]:
        """Open the ports: first the camera, which tells at once, then the links, and the record of what there is."""
        parts = self._parts
        self._opened_camera = await parts.camera().__aenter__()
        stack.push_async_callback(self._close_unused_camera)
        autopilot = await stack.enter_async_context(parts.autopilot)
        operator = await stack.enter_async_context(parts.operator)
        if parts.recorder is not None:
            await stack.enter_async_context(parts.recorder)
        return autopilot, operator

    async def _unless_stopped(self, opening: Coroutine[Any, Any, T]) -> T | None:
        """What a coroutine returns; None, and it is cancelled, if `stop` comes first: links may take minutes."""
        tasks = asyncio.create_task(opening, name="opening"), asyncio.create_task(self._stop.wait(), name="stop")
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            return tasks[0].result() if tasks[0].done() else None
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _fly_and_hold(self, autopilot: Autopilot, operator: OperatorLink, watchdog: Watchdog) -> None:
        """Fly; whatever goes wrong, hold the vehicle before anything else is done, and answer the phone at the end."""
        gc.collect()
        gc.freeze()  # what lives as long as the application needs no more looking at: no pauses from it
        try:
            await self._fly(autopilot, operator, watchdog)
        except asyncio.CancelledError:
            await self._hold(autopilot)
            raise
        except BaseExceptionGroup as group:
            await self._hold(autopilot)
            first = first_error(group)
            log.error("part.failed", error=str(first))
            if isinstance(first, AlightError):
                raise first from group
            raise
        finally:
            await answer_last(operator, self._answers.drain())

    async def _fly(self, autopilot: Autopilot, operator: OperatorLink, watchdog: Watchdog) -> None:
        parts, config = self._parts, self._parts.config
        requests: Events[ActionRequest] = Events("requests")
        results: Events[ActionResult] = Events("results")
        commands = self.commands.subscribe_all()
        answers = self._answers
        texts = self.texts.subscribe_all()
        for text in parameter_texts(autopilot.parameter_findings):
            self.texts.publish(text)
        queues = MissionQueues(
            vehicle=self.vehicle.subscribe(),
            tracks=self.tracks.subscribe(),
            statuses=self.statuses.subscribe(),
            detections=self.detections.subscribe(),
            camera=self.camera_status.subscribe(),
            track_checks=self.track_checks.subscribe(),
            commands=commands,
            results=results,
            orders=self.orders,
            requests=requests,
            answers=answers,
            texts=self.texts,
            reports=self.reports,
        )
        pose = partial(
            run_pose,
            detections=self.detections.subscribe(),
            vehicle=self.vehicle.subscribe_window(int(2 * config.autopilot.telemetry_rate_hz)),
            fixes=self.fixes,
            tracks=self.tracks,
            checks=self.track_checks,
            history=VehicleHistory(config.estimation.history_s),
            make_fix=parts.make_fix,
            estimator=TargetEstimator(config.estimation),
            copy_check=CopyCheck(),
            compute=parts.compute,
        )
        control = run_control(
            orders=self.orders.subscribe(),
            tracks=self.tracks.subscribe(),
            vehicle=self.vehicle.subscribe(),
            statuses=self.statuses,
            turns=self.turns,
            controller=VelocityController(config.guidance, config.safety),
            precland=PrecisionLanding(config.guidance, config.safety),
            autopilot=autopilot,
            envelope=envelope_of(config),
            safety=config.safety,
            estimation=config.estimation,
            rate_hz=config.autopilot.setpoint_rate_hz,
            clock=parts.clock,
            alive=watchdog.alive,
        )
        settings = MissionSettings(
            config.mission, config.estimation, config.safety, px4_lands=config.guidance.method == "px4-precland"
        )
        frames = self.frames.subscribe()
        detector, compute = parts.detector, parts.compute

        def detection() -> Awaitable[None]:
            return run_detection(frames=frames, detections=self.detections, detector=detector, compute=compute)

        async with asyncio.TaskGroup() as group:
            mission = group.create_task(
                run_mission(queues=queues, settings=settings, clock=parts.clock, stopping=self._stop.is_set),
                name="mission",
            )
            tasks = [
                group.create_task(run_telemetry(autopilot=autopilot, vehicle=self.vehicle), name="telemetry"),
                group.create_task(self._supervise("pose", pose), name="pose"),
                (steering := group.create_task(control, name="control")),
                group.create_task(run_actions(requests=requests, results=results, autopilot=autopilot), name="actions"),
                group.create_task(
                    run_operator(link=operator, commands=self.commands, answers=answers, texts=texts), name="operator"
                ),
                group.create_task(self._supervise("camera", self._camera), name="camera"),
                group.create_task(self._supervise("detection", detection), name="detection"),
            ]
            if parts.recorder is not None:
                record = partial(run_recorder, recorder=parts.recorder, recorded=self._recorded(), clock=parts.clock)
                tasks.append(group.create_task(self._supervise("recorder", record, vital=False), name="recorder"))
            # Its turns feed the watchdog. Whatever ends them, what follows may take longer than the watchdog waits.
            steering.add_done_callback(lambda _: watchdog.stopping(self._hold_timeout_s + CLOSING_S))
            watchdog.ready()
            log.info("application.started", setpoint_rate_hz=config.autopilot.setpoint_rate_hz)
            await self._stop.wait()
            log.info("application.stopping")
            # It finishes a landing on the pad, or has PX4 hold. Then it asks for nothing behind the hold.
            await asyncio.wait([mission], timeout=WIND_DOWN_MAX_S)
            mission.cancel()
            await self._hold(autopilot)
            for task in tasks:
                task.cancel()

    def _recorded(self) -> tuple[Recorded, ...]:
        steady: tuple[Topic[object], ...] = (  # type: ignore[assignment]  # a record takes every type
            self.detections,
            self.fixes,
            self.tracks,
            self.vehicle,
            self.turns,
            self.reports,
            self.camera_status,
            self.track_checks,
        )
        rare: tuple[Topic[object], ...] = (self.exposures, self.texts, self.commands)  # type: ignore[assignment]  # as above
        vehicle = self.vehicle.subscribe()

        def flying() -> bool:
            """Images are most of a record: a drone that waits on its pad for a day must not fill the card."""
            report = self._last_report.newest
            in_mission = report is not None and report.phase not in (Phase.IDLE, Phase.LANDED)
            return in_mission or (vehicle.newest is not None and vehicle.newest.armed)

        clock = self._parts.clock
        return (
            Recorded(self.frames.name, self.frames.subscribe_window(8), flying),
            *(Recorded(topic.name, topic.subscribe_window(256), Thinned(flying, clock)) for topic in steady),
            *(Recorded(topic.name, topic.subscribe_window(256)) for topic in rare),
        )

    async def _camera(self) -> None:
        async with AsyncExitStack() as stack:
            camera, self._opened_camera = self._opened_camera, None
            if camera is None:
                camera = await stack.enter_async_context(self._parts.camera())
            else:
                stack.push_async_exit(camera)
            steering = asyncio.create_task(self._steer_exposure(camera), name="exposure")
            try:
                await run_camera(camera=camera, frames=self.frames)
            finally:
                steering.cancel()
                await asyncio.gather(steering, return_exceptions=True)

    async def _steer_exposure(self, camera: Camera) -> None:
        """As long as this camera runs; a flight goes on without it."""
        parts, control = self._parts, camera.exposure_control
        if parts.exposure is None or control is None:
            why = "the camera can't be told" if control is None else "exposure.steer is off"
            log.info("exposure.automatic", why=why)
            return
        steer = partial(
            run_exposure,
            control=control,
            frames=self._metered_frames,
            detections=self._metered_detections,
            commands=self.exposures,
            steering=parts.exposure,
            compute=parts.compute,
            clock=parts.clock,
        )
        await self._supervise("exposure", steer, vital=False)

    async def _close_unused_camera(self) -> None:
        if self._opened_camera is not None:
            await self._opened_camera.__aexit__(None, None, None)

    async def _supervise(self, name: str, run: Callable[[], Awaitable[None]], *, vital: bool = True) -> None:
        await supervise(name, run, proven=lambda: self._last_frame.newest is not None, texts=self.texts, vital=vital)

    @property
    def _hold_timeout_s(self) -> float:
        return 2 * self._parts.config.autopilot.action_timeout_s

    async def _hold(self, autopilot: Autopilot) -> None:
        await hold_vehicle(autopilot, self._last_report.newest, self._last_vehicle.newest, self._hold_timeout_s)
