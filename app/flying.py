"""One flight from a terminal: starts what the rig needs (the simulator, where it is synthetic), runs the application,
shows it, and reviews the record afterwards.
"""

from __future__ import annotations

import asyncio
import os
import resource
import signal
import sys
import tempfile
import time
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from rich.console import Console

from app.channels import Latest
from app.display import Display, Watched
from app.errors import AlightError
from app.messages import Detection, MissionReport, OperatorAction, Phase, VehicleState
from app.orders import Caller, Order
from app.runtime import Application
from app.wiring import Rig, build_application, build_simulator

REFRESH_S = 0.25
SWITCH_INTERVAL_S = 0.001
"""The interpreter's: vision's thread holds it no longer than this (5 ms by default) when a setpoint is due."""
FIRST_FRAME_S = 20.0
"""For a camera that is rendered from a PX4's ground truth: that comes at once, or there is none."""
LINGER_S = 1.5
"""After a mission's end: the record shows that the vehicle rests where it landed."""
ENDED = frozenset({Phase.LANDED, Phase.IDLE, Phase.HOLD})
"""The phases in which a mission is over, once it has begun."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be flown.

    Attributes:
        title: For the display.
        rig: The rig.
        folder: Where record and truth go; it exists. None for neither.
        orders: What the phone is to ask for, one after the other; none: a person's own phone will.
        once: End after the first mission.
        timeout_s: End after this long in any case; None for never.
        logged: The log tells each change of state, so the display need not.
    """

    title: str
    rig: Rig
    folder: Path | None
    orders: tuple[Order, ...] = ()
    once: bool = False
    timeout_s: float | None = None
    logged: bool = False

    @property
    def record(self) -> Path | None:
        """The flight record."""
        return None if self.folder is None else self.folder / "flight.mcap"

    @property
    def truth(self) -> Path | None:
        """The simulator's log."""
        return None if self.folder is None else self.folder / "truth.jsonl"


class Ended(StrEnum):
    """Why the flying ended."""

    OVER = "over"
    """The mission came to its own end."""
    INTERRUPTED = "interrupted"
    """Somebody asked for it: Ctrl-C, or the system's SIGTERM or SIGHUP."""
    TIMED_OUT = "timed out"
    """The plan's time was up."""


@dataclass(frozen=True, slots=True)
class Flown:
    """How a plan was flown.

    Attributes:
        ended: Why it ended.
        cpu_percent: Processor time of "application" and "simulator", in percent of one core.
    """

    ended: Ended
    cpu_percent: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Seen:
    """What is looked at while a plan is flown."""

    reports: Latest[MissionReport]
    vehicle: Latest[VehicleState]
    detections: Latest[Detection]


async def fly(plan: Plan, console: Console) -> Flown:
    """Fly a plan to its end.

    Raises:
        AlightError: Something doesn't open, or failed.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    async with AsyncExitStack() as stack:
        source, simulator = None, None
        if plan.rig.config.camera.driver == "synthetic":
            scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix="alight-"))
            source = str(Path(scratch) / "frames")
            simulator = build_simulator(plan.rig, frames=Path(source), truth=plan.truth)
            await stack.enter_async_context(simulator)
        application = build_application(plan.rig, source=source, record=plan.record)
        reports = application.reports.subscribe()
        vehicle = application.vehicle.subscribe()
        detections = application.detections.subscribe()
        watched = Watched(
            vehicle=application.vehicle.subscribe(),
            detections=application.detections.subscribe(),
            tracks=application.tracks.subscribe(),
            statuses=application.statuses.subscribe(),
            reports=application.reports.subscribe(),
            texts=application.texts.subscribe(),
        )
        signals = _stop_on_signals(application)
        wall_s, own_s = time.monotonic(), _own_cpu_s()
        simulated_s = _cpu_s(simulator.pid) if simulator is not None else 0.0
        running = asyncio.create_task(application.run(), name="application")
        with Display(plan.title, watched, console, tells=not plan.logged) as display:
            try:
                ended = await _attend(plan, running, Seen(reports, vehicle, detections), display)
            finally:
                application.stop()
                await asyncio.wait([running])
        running.result()
        wall_s, own_s = time.monotonic() - wall_s, _own_cpu_s() - own_s
        used = {"application": round(100 * own_s / wall_s, 1)}
        if simulator is not None:
            used["simulator"] = round(100 * (_cpu_s(simulator.pid) - simulated_s) / wall_s, 1)
        return Flown(Ended.INTERRUPTED if signals else ended, used)


async def _attend(plan: Plan, running: asyncio.Task[None], seen: Seen, display: Display) -> Ended:
    """Show the flight, let the phone speak when the vehicle is ready, and leave when it is over."""
    start_s = time.monotonic()
    caller = Caller(plan.orders, lambda action: _phone(plan.rig.config.operator.address, action))
    begun = False
    over_since_s: float | None = None
    ended = Ended.OVER
    try:
        while not running.done():
            now_s = time.monotonic()
            display.refresh(now_s)
            report, state = seen.reports.newest, seen.vehicle.newest
            if report is not None:
                begun = begun or report.phase not in (Phase.IDLE, Phase.LANDED)
                over = plan.once and begun and report.phase in ENDED and report.command is None
                over_since_s = (over_since_s or now_s) if over else None
                if over_since_s is not None and now_s - over_since_s > LINGER_S:
                    break
            if plan.orders and not begun:
                _check_truth(plan, seen, now_s - start_s)
            caller.turn(now_s, ready=state is not None and state.armable and report is not None, begun=begun)
            if plan.timeout_s is not None and now_s - start_s > plan.timeout_s:
                ended = Ended.TIMED_OUT
                break
            await asyncio.wait([running], timeout=REFRESH_S)
        display.refresh(time.monotonic())
        if over_since_s is not None:
            await caller.hear_out()
    finally:
        await caller.hang_up()
    return ended


def _check_truth(plan: Plan, seen: Seen, waited_s: float) -> None:
    """A PX4 that gives no ground truth gives no frames either, and nothing would ever begin.

    Raises:
        AlightError: So it is, or the vehicle flies already: the world is built round a vehicle at rest on the ground.
    """
    world = plan.rig.config.simulator
    if world is None or world.vehicle != "px4" or seen.reports.newest is None:
        return
    if seen.vehicle.newest is not None and seen.vehicle.newest.armed:
        raise AlightError("PX4 is armed already", "land and disarm it, or start it anew, and fly again")
    if seen.detections.newest is None and waited_s > FIRST_FRAME_S:
        raise AlightError(
            f"no ground truth of PX4's on {world.px4_truth_address} within {FIRST_FRAME_S:.0f} s",
            "start PX4 with PX4_SIM_MODEL=sihsim_quadx (SIH sends it to port 19410 + instance), and see that no other "
            "program takes it",
        )


async def _phone(address: str, order: OperatorAction) -> str:
    """`alight phone` as a process of its own: an independent ground station. Returns the last line that it printed."""
    command = [sys.executable, "-m", "app", "phone", order.name.lower(), "--address", address]
    process = await asyncio.create_subprocess_exec(
        *command,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        start_new_session=True,  # a terminal's Ctrl-C is for the application, which ends this
    )
    try:
        words, _ = await process.communicate()
    except asyncio.CancelledError:
        with suppress(ProcessLookupError):
            process.terminate()
        await process.wait()
        raise
    lines = [line for line in words.decode(errors="replace").splitlines() if line.strip()]
    told = [line for line in lines if "refused" in line] or lines
    return told[-1] if told else "the phone said nothing"


def _stop_on_signals(application: Application) -> list[int]:
    """From now on the signals that end a program end the application in order. Returns those that came, as they come.

    A terminal that hangs up counts too, unless the program was started to outlive it (nohup).
    """
    came: list[int] = []

    def stop(number: int) -> None:
        came.append(number)
        application.stop()

    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            loop.add_signal_handler(number, stop, number)
    return came


def _own_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _cpu_s(pid: int) -> float:
    """Processor time of another process so far; 0 where the system doesn't tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
