"""Scenario files: configs/scenarios/*.toml. What is drawn for each trial, and within which bounds.

A key that takes a range holds one number, or [low, high]: then each trial draws from it. Units are in the names.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from app.config import RigConfig, checked, read_config, resolve
from app.config_world import OcclusionConfig
from app.errors import ConfigError
from app.sections import Section
from app.wiring import CONFIGS

SUFFIX = ".toml"
SIMULATOR = "simulator.toml"
"""The rig of a scenario that names none."""
ANOTHER_RIG = "name a rig that has it: rig = ..."
SAID_ELSEWHERE = {
    "simulator": "the world is drawn: say it in [start], [pad], [wind], [light], [camera] or [vehicle]",
    "mission.search_height_m": "it is drawn: say it as height_m in [start]",
    "camera.frame_rate_hz": "it is drawn: say it as rate_hz in [camera]",
    "camera.driver": "a trial flies with the simulator's camera",
    "camera.lens": ANOTHER_RIG,
    "vision.height_table": ANOTHER_RIG,
}
"""Keys of a rig that an override can't change, and what to do instead."""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _pair(value: Any) -> Any:
    """One number is a range of itself."""
    if _is_number(value):
        return value, value
    if isinstance(value, list | tuple) and len(value) == 2 and all(map(_is_number, value)):
        return tuple(value)
    raise PydanticCustomError("range", "must be a number, or [low, high]")


Range = Annotated[tuple[float, float], BeforeValidator(_pair)]
"""A number, or [low, high]."""


def _range(low: float, high: float, default: tuple[float, float], description: str) -> Any:
    """A key of type Range with the limits of its values."""
    return Field(default=default, description=description, json_schema_extra={"low": low, "high": high})


class Drawn(Section):
    """A table with keys that are drawn."""

    @model_validator(mode="after")
    def _within_limits(self) -> Drawn:
        for key, field in type(self).model_fields.items():
            limits = field.json_schema_extra
            if not isinstance(limits, dict):
                continue
            low, high = getattr(self, key)
            least, most = float(str(limits["low"])), float(str(limits["high"]))
            shown = f"{low:g}" if low == high else f"[{low:g}, {high:g}]"
            if not least <= low <= high <= most:
                order = " and in order" if low > high else ""
                raise ValueError(f"{key} = {shown} must be within {least:g}..{most:g}{order}")
        return self


class WindDraw(Drawn):
    """[wind]: a steady part and gusts."""

    speed_m_s: Range = _range(0, 20, (0.0, 2.0), "steady part")
    gust_m_s: Range = _range(0, 10, (0.2, 0.6), "standard deviation of the gusts along each horizontal axis")
    from_deg: Range = _range(-360, 360, (0.0, 360.0), "where it comes from, clockwise from north")


class LightDraw(Drawn):
    """[light]: daylight, sun, and a shadow's edge."""

    level: Range = _range(0.0005, 2, (0.3, 1.0), "1: noon; 0.1: a dull day; 0.002: dusk, 200 lux; drawn even in stops")
    sun_elevation_deg: Range = _range(5, 90, (30.0, 65.0), "of the sun above the horizon")
    sun_azimuth_deg: Range = _range(-360, 360, (0.0, 360.0), "of the sun, clockwise from north")
    glare: Range = _range(0, 10, (0.0, 0.0), "the sun mirrored in wet ground and glossy print; 1: as bright as white")
    shadow: bool = Field(default=False, description="the straight edge of a building's shadow lies across the pad")
    shadow_light: Range = _range(0.05, 1, (0.15, 0.4), "light that is left in the shadow")
    shadow_offset_m: Range = _range(-10, 10, (-0.2, 0.2), "of the shadow's edge from the pad's centre")


class StartDraw(Drawn):
    """[start]: where the vehicle begins, and how high it searches."""

    distance_m: Range = _range(0, 100, (1.0, 4.0), "from home to the pad")
    bearing_deg: Range = _range(-360, 360, (0.0, 360.0), "of the pad seen from home, clockwise from north")
    heading_deg: Range = _range(-360, 360, (0.0, 360.0), "of the vehicle on the ground, clockwise from north")
    height_m: Range = _range(1.5, 50, (3.5, 5.0), "of the search over the ground: where the approach begins")


class PadDraw(Drawn):
    """[pad]: how it stands, drives or floats."""

    heading_deg: Range = _range(-360, 360, (0.0, 360.0), "of its forward axis, clockwise from north")
    height_m: Range = _range(0, 10, (0.0, 0.0), "above the ground: a car's roof")
    deck_m: Range = _range(0.4, 20, (1.2, 1.2), "side of the square that can be landed on")
    carrier: Literal["van", "boat"] = Field(default="van", description="what a pad above the ground stands on")
    speed_km_h: Range = _range(0, 100, (0.0, 0.0), "that it drives at; 0: it stays")
    start_after_s: Range = _range(0, 600, (2.0, 4.0), "for which the vehicle was near, before it drives off")
    start_near_m: float = Field(default=1.5, gt=0, le=100, description="so near, flying, the driver sees it follow")
    acceleration_m_s2: Range = _range(0.1, 5, (0.8, 1.2), "as it drives off")
    bend_radius_m: Range = _range(0, 1000, (0.0, 0.0), "of the bend, to a side that is drawn; 0: straight on")
    bend_after_s: Range = _range(0, 600, (5.0, 5.0), "of driving, before it steers into the bend")
    brakes: bool = Field(default=False, description="it brakes to a stop")
    brake_after_s: Range = _range(0, 600, (5.0, 5.0), "at its whole speed, before it brakes")
    brake_m_s2: Range = _range(0.1, 8, (2.0, 2.0), "as it brakes")
    roll_deg: Range = _range(0, 30, (0.0, 0.0), "the deck rolls so far to each side")
    pitch_deg: Range = _range(0, 30, (0.0, 0.0), "the deck pitches so far fore and aft")
    heave_m: Range = _range(0, 5, (0.0, 0.0), "the deck rises and falls so far about its height")
    wave_period_s: Range = _range(2, 30, (6.0, 8.0), "of the waves that carry the most")


class CameraDraw(Drawn):
    """[camera]: frame rate, latency, noise."""

    rate_hz: Range = _range(1, 120, (30.0, 30.0), "frames a second")
    latency_ms: Range = _range(0, 1000, (25.0, 50.0), "from mid-exposure to the application")
    clock_error_ms: Range = _range(-100, 100, (0.0, 0.0), "how much earlier than their exposure the frames' times are")
    noise_dn: Range = _range(0, 20, (1.0, 3.0), "image noise at gain 1, 1 sigma, of 255 grey levels")


class VehicleDraw(Drawn):
    """[vehicle]: PX4's estimate of itself, and its parameters."""

    estimate_error: Range = _range(0, 5, (0.7, 1.3), "errors of position, velocity, attitude over those measured")
    gnss: bool = Field(default=True, description="false: only a local velocity, which drifts")
    parameters: dict[str, float] = Field(default={}, description="PX4's parameters, where not its defaults")


class DecoysDraw(Drawn):
    """[decoys]: printed things beside the pad that are not the landmark."""

    count: Range = _range(0, 12, (0.0, 0.0), "how many")
    distance_m: Range = _range(0.7, 50, (0.7, 2.5), "from the pad's centre")
    size_cm: Range = _range(5, 200, (25.0, 60.0), "side of the outermost contour")


class OrderConfig(Drawn):
    """[order]: what the person with the phone asks for."""

    wait_s: Range = _range(
        0, 600, (0.0, 0.0), "before a landing is asked for; of a pad that drives: at its whole speed"
    )


class SuccessConfig(Section):
    """[success]: what a landing must hold beside what every one must: on the pad, disarmed, 1 m/s at most."""

    deck_tilt_max_deg: float = Field(default=90.0, gt=0, le=90, description="of the deck at first contact")


class Scenario(Section):
    """A scenario file."""

    summary: str = Field(min_length=1, max_length=200, description="what it is, in a line")
    rig: str = Field(
        default="", description="rig file of the vehicle, relative to this one; empty: the simulator's own"
    )
    time_limit_s: float = Field(default=180.0, ge=10, le=3600, description="of a trial, in simulated time")
    ground: tuple[Literal["lawn", "asphalt", "water"], ...] = Field(
        default=("lawn", "asphalt"), min_length=1, description="kinds to draw from"
    )
    wind: WindDraw = WindDraw()
    light: LightDraw = LightDraw()
    start: StartDraw = StartDraw()
    pad: PadDraw = PadDraw()
    camera: CameraDraw = CameraDraw()
    vehicle: VehicleDraw = VehicleDraw()
    decoys: DecoysDraw = DecoysDraw()
    order: OrderConfig = OrderConfig()
    success: SuccessConfig = SuccessConfig()
    occlusion: OcclusionConfig | None = Field(default=None, description="something before the lens; none without it")
    override: dict[str, dict[str, Any]] = Field(
        default={}, description="keys of the rig file that are otherwise here: [override.guidance] and so on"
    )


def scenario_path(name: str, folder: Path) -> Path:
    """The file of a scenario that is named, or given as a path.

    Raises:
        ConfigError: There is none; it lists those that ship.
    """
    if name.endswith(SUFFIX):
        return Path(name)
    path = folder / f"{name}{SUFFIX}"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob(f"*{SUFFIX}"))) or "none"
        raise ConfigError(f"no scenario is called {name!r}", f"give a .toml file's path, or one of: {known}")
    return path


def read_scenario(path: Path) -> Scenario:
    """A scenario file, checked, with the overrides of its rig.

    Raises:
        ConfigError: It is missing or wrong: it names the file, each wrong key with its value and limit.
    """
    scenario = read_config(path, Scenario)
    overridden(path, scenario, read_config(rig_path(path, scenario), RigConfig))
    return scenario


def rig_path(path: Path, scenario: Scenario) -> Path:
    """The rig file of a scenario file."""
    return resolve(path, scenario.rig) if scenario.rig else CONFIGS / SIMULATOR


def overridden(path: Path, scenario: Scenario, rig: RigConfig) -> RigConfig:
    """The rig with the scenario's overrides.

    Raises:
        ConfigError: A key that no rig has, one that a trial draws or reads elsewhere, or a value out of its limits.
    """
    data = rig.model_dump()
    for section, keys in scenario.override.items():
        for key in (section, *(f"{section}.{key}" for key in keys)):
            if key in SAID_ELSEWHERE:
                raise ConfigError(f"{path}: override.{key} would change nothing", SAID_ELSEWHERE[key])
        table = data.get(section)
        if not isinstance(table, dict):
            known = ", ".join(sorted(name for name, value in data.items() if isinstance(value, dict)))
            raise ConfigError(f"{path}: unknown table [override.{section}]", f"a rig has {known}")
        table.update(keys)
    return checked(path, RigConfig, data, "override.")
