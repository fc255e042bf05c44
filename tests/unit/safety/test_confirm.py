"""A hazard that needs time to be believed."""

from __future__ import annotations

import pytest

from app.messages import Hazard, Verdict
from app.safety.monitors import Vigil, confirm


def _run(samples):
    vigil, said = Vigil(), []
    for now_s, hazard in samples:
        verdict = None if hazard is None else Verdict(hazard, "")
        vigil, told = confirm(vigil, verdict, now_s)
        said.append(told is not None)
    return said


def test_confirm_position_lost_for_one_report_is_not_told():
    assert _run([(0.0, None), (0.05, Hazard.POSITION_LOST), (0.1, None), (0.15, Hazard.POSITION_LOST)]) == [False] * 4


def test_confirm_position_lost_for_three_tenths_is_told():
    assert _run([(0.0, Hazard.POSITION_LOST), (0.2, Hazard.POSITION_LOST), (0.31, Hazard.POSITION_LOST)]) == [
        False,
        False,
        True,
    ]


@pytest.mark.parametrize("hazard", [Hazard.LINK_LOST, Hazard.VEHICLE_STATE_STALE, Hazard.FRAMES_STALE])
def test_confirm_what_is_an_age_already_is_told_at_once(hazard):
    assert _run([(0.0, hazard)]) == [True]


def test_confirm_another_hazard_starts_its_own_time():
    samples = [(0.0, Hazard.TILT_EXCESSIVE), (0.2, Hazard.TOO_FAR), (0.4, Hazard.TOO_FAR), (0.51, Hazard.TOO_FAR)]
    assert _run(samples) == [False, False, False, True]
