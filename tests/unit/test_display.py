"""What a person sees while it flies: a line for each change, a line that changes in place, or nothing to write to."""

from __future__ import annotations

import io
import threading

import numpy as np
import pytest
from rich.console import Console

from app.channels import Topic
from app.display import Display, Watched, open_console
from app.messages import Detection, GoalKind, GuidanceStatus, MissionReport, Phase, VehicleState


class Seen:
    """The topics that a display watches."""

    def __init__(self) -> None:
        names = ("vehicle", "detections", "tracks", "statuses", "reports", "texts")
        self.topics = {name: Topic(name) for name in names}
        self.watched = Watched(**{name: topic.subscribe() for name, topic in self.topics.items()})

    def report(self, phase: Phase, reason: str) -> None:
        self.topics["reports"].publish(MissionReport(0.0, phase, GoalKind.NONE, reason, 0, None))

    def height(self, height_m: float) -> None:
        down = np.array([0.0, 0.0, -height_m])
        self.topics["vehicle"].publish(VehicleState(0.0, down, np.zeros(3), np.array([1.0, 0, 0, 0])))

    def over_pad(self, t_s: float, height_m: float | None, distance_m: float | None) -> None:
        status = GuidanceStatus(t_s, height_above_pad_m=height_m, horizontal_error_m=distance_m)
        self.topics["statuses"].publish(status)


@pytest.fixture
def seen():
    return Seen()


@pytest.fixture
def plain():
    return Console(file=io.StringIO(), force_terminal=False, width=200)


def lines(console):
    return console.file.getvalue().splitlines()


def test_display_off_a_terminal_has_a_line_for_each_change_and_none_between(seen, plain):
    with Display("car", seen.watched, plain) as display:
        display.refresh(0.0)
        seen.report(Phase.SEARCH, "search: height reached")
        for k in range(5):
            display.refresh(0.25 * k)
        seen.report(Phase.HOVER, "hover: pad found")
        display.refresh(2.0)
    assert [line.split("(")[0].strip() for line in lines(plain)] == [
        "car: starting",
        "car: search: height reached",
        "car: hover: pad found",
    ]


def test_display_that_tells_nothing_leaves_it_to_the_log(seen, plain):
    seen.report(Phase.SEARCH, "search: height reached")
    with Display("car", seen.watched, plain, tells=False) as display:
        display.refresh(0.0)
    assert lines(plain) == []


def test_display_shows_height_and_distance_to_the_pad_while_guidance_knows_them(seen, plain):
    seen.height(7.0)
    seen.over_pad(10.0, 2.5, 0.125)
    with Display("car", seen.watched, plain) as display:
        display.refresh(10.5)
    assert "2.50 m over pad" in lines(plain)[0]
    assert "0.12 m off" in lines(plain)[0]


@pytest.mark.parametrize("status", [(10.0, 2.5, 0.1), (12.0, None, None)])
def test_display_without_a_fresh_pad_shows_the_height_over_home(seen, plain, status):
    seen.height(7.0)
    seen.over_pad(*status)
    with Display("car", seen.watched, plain) as display:
        display.refresh(12.0)
    assert "7.00 m over home" in lines(plain)[0]
    assert "- m off" in lines(plain)[0]


def test_display_shows_the_frame_rate_of_the_last_two_seconds(seen, plain):
    with Display("car", seen.watched, plain, tells=False) as display:
        for k in range(17):
            seen.topics["detections"].publish(Detection(0.25 * k, 5 * k))  # 5 frames each quarter of a second
            display.refresh(0.25 * k)
    with Display("car", seen.watched, plain) as fresh:
        fresh.refresh(4.0)
    assert " 0.0 frames/s" in lines(plain)[0]
    assert display._figures(4.0).endswith("20.0 frames/s")


def test_display_on_a_terminal_changes_in_place_and_leaves_a_line_for_each_change(seen):
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    with Display("car", seen.watched, console) as display:
        display.refresh(0.0)
        seen.report(Phase.SEARCH, "search: height reached")
        display.refresh(0.25)
        display.refresh(0.5)
    text = console.file.getvalue()
    assert text.count("  car: search: height reached\n") + text.count("  car: search: height reached\r\n") == 1
    assert "\x1b[" in text


class Broken(io.StringIO):
    """A terminal that hung up."""

    def write(self, text):
        raise BrokenPipeError(32, "Broken pipe")

    def isatty(self):
        return True


@pytest.mark.parametrize("plain", [True, False])
def test_display_that_nobody_can_see_any_more_ends_nothing(seen, plain):
    with Display("car", seen.watched, open_console(Broken(), plain=plain)) as display:
        display.refresh(0.0)
        seen.report(Phase.SEARCH, "search: height reached")
        display.refresh(0.25)


class Stuck(io.StringIO):
    """A terminal that is paused (Ctrl-S) until it is let go on."""

    def __init__(self):
        super().__init__()
        self.goes_on = threading.Event()

    def write(self, text):
        assert self.goes_on.wait(30.0)
        return super().write(text)


@pytest.mark.parametrize("terminal", [True, False])
def test_display_on_a_terminal_that_is_paused_holds_nobody_up_and_goes_on_with_what_is_newest(seen, terminal):
    below = Stuck()
    console = Console(file=below, force_terminal=terminal, width=200)
    with Display("car", seen.watched, console) as display:
        seen.report(Phase.SEARCH, "search: height reached")
        for k in range(400):
            seen.height(k / 100.0)
            display.refresh(0.25 * k)
        below.goes_on.set()
    assert console.file is below
    assert below.getvalue().count("search: height reached") <= 2  # figures of long ago are left out
