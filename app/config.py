"""Configuration: TOML files read into frozen models, every key with its unit in its name, its range and a meaning.

Files name other files (camera, pad) relative to themselves. An error names the file, the key, the value and what to do.
"""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError, model_validator

from app.config_world import LightChange as LightChange
from app.config_world import LightConfig as LightConfig
from app.config_world import PadMotionConfig as PadMotionConfig
from app.config_world import WorldConfig as WorldConfig
from app.errors import ConfigError
from app.frames import is_inside
from app.landmark import ContourSpec, Landmark, Shape, build_landmark
from app.sections import Section as Section

Address = Annotated[str, Field(pattern=r"^(udpin|udpout|tcpin|tcpout|serial|serial_flowcontrol)://\S+$")]
Metres = Annotated[float, Field(ge=-20000.0, le=20000.0)]
FenceCorner = tuple[Metres, Metres]
OnVehicle = Annotated[float, Field(ge=-5.0, le=5.0)]
"""Metres from the middle of the vehicle: nothing on it is further off."""
LEAST_FOCAL, MOST_FOCAL = 0.1, 20.0
"""Of a lens, in widths of its image: from a fisheye that sees all round to a telescope."""


# ------------------------------------------------------------------------------------------------------------ pads
class ContourConfig(Section):
    """One contour of a pad, outermost first."""

    shape: Shape
    area_ratio: float = Field(gt=0.0, le=1.0, description="its area over the outermost's")
    offset_forward_cm: float = Field(default=0.0, ge=-500, le=500, description="moved from where equal gaps place it")
    offset_right_cm: float = Field(default=0.0, ge=-500, le=500)


class PadConfig(Section):
    """A pad file: configs/pads/*.toml."""

    name: str
    size_cm: float = Field(ge=2.0, le=2000.0, description="side of the outermost contour")
    quiet_zone_cm: float | None = Field(
        default=None, ge=2.0, le=2500.0, description="side of the white square round it"
    )
    contour: tuple[ContourConfig, ...] = Field(min_length=2, max_length=12)

    def landmark(self, size_cm: float | None = None) -> Landmark:
        """The landmark that the file describes, at another size if one is given (the quiet zone scales with it)."""
        size = self.size_cm if size_cm is None else size_cm
        zone = None if self.quiet_zone_cm is None else self.quiet_zone_cm * size / self.size_cm / 100.0
        scale = size / self.size_cm / 100.0
        specs = tuple(
            ContourSpec(c.shape, c.area_ratio, c.offset_forward_cm * scale, c.offset_right_cm * scale)
            for c in self.contour
        )
        return build_landmark(self.name, size / 100.0, specs, zone)


# --------------------------------------------------------------------------------------------------------- cameras
class LensConfig(Section):
    """A camera file: configs/cameras/*.toml. Pixel centres are at whole numbers."""

    model: Literal["pinhole", "equidistant"]
    width_px: int = Field(ge=64, le=8192)
    height_px: int = Field(ge=64, le=8192)
    fx_px: float = Field(gt=0, le=50000, description="pinhole: pixels per unit tangent; equidistant: per radian")
    fy_px: float = Field(gt=0, le=50000)
    cx_px: float = Field(description="principal point, to the right")
    cy_px: float = Field(description="principal point, down")
    distortion: tuple[float, ...] = Field(
        default=(),
        description="pinhole: k1 k2 p1 p2 k3 as OpenCV; equidistant: k1 k2 k3 k4 as OpenCV's fisheye; empty for none",
    )

    @model_validator(mode="after")
    def _right_count(self) -> LensConfig:
        allowed = (0, 4, 5) if self.model == "pinhole" else (0, 4)
        if len(self.distortion) not in allowed:
            raise ValueError(f"a {self.model} lens takes {' or '.join(map(str, allowed))} distortion coefficients")
        return self

    @model_validator(mode="after")
    def _can_be_a_lens(self) -> LensConfig:
        faults = []
        if not (0.0 <= self.cx_px < self.width_px and 0.0 <= self.cy_px < self.height_px):
            faults.append(
                f"the lens's axis at cx_px, cy_px = {self.cx_px:g}, {self.cy_px:g} lies outside of the image of "
                f"{self.width_px}x{self.height_px}"
            )
        low, high = LEAST_FOCAL * self.width_px, MOST_FOCAL * self.width_px
        if not (low <= self.fx_px <= high and low <= self.fy_px <= high):
            faults.append(f"fx_px, fy_px = {self.fx_px:g}, {self.fy_px:g} are not within {low:g}..{high:g} pixels")
        if faults:
            raise ValueError("; ".join(faults))
        return self


class CameraConfig(Section):
    """[camera]: which driver gives the frames, through which lens, and how it is mounted."""

    driver: Literal["picamera2", "opencv", "synthetic"]
    lens: str = Field(description="camera file, relative to this one")
    source: str = Field(default="", description="opencv: device number, file or URL; synthetic: set by the program")
    frame_rate_hz: float = Field(default=30.0, ge=1.0, le=240.0)
    exposure_max_ms: float = Field(default=8.0, gt=0.0, le=100.0, description="longest exposure, steered or automatic")
    readout_ms: float = Field(
        default=0.0, ge=0.0, le=100.0, description="picamera2: rolling shutter, first row to last; 0 for a global one"
    )
    mount_yaw_deg: float = Field(default=0.0, ge=-180, le=180, description="0: image top is forward; 90: right")
    mount_pitch_deg: float = Field(default=0.0, ge=-45, le=45, description="positive: tilted to its image's top")
    mount_roll_deg: float = Field(default=0.0, ge=-45, le=45, description="positive: tilted to its image's left")
    position_body_m: tuple[OnVehicle, OnVehicle, OnVehicle] = Field(
        default=(0.0, 0.0, 0.05), description="forward, right, down of the body origin"
    )
    latency_s: float = Field(default=0.0, ge=0.0, le=1.0, description="subtracted from arrival where no sensor time is")


class ExposureConfig(Section):
    """[exposure]: steering the camera's exposure by the pad's own contrast. Grey levels are of 255."""

    steer: bool = Field(default=True, description="false: the camera exposes by itself")
    white_level: int = Field(default=205, ge=80, le=240, description="grey level that the pad's white is brought to")
    black_level: int = Field(default=16, ge=0, le=80, description="the pad's black is lifted above this, if white can")
    picture_level: int = Field(default=80, ge=20, le=200, description="middle grey of the picture before a pad is seen")
    blur_max_px: float = Field(default=1.5, gt=0, le=20, description="longest way of the pad's image in an exposure")
    gain_max: float = Field(default=8.0, ge=1, le=64, description="largest gain; the camera's own limit holds too")
    dead_band: float = Field(default=0.08, ge=0.02, le=0.5, description="share of the light that isn't corrected")
    response_gamma: float = Field(
        default=2.2, ge=1, le=3, description="light = (grey / 255) ^ gamma; a wrong one only takes a step longer"
    )

    @model_validator(mode="after")
    def _in_order(self) -> ExposureConfig:
        if not self.black_level < self.picture_level < self.white_level:
            levels = f"{self.black_level} < {self.picture_level} < {self.white_level}"
            raise ValueError(f"black_level < picture_level < white_level is needed, not {levels}")
        return self


# ------------------------------------------------------------------------------------------------------------ links
class AutopilotConfig(Section):
    """[autopilot]: the MAVLink connection to PX4."""

    address: Address = "udpin://127.0.0.1:14540"
    connect_timeout_s: float = Field(default=15.0, gt=0, le=600)
    telemetry_rate_hz: float = Field(default=100.0, ge=10, le=250)
    setpoint_rate_hz: float = Field(default=50.0, ge=5, le=100)
    action_timeout_s: float = Field(default=5.0, gt=0, le=30)
    check_parameters: Literal["refuse", "warn", "off"] = Field(
        default="warn",
        description="PX4's failsafe parameters are compared with deploy/px4/alight.params when the link opens; refuse: "
        "no arming while a critical one differs (COM_OF_LOSS_T, COM_OBL_RC_ACT, COM_RC_OVERRIDE)",
    )


class OperatorConfig(Section):
    """[operator]: where the phone's commands come in. Empty: through the autopilot's own link."""

    address: Address | Literal[""] = "udpin://127.0.0.1:14590"


# ------------------------------------------------------------------------------------------------------- the logic
class VisionConfig(Section):
    """[vision]: the paper's pipeline."""

    method: Literal["pnp", "paper"] = "pnp"
    height_table: str = Field(
        default="", description="paper: height table, relative to the rig file; empty: worked out from the lens"
    )
    blur_sigma_px: float = Field(default=0.8, ge=0, le=5, description="Gaussian before the threshold; 0 for none")
    otsu_band: int = Field(default=60, ge=1, le=255, description="ROI threshold is taken if this near the global one")
    misses_before_sweep: int = Field(default=2, ge=0, le=100)
    sweep_from: int = Field(default=70, ge=1, le=254)
    sweep_to: int = Field(default=190, ge=1, le=254)
    sweep_step: int = Field(default=30, ge=1, le=128)
    sweeps_before_wide: int = Field(default=2, ge=1, le=100)
    wide_from: int = Field(default=20, ge=1, le=254)
    wide_to: int = Field(default=240, ge=1, le=254)
    wide_step: int = Field(default=10, ge=1, le=128)
    wide_sweeps_before_lost: int = Field(default=2, ge=1, le=100)
    min_side_px: float = Field(default=10.0, ge=4, le=200, description="shortest side of the outermost contour")
    min_score: float = Field(default=0.6, ge=0, le=1)


class EstimationConfig(Section):
    """[estimation]: the target estimator."""

    acceleration_m_s2: float = Field(default=1.0, gt=0, le=20, description="pad's random acceleration, 1 sigma")
    gate_sigma: float = Field(default=4.0, ge=1, le=20)
    rejections_before_restart: int = Field(default=8, ge=1, le=100)
    fixes_before_confident: int = Field(default=5, ge=1, le=100)
    history_s: float = Field(default=2.0, gt=0.1, le=30, description="length of the vehicle pose history")
    delay_sigma_s: float = Field(
        default=0.02,
        ge=0,
        le=0.2,
        description="of the frames' times from PX4's, 1 sigma; it is estimated in flight",
    )


class GuidanceConfig(Section):
    """[guidance]: the velocity controller, or PX4's own precision landing in its place for the landing itself."""

    method: Literal["velocity", "px4-precland"] = Field(
        default="velocity",
        description="who flies a landing: Alight by velocity, or PX4 by its precision landing (pads at rest only)",
    )
    position_gain_1_s: float = Field(default=2.5, gt=0, le=5)
    trim_gain_1_s2: float = Field(default=1.5, ge=0, le=3, description="integral action against PX4's velocity error")
    trim_max_m_s: float = Field(default=0.4, ge=0, le=2)
    gust_share: float = Field(default=0.8, ge=0, le=1, description="of a gust's acceleration that is fed forward")
    gust_max_m_s2: float = Field(default=2.0, ge=0, le=5, description="that is fed forward against gusts at most")
    coast_s: float = Field(default=4.0, ge=0, le=30, description="with the pad's last velocity, after it was lost")
    speed_max_m_s: float = Field(default=8.0, gt=0, le=25)
    closing_speed_max_m_s: float = Field(default=3.0, gt=0, le=15, description="relative to the pad")
    acceleration_max_m_s2: float = Field(default=4.0, gt=0, le=10)
    jerk_max_m_s3: float = Field(
        default=1000.0,
        gt=0,
        le=10000,
        description="of the commanded velocity; a press, a lost pad and a start are free of it. A limit that is felt, "
        "200 and less, wants a position gain of 1.8 on PX4",
    )
    climb_speed_m_s: float = Field(default=1.0, gt=0, le=5)
    descend_speed_m_s: float = Field(default=0.8, gt=0, le=3, description="inside the cone, high up")
    touchdown_speed_m_s: float = Field(default=0.6, gt=0, le=1.0, description="below the commit height")
    press_speed_m_s: float = Field(
        default=1.5, ge=0.3, le=3.0, description="sink that is asked for in contact: PX4 then takes its thrust off"
    )
    yaw_rate_max_deg_s: float = Field(default=45.0, gt=0, le=180)
    align_yaw: bool = Field(default=True, description="turn to the pad's heading")
    actuation_delay_s: float = Field(default=0.2, ge=0, le=1, description="the track is predicted this far ahead")
    cone_height_m: float = Field(default=3.0, gt=0, le=50, description="the paper's cone: 3 m high, 6 m across")
    cone_radius_m: float = Field(default=3.0, gt=0, le=50)
    touchdown_radius_m: float = Field(default=0.10, gt=0, le=2, description="radius of the cone at the commit height")
    commit_height_m: float = Field(default=0.45, gt=0, le=3)
    commit_speed_m_s: float = Field(default=0.4, gt=0, le=3, description="largest speed relative to the pad at commit")
    deck_lean_max_deg: float = Field(
        default=4.0, gt=0, le=30, description="commit only if the deck will lean less at touchdown: wait for a calm one"
    )
    search_spacing_m: float = Field(default=3.0, ge=0.3, le=50, description="between the lines of the expanding square")
    search_radius_m: float = Field(default=15.0, gt=0, le=500)
    search_speed_m_s: float = Field(default=2.0, gt=0, le=15)


class MissionConfig(Section):
    """[mission]: heights, times and tries of the state machine."""

    search_height_m: float = Field(default=4.0, ge=0.5, le=100)
    hover_height_m: float = Field(default=2.5, ge=0.5, le=50)
    track_height_m: float = Field(default=2.5, ge=0.5, le=50, description="the paper tracks the car at 2.5 m")
    track_time_before_land_s: float = Field(default=4.0, ge=0, le=600, description="a settled track before a landing")
    takeoff_timeout_s: float = Field(default=30.0, gt=0, le=300)
    search_timeout_s: float = Field(
        default=180.0, gt=0, le=3600, description="of one pass of the pattern, which takes 140 s with its defaults"
    )
    search_along_s: float = Field(
        default=15.0,
        ge=0,
        le=600,
        description="a pad that drove when it was lost is taken to drive on for so long; then the search turns back "
        "along its way to where it was last seen",
    )
    search_passes: int = Field(
        default=3, ge=1, le=10, description="times that the pattern is flown, each lower than the one before"
    )
    search_lower_share: float = Field(
        default=0.6, ge=0.2, le=0.9, description="height and size of a pass of the pattern over those of the one before"
    )
    search_height_min_m: float = Field(
        default=2.5,
        ge=1.0,
        le=100,
        description="no pass is flown lower over the ground: people, cars, and PX4's height, which is off by up to 1 m",
    )
    hover_timeout_s: float = Field(default=30.0, gt=0, le=600, description="to settle over the pad")
    land_timeout_s: float = Field(default=60.0, gt=0, le=600, description="from the start of a descent")
    landing_tries: int = Field(default=3, ge=1, le=20)
    abort_action: Literal["hold", "return", "land"] = "return"
    failure_action: Literal["hold", "return", "land"] = "hold"
    hold_max_s: float = Field(
        default=120.0, gt=0, le=3600, description="how long a hold after a failed mission lasts; then hold_end_action"
    )
    hold_end_action: Literal["return", "land"] = Field(
        default="return", description="what ends a hold that nobody ended: PX4's return to launch, or its landing there"
    )
    resume_within_s: float = Field(
        default=2.0, ge=0, le=10, description="a mission goes on by itself after a lost link or a stall this short"
    )


class SafetyConfig(Section):
    """[safety]: limits that turn into verdicts."""

    track_stale_s: float = Field(
        default=0.5, gt=0, le=5, description="no velocity towards a pad not seen for this long"
    )
    vehicle_state_stale_s: float = Field(default=0.5, gt=0, le=5)
    frames_stale_s: float = Field(default=1.0, gt=0, le=10)
    setpoint_gap_max_s: float = Field(default=0.3, gt=0.02, le=0.5, description="control loop's own watchdog")
    distance_from_home_max_m: float = Field(default=300.0, gt=0, le=20000)
    height_max_m: float = Field(default=30.0, gt=0, le=500)
    tilt_max_deg: float = Field(default=45.0, gt=0, le=90)
    tilt_reserve_deg: float = Field(
        default=12.0,
        ge=0,
        le=45,
        description="under tilt_max_deg: a vehicle that leans into this for seconds has no reserve against the wind",
    )
    fence_ne_m: tuple[FenceCorner, ...] = Field(
        default=(),
        max_length=100,
        description="corners of a polygon that is not to be left, metres north and east of home; empty for none",
    )
    battery_min_fraction: float = Field(default=0.15, ge=0, le=1)
    battery_unknown_action: Literal["land", "warn"] = Field(
        default="land", description="when PX4 tells no battery level: as with a low battery, or only a warning"
    )

    @model_validator(mode="after")
    def _fence_holds_home(self) -> SafetyConfig:
        if not self.fence_ne_m:
            return self
        if len(self.fence_ne_m) < 3:
            raise ValueError(f"fence_ne_m has {len(self.fence_ne_m)} corners, a polygon needs 3 or more")
        if not is_inside((0.0, 0.0), self.fence_ne_m):
            raise ValueError("fence_ne_m must hold home, which is at 0 north, 0 east")
        return self


class RecorderConfig(Section):
    """[recorder]: the flight record."""

    directory: str = Field(default="flights", description="relative to where alight is run; empty for no record")
    jpeg_quality: int = Field(default=80, ge=10, le=100)
    frame_rate_hz: float = Field(default=30.0, ge=0, le=240, description="images kept a second")


class RigConfig(Section):
    """A rig file: configs/*.toml."""

    camera: CameraConfig
    pad: str = Field(description="pad file, relative to this one")
    autopilot: AutopilotConfig = AutopilotConfig()
    operator: OperatorConfig = OperatorConfig()
    vision: VisionConfig = VisionConfig()
    exposure: ExposureConfig = ExposureConfig()
    estimation: EstimationConfig = EstimationConfig()
    guidance: GuidanceConfig = GuidanceConfig()
    mission: MissionConfig = MissionConfig()
    safety: SafetyConfig = SafetyConfig()
    recorder: RecorderConfig = RecorderConfig()
    simulator: WorldConfig | None = None

    @model_validator(mode="after")
    def _can_precland(self) -> RigConfig:
        built_in = self.simulator is not None and self.simulator.vehicle == "built-in"
        if self.guidance.method == "px4-precland" and self.camera.driver == "synthetic" and built_in:
            raise ValueError(
                'guidance.method = "px4-precland" needs a PX4: the built-in simulator has no precision landing '
                '(simulator.vehicle = "px4" flies one)'
            )
        return self

    @model_validator(mode="after")
    def _can_fly(self) -> RigConfig:
        """What no single key shows: a mission that can't end well however it goes."""
        guidance, mission, safety = self.guidance, self.mission, self.safety
        frame_s = 1.0 / self.camera.frame_rate_hz
        below = (
            ("mission.search_height_m", mission.search_height_m, "safety.height_max_m", safety.height_max_m),
            ("mission.hover_height_m", mission.hover_height_m, "safety.height_max_m", safety.height_max_m),
            ("mission.track_height_m", mission.track_height_m, "safety.height_max_m", safety.height_max_m),
            ("guidance.commit_height_m", guidance.commit_height_m, "mission.track_height_m", mission.track_height_m),
            ("guidance.commit_height_m", guidance.commit_height_m, "guidance.cone_height_m", guidance.cone_height_m),
            (
                "guidance.touchdown_radius_m", guidance.touchdown_radius_m,
                "guidance.cone_radius_m", guidance.cone_radius_m,
            ),
            (
                "guidance.search_radius_m", guidance.search_radius_m,
                "safety.distance_from_home_max_m", safety.distance_from_home_max_m,
            ),
            ("two frames of the camera, s", 2.0 * frame_s, "safety.frames_stale_s", safety.frames_stale_s),
        )  # fmt: skip
        faults = [f"{low} = {a:g} must be under {high} = {b:g}" for low, a, high, b in below if not a < b]
        if faults:
            raise ValueError("; ".join(faults))
        return self


# --------------------------------------------------------------------------------------------------------- reading
S = TypeVar("S", bound=Section)


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file as nested dictionaries.

    Raises:
        ConfigError: It is missing, unreadable or no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        near = difflib.get_close_matches(path.stem, [p.stem for p in path.parent.glob("*.toml")], n=1)
        raise ConfigError(
            f"{path}: no such file",
            f"did you mean {path.parent / near[0]}.toml?"
            if near
            else "give the path of a .toml file; configs/ has the ones that ship",
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: can't be read ({error})", "give a readable TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}", "mend that line") from None


def read_config(path: Path, kind: type[S]) -> S:
    """Read and check a file of one kind (RigConfig, LensConfig, PadConfig).

    Raises:
        ConfigError: It names the file, each wrong key with its value and limit, and what to do.
    """
    return checked(path, kind, read_toml(path))


def checked(path: Path, kind: type[S], data: dict[str, Any], prefix: str = "") -> S:
    """What a file of one kind says, checked; `prefix` stands before the keys in an error.

    Raises:
        ConfigError: It names the file, each wrong key with its value and limit, and what to do.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        faults = [_explain(kind, item, prefix) for item in error.errors()]
        shown = " | ".join(faults[:4]) + (f" | and {len(faults) - 4} more" if len(faults) > 4 else "")
        raise ConfigError(f"{path}: {shown}", "mend the file") from None


def _keys_of(kind: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """The keys that the table at a location may have."""
    model: Any = kind
    for part in location:
        if isinstance(part, int):
            continue
        info = getattr(model, "model_fields", {}).get(part)
        if info is None:
            return []
        choices = (info.annotation, *getattr(info.annotation, "__args__", ()))
        model = next((choice for choice in choices if hasattr(choice, "model_fields")), None)
    return sorted(getattr(model, "model_fields", {}))


UNITS = frozenset(
    "m cm mm km ft in s ms us min h s2 rad deg hz khz px mps kmh kph mph knots kn percent fraction body".split()
)
"""Words that end a key and say its unit, right ones and likely wrong ones."""


def _without_unit(key: str) -> str:
    """A key's name without the unit at its end: speed_max_km_h and speed_max_m_s are both speed_max."""
    words = key.split("_")
    while len(words) > 1 and words[-1] in UNITS:
        words.pop()
    return "_".join(words)


def _explain(kind: type[BaseModel], item: Any, prefix: str) -> str:
    """One fault of a file in words."""
    location = item["loc"]
    key = prefix + ".".join(str(part) for part in location)
    if item["type"] == "extra_forbidden":
        keys = _keys_of(kind, location[:-1])
        wrong = str(location[-1])
        same_stem = [k for k in keys if _without_unit(k) == _without_unit(wrong)]
        near = same_stem[:1] or difflib.get_close_matches(wrong, keys, n=1)
        unit = " (units are part of the name)" if same_stem else ""
        hint = f"; did you mean {near[0]}{unit}?" if near else (f"; known here: {', '.join(keys)}" if keys else "")
        return f"unknown key {key} = {item['input']!r}{hint}"
    if item["type"] == "missing":
        return f"key {key} is missing"
    if item["type"] == "value_error":
        return f"{key + ': ' if key else ''}{item['ctx']['error']}"
    return f"{key} = {item['input']!r}: {item['msg']}"


def resolve(base: Path, name: str) -> Path:
    """A path that a file names, relative to that file."""
    path = Path(name).expanduser()
    return path if path.is_absolute() else base.parent / path
