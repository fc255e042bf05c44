"""A deck on the waves: roll, pitch and heave, each a sum of three sines about the period of the waves.

Three components of unlike periods give groups of high waves with calmer moments between them, as a sea has them. The
amplitudes add up to the configured ones, so those are never exceeded.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from app.config import PadMotionConfig

if TYPE_CHECKING:
    from drivers.simulator.pad import PadState

SHARES = (0.5, 0.3, 0.2)
"""Of the amplitude, of each component."""
PERIODS = (1.0, 0.78, 1.37)
"""Over the period of the waves."""
SPREAD = 0.1
"""Each period is drawn within this part of itself: no two decks move alike."""


@dataclass(frozen=True, slots=True)
class _Sines:
    """A sum of sines.

    Attributes:
        parts: Amplitude, angular frequency and phase of each.
    """

    parts: tuple[tuple[float, float, float], ...]

    def at(self, t_s: float) -> tuple[float, float]:
        """Value and rate at a time."""
        value = sum(a * math.sin(w * t_s + phase) for a, w, phase in self.parts)
        rate = sum(a * w * math.cos(w * t_s + phase) for a, w, phase in self.parts)
        return value, rate


class Waves:
    """Moves a level pad as the waves do.

    Args:
        config: Amplitudes and period.
        seed: Of periods and phases.
    """

    def __init__(self, config: PadMotionConfig, seed: int) -> None:
        source = random.Random(f"waves {seed}")

        def sines(amplitude: float) -> _Sines:
            return _Sines(
                tuple(
                    (
                        share * amplitude,
                        2.0 * math.pi / (config.wave_period_s * period * source.uniform(1.0 - SPREAD, 1.0 + SPREAD)),
                        source.uniform(0.0, 2.0 * math.pi),
                    )
                    for share, period in zip(SHARES, PERIODS, strict=True)
                )
            )

        self._roll, self._pitch = sines(math.radians(config.roll_deg)), sines(math.radians(config.pitch_deg))
        self._heave = sines(config.heave_m)

    def carry(self, level: PadState, t_s: float) -> PadState:
        """The pad, level as it would be, on the waves at a time."""
        roll, roll_rate = self._roll.at(t_s)
        pitch, pitch_rate = self._pitch.at(t_s)
        down, down_rate = self._heave.at(t_s)
        return replace(
            level,
            down_m=level.down_m + down,
            vel_down_m_s=down_rate,
            roll_rad=roll,
            pitch_rad=pitch,
            roll_rate_rad_s=roll_rate,
            pitch_rate_rad_s=pitch_rate,
        )
