"""The application as a whole on ports that do as they are told: restarts, failures, and how it ends."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from app import runtime
from app.channels import Topic
from app.clock import run_virtual
from app.config import CameraConfig, ExposureConfig, LensConfig, RigConfig
from app.errors import AlightError, AutopilotError, CameraError
from app.landmark import paper_landmark
from app.messages import (
    AutopilotAction,
    CommandResult,
    Detection,
    FlightMode,
    Frame,
    LandedState,
    MissionReport,
    OperatorAction,
    OperatorCommand,
    ParameterFinding,
    Phase,
)
from app.runtime import Application, Parts
from app.supervision import RESTARTS_MAX
from app.systemd import Watchdog
from app.tasks.compute import in_place
from app.vision.camera_model import lens_from_config
from app.vision.exposure import ExposureSteering

A, C = AutopilotAction, CommandResult
RIG = RigConfig(camera=CameraConfig(driver="synthetic", lens="lens.toml"), pad="pad.toml")
SMALL = LensConfig(model="pinhole", width_px=64, height_px=64, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=31.5)


class Blind:
    """A detector that never finds anything; `broken` makes it fail."""

    broken = False

    def detect(self, frame: Frame) -> Detection:
        if self.broken:
            raise ZeroDivisionError("one odd frame")
        return Detection(frame.t_capture_s, frame.sequence, reason="no dark square")


@pytest.fixture(autouse=True)
def _unfrozen() -> Iterator[None]:
    """The application freezes what the garbage collector looks at; a test run must not."""
    yield
    gc.unfreeze()


class Bench:
    """The application and its ports. The vehicle is in the air in hold, and does at once what it is asked."""

    def __init__(self, fakes: Any, *, frames: int = 10**9) -> None:
        flying = {"armed": True, "landed": LandedState.IN_AIR, "mode": FlightMode.HOLD}
        self.autopilot = fakes.Autopilot(fakes.vehicle(**flying))
        self.operator, self.recorder, self.detector = fakes.Operator(), fakes.Recorder(), Blind()
        self.cameras: list[Any] = []
        self.make_camera: Any = lambda: fakes.Camera(frames)
        self.application = Application(
            Parts(
                config=RIG,
                camera=self.camera,
                autopilot=self.autopilot,
                operator=self.operator,
                recorder=self.recorder,
                detector=self.detector,  # type: ignore[arg-type]  # a stand-in
                make_fix=lambda detection, state: None,
                clock=fakes.clock,
                compute=in_place,
                exposure=ExposureSteering(paper_landmark(), lens_from_config(SMALL), ExposureConfig(), 8e-3),
            )
        )
        self.reports: Topic[MissionReport] = self.application.reports
        self.last = self.reports.subscribe()

    def camera(self) -> Any:
        self.cameras.append(self.make_camera())
        return self.cameras[-1]

    async def obey(self) -> None:
        """Modes follow the actions, 0.1 s later."""
        done = 0
        while True:
            await asyncio.sleep(0.1)
            modes = {A.OFFBOARD: FlightMode.OFFBOARD, A.HOLD: FlightMode.HOLD, A.RETURN: FlightMode.RETURN}
            for _, action in self.autopilot.actions[done:]:
                state = self.autopilot.state
                fields = {name: getattr(state, name) for name in type(state).__slots__}
                self.autopilot.state = type(state)(**{**fields, "mode": modes.get(action, state.mode)})
            done = len(self.autopilot.actions)

    def order(self, action: OperatorAction, number: int = 1) -> None:
        self.operator.orders.emit(OperatorCommand(0.0, action, None, (255, 190), number))

    def results(self) -> list[CommandResult]:
        return [answer.result for answer in self.operator.answers]

    def asked(self) -> list[AutopilotAction]:
        return [action for _, action in self.autopilot.actions]


def fly(fakes: Any, scenario: Any, **changes: Any) -> tuple[Bench, BaseException | None]:
    """Run the application through a scenario; what it ended with, if not in good order."""

    async def main() -> tuple[Bench, BaseException | None]:
        bench = Bench(fakes, **changes)
        async with fakes.running(bench.obey()):
            run = asyncio.create_task(bench.application.run())
            await scenario(bench, run)
            outcome = await asyncio.gather(run, return_exceptions=True)
        return bench, outcome[0]

    return run_virtual(main(), start_s=100.0)


async def searching(bench: Bench) -> None:
    bench.order(OperatorAction.SEARCH)
    await asyncio.sleep(2.0)
    assert bench.last.newest is not None and bench.last.newest.phase is Phase.SEARCH
    assert bench.autopilot.state.mode is FlightMode.OFFBOARD


async def stop_while_steering(bench: Bench, run: asyncio.Task[None]) -> None:
    await asyncio.sleep(0.5)
    await searching(bench)
    bench.application.stop()


def test_stop_while_steering_holds_answers_the_command_and_closes_every_port(fakes: Any):
    bench, outcome = fly(fakes, stop_while_steering)
    assert outcome is None
    assert bench.asked() == [A.OFFBOARD, A.HOLD]
    assert bench.results() == [C.IN_PROGRESS, C.CANCELLED]
    assert not any(port.is_open for port in (bench.autopilot, bench.operator, bench.recorder, *bench.cameras))


def test_stop_while_steering_ends_the_setpoints_with_the_hold(fakes: Any):
    bench, _ = fly(fakes, stop_while_steering)
    held_s = bench.autopilot.actions[-1][0]
    assert held_s - 0.071 <= bench.autopilot.setpoints[-1][0] <= held_s + 0.3  # one step of the mission, one of control


def test_stop_with_nothing_to_steer_asks_for_nothing(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(1.0)
        bench.application.stop()

    bench, outcome = fly(fakes, scenario)
    assert (outcome, bench.asked(), bench.autopilot.setpoints) == (None, [], [])


def test_start_tells_the_phone_of_px4s_parameters_that_differ(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        bench.autopilot.parameter_findings = (
            ParameterFinding("COM_OBL_RC_ACT", "all of it", "COM_OBL_RC_ACT is 0, must be 5", critical=True),
        )
        await asyncio.sleep(1.0)
        bench.application.stop()

    assert "COM_OBL_RC_ACT is 0, must be 5" in fly(fakes, scenario)[0].operator.texts


def test_stop_when_the_pilot_has_just_taken_over_takes_nothing_from_him(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(0.5)
        await searching(bench)
        state = bench.autopilot.state
        fields = {name: getattr(state, name) for name in type(state).__slots__}
        bench.autopilot.state = type(state)(**{**fields, "mode": FlightMode.POSITION})
        await asyncio.sleep(0.02)
        bench.application.stop()

    assert fly(fakes, scenario)[0].asked() == [A.OFFBOARD]


def test_cancelled_while_steering_holds_too(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(0.5)
        await searching(bench)
        run.cancel()

    bench, outcome = fly(fakes, scenario)
    assert isinstance(outcome, asyncio.CancelledError)
    assert bench.asked() == [A.OFFBOARD, A.HOLD]
    assert bench.results() == [C.IN_PROGRESS, C.CANCELLED]


def test_telemetry_that_ends_while_steering_ends_the_application_which_holds(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(0.5)
        await searching(bench)
        bench.autopilot.states_end_s = fakes.clock.now_s()

    bench, outcome = fly(fakes, scenario)
    assert isinstance(outcome, AlightError) and "telemetry ended" in outcome.what
    assert bench.asked() == [A.OFFBOARD, A.HOLD]
    assert bench.results() == [C.IN_PROGRESS, C.CANCELLED]


def test_hold_that_px4_refuses_at_the_end_is_not_the_end_of_the_ending(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(0.5)
        await searching(bench)
        bench.autopilot.refuses = {A.HOLD}
        bench.application.stop()

    bench, outcome = fly(fakes, scenario)
    assert outcome is None and not bench.autopilot.is_open


def test_camera_that_fails_is_opened_again_a_bounded_number_of_times(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(60.0)

    bench, outcome = fly(fakes, scenario, frames=10)
    assert isinstance(outcome, CameraError)
    assert len(bench.cameras) == RESTARTS_MAX + 1
    assert [text for text in bench.operator.texts if "camera" in text] == [
        f"camera failed, restart {n}" for n in range(1, RESTARTS_MAX + 1)
    ]


def test_camera_that_never_gave_a_frame_ends_the_application_at_once(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(1.0)

    bench, outcome = fly(fakes, scenario, frames=0)
    assert isinstance(outcome, CameraError) and len(bench.cameras) == 1


def test_detector_that_fails_on_an_odd_frame_goes_on_with_the_next(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(1.0)
        bench.detector.broken = True
        await asyncio.sleep(0.1)
        bench.detector.broken = False
        await asyncio.sleep(3.0)
        bench.application.stop()

    bench, outcome = fly(fakes, scenario)
    assert outcome is None
    assert max(t_s for topic, t_s in bench.recorder.written if topic == "detections") > 103.9


def test_recorder_that_is_full_ends_no_flight(fakes: Any):
    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(0.5)
        await searching(bench)
        bench.recorder.full = True
        await asyncio.sleep(20.0)
        assert bench.last.newest is not None and bench.last.newest.phase is Phase.SEARCH
        bench.application.stop()

    bench, outcome = fly(fakes, scenario)
    assert outcome is None
    assert bench.operator.texts.count("recorder failed for good") == 1


def test_setpoints_of_a_whole_flight_keep_their_period(fakes: Any):
    bench, _ = fly(fakes, stop_while_steering)
    gaps = np.diff([t_s for t_s, _ in bench.autopilot.setpoints])
    np.testing.assert_allclose(gaps, 0.02, atol=1e-9)


def test_camera_that_does_not_open_is_told_before_the_links_are_tried(fakes: Any):
    class Closed(fakes.Camera):  # type: ignore[misc]  # a class that a test makes
        async def __aenter__(self) -> Any:
            raise CameraError("no camera 7", "plug it in")

    async def main() -> float:
        bench = Bench(fakes)
        bench.autopilot.opening_takes_s = 600.0
        bench.make_camera = Closed
        with pytest.raises(CameraError, match="no camera 7"):
            await bench.application.run()
        return fakes.clock.now_s()

    assert run_virtual(main(), start_s=100.0) == 100.0


def test_stop_while_a_link_is_still_opening_ends_at_once_and_closes_what_is_open(fakes: Any):
    async def main() -> tuple[float, Bench]:
        bench = Bench(fakes)
        bench.autopilot.opening_takes_s = 600.0
        run = asyncio.create_task(bench.application.run())
        await asyncio.sleep(3.0)
        bench.application.stop()
        await run
        return fakes.clock.now_s(), bench

    ended_s, bench = run_virtual(main(), start_s=100.0)
    assert ended_s == 103.0
    assert len(bench.cameras) == 1
    assert not any(port.is_open for port in (bench.autopilot, bench.operator, bench.recorder, *bench.cameras))


def test_autopilot_that_is_not_there_closes_the_camera_and_makes_no_record(fakes: Any):
    async def main() -> Bench:
        bench = Bench(fakes)
        bench.autopilot.opening_fails = True
        with pytest.raises(AutopilotError, match="nobody there"):
            await bench.application.run()
        return bench

    bench = run_virtual(main(), start_s=100.0)
    assert len(bench.cameras) == 1 and not bench.cameras[0].is_open
    assert not bench.recorder.was_opened


def test_camera_that_can_be_told_is_steered_recorded_and_given_back(fakes: Any):
    """Grey 23 at first; the picture's own level is 80, so about (80 / 23)^2 times the light is wanted."""

    async def main() -> Bench:
        bench = Bench(fakes)
        bench.make_camera = fakes.DimCamera
        async with fakes.running(bench.obey()):
            run = asyncio.create_task(bench.application.run())
            await asyncio.sleep(2.0)
            bench.application.stop()
            await run
        return bench

    bench = run_virtual(main(), start_s=100.0)
    (camera,) = bench.cameras
    exposure_s, gain = camera.told[-2]
    assert camera.told[-1] is None
    assert 255.0 * (8.0 * exposure_s * gain) ** 0.5 == pytest.approx(80.0, rel=0.06)
    assert [topic for topic, _ in bench.recorder.written].count("exposures") == len(camera.told) - 1


def test_camera_that_fails_while_it_is_steered_is_started_again_and_steered_anew(fakes: Any):
    async def main() -> Bench:
        bench = Bench(fakes)
        bench.make_camera = lambda: fakes.DimCamera(30)
        async with fakes.running(bench.obey()):
            run = asyncio.create_task(bench.application.run())
            await asyncio.sleep(3.5)
            bench.application.stop()
            await run
        return bench

    cameras = run_virtual(main(), start_s=100.0).cameras
    assert len(cameras) >= 2
    assert all(camera.told[0] is not None and camera.told[-1] is None for camera in cameras)


WATCHDOG_S = 2.0
"""WatchdogSec of deploy/alight.service."""


@pytest.fixture
def told(fakes: Any, monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, str]]:
    """What systemd is told, and when."""
    words: list[tuple[float, str]] = []

    class Told(Watchdog):
        def _send(self, message: bytes) -> None:
            words.append((fakes.clock.now_s(), message.decode()))

    monkeypatch.setattr(runtime, "Watchdog", lambda: Told(""))
    return words


def going_down_slowly(fakes: Any, monkeypatch: pytest.MonkeyPatch, end: Any) -> Bench:
    """End an application that steers. PX4 takes 4 s to hold, the camera 3 s to close and the record 10 s."""

    def closing(takes_s: float) -> Any:
        async def close(port: Any, *reason: Any) -> None:
            await asyncio.sleep(takes_s)
            port.is_open = False

        return close

    monkeypatch.setattr(fakes.Camera, "__aexit__", closing(3.0), raising=False)
    monkeypatch.setattr(fakes.Recorder, "__aexit__", closing(10.0), raising=False)

    async def scenario(bench: Bench, run: asyncio.Task[None]) -> None:
        await asyncio.sleep(0.5)
        await searching(bench)
        bench.autopilot.takes_s = 4.0
        end(bench, run)

    return fly(fakes, scenario)[0]


def telemetry_ends(bench: Bench, run: asyncio.Task[None]) -> None:
    bench.autopilot.states_end_s = 0.0


def is_cancelled(bench: Bench, run: asyncio.Task[None]) -> None:
    run.cancel()


def is_stopped(bench: Bench, run: asyncio.Task[None]) -> None:
    bench.application.stop()


@pytest.mark.parametrize("end", [telemetry_ends, is_cancelled, is_stopped])
def test_application_that_goes_down_slowly_tells_systemd_before_the_watchdog_bites(
    fakes: Any, monkeypatch: pytest.MonkeyPatch, told: list[tuple[float, str]], end: Any
):
    bench = going_down_slowly(fakes, monkeypatch, end)
    fed_s = max(t_s for t_s, word in told if word == "WATCHDOG=1")
    (stopping_s, _), (asked_s, asked), (ended_s, _) = told[-3:]
    assert [word.partition("=")[0] for _, word in told[-3:]] == ["STOPPING", "EXTEND_TIMEOUT_USEC", "STOPPING"]
    assert stopping_s - fed_s < WATCHDOG_S
    assert stopping_s + 12.9 < ended_s < asked_s + float(asked.partition("=")[2]) / 1e6
    assert bench.asked() == [A.OFFBOARD, A.HOLD]


def test_watchdog_stays_on_as_long_as_the_control_loop_turns(
    fakes: Any, monkeypatch: pytest.MonkeyPatch, told: list[tuple[float, str]]
):
    bench = going_down_slowly(fakes, monkeypatch, is_stopped)
    held_s = bench.autopilot.actions[-1][0] + 4.0
    stopping_s = min(t_s for t_s, word in told if word == "STOPPING=1")
    assert stopping_s == pytest.approx(held_s, abs=0.05)
    fed_s = [t_s for t_s, word in told if word in ("READY=1", "WATCHDOG=1")]
    assert np.diff(fed_s).max() < 0.5
