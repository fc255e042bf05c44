"""`alight run`, which flies a rig until it is told to stop, and `alight check`, which looks at one before a flight."""

from __future__ import annotations

import asyncio
import shutil
import time
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from rich.console import Console

from app.debrief import RESULT, failed, files_of, own_folder, review, set_aside, write_result
from app.errors import AlightError, ConfigError
from app.flying import Plan, fly
from app.log import get_logger
from app.systemd import Watchdog
from app.wiring import PARAMETERS, Rig, check_operator, make_camera, make_links

log = get_logger("service")

REVIEW_S = 120.0
"""systemd is asked to wait this long for the review of a long record."""
FREE_MIN_GB = 0.5
"""A record with images at their full rate grows by 1 to 2 GB an hour."""


class Verdict(StrEnum):
    """What `alight check` writes before each line."""

    OK = "ok"
    NOTE = "note"
    FAULT = "FAULT"


Finding = tuple[str, Verdict, str]
"""(part, verdict, what was found)."""


def run_rig(rig: Rig, out: Path | None, once: bool, console: Console) -> None:
    """Fly a rig until Ctrl-C or SIGTERM, or to the end of the first mission; then write result.json beside the record.

    Without `out`, and with an empty recorder.directory, nothing is written.

    Raises:
        AlightError: Something doesn't open, or a critical part failed.
    """
    folder = out
    if folder is None and (directory := record_directory(rig)) is not None:
        folder = directory / f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
    plan = Plan(rig.path.stem, rig, folder, once=once, logged=True)
    if folder is None:
        asyncio.run(fly(plan, console))
        return
    with own_folder(folder):
        set_aside(*files_of(plan), folder / RESULT)
        try:
            flown = asyncio.run(fly(plan, console))
        except AlightError as error:
            if plan.record is not None and plan.record.exists():
                _ask_for_review_time()
                write_result(folder, [failed(plan, error)])
            raise
        _ask_for_review_time()
        _, entry = review(plan, flown)
        write_result(folder, [entry])
    log.info("flight.reviewed", folder=str(folder), outcome=entry["outcome"], reason=entry["reason"])


def record_directory(rig: Rig) -> Path | None:
    """Where a rig's flights are recorded, with ~ for the user's home; None for nowhere.

    Raises:
        ConfigError: It begins with the ~ of a user who isn't known.
    """
    directory = rig.config.recorder.directory
    try:
        return Path(directory).expanduser() if directory else None
    except RuntimeError:
        raise ConfigError(
            f"{rig.path}: recorder.directory = {directory!r}: no such user's home", "give the folder's whole path"
        ) from None


def _ask_for_review_time() -> None:
    """A long record takes longer to read than systemd waits for a service that is going down."""
    watchdog = Watchdog()
    watchdog.busy(REVIEW_S)
    watchdog.close()


async def check_rig(rig: Rig, seconds: float) -> list[Finding]:
    """Look at every part; a fault in one hides none in another."""
    found: list[Finding] = [
        (
            "files",
            Verdict.OK,
            f"{rig.path}: landmark {rig.landmark.name} ({rig.landmark.code}), {rig.lens_config.model} lens",
        )
    ]
    parts: list[tuple[str, Callable[[Rig, float], Awaitable[str | list[Finding]]]]] = [
        ("record", _check_record),
        ("autopilot", _check_autopilot),
        ("phone", _check_phone),
    ]
    if rig.config.camera.driver == "synthetic":
        found.append(("camera", Verdict.OK, "synthetic: rendered by the simulator when it flies"))
    else:
        parts.insert(0, ("camera", _check_camera))
    for name, look in parts:
        try:
            told = await look(rig, seconds)
            found += [(name, Verdict.OK, told)] if isinstance(told, str) else told
        except AlightError as error:
            found.append((name, Verdict.FAULT, str(error)))
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


async def _check_record(rig: Rig, seconds: float) -> str:
    directory = record_directory(rig)
    if directory is None:
        return "none is made: recorder.directory is empty"
    with own_folder(directory):
        free_gb = shutil.disk_usage(directory).free / 1e9
        if free_gb < FREE_MIN_GB:
            raise AlightError(f"{directory}: {free_gb:.2f} GB free", f"free {FREE_MIN_GB:g} GB")
    return f"{directory}: {free_gb:.1f} GB free"


async def _check_autopilot(rig: Rig, seconds: float) -> list[Finding]:
    """The link and PX4's parameters. A difference is a fault where the rig requires the parameters to match."""
    autopilot, _ = make_links(rig)
    config = rig.config.autopilot
    states, ready = 0, False
    async with autopilot:
        end_s = time.monotonic() + seconds
        async for state in autopilot.states():
            states += 1
            ready = state.armable
            if time.monotonic() > end_s:
                break
        differing = autopilot.parameter_findings
    rate, wanted = states / seconds, config.telemetry_rate_hz
    told = f"{config.address}: {rate:.0f} states a second, {'ready' if ready else 'not ready'} to arm"
    found: list[Finding] = [("autopilot", Verdict.OK, told)]
    if rate < 0.5 * wanted:
        found = [("autopilot", Verdict.FAULT, f"{told}; {wanted:g} are wanted: raise the link's baud rate")]
    verdict = Verdict.FAULT if config.check_parameters == "refuse" else Verdict.NOTE
    found += [("parameters", verdict, finding.words) for finding in differing]
    if config.check_parameters == "off":
        found.append(("parameters", Verdict.NOTE, "not compared: autopilot.check_parameters is off"))
    elif not differing:
        found.append(("parameters", Verdict.OK, f"PX4's failsafes are set as {PARAMETERS} says"))
    return found


async def _check_phone(rig: Rig, seconds: float) -> str:
    address = rig.config.operator.address
    if not address:
        return "comes through the autopilot's link"
    check_operator(rig)
    return f"{address}: free to listen on"
