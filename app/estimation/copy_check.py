"""Does the pad copy the vehicle's own motion? Pure.

A pad's place in PX4's local frame is the vehicle's place plus what the camera sees, turned by the vehicle's attitude.
Where the camera sees right, the vehicle's shaking and turning cancel in that sum, and the pad moves smoothly. Where the
image is frozen or late, the frames' times are wrong, or the camera is mounted otherwise than the configuration says, a
part of the vehicle's own motion stays in it; a controller that follows such a pad follows itself.

Over a window of a second, let o be the way of a point that is fixed to the vehicle where the pad is (its own motion
with its turning), and p the measured way of the pad, both horizontal, as complex numbers (north + i east), less a
parabola in time each: a pad's own acceleration is steady over a second, the vehicle's shaking is not. The regression
c = sum(conj(o) p) / sum(|o|^2) is 0 for a right measurement and 1 for a frozen image; a camera that is turned by the
angle a about its axis gives 1 - exp(i a), an image that is late by t at the frequency w has the real part
1 - cos(w t). Both signals contain the same error of PX4's attitude, so c is a little over 0 at rest.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from app.frames import Array, rotation_from_quaternion
from app.messages import PadFix, TrackCheck

WINDOW_S = 1.2
FIXES_MIN = 8
STEP_S = 0.1
"""The window is judged so often."""
OWN_MOTION_MIN_M = 0.02
"""Root mean square of o: below that the noise of the measurements decides."""
OWN_MOTION_MIN_RAD = math.radians(0.45)
"""... and of o over the distance: below that the error of PX4's attitude decides."""
COPY_MIN = 0.35
"""A mount that is off by 20 degrees gives this. Of 30 flights over pads at rest, cars that brake and turn, and boats,
with both limits met by no window, 95 % of all windows stayed under 0.3, with late and slow cameras too (measured)."""
COHERENCE_MIN = 0.5
"""Part of p that o explains: the pad's own motion and noise are not in it."""
WRONG_FOR_S = 1.6
"""Longer than the window: one step of PX4's attitude, or one frame at a wrong time, is in it for 1.2 s (on a busy
machine with a real PX4 such a step was 3 cm at 2.5 m)."""
OWN_MOTION_STRONG_M = 0.03
STRONG_MAX = 3.0
"""A window with more motion than that counts for more time, up to so many times."""
RIGHT_LEAK = 0.5
"""A window that is right takes back this part of its time."""


@dataclass(frozen=True, slots=True)
class _Sample:
    t_s: float
    travelled_ne_m: Array
    ned_from_body: Array
    from_vehicle_ned_m: Array


class CopyCheck:
    """Judges fixes as they come; remembers a window of them."""

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque()
        self._judged_s = -math.inf
        self._wrong_s = 0.0
        self._mean = 0j
        self._check = TrackCheck(0.0)

    def reset(self) -> None:
        """Forget: PX4's local frame has jumped."""
        self._samples.clear()

    def update(self, fix: PadFix, q_ned_from_body_wxyz: Array) -> TrackCheck:
        """Take a fix.

        Args:
            fix: With travelled_ned_m.
            q_ned_from_body_wxyz: (4,) the vehicle's attitude that it was made with.
        """
        samples, t_s = self._samples, fix.t_capture_s
        if fix.travelled_ned_m is None or (samples and t_s <= samples[-1].t_s):
            return self._check
        samples.append(
            _Sample(
                t_s,
                fix.travelled_ned_m[:2],
                rotation_from_quaternion(q_ned_from_body_wxyz),
                fix.pad_from_vehicle_ned_m,
            )
        )
        while t_s - samples[0].t_s > WINDOW_S:
            samples.popleft()
        if t_s - self._judged_s < STEP_S:
            return self._check
        dt_s = min(t_s - self._judged_s, 3.0 * STEP_S)
        self._judged_s = t_s
        judged = regression(samples)
        if judged is None:
            self._check = TrackCheck(t_s, None, self._check.cause, self._check.since_s)
            return self._check
        ratio, coherence, own_motion_m = judged
        if abs(ratio) >= COPY_MIN and coherence >= COHERENCE_MIN:
            self._mean = ratio if self._wrong_s == 0.0 else self._mean + 0.2 * (ratio - self._mean)
            weight = min(STRONG_MAX, max(1.0, own_motion_m / OWN_MOTION_STRONG_M))
            self._wrong_s = min(1.5 * WRONG_FOR_S, self._wrong_s + weight * dt_s)
        else:
            self._wrong_s = max(0.0, self._wrong_s - RIGHT_LEAK * dt_s)
        wrong = self._wrong_s >= WRONG_FOR_S or (bool(self._check.cause) and self._wrong_s > 0.0)
        since_s = (t_s if self._check.since_s is None else self._check.since_s) if wrong else None
        self._check = TrackCheck(t_s, abs(ratio), likely_cause(self._mean) if wrong else "", since_s)
        return self._check


def regression(samples: deque[_Sample]) -> tuple[complex, float, float] | None:
    """How much of the vehicle's own motion the pad copies, which part of the pad's motion that explains, and the root
    mean square of the own motion, m; None where there are too few fixes or too little motion.
    """
    if len(samples) < FIXES_MIN or samples[-1].t_s - samples[0].t_s < 0.6 * WINDOW_S:
        return None
    t = np.array([sample.t_s for sample in samples]) - samples[-1].t_s
    travelled = np.array([sample.travelled_ne_m for sample in samples])
    turning = np.array([sample.ned_from_body for sample in samples])
    seen = np.array([sample.from_vehicle_ned_m for sample in samples])
    in_body = np.einsum("kji,kj->ki", turning, seen).mean(axis=0)
    own = travelled + (turning @ in_body)[:, :2]
    pad = travelled + seen[:, :2]
    o, p = _shaking(t, own), _shaking(t, pad)
    power_o, power_p = float(np.vdot(o, o).real), float(np.vdot(p, p).real)
    rms_m = math.sqrt(power_o / len(samples))
    if rms_m < max(OWN_MOTION_MIN_M, OWN_MOTION_MIN_RAD * float(np.linalg.norm(in_body))) or power_p == 0.0:
        return None
    product = complex(np.vdot(o, p))
    return product / power_o, abs(product) ** 2 / (power_o * power_p), rms_m


def _shaking(t_s: Array, way_m: Array) -> Array:
    """(n,) complex: a way (n, 2) less its best parabola in time."""
    basis = np.stack([np.ones_like(t_s), t_s, t_s * t_s], axis=1)
    rest = way_m - basis @ np.linalg.lstsq(basis, way_m, rcond=None)[0]
    result: Array = rest[:, 0] + 1j * rest[:, 1]
    return result


MOUNT_MIN_DEG, MOUNT_MAX_DEG = 15.0, 150.0
"""A late image looks like a mount that is turned by 0 or 180 degrees: in between it is the mount."""


def likely_cause(ratio: complex) -> str:
    """What most likely makes a pad copy so much of the vehicle's motion, in at most 40 characters."""
    rest = 1.0 - ratio
    angle_deg = abs(math.degrees(cmath.phase(rest)))
    if 0.6 <= abs(rest) <= 1.4 and MOUNT_MIN_DEG < angle_deg < MOUNT_MAX_DEG:
        return f"camera mount is turned by {angle_deg:.0f} deg?"
    return "image frozen or late, or camera turned?"
