"""What a campaign's trials come to: shares with their interval, percentiles. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from app.campaign.outcome import TrialResult

Z95 = 1.959963984540054
"""Of the normal distribution: 95% lie within so many deviations."""


def wilson95(successes: int, trials: int) -> tuple[float, float]:
    """The 95% interval of a share (Wilson 1927): right at 0 and 100% too, where the naive one has no width."""
    if trials == 0:
        return 0.0, 1.0
    share, z2 = successes / trials, Z95 * Z95
    middle = share + z2 / (2.0 * trials)
    half = Z95 * math.sqrt(share * (1.0 - share) / trials + z2 / (4.0 * trials * trials))
    scale = 1.0 + z2 / trials
    low = 0.0 if successes == 0 else (middle - half) / scale
    high = 1.0 if successes == trials else (middle + half) / scale
    return low, high


def percentile(values: Sequence[float], percent: float) -> float:
    """Of values that are not empty, straight between the two nearest ones (Hyndman and Fan's type 7)."""
    ordered = sorted(values)
    at = (len(ordered) - 1) * percent / 100.0
    low = math.floor(at)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (at - low) * (ordered[high] - ordered[low])


@dataclass(frozen=True, slots=True)
class Spread:
    """Half of the values lie below p50, and so on; None of no values."""

    p50: float | None
    p95: float | None
    max: float | None

    @classmethod
    def of(cls, values: Iterable[float | None]) -> Spread:
        """Of the values that there are."""
        known = [value for value in values if value is not None]
        if not known:
            return cls(None, None, None)
        return cls(percentile(known, 50.0), percentile(known, 95.0), max(known))

    def to_json(self) -> dict[str, float | None]:
        """For the file."""
        return {"p50": self.p50, "p95": self.p95, "max": self.max}


@dataclass(frozen=True, slots=True)
class ScenarioFigures:
    """What one scenario's trials came to.

    Attributes:
        name: Of the scenario.
        results: In the order of their seeds.
    """

    name: str
    results: tuple[TrialResult, ...]

    @property
    def successes(self) -> int:
        """Landings on the pad."""
        return sum(result.landed for result in self.results)

    @property
    def failures(self) -> tuple[TrialResult, ...]:
        """The others."""
        return tuple(result for result in self.results if not result.landed)

    @property
    def interval95(self) -> tuple[float, float]:
        """Of the share of successes."""
        return wilson95(self.successes, len(self.results))

    @property
    def touchdown_error_m(self) -> Spread:
        """Of all that touched anything, failures too."""
        return Spread.of(result.touchdown_error_m for result in self.results)

    @property
    def touchdown_speed_m_s(self) -> Spread:
        """Of all that touched anything, failures too."""
        return Spread.of(result.touchdown_speed_m_s for result in self.results)

    @property
    def time_to_land_s(self) -> Spread:
        """Of the successes."""
        return Spread.of(result.time_to_land_s for result in self.results)

    @property
    def tries(self) -> tuple[float, int]:
        """Mean and most."""
        counts = [result.tries for result in self.results]
        return (sum(counts) / len(counts), max(counts)) if counts else (0.0, 0)

    def to_json(self) -> dict[str, Any]:
        """For the file."""
        return {
            "name": self.name,
            "trials": len(self.results),
            "successes": self.successes,
            "interval95": list(self.interval95),
            "touchdown_error_m": self.touchdown_error_m.to_json(),
            "touchdown_speed_m_s": self.touchdown_speed_m_s.to_json(),
            "time_to_land_s": self.time_to_land_s.to_json(),
            "failures": [{"seed": result.seed, "reason": result.reason} for result in self.failures],
        }


@dataclass(frozen=True, slots=True)
class CampaignFigures:
    """What a campaign came to.

    Attributes:
        scenarios: In the order that they were asked for.
        wall_s: How long it took.
    """

    scenarios: tuple[ScenarioFigures, ...]
    wall_s: float

    @property
    def simulated_s(self) -> float:
        """Of all trials together."""
        return sum(result.simulated_s for scenario in self.scenarios for result in scenario.results)

    def to_json(self) -> dict[str, Any]:
        """For the file."""
        return {
            "scenarios": [scenario.to_json() for scenario in self.scenarios],
            "simulated_s": self.simulated_s,
            "wall_s": self.wall_s,
        }
