"""The simulator's world as a configuration: [simulator] of a rig file. The application never reads it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from app.sections import Section


class PadMotionConfig(Section):
    """How the simulated pad stands, drives or floats."""

    north_m: float = Field(default=3.0, ge=-1000, le=1000, description="where it starts, from home")
    east_m: float = Field(default=2.0, ge=-1000, le=1000)
    height_m: float = Field(default=0.0, ge=0, le=10, description="of the pad above the ground: a car's roof")
    heading_deg: float = Field(default=0.0, ge=-360, le=360)
    speed_m_s: float = Field(default=0.0, ge=0, le=30)
    start_after_s: float = Field(default=0.0, ge=0, le=600, description="of flight above 1 m, before it drives off")
    start_near_m: float | None = Field(
        default=None, gt=0, le=1000, description="only flight this near to the pad counts for that; none: any does"
    )
    acceleration_m_s2: float = Field(default=1.0, gt=0, le=10)
    deck_m: float = Field(default=1.2, gt=0, le=20, description="side of the square that can be landed on")
    carrier: Literal["van", "boat"] = Field(default="van", description="what a pad above the ground stands on")
    bend_radius_m: float = Field(default=0.0, ge=-1000, le=1000, description="positive: to the right; 0: straight on")
    bend_after_s: float = Field(default=0.0, ge=0, le=600, description="of driving, before it steers into the bend")
    brake_after_s: float | None = Field(
        default=None, ge=0, le=600, description="at its whole speed, before it brakes to a stop; none: it never does"
    )
    brake_m_s2: float = Field(default=2.0, gt=0, le=10)
    roll_deg: float = Field(default=0.0, ge=0, le=30, description="the deck rolls so far to each side")
    pitch_deg: float = Field(default=0.0, ge=0, le=30, description="the deck pitches so far fore and aft")
    heave_m: float = Field(default=0.0, ge=0, le=5, description="the deck rises and falls so far about its height")
    wave_period_s: float = Field(default=7.0, ge=2, le=30, description="of the waves that carry the most")

    @model_validator(mode="after")
    def _bend_can_be_driven(self) -> PadMotionConfig:
        if 0.0 < abs(self.bend_radius_m) < 5.0:
            raise ValueError(f"bend_radius_m = {self.bend_radius_m:g} must be 0, or 5 m or more to either side")
        return self


class LightChange(Section):
    """A change of the simulated daylight: a cloud, an edge of shadow, dusk."""

    at_s: float = Field(ge=0, le=36000, description="since the camera's first frame")
    level: float = Field(gt=0, le=100, description="of the light afterwards; 1: noon")
    over_s: float = Field(default=0.0, ge=0, le=36000, description="how long it takes; 0: at once")


class ShadowConfig(Section):
    """The straight edge of a building's shadow across the place where the pad starts."""

    toward_deg: float = Field(default=0.0, ge=-360, le=360, description="which way from its edge the shadow lies")
    offset_m: float = Field(default=0.0, ge=-100, le=100, description="of the edge from the pad's centre, that way")
    light: float = Field(default=0.25, gt=0, le=1, description="that is left in the shadow, of that beside it")
    soft_m: float = Field(default=0.04, ge=0.001, le=10, description="over which the edge is soft")


class LightConfig(Section):
    """The simulated daylight."""

    level: float = Field(default=1.0, gt=0, le=100, description="1: noon; 0.1: a dull day; 0.002: dusk, 200 lux")
    changes: tuple[LightChange, ...] = Field(default=(), max_length=1000, description="in the order of their times")
    glare: float = Field(
        default=0.0, ge=0, le=100, description="the sun mirrored in wet ground and glossy print; 1: as bright as white"
    )
    glare_width_deg: float = Field(
        default=4.0, gt=0, le=45, description="half width of that spot, seen from the camera"
    )
    shadow: ShadowConfig | None = Field(default=None, description="a shadow's edge over the pad; none without it")

    @model_validator(mode="after")
    def _in_order(self) -> LightConfig:
        for earlier, later in zip(self.changes, self.changes[1:], strict=False):
            if later.at_s < (end_s := earlier.at_s + earlier.over_s):
                raise ValueError(
                    f"the change at_s = {later.at_s:g} must begin after the one before has ended, at {end_s:g} s"
                )
        return self


class OcclusionConfig(Section):
    """Something before the lens for a while, the first time that the camera sinks below a height over the pad."""

    below_m: float = Field(default=1.0, gt=0, le=50, description="height of the camera over the pad")
    for_s: float = Field(default=1.0, gt=0, le=60)


class DecoyConfig(Section):
    """Something printed that lies beside the pad and is not the landmark."""

    kind: Literal["squares", "triangles", "helipad", "marker", "negative"]
    forward_m: float = Field(ge=-100, le=100, description="from the pad's start, along its heading")
    right_m: float = Field(ge=-100, le=100)
    heading_deg: float = Field(default=0.0, ge=-360, le=360)
    size_m: float = Field(default=0.38, gt=0.01, le=10, description="side of its outermost contour")


class WorldConfig(Section):
    """[simulator]: what is simulated. The application never reads this."""

    seed: int = Field(default=1, ge=0)
    vehicle: Literal["built-in", "px4"] = "built-in"
    px4_truth_address: str = Field(default="udpin:127.0.0.1:19410", description="px4: where its ground truth arrives")
    start_heading_deg: float = Field(default=0.0, ge=-360, le=360, description="built-in: of the vehicle on the ground")
    gnss: bool = Field(default=True, description="built-in: false leaves the autopilot a local velocity that drifts")
    estimate_error: float = Field(
        default=1.0, ge=0, le=10, description="built-in: errors of the autopilot's estimate, over those measured on PX4"
    )
    parameters: dict[str, float] = Field(default={}, description="built-in: PX4's parameters, where not its defaults")
    ground: Literal["lawn", "asphalt", "water"] = "lawn"
    wind_m_s: float = Field(default=1.0, ge=0, le=20)
    gust_m_s: float = Field(default=0.5, ge=0, le=10)
    wind_from_deg: float = Field(default=270.0, ge=-360, le=360)
    sun_elevation_deg: float = Field(default=50.0, ge=5, le=90)
    sun_azimuth_deg: float = Field(default=200.0, ge=-360, le=360)
    noise_dn: float = Field(default=2.0, ge=0, le=50, description="image noise at gain 1, 1 sigma, of 255")
    camera_latency_s: float = Field(default=0.035, ge=0, le=1, description="mid-exposure to the application")
    camera_clock_error_s: float = Field(
        default=0.0, ge=-0.1, le=0.1, description="how much earlier than their exposure the frames' times are"
    )
    exposure_ms: float = Field(default=2.0, gt=0, le=30, description="while nobody steers it; its gain is automatic")
    exposure_delay_frames: int = Field(default=3, ge=0, le=30, description="until the camera does what it is told")
    light: LightConfig = LightConfig()
    motion: PadMotionConfig = PadMotionConfig()
    occlusion: OcclusionConfig | None = Field(default=None, description="something before the lens; none without it")
    decoys: tuple[DecoyConfig, ...] = Field(default=(), max_length=50)
