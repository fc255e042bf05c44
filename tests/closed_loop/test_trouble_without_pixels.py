"""Flights that go wrong, with the simulated vehicle in process and the pad told from the truth instead of from pixels.

Without rendering and detection a flight takes seconds, so that decisions can be tried against PX4's own behaviour:
failsafe and return to offboard, pilot, a link that is cut, a pad that is hidden, one mission after the other.
"""

from __future__ import annotations

import asyncio
import gc
import itertools
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import numpy as np
import pytest

from app.clock import LoopClock, run_virtual
from app.config import PadMotionConfig, WorldConfig
from app.messages import (
    CommandAnswer,
    CommandResult,
    Detection,
    FlightMode,
    Frame,
    MissionReport,
    OperatorAction,
    OperatorCommand,
    OperatorText,
    PadFix,
    Phase,
    SeenContour,
    VehicleState,
)
from app.mission.commands import LOCKED_FOR_S
from app.runtime import Application, Parts
from app.tasks.compute import in_place
from app.wiring import CONFIGS, load_rig
from drivers.autopilot.simulated import SimulatedAutopilot
from drivers.simulator.virtual import SimulatedWorld
from drivers.simulator.world import Truth

CLOCK = LoopClock()
C, Op, P = CommandResult, OperatorAction, Phase
OVER = {P.LANDED, P.HOLD, P.IDLE, P.RETURN, P.FALLBACK_LAND}


@dataclass
class Eye:
    """Camera, detector and pose in one: thirty looks a second at the truth, with a centimetre of noise."""

    world: SimulatedWorld
    hidden: bool = False
    seen: dict[int, Truth] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(4))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    async def frames(self) -> AsyncIterator[Frame]:
        sequence = 0
        while True:
            sequence += 1
            self.seen[sequence] = self.world.truth()
            self.seen.pop(sequence - 30, None)
            yield Frame(CLOCK.now_s(), sequence, np.zeros((2, 2), np.uint8))
            await asyncio.sleep(1.0 / 30.0)

    def pad_from_vehicle_m(self, sequence: int) -> np.ndarray:
        truth = self.seen[sequence]
        return np.array([truth.pad.north_m, truth.pad.east_m, truth.pad.down_m]) - np.array(truth.pos)

    def detect(self, frame: Frame) -> Detection:
        relative = self.pad_from_vehicle_m(frame.sequence)
        in_sight = 0.25 < relative[2] < 12.0 and np.hypot(*relative[:2]) < 1.6 * relative[2]
        seen = in_sight and not self.hidden and self.rng.random() < 0.95
        contours = (SeenContour(0, np.zeros((4, 2))),) if seen else ()
        return Detection(frame.t_capture_s, frame.sequence, contours)

    def fix(self, detection: Detection, state: VehicleState) -> PadFix:
        relative = self.pad_from_vehicle_m(detection.sequence) + self.rng.normal(0.0, 0.01, 3)
        place = state.pos_ned_m + relative
        return PadFix(detection.t_capture_s, place, relative, np.eye(3) * 1e-4, 0.0, 0.02, "44")


class Phone:
    """Orders go out, answers and texts come in."""

    def __init__(self) -> None:
        self.orders: asyncio.Queue[OperatorCommand] = asyncio.Queue()
        self.answers: list[CommandAnswer] = []
        self.texts: list[str] = []
        self.asked = 0

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def ask(self, action: OperatorAction, *, takes_over: bool = False) -> None:
        self.asked += 1
        order = OperatorCommand(CLOCK.now_s(), action, None, (255, 190), self.asked, takes_over=takes_over)
        self.orders.put_nowait(order)

    async def commands(self) -> AsyncIterator[OperatorCommand]:
        while True:
            yield await self.orders.get()

    async def answer(self, answer: CommandAnswer) -> None:
        self.answers.append(answer)

    async def say(self, text: OperatorText) -> None:
        self.texts.append(text.text)


class Flight:
    """What a script may touch, and what is left of a flight."""

    def __init__(self, world: SimulatedWorld) -> None:
        self.world, self.eye, self.phone = world, Eye(world), Phone()
        self.reports: list[MissionReport] = []

    @property
    def phases(self) -> list[Phase]:
        """In the order in which they were entered."""
        return [phase for phase, _ in itertools.groupby(report.phase for report in self.reports)]

    def finals(self) -> list[tuple[int, CommandResult]]:
        return [(a.number, a.result) for a in self.phone.answers if a.result is not C.IN_PROGRESS]

    async def reach(self, *phases: Phase) -> None:
        async with asyncio.timeout(150.0):
            while self.reports[-1].phase not in phases:
                await asyncio.sleep(0.02)

    async def to_its_end(self, action: OperatorAction, *, takes_over: bool = False) -> None:
        """Order something and wait until it is over."""
        self.phone.ask(action, takes_over=takes_over)
        await self.reach(P.TAKEOFF, P.SEARCH)
        await self.reach(*OVER)
        await asyncio.sleep(1.0)


def fly(script: Callable[[Flight], Awaitable[None]], motion: PadMotionConfig | None = None, seed: int = 1) -> Flight:
    async def main() -> Flight:
        rig = load_rig(CONFIGS / "simulator.toml")
        config = WorldConfig(seed=seed, motion=motion or PadMotionConfig())
        world = SimulatedWorld(config, rig.landmark, rig.lens_config, rig.config.camera, CLOCK)
        world.frames_flow = False
        flight = Flight(world)
        application = Application(
            Parts(
                config=rig.config,
                camera=lambda: flight.eye,
                autopilot=SimulatedAutopilot(world),
                operator=flight.phone,
                recorder=None,
                detector=flight.eye,  # type: ignore[arg-type]  # a stand-in
                make_fix=flight.eye.fix,  # type: ignore[arg-type]  # a stand-in
                clock=CLOCK,
                compute=in_place,
            )
        )
        reports = application.reports.subscribe_all(100_000)
        turning, running = asyncio.create_task(world.run()), asyncio.create_task(application.run())

        async def watch() -> None:
            while True:
                flight.reports.append(await reports.get())

        watching = asyncio.create_task(watch())
        try:
            await asyncio.sleep(6.0)
            await script(flight)
        finally:
            application.stop()
            await asyncio.wait([running])
            turning.cancel()
            watching.cancel()
            await asyncio.gather(turning, watching, return_exceptions=True)
            gc.unfreeze()
        running.result()
        return flight

    return run_virtual(main(), start_s=10.0)


def errors_m(flight: Flight) -> list[float]:
    return [contact.error_m for contact in flight.world.contacts if contact.kind == "rest"]


CAR = PadMotionConfig(
    north_m=2.0, east_m=-1.0, height_m=1.5, heading_deg=20.0, speed_m_s=3.75, start_after_s=8.0, deck_m=1.6
)


@pytest.mark.parametrize(("motion", "limit_m"), [(None, 0.10), (CAR, 0.20)])
def test_landing_rests_on_the_pad(motion, limit_m):
    """This eye is blind below 25 cm and noisier than the camera: what the camera reaches is held to with pixels."""
    flight = fly(lambda f: f.to_its_end(Op.LAND), motion)
    assert flight.phases == [P.IDLE, P.TAKEOFF, P.SEARCH, P.HOVER, P.TRACK, P.LAND, P.LANDED]
    assert flight.finals() == [(1, C.ACCEPTED)]
    assert len(errors_m(flight)) == 1 and errors_m(flight)[0] < limit_m
    assert not flight.world.px4.commander.armed


def test_second_mission_after_a_landing_flies_as_the_first_did():
    async def script(flight: Flight) -> None:
        await flight.to_its_end(Op.LAND)
        await asyncio.sleep(LOCKED_FOR_S)
        await flight.to_its_end(Op.LAND)

    flight = fly(script)
    once = [P.TAKEOFF, P.SEARCH, P.HOVER, P.TRACK, P.LAND, P.LANDED]
    assert flight.phases == [P.IDLE, *once, *once]
    assert flight.finals() == [(1, C.ACCEPTED), (2, C.ACCEPTED)]


def test_pilot_who_takes_over_keeps_the_vehicle_until_the_phone_asks_again():
    async def script(flight: Flight) -> None:
        flight.phone.ask(Op.TRACK)
        await flight.reach(P.TRACK)
        flight.world.px4.set_mode(FlightMode.POSITION)
        await asyncio.sleep(20.0)
        assert flight.reports[-1].phase is P.IDLE
        assert flight.world.px4.commander.mode is FlightMode.POSITION
        flight.phone.ask(Op.LAND)
        await asyncio.sleep(1.0)
        assert flight.reports[-1].phase is P.IDLE
        await flight.to_its_end(Op.LAND, takes_over=True)

    flight = fly(script)
    assert flight.finals() == [(1, C.CANCELLED), (2, C.TEMPORARILY_REJECTED), (3, C.ACCEPTED)]
    assert "idle: position mode by pilot or PX4, hands off" in flight.phone.texts


def test_pad_that_is_hidden_above_the_commit_is_searched_for_and_landed_on():
    async def script(flight: Flight) -> None:
        flight.phone.ask(Op.LAND)
        await flight.reach(P.LAND)
        flight.eye.hidden = True
        await asyncio.sleep(6.0)
        flight.eye.hidden = False
        await flight.reach(*OVER)

    flight = fly(script)
    assert flight.phases[5:8] == [P.LAND, P.SEARCH, P.HOVER]
    assert flight.phases[-1] is P.LANDED and errors_m(flight)[0] < 0.10


def test_link_that_is_cut_ends_the_mission_in_a_watched_hold_and_px4s_failsafe_is_not_ended_by_us():
    """PX4's intent is still offboard: setpoints that resumed would take it back there."""

    async def script(flight: Flight) -> None:
        flight.phone.ask(Op.TRACK)
        await flight.reach(P.TRACK)
        flight.world.telemetry_flows = False
        await asyncio.sleep(3.0)
        flight.world.telemetry_flows = True
        await asyncio.sleep(10.0)
        assert flight.reports[-1].phase is P.HOLD
        assert flight.world.px4.commander.mode is FlightMode.HOLD
        await flight.to_its_end(Op.LAND)

    assert fly(script).phases[-1] is P.LANDED


def test_hold_and_a_new_order_on_its_heels_do_not_race():
    async def script(flight: Flight) -> None:
        flight.phone.ask(Op.TRACK)
        await flight.reach(P.TRACK)
        flight.phone.ask(Op.HOLD)
        await asyncio.sleep(0.06)
        flight.phone.ask(Op.TRACK)
        await asyncio.sleep(2.0)
        assert flight.reports[-1].phase is P.HOLD
        assert flight.world.px4.commander.mode is FlightMode.HOLD
        await flight.to_its_end(Op.LAND)

    flight = fly(script)
    assert flight.finals()[1:] == [(2, C.ACCEPTED), (3, C.TEMPORARILY_REJECTED), (4, C.ACCEPTED)]
