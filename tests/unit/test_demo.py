"""The demo's worlds, its table, and what it keeps of an earlier one."""

from __future__ import annotations

import io
import json

import pytest
from rich.console import Console

from app import demo
from app.debrief import write_result
from app.demo import EXPERIMENTS, drawings_of, run_demo, table_of, world_of
from app.errors import AlightError
from app.flying import Ended, Flown, Plan
from app.review.flight import Flight
from app.review.report import summarise
from app.wiring import load_shipped_rig


@pytest.fixture
def flown(monkeypatch):
    """Flights that are not flown: the plans that would have been, and how each ends."""

    class Flights:
        plans: list[Plan]
        ends: list[object]

    found = Flights()
    found.plans, found.ends = [], []

    async def fly(plan, console):
        found.plans.append(plan)
        end = found.ends.pop(0)
        if isinstance(end, Exception):
            raise end
        return Flown(end)

    monkeypatch.setattr(demo, "fly", fly)
    monkeypatch.setattr(
        demo, "review", lambda plan, end: (Flight(), summarise(plan.title, Flight(), [], cpu_percent={}))
    )
    monkeypatch.setattr(demo, "draw", lambda plan, flight: None)
    return found


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=120)


@pytest.fixture
def rig():
    return load_shipped_rig("simulator.toml")


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_world_of_a_seed_is_the_same_each_time_and_another_for_another(experiment):
    assert world_of(experiment, 3) == world_of(experiment, 3)
    assert world_of(experiment, 3) != world_of(experiment, 4)


@pytest.mark.parametrize("seed", range(20))
def test_car_drives_at_the_papers_speed_and_the_static_pad_lies_on_a_lawn(seed):
    car, static = world_of("car", seed), world_of("static", seed)
    assert car.motion.speed_m_s * 3.6 == pytest.approx(13.5)
    assert car.motion.height_m > 1.0
    assert (static.ground, static.motion.speed_m_s, static.motion.height_m) == ("lawn", 0.0, 0.0)
    assert car.seed == static.seed == seed


def test_demo_flies_each_experiment_with_a_phone_on_ports_of_its_own(flown, console, rig, tmp_path):
    flown.ends = [Ended.OVER, Ended.OVER]
    found = run_demo(rig, EXPERIMENTS, 5, tmp_path, console)
    assert [entry["name"] for entry in found["experiments"]] == ["static", "car"]
    static, car = flown.plans
    assert [plan.folder for plan in flown.plans] == [tmp_path / "static", tmp_path / "car"]
    assert static.rig.config.simulator == world_of("static", 5)
    assert car.rig.config.simulator == world_of("car", 5)
    addresses = {plan.rig.config.autopilot.address for plan in flown.plans}
    addresses |= {plan.rig.config.operator.address for plan in flown.plans}
    assert len(addresses) == 4
    assert all(plan.orders and plan.once for plan in flown.plans)


def test_demo_that_fails_writes_what_came_before_and_its_error(flown, console, rig, tmp_path):
    write_result(tmp_path, [{"name": "old"}])
    flown.ends = [Ended.OVER, AlightError("the simulator didn't start", "mend that")]
    with pytest.raises(AlightError, match="didn't start"):
        run_demo(rig, EXPERIMENTS, 1, tmp_path, console)
    static, car = json.loads((tmp_path / "result.json").read_text())["experiments"]
    assert (static["name"], static["outcome"]) == ("static", "not flown")
    assert (car["name"], car["outcome"], car["reason"]) == ("car", "failed", "the simulator didn't start; mend that")


def test_demo_that_was_interrupted_flies_nothing_more(flown, console, rig, tmp_path):
    flown.ends = [Ended.INTERRUPTED]
    with pytest.raises(KeyboardInterrupt):
        run_demo(rig, EXPERIMENTS, 1, tmp_path, console)
    assert len(flown.plans) == 1
    assert (tmp_path / "result.json").exists()


def test_demo_replaces_what_an_earlier_one_left_and_nothing_else(flown, console, rig, tmp_path):
    folder = tmp_path / "static"
    folder.mkdir()
    old = ["flight.mcap", "truth.jsonl", "static.mp4", "static-height.png"]
    for name in [*old, "notes.txt"]:
        (folder / name).touch()
    flown.ends = [AlightError("the simulator didn't start", "mend that")]
    with pytest.raises(AlightError):
        run_demo(rig, ("static",), 1, tmp_path, console)
    assert [p.name for p in folder.iterdir()] == ["notes.txt"]


def test_drawings_of_a_plan_without_a_folder_are_none():
    assert drawings_of(Plan("static", None, None)) == []  # type: ignore[arg-type]  # a stand-in


def test_table_has_a_column_for_each_experiment_in_the_units_of_people(console):
    entry = summarise("static", Flight(), [], cpu_percent={"application": 38.2})
    entry |= {"touchdown_error_m": 0.0412, "touchdown_speed_m_s": 0.084, "detection_rate": 0.99, "outcome": "landed"}
    entry |= {"latency_s": {"p50": 0.0594, "p99": 0.134}, "setpoint_period_s": {"p50": 0.02, "p99": 0.0302}}
    console.print(table_of([entry, summarise("car", Flight(), [], cpu_percent={})]))
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in console.file.getvalue().splitlines()]
    rows = {row[0]: row[1:] for row in rows if row}
    assert rows["outcome"] == ["landed", "not flown"]
    assert rows["touchdown error"] == ["4.1 cm", "-"]
    assert rows["speed relative to the pad"] == ["0.08 m/s", "-"]
    assert rows["frames with the landmark found"] == ["99.0 %", "-"]
    assert rows["exposure to setpoint, p50"] == ["59 ms", "-"]
    assert rows["exposure to setpoint, p99"] == ["134 ms", "-"]
    assert rows["setpoint period, p99"] == ["30.2 ms", "-"]
    assert rows["processor: application"] == ["38 %", "-"]
