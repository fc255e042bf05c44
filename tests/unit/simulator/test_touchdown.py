"""Touchdowns told from the truth, and the log of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drivers.simulator.pad import PadState
from drivers.simulator.touchdown import Seen, TouchdownWatch
from drivers.simulator.truth_log import TruthLog
from drivers.simulator.world import Truth

PAD = PadState(10.0, 0.0, -1.6, 3.7, 0.0, 0.0, 0.6)


def seen(t_s: float, *, touching: bool = False, armed: bool = True, clearance_m: float = 1.0, **more: object) -> Seen:
    fields = {
        "pos": (10.1, -0.05, -1.72),
        "vel": (3.9, 0.0, 0.0 if touching else 0.6),
        "tilt_rad": 0.02,
        "on_deck": touching,
        "crashed": None,
    }
    return Seen(t_s=t_s, touching=touching, armed=armed, clearance_m=clearance_m, **{**fields, **more})


def test_touchdown_after_flight_tells_offset_speed_and_sink() -> None:
    watch = TouchdownWatch()
    for k in range(10):
        assert watch.step(seen(0.1 * k), PAD) == []
    (contact,) = watch.step(seen(1.0, touching=True, clearance_m=0.0), PAD)
    assert contact.kind == "touchdown"
    assert contact.forward_m == pytest.approx(0.1)
    assert contact.right_m == pytest.approx(-0.05)
    assert contact.error_m == pytest.approx(0.1118, abs=1e-4)
    assert contact.relative_speed_m_s == pytest.approx(0.2)
    assert contact.sink_m_s == pytest.approx(0.6)
    assert contact.on_deck


def test_touchdown_bounce_is_not_a_second_one() -> None:
    watch = TouchdownWatch()
    for k in range(10):
        watch.step(seen(0.1 * k), PAD)
    watch.step(seen(1.0, touching=True), PAD)
    for k in range(3):
        assert watch.step(seen(1.1 + 0.1 * k, clearance_m=0.02), PAD) == []
    assert watch.step(seen(1.5, touching=True), PAD) == []


def test_touchdown_after_a_new_flight_is_a_second_one() -> None:
    watch = TouchdownWatch()
    for start in (0.0, 10.0):
        for k in range(10):
            watch.step(seen(start + 0.1 * k), PAD)
        assert len(watch.step(seen(start + 1.0, touching=True), PAD)) == 1


def test_touchdown_on_the_ground_at_the_start_is_none() -> None:
    watch = TouchdownWatch()
    assert [watch.step(seen(0.1 * k, touching=True, clearance_m=0.0), PAD) for k in range(20)] == [[]] * 20


def test_rest_is_told_when_the_motors_stop_after_a_flight() -> None:
    watch = TouchdownWatch()
    for k in range(10):
        watch.step(seen(0.1 * k), PAD)
    watch.step(seen(1.0, touching=True), PAD)
    assert [c.kind for c in watch.step(seen(1.1, touching=True, armed=False), PAD)] == ["rest"]


def test_crash_is_told_once_with_its_cause() -> None:
    watch = TouchdownWatch()
    first = watch.step(seen(0.0, touching=True, crashed="tipped over"), PAD)
    assert [(c.kind, c.detail) for c in first] == [("crash", "tipped over")]
    assert watch.step(seen(0.1, touching=True, crashed="tipped over"), PAD) == []


def test_truth_log_writes_states_at_its_rate_and_each_contact_once(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"
    log = TruthLog(path)
    log.start(100.0, 7, "built-in")
    watch = TouchdownWatch()
    contacts = []
    truth = Truth(0.0, (1.0, 2.0, -3.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), PAD)
    for k in range(250):
        contacts += watch.step(seen(0.004 * k, touching=k > 200), PAD)
        log.state(100.0 + 0.004 * k, truth, armed=True)
        log.contacts(100.0, contacts)
    log.close(101.0, frames=30)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    kinds = [line["kind"] for line in lines]
    assert kinds.count("state") == 50
    assert kinds.count("touchdown") == 1
    assert (kinds[0], kinds[-1]) == ("start", "end")
    touchdown = next(line for line in lines if line["kind"] == "touchdown")
    assert touchdown["t_s"] == pytest.approx(100.0 + 0.004 * 201)
    state = next(line for line in lines if line["kind"] == "state")
    assert state["pad_pos_ned_m"] == [10.0, 0.0, -1.6]


def test_truth_log_without_a_path_writes_nothing() -> None:
    log = TruthLog(None)
    log.start(0.0, 1, "built-in")
    log.close(1.0)
