"""A hazard that needs time to be believed."""

from __future__ import annotations

import pytest

from app.messages import Hazard, Verdict
from app.safety.monitors import Debounce, debounce


def _run(samples):
    """Whether anything is told at each (time, hazards)."""
    memory, said = Debounce(), []
    for now_s, hazards in samples:
        memory, told = debounce(memory, tuple(Verdict(hazard, "") for hazard in hazards), now_s)
        said.append([verdict.hazard for verdict in told])
    return said


LOST, FAR, TILT, BATTERY = Hazard.POSITION_LOST, Hazard.TOO_FAR, Hazard.TILT_EXCESSIVE, Hazard.BATTERY_LOW


def test_debounce_position_lost_for_one_report_is_not_told():
    assert _run([(0.0, []), (0.05, [LOST]), (0.1, []), (0.15, [LOST])]) == [[]] * 4


def test_debounce_position_lost_for_three_tenths_is_told():
    assert _run([(0.0, [LOST]), (0.2, [LOST]), (0.31, [LOST])]) == [[], [], [LOST]]


@pytest.mark.parametrize("hazard", [Hazard.LINK_LOST, Hazard.VEHICLE_STATE_STALE, Hazard.FRAMES_STALE])
def test_debounce_what_is_an_age_already_is_told_at_once(hazard):
    assert _run([(0.0, [hazard])]) == [[hazard]]


def test_debounce_another_hazard_starts_its_own_time():
    assert _run([(0.0, [TILT]), (0.2, [FAR]), (0.4, [FAR]), (0.51, [FAR])]) == [[], [], [], [FAR]]


def test_debounce_a_flickering_tilt_does_not_keep_a_low_battery_from_being_told():
    """A battery that stays low, and a tilt that comes and goes each 0.2 s: the battery is told after its 2 s."""
    steps = [(0.05 * k, [TILT, BATTERY] if (k // 4) % 2 else [BATTERY]) for k in range(60)]
    told = _run(steps)
    assert not any(BATTERY in hazards for hazards in told[:40])
    assert all(BATTERY in hazards for hazards in told[41:])


def test_debounce_a_hazard_that_is_there_one_time_in_ten_is_never_told():
    assert not any(_run([(0.05 * k, [TILT] if k % 10 == 0 else []) for k in range(600)]))


def test_debounce_a_hazard_that_is_there_every_other_step_is_told():
    assert any(_run([(0.05 * k, [BATTERY] if k % 2 else []) for k in range(200)]))
