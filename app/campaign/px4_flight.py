"""`alight run --scenario`: one trial of a scenario, flown by a real PX4 SITL in real time.

The trial is drawn as a campaign draws it, and judged by the same rules. PX4 flies its own vehicle in its own world, of
which the camera is told; what of a scenario lies there is said in words, and kept in result.json.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from app.campaign.command import SCENARIOS
from app.campaign.draw import TrialPlan, draw_trial
from app.campaign.outcome import Ending, failure_of
from app.campaign.scenario import Scenario, overridden, read_scenario, scenario_path
from app.config import WorldConfig
from app.debrief import RESULT, failed, files_of, own_folder, review, set_aside, write_result
from app.errors import AlightError, ConfigError
from app.flying import Ended, Flown, Plan, fly
from app.log import get_logger
from app.messages import OperatorAction, Phase
from app.orders import Order
from app.review.flight import Flight
from app.review.report import read_truth
from app.wiring import Rig
from app.wiring_virtual import Contact

log = get_logger("scenario")

AT_SPEED = 0.99
"""A pad drives at its whole speed from this part of it on."""


def fly_scenario(rig: Rig, argument: str, seed: int, out: Path | None, console: Console) -> dict[str, Any]:
    """Fly the trial of a seed to its end, and write its folder.

    Args:
        rig: With simulator.vehicle = "px4".
        argument: The scenario: a name of those that ship, or a path.
        seed: Of the trial.
        out: Folder; None: a new one in the rig's.
        console: Where to show it.

    Returns:
        Its entry of result.json: beside what every flight has "scenario", "seed", "success", "failure" (the named
        reason, or None), "not_applied" (sentences) and "folder".

    Raises:
        ConfigError: The rig, the scenario or a value is wrong, or PX4 can't be made to fly it.
        AlightError: Something doesn't open, or failed.
        KeyboardInterrupt: It was interrupted; the folder is written.
    """
    path = scenario_path(argument, SCENARIOS)
    scenario = read_scenario(path)
    ours = _world_of_px4(rig, argument)
    trial = draw_trial(scenario, overridden(path, scenario, rig.config), seed)
    refuse(path, scenario)
    not_applied = left_out(scenario, trial.world)
    for sentence in not_applied:
        log.warning("scenario.not_applied", what=sentence)
    folder = out
    if folder is None:
        stamp = f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
        folder = Path(rig.config.recorder.directory or "flights").expanduser() / f"{path.stem}-{seed}-{stamp}"
    drawn = replace(rig, config=trial.rig).with_world(in_px4s_world(trial.world, ours))
    more = {"scenario": path.stem, "seed": seed, "not_applied": not_applied, "folder": str(folder)}
    with own_folder(folder):
        plan = Plan(
            f"{path.stem}, seed {seed}",
            drawn,
            folder,
            orders_of(trial, folder / "truth.jsonl"),
            once=True,
            timeout_s=scenario.time_limit_s,
            logged=True,
        )
        set_aside(*files_of(plan), folder / RESULT)
        try:
            flown = asyncio.run(fly(plan, console))
        except AlightError as error:
            write_result(folder, [{**failed(plan, error), **more, "success": False, "failure": f"failed: {error}"}])
            raise
        flight, entry = review(plan, flown)
        failure = judge(flight, read_truth(folder / "truth.jsonl"), flown, scenario, drives=_drives(trial))
        entry = {**entry, **more, "success": failure is None, "failure": failure}
        write_result(folder, [entry])
    if flown.ended is Ended.INTERRUPTED:
        raise KeyboardInterrupt
    return entry


def _world_of_px4(rig: Rig, argument: str) -> WorldConfig:
    world = rig.config.simulator
    if world is None or world.vehicle != "px4" or rig.config.camera.driver != "synthetic":
        raise ConfigError(
            f'{rig.path}: a scenario wants camera.driver = "synthetic" and simulator.vehicle = "px4"',
            f"give configs/sitl.toml, or fly the built-in simulator: alight campaign --scenario {argument}",
        )
    return world


def _drives(trial: TrialPlan) -> bool:
    return trial.world.motion.speed_m_s > 0.0


# ----------------------------------------------------------------------------------------- what PX4's own world allows
def refuse(path: Path, scenario: Scenario) -> None:
    """See that the scenario can be flown at all.

    Raises:
        ConfigError: PX4's world can't have what the scenario is about.
    """
    pad, do = scenario.pad, f"fly the built-in simulator: alight campaign --scenario {path.stem}"
    if max(pad.roll_deg[1], pad.pitch_deg[1], pad.heave_m[1]) > 0.0:
        raise ConfigError(f"{path}: the deck rides on waves, and the ground of PX4's SITL stands still", do)
    if not scenario.vehicle.gnss:
        raise ConfigError(f"{path}: vehicle.gnss = false, and PX4's SITL has its GNSS", do)


def left_out(scenario: Scenario, world: WorldConfig) -> list[str]:
    """What of a drawn scenario is PX4's own, and therefore not applied: a sentence each."""
    found = []
    if "wind" in scenario.model_fields_set:
        found.append(f"wind of {world.wind_m_s:.1f} m/s: PX4's simulator has its own, and SIH none")
    if world.motion.height_m > 0.0:
        found.append(
            f"pad {world.motion.height_m:.1f} m above the ground: PX4's ground is one plane, the pad lies on it"
        )
    if {"heading_deg"} & scenario.start.model_fields_set:
        found.append("start.heading_deg: PX4's vehicle stands as PX4 starts it")
    if "estimate_error" in scenario.vehicle.model_fields_set:
        found.append("vehicle.estimate_error: PX4's estimate has its own errors")
    if scenario.vehicle.parameters:
        names = ", ".join(f"{name} {value:g}" for name, value in scenario.vehicle.parameters.items())
        found.append(f"vehicle.parameters: set them in PX4 yourself ({names})")
    if scenario.rig:
        found.append(f"rig {scenario.rig}: the one of --config is flown")
    return found


def in_px4s_world(drawn: WorldConfig, ours: WorldConfig) -> WorldConfig:
    """The drawn world round PX4's vehicle: on PX4's ground, with the rig's own address of the truth."""
    motion = drawn.motion.model_copy(update={"height_m": 0.0})
    return drawn.model_copy(update={"vehicle": "px4", "px4_truth_address": ours.px4_truth_address, "motion": motion})


# ----------------------------------------------------------------------------------------------- the person's orders
def orders_of(trial: TrialPlan, truth: Path) -> tuple[Order, ...]:
    """As in a campaign: follow a pad that will drive, and land once it does; land on a pad at rest."""
    if _drives(trial):
        at_speed = DrivesFor(truth, trial.world.motion.speed_m_s, trial.wait_s)
        return Order(OperatorAction.TRACK), Order(OperatorAction.LAND, at_speed)
    return (Order(OperatorAction.LAND, _after(trial.wait_s)),)


def _after(wait_s: float) -> Callable[[], bool]:
    start_s = time.monotonic()
    return lambda: time.monotonic() - start_s >= wait_s


class DrivesFor:
    """Sees in the log of the truth, as it grows, that the pad has driven at its whole speed for a time.

    Args:
        truth: The log; it may not be there yet.
        speed_m_s: The whole speed.
        wait_s: The time.
    """

    def __init__(self, truth: Path, speed_m_s: float, wait_s: float) -> None:
        self._truth, self._speed_m_s, self._wait_s = truth, speed_m_s, wait_s
        self._read = 0
        self._since_s: float | None = None
        self._long_enough = False

    def __call__(self) -> bool:
        """Whether it has."""
        if self._truth.exists():
            with self._truth.open("rb") as file:
                file.seek(self._read)
                lines = file.read()
            whole = lines.rpartition(b"\n")[0]
            self._read += len(whole) + 1 if whole else 0
            for line in whole.splitlines():
                self._take(json.loads(line))
        return self._long_enough

    def _take(self, line: dict[str, Any]) -> None:
        if line["kind"] != "state":
            return
        if self._since_s is None and math.hypot(*line["pad_vel_ned_m_s"]) >= AT_SPEED * self._speed_m_s:
            self._since_s = line["t_s"]
        self._long_enough = self._long_enough or (
            self._since_s is not None and line["t_s"] - self._since_s >= self._wait_s
        )


# ------------------------------------------------------------------------------------------------------ the judgement
def judge(flight: Flight, truth: list[dict[str, Any]], flown: Flown, scenario: Scenario, *, drives: bool) -> str | None:
    """The named reason of a failure by a campaign's rules; None: it landed.

    PX4's ground stands still: a vehicle that has landed is left behind by a pad that drives. There the touchdown says
    where it came to rest.
    """
    contacts = tuple(Contact(**line) for line in truth if line["kind"] in ("touchdown", "rest", "crash"))
    touched = [contact for contact in contacts if contact.kind == "touchdown"]
    if drives and touched:
        contacts = tuple(
            replace(contact, on_deck=touched[-1].on_deck) if contact.kind == "rest" else contact for contact in contacts
        )
    last = next((line for line in reversed(truth) if line["kind"] == "state"), None)
    if last is None or not flight.phases:
        return "not flown"
    _, phase, words = flight.phases[-1]
    ending = Ending(
        contacts,
        Phase(phase),
        words,
        bool(last["armed"]),
        flown.ended is Ended.TIMED_OUT,
        math.hypot(*last["vel_ned_m_s"][:2]),
        -float(last["pos_ned_m"][2]),
    )
    if flown.ended is Ended.INTERRUPTED:
        return "interrupted"
    return failure_of(ending, scenario.success.deck_tilt_max_deg)


def words_of(entry: dict[str, Any]) -> str:
    """A flight in a line or two."""

    def figure(key: str, form: str, scale: float = 1.0) -> str:
        return "-" if entry[key] is None else form.format(entry[key] * scale)

    outcome = "landed" if entry["success"] else f"failed: {entry['failure']}"
    return (
        f"{entry['scenario']}, seed {entry['seed']}: {outcome}\n"
        f"touchdown {figure('touchdown_error_m', '{:.1f} cm', 100)} from the pad's centre, "
        f"{figure('touchdown_speed_m_s', '{:.2f} m/s')} relative to it, "
        f"sink {figure('touchdown_sink_m_s', '{:.2f} m/s')}; written to {entry['folder']}"
    )
