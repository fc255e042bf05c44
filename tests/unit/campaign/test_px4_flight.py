"""A scenario for a real PX4: what of it applies there, when the orders are given, and how the landing is judged."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from app.campaign import px4_flight
from app.campaign.command import SCENARIOS
from app.campaign.draw import draw_trial
from app.campaign.px4_flight import DrivesFor, in_px4s_world, judge, left_out, orders_of, refuse, words_of
from app.campaign.scenario import overridden, read_scenario
from app.config import WorldConfig
from app.errors import ConfigError
from app.flying import Ended, Flown
from app.messages import OperatorAction
from app.review.flight import Flight
from app.wiring import load_shipped_rig

OVER = Flown(Ended.OVER)
LANDED = Flight(phases=[(1.0, "land", "land: track steady"), (9.0, "landed", "landed: on the pad, disarmed")])
STATE = {"kind": "state", "t_s": 9.5, "pos_ned_m": [3.0, 0.0, -0.12], "vel_ned_m_s": [0.0, 0.0, 0.0], "armed": False}
TOUCH = {
    "kind": "touchdown", "t_s": 6.0, "on_deck": True, "error_m": 0.05, "forward_m": 0.03, "right_m": 0.04,
    "relative_speed_m_s": 0.1, "sink_m_s": 0.6, "tilt_rad": 0.0, "detail": "", "deck_tilt_rad": 0.0, "impact_m_s": 0.61,
}  # fmt: skip
REST = {**TOUCH, "kind": "rest", "t_s": 9.0, "on_deck": False, "error_m": 18.0, "impact_m_s": 0.0}
STATIC = read_scenario(SCENARIOS / "static.toml")


def drawn(name: str, seed: int = 3):
    path = SCENARIOS / f"{name}.toml"
    scenario = read_scenario(path)
    return scenario, draw_trial(scenario, overridden(path, scenario, load_shipped_rig("sitl.toml").config), seed)


@pytest.mark.parametrize(
    ("name", "words"), [("boat", "waves"), ("no-gnss", "vehicle.gnss = false")], ids=["waves", "gnss"]
)
def test_scenario_that_px4s_world_cannot_have_is_refused_with_what_can_fly_it(name, words):
    with pytest.raises(ConfigError, match=words) as refused:
        refuse(SCENARIOS / f"{name}.toml", drawn(name)[0])
    assert f"alight campaign --scenario {name}" in str(refused.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("static-wind", ["wind of 8.0 m/s"]),
        ("car-50", ["pad 1.", "vehicle.parameters: set them in PX4 yourself (MPC_XY_VEL_MAX 20)"]),
        ("static", []),
        ("decoys", []),
    ],
)
def test_scenario_says_what_is_px4s_own(name, words):
    scenario, trial = drawn(name)
    said = left_out(scenario, trial.world)
    assert len(said) == len(words)
    assert all(sentence.startswith(start) for sentence, start in zip(said, words, strict=True))


def test_drawn_world_lies_on_px4s_ground_and_keeps_everything_else():
    _, trial = drawn("car-13.5")
    ours = WorldConfig(vehicle="px4", px4_truth_address="udpin:127.0.0.1:19411")
    world = in_px4s_world(trial.world, ours)
    assert (world.vehicle, world.px4_truth_address) == ("px4", "udpin:127.0.0.1:19411")
    assert world.motion.height_m == 0.0
    flat = trial.world.motion.model_copy(update={"height_m": 0.0})
    same = {"vehicle": "built-in", "px4_truth_address": trial.world.px4_truth_address, "motion": flat}
    assert world.model_copy(update=same) == trial.world.model_copy(update={"motion": flat})


def test_pad_that_drives_is_followed_first_and_landed_on_at_its_speed(tmp_path):
    _, trial = drawn("car-13.5")
    truth = tmp_path / "truth.jsonl"
    track, land = orders_of(replace(trial, wait_s=2.0), truth)
    assert (track.action, land.action) == (OperatorAction.TRACK, OperatorAction.LAND)
    assert track.when()
    assert not land.when()
    speeds = [(0.0, 0.0), (1.0, 2.0), (2.0, 3.75), (3.9, 3.75)]
    with truth.open("w", encoding="utf-8") as log:
        log.write('{"kind": "start", "t_s": 0.0}\n')
        for t_s, speed in speeds:
            velocity = [speed * math.cos(0.7), speed * math.sin(0.7), 0.0]
            log.write(json.dumps({"kind": "state", "t_s": t_s, "pad_vel_ned_m_s": velocity}) + "\n")
        log.write('{"kind": "sta')  # the rest of the line is written later
        log.flush()
        assert not land.when()
        log.write('te", "t_s": 4.1, "pad_vel_ned_m_s": [0.0, 0.0, 0.0]}\n')
    assert land.when()


def test_pad_at_rest_is_landed_on_after_the_scenarios_wait(tmp_path, monkeypatch):
    now_s = [50.0]
    monkeypatch.setattr(px4_flight.time, "monotonic", lambda: now_s[0])
    _, trial = drawn("static")
    (land,) = orders_of(replace(trial, wait_s=1.5), tmp_path / "truth.jsonl")
    assert land.action is OperatorAction.LAND
    assert not land.when()
    now_s[0] = 51.6
    assert land.when()


def test_pad_whose_speed_is_not_reached_is_waited_for(tmp_path):
    truth = tmp_path / "truth.jsonl"
    truth.write_text('{"kind": "state", "t_s": 0.0, "pad_vel_ned_m_s": [3.0, 0.0, 0.0]}\n' * 3, encoding="utf-8")
    assert not DrivesFor(truth, 3.75, 0.0)()


def test_landing_on_a_pad_that_drove_on_is_judged_by_its_touchdown():
    assert judge(LANDED, [TOUCH, REST, STATE], OVER, STATIC, drives=True) is None


@pytest.mark.parametrize(
    ("flight", "truth", "flown", "words"),
    [
        pytest.param(LANDED, [TOUCH, REST, STATE], OVER, "left the pad", id="slid off a pad at rest"),
        pytest.param(
            LANDED,
            [{**TOUCH, "on_deck": False, "error_m": 0.9}, REST, STATE],
            OVER,
            "landed off the pad: 0.90",
            id="off",
        ),
        pytest.param(LANDED, [{**TOUCH, "impact_m_s": 1.2}, REST, STATE], OVER, "crash: touched down at", id="hard"),
        pytest.param(
            Flight(phases=[(1.0, "hold", "hold: tries used up: pad lost")]),
            [{**STATE, "armed": True}],
            OVER,
            "tries used up: pad lost",
            id="held",
        ),
        pytest.param(LANDED, [TOUCH, STATE], Flown(Ended.INTERRUPTED), "interrupted", id="interrupted"),
        pytest.param(
            Flight(phases=[(1.0, "land", "land: track steady")]),
            [{**STATE, "armed": True}],
            Flown(Ended.TIMED_OUT),
            "time out in land",
            id="time",
        ),
        pytest.param(Flight(), [], OVER, "not flown", id="nothing"),
    ],
)
def test_landing_that_fails_has_a_named_reason(flight, truth, flown, words):
    reason = judge(flight, truth, flown, STATIC, drives=False)
    assert reason is not None
    assert reason.startswith(words)


def test_words_give_the_figures_in_the_units_of_people():
    entry = {
        "scenario": "static", "seed": 4, "success": False, "failure": "left the pad", "folder": "flights/x",
        "touchdown_error_m": 0.051, "touchdown_speed_m_s": None, "touchdown_sink_m_s": 0.6,
    }  # fmt: skip
    first, second = words_of(entry).splitlines()
    assert first == "static, seed 4: failed: left the pad"
    assert second == ("touchdown 5.1 cm from the pad's centre, - relative to it, sink 0.60 m/s; written to flights/x")
