"""What `make deploy` does to what is on the Pi already: a small project is pushed to an sshd on loopback, where nothing
is installed: a stand-in is in place of deploy/install.sh.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
FILES = ["LICENSE", "Makefile", "README.md", "CHANGELOG.md", "requirements.lock", "requirements-dev.lock"]
FOLDERS = ["app", "configs/scenarios", "deploy", "docs", "drivers", "tests", ".ci"]
MADE_ON_THE_PI = [
    "test1/flight.mcap",
    "test1/result.json",
    "flights/2026-01-01T00-00-00Z/flight.mcap",
    "calibration/lens.toml",
    "mine.toml",
    "pad.toml",
    "board.mp4",
    "configs/mine.toml",
    "configs/cameras/mine.toml",
    ".venv/bin/python",
]


def _write(folder: Path, name: str, text: str) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def _kept(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.before-*"))


@pytest.fixture
def desk(tmp_path):
    """A project as push.sh knows it, with one line in each file."""
    desk = tmp_path / "desk"
    for name in FILES:
        _write(desk, name, "desk\n")
    for name in FOLDERS:
        _write(desk, f"{name}/file.toml", "desk\n")
    _write(desk, "pyproject.toml", '[project]\nname = "alight"\n')
    shutil.copy(ROOT / ".gitignore", desk)
    shutil.copy(ROOT / "deploy/push.sh", desk / "deploy")
    _write(desk, "deploy/install.sh", "echo installing\n")
    return desk


@pytest.fixture
def pi(tmp_path):
    """An older deployment."""
    pi = tmp_path / "pi"
    _write(pi, "pyproject.toml", '[project]\nname = "alight"\n')
    return pi


@pytest.fixture
def push(host, desk, pi):
    def run() -> str:
        settings = {"HOST": host.name, "PORT": str(host.port), "DIR": str(pi), "SSH_OPTS": host.options}
        done = subprocess.run(
            ["bash", desk / "deploy/push.sh"],
            env=os.environ | settings | {"ALIGHT_NO_SYSTEM": "1"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.endswith("installing\n")
        return done.stdout

    return run


@pytest.mark.parametrize("name", MADE_ON_THE_PI)
def test_push_leaves_what_was_made_on_the_pi(push, pi, name):
    _write(pi, name, "made on the Pi")
    said = push()
    assert (pi / name).read_text() == "made on the Pi"
    assert (_kept(pi), "another" in said) == ([], False)


@pytest.mark.parametrize("folder", ["app", "deploy", "docs", "drivers", "tests"])
def test_push_removes_stale_code_and_keeps_no_copy_of_what_is_new(push, pi, folder):
    _write(pi, f"{folder}/gone/stale.py", "")
    _write(pi, f"{folder}/file.toml", "older")
    push()
    assert not (pi / folder / "gone").exists()
    assert (pi / folder / "file.toml").read_text() == "desk\n"
    assert _kept(pi) == []


@pytest.mark.parametrize("name", ["configs/file.toml", "configs/scenarios/file.toml"])
def test_push_over_a_config_that_was_edited_on_the_pi_keeps_that_beside_it_and_says_so(push, desk, pi, name):
    _write(desk, name, "desk\n")
    _write(pi, name, "edited\n")
    said = push()
    assert (pi / name).read_text() == "desk\n"
    (old,) = _kept(pi)
    assert (old.parent, old.name.startswith("file.toml.before-")) == ((pi / name).parent, True)
    assert old.read_text() == "edited\n"
    assert f"had another {name}; it is replaced, and kept there as {old.relative_to(pi)}" in said


def test_push_over_a_record_of_the_same_name_keeps_the_pis_beside_it(push, desk, pi):
    _write(desk, "test1/flight.mcap", "simulated")
    _write(pi, "test1/flight.mcap", "flown")
    said = push()
    (old,) = _kept(pi)
    assert old.read_text() == "flown"
    assert str(old.relative_to(pi)) in said


def test_push_of_the_same_configs_with_other_times_keeps_no_copies(push, desk, pi):
    push()
    os.utime(desk / "configs/scenarios/file.toml", (0, 0))
    said = push()
    assert (_kept(pi), "another" in said) == ([], False)


def test_push_twice_keeps_what_the_first_kept(push, desk, pi):
    _write(desk, "configs/file.toml", "desk\n")
    _write(pi, "configs/file.toml", "edited\n")
    push()
    said = push()
    assert [old.read_text() for old in _kept(pi)] == ["edited\n"]
    assert "another" not in said
