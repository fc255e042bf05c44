"""Contact told apart from hovering: along time lines written by hand."""

from __future__ import annotations

import math

import pytest

from app.guidance.touchdown import Contact, step_contact

DT_S = 0.02


def run(actual, *, seconds: float, commanded: float = 0.6) -> tuple[float | None, Contact]:
    """When contact is first told, and the memory at the end; `actual` is the sink speed by time."""
    memory, first = Contact(), None
    for k in range(round(seconds / DT_S) + 1):
        memory = step_contact(memory, commanded, actual(k * DT_S), k * DT_S)
        first = k * DT_S if first is None and memory.contact else first
    return first, memory


def test_contact_is_told_a_third_of_a_second_after_the_sink_stops():
    first, _ = run(lambda t: 0.6 if t < 2.0 else 0.0, seconds=4.0)
    assert first == pytest.approx(2.35, abs=0.03)


def test_contact_is_not_told_while_the_sink_builds_up_as_measured():
    """0.1 s dead time, 63% after 0.3 s: an exponential of 0.2 s."""
    first, _ = run(lambda t: 0.6 * (1 - math.exp(-max(0.0, t - 0.1) / 0.2)), seconds=5.0)
    assert first is None


def test_contact_is_not_told_for_a_vehicle_that_never_began_to_sink_before_it_had_time_to():
    first, _ = run(lambda t: 0.0, seconds=3.0)
    assert first == pytest.approx(0.85, abs=0.03)  # 0.5 s to begin, 0.35 s of standstill


def test_contact_is_not_told_for_a_gust_that_stops_the_sink_briefly():
    first, _ = run(lambda t: 0.0 if 2.0 <= t < 2.3 else 0.6, seconds=5.0)
    assert first is None


def test_contact_is_not_told_without_a_sink_command():
    first, _ = run(lambda t: 0.0, seconds=5.0, commanded=0.2)
    assert first is None


def test_contact_ends_when_the_vehicle_falls_on():
    first, memory = run(lambda t: 0.0 if 2.0 <= t < 3.0 else 0.6, seconds=3.5)
    assert first is not None and not memory.contact and memory.held_s(3.5) == 0.0


def test_contact_held_counts_from_the_standstill():
    _, memory = run(lambda t: 0.6 if t < 2.0 else 0.0, seconds=4.0)
    assert memory.held_s(4.0) == pytest.approx(2.0, abs=0.03)


def test_contact_with_a_rise_counts_too():
    first, _ = run(lambda t: 0.6 if t < 2.0 else -0.2, seconds=4.0)
    assert first == pytest.approx(2.35, abs=0.03)
