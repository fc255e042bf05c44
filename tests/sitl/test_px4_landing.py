"""The application against a real PX4 SITL (SIH): `alight run`, ordered by `alight phone`, judged by PX4's truth.

PX4_SITL names the companion link of a running PX4 (udpin://127.0.0.1:14540 for instance 0).
"""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.wiring import CONFIGS

ADDRESS = os.environ.get("PX4_SITL", "")
TRUTH_PORT_FROM_LINK = 19410 - 14540
pytestmark = [
    pytest.mark.sitl,
    pytest.mark.timeout(240),
    pytest.mark.skipif(
        not ADDRESS.startswith("udpin://"),
        reason="no PX4: set PX4_SITL to the companion link of a running SITL, such as udpin://127.0.0.1:14540",
    ),
]


def _rig(name: str, folder: Path) -> tuple[Path, str]:
    """A shipped rig on the links of the PX4 that the environment names, and its operator address."""
    text = (CONFIGS / name).read_text(encoding="utf-8")
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        phone = f"udpin://127.0.0.1:{free.getsockname()[1]}"
    truth_port = int(ADDRESS.rpartition(":")[2]) + TRUTH_PORT_FROM_LINK
    text = re.sub(r'"(pads|cameras)/', rf'"{CONFIGS}/\1/', text)
    text = text.replace("udpin://127.0.0.1:14540", ADDRESS).replace("udpin://127.0.0.1:14590", phone)
    text = text.replace('vehicle = "px4"', f'vehicle = "px4"\npx4_truth_address = "udpin:127.0.0.1:{truth_port}"')
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path, phone


@pytest.mark.parametrize(("name", "error_m"), [("sitl.toml", 0.20), ("sitl-car.toml", 0.40)])
def test_px4_sitl_land_ordered_by_phone_touches_down_on_the_pad(tmp_path, name, error_m):
    rig, phone = _rig(name, tmp_path)
    out = tmp_path / "out"
    log = tmp_path / "alight.log"
    alight = [sys.executable, "-m", "app"]
    with (
        log.open("w") as words,
        subprocess.Popen([*alight, "run", "--config", rig, "--out", out, "--once"], stderr=words) as flying,
    ):
        try:
            order = _order([*alight, "phone", "land", "--address", phone])
            flying.wait(timeout=30)
        finally:
            if flying.poll() is None:
                flying.terminate()
    assert order.returncode == 0, order.stdout + order.stderr + log.read_text()
    (result,) = json.loads((out / "result.json").read_text(encoding="utf-8"))["experiments"]
    assert result["outcome"] == "landed", result
    assert result["touchdown_error_m"] < error_m


def _order(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Give the order again while Alight is starting, or PX4 is not ready to arm yet."""
    deadline_s = time.monotonic() + 60.0
    while True:
        order = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
        early = order.returncode == 2 or "temporarily_rejected" in order.stdout
        if not early or time.monotonic() > deadline_s:
            return order
