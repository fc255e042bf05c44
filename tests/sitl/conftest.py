"""A PX4 SITL with the SIH quadrotor, as the environment names it.

PX4_SITL is the companion link of one that runs, fresh and on the ground (udpin://127.0.0.1:14540 for instance 0), or
the path of a px4 binary in its build folder (.../build/px4_sitl_default/bin/px4): then each test starts its own, with
fresh parameters, on an instance whose ports are free, and ends it. Nothing else is taken: a wrong PX4_SITL is an error.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.wiring import CONFIGS

COMPANION, TRUTH, LOCAL = 14540, 19410, 14580
"""UDP ports of instance 0: where PX4 sends its companion link and SIH's truth, and where it listens for the first."""
INSTANCES = 10
"""PX4's start script gives companion ports of their own to so many."""
STEADY = {"PX4_PARAM_SIH_KDV": "0.3", "PX4_PARAM_EKF2_ACC_NOISE": "1.0", "PX4_PARAM_EKF2_GYR_NOISE": "0.1"}
"""SIH's drag is that of no quadrotor, and with its noise PX4's estimate wanders more than a real one's."""
END_S = 10.0
UNSET = "PX4_SITL is not set: give it the address of a running PX4 SITL, or the path of a px4 binary"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Without a PX4 the tests that want one are skipped, and say why."""
    if os.environ.get("PX4_SITL"):
        return
    for item in items:
        if item.get_closest_marker("sitl") is not None and Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=UNSET))


@dataclass(frozen=True)
class Sitl:
    """A PX4 that runs.

    Attributes:
        address: Its companion link.
        truth_address: Where its ground truth arrives.
    """

    address: str
    truth_address: str

    def rig(self, folder: Path, name: str = "sitl.toml") -> tuple[Path, str]:
        """A shipped rig on this PX4's links, in a folder; and its operator address."""
        with socket.socket(type=socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            phone = f"udpin://127.0.0.1:{free.getsockname()[1]}"
        text = (CONFIGS / name).read_text(encoding="utf-8")
        for shipped, own in (
            ('"pads/', f'"{CONFIGS}/pads/'),
            ('"cameras/', f'"{CONFIGS}/cameras/'),
            ("udpin://127.0.0.1:14540", self.address),
            ("udpin://127.0.0.1:14590", phone),
            ('vehicle = "px4"', f'vehicle = "px4"\npx4_truth_address = "{self.truth_address}"'),
        ):
            assert shipped in text, f"{name} has no {shipped}"
            text = text.replace(shipped, own)
        path = folder / name
        path.write_text(text, encoding="utf-8")
        return path, phone


@contextmanager
def px4_of(value: str, folder: Path) -> Iterator[Sitl]:
    """The PX4 that a value of PX4_SITL names; one that is started here lives in the folder, and no longer than this.

    Raises:
        ValueError: The value names none.
    """
    address = re.fullmatch(r"udpin://([^:/]+):(\d+)", value)
    if address is not None:
        yield Sitl(value, f"udpin:{address[1]}:{int(address[2]) - COMPANION + TRUTH}")
        return
    binary = Path(value)
    etc = binary.parent.parent / "etc"
    if "://" in value:
        raise ValueError(f"PX4_SITL={value}: not an address; write udpin://HOST:PORT")
    if not binary.is_file() or not os.access(binary, os.X_OK):
        raise ValueError(f"PX4_SITL={value}: no such program; give the path of a px4 binary, or udpin://HOST:PORT")
    script = etc / "init.d-posix" / "rcS"
    if not script.is_file():
        raise ValueError(f"PX4_SITL={value}: {script} is not there; give the px4 of a build folder")
    instance = next((k for k in range(INSTANCES) if _is_free(k)), None)
    if instance is None:
        raise ValueError(f"PX4_SITL={value}: the ports of all {INSTANCES} instances are taken; end those that run")
    words = folder / "px4.out"
    with words.open("wb") as out:
        process = subprocess.Popen(
            [binary.resolve(), "-d", "-i", str(instance), "-s", script, "-w", folder, etc],
            cwd=folder,
            env={**os.environ, "PX4_SIM_MODEL": "sihsim_quadx", "HEADLESS": "1", **STEADY},
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
        )
    try:
        yield Sitl(f"udpin://127.0.0.1:{COMPANION + instance}", f"udpin:127.0.0.1:{TRUTH + instance}")
        assert process.poll() is None, f"px4 ended by itself: {words.read_text(errors='replace')[-2000:]}"
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _is_free(instance: int) -> bool:
    """Nobody holds the ports of an instance."""
    for port in (COMPANION, TRUTH, LOCAL):
        with socket.socket(type=socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port + instance))
            except OSError:
                return False
    return True


@pytest.fixture
def sitl(tmp_path: Path) -> Iterator[Sitl]:
    """The PX4 that the environment names, for one test."""
    folder = tmp_path / "px4"
    folder.mkdir()
    with px4_of(os.environ["PX4_SITL"], folder) as running:
        yield running
    shutil.rmtree(folder, ignore_errors=True)  # its logs are large
