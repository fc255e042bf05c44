"""The offset between two clocks, against streams whose true offset, rate and delays are known."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.autopilot.boot_clock import BootClock

OFFSET_S = 1000.0


def error_after(
    seconds: float,
    *,
    slow: float = 0.0,
    delay_s: float = 0.0005,
    jitter_s: float = 0.004,
    busy_s: float = 0.0,
    rate_hz: float = 100.0,
) -> float:
    """Largest error of the estimate in the last second of a stream: the autopilot's clock runs slow by `slow`, every
    message is delayed by at least delay_s plus an exponential jitter, and the reader wakes only each busy_s."""
    rng = np.random.default_rng(5)
    clock = BootClock()
    errors = []
    for k in range(int(seconds * rate_hz)):
        true_s = OFFSET_S + k / rate_hz
        boot_s = (true_s - OFFSET_S) * (1.0 - slow)
        arrival_s = true_s + delay_s + rng.exponential(jitter_s)
        if busy_s:
            arrival_s = np.ceil(arrival_s / busy_s) * busy_s
        clock.observe(boot_s, float(arrival_s))
        if k / rate_hz > seconds - 1.0:
            errors.append(clock.to_ours_s(boot_s) - true_s)
    return float(np.abs(errors).max())


@pytest.mark.parametrize(
    ("named", "limit_s"),
    [
        ({}, 0.001),
        ({"slow": 50e-6}, 0.001),  # a crystal
        ({"slow": 0.008}, 0.002),  # a simulated PX4 on a busy machine
        ({"slow": -0.008}, 0.002),
        ({"jitter_s": 0.020}, 0.004),
        ({"busy_s": 0.033}, 0.004),  # read between frames of vision
    ],
)
def test_offset_of_a_jittering_drifting_stream_is_found_to_milliseconds(
    named: dict[str, float], limit_s: float
) -> None:
    assert error_after(12.0, **named) < limit_s


def test_offset_follows_the_quickest_message_not_the_mean() -> None:
    clock = BootClock()
    clock.observe(0.00, 50.30)
    clock.observe(0.01, 50.02)
    clock.observe(0.02, 50.50)
    assert clock.to_ours_s(0.02) == pytest.approx(50.03)


def test_offset_forgets_a_quick_message_that_left_the_window() -> None:
    clock = BootClock()
    clock.observe(0.0, 100.0)
    for k in range(1, 200):
        clock.observe(k * 0.01, 100.05 + k * 0.01)
    assert clock.to_ours_s(1.99) == pytest.approx(102.04, abs=1e-9)


def test_offset_is_unknown_before_the_first_message() -> None:
    clock = BootClock()
    assert clock.offset_s(0.0) is None
    assert clock.to_boot_s(123.0) == 0.0
    with pytest.raises(ValueError, match="not known"):
        clock.to_ours_s(0.0)


def test_restart_of_the_autopilot_begins_a_new_offset() -> None:
    clock = BootClock()
    clock.observe(500.0, 1500.0)
    assert clock.observe(2.0, 1510.0)
    assert clock.restarts == 1
    assert clock.to_ours_s(2.0) == pytest.approx(1510.0)


def test_message_a_little_out_of_order_is_no_restart() -> None:
    clock = BootClock()
    clock.observe(500.0, 1500.0)
    assert not clock.observe(499.98, 1500.001)
    assert clock.restarts == 0


def test_offset_after_a_long_gap_is_that_of_the_new_messages() -> None:
    clock = BootClock()
    clock.observe(10.0, 110.0)
    clock.observe(40.0, 140.5)
    assert clock.to_ours_s(40.0) == pytest.approx(140.5)


def test_offset_of_a_simulated_autopilot_that_stood_still_is_found_at_once() -> None:
    clock = BootClock()
    for k in range(500):
        clock.observe(k * 0.01, 100.0 + k * 0.01)
    clock.observe(5.0, 109.0)  # four seconds of ours, none of its
    assert clock.to_ours_s(5.0) == pytest.approx(109.0)
    assert clock.restarts == 0


def test_time_of_ours_on_the_autopilots_clock_is_the_inverse() -> None:
    clock = BootClock()
    clock.observe(10.0, 110.0)
    assert clock.to_boot_s(112.5) == pytest.approx(12.5)
