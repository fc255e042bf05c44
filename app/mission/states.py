"""What the mission state machine remembers, sees and says. Values only."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from app.frames import Array
from app.local_frame import FrameJumps
from app.messages import (
    ActionResult,
    AutopilotAction,
    CommandAnswer,
    FlightMode,
    Goal,
    GuidanceStatus,
    OperatorCommand,
    OperatorText,
    PadTrack,
    Phase,
    VehicleState,
    Verdict,
)


class Reason(StrEnum):
    """Why the state changed, or a command was refused. Every one is told to the phone and to the log."""

    COMMANDED = "commanded"
    ALREADY_FLYING = "already flying"
    HEIGHT_REACHED = "height reached"
    PAD_FOUND = "pad found"
    SETTLED = "settled over the pad"
    TRACK_STEADY = "track steady"
    PAD_LOST = "pad lost"
    PAD_NOT_FOUND = "pad not found"
    SEARCHES_LOWER = "not found, searching lower"
    TURNS_BACK = "not found ahead, turning back"
    PAD_MOVES = "pad moves"
    PAD_TOO_FAST = "the pad drives away too fast"
    PAD_MISSED = "missed the pad, going round"
    TIMED_OUT = "took too long"
    TRIES_USED_UP = "tries used up"
    TOUCHDOWN = "on the pad, disarmed"
    DISARMED = "disarmed"
    PILOT_TOOK_OVER = "mode changed by pilot or PX4"
    REFUSED_BY_AUTOPILOT = "refused by the autopilot"
    HELD_BY_OPERATOR = "held by the phone"
    ABORTED_BY_OPERATOR = "aborted by the phone"
    SAFETY = "safety"
    NOT_ARMABLE = "not ready to arm"
    NO_MISSION = "no mission to end"
    COMMITTED = "landing is committed"
    ON_THE_GROUND = "on the ground"
    RESUMED = "link and state are back, going on"
    LINK_WAS_LOST = "link was lost: give a new order"
    PX4_FAILSAFE = "PX4's own failsafe flies"
    HELD_TOO_LONG = "held too long"
    STOPPED = "Alight stops"
    BESIDE_PAD = "low beside the pad, going round"
    UNEXPECTED_CONTACT = "contact before the pad"
    NOT_DISARMED = "PX4 does not disarm, use the remote"


IN_OFFBOARD = frozenset({Phase.SEARCH, Phase.HOVER, Phase.TRACK, Phase.LAND})
"""The phases in which Alight steers."""
ACTIVE = IN_OFFBOARD | {Phase.TAKEOFF, Phase.PRECLAND}
"""The phases in which a command is being carried out."""
OWN_MODE = {
    Phase.HOLD: (AutopilotAction.HOLD, FlightMode.HOLD),
    Phase.RETURN: (AutopilotAction.RETURN, FlightMode.RETURN),
    Phase.FALLBACK_LAND: (AutopilotAction.LAND, FlightMode.LAND),
    Phase.PRECLAND: (AutopilotAction.PRECLAND, FlightMode.PRECLAND),
}
"""What is asked of PX4 on entering a phase that it flies by itself, and the mode that this shows as."""
NO_ARMING_IN = frozenset({FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.PRECLAND, FlightMode.RETURN})
"""The modes that a flight ends in and in which PX4 does not arm: hold comes first."""
HANDED_OVER = frozenset(OWN_MODE)
"""The phases in which PX4 flies a mode of its own because Alight asked for it."""
OVER = frozenset({Phase.IDLE, Phase.LANDED})
"""The phases without a mission."""


@dataclass(frozen=True, slots=True)
class PadWatch:
    """How far the pad has gone in PX4's local frame.

    Attributes:
        since_s: When it was last looked at.
        from_ne_m: Where it was then, north and east.
        speed_m_s: Its way since it was looked at before that, over the time; None at first.
    """

    since_s: float
    from_ne_m: tuple[float, float]
    speed_m_s: float | None = None


@dataclass(frozen=True, slots=True)
class Suspended:
    """A phase that was interrupted.

    Attributes:
        phase: Which.
        goal: What the controller was told.
        frame_resets: PX4's count of jumps of its local frame then.
    """

    phase: Phase
    goal: Goal
    frame_resets: int


@dataclass(frozen=True, slots=True)
class MissionState:
    """All that the machine remembers.

    Attributes:
        phase: Where it is.
        since_s: Since when.
        goal: What the controller was told.
        command: The command that is being carried out; None when done.
        tries: Landings (or approaches) that failed in this mission.
        home_ned_m: (3,) ground below where this mission began; None between missions.
        ground_known: Where the ground is was seen: by standing on it, or by the pad on it. A mission that began in the
            air only assumes it.
        search_passes: How often the search pattern has been flown out in this search.
        left_behind_s: When the pad was last seen whose last velocity this search goes along with; None if with none.
        pending: The action whose answer is awaited.
        asked: The action that was last asked for in this phase.
        asked_s: When it was asked for.
        accepted: That action, once PX4 has accepted it; that it happened shows up to a second later.
        refusals: How often PX4 refused an action of this phase, or accepted it without showing it.
        refusal: PX4's words at the last refusal.
        entry_mode: PX4's mode when Alight began to ask for another: not yet a sign of the pilot.
        offboard_seen: PX4 has accepted and reported offboard since.
        steady_since_s: Since when the vehicle has been settled over the pad.
        committed_since_s: Since when the landing has been committed.
        contact_s: When the vehicle last rested on something in this landing.
        arm_asked: This order has asked PX4 to arm. It asks once.
        armed_seen: The vehicle has shown armed since.
        takeoff_accepted: PX4 accepted the take-off.
        takeoff_accepted_s: When.
        takeoff_seen: PX4 has shown its take-off mode since.
        handed_over: PX4 has taken up the mode of its own that this phase asked for.
        watch: Of the pad's way over ground, for a landing that is left to PX4.
        hold_until_s: When a hold that nobody asked for ends; None: it has no limit.
        suspended: What was interrupted, in SUSPENDED.
        last_order: The order that began the newest mission; it does not begin another one right after the landing.
        stopping_since_s: Since when the application has been going down.
        jumps: Of PX4's local frame, in which home and the goal's anchor stand.
    """

    phase: Phase = Phase.IDLE
    since_s: float = 0.0
    goal: Goal = field(default_factory=Goal)
    command: OperatorCommand | None = None
    tries: int = 0
    home_ned_m: Array | None = None
    ground_known: bool = False
    search_passes: int = 0
    left_behind_s: float | None = None
    pending: AutopilotAction | None = None
    asked: AutopilotAction | None = None
    asked_s: float = 0.0
    accepted: AutopilotAction | None = None
    refusals: int = 0
    refusal: str = ""
    entry_mode: FlightMode = FlightMode.UNKNOWN
    offboard_seen: bool = False
    steady_since_s: float | None = None
    committed_since_s: float | None = None
    contact_s: float | None = None
    arm_asked: bool = False
    armed_seen: bool = False
    takeoff_accepted: bool = False
    takeoff_accepted_s: float = 0.0
    takeoff_seen: bool = False
    handed_over: bool = False
    watch: PadWatch | None = None
    hold_until_s: float | None = None
    suspended: Suspended | None = None
    last_order: OperatorCommand | None = None
    stopping_since_s: float | None = None
    jumps: FrameJumps = field(default_factory=FrameJumps, compare=False)


@dataclass(frozen=True, slots=True)
class MissionInputs:
    """All that the machine sees in one step.

    Attributes:
        vehicle: Newest state; None before the first.
        track: Newest track; None without one.
        track_usable: The track is confident and fresh.
        guidance: Newest word of the velocity controller; of another goal number it is ignored.
        verdict: The gravest hazard.
        command: A new command of the phone.
        results: Answers to actions since the last step.
        may_force_disarm: Safety allows a forced disarm now.
        px4_lands: A landing is left to PX4's own precision landing (guidance.method).
        stopping: The application is to end: bring the vehicle into a state that needs it no more.
    """

    vehicle: VehicleState | None
    track: PadTrack | None
    track_usable: bool
    guidance: GuidanceStatus | None
    verdict: Verdict | None = None
    command: OperatorCommand | None = None
    results: tuple[ActionResult, ...] = ()
    may_force_disarm: bool = False
    px4_lands: bool = False
    stopping: bool = False


@dataclass(frozen=True, slots=True)
class Transition:
    """What a step decides.

    Attributes:
        state: The next state.
        reason: Why the phase changed; None if it didn't.
        action: An action to ask of the autopilot now.
        action_height_m: Its height (TAKEOFF).
        answers: To the phone's commands.
        texts: Lines for the phone.
        cancels: The action that was pending is not wanted any more: it must not be sent again.
    """

    state: MissionState
    reason: Reason | None = None
    action: AutopilotAction | None = None
    action_height_m: float = 0.0
    answers: tuple[CommandAnswer, ...] = ()
    texts: tuple[OperatorText, ...] = ()
    cancels: bool = False
