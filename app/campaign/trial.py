"""One trial: the application flies a drawn world under virtual time, a person's phone gives the orders.

The script of that person looks at the truth as people do (the car has reached its speed; the drone stands on the deck)
and tells the application nothing but orders.
"""

from __future__ import annotations

import asyncio
import gc
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path

from app.campaign.draw import TrialPlan, draw_trial
from app.campaign.outcome import AT_REST, Ending, TrialResult, failure_of, touchdown_of
from app.campaign.scenario import Scenario, overridden, read_scenario, rig_path
from app.clock import LoopClock, run_virtual
from app.errors import AlightError
from app.messages import CommandResult, OperatorAction, Phase
from app.vision.geometry import LandmarkGeometry
from app.wiring import Rig, load_rig
from app.wiring_virtual import VirtualFlight, fly

POLL_S = 0.05
READY_S = 0.5
"""The camera is seen and the link is up; then the phone speaks."""
ASK_AGAIN_S = 1.0
LINGER_S = 1.0
"""After the end: a vehicle that slides off the deck does so now."""
STOP_S = 10.0
"""A vehicle in the air gets longer: from 50 km/h PX4 needs 6 s to stand."""
PX4_LANDS = frozenset({Phase.FALLBACK_LAND, Phase.RETURN})
"""PX4 flies on to the ground by itself: that is looked at too."""


@dataclass(frozen=True, slots=True)
class Course:
    """A scenario that is ready to be flown.

    Attributes:
        name: Of the scenario.
        argument: What names it on the command line.
        scenario: What its file says.
        rig: Its rig, overrides in it.
        geometry: Of the rig's landmark, for the detectors of all trials.
    """

    name: str
    argument: str
    scenario: Scenario
    rig: Rig
    geometry: LandmarkGeometry


def load_course(path: Path, argument: str) -> Course:
    """A scenario file with its rig.

    Raises:
        AlightError: A file is missing or wrong.
    """
    scenario = read_scenario(path)
    rig = load_rig(rig_path(path, scenario))
    rig = replace(rig, config=overridden(path, scenario, rig.config))
    return Course(path.stem, argument, scenario, rig, LandmarkGeometry(rig.landmark))


def fly_trial(course: Course, seed: int) -> TrialResult:
    """Fly the trial of a seed. The same course and seed give the same result, but for wall_s."""
    start_s = time.monotonic()
    plan = draw_trial(course.scenario, course.rig.config, seed)
    flown = _Flown()
    try:
        run_virtual(_fly(course, plan, flown))
        result = flown.result(course, plan)
    except AlightError as error:
        result = TrialResult(course.name, seed, f"failed: {error}", simulated_s=flown.simulated_s)
    finally:
        gc.unfreeze()  # the application freezes what lives as long as it does
        gc.collect()
    return replace(result, wall_s=time.monotonic() - start_s)


class _Flown:
    """What is kept of a flight."""

    def __init__(self) -> None:
        self.flight: VirtualFlight | None = None
        self.ordered_s = 0.0
        self.timed_out = False

    @property
    def simulated_s(self) -> float:
        return 0.0 if self.flight is None else self.flight.world.world.t_s

    def result(self, course: Course, plan: TrialPlan) -> TrialResult:
        flight = self.flight
        assert flight is not None
        contacts, report = tuple(flight.contacts), flight.reports[-1] if flight.reports else None
        truth = flight.world.truth()
        ending = Ending(
            contacts,
            flight.phase,
            "" if report is None else report.reason,
            flight.world.px4.commander.armed,
            self.timed_out,
            math.hypot(truth.vel[0], truth.vel[1]),
            -truth.pos[2],
        )
        reason = failure_of(ending, course.scenario.success.deck_tilt_max_deg)
        touchdown, rest = touchdown_of(contacts), contacts[-1] if contacts else None
        landed = reason is None and rest is not None
        tries = 1 + max((r.tries for r in flight.reports), default=0)
        result = TrialResult(
            course.name,
            plan.seed,
            reason,
            time_to_land_s=rest.t_s - self.ordered_s if landed and rest is not None else None,
            tries=tries,
            simulated_s=self.simulated_s,
        )
        if touchdown is None:
            return result
        return replace(
            result,
            touchdown_error_m=touchdown.error_m,
            touchdown_forward_m=touchdown.forward_m,
            touchdown_right_m=touchdown.right_m,
            touchdown_speed_m_s=touchdown.impact_m_s,
        )


async def _fly(course: Course, plan: TrialPlan, flown: _Flown) -> None:
    async def script(flight: VirtualFlight) -> None:
        flown.flight = flight
        try:
            async with asyncio.timeout(course.scenario.time_limit_s):
                await _person(flight, plan, flown)
        except TimeoutError:
            flown.timed_out = True

    await fly(replace(course.rig, config=plan.rig), script, course.geometry)


async def _person(flight: VirtualFlight, plan: TrialPlan, flown: _Flown) -> None:
    """Have it follow a pad that will drive, and have it land once it does; on a pad at rest: have it land."""
    clock, world = LoopClock(), flight.world.world
    await asyncio.sleep(READY_S)
    drives = plan.world.motion.speed_m_s > 0.0
    aim = OperatorAction.TRACK if drives else OperatorAction.LAND
    asked_s, begun, over_s = -ASK_AGAIN_S, False, 0.0
    while over_s < (STOP_S if flight.phase in AT_REST and flight.world.px4.commander.armed else LINGER_S):
        begun = begun or flight.phase is not Phase.IDLE
        if aim is OperatorAction.TRACK and world.pad.at_speed_s > 0.0 and world.pad.at_speed_s >= plan.wait_s:
            aim, asked_s = OperatorAction.LAND, -ASK_AGAIN_S
        refused = bool(flight.phone.answers) and flight.phone.answers[-1].result is not CommandResult.IN_PROGRESS
        wanted = not begun if aim is OperatorAction.TRACK else flown.ordered_s == 0.0 or (not begun and refused)
        if wanted and clock.now_s() - asked_s >= ASK_AGAIN_S and (drives or world.t_s >= plan.wait_s):
            flight.phone.ask(aim, clock.now_s())
            asked_s = clock.now_s()
            if aim is OperatorAction.LAND:
                flown.ordered_s = world.t_s
        await asyncio.sleep(POLL_S)
        over_s = over_s + POLL_S if begun and _is_over(flight) else 0.0


def _is_over(flight: VirtualFlight) -> bool:
    """Nothing more will come of it."""
    if any(contact.kind == "crash" for contact in flight.contacts):
        return True
    if flight.phase in PX4_LANDS:
        return not flight.world.px4.commander.armed
    return flight.phase in (Phase.LANDED, Phase.HOLD, Phase.IDLE)
