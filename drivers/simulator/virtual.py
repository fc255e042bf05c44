"""The simulator in the application's own process and time: for closed-loop tests and campaigns under a virtual clock.

The same world and renderer as the simulator's process, stepped by a task on the event loop: under app.clock.run_virtual
a flight takes as long as the machine needs and comes out the same every time. No sockets, no threads.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Self

from app.channels import Latest, Topic
from app.clock import Clock
from app.config import CameraConfig, LensConfig, WorldConfig
from app.errors import CameraError
from app.landmark import Landmark
from app.messages import ExposureLimits, Frame
from drivers.simulator.px4 import Px4
from drivers.simulator.renderer import Renderer
from drivers.simulator.shutter import LIMITS, Exposure, Shutter
from drivers.simulator.touchdown import Contact
from drivers.simulator.world import STEP_S, Truth, World

STEPS_A_TURN = 2
"""The vehicle's state is told every 8 ms."""
FRAME_TIMEOUT_S = 3.0


class SimulatedWorld:
    """A world that a task keeps at the clock's present.

    Args:
        config: The world.
        landmark: On the pad.
        lens: The camera's lens.
        camera: How it is mounted, and its frame rate.
        clock: The application's.

    Attributes:
        world: What is stepped; its px4 takes the pilot's doings (set_mode, sticks), its plant and pad hold the truth.
        frames_flow: Whether the camera gives frames; a test may stop it.
        telemetry_flows: Whether the vehicle's states are told; a test may cut the link.
        shutter: What the camera is told of its exposure.
        turned: Published after each turn, with the clock's time.
        frames: The camera's frames.
    """

    def __init__(
        self, config: WorldConfig, landmark: Landmark, lens: LensConfig, camera: CameraConfig, clock: Clock
    ) -> None:
        self.world = World(config)
        self.frames_flow = True
        self.telemetry_flows = True
        self.turned: Topic[float] = Topic("simulated time")
        self.frames: Topic[Frame] = Topic("simulated frames")
        self._renderer = Renderer(config, landmark, lens, camera)
        self._clock = clock
        self._latency_s, self._clock_error_s = config.camera_latency_s, config.camera_clock_error_s
        self.shutter = Shutter(config.exposure_delay_frames)
        self._frame_period_s = 1.0 / camera.frame_rate_hz
        self._frame_due_s = self._frame_period_s
        self._on_the_way: deque[tuple[float, Frame]] = deque()
        self._sequence = 0
        self.origin_s: float | None = None

    @property
    def px4(self) -> Px4:
        """The flight controller."""
        return self.world.px4

    @property
    def contacts(self) -> list[Contact]:
        """Touchdowns, rests and crashes, times in seconds since the world began."""
        return self.world.contacts

    def truth(self) -> Truth:
        """What is true now. For the review of a flight; the application must not see it."""
        return self.world.truth()

    def boot(self) -> None:
        """Let the autopilot come up to where it can be armed, before the first frame is taken. Call it before run."""
        while not self.world.px4.commander.ready:
            self.world.step()
        self._frame_due_s = self.world.t_s + self._frame_period_s

    async def run(self) -> None:
        """Keep the world at the present, until cancelled."""
        world = self.world
        self.origin_s = self._clock.now_s() - world.t_s
        turn_s = STEPS_A_TURN * STEP_S
        while True:
            # On the grid of the steps, so that the clock's rounding doesn't accumulate.
            await asyncio.sleep(max(0.0, self.origin_s + world.t_s + turn_s - self._clock.now_s()))
            for _ in range(STEPS_A_TURN):
                world.step()
                self._expose(self.origin_s + world.t_s)
            self._deliver(self.origin_s + world.t_s)
            if self.telemetry_flows:
                self.turned.publish(self.origin_s + world.t_s)

    def _expose(self, now_s: float) -> None:
        """Take a frame, if one is due."""
        if self.world.t_s < self._frame_due_s:
            return
        self._frame_due_s += self._frame_period_s
        self._sequence += 1
        told = self.shutter.next()
        if self.frames_flow:
            shot = self._renderer.shoot(self.world.truth(), told)
            exposure, told_s = shot.exposure, now_s - self._clock_error_s
            frame = Frame(told_s, self._sequence, shot.image, exposure.exposure_s, gain=exposure.gain)
            self._on_the_way.append((now_s + self._latency_s, frame))

    def _deliver(self, now_s: float) -> None:
        """Give out the frames whose latency is over."""
        while self._on_the_way and self._on_the_way[0][0] <= now_s:
            self.frames.publish(self._on_the_way.popleft()[1])


class SimulatedCamera:
    """app.ports.Camera on a SimulatedWorld.

    Args:
        world: Whose camera it is; its run() has to run.

    Raises:
        CameraError: From frames(): none came for a while.
    """

    def __init__(self, world: SimulatedWorld) -> None:
        self._frames: Latest[Frame] = world.frames.subscribe()
        self._shutter = world.shutter

    async def __aenter__(self) -> Self:
        """Nothing to open."""
        return self

    @property
    def exposure_control(self) -> Self:
        """The simulated camera obeys."""
        return self

    @property
    def limits(self) -> ExposureLimits:
        """What it can be told."""
        return LIMITS

    def set_exposure(self, exposure_s: float, gain: float) -> None:
        """Expose so, a few frames from now."""
        self._shutter.tell(Exposure(exposure_s, gain))

    def set_auto(self) -> None:
        """Expose by itself again."""
        self._shutter.tell(None)

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave it exposing by itself."""
        self._shutter.tell(None)

    async def frames(self) -> AsyncIterator[Frame]:
        """Frames as they come, the newest only."""
        while True:
            try:
                async with asyncio.timeout(FRAME_TIMEOUT_S):
                    frame = await self._frames.get()
            except TimeoutError:
                raise CameraError(f"the simulated camera gave no frame for {FRAME_TIMEOUT_S:.0f} s", "") from None
            yield frame
