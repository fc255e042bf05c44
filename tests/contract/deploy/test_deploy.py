"""`make deploy` against a real sshd on loopback: the copy, the virtual environment from the lock, the preflight check.

The system's own parts (apt, groups, systemd) are left alone, as ALIGHT_NO_SYSTEM=1 says.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import uuid
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
DEPLOY = ROOT / "deploy"
REAL_PYTHON = str(Path(sys.base_prefix) / "bin" / f"python3.{sys.version_info[1]}")


def _deploy(host, folder, **settings) -> subprocess.CompletedProcess[str]:
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
    options = {"HOST": host.name, "PORT": str(host.port), "DIR": str(folder), **settings}
    return subprocess.run(
        ["make", "--no-print-directory", "deploy", *(f"{key}={value}" for key, value in options.items())],
        cwd=ROOT,
        env=clean | {"SSH_OPTS": host.options, "ALIGHT_NO_SYSTEM": "1", "PYTHON": REAL_PYTHON},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=240,
    )


@pytest.fixture(scope="session")
def deployed(host, tmp_path_factory):
    """A deployment over an older one that holds a rig file of its own, for an autopilot that isn't there."""
    folder = tmp_path_factory.mktemp("pi") / "alight"
    (folder / "configs").mkdir(parents=True)
    (folder / "pyproject.toml").write_text('[project]\nname = "alight"\n')
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        nowhere = f"udpin://127.0.0.1:{probe.getsockname()[1]}"
    (folder / "configs/my-rig.toml").write_text(
        f'pad = "pads/paper-38cm.toml"\n[camera]\ndriver = "synthetic"\nlens = "cameras/pi-fisheye-640.toml"\n'
        f'[autopilot]\naddress = "{nowhere}"\nconnect_timeout_s = 1.0\n[operator]\naddress = ""\n'
    )
    return folder, nowhere, _deploy(host, folder, CONFIG="configs/my-rig.toml")


def test_deploy_installs_a_command_that_runs(deployed):
    folder, _, done = deployed
    alight = subprocess.run([folder / ".venv/bin/alight", "--help"], cwd="/", capture_output=True, text=True)
    assert alight.returncode == 0, done.stdout + done.stderr
    assert "landmark" in alight.stdout


def test_deploy_installs_the_locked_versions(deployed):
    folder, *_ = deployed
    listed = subprocess.run(
        [folder / ".venv/bin/python", "-m", "pip", "--disable-pip-version-check", "freeze", "--all"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    locked = re.findall(r"^([a-z0-9-]+==\S+) \\$", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    assert set(locked) - {line.lower().replace("_", "-") for line in listed.splitlines()} == set()


def test_deploy_lets_the_environment_see_the_systems_picamera2(deployed):
    folder, *_ = deployed
    assert "include-system-site-packages = true" in (folder / ".venv/pyvenv.cfg").read_text()


def test_deploy_ends_with_the_preflight_check_and_fails_with_it(deployed):
    _, nowhere, done = deployed
    assert done.returncode == 2, done.stdout + done.stderr  # make's own code for a recipe that failed
    assert "Error 1" in done.stderr
    assert "installed, but the check found faults" in done.stdout
    assert nowhere in done.stdout


def test_deploy_says_what_it_left_out_and_which_version_it_brought(deployed):
    folder, _, done = deployed
    wanted = ("ALIGHT_NO_SYSTEM=1", "no Raspberry Pi", (folder / ".deployed").read_text().strip())
    assert [word for word in wanted if word not in done.stdout] == []


def test_deploy_copies_neither_history_nor_environment_nor_flights(deployed):
    folder, *_ = deployed
    assert not (folder / ".git").exists()
    assert str(folder) in (folder / ".venv/bin/pip").read_text()
    assert list((folder / "flights").iterdir()) == []


def test_deploy_again_keeps_what_was_added_on_the_pi_and_removes_what_is_stale(host, deployed):
    folder, *_ = deployed
    mark = uuid.uuid4().hex
    (folder / "flights/one.mcap").write_text(mark)
    (folder / "app/stale.py").write_text("")
    done = _deploy(host, folder, CONFIG="configs/my-rig.toml")
    assert "alight: making" not in done.stdout
    assert (folder / "configs/my-rig.toml").exists()
    assert (folder / "flights/one.mcap").read_text() == mark
    assert not (folder / "app/stale.py").exists()


def test_deploy_into_a_folder_that_holds_something_else_is_refused_and_deletes_nothing(host, tmp_path):
    (tmp_path / "thesis.txt").write_text("three years")
    done = _deploy(host, tmp_path)
    assert done.returncode == 2
    assert "holds something else" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"HOST": ""}, "make deploy HOST=user@pi"),
        ({"HOST": "-oProxyCommand=true"}, "is no host name"),
        ({"DIR": "a b"}, "DIR=a b: give a folder"),
        ({"PORT": "x"}, "PORT=x is no number"),
    ],
)
def test_deploy_with_settings_that_make_no_sense_is_refused(host, tmp_path, settings, words):
    done = _deploy(host, tmp_path / "alight", **settings)
    assert (done.returncode, words in done.stderr) == (2, True), done.stderr


def test_deploy_to_a_host_that_does_not_answer_says_so(host, tmp_path):
    done = _deploy(host, tmp_path / "alight", PORT="1")
    assert (done.returncode, "does not answer ssh on port 1" in done.stderr) == (2, True), done.stderr


def test_deploy_with_a_rig_file_that_is_not_there_names_those_that_are(host, deployed):
    folder, *_ = deployed
    done = _deploy(host, folder, CONFIG="configs/nothing.toml")
    assert "configs/nothing.toml: no such file" in done.stderr
    assert "configs/raspberry-pi.toml" in done.stderr
