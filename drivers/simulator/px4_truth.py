"""A real PX4's ground truth, from its own simulator (SIH), in place of the built-in vehicle.

HIL_STATE_QUATERNION comes over a MAVLink link of PX4's: attitude and rates, latitude and longitude in steps of 1.1 cm,
altitude in millimetres, velocity in centimetres a second. The velocity is integrated between the steps, so that the
picture does not jump. It carries no time (PX4 leaves it 0): it is that of its arrival, bounded by PX4's own time on
HIL_ACTUATOR_CONTROLS next to it, so that a busy machine doesn't make it late. An instant of the camera is interpolated
between two samples. Nothing but frames reaches the application.
"""

from __future__ import annotations

import math
import re
import socket
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from app.config import WorldConfig
from app.errors import AutopilotError
from app.frames import slerp
from app.log import get_logger
from drivers.simulator.contact import FOOT_DOWN_M
from drivers.simulator.film import Film
from drivers.simulator.pad import Pad, PadState
from drivers.simulator.touchdown import Contact, Seen, TouchdownWatch
from drivers.simulator.truth_log import TruthLog
from drivers.simulator.world import Truth

EARTH_RADIUS_M = 6371000.0
"""PX4's map projection takes this sphere."""
RATE_HZ = 100.0
ASK_AGAIN_S = 2.0
SETTLE_SAMPLES = 20
"""The start is the mean of so many samples at rest."""
PULL = 0.05
"""Share of the difference to the measured place that a sample takes in: 0.2 s at 100 Hz."""
TOUCH_M = 0.02
CLOCK_PERIOD_S = 0.005
"""HIL_ACTUATOR_CONTROLS, which carries PX4's time, is asked for this often."""
OFFSET_WINDOW_S = 0.5
JUMP_S = 1.0
"""PX4 was started anew, or stopped for a while."""
HISTORY = 64
_log = get_logger("simulator")


@dataclass(frozen=True, slots=True)
class _Sample:
    """The vehicle at one of PX4's instants, in the simulator's world."""

    t_s: float
    pos: tuple[float, float, float]
    vel: tuple[float, float, float]
    q: tuple[float, float, float, float]
    rates: tuple[float, float, float]
    pad: PadState


class Px4Truth:
    """Follows a PX4 SITL.

    Args:
        config: The world: the pad's motion, and the address that PX4 sends its truth to.
        frame_rate_hz: Of the camera.
        log: Of the truth.

    Raises:
        AutopilotError: The address can't be listened on.
    """

    def __init__(self, config: WorldConfig, frame_rate_hz: float, log: TruthLog) -> None:
        self._socket = _listen(config.px4_truth_address)
        self._mav = mavlink.MAVLink(None, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._mav.robust_parsing = True
        self._pad = Pad(config.motion)
        self._log = log
        self._watch = TouchdownWatch()
        self._contacts: list[Contact] = []
        self._frame_period_s = 1.0 / frame_rate_hz
        self._frame_due_s = 0.0
        self._clock: tuple[float, float] | None = None
        self._offsets: deque[tuple[float, float]] = deque()
        self._start: list[tuple[float, float, float]] = []
        self._samples: deque[_Sample] = deque(maxlen=HISTORY)
        self._armed = False
        self._asked_s = -math.inf
        self._remote: tuple[str, int] | None = None
        self._system = 1

    def sockets(self) -> list[Any]:
        """What to wait on."""
        return [self._socket]

    def begin(self) -> None:
        """Frames start now."""
        self._frame_due_s = time.monotonic()

    def advance(self, film: Film) -> float:
        """Take in what has arrived and give the camera the instants that it covers; seconds until the next look."""
        while True:
            try:
                packet, self._remote = self._socket.recvfrom(4096)
            except BlockingIOError:
                break
            for message in self._mav.parse_buffer(packet) or ():
                self._take(message)
        self._ask()
        self._expose(film)
        return 0.004

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    # ------------------------------------------------------------------------------------------------------ the link
    def _ask(self) -> None:
        """Ask for the truth at the rate that is wanted, until it comes."""
        now_s = time.monotonic()
        if self._remote is None or now_s - self._asked_s < ASK_AGAIN_S:
            return
        self._asked_s = now_s
        for number, rate_hz in (
            (mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, RATE_HZ),
            (mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS, 1.0 / CLOCK_PERIOD_S),
        ):
            request = mavlink.MAVLink_command_long_message(
                self._system, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, 1e6 / rate_hz, 0, 0, 0, 0, 0
            )
            self._socket.sendto(request.pack(self._mav), self._remote)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.get_srcComponent() == 1:
            self._system = message.get_srcSystem()
            self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == "HIL_ACTUATOR_CONTROLS":
            self._take_clock(message.time_usec * 1e-6)
        elif kind == "HIL_STATE_QUATERNION":
            self._take_truth(message)

    def _take_clock(self, px4_s: float) -> None:
        """PX4's time, on a message of the same stream: the truth itself carries none."""
        offset_s = time.monotonic() - px4_s
        if self._clock is not None and abs(offset_s - self._clock[1]) > JUMP_S:
            self._offsets.clear()
        # The fastest of the last packets tells the offset; a PX4 on a busy machine runs a little slow.
        self._offsets.append((px4_s, offset_s))
        while self._offsets[0][0] < px4_s - OFFSET_WINDOW_S:
            self._offsets.popleft()
        self._clock = (px4_s, min(offset for _, offset in self._offsets))

    def _take_truth(self, message: Any) -> None:
        now_s = time.monotonic()
        if self._clock is not None:
            # It left right after the last message with a time: however late it is read, it is not much younger.
            now_s = min(now_s, sum(self._clock) + CLOCK_PERIOD_S)
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        if len(self._start) < SETTLE_SAMPLES:
            self._start.append(place)
            if len(self._start) == SETTLE_SAMPLES:
                _log.info("px4_truth.found", system=self._system)
            return
        if self._samples and not 0.0 < now_s - self._samples[-1].t_s < JUMP_S:
            self._samples.clear()
        self._add(now_s, place, message)

    # ----------------------------------------------------------------------------------------------------- the vehicle
    def _add(self, t_s: float, place: tuple[float, float, float], message: Any) -> None:
        measured = self._local(place)
        vel = (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
        pos, pad = measured, self._pad.state
        if self._samples:
            last = self._samples[-1]
            dt = t_s - last.t_s
            ahead = [p + 0.5 * dt * (v + w) for p, v, w in zip(last.pos, last.vel, vel, strict=True)]
            moved = [p + PULL * (m - p) for p, m in zip(ahead, measured, strict=True)]
            # Altitude has no coarse steps: it is taken as it is.
            pos = (moved[0], moved[1], measured[2])
            pad = self._pad.step(dt, -pos[2] - FOOT_DOWN_M, (pos[0], pos[1]))
        w, x, y, z = message.attitude_quaternion
        sample = _Sample(t_s, pos, vel, (w, x, y, z), (message.rollspeed, message.pitchspeed, message.yawspeed), pad)
        self._samples.append(sample)
        self._note(sample)

    def _local(self, place: tuple[float, float, float]) -> tuple[float, float, float]:
        """North, east, down of the body's origin in the world: ground at 0, the start at the feet's height."""
        latitude, longitude, altitude = (sum(v) / len(self._start) for v in zip(*self._start, strict=True))
        north = math.radians(place[0] - latitude) * EARTH_RADIUS_M
        east = math.radians(place[1] - longitude) * EARTH_RADIUS_M * math.cos(math.radians(latitude))
        return north, east, altitude - place[2] - FOOT_DOWN_M

    def _note(self, sample: _Sample) -> None:
        """Contacts and the log."""
        pad = sample.pad
        forward, right = pad.offset_m(sample.pos[0], sample.pos[1])
        over = max(abs(forward), abs(right)) <= pad.deck_half_m
        clearance = (pad.down_m if over else 0.0) - sample.pos[2] - FOOT_DOWN_M
        cos_tilt = 1.0 - 2.0 * (sample.q[1] ** 2 + sample.q[2] ** 2)
        seen = Seen(
            sample.t_s,
            sample.pos,
            sample.vel,
            math.acos(max(-1.0, min(1.0, cos_tilt))),
            clearance < TOUCH_M,
            over and clearance < TOUCH_M,
            self._armed,
            None,
            clearance,
        )
        self._contacts += self._watch.step(seen, pad)
        self._log.state(sample.t_s, self._truth(sample), self._armed)
        self._log.contacts(0.0, self._contacts)

    @staticmethod
    def _truth(sample: _Sample) -> Truth:
        return Truth(sample.t_s, sample.pos, sample.vel, sample.q, sample.rates, sample.pad)

    # ------------------------------------------------------------------------------------------------------ the camera
    def _expose(self, film: Film) -> None:
        """Give the camera each instant that lies between two samples."""
        if len(self._samples) < 2:
            return
        newest_s = self._samples[-1].t_s
        if self._frame_due_s < newest_s - JUMP_S:
            self._frame_due_s = newest_s  # it was silent: no use in drawing the past
        while self._frame_due_s <= newest_s:
            truth = self._between(self._frame_due_s)
            if truth is not None:
                film.expose(self._frame_due_s, truth)
            self._frame_due_s += self._frame_period_s

    def _between(self, t_s: float) -> Truth | None:
        """The truth at a time, interpolated."""
        samples = self._samples
        for later, sooner in zip(reversed(samples), list(reversed(samples))[1:], strict=False):
            if sooner.t_s <= t_s <= later.t_s:
                share = (t_s - sooner.t_s) / (later.t_s - sooner.t_s)
                q = slerp(np.array(sooner.q), np.array(later.q), share)
                a, b = sooner.pad, later.pad
                pad = PadState(
                    a.north_m + share * (b.north_m - a.north_m),
                    a.east_m + share * (b.east_m - a.east_m),
                    a.down_m,
                    b.vel_north_m_s,
                    b.vel_east_m_s,
                    a.heading_rad,
                    a.deck_half_m,
                )
                return Truth(
                    t_s,
                    _mix(sooner.pos, later.pos, share),
                    _mix(sooner.vel, later.vel, share),
                    (float(q[0]), float(q[1]), float(q[2]), float(q[3])),
                    _mix(sooner.rates, later.rates, share),
                    pad,
                )
        return None


def _mix(a: tuple[float, float, float], b: tuple[float, float, float], share: float) -> tuple[float, float, float]:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))


def _listen(address: str) -> socket.socket:
    """A UDP socket on udpin:HOST:PORT."""
    match = re.fullmatch(r"udpin:(?://)?([^:/]*):(\d{1,5})", address)
    if match is None:
        raise AutopilotError(f"px4_truth_address {address!r} can't be listened on", "give udpin:HOST:PORT")
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.setblocking(False)
    try:
        listener.bind((match[1] or "0.0.0.0", int(match[2])))
    except OSError as error:
        listener.close()
        raise AutopilotError(f"px4_truth_address {address}: {error.strerror}", "stop what holds the port") from error
    return listener
