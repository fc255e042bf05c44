"""The built-in world in real time: steps to the present, MAVLink in and out, instants for the camera."""

from __future__ import annotations

import time

from app.config import WorldConfig
from drivers.simulator.endpoint import Endpoint
from drivers.simulator.film import Film
from drivers.simulator.truth_log import TruthLog
from drivers.simulator.world import STEP_S, World

STALL_S = 0.25
"""Further behind than this (the process was stopped, the machine slept) and the world's time stands still instead."""


class LiveWorld:
    """Keeps the world at the present.

    Args:
        config: The world.
        companion: (host, port) of the companion's link.
        ground_station: (host, port) of a ground station's link, or None.
        local_port: Where the companion's link listens; 0 takes any.
        frame_rate_hz: Of the camera.
        log: Of the truth.

    Attributes:
        world: What is stepped.
        stalled_s: How long its time stood still.
    """

    def __init__(
        self,
        config: WorldConfig,
        companion: tuple[str, int],
        ground_station: tuple[str, int] | None,
        local_port: int,
        frame_rate_hz: float,
        log: TruthLog,
    ) -> None:
        self.world = World(config)
        self._links = [Endpoint(self.world.px4, companion, local_port)]
        if ground_station is not None:
            self._links.append(Endpoint(self.world.px4, ground_station, ground_station=True))
        self._log = log
        self._frame_period_s = 1.0 / frame_rate_hz
        self._frame_due_s = self._frame_period_s
        self._origin_s = time.monotonic()
        self.stalled_s = 0.0

    @property
    def address(self) -> tuple[str, int]:
        """Where the companion's link listens."""
        return self._links[0].address

    def sockets(self) -> list[Endpoint]:
        """What to wait on."""
        return self._links

    def begin(self) -> None:
        """Time starts now."""
        self._origin_s = time.monotonic()

    def advance(self, film: Film) -> float:
        """Step to the present; the time until the next step is due, in seconds."""
        for link in self._links:
            link.poll()
        behind_s = time.monotonic() - self._origin_s - self.world.t_s
        if behind_s > STALL_S:
            self._origin_s += behind_s
            self.stalled_s += behind_s
        while self.world.t_s + STEP_S <= time.monotonic() - self._origin_s:
            self.world.step()
            for link in self._links:
                link.tick()
            self._observe(film)
        return self._origin_s + self.world.t_s + STEP_S - time.monotonic()

    def _observe(self, film: Film) -> None:
        """The camera and the log."""
        world = self.world
        now_s = self._origin_s + world.t_s
        if world.t_s >= self._frame_due_s:
            self._frame_due_s += self._frame_period_s
            film.expose(now_s, world.truth())
        self._log.state(now_s, world.truth(), world.px4.commander.armed)
        self._log.contacts(self._origin_s, world.contacts)

    def close(self) -> None:
        """Close the links."""
        for link in self._links:
            link.close()
