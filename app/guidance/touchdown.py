"""Contact: sink is commanded and does not happen. Pure.

PX4's land detector needs seconds, and on a moving pad it waits for a speed that never falls; this monitor looks at
what any contact shows at once: the vehicle was told to sink, was sinking, and stands still above what it landed on.
"""

from __future__ import annotations

from dataclasses import dataclass

COMMANDED_SINK_MIN_M_S = 0.3
STOPPED_FRACTION = 0.35
"""Contact is assumed when less than this part of the commanded sink is left. In flight PX4 reaches 63% of a sink step
in 0.3 s and 90% in 0.75 s, and overshoots by 17%."""
RESUMED_FRACTION = 0.7
"""A standstill that is pressed upon, and a contact, have ended when this part of the commanded sink is back: a vehicle
that touched down leaning sinks at 0.3 m/s as it falls onto its other feet, and slides if the press lets go then. On
the ground PX4's velocity wanders by 0.1 to 0.15 m/s, which is a fifth of the sink that is commanded: nothing short
of falling may end a contact."""
FALL_S = 0.15
"""... for this long: a vehicle that touched down on two feet falls onto the others meanwhile."""
SETTLE_S = 0.5
"""The sink must have been commanded for this long: before, a vehicle that has not begun to sink looks the same."""
PRESS_AFTER_S = 0.1
"""After this long at rest more sink is asked for, as a question: what stands on a deck stays, what a gust held up falls
on, and by less than 0.3 m/s faster before that shows."""
HOLD_S = 0.35
"""The stop must last this long: gusts and ground effect slow a sink for less."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The memory of the monitor.

    Attributes:
        sinking_since_s: When the sink was first commanded without a break; None while it is not.
        stopped_since_s: Since when the vehicle has not been sinking; None while it is.
        contact: It rests on something. Stays true while sink is commanded and the vehicle doesn't move.
        falling_since_s: Since when it has been sinking again in spite of its contact; None while it has not.
    """

    sinking_since_s: float | None = None
    stopped_since_s: float | None = None
    contact: bool = False
    falling_since_s: float | None = None

    def presses(self, now_s: float) -> bool:
        """Whether more sink is to be asked for: at rest for PRESS_AFTER_S, or in contact."""
        return self.contact or (self.stopped_since_s is not None and now_s - self.stopped_since_s >= PRESS_AFTER_S)

    def held_s(self, now_s: float) -> float:
        """How long the vehicle has been at rest while told to sink."""
        return 0.0 if self.stopped_since_s is None or not self.contact else now_s - self.stopped_since_s


def step_contact(memory: Contact, commanded_sink_m_s: float, actual_sink_m_s: float, now_s: float) -> Contact:
    """The next memory, from the commanded and the actual sink speed, both positive down and relative to the pad."""
    if commanded_sink_m_s < COMMANDED_SINK_MIN_M_S:
        return Contact()
    since = now_s if memory.sinking_since_s is None else memory.sinking_since_s
    fraction = RESUMED_FRACTION if memory.presses(now_s) else STOPPED_FRACTION
    stopped = actual_sink_m_s < fraction * commanded_sink_m_s and now_s - since >= SETTLE_S
    if not stopped:
        falling_since = now_s if memory.falling_since_s is None else memory.falling_since_s
        if memory.contact and now_s - falling_since < FALL_S:
            return Contact(since, memory.stopped_since_s, True, falling_since)
        return Contact(sinking_since_s=since)
    stopped_since = now_s if memory.stopped_since_s is None else memory.stopped_since_s
    return Contact(since, stopped_since, now_s - stopped_since >= HOLD_S)
