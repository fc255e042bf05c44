"""Ports that do as they are told, and a way to run loops for a while under virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Any, Self

import numpy as np
import pytest

from app.channels import Events
from app.clock import LoopClock
from app.errors import AutopilotError, CameraError, OperatorError, RecorderError
from app.messages import (
    AutopilotAction,
    CommandAnswer,
    ExposureLimits,
    Frame,
    LandedState,
    LandingTarget,
    OperatorCommand,
    OperatorText,
    PadTrack,
    ParameterFinding,
    Setpoint,
    VehicleState,
)
from app.ports import always

CLOCK = LoopClock()


class FakePort:
    """Opens and closes, and says so."""

    def __init__(self) -> None:
        self.is_open = self.was_opened = False
        self.opening_takes_s = 0.0
        self.opening_fails = False

    async def __aenter__(self) -> Self:
        if self.opening_takes_s:
            await asyncio.sleep(self.opening_takes_s)
        if self.opening_fails:
            raise AutopilotError("nobody there", "switch it on")
        self.is_open = self.was_opened = True
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.is_open = False


class FakeAutopilot(FakePort):
    """Keeps what it is sent. `state` is what states() gives a hundred times a second; actions take `takes_s`.

    `ended` are those that were cancelled.
    """

    def __init__(self, state: VehicleState | None = None) -> None:
        super().__init__()
        self.state = vehicle() if state is None else state
        self.setpoints: list[tuple[float, Setpoint]] = []
        self.targets: list[tuple[float, LandingTarget]] = []
        self.actions: list[tuple[float, AutopilotAction]] = []
        self.asked_s: list[float | None] = []
        self.ended: list[tuple[float, AutopilotAction]] = []
        self.refuses: set[AutopilotAction] = set()
        self.takes_s = 0.02
        self.send_takes_s = 0.0
        self.states_end_s = float("inf")
        self.parameter_findings: tuple[ParameterFinding, ...] = ()

    async def states(self) -> AsyncIterator[VehicleState]:
        while CLOCK.now_s() < self.states_end_s:
            yield vehicle_at(self.state, CLOCK.now_s())
            await asyncio.sleep(0.01)

    async def send_setpoint(self, setpoint: Setpoint) -> None:
        self.setpoints.append((CLOCK.now_s(), setpoint))
        if self.send_takes_s:
            await asyncio.sleep(self.send_takes_s)

    async def send_landing_target(self, target: LandingTarget) -> None:
        self.targets.append((CLOCK.now_s(), target))

    async def execute(
        self,
        action: AutopilotAction,
        *,
        height_m: float = 0.0,
        asked_s: float | None = None,
        wanted: Callable[[], bool] = always,
    ) -> None:
        self.actions.append((CLOCK.now_s(), action))
        self.asked_s.append(asked_s)
        try:
            await asyncio.sleep(self.takes_s)
        except asyncio.CancelledError:
            self.ended.append((CLOCK.now_s(), action))
            raise
        if action in self.refuses:
            raise AutopilotError(f"PX4 refused to {action.value}", "see what PX4 says")


class FakeOperator(FakePort):
    """A phone: `orders` are what it sends; what it is told is kept."""

    def __init__(self) -> None:
        super().__init__()
        self.orders: Events[OperatorCommand] = Events("orders")
        self.answers: list[CommandAnswer] = []
        self.texts: list[str] = []
        self.reachable = True

    async def commands(self) -> AsyncIterator[OperatorCommand]:
        while True:
            yield await self.orders.get()

    async def answer(self, answer: CommandAnswer) -> None:
        if not self.reachable:
            raise OperatorError("no route to the phone", "go nearer")
        self.answers.append(answer)

    async def say(self, text: OperatorText) -> None:
        if not self.reachable:
            raise OperatorError("no route to the phone", "go nearer")
        self.texts.append(text.text)


class FakeCamera(FakePort):
    """Thirty black frames a second; after `fails_after` of them, an error each time."""

    def __init__(self, fails_after: int = 10**9) -> None:
        super().__init__()
        self.fails_after = fails_after
        self.exposure_control = None

    async def frames(self) -> AsyncIterator[Frame]:
        for sequence in range(self.fails_after):
            yield Frame(CLOCK.now_s(), sequence, np.zeros((2, 2), np.uint8))
            await asyncio.sleep(1.0 / 30.0)
        raise CameraError("the camera is gone", "plug it in")


class FakeDimCamera(FakePort):
    """Thirty dark frames a second, exposed as it is told at once; what it is told is kept, None for by itself."""

    limits = ExposureLimits(1e-4, 1e-2, 1.0, 8.0)

    def __init__(self, fails_after: int = 10**9) -> None:
        super().__init__()
        self.fails_after = fails_after
        self.told: list[tuple[float, float] | None] = []
        self.exposure_control = self
        self._exposure = (1e-3, 1.0)

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        assert self.is_open
        self.told.append((exposure_s, gain))
        self._exposure = (exposure_s, gain)

    def set_auto(self) -> None:
        self.told.append(None)

    async def frames(self) -> AsyncIterator[Frame]:
        for sequence in range(self.fails_after):
            exposure_s, gain = self._exposure
            grey = min(255.0, 255.0 * (8.0 * exposure_s * gain) ** 0.5)
            yield Frame(CLOCK.now_s(), sequence, np.full((64, 64), grey, np.uint8), exposure_s, gain=gain)
            await asyncio.sleep(1.0 / 30.0)
        raise CameraError("the camera is gone", "plug it in")


class FakeRecorder(FakePort):
    """Keeps topics and times; when full, an error each time."""

    def __init__(self) -> None:
        super().__init__()
        self.written: list[tuple[str, float]] = []
        self.full = False

    def write(self, topic: str, t_s: float, message: Any) -> None:
        if self.full:
            raise RecorderError("no space left", "free some")
        self.written.append((topic, t_s))


def vehicle(**changes: Any) -> VehicleState:
    """Disarmed on the ground, armable."""
    values = {
        "t_capture_s": 0.0,
        "pos_ned_m": np.array([0.0, 0.0, -3.0]),
        "vel_ned_m_s": np.zeros(3),
        "q_ned_from_body_wxyz": np.array([1.0, 0.0, 0.0, 0.0]),
        "armable": True,
        "local_position_ok": True,
        "battery_fraction": 0.8,
        "landed": LandedState.ON_GROUND,
        **changes,
    }
    return VehicleState(**values)


def vehicle_at(state: VehicleState, t_s: float) -> VehicleState:
    """The same at another time."""
    fields = {name: getattr(state, name) for name in VehicleState.__slots__}
    return VehicleState(**{**fields, "t_capture_s": t_s})


def track(t_s: float, north_m: float = 0.0, fixes: int = 99) -> PadTrack:
    """A pad at rest."""
    pos = np.array([north_m, 0.0, 0.0])
    return PadTrack(t_s, pos, np.zeros(3), np.eye(6) * 1e-4, 0.0, 0.0, t_s, fixes)


@asynccontextmanager
async def running(*coroutines: Coroutine[Any, Any, None]) -> AsyncIterator[list[asyncio.Task[None]]]:
    """The coroutines as tasks, cancelled at the end. One that failed before fails the test."""
    tasks = [asyncio.create_task(one) for one in coroutines]
    try:
        yield tasks
    finally:
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
    for outcome in ended:
        if isinstance(outcome, Exception):
            raise outcome


class Fakes:
    """What the tests of the loops share."""

    clock = CLOCK
    Autopilot, Operator, Camera, Recorder = FakeAutopilot, FakeOperator, FakeCamera, FakeRecorder
    DimCamera = FakeDimCamera
    vehicle, vehicle_at, track = staticmethod(vehicle), staticmethod(vehicle_at), staticmethod(track)
    running = staticmethod(running)


@pytest.fixture(scope="session")
def fakes() -> type[Fakes]:
    """Ports that do as they are told."""
    return Fakes
