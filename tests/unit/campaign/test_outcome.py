"""What counts as a landing, by hand-made contacts."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from app.campaign.outcome import Ending, failure_of
from app.messages import Phase
from app.wiring_virtual import Contact

TOUCH = Contact("touchdown", 20.0, True, 0.05, 0.03, 0.04, 0.1, 0.6, 0.02, impact_m_s=0.62)
REST = Contact("rest", 22.0, True, 0.06, 0.04, 0.04, 0.0, 0.0, 0.02)
CRASH = Contact("crash", 21.0, False, 0.9, 0.9, 0.0, 1.0, 4.0, 1.5, "tipped over")
LANDED = Ending((TOUCH, REST), Phase.LANDED, "landed: on the pad, disarmed", False, False, 0.0, 0.1)


def test_landing_on_the_pad_is_a_success():
    assert failure_of(LANDED, 90.0) is None


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        pytest.param(replace(LANDED, contacts=(TOUCH, CRASH)), "crash: tipped over", id="crash"),
        pytest.param(
            replace(LANDED, contacts=(replace(TOUCH, impact_m_s=1.01), REST)), "crash: touched down at 1.01", id="hard"
        ),
        pytest.param(
            replace(LANDED, contacts=(replace(TOUCH, on_deck=False, error_m=1.2), REST)),
            "landed off the pad: 1.20 m",
            id="beside",
        ),
        pytest.param(
            replace(LANDED, contacts=(TOUCH, replace(REST, on_deck=False))),
            "left the pad after touchdown",
            id="slid off",
        ),
        pytest.param(
            replace(LANDED, contacts=(replace(TOUCH, deck_tilt_rad=math.radians(5.5)), REST)),
            "deck tilted 5.5 deg at contact, over 5",
            id="leaning deck",
        ),
        pytest.param(
            Ending((), Phase.HOLD, "hold: tries used up: pad lost", True, False, 0.1, 4.0),
            "tries used up: pad lost",
            id="safe end",
        ),
        pytest.param(Ending((), Phase.HOLD, "hold: safety", True, False, 6.0, 4.0), "fly-away: 6.0 m/s", id="fly-away"),
        pytest.param(Ending((), Phase.LAND, "land: track steady", True, True, 0.1, 2.0), "time out in land", id="time"),
    ],
)
def test_landing_that_fails_has_a_named_reason(ending, words):
    reason = failure_of(ending, 5.0)
    assert reason is not None
    assert reason.startswith(words)
