"""What a flight came to: hand-made records and truths, hand-worked entries of result.json."""

import json
import math

import pytest

from app.errors import RecorderError
from app.messages import Phase
from app.review.flight import Flight, collect_flight
from app.review.report import read_truth, summarise

SQUARE = [[0, 0], [9, 0], [9, 9], [0, 9]]
KEYS = {
    "name",
    "outcome",
    "reason",
    "seed",
    "touchdown_error_m",
    "touchdown_speed_m_s",
    "touchdown_sink_m_s",
    "rest_error_m",
    "time_in_state_s",
    "detection_rate",
    "detection_ms",
    "latency_s",
    "setpoint_period_s",
    "frames_seen",
}


def contact(kind, *, on_deck=True, error_m=0.05, speed_m_s=0.1, sink_m_s=0.5, detail=""):
    return {
        "kind": kind,
        "t_s": 114.0,
        "on_deck": on_deck,
        "error_m": error_m,
        "forward_m": error_m,
        "right_m": 0.0,
        "relative_speed_m_s": speed_m_s,
        "sink_m_s": sink_m_s,
        "tilt_rad": 0.0,
        "detail": detail,
    }


def start(vehicle="built-in"):
    return {"kind": "start", "t_s": 98.0, "seed": 7, "vehicle": vehicle}


@pytest.fixture
def landing(items, recorded):
    return collect_flight(recorded(items.landing()))


@pytest.fixture
def ending(items, recorded):
    """A flight that was searching, and ended in a phase."""

    def run(phase, reason):
        return collect_flight(
            recorded([items.report(1.0, Phase.SEARCH, "search: commanded"), items.report(5.0, phase, reason)])
        )

    return run


def test_landing_on_the_pad_is_landed_with_the_truth_of_its_touchdown(landing):
    truth = [start(), contact("touchdown", error_m=0.041, speed_m_s=0.08, sink_m_s=0.52), contact("rest", error_m=0.05)]
    entry = summarise("static", landing, truth)
    assert (entry["name"], entry["outcome"], entry["seed"]) == ("static", "landed", 7)
    assert entry["reason"] == "landed: on the pad, disarmed"
    assert entry["touchdown_error_m"] == 0.041
    assert entry["touchdown_speed_m_s"] == 0.08
    assert entry["touchdown_sink_m_s"] == 0.52
    assert entry["rest_error_m"] == 0.05


def test_touchdown_after_a_climb_away_is_the_one_that_counts(landing):
    truth = [start(), contact("touchdown", error_m=0.9), contact("touchdown", error_m=0.03), contact("rest")]
    assert summarise("static", landing, truth)["touchdown_error_m"] == 0.03


def test_landing_in_the_real_world_is_landed_and_its_errors_unknown(landing):
    entry = summarise("field", landing, [])
    assert entry["outcome"] == "landed"
    assert [entry[k] for k in ("seed", "touchdown_error_m", "touchdown_speed_m_s", "rest_error_m")] == [None] * 4


def test_landing_beside_the_pad_missed_it(landing):
    truth = [start(), contact("touchdown"), contact("rest", on_deck=False, error_m=1.234)]
    entry = summarise("car", landing, truth)
    assert (entry["outcome"], entry["reason"]) == ("missed the pad", "came down 1.23 m from its centre")


def test_landing_beside_the_pad_missed_it_even_if_the_log_ends_before_the_rest(landing):
    assert summarise("car", landing, [start(), contact("touchdown", on_deck=False)])["outcome"] == "missed the pad"


def test_px4_that_stands_still_while_its_pad_drives_on_landed_where_it_touched_down(landing):
    truth = [start("px4"), contact("touchdown", on_deck=True), contact("rest", on_deck=False, error_m=4.0)]
    assert summarise("sitl-car", landing, truth)["outcome"] == "landed"


def test_px4_that_touched_down_beside_the_pad_missed_it(landing):
    truth = [start("px4"), contact("touchdown", on_deck=False, error_m=2.0), contact("rest", on_deck=True)]
    assert summarise("sitl", landing, truth)["outcome"] == "missed the pad"


def test_crash_is_a_crash_whatever_the_mission_said(landing):
    truth = [start(), contact("touchdown"), contact("crash", detail="tipped over at 71 degrees")]
    entry = summarise("car", landing, truth)
    assert (entry["outcome"], entry["reason"]) == ("crashed", "tipped over at 71 degrees")


@pytest.mark.parametrize("ended", ["over", "interrupted", "timed out"])
@pytest.mark.parametrize(("phase", "reason"), [(Phase.HOLD, "hold: pad not found"), (Phase.IDLE, "idle: pilot flies")])
def test_mission_that_ended_in_rest_has_that_for_its_outcome(ending, phase, reason, ended):
    entry = summarise("static", ending(phase, reason), [start()], ended=ended)
    assert (entry["outcome"], entry["reason"]) == (phase.value, reason)


@pytest.mark.parametrize("ended", ["interrupted", "timed out"])
def test_flight_that_was_cut_short_says_so_and_what_it_was_about(ending, ended):
    entry = summarise("static", ending(Phase.TRACK, "track: settled over the pad"), [start()], ended=ended)
    assert (entry["outcome"], entry["reason"]) == (ended, "track: settled over the pad")


def test_landing_that_was_interrupted_after_its_end_is_landed(landing):
    assert summarise("static", landing, [start()], ended="interrupted")["outcome"] == "landed"


def test_flight_of_an_empty_record_was_not_flown_and_has_every_key():
    entry = summarise("static", Flight(), [], cpu_percent={"application": 1.0})
    assert set(entry) == KEYS | {"cpu_percent"}
    assert (entry["outcome"], entry["time_in_state_s"], entry["frames_seen"]) == ("not flown", {}, 0)
    assert entry["detection_rate"] is None
    assert entry["latency_s"] == {"p50": None, "p99": None}
    json.dumps(entry, allow_nan=False)


def test_time_in_state_is_told_for_each_phase(landing):
    expected = {"takeoff": 4.0, "search": 2.0, "hover": 1.0, "track": 4.0, "land": 4.0, "landed": 2.0}
    assert summarise("static", landing, [])["time_in_state_s"] == expected


def test_latency_percentiles_lie_between_its_values_by_rank(items, recorded):
    # 0, 1, ... 100 ms: the p-th percentile is p ms.
    turns = [items.turn(k / 50, latency_s=k / 1000) for k in range(101)]
    entry = summarise("static", collect_flight(recorded(turns)), [])
    assert entry["latency_s"] == pytest.approx({"p50": 0.050, "p99": 0.099})


def test_detection_percentiles_are_of_all_frames_in_milliseconds(items, recorded):
    seen = [items.detection(k / 30, k, elapsed_s=k / 10000) for k in range(101)]
    entry = summarise("static", collect_flight(recorded(seen)), [])
    assert entry["detection_ms"] == pytest.approx({"p50": 5.0, "p95": 9.5})
    assert entry["frames_seen"] == 101


def test_setpoint_period_is_of_the_turns_that_sent_while_it_flew(items, recorded):
    flying = [items.turn(100.0 + 0.02 * k, 0.02) for k in range(1, 100)]
    others = [
        items.turn(99.0, 5.0),  # before the mission
        items.turn(104.5, 7.0, sent=False),  # nothing to send
        items.turn(116.0, 9.0),  # after the landing
    ]
    flight = collect_flight(recorded([*items.landing(), *flying, *others]))
    assert summarise("static", flight, [])["setpoint_period_s"] == pytest.approx({"p50": 0.02, "p99": 0.02})


def test_detection_rate_counts_from_the_first_sight_to_the_touchdown(items, recorded):
    before = [items.detection(103.0 + 0.1 * k, k) for k in range(10)]
    found = [items.detection(105.0 + 0.1 * k, 10 + k, SQUARE) for k in range(3)]
    missed = [items.detection(105.3, 13)]
    blind_on_the_pad = [items.detection(114.0 + 0.1 * k, 20 + k) for k in range(5)]
    turns = [items.turn(113.0), items.turn(113.5, contact=True)]
    flight = collect_flight(recorded([*items.landing(), *before, *found, *missed, *blind_on_the_pad, *turns]))
    assert summarise("static", flight, [])["detection_rate"] == 0.75


def test_detection_rate_of_a_flight_that_never_saw_the_pad_is_unknown(items, recorded):
    flight = collect_flight(recorded([*items.landing(), items.detection(105.0, 1)]))
    assert summarise("static", flight, [])["detection_rate"] is None


def test_truth_is_read_up_to_a_line_that_was_cut_off(tmp_path):
    path = tmp_path / "truth.jsonl"
    path.write_text('{"kind": "start", "seed": 3}\n{"kind": "rest", "err', encoding="utf-8")
    assert read_truth(path) == [{"kind": "start", "seed": 3}]


def test_truth_that_is_missing_is_an_error_that_names_it(tmp_path):
    with pytest.raises(RecorderError, match=r"none\.jsonl: can't be read"):
        read_truth(tmp_path / "none.jsonl")


def test_figures_that_are_not_numbers_reach_no_result(items, recorded):
    flight = collect_flight(
        recorded([items.vehicle(1.0, math.nan, math.nan), items.report(1.0, Phase.IDLE, "started")])
    )
    json.dumps(summarise("static", flight, []), allow_nan=False)
