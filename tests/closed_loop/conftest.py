"""Flights in process under virtual time: the application, the simulated vehicle, rendered frames, a scripted phone."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import pytest

from app.clock import LoopClock
from app.config import WorldConfig
from app.estimation.fix import FixMaker, pose_estimator
from app.estimation.mount import body_from_cam
from app.messages import (
    CommandAnswer,
    MissionReport,
    OperatorAction,
    OperatorCommand,
    OperatorText,
    Phase,
)
from app.runtime import Application, Parts
from app.tasks.compute import in_place
from app.vision.detector import Detector
from app.wiring import CONFIGS, Rig, load_rig, make_exposure
from drivers.autopilot.simulated import SimulatedAutopilot
from drivers.simulator.touchdown import Contact
from drivers.simulator.virtual import SimulatedCamera, SimulatedWorld


@dataclass
class ScriptedPhone:
    """app.ports.OperatorLink: asks what it is told to, keeps what it hears."""

    orders: asyncio.Queue[OperatorCommand] = field(default_factory=asyncio.Queue)
    answers: list[CommandAnswer] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    asked: int = 0

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def ask(self, action: OperatorAction, now_s: float) -> None:
        self.asked += 1
        self.orders.put_nowait(OperatorCommand(now_s, action, None, (255, 190), self.asked))

    async def commands(self) -> AsyncIterator[OperatorCommand]:
        while True:
            yield await self.orders.get()

    async def answer(self, answer: CommandAnswer) -> None:
        self.answers.append(answer)

    async def say(self, text: OperatorText) -> None:
        self.texts.append(text.text)


@dataclass
class VirtualFlight:
    """What a script of a test may touch while it flies, and what is left afterwards."""

    world: SimulatedWorld
    phone: ScriptedPhone
    reports: list[MissionReport] = field(default_factory=list)

    @property
    def phase(self) -> Phase:
        return self.reports[-1].phase if self.reports else Phase.IDLE

    @property
    def phases(self) -> list[Phase]:
        """The phases in the order they were entered."""
        entered: list[Phase] = []
        for report in self.reports:
            if not entered or entered[-1] is not report.phase:
                entered.append(report.phase)
        return entered

    @property
    def contacts(self) -> list[Contact]:
        """From the truth, for the test alone."""
        return self.world.contacts

    async def reach(self, *phases: Phase, timeout_s: float = 120.0) -> Phase:
        """Wait until the mission is in one of the phases."""
        async with asyncio.timeout(timeout_s):
            while self.phase not in phases:
                await asyncio.sleep(0.05)
        return self.phase

    async def ready(self) -> None:
        """Wait until the vehicle can be armed and the camera is seen."""
        async with asyncio.timeout(30.0):
            while not self.world.px4.commander.ready:
                await asyncio.sleep(0.1)
        await asyncio.sleep(1.0)


Script = Callable[[VirtualFlight], Awaitable[None]]


async def fly_virtually(world: WorldConfig, script: Script, rig: Rig | None = None) -> VirtualFlight:
    """Fly a script in a world to its end. Call it under app.clock.run_virtual."""
    rig = rig or load_rig(CONFIGS / "simulator.toml")
    clock = LoopClock()
    simulated = SimulatedWorld(world, rig.landmark, rig.lens_config, rig.config.camera, clock)
    phone = ScriptedPhone()
    flight = VirtualFlight(simulated, phone)
    application = Application(
        Parts(
            config=rig.config,
            camera=lambda: SimulatedCamera(simulated),
            autopilot=SimulatedAutopilot(simulated),
            operator=phone,
            recorder=None,
            detector=Detector(rig.landmark, rig.lens, rig.config.vision),
            make_fix=FixMaker(
                pose_estimator(rig.landmark, rig.lens, rig.config.vision.method), body_from_cam(rig.config.camera)
            ),
            clock=clock,
            compute=in_place,
            exposure=make_exposure(rig),
        )
    )
    reports = application.reports.subscribe_all(100_000)
    running = asyncio.create_task(application.run())
    turning = asyncio.create_task(simulated.run())

    async def watch() -> None:
        while True:
            flight.reports.append(await reports.get())

    watching = asyncio.create_task(watch())
    try:
        await script(flight)
    finally:
        application.stop()
        await asyncio.wait([running])
        for task in (turning, watching):
            task.cancel()
        await asyncio.gather(turning, watching, return_exceptions=True)
    running.result()
    return flight


@pytest.fixture
def fly() -> Callable[..., Awaitable[VirtualFlight]]:
    """fly_virtually."""
    return fly_virtually
