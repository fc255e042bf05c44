"""`alight run`, which flies a rig until it is told to stop, and `alight check`, which looks at one before a flight."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from app.errors import AlightError
from app.flying import Plan, fly
from app.log import get_logger
from app.review.flight import collect_flight
from app.review.record_reader import read_record
from app.review.report import read_truth, summarise
from app.wiring import Rig, make_camera, open_autopilot

log = get_logger("service")

Finding = tuple[str, bool, str]
"""(part, whether it is a fault, what was found)."""


def run_rig(rig: Rig, out: Path | None, once: bool, console: Console) -> None:
    """Fly a rig until Ctrl-C or SIGTERM, or to the end of the first mission; then write result.json beside the record.

    Raises:
        AlightError: Something doesn't open, or a critical part failed.
    """
    directory = rig.config.recorder.directory
    stamp = f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
    folder = out if out is not None else Path(directory or ".") / stamp
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise AlightError(f"{folder}: can't be made ({fault.strerror})", "give another folder with --out") from None
    plan = Plan(rig.path.stem, rig, folder, once=once)
    used = asyncio.run(fly(plan, console))
    truth = read_truth(plan.truth) if plan.truth.exists() else []
    found = {"experiments": [summarise(plan.title, collect_flight(read_record(plan.record)), truth, **used)]}
    (folder / "result.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    log.info("flight.reviewed", folder=str(folder), outcome=found["experiments"][0]["outcome"])


async def check_rig(rig: Rig, seconds: float) -> list[Finding]:
    """Look at every part; a fault in one hides none in another."""
    found: list[Finding] = [
        (
            "files",
            False,
            f"{rig.path}: landmark {rig.landmark.name} ({rig.landmark.code}), {rig.lens_config.model} lens",
        )
    ]
    parts: list[tuple[str, Callable[[Rig, float], Awaitable[str]]]] = [("autopilot", _check_autopilot)]
    if rig.config.camera.driver == "synthetic":
        found.append(("camera", False, "synthetic: rendered by the simulator when it flies"))
    else:
        parts.insert(0, ("camera", _check_camera))
    for name, look in parts:
        try:
            found.append((name, False, await look(rig, seconds)))
        except AlightError as error:
            found.append((name, True, str(error)))
    return found


async def _check_camera(rig: Rig, seconds: float) -> str:
    frames, first_s, last_s = 0, 0.0, 0.0
    async with make_camera(rig) as camera:
        end_s = time.monotonic() + seconds
        async for frame in camera.frames():
            first_s = first_s or frame.t_capture_s
            last_s, frames = frame.t_capture_s, frames + 1
            if time.monotonic() > end_s:
                break
    rate = (frames - 1) / (last_s - first_s) if last_s > first_s else 0.0
    wanted = rig.config.camera.frame_rate_hz
    if rate < 0.8 * wanted:
        raise AlightError(f"{rate:.1f} frames a second instead of {wanted:g}", "look at exposure and processor load")
    return f"{frames} frames, {rate:.1f} a second"


async def _check_autopilot(rig: Rig, seconds: float) -> str:
    states, ready = 0, False
    async with open_autopilot(rig) as autopilot:
        end_s = time.monotonic() + seconds
        async for state in autopilot.states():
            states += 1
            ready = state.armable
            if time.monotonic() > end_s:
                break
    rate = states / seconds
    if rate < 0.5 * rig.config.autopilot.telemetry_rate_hz:
        wanted = rig.config.autopilot.telemetry_rate_hz
        raise AlightError(f"{rate:.0f} states a second instead of {wanted:g}", "raise the link's baud rate")
    return f"{rig.config.autopilot.address}: {rate:.0f} states a second, {'ready' if ready else 'not ready'} to arm"
