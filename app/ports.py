"""What the application needs of the world: the Protocols that drivers implement.

Every method that waits on hardware ends in bounded time or raises; each driver is an async context manager that
opens in `__aenter__` (raising the AlightError of its kind) and releases everything in `__aexit__`.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Any, Protocol, Self

from app.messages import (
    AutopilotAction,
    CommandAnswer,
    ExposureLimits,
    Frame,
    LandingTarget,
    OperatorCommand,
    OperatorText,
    ParameterFinding,
    Setpoint,
    VehicleState,
)


def always() -> bool:
    """True."""
    return True


class Port(Protocol):
    """An async context manager."""

    async def __aenter__(self) -> Self:
        """Open it."""
        ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release everything."""
        ...


class ExposureControl(Protocol):
    """A camera whose exposure can be told. What it really did is in each frame: exposure_s and gain, or None there
    while that isn't known; a change takes a few frames. Until it is told, it exposes by itself.
    """

    @property
    def limits(self) -> ExposureLimits:
        """What it can be told; beyond them it does what comes nearest."""
        ...

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        """Expose so from now on. Never waits; a fault of the camera shows in its frames."""
        ...

    def set_auto(self) -> None:
        """Expose by itself again. Never waits."""
        ...


class Camera(Port, Protocol):
    """A source of frames. Opening raises CameraError."""

    @property
    def exposure_control(self) -> ExposureControl | None:
        """How its exposure is told; None: it can't be (a stream, a file, a device without). Known once it is open."""
        ...

    def frames(self) -> AsyncIterator[Frame]:
        """Frames as they come, each with its mid-exposure time; only the newest is kept for a slow reader.

        Ends when the source ends (files); raises CameraError when the camera fails.
        """
        ...


class Autopilot(Port, Protocol):
    """PX4. Opening connects and raises AutopilotError when no autopilot answers on the address."""

    @property
    def parameter_findings(self) -> tuple[ParameterFinding, ...]:
        """PX4's failsafe parameters that are not as they have to be, critical ones first. Known once it is open."""
        ...

    def states(self) -> AsyncIterator[VehicleState]:
        """The newest state, each time the attitude is updated, and at least twice a second with connected=False."""
        ...

    async def send_setpoint(self, setpoint: Setpoint) -> None:
        """Send one setpoint, once. Nothing re-sends it."""
        ...

    async def send_landing_target(self, target: LandingTarget) -> None:
        """Tell PX4's own precision landing once where the pad is."""
        ...

    async def execute(
        self,
        action: AutopilotAction,
        *,
        height_m: float = 0.0,
        asked_s: float | None = None,
        wanted: Callable[[], bool] = always,
    ) -> None:
        """Run an action to the autopilot's answer. Cancelling the call ends it at once: nothing of it is sent after.

        One action runs at a time: a new one ends the one before, which then raises. An action without an answer is sent
        again only while `wanted` says so and the vehicle is still in the mode and armed as when it was asked; in the
        mode that was asked for it has succeeded; in any other mode it is the pilot's, and the action fails. ARM and
        FORCE_DISARM are sent once.

        Args:
            action: Which.
            height_m: TAKEOFF climbs to this height above the present place.
            asked_s: When it was decided, on the application's clock; None: now. What is older than its limit (0.2 s for
                FORCE_DISARM, 0.5 s for the others) when it would be put on the wire is not sent.
            wanted: Whether it should still be sent; asked before each repeated sending.

        Raises:
            AutopilotError: It was refused (with the autopilot's words), no answer came in time, it was too old, it is
                no longer wanted, or another action replaced it.
        """
        ...


class OperatorLink(Port, Protocol):
    """The phone. Opening raises OperatorError."""

    def commands(self) -> AsyncIterator[OperatorCommand]:
        """Commands as they arrive, retransmissions left out."""
        ...

    async def answer(self, answer: CommandAnswer) -> None:
        """Answer a command."""
        ...

    async def say(self, text: OperatorText) -> None:
        """Show a line on the phone."""
        ...


class Recorder(Port, Protocol):
    """The flight record. Opening raises RecorderError."""

    def write(self, topic: str, t_s: float, message: Any) -> None:
        """Record a message (a dataclass of app.messages; a Frame is compressed). Never blocks the caller."""
        ...
