"""What the application needs of the world: the Protocols that drivers implement.

Every method that waits on hardware ends in bounded time or raises; each driver is an async context manager that
opens in `__aenter__` (raising the AlightError of its kind) and releases everything in `__aexit__`.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
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
    Setpoint,
    VehicleState,
)


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

    def states(self) -> AsyncIterator[VehicleState]:
        """The newest state, each time the attitude is updated, and at least twice a second with connected=False."""
        ...

    async def send_setpoint(self, setpoint: Setpoint) -> None:
        """Send one setpoint, once. Nothing re-sends it."""
        ...

    async def send_landing_target(self, target: LandingTarget) -> None:
        """Tell PX4's own precision landing once where the pad is."""
        ...

    async def execute(self, action: AutopilotAction, *, height_m: float = 0.0) -> None:
        """Run an action to the autopilot's answer. TAKEOFF climbs to height_m above the present place.

        Raises:
            AutopilotError: It was refused (with the autopilot's words) or no answer came in time.
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
