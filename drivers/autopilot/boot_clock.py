"""What PX4's time since boot is on our own clock. Values in and out; knows no messages."""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass

BUCKET_S = 0.25
SKEW_BUCKETS = 40
"""10 s: over which the two clocks' rates are compared."""
FIRST_SKEW_BUCKETS = 4
"""Distance of the pairs that give the first slope, 2 s after the start."""
OFFSET_BUCKETS = 6
"""1.5 s: over which the message with the shortest delay is looked for."""
GAP_S = 2.0
"""After a silence as long as this, earlier messages say nothing of the offset."""
SKEW_MAX = 0.05
"""A simulated PX4 on a busy machine runs slow by a per cent; a crystal is off by 50e-6 at most."""


@dataclass(frozen=True, slots=True)
class _Quickest:
    """The message of one bucket that had the shortest delay."""

    boot_s: float
    difference_s: float


class BootClock:
    """The offset between PX4's boot clock and ours, from arrivals: arrival - boot = offset + delay, and delay >= 0.

    The smallest difference of a sliding window is the offset plus the link's shortest delay, whatever the others
    suffered on the way. The window slides, and differences are carried along at the rate at which the clocks part
    (the median slope between bucket minima half a history apart, Theil and Sen's way), so that they may drift.

    Args:
        restart_s: A boot time this much behind the newest one means that the autopilot was restarted.

    Attributes:
        restarts: How often the autopilot's clock began anew.
    """

    def __init__(self, restart_s: float = 1.0) -> None:
        self._restart_s = restart_s
        self.restarts = 0
        self._forget()

    def _forget(self) -> None:
        self._buckets: deque[_Quickest] = deque(maxlen=SKEW_BUCKETS)
        self._bucket_end_s = -math.inf
        self._newest_boot_s = -math.inf
        self._newest_arrival_s = math.inf
        self._skew = 0.0

    def observe(self, boot_s: float, arrival_s: float) -> bool:
        """Take one message's boot time and its arrival on our clock, both in seconds.

        Returns:
            Whether this is the first of a restarted autopilot: what was known before it is void.
        """
        restarted = boot_s < self._newest_boot_s - self._restart_s
        if restarted:
            self._forget()
            self.restarts += 1
        if arrival_s - self._newest_arrival_s > GAP_S:
            # The clocks are compared afresh: a simulated one may have stood still in the meantime.
            self._forget()
        self._newest_boot_s = max(self._newest_boot_s, boot_s)
        self._newest_arrival_s = arrival_s
        here = _Quickest(boot_s, arrival_s - boot_s)
        if boot_s >= self._bucket_end_s:
            self._skew = self._measured_skew()
            self._buckets.append(here)
            self._bucket_end_s = boot_s + BUCKET_S
        elif here.difference_s < self._buckets[-1].difference_s:
            self._buckets[-1] = here
        return restarted

    def _measured_skew(self) -> float:
        """Seconds a second by which our clock gains on PX4's; 0 until the buckets suffice."""
        half = len(self._buckets) // 2
        if half < FIRST_SKEW_BUCKETS:
            return 0.0
        pairs = zip(self._buckets, list(self._buckets)[half:], strict=False)
        slope = statistics.median((b.difference_s - a.difference_s) / (b.boot_s - a.boot_s) for a, b in pairs)
        return max(-SKEW_MAX, min(SKEW_MAX, slope))

    def offset_s(self, boot_s: float) -> float | None:
        """Our clock minus PX4's at a boot time; None before the first message."""
        recent = list(self._buckets)[-OFFSET_BUCKETS:]
        return min((q.difference_s + self._skew * (boot_s - q.boot_s) for q in recent), default=None)

    def to_ours_s(self, boot_s: float) -> float:
        """A boot time on our clock.

        Raises:
            ValueError: No message has been observed.
        """
        offset_s = self.offset_s(boot_s)
        if offset_s is None:
            raise ValueError("the autopilot's clock is not known before its first message")
        return boot_s + offset_s

    def to_boot_s(self, ours_s: float) -> float:
        """A time of ours on PX4's boot clock, 0 while it is unknown (PX4 doesn't read the time of a setpoint)."""
        offset_s = self.offset_s(self._newest_boot_s)
        return 0.0 if offset_s is None else max(0.0, ours_s - offset_s)
