"""deploy/install.sh on a Pi that isn't one: the system's commands are stand-ins, and so are Python and Alight."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

DEPLOY = Path(__file__).parents[3] / "deploy"
COMMANDS = {
    "id": 'case $1 in -un) echo pilot;; -nG) echo "$GROUPS_OF_SESSION";; *) echo 1000;; esac',
    "getent": "exit 0",
    "grep": 'case "$*" in *"Raspberry Pi"*) exit 0;; esac; exec /usr/bin/env PATH=/usr/bin:/bin grep "$@"',
    "sudo": '[ "$1" = -n ] && shift; exec "$@"',
    "setpriv": 'while [ "$1" != env ]; do echo "$1" >>"$TOLD"; shift; done; FRESH=1 exec "$@"',
    "usermod": 'echo "usermod $*" >>"$TOLD"',
    "apt-get": "exit 0",
    "systemctl": "exit 0",
    "install": "exit 0",
}


@pytest.fixture
def install(tmp_path):
    """Run it in a session with these groups; alight's check finds the devices only with fresh ones."""

    def script(name: str, text: str) -> None:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)

    for name, text in COMMANDS.items():
        script(f"bin/{name}", text)
    for name in ("deploy/venv.sh", "deploy/unit.sh", ".venv/bin/python"):
        script(name, "exit 0")
    needs = "dialout video render"
    script(".venv/bin/alight", f'[ "$FRESH" = 1 ] || [ "$GROUPS_OF_SESSION" = "{needs}" ] || {{ echo FAULT; exit 2; }}')
    shutil.copy(DEPLOY / "install.sh", tmp_path / "deploy")
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs/rig.toml").write_text("")

    def run(groups: str) -> tuple[subprocess.CompletedProcess[str], list[str]]:
        told = tmp_path / "told"
        told.write_text("")
        stand_ins = {
            "PATH": f"{tmp_path}/bin:{os.environ['PATH']}",
            "TOLD": str(told),
            "GROUPS_OF_SESSION": groups,
            "CONFIG": "configs/rig.toml",
            "ALIGHT_NO_SYSTEM": "",
        }
        done = subprocess.run(
            ["bash", tmp_path / "deploy/install.sh"],
            env=os.environ | stand_ins,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
        )
        return done, told.read_text().splitlines()

    return run


def test_install_that_adds_the_user_to_groups_checks_with_them(install):
    done, told = install("pilot")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "FAULT" not in done.stdout
    assert told == [
        "usermod -aG dialout pilot",
        "usermod -aG video pilot",
        "usermod -aG render pilot",
        "--reuid",
        "1000",
        "--regid",
        "1000",
        "--init-groups",
    ]


def test_install_for_a_user_of_all_groups_checks_in_this_session(install):
    done, told = install("dialout video render")
    assert (done.returncode, told) == (0, []), done.stdout + done.stderr
