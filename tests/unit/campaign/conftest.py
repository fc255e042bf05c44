"""Results of trials without flying them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from app.campaign.outcome import TrialResult


@pytest.fixture
def result() -> Callable[..., TrialResult]:
    """A landing 3 cm ahead of the pad's centre and 4 cm to its right, unless told otherwise."""

    def make(seed: int, reason: str | None = None, **more: object) -> TrialResult:
        fields: dict[str, object] = {
            "touchdown_error_m": 0.05,
            "touchdown_forward_m": 0.03,
            "touchdown_right_m": 0.04,
            "touchdown_speed_m_s": 0.6,
            "time_to_land_s": 20.0 if reason is None else None,
            "tries": 1,
            "simulated_s": 30.0,
            "wall_s": 10.0,
        }
        return TrialResult("static", seed, reason, **{**fields, **more})  # type: ignore[arg-type]  # a stand-in

    return make
