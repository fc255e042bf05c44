"""What travels between tasks: frozen dataclasses, values only.

`t_capture_s` is the time, on the application's monotonic clock, at which what a message describes was true
(mid-exposure for a frame), never the time at which it was handled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

from app.frames import Array, rotation_from_yaw, wrap_angle_rad

Image = NDArray[np.uint8]


# ---------------------------------------------------------------------------------------------------------- camera
@dataclass(frozen=True, slots=True)
class Frame:
    """One camera image.

    Attributes:
        t_capture_s: Mid-exposure.
        sequence: Counts up by one for each frame that the camera gave.
        image: (height, width) uint8 grey, or (height, width, 3) uint8 BGR.
        exposure_s: Exposure time, where known.
        name: The file (and frame in it) it came from, or "".
        gain: What the sensor's signal was amplified by, where known.
    """

    t_capture_s: float
    sequence: int
    image: Image
    exposure_s: float | None = None
    name: str = ""
    gain: float | None = None


@dataclass(frozen=True, slots=True)
class ExposureLimits:
    """What a camera can be told.

    Attributes:
        exposure_min_s: Shortest exposure time.
        exposure_max_s: Longest one that keeps the frame rate.
        gain_min: Least gain.
        gain_max: Largest gain; the same as gain_min where there is only one.
    """

    exposure_min_s: float
    exposure_max_s: float
    gain_min: float = 1.0
    gain_max: float = 1.0


class LightSource(StrEnum):
    """What an exposure was worked out from."""

    START = "start"
    """Nothing yet: a place to begin, for a camera that doesn't tell what it does by itself."""
    PAD = "pad"
    """The white and the black of the pad."""
    PICTURE = "picture"
    """The whole picture: the pad is not seen."""


@dataclass(frozen=True, slots=True)
class ExposureCommand:
    """What the camera was told, and why; told only when it changes.

    Attributes:
        t_s: When.
        sequence: Of the frame that it was worked out from.
        exposure_s: Exposure time.
        gain: Gain.
        source: What it rests on.
        white: Grey level of the pad's white in that frame, None if not seen.
        black: Grey level of its black.
        saturated: Share of the pad's white that is saturated.
        picture: Middle grey level of the picture.
        motion_px_s: How fast the pad moves in the image; None if not known.
    """

    t_s: float
    sequence: int
    exposure_s: float
    gain: float
    source: LightSource
    white: float | None = None
    black: float | None = None
    saturated: float = 0.0
    picture: float = 0.0
    motion_px_s: float | None = None


@dataclass(frozen=True, slots=True)
class CameraStatus:
    """What is known of the camera's frames, judged at each arrival and while none arrives.

    Attributes:
        t_s: When it was judged.
        new_frame_s: When the newest frame with a new image arrived, on our clock; None before the first.
        frozen_s: For how long every frame has been a copy of one image; 0 while images change.
        image_fault: What is wrong with the newest images: "black", "white", "torn"; "" if nothing.
        image_fault_s: For how long.
        time_fault: What is wrong with the frames' times, in at most 40 characters; "" if nothing.
        time_fault_s: For how long.
    """

    t_s: float
    new_frame_s: float | None = None
    frozen_s: float = 0.0
    image_fault: str = ""
    image_fault_s: float = 0.0
    time_fault: str = ""
    time_fault_s: float = 0.0


# ---------------------------------------------------------------------------------------------------------- vision
@dataclass(frozen=True, slots=True)
class SeenContour:
    """One contour of the landmark, as it was found in the image.

    Attributes:
        index: Which contour of the landmark: 0 is the outermost.
        corners_px: (n, 2) sub-pixel corners (u right, v down; pixel centres at whole numbers), in the order of
            Landmark.contours[index].corners_m.
    """

    index: int
    corners_px: Array


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """The landmark's plane as it lies before the lens: one fit of the whole drawing to all that was seen of it.

    It carries all that the image says of the pose, also where corners are covered or out of the image. Let
    S = diag(unit_m, unit_m, 1) and W(d) = [[1 + d0, d1, d2], [d3, 1 + d4, d5], [d6, d7, 1]]. Then the true map is, up
    to scale, rays_from_pad S W(d) S^-1 for a d of mean 0 and covariance information^-1.

    Attributes:
        rays_from_pad: (3, 3) takes (forward, right, 1) on the pad, metres, to a direction in the camera frame. Up to
            scale it is [r1 r2 t] of the pose cam_from_pad.
        information: (8, 8) inverse of the covariance of d.
        unit_m: Length that d counts in.
        residual_px: Root mean square of what the fit leaves, in pixels.
    """

    rays_from_pad: Array
    information: Array
    unit_m: float
    residual_px: float = 0.0


@dataclass(frozen=True, slots=True)
class Detection:
    """What the detector says of one frame.

    Attributes:
        t_capture_s: Of the frame.
        sequence: Of the frame.
        contours: What was found, outermost first; empty if the landmark was not detected.
        code: Corner counts of the run that was found ("4433"), or None.
        reason: Why not, in words that name the figure and the limit; None if detected.
        score: Evidence in 0..1 (correlation with the drawn landmark, weighed with the rest); 0 if not detected.
        threshold: Grey level of the binarisation that was used.
        roi_px: (u0, v0, u1, v1) region that was searched, half open; None for the whole frame.
        elapsed_s: Processor time of the detection.
        plane: The fit behind it; None if not detected.
    """

    t_capture_s: float
    sequence: int
    contours: tuple[SeenContour, ...] = ()
    code: str | None = None
    reason: str | None = None
    score: float = 0.0
    threshold: int = 0
    roi_px: tuple[int, int, int, int] | None = None
    elapsed_s: float = 0.0
    plane: PlaneFit | None = None

    @property
    def detected(self) -> bool:
        """Whether the landmark was found."""
        return bool(self.contours)


@dataclass(frozen=True, slots=True)
class PaperPose:
    """The outputs of the paper's own equations for one frame (its camera is levelled first; see estimation.pose).

    Attributes:
        x_c_m: Equation (5): landmark centre to the right of the camera axis.
        y_c_m: Equation (6): landmark centre towards image down.
        h_m: Equations (11) to (13): height of the camera above the landmark.
        theta_rad: Heading of the pad relative to the vehicle, positive clockwise seen from above.
    """

    x_c_m: float
    y_c_m: float
    h_m: float
    theta_rad: float


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Where the landmark is in the camera's frame.

    Attributes:
        t_cam_from_pad_m: (3,) the pad's origin in the camera frame.
        q_cam_from_pad_wxyz: (4,) rotation of the pad frame into the camera frame.
        covariance: (6, 6) of the error in (translation in cam, m; small rotation about the cam axes, rad).
        reprojection_px: Root mean square of the residuals.
    """

    t_cam_from_pad_m: Array
    q_cam_from_pad_wxyz: Array
    covariance: Array
    reprojection_px: float


@dataclass(frozen=True, slots=True)
class PadFix:
    """One measurement of the pad in PX4's local frame: a camera pose combined with the vehicle's pose at that time.

    Attributes:
        t_capture_s: When the frame was exposed: its own time and delay_s.
        pad_pos_ned_m: (3,) the pad's origin.
        pad_from_vehicle_ned_m: (3,) the same relative to the vehicle's body origin, along the ned axes.
        covariance_ned_m2: (3, 3) of pad_from_vehicle_ned_m: vision and attitude, not PX4's position error.
        pad_yaw_ned_rad: Heading of the pad's forward axis.
        yaw_sigma_rad: Standard deviation of that heading.
        code: Run of contours that it rests on.
        pad_tilt_rad: Angle between the pad's normal and the vertical.
        travelled_ned_m: (3,) integral of PX4's velocity up to the capture; only differences between fixes mean
            something. None: the estimator takes PX4's position for it.
        paper: The paper's own outputs, in a fix by method paper.
        pad_normal_ned: (3,) the pad's down axis; None where the method doesn't give it.
        normal_sigma_rad: Standard deviation of its north and east part.
        shift_ned_m_s: (3,) how pad_pos_ned_m would move for each second by which the frame was exposed later than
            t_capture_s: the vehicle's velocity, and its turning times the way to the pad. None where that is unknown.
        delay_s: By how much the frame was taken to be exposed later than its own time says.
    """

    t_capture_s: float
    pad_pos_ned_m: Array
    pad_from_vehicle_ned_m: Array
    covariance_ned_m2: Array
    pad_yaw_ned_rad: float
    yaw_sigma_rad: float
    code: str
    pad_tilt_rad: float = 0.0
    travelled_ned_m: Array | None = None
    paper: PaperPose | None = None
    pad_normal_ned: Array | None = None
    normal_sigma_rad: float = 0.0
    shift_ned_m_s: Array | None = None
    delay_s: float = 0.0


# -------------------------------------------------------------------------------------------------------- estimate
@dataclass(frozen=True, slots=True)
class PadTrack:
    """The target estimator's state at one time.

    Attributes:
        t_capture_s: The time that the state is valid at.
        pos_ned_m: (3,) the pad's origin in PX4's local frame.
        vel_ned_m_s: (3,).
        covariance: (6, 6) of (position, velocity).
        yaw_ned_rad: Heading of the pad's forward axis.
        yaw_rate_rad_s: Its rate.
        t_last_fix_s: Capture time of the last fix that was accepted.
        fixes_accepted: Count since the track began.
        fixes_rejected_in_row: Outliers since the last accepted fix.
        lean_ne_rad: (2,) north and east part of the deck's normal: how it leans.
        lean_rate_ne_rad_s: (2,) their rates.
        lean_sigma_rad: Standard deviation of each part, at t_capture_s.
        turn_rate_rad_s: At which the velocity turns with the heading, clockwise from above: 0 unless the heading's rate
            stands out of its error.
        delay_s: By how much later the frames are exposed than their times say.
        delay_sigma_s: Its standard deviation.
        delay_at_limit: The offset has reached the largest value that is believed: something else is wrong.
        restarts: How often fixes contradicted the track until it was begun anew, since the application started.
    """

    t_capture_s: float
    pos_ned_m: Array
    vel_ned_m_s: Array
    covariance: Array
    yaw_ned_rad: float
    yaw_rate_rad_s: float
    t_last_fix_s: float
    fixes_accepted: int
    fixes_rejected_in_row: int = 0
    lean_ne_rad: tuple[float, float] = (0.0, 0.0)
    lean_rate_ne_rad_s: tuple[float, float] = (0.0, 0.0)
    lean_sigma_rad: float = 0.0
    turn_rate_rad_s: float = 0.0
    delay_s: float = 0.0
    delay_sigma_s: float = 0.0
    delay_at_limit: bool = False
    restarts: int = 0

    def lean_rad(self, ahead_s: float) -> float:
        """The deck's angle from level so long after t_capture_s, less what it is unsure by; it goes on as it moves.

        Infinite if it isn't known: a deck whose lean is not a number is not level.
        """
        parts = (a + ahead_s * rate for a, rate in zip(self.lean_ne_rad, self.lean_rate_ne_rad_s, strict=True))
        lean_rad = math.hypot(*parts) - self.lean_sigma_rad
        return max(0.0, lean_rad) if math.isfinite(lean_rad) else math.inf

    def at(self, t_s: float) -> PadTrack:
        """The track's mean carried to another time, at constant velocity or on the arc of its turn; the covariance
        stays that of the last fix.
        """
        dt_s = t_s - self.t_capture_s
        pos_ned_m, vel_ned_m_s = self.pos_ned_m + dt_s * self.vel_ned_m_s, self.vel_ned_m_s
        if self.turn_rate_rad_s != 0.0:
            pos_ned_m = self.pos_ned_m + dt_s * (
                rotation_from_yaw(0.5 * dt_s * self.turn_rate_rad_s) @ self.vel_ned_m_s
            )
            vel_ned_m_s = rotation_from_yaw(dt_s * self.turn_rate_rad_s) @ self.vel_ned_m_s
        return replace(
            self,
            t_capture_s=t_s,
            pos_ned_m=pos_ned_m,
            vel_ned_m_s=vel_ned_m_s,
            lean_ne_rad=(
                self.lean_ne_rad[0] + dt_s * self.lean_rate_ne_rad_s[0],
                self.lean_ne_rad[1] + dt_s * self.lean_rate_ne_rad_s[1],
            ),
            yaw_ned_rad=wrap_angle_rad(self.yaw_ned_rad + dt_s * self.yaw_rate_rad_s),
        )


@dataclass(frozen=True, slots=True)
class TrackCheck:
    """Whether the pad's measurements move as the vehicle's own motion says, or copy it.

    Attributes:
        t_s: When it was judged.
        copy_ratio: Part of the vehicle's own motion that shows in the measured place of the pad: 0 for a right one, 1
            for a frozen image; None while the vehicle moves too little to tell.
        cause: The likely cause, in at most 40 characters; "" while nothing is wrong.
        since_s: Since when it has been wrong; None while it is not.
    """

    t_s: float
    copy_ratio: float | None = None
    cause: str = ""
    since_s: float | None = None


# --------------------------------------------------------------------------------------------------------- vehicle
class FlightMode(StrEnum):
    """PX4's flight modes, as far as they matter here."""

    UNKNOWN = "unknown"
    MANUAL = "manual"
    ALTITUDE = "altitude"
    POSITION = "position"
    OFFBOARD = "offboard"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    LAND = "land"
    RETURN = "return"
    MISSION = "mission"
    PRECLAND = "precland"
    OTHER = "other"


class LandedState(StrEnum):
    """PX4's land detector (EXTENDED_SYS_STATE)."""

    UNKNOWN = "unknown"
    ON_GROUND = "on_ground"
    IN_AIR = "in_air"
    TAKING_OFF = "taking_off"
    LANDING = "landing"


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The vehicle as PX4 reports it.

    Attributes:
        t_capture_s: The time that the pose was true.
        pos_ned_m: (3,) in PX4's local frame.
        vel_ned_m_s: (3,).
        q_ned_from_body_wxyz: (4,).
        connected: Heartbeats arrive.
        armed: Motors are armed.
        mode: PX4's present flight mode.
        landed: PX4's land detector.
        armable: PX4 would accept an arming command.
        local_position_ok: PX4 vouches for its local position and velocity.
        battery_fraction: 0..1, or None if unknown.
        frame_resets: Jumps of PX4's local frame seen so far.
        failsafe: PX4 says that a failsafe of its own is active.
        mode_age_s: How old PX4's statement of its mode was when this state was put together; inf: never stated. The
            same for the other ages.
        mode_is_fast: The mode comes about ten times a second (CURRENT_MODE), not once (HEARTBEAT).
        armed_age_s: Age of `armed`.
        landed_age_s: Age of `landed`.
        battery_age_s: Age of `battery_fraction`.
        estimator_age_s: Age of PX4's estimator flags, on which `local_position_ok` rests.
        position_age_s: Age of the position and velocity: how far they were carried on to t_capture_s.
        estimator_test_ratio: The largest of PX4's innovation test ratios (velocity, position); over 1 the estimator
            rejects its measurements. None: not stated.
        gnss_glitch: PX4's estimator says that GNSS jumps.
        thrust: Collective thrust that PX4 asks of its motors, 0..1; None: not stated in the last 0.3 s.
        specific_force_body_m_s2: (3,) what the accelerometers read, forward, right, down: about (0, 0, -9.8) at rest.
            None: not stated in the last 0.3 s.
    """

    t_capture_s: float
    pos_ned_m: Array
    vel_ned_m_s: Array
    q_ned_from_body_wxyz: Array
    connected: bool = True
    armed: bool = False
    mode: FlightMode = FlightMode.UNKNOWN
    landed: LandedState = LandedState.UNKNOWN
    armable: bool = False
    local_position_ok: bool = False
    battery_fraction: float | None = None
    frame_resets: int = 0
    failsafe: bool = False
    mode_age_s: float = 0.0
    mode_is_fast: bool = True
    armed_age_s: float = 0.0
    landed_age_s: float = 0.0
    battery_age_s: float = 0.0
    estimator_age_s: float = 0.0
    position_age_s: float = 0.0
    estimator_test_ratio: float | None = None
    gnss_glitch: bool = False
    thrust: float | None = None
    specific_force_body_m_s2: Array | None = None


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A velocity command with feed-forward.

    Attributes:
        t_s: When it was computed.
        vel_ned_m_s: (3,).
        acc_ned_m_s2: (3,) acceleration feed-forward; zeros for none.
        yaw_ned_rad: Heading to hold.
    """

    t_s: float
    vel_ned_m_s: Array
    acc_ned_m_s2: Array
    yaw_ned_rad: float


@dataclass(frozen=True, slots=True)
class LandingTarget:
    """Where PX4's own precision landing is to come down.

    Attributes:
        t_s: The time that it is true at.
        pos_ned_m: (3,) the pad's origin in PX4's local frame.
        yaw_ned_rad: Heading of the pad's forward axis.
    """

    t_s: float
    pos_ned_m: Array
    yaw_ned_rad: float


class AutopilotAction(StrEnum):
    """What the mission asks of the autopilot, beside setpoints."""

    ARM = "arm"
    TAKEOFF = "takeoff"
    OFFBOARD = "offboard"
    HOLD = "hold"
    LAND = "land"
    PRECLAND = "precland"
    RETURN = "return"
    DISARM = "disarm"
    FORCE_DISARM = "force_disarm"


@dataclass(frozen=True, slots=True)
class ActionResult:
    """How an AutopilotAction ended.

    Attributes:
        action: Which.
        ok: The autopilot accepted it.
        detail: Its own words, or "timeout".
    """

    action: AutopilotAction
    ok: bool
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ParameterFinding:
    """A parameter of PX4 that is not as it has to be.

    Attributes:
        name: PX4's.
        words: What it is, what it has to be, and why.
        brief: The same without the reason, for the phone: 50 characters.
        critical: Nobody is safe while it is so.
    """

    name: str
    words: str
    brief: str
    critical: bool


# -------------------------------------------------------------------------------------------------------- operator
class OperatorAction(IntEnum):
    """Parameter 1 of COMMAND_LONG 31010 (MAV_CMD_USER_1)."""

    LAND = 1
    TRACK = 2
    SEARCH = 3
    HOLD = 4
    ABORT = 5


class CommandResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """A command from the phone.

    Attributes:
        t_s: When it arrived.
        action: What is asked.
        height_m: Height above the pad to track at (parameter 2); None takes the configured one.
        sender: (system id, component id) of the phone, whom the answer goes to.
        number: Counts up with each new command of this link; names the command in answers.
        pad_drives_ne_m_s: (2,) velocity of a pad that is said to drive (parameters 3 and 4: m/s, degrees clockwise from
            north): it is searched for along its way. None: nothing is said.
        takes_over: The order says that it may take the vehicle from the pilot's mode (parameter 5 is 1).
        repeated: It came with confirmation > 0 and its first copy was never seen: it begins nothing.
        trusted: The link is signed, or inside this process: an order may start the motors without a second one.
    """

    t_s: float
    action: OperatorAction
    height_m: float | None
    sender: tuple[int, int]
    number: int
    pad_drives_ne_m_s: tuple[float, float] | None = None
    takes_over: bool = False
    repeated: bool = False
    trusted: bool = True


@dataclass(frozen=True, slots=True)
class CommandAnswer:
    """An answer to a command: any number with IN_PROGRESS, then one other.

    Attributes:
        number: Of the command.
        result: MAV_RESULT.
        progress_percent: 0..100 with IN_PROGRESS.
        asks_confirmation: The command is carried out if it is sent again: it would start the motors.
    """

    number: int
    result: CommandResult
    progress_percent: int = 0
    asks_confirmation: bool = False


class Severity(IntEnum):
    """MAV_SEVERITY, as far as it is used here."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


@dataclass(frozen=True, slots=True)
class OperatorText:
    """A line for the phone's screen (STATUSTEXT).

    Attributes:
        text: At most 50 ASCII characters; the link cuts what is longer.
        severity: How loud.
    """

    text: str
    severity: Severity = Severity.INFO


# --------------------------------------------------------------------------------------------------------- mission
class Phase(StrEnum):
    """The states of the mission."""

    IDLE = "idle"
    TAKEOFF = "takeoff"
    SEARCH = "search"
    HOVER = "hover"
    TRACK = "track"
    LAND = "land"
    PRECLAND = "precland"
    LANDED = "landed"
    HOLD = "hold"
    RETURN = "return"
    FALLBACK_LAND = "fallback_land"
    SUSPENDED = "suspended"
    """Nothing is sent, because the link or PX4's state is not known. It resumes if all is soon as before."""
    DISARM = "disarm"
    """On the ground: PX4 is asked to disarm until it shows, also if an ARM may still be on its way."""


class GoalKind(StrEnum):
    """What the velocity controller is to do."""

    NONE = "none"
    """Send nothing."""
    STAY = "stay"
    """Zero velocity: the stream that PX4 wants before offboard, and a stop."""
    SEARCH = "search"
    """Fly the search pattern about `anchor_ned_m`, at its height."""
    HOVER = "hover"
    """Stay over the track at `height_m` above the pad."""
    TRACK = "track"
    """Follow the track, feed-forward of its velocity, at `height_m` above the pad."""
    LAND = "land"
    """Follow the track and descend inside the cone, commit, touch down."""
    PRECLAND = "precland"
    """Tell PX4 where the track is, for its own precision landing; as long as it is in offboard, stay over the track."""
    CLIMB = "climb"
    """Climb to `height_m` above `anchor_ned_m`, keeping the horizontal velocity that brakes to zero."""


@dataclass(frozen=True, slots=True)
class Goal:
    """What the mission wants of the velocity controller.

    Attributes:
        kind: What to do.
        height_m: Height above the pad (HOVER, TRACK, PRECLAND) or above the anchor (SEARCH, CLIMB).
        anchor_ned_m: (3,) centre of the search, on the ground.
        drift_ne_m_s: (2,) velocity at which that centre moves on, from when the goal is taken up: that of a pad which
            drives.
        pattern_scale: The search pattern's size over the configured one: smaller for a search from lower down.
        number: Counts up with each new goal: a changed number restarts search pattern and descent.
        frame_s: Capture time of the vehicle state in whose local frame the anchor stands; jumps of the frame after it
            are added. None: it stands in the present one.
    """

    kind: GoalKind = GoalKind.NONE
    height_m: float = 0.0
    anchor_ned_m: Array = field(default_factory=lambda: np.zeros(3))
    number: int = 0
    drift_ne_m_s: tuple[float, float] = (0.0, 0.0)
    pattern_scale: float = 1.0
    frame_s: float | None = None


@dataclass(frozen=True, slots=True)
class GuidanceStatus:
    """What the velocity controller tells the mission.

    Attributes:
        t_s: When.
        goal_number: Of the goal that this is about.
        horizontal_error_m: Distance to the predicted pad; None without a usable track.
        height_above_pad_m: By the track; None without one.
        relative_speed_m_s: Horizontal speed relative to the pad; None without one.
        in_cone: Descent is allowed.
        committed: Below the commit height and sinking onto the pad: the landing is to be finished.
        contact: The vehicle rests on something: sink is commanded and does not happen.
        contact_held_s: For how long it has.
        search_finished: The whole search pattern has been flown.
        anchor_ned_m: (3,) the anchor of a SEARCH or CLIMB goal as it stands now: it has drifted, and jumped along with
            PX4's local frame; None with another goal.
        frame_s: Capture time of the vehicle state in whose local frame that anchor stands.
        climbed: The height of a CLIMB goal has been reached.
        pad_too_fast_m_s: Speed of a pad that drives away faster than the vehicle may fly; None while it can follow.
    """

    t_s: float
    goal_number: int = 0
    horizontal_error_m: float | None = None
    height_above_pad_m: float | None = None
    relative_speed_m_s: float | None = None
    in_cone: bool = False
    committed: bool = False
    contact: bool = False
    contact_held_s: float = 0.0
    search_finished: bool = False
    anchor_ned_m: Array | None = None
    frame_s: float | None = None
    climbed: bool = False
    pad_too_fast_m_s: float | None = None


@dataclass(frozen=True, slots=True)
class GoalOrder:
    """A goal with a lease: the mission renews it at every step, and the controller obeys no order that is older than
    the limit, so a mission that hangs doesn't leave the vehicle flying its last wish.

    Attributes:
        t_s: When the mission last renewed it.
        goal: What to do.
        home_ned_m: (3,) ground where this flight began, in PX4's present local frame; None between missions.
    """

    t_s: float
    goal: Goal
    home_ned_m: Array | None = None


@dataclass(frozen=True, slots=True)
class MissionReport:
    """What the mission is about, for the display and the record.

    Attributes:
        t_s: When.
        phase: The state.
        goal_kind: What the controller is told.
        reason: Why the phase was entered.
        tries: Approaches that failed.
        command: Name of the running command, or None.
        committed: A landing is being finished.
        contact: The vehicle rests on something.
        may_force_disarm: Safety allowed a forced disarm at this time.
        pad_drives: The pad moves: a vehicle that stays where it is would be left behind on the road.
    """

    t_s: float
    phase: Phase
    goal_kind: GoalKind
    reason: str
    tries: int
    command: str | None
    committed: bool = False
    contact: bool = False
    may_force_disarm: bool = False
    pad_drives: bool = False


@dataclass(frozen=True, slots=True)
class ControlTurn:
    """One turn of the control loop, for the record.

    Attributes:
        t_s: When the setpoint was sent.
        period_s: From the start of the turn before to the start of this one.
        setpoint: What was sent; None if nothing was.
        fix_latency_s: From the exposure of the frame behind the newest fix to this setpoint; only in the first turn
            that uses that fix.
        status: What the controller told the mission.
        target: What PX4's own precision landing was told; None if nothing was.
    """

    t_s: float
    period_s: float
    setpoint: Setpoint | None
    fix_latency_s: float | None
    status: GuidanceStatus | None
    target: LandingTarget | None = None


# ---------------------------------------------------------------------------------------------------------- safety
class Hazard(StrEnum):
    """What can be wrong, gravest first."""

    LINK_LOST = "link_lost"
    VEHICLE_STATE_STALE = "vehicle_state_stale"
    MODE_UNKNOWN = "mode_unknown"
    POSITION_LOST = "position_lost"
    TILT_EXCESSIVE = "tilt_excessive"
    FRAMES_FROZEN = "frames_frozen"
    PAD_COPIES_VEHICLE = "pad_copies_vehicle"
    CAMERA_TIME_WRONG = "camera_time_wrong"
    TOO_FAST = "too_fast"
    CONTROL_LATE = "control_late"
    BATTERY_LOW = "battery_low"
    BATTERY_UNKNOWN = "battery_unknown"
    FENCE_LEFT = "fence_left"
    TOO_FAR = "too_far"
    TOO_HIGH = "too_high"
    ESTIMATOR_BAD = "estimator_bad"
    WIND_EXCESSIVE = "wind_excessive"
    FRAMES_UNUSABLE = "frames_unusable"
    FRAMES_STALE = "frames_stale"
    OPERATOR_SILENT = "operator_silent"
    RECORD_FAILED = "record_failed"
    DISK_LOW = "disk_low"


class Response(StrEnum):
    """What must happen."""

    STOP_COMMANDING = "stop_commanding"
    """Send nothing more: PX4's own failsafes know better than a blind application."""
    LAND = "land"
    """PX4's own landing where it is."""
    RETURN = "return"
    """PX4's return to launch."""
    HOLD = "hold"
    """PX4's hold, also where the landing is committed and not yet in contact: what is seen can't be believed."""
    FAIL = "fail"
    """End the mission by the configured failure action."""
    WARN = "warn"
    """Tell it: the flight goes on."""


RESPONSES: dict[Hazard, Response] = {
    Hazard.LINK_LOST: Response.STOP_COMMANDING,
    Hazard.VEHICLE_STATE_STALE: Response.STOP_COMMANDING,
    Hazard.MODE_UNKNOWN: Response.STOP_COMMANDING,
    Hazard.POSITION_LOST: Response.LAND,
    Hazard.TILT_EXCESSIVE: Response.FAIL,
    Hazard.FRAMES_FROZEN: Response.HOLD,
    Hazard.PAD_COPIES_VEHICLE: Response.HOLD,
    Hazard.CAMERA_TIME_WRONG: Response.HOLD,
    Hazard.TOO_FAST: Response.HOLD,
    Hazard.CONTROL_LATE: Response.HOLD,
    Hazard.BATTERY_LOW: Response.LAND,
    Hazard.BATTERY_UNKNOWN: Response.LAND,
    Hazard.FENCE_LEFT: Response.RETURN,
    Hazard.TOO_FAR: Response.RETURN,
    Hazard.TOO_HIGH: Response.FAIL,
    Hazard.ESTIMATOR_BAD: Response.FAIL,
    Hazard.WIND_EXCESSIVE: Response.FAIL,
    Hazard.FRAMES_UNUSABLE: Response.FAIL,
    Hazard.FRAMES_STALE: Response.FAIL,
    Hazard.OPERATOR_SILENT: Response.WARN,
    Hazard.RECORD_FAILED: Response.WARN,
    Hazard.DISK_LOW: Response.WARN,
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """A hazard, with the figure and the limit in words of at most 40 characters.

    Attributes:
        hazard: Which.
        detail: "battery 12% under 15%".
        configured: What the configuration wants done; None: what RESPONSES says.
    """

    hazard: Hazard
    detail: str
    configured: Response | None = None

    @property
    def response(self) -> Response:
        """What must happen."""
        return RESPONSES[self.hazard] if self.configured is None else self.configured
