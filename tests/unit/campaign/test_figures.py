"""Intervals and percentiles against textbooks, and what is made of a campaign's results."""

from __future__ import annotations

import json
import re

import pytest

from app.campaign.figures import CampaignFigures, ScenarioFigures, Spread, percentile, wilson95
from app.campaign.page import page_of
from app.campaign.tables import replay_text


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        # Newcombe, "Two-sided confidence intervals for the single proportion" (1998), table I, method 3.
        pytest.param(81, 263, 0.2553, 0.3662, id="Newcombe 81/263"),
        pytest.param(15, 148, 0.0624, 0.1605, id="Newcombe 15/148"),
        pytest.param(0, 20, 0.0, 0.1611, id="Newcombe 0/20"),
        pytest.param(1, 29, 0.0061, 0.1718, id="Newcombe 1/29"),
        # At all of n the lower end is n / (n + z^2).
        pytest.param(200, 200, 200 / 203.841459, 1.0, id="all of 200"),
    ],
)
def test_wilson_interval_is_that_of_the_textbook(successes, trials, low, high):
    assert wilson95(successes, trials) == (pytest.approx(low, abs=6e-5), pytest.approx(high, abs=6e-5))


def test_wilson_interval_of_no_trials_says_nothing():
    assert wilson95(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(("percent", "value"), [(0, 15.0), (40, 29.0), (50, 35.0), (100, 50.0)])
def test_percentile_lies_straight_between_the_two_nearest(percent, value):
    """Hyndman and Fan's type 7 on a worked example: 15, 20, 35, 40, 50."""
    assert percentile([50.0, 15.0, 40.0, 20.0, 35.0], percent) == pytest.approx(value)


def test_spread_of_nothing_is_nothing():
    assert Spread.of([None, None]).to_json() == {"p50": None, "p95": None, "max": None}


def test_json_has_the_keys_that_are_promised(result):
    results = (result(1), result(2, "tries used up: pad lost", touchdown_error_m=0.15))
    figures = CampaignFigures((ScenarioFigures("static", results),), 20.0)
    data = json.loads(json.dumps(figures.to_json()))
    assert set(data) == {"scenarios", "simulated_s", "wall_s"}
    assert (data["simulated_s"], data["wall_s"]) == (60.0, 20.0)
    (scenario,) = data["scenarios"]
    assert (scenario["name"], scenario["trials"], scenario["successes"]) == ("static", 2, 1)
    assert scenario["interval95"] == [pytest.approx(0.0945, abs=1e-4), pytest.approx(0.9055, abs=1e-4)]
    assert scenario["touchdown_error_m"] == {"p50": pytest.approx(0.10), "p95": pytest.approx(0.145), "max": 0.15}
    assert scenario["time_to_land_s"] == {"p50": 20.0, "p95": 20.0, "max": 20.0}
    assert scenario["failures"] == [{"seed": 2, "reason": "tries used up: pad lost"}]


def test_page_is_self_contained_and_shows_each_touchdown_and_failure(result):
    results = (result(1), result(2), result(3, "crash: <tipped> over"))
    page = page_of(
        CampaignFigures((ScenarioFigures("static", results),), 20.0), {"static": "static"}, "alight campaign"
    )
    assert re.findall(r"(?:src|href)=|https?://|@import", page) == []
    assert page.count('r="3"') == 3
    assert "crash: &lt;tipped&gt; over" in page
    assert replay_text("static", 3) in page
