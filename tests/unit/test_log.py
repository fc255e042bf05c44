"""The log goes to standard error, as JSON where that is no terminal, and ends nothing when it can't be written."""

from __future__ import annotations

import io
import json
import sys
import threading

import pytest
import structlog

from app.log import configure_logging, get_logger, standard_error_in_background


@pytest.fixture(autouse=True)
def _unconfigured():
    yield
    structlog.reset_defaults()


class Full(io.StringIO):
    """A disk without room, behind standard error."""

    def write(self, text):
        raise OSError(28, "No space left on device")


def test_log_event_is_a_json_line_on_standard_error_with_part_and_level(capsys):
    configure_logging()
    get_logger("camera").info("camera.opened", rate_hz=30.0)
    out, err = capsys.readouterr()
    assert out == ""
    event = json.loads(err)
    assert {k: event[k] for k in ("event", "part", "level", "rate_hz")} == {
        "event": "camera.opened",
        "part": "camera",
        "level": "info",
        "rate_hz": 30.0,
    }
    assert event["timestamp"].endswith("Z")


@pytest.mark.parametrize(
    ("options", "shown"),
    [
        ({}, ["info", "error"]),
        ({"verbose": True}, ["debug", "info", "error"]),
        ({"quiet": True}, ["error"]),
    ],
)
def test_log_level_is_info_or_as_asked(capsys, options, shown):
    configure_logging(**options)
    log = get_logger("test")
    for level in ("debug", "info", "error"):
        getattr(log, level)("thing.happened")
    assert [json.loads(line)["level"] for line in capsys.readouterr().err.splitlines()] == shown


@pytest.mark.parametrize("broken", ["full", "closed"])
def test_log_that_cannot_be_written_raises_nothing(monkeypatch, broken):
    stream = Full() if broken == "full" else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    configure_logging()
    if broken == "closed":
        stream.close()
    get_logger("test").error("thing.happened")


def test_log_follows_standard_error_to_where_a_display_puts_it(monkeypatch):
    first, second = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stderr", first)
    configure_logging()
    log = get_logger("test")
    monkeypatch.setattr(sys, "stderr", second)
    log.info("thing.happened")
    assert first.getvalue() == ""
    assert json.loads(second.getvalue())["event"] == "thing.happened"


class Stuck(io.StringIO):
    """A terminal that is paused (Ctrl-S) until it is let go on."""

    def __init__(self):
        super().__init__()
        self.goes_on = threading.Event()

    def write(self, text):
        assert self.goes_on.wait(30.0)
        return super().write(text)


def test_log_in_background_is_written_in_order_by_the_end_and_standard_error_is_put_back(monkeypatch):
    monkeypatch.setattr(sys, "stderr", below := io.StringIO())
    with standard_error_in_background():
        configure_logging()
        for number in range(100):
            get_logger("test").info("thing.happened", number=number)
    assert sys.stderr is below
    assert [json.loads(line)["number"] for line in below.getvalue().splitlines()] == list(range(100))


def test_log_that_is_paused_holds_nobody_up_and_tells_how_many_lines_were_left_out(monkeypatch):
    monkeypatch.setattr(sys, "stderr", below := Stuck())
    with standard_error_in_background():
        configure_logging()
        log = get_logger("test")
        for _ in range(5000):
            log.info("thing.happened", words="x" * 100)
        below.goes_on.set()
    events = [json.loads(line) for line in below.getvalue().splitlines()]
    (note,) = [event for event in events if event["event"] == "log.lines_left_out"]
    assert note["level"] == "warning"
    assert note["lines"] == 5000 - (len(events) - 1)
