"""A short campaign as a person runs it, with frames rendered and detected; and the same trial again, alone."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import pytest

from app.campaign.command import SCENARIOS
from app.campaign.figures import CampaignFigures, ScenarioFigures
from app.campaign.trial import fly_trial, load_course
from app.log import configure_logging


def test_campaign_lands_and_its_trial_replays_to_the_last_digit(tmp_path):
    figures, page = tmp_path / "figures.json", tmp_path / "page.html"
    command = [sys.executable, "-m", "app", "campaign", "--scenario", "static", "--trials", "2", "--seed", "11"]
    command += ["--workers", "2", "--json", str(figures), "--html", str(page)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads(figures.read_text(encoding="utf-8"))
    (scenario,) = told["scenarios"]
    assert (scenario["trials"], scenario["successes"], scenario["failures"]) == (2, 2, [])
    assert scenario["touchdown_error_m"]["max"] < 0.15
    assert scenario["touchdown_speed_m_s"]["max"] < 1.0
    assert "<svg" in page.read_text(encoding="utf-8")

    configure_logging(quiet=True)
    again = fly_trial(load_course(SCENARIOS / "static.toml", "static"), 12)
    errors = scenario["touchdown_error_m"]
    # The median of two is their mean; taking it apart costs the last bit.
    assert again.touchdown_error_m in (errors["max"], pytest.approx(2 * errors["p50"] - errors["max"], rel=1e-14))
    alone = CampaignFigures((ScenarioFigures("static", (replace(again, wall_s=0.0),)),), 0.0)
    assert 0.0 < alone.simulated_s < told["simulated_s"]
