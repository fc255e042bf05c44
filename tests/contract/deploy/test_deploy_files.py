"""What is put on the Pi and the Pixhawk: the service, the parameters, the locks and the scripts, checked as files."""

from __future__ import annotations

import configparser
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
DEPLOY = ROOT / "deploy"
INT32, REAL32 = 6, 9
"""MAV_PARAM_TYPE, which QGroundControl's parameter files give in the last column."""
LOCKS = ["requirements.lock", "requirements-dev.lock", "deploy/raspberry-pi/simplejpeg.lock"]


def _parameters(name: str) -> dict[str, tuple[float, int]]:
    lines = (DEPLOY / "px4" / name).read_text().splitlines()
    rows = [line.split("\t") for line in lines if line and not line.startswith("#")]
    assert {len(row) for row in rows} == {5}
    assert {(row[0], row[1]) for row in rows} == {("1", "1")}
    return {row[2]: (float(row[3]), int(row[4])) for row in rows}


def test_px4_parameters_stop_the_vehicle_when_setpoints_stop_and_let_the_pilot_take_over():
    parameters = _parameters("alight.params")
    wanted = {
        "COM_OF_LOSS_T": (0.5, REAL32),
        "COM_OBL_RC_ACT": (5.0, INT32),
        "COM_RC_OVERRIDE": (3.0, INT32),
        "MAV_1_CONFIG": (102.0, INT32),
        "MAV_1_MODE": (2.0, INT32),
        "MAV_1_FORWARD": (1.0, INT32),
        "SER_TEL2_BAUD": (921600.0, INT32),
    }
    assert {key: parameters.get(key) for key in wanted} == wanted


def test_px4_land_detector_is_loosened_in_the_file_for_moving_pads_only():
    assert [key for key in _parameters("alight.params") if key.startswith("LNDMC")] == []
    assert _parameters("alight-moving-pad.params")["LNDMC_XY_VEL_MAX"] == (10.0, REAL32)


@pytest.mark.parametrize("name", ["alight.params", "alight-moving-pad.params"])
def test_px4_parameter_names_fit_and_whole_numbers_are_whole(name):
    for key, (value, kind) in _parameters(name).items():
        assert re.fullmatch(r"[A-Z0-9_]{1,16}", key)
        assert kind in (INT32, REAL32)
        assert kind == REAL32 or value.is_integer()


@pytest.fixture
def unit():
    parser = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    parser.optionxform = str
    parser.read_string((DEPLOY / "alight.service").read_text())
    return parser


def test_service_is_restarted_when_the_control_loop_stops_feeding_the_watchdog(unit):
    service = unit["Service"]
    assert (service["Type"], service["Restart"]) == ("notify", "on-failure")
    assert 0.5 < float(service["WatchdogSec"]) <= 2.0
    assert unit["Unit"]["StartLimitIntervalSec"] == "0"


def test_service_runs_the_rig_from_the_checkout_as_the_user(unit):
    service = unit["Service"]
    assert service["ExecStart"] == "@DIR@/.venv/bin/alight run --config @CONFIG@"
    assert (service["User"], service["WorkingDirectory"]) == ("@USER@", "@DIR@")
    assert service["ReadWritePaths"] == "-@RECORDS@"


def test_service_hides_no_device_of_the_camera_or_the_link(unit):
    # Each of these closes /dev to the service; ProtectClock does by adding a DeviceAllow.
    assert [
        key for key in ("PrivateDevices", "DevicePolicy", "DeviceAllow", "ProtectClock") if key in unit["Service"]
    ] == []


@pytest.fixture
def filled(tmp_path):
    """deploy/unit.sh in a checkout of its own, for a rig that records into a directory, as someone of /home/someone."""
    (tmp_path / "deploy").mkdir()
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for name in ("unit.sh", "alight.service"):
        shutil.copy(DEPLOY / name, tmp_path / "deploy")
    (tmp_path / ".venv/bin/python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (tmp_path / ".venv/bin/python").chmod(0o755)

    def fill(directory: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "rig.toml").write_text(
            f'pad = "{ROOT}/configs/pads/paper-38cm.toml"\n[recorder]\ndirectory = "{directory}"\n'
            f'[camera]\ndriver = "synthetic"\nlens = "{ROOT}/configs/cameras/pi-fisheye-640.toml"\n'
        )
        return subprocess.run(
            ["bash", tmp_path / "deploy/unit.sh", "rig.toml"],
            env=os.environ | {"HOME": "/home/someone", "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=60,
        )

    return fill


@pytest.mark.parametrize(
    ("directory", "writable"),
    [
        ("flights", "{checkout}/flights"),
        ("", "{checkout}/flights"),
        ("records/of-today", "{checkout}/records/of-today"),
        ("/srv/alight", "/srv/alight"),
        ("~/records", "/home/someone/records"),
    ],
)
def test_service_may_write_where_the_rig_records(filled, tmp_path, directory, writable):
    done = filled(directory)
    lines = [line for line in done.stdout.splitlines() if line.startswith("ReadWritePaths=")]
    assert lines == [f"ReadWritePaths=-{writable.format(checkout=tmp_path)}"], done.stderr
    assert re.search("@[A-Z]+@", done.stdout) is None


@pytest.mark.parametrize(
    ("directory", "words"),
    [
        ("/media/usb disk/flights", "/media/usb disk/flights: the service needs a path of letters"),
        ("/srv/%h", "/srv/%h: the service needs a path of letters"),
        ("/tmp/records", "/tmp/records: the service has temporary folders of its own"),
    ],
)
def test_service_that_could_not_record_there_is_refused(filled, directory, words):
    done = filled(directory)
    assert (done.returncode, done.stdout, words in done.stderr) == (2, "", True), done.stderr


def test_service_of_a_rig_with_a_fault_is_left_to_the_check(filled, tmp_path):
    done = filled('x"\ny = "')
    assert f"ReadWritePaths=-{tmp_path}/flights\n" in done.stdout, done.stderr


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd-analyze on this machine")
def test_service_file_is_accepted_by_systemd(tmp_path):
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/alight").write_text("#!/bin/sh\n")
    (tmp_path / ".venv/bin/alight").chmod(0o755)
    text = (DEPLOY / "alight.service").read_text()
    values = {"@USER@": "root", "@DIR@": str(tmp_path), "@CONFIG@": "configs/rig.toml", "@RECORDS@": "/srv/flights"}
    for name, value in values.items():
        text = text.replace(name, value)
    (tmp_path / "alight.service").write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", tmp_path / "alight.service"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, "alight.service" in done.stderr) == (0, False), done.stderr


@pytest.mark.parametrize("name", LOCKS)
def test_lock_pins_every_package_with_hashes_and_names_no_index(name):
    text = (ROOT / name).read_text()
    pins = re.findall(r"^(\S+)==(\S+) \\\n((?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)", text, re.MULTILINE)
    named = re.findall(r"^[a-z0-9][^\s=]*", text, re.MULTILINE)
    assert [pin[0] for pin in pins] == named
    assert re.search(r"://|--(extra-)?index-url|--find-links|--trusted-host", text) is None


def test_dev_lock_holds_the_same_versions_as_the_lock_of_what_flies():
    flies, dev = (set(re.findall(r"^(\S+==\S+) \\$", (ROOT / name).read_text(), re.MULTILINE)) for name in LOCKS[:2])
    assert flies - dev == set()


def test_lock_holds_every_dependency_that_the_project_names():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    asked = project["project"]["dependencies"] + project["build-system"]["requires"]
    asked_dev = asked + project["project"]["optional-dependencies"]["dev"]
    for names, lock in ((asked, LOCKS[0]), (asked_dev, LOCKS[1])):
        pinned = set(re.findall(r"^(\S+)==", (ROOT / lock).read_text(), re.MULTILINE))
        assert {re.split(r"[<>=!\[; ]", name)[0].lower() for name in names} - pinned == set()


@pytest.mark.parametrize("script", [*sorted(DEPLOY.glob("*.sh")), ROOT / ".ci/run"], ids=lambda path: path.name)
def test_script_is_executable_and_parses(script):
    assert script.stat().st_mode & 0o111
    done = subprocess.run(["bash", "-n", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
