"""`alight run`: where its record goes, and what is left of a flight that failed."""

from __future__ import annotations

import asyncio
import io
import json
import socket
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.writer import Writer
from rich.console import Console

from app import service
from app.errors import AlightError, ConfigError
from app.flying import Ended, Flown
from app.service import record_directory, run_rig
from app.wiring import load_shipped_rig

NOTHING = {"outcome": "none", "reason": None}


@pytest.fixture
def console():
    return Console(file=io.StringIO())


@pytest.fixture
def rig(tmp_path):
    """A rig that records into a directory."""

    def make(directory):
        rig = load_shipped_rig("sitl.toml")
        recorder = rig.config.recorder.model_copy(update={"directory": directory})
        return replace(rig, config=rig.config.model_copy(update={"recorder": recorder}))

    return make


@pytest.fixture
def flown(monkeypatch):
    """Flights that leave an empty record and end as they are told: their plans."""
    plans = []

    def flying(end=Ended.OVER, records=True):
        async def fly(plan, console):
            plans.append(plan)
            if records and plan.record is not None:
                with plan.record.open("wb") as stream:
                    writer = Writer(stream)
                    writer.start()
                    writer.finish()
            if isinstance(end, Exception):
                raise end
            return Flown(end)

        monkeypatch.setattr(service, "fly", fly)
        return plans

    return flying


def test_run_records_into_a_new_folder_of_the_rigs_directory(flown, rig, console, tmp_path):
    plans = flown()
    run_rig(rig(str(tmp_path)), None, False, console)
    (plan,) = plans
    assert plan.folder is not None and plan.folder.parent == tmp_path
    assert {p.name for p in plan.folder.iterdir()} == {"flight.mcap", "result.json"}


def test_run_with_an_empty_directory_records_nothing(flown, rig, console, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plans = flown()
    run_rig(rig(""), None, False, console)
    assert [plan.folder for plan in plans] == [None]
    assert list(tmp_path.iterdir()) == []


def test_run_with_an_empty_directory_and_out_records_there(flown, rig, console, tmp_path):
    flown()
    run_rig(rig(""), tmp_path / "out", False, console)
    assert (tmp_path / "out" / "flight.mcap").exists()


def test_run_into_a_folder_with_an_earlier_flight_keeps_that(flown, rig, console, tmp_path):
    flown()
    run_rig(rig(""), tmp_path, False, console)
    (tmp_path / "result.json").write_text("the first")
    run_rig(rig(""), tmp_path, False, console)
    (earlier,) = tmp_path.glob("result-*.json")
    assert earlier.read_text() == "the first"
    assert len(list(tmp_path.glob("flight*.mcap"))) == 2
    assert json.loads((tmp_path / "result.json").read_text())["experiments"][0]["name"] == "sitl"


def test_run_that_fails_in_flight_writes_its_error_beside_the_record(flown, rig, console, tmp_path):
    flown(AlightError("the camera is gone", "plug it in"))
    with pytest.raises(AlightError, match="the camera is gone"):
        run_rig(rig(""), tmp_path / "out", False, console)
    (entry,) = json.loads((tmp_path / "out" / "result.json").read_text())["experiments"]
    assert (entry["outcome"], entry["reason"]) == ("failed", "the camera is gone; plug it in")


def test_run_that_does_not_get_as_far_as_a_record_leaves_no_folder(flown, rig, console, tmp_path):
    flown(AlightError("no autopilot", "start it"), records=False)
    with pytest.raises(AlightError, match="no autopilot"):
        run_rig(rig(""), tmp_path / "out", False, console)
    assert not (tmp_path / "out").exists()


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The user's home; the current directory is another one."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path / "home"


def test_run_records_into_a_directory_of_the_users_home(flown, rig, console, home):
    plans = flown()
    run_rig(rig("~/flights"), None, False, console)
    assert plans[0].folder.parent == home / "flights"
    assert list(Path.cwd().iterdir()) == []


def test_check_looks_at_a_directory_of_the_users_home(rig, home):
    home.mkdir()
    found = asyncio.run(service._check_record(rig("~/flights"), 0.5))
    assert found.startswith(f"{home}/flights: ")
    assert list(Path.cwd().iterdir()) == []


def test_directory_of_a_user_who_is_not_known_is_refused_by_name(rig):
    with pytest.raises(ConfigError, match=r"recorder.directory = '~nobody-here/flights': no such user's home"):
        record_directory(rig("~nobody-here/flights"))


@pytest.fixture
def heard(tmp_path, monkeypatch):
    """What systemd has heard so far."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))

        def words():
            found = []
            try:
                while True:
                    found.append(systemd.recv(200))
            except BlockingIOError:
                return found

        yield words


@pytest.mark.parametrize("end", [Ended.OVER, AlightError("the camera is gone", "plug it in")])
def test_run_asks_systemd_for_time_before_it_reads_the_record(flown, rig, console, tmp_path, monkeypatch, heard, end):
    before = []
    monkeypatch.setattr(service, "review", lambda plan, flown: (before.extend(heard()), ({}, NOTHING))[1])
    monkeypatch.setattr(service, "failed", lambda plan, error: (before.extend(heard()), NOTHING)[1])
    flown(end)
    with suppress(AlightError):
        run_rig(rig(""), tmp_path / "out", False, console)
    assert before == [b"EXTEND_TIMEOUT_USEC=120000000", b"STOPPING=1"]
