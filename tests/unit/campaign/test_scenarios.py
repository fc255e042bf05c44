"""Scenario files: those that ship load; what is wrong with one is told in one line."""

from __future__ import annotations

import math

import pytest

from app.campaign.command import SCENARIOS
from app.campaign.draw import draw_trial
from app.campaign.scenario import read_scenario, scenario_path
from app.campaign.trial import load_course
from app.errors import ConfigError
from app.wiring_virtual import check_parameters

SHIPPED = (
    "static static-wind static-occlusion car-5 car-13.5 car-20 car-30 car-50 car-bend car-braking boat slow-camera "
    "late-camera dusk half-shadow no-gnss decoys"
).split()


@pytest.fixture
def scenario_file(tmp_path):
    """Writes a scenario."""

    def write(text: str):
        path = tmp_path / "mine.toml"
        path.write_text(f'summary = "mine"\n{text}', encoding="utf-8")
        return path

    return write


def drawn(name: str, seed: int = 1):
    course = load_course(SCENARIOS / f"{name}.toml", name)
    return draw_trial(course.scenario, course.rig.config, seed)


def test_shipped_scenarios_are_those_that_are_promised():
    assert {path.stem for path in SCENARIOS.glob("*.toml")} == set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenario_loads_and_draws_a_world(name):
    assert drawn(name).world.seed == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[wind]\nspeed_m_s = 99", "wind: speed_m_s = 99 must be within 0..20"),
        ("[wind]\nspeed_m_s = [3, 1]", "speed_m_s = [3, 1] must be within 0..20 and in order"),
        ("[wind]\nspeed_km_h = 3", "unknown key wind.speed_km_h = 3; did you mean speed_m_s"),
        ("[pad]\nspeed_km_h = 'fast'", "pad.speed_km_h = 'fast': must be a number, or [low, high]"),
        ("[pad]\nspeed_km_h = [1, 2, 3]", "pad.speed_km_h = [1, 2, 3]: must be a number, or [low, high]"),
        ("time_limit_s = 1", "time_limit_s = 1: Input should be greater than or equal to 10"),
        ("[override.guidance]\nspeed_max_m_s = 99", "override.guidance.speed_max_m_s = 99: Input should be less than"),
        ("[override.guidanze]\nspeed_max_m_s = 9", "unknown table [override.guidanze]"),
        ("[override.simulator]\nwind_m_s = 15", "override.simulator would change nothing; the world is drawn"),
        ("[override.mission]\nsearch_height_m = 9", "override.mission.search_height_m would change nothing"),
        ("[override.camera]\nframe_rate_hz = 5", "change nothing; it is drawn: say it as rate_hz in [camera]"),
        ("[override.camera]\nlens = 'x.toml'", "override.camera.lens would change nothing; name a rig that has it"),
    ],
)
def test_scenario_that_is_wrong_is_refused_in_one_line_that_names_file_key_and_limit(scenario_file, text, words):
    path = scenario_file(text)
    with pytest.raises(ConfigError) as refused:
        read_scenario(path)
    line = str(refused.value)
    assert words in line
    assert line.startswith(str(path))
    assert "\n" not in line


def test_scenario_with_an_unknown_px4_parameter_is_refused(scenario_file):
    path = scenario_file("[vehicle.parameters]\nMPC_XY_VEL_MXA = 20.0")
    with pytest.raises(ConfigError, match=r"vehicle\.parameters\.MPC_XY_VEL_MXA"):
        check_parameters(path, read_scenario(path).vehicle.parameters)


def test_scenario_that_nobody_knows_is_refused_with_those_that_ship():
    with pytest.raises(ConfigError, match=r"no scenario is called 'car-9'.*car-13\.5"):
        scenario_path("car-9", SCENARIOS)


def test_scenario_of_a_users_own_is_found_by_its_path(scenario_file):
    path = scenario_file("")
    assert scenario_path(str(path), SCENARIOS) == path


def test_draw_of_a_seed_is_the_same_each_time_and_another_for_another():
    assert drawn("static", 7) == drawn("static", 7)
    assert drawn("static", 7).world != drawn("static", 8).world


def test_draw_of_two_scenarios_differs_in_nothing_but_what_their_files_say():
    calm, windy = drawn("static", 5).world, drawn("static-wind", 5).world
    same = {"wind_m_s": calm.wind_m_s, "gust_m_s": calm.gust_m_s}
    assert windy.wind_m_s == 8.0
    assert windy.model_copy(update=same) == calm


@pytest.mark.parametrize("seed", range(1, 21))
def test_draw_stays_within_the_bounds_of_the_file(seed):
    plan = drawn("car-braking", seed)
    motion = plan.world.motion
    assert 3.5 <= math.hypot(motion.north_m, motion.east_m) <= 5.5
    assert motion.speed_m_s == pytest.approx(3.75)
    assert motion.brake_after_s is not None
    assert 4.0 <= motion.brake_after_s <= 10.0
    assert 1.0 <= plan.wait_s <= 2.0
    assert 3.5 <= plan.rig.mission.search_height_m <= 5.0


def test_draw_of_decoys_lays_each_beside_the_pad():
    decoys = drawn("decoys", 3).world.decoys
    assert 4 <= len(decoys) <= 6
    assert all(0.7 <= math.hypot(d.forward_m, d.right_m) <= 2.5 for d in decoys)
