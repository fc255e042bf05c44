"""Contact told apart from hovering: along time lines written by hand."""

from __future__ import annotations

import math

import numpy as np
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


@pytest.mark.parametrize("wander_m_s", [0.25, 0.35, -0.3])
def test_contact_outlasts_the_wandering_of_px4s_velocity_on_the_ground(wander_m_s):
    _, memory = run(lambda t: 0.6 if t < 2.0 else 0.0 if t < 3.0 else wander_m_s, seconds=6.0)
    assert memory.contact and memory.held_s(6.0) == pytest.approx(4.0, abs=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_contact_is_held_for_seven_seconds_under_the_noise_that_was_measured(seed):
    """0.15 m/s, correlated over a second, seen on PX4: the wait before a forced disarm on a pad at rest must end."""
    rng, noise = np.random.default_rng(seed), [0.0]
    for _ in range(1000):
        noise.append(0.98 * noise[-1] + rng.normal(0.0, 0.15 * math.sqrt(1.0 - 0.98**2)))
    _, memory = run(lambda t: (0.6 if t < 2.0 else 0.0) + noise[round(t / DT_S)], seconds=16.0)
    assert memory.held_s(16.0) >= 7.0


@pytest.mark.parametrize(("fall_s", "kept"), [(0.12, True), (0.2, False)])
def test_contact_outlasts_the_fall_from_two_feet_onto_four(fall_s, kept):
    _, memory = run(lambda t: 0.6 if t < 2.0 or 3.0 <= t < 3.0 + fall_s else 0.0, seconds=3.3)
    assert memory.contact is kept


def test_press_is_asked_for_a_tenth_of_a_second_after_the_sink_stops():
    memory = Contact(sinking_since_s=0.0, stopped_since_s=2.0)
    assert [memory.presses(t) for t in (2.05, 2.15)] == [False, True]
    assert not Contact(sinking_since_s=0.0).presses(9.0)


def test_contact_held_counts_from_the_standstill():
    _, memory = run(lambda t: 0.6 if t < 2.0 else 0.0, seconds=4.0)
    assert memory.held_s(4.0) == pytest.approx(2.0, abs=0.03)


def test_contact_with_a_rise_counts_too():
    first, _ = run(lambda t: 0.6 if t < 2.0 else -0.2, seconds=4.0)
    assert first == pytest.approx(2.35, abs=0.03)


@pytest.mark.parametrize(("sink_m_s", "told"), [(0.3, True), (0.5, False)])
def test_fall_onto_the_other_feet_does_not_end_a_press_and_sinking_on_does(sink_m_s, told):
    """At rest from 2 s on, pressed from 2.1 s on; then it sinks for 0.15 s. Contact is due at 2.35 s."""
    first, memory = run(lambda t: 0.6 if t < 2.0 else sink_m_s if 2.12 <= t < 2.27 else 0.0, seconds=2.4)
    assert (first == pytest.approx(2.35, abs=0.03)) is told
    assert memory.contact is told
