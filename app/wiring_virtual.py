"""The wiring of a flight in process: the application, the simulated vehicle and a scripted phone under virtual time.

Beside wiring.py the only file in app/ that imports drivers. Call `fly` under app.clock.run_virtual.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from app.clock import LoopClock
from app.config import WorldConfig
from app.errors import ConfigError
from app.estimation.fix import FixMaker, pose_estimator
from app.estimation.mount import body_from_cam
from app.messages import CommandAnswer, MissionReport, OperatorAction, OperatorCommand, OperatorText, Phase
from app.runtime import Application, Parts
from app.tasks.compute import in_place
from app.vision.detector import Detector
from app.vision.geometry import LandmarkGeometry
from app.wiring import Rig, make_exposure
from drivers.autopilot.simulated import SimulatedAutopilot
from drivers.simulator.params import DEFAULTS
from drivers.simulator.touchdown import Contact
from drivers.simulator.virtual import SimulatedCamera, SimulatedWorld

__all__ = ["Contact", "ScriptedPhone", "SimulatedWorld", "VirtualFlight", "check_parameters", "fly"]

PHONE = (255, 190)
"""System and component id of a ground station."""


@dataclass
class ScriptedPhone:
    """app.ports.OperatorLink: asks what it is told to, keeps what it hears."""

    orders: asyncio.Queue[OperatorCommand] = field(default_factory=asyncio.Queue)
    answers: list[CommandAnswer] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    asked: int = 0

    async def __aenter__(self) -> Self:
        """Nothing to open."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing to release."""

    def ask(self, action: OperatorAction, now_s: float) -> None:
        """Give an order."""
        self.asked += 1
        self.orders.put_nowait(OperatorCommand(now_s, action, None, PHONE, self.asked))

    async def commands(self) -> AsyncIterator[OperatorCommand]:
        """The orders, as they are given."""
        while True:
            yield await self.orders.get()

    async def answer(self, answer: CommandAnswer) -> None:
        """Keep an answer."""
        self.answers.append(answer)

    async def say(self, text: OperatorText) -> None:
        """Keep a line."""
        self.texts.append(text.text)


@dataclass
class VirtualFlight:
    """What a script may touch while it flies, and what is left afterwards.

    Attributes:
        world: The simulated world; its truth is for the script and the review, never for the application.
        phone: The phone.
        reports: Of the mission, one for each change.
    """

    world: SimulatedWorld
    phone: ScriptedPhone
    reports: list[MissionReport] = field(default_factory=list)

    @property
    def phase(self) -> Phase:
        """The mission's present state."""
        return self.reports[-1].phase if self.reports else Phase.IDLE

    @property
    def contacts(self) -> list[Contact]:
        """Touchdowns, rests and crashes, from the truth."""
        return self.world.contacts


Script = Callable[[VirtualFlight], Awaitable[None]]


def check_parameters(path: Path, names: Iterable[str]) -> None:
    """See that the simulated PX4 has parameters of these names.

    Raises:
        ConfigError: It doesn't.
    """
    for name in names:
        if name not in DEFAULTS:
            raise ConfigError(
                f"{path}: vehicle.parameters.{name}: the simulated PX4 has no such parameter",
                f"it has {', '.join(DEFAULTS)}",
            )


async def fly(rig: Rig, script: Script, geometry: LandmarkGeometry | None = None) -> VirtualFlight:
    """Fly a script to its end in the rig's world. The autopilot is up before the application starts, as on a field.
    What a detector works out of the rig's landmark can be handed from flight to flight.
    """
    clock = LoopClock()
    world = SimulatedWorld(
        rig.config.simulator or WorldConfig(), rig.landmark, rig.lens_config, rig.config.camera, clock
    )
    world.boot()
    flight = VirtualFlight(world, ScriptedPhone())
    application = Application(
        Parts(
            config=rig.config,
            camera=lambda: SimulatedCamera(world),
            autopilot=SimulatedAutopilot(world),
            operator=flight.phone,
            recorder=None,
            detector=Detector(rig.landmark, rig.lens, rig.config.vision, geometry),
            make_fix=FixMaker(
                pose_estimator(rig.landmark, rig.lens, rig.config.vision.method, rig.height_table),
                body_from_cam(rig.config.camera),
            ),
            clock=clock,
            compute=in_place,
            exposure=make_exposure(rig),
        )
    )
    reports = application.reports.subscribe_all(1_000)

    async def watch() -> None:
        while True:
            report = await reports.get()
            last = flight.reports[-1] if flight.reports else None
            if last is None or (last.phase, last.reason, last.tries) != (report.phase, report.reason, report.tries):
                flight.reports.append(report)

    running = asyncio.create_task(application.run(), name="application")
    others = [asyncio.create_task(world.run(), name="world"), asyncio.create_task(watch(), name="watch")]
    scripted = asyncio.ensure_future(script(flight))
    try:
        # An application that fails, or a world that does, ends the flight before its script is through.
        await asyncio.wait([scripted, running, *others], return_when=asyncio.FIRST_COMPLETED)
    finally:
        application.stop()
        await asyncio.wait([running])
        for task in (*others, scripted):
            task.cancel()
        ends = await asyncio.gather(*others, scripted, return_exceptions=True)
    running.result()
    for end in ends:
        if isinstance(end, Exception):
            raise end
    return flight
