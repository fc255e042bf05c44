"""A record as arrays."""

import numpy as np
import pytest

from app.messages import OperatorText, Phase
from app.review.flight import collect_flight


def test_flight_of_an_empty_record_is_empty():
    flight = collect_flight([])
    assert flight.end_s == 0.0
    assert flight.window_s() == (0.0, 0.0)
    assert flight.time_in_state_s() == {}
    assert flight.spans_s() == []
    assert flight.vehicle_pos_ned_m.shape == flight.vehicle_vel_ned_m_s.shape == (0, 3)
    sizes = {a.shape for a in (flight.detected, flight.fix_height_m, flight.turn_period_s, flight.latency_s)}
    assert sizes == {(0,)}


def test_vehicle_of_a_record_becomes_rows_in_order(items, recorded):
    flight = collect_flight(recorded([items.vehicle(1.0, 2.0, -0.5), items.vehicle(1.5, 2.25, 0.25)]))
    np.testing.assert_array_equal(flight.vehicle_t_s, [1.0, 1.5])
    np.testing.assert_array_equal(flight.vehicle_pos_ned_m, [[0, 0, -2.0], [0, 0, -2.25]])
    np.testing.assert_array_equal(flight.vehicle_vel_ned_m_s, [[0, 0, -0.5], [0, 0, 0.25]])
    assert flight.end_s == 1.5


def test_vehicle_without_a_velocity_has_nan_for_it(items, recorded):
    topic, state = items.vehicle(1.0, sink_m_s=float("nan"))
    assert np.isnan(collect_flight(recorded([(topic, state)])).vehicle_vel_ned_m_s[0, 2])


def test_detections_of_a_record_tell_found_and_missed_and_their_milliseconds(items, recorded):
    square = [[0, 0], [9, 0], [9, 9], [0, 9]]
    flight = collect_flight(
        recorded([items.detection(1.0, 0, elapsed_s=0.002), items.detection(1.1, 1, square, elapsed_s=0.004)])
    )
    np.testing.assert_array_equal(flight.detected, [0, 1])
    np.testing.assert_allclose(flight.detection_ms, [2.0, 4.0])


def test_fixes_of_a_record_become_height_and_distance_over_ground(items, recorded):
    flight = collect_flight(recorded([items.fix(1.0, 3.0, -4.0, 2.5)]))
    np.testing.assert_array_equal(flight.fix_height_m, [2.5])
    np.testing.assert_array_equal(flight.fix_horizontal_m, [5.0])


def test_turns_of_a_record_give_periods_sent_or_not_and_a_latency_for_each_fix_used(items, recorded):
    turns = [
        items.turn(1.00, 0.0, sent=False),
        items.turn(1.02, 0.02, latency_s=0.061),
        items.turn(1.05, 0.03),
        items.turn(1.07, 0.02, latency_s=0.055),
    ]
    flight = collect_flight(recorded(turns))
    np.testing.assert_allclose(flight.turn_period_s, [0.0, 0.02, 0.03, 0.02])
    np.testing.assert_array_equal(flight.turn_sent, [0, 1, 1, 1])
    np.testing.assert_allclose(flight.latency_s, [0.061, 0.055])
    assert flight.contact_s is None


def test_contact_of_a_record_is_the_last_time_that_it_began(items, recorded):
    touching = [False, True, True, False, False, True, True]
    turns = [items.turn(10.0 + k, contact=contact) for k, contact in enumerate(touching)]
    assert collect_flight(recorded(turns)).contact_s == 15.0


def test_phases_of_a_record_are_its_changes_and_repeated_reports_none(items, recorded):
    reports = [items.report(t, Phase.SEARCH, "search: height reached") for t in (1.0, 1.05, 1.1)]
    other_reason = items.report(2.0, Phase.SEARCH, "search: pad lost")
    flight = collect_flight(recorded([*reports, other_reason]))
    assert flight.phases == [(1.0, "search", "search: height reached"), (2.0, "search", "search: pad lost")]


def test_texts_of_a_record_are_kept(recorded):
    flight = collect_flight(recorded([("texts", OperatorText("search: pad lost"))]))
    assert [text for _, text in flight.texts] == ["search: pad lost"]


def test_time_in_state_runs_to_the_next_phase_and_the_last_to_the_end_of_the_record(items, recorded):
    flight = collect_flight(recorded(items.landing()))
    assert flight.time_in_state_s() == pytest.approx(
        {"takeoff": 4.0, "search": 2.0, "hover": 1.0, "track": 4.0, "land": 4.0, "landed": 2.0}
    )


def test_time_in_state_of_a_phase_entered_twice_is_added(items, recorded):
    phases = [(0.0, Phase.SEARCH), (3.0, Phase.HOVER), (4.0, Phase.SEARCH), (6.5, Phase.HOLD)]
    flight = collect_flight(recorded([items.report(t, phase, "") for t, phase in phases]))
    assert flight.time_in_state_s() == pytest.approx({"search": 5.5, "hover": 1.0, "hold": 0.0})


@pytest.mark.parametrize(
    ("phases", "window"),
    [
        ([(98.0, Phase.IDLE)], (0.0, 120.0)),
        ([(98.0, Phase.IDLE), (100.0, Phase.TAKEOFF)], (100.0, 120.0)),
        ([(98.0, Phase.IDLE), (100.0, Phase.TAKEOFF), (115.0, Phase.LANDED)], (100.0, 115.0)),
        ([(100.0, Phase.TAKEOFF), (110.0, Phase.HOLD)], (100.0, 120.0)),
        ([(100.0, Phase.TRACK), (110.0, Phase.IDLE), (112.0, Phase.TRACK)], (100.0, 110.0)),
    ],
)
def test_window_is_from_the_first_phase_to_the_end_of_the_flying(items, recorded, phases, window):
    flight = collect_flight(recorded([*(items.report(t, p, "") for t, p in phases), items.vehicle(120.0)]))
    assert flight.window_s() == window
