"""What a trial's seed draws from a scenario: the world, and the rig's own figures. Pure.

Every key has a random stream of its own, named after it: a key more in a scenario changes no other one's draw, and two
scenarios that differ in one key fly the same seeds in otherwise the same worlds.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Any

from app.campaign.scenario import Drawn, Range, Scenario
from app.config import PadMotionConfig, RigConfig, WorldConfig
from app.config_world import DecoyConfig, LightConfig, ShadowConfig

DECOYS = ("squares", "triangles", "helipad", "marker", "negative")
KM_H = 3.6


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """One trial, drawn.

    Attributes:
        seed: That drew it.
        rig: The application's configuration, and the world in it.
        wait_s: Before the landing is asked for.
    """

    seed: int
    rig: RigConfig
    wait_s: float

    @property
    def world(self) -> WorldConfig:
        """The simulated world."""
        assert self.rig.simulator is not None
        return self.rig.simulator


@dataclass(frozen=True, slots=True)
class _Draws:
    """Numbers by the names of keys."""

    seed: int

    def stream(self, name: str) -> random.Random:
        return random.Random(f"{name} {self.seed}")

    def number(self, name: str, bounds: Range) -> float:
        low, high = bounds
        return low if low == high else round(self.stream(name).uniform(low, high), 4)

    def all(self, name: str, table: Drawn) -> dict[str, float]:
        """A number for each key of a table that takes a range."""
        values = {key: getattr(table, key) for key in type(table).model_fields}
        return {key: self.number(f"{name}.{key}", v) for key, v in values.items() if isinstance(v, tuple)}


def draw_trial(scenario: Scenario, rig: RigConfig, seed: int) -> TrialPlan:
    """The trial of a seed.

    Args:
        scenario: What is drawn from.
        rig: The scenario's rig, its overrides in it.
        seed: Of everything.
    """
    draws = _Draws(seed)
    start, camera = draws.all("start", scenario.start), draws.all("camera", scenario.camera)
    search = {"search_height_m": start["height_m"]}
    drawn = rig.model_copy(
        update={
            "simulator": _world(scenario, draws, start, camera),
            "camera": rig.camera.model_copy(update={"frame_rate_hz": camera["rate_hz"]}),
            "mission": rig.mission.model_copy(update=search),
        }
    )
    return TrialPlan(seed, drawn, draws.number("order.wait_s", scenario.order.wait_s))


def _world(scenario: Scenario, draws: _Draws, start: dict[str, float], camera: dict[str, float]) -> WorldConfig:
    wind, light = draws.all("wind", scenario.wind), draws.all("light", scenario.light)
    low, high = scenario.light.level
    level = math.exp(draws.stream("light.level").uniform(math.log(low), math.log(high)))
    shadow = None
    if scenario.light.shadow:
        shadow = ShadowConfig(
            toward_deg=draws.number("light.shadow_toward_deg", (0.0, 360.0)),
            offset_m=light["shadow_offset_m"],
            light=light["shadow_light"],
        )
    motion = _motion(scenario, draws, start)
    return WorldConfig(
        seed=draws.seed,
        start_heading_deg=start["heading_deg"],
        gnss=scenario.vehicle.gnss,
        estimate_error=draws.number("vehicle.estimate_error", scenario.vehicle.estimate_error),
        parameters=scenario.vehicle.parameters,
        ground=draws.stream("ground").choice(scenario.ground),
        wind_m_s=wind["speed_m_s"],
        gust_m_s=wind["gust_m_s"],
        wind_from_deg=wind["from_deg"],
        sun_elevation_deg=light["sun_elevation_deg"],
        sun_azimuth_deg=light["sun_azimuth_deg"],
        noise_dn=camera["noise_dn"],
        camera_latency_s=camera["latency_ms"] / 1e3,
        camera_clock_error_s=camera["clock_error_ms"] / 1e3,
        light=LightConfig(level=level, glare=light["glare"], shadow=shadow),
        motion=motion,
        occlusion=scenario.occlusion,
        decoys=_decoys(scenario, draws),
    )


def _motion(scenario: Scenario, draws: _Draws, start: dict[str, float]) -> PadMotionConfig:
    pad, bearing = draws.all("pad", scenario.pad), math.radians(start["bearing_deg"])
    side = draws.stream("pad.bend_side").choice((-1.0, 1.0))
    figures: dict[str, Any] = {
        key: pad[key]
        for key in (
            "heading_deg", "height_m", "deck_m", "start_after_s", "acceleration_m_s2", "bend_after_s", "brake_m_s2",
            "roll_deg", "pitch_deg", "heave_m", "wave_period_s",
        )
    }  # fmt: skip
    return PadMotionConfig(
        north_m=start["distance_m"] * math.cos(bearing),
        east_m=start["distance_m"] * math.sin(bearing),
        carrier=scenario.pad.carrier,
        start_near_m=scenario.pad.start_near_m,
        speed_m_s=pad["speed_km_h"] / KM_H,
        bend_radius_m=side * pad["bend_radius_m"],
        brake_after_s=pad["brake_after_s"] if scenario.pad.brakes else None,
        **figures,
    )


def _decoys(scenario: Scenario, draws: _Draws) -> tuple[DecoyConfig, ...]:
    """Spread round the pad, each in a sector of its own."""
    count = round(draws.number("decoys.count", scenario.decoys.count))
    first = draws.number("decoys.bearing_deg", (0.0, 360.0))
    found = []
    for k in range(count):
        bearing = math.radians(first + 360.0 * k / count)
        distance_m = draws.number(f"decoys.{k}.distance_m", scenario.decoys.distance_m)
        found.append(
            DecoyConfig(
                kind=draws.stream(f"decoys.{k}.kind").choice(DECOYS),  # type: ignore[arg-type]  # checked by pydantic
                forward_m=distance_m * math.cos(bearing),
                right_m=distance_m * math.sin(bearing),
                heading_deg=draws.number(f"decoys.{k}.heading_deg", (0.0, 360.0)),
                size_m=draws.number(f"decoys.{k}.size_cm", scenario.decoys.size_cm) / 100.0,
            )
        )
    return tuple(found)
