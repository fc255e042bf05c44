"""A process that flies the real driver at 50 Hz and then hangs, for test_setpoint_lifetime.

Usage: setpoint_sender.py PORT none|sleep|gil. Each setpoint's north velocity is its turn's time.monotonic() modulo
1000. A process that hangs by itself writes the time of its last turn to standard error first.
"""

from __future__ import annotations

import asyncio
import ctypes
import sys
import time

import numpy as np

from app.config import AutopilotConfig
from app.log import configure_logging
from app.messages import Setpoint
from drivers.autopilot.px4_mavsdk import Px4Autopilot

HANG_S = 2.5


def hang(how: str) -> None:
    sys.stderr.write(f"last turn {time.monotonic()}\n")
    sys.stderr.flush()
    if how == "sleep":
        time.sleep(HANG_S)
    else:
        ctypes.PyDLL(None).usleep(int(HANG_S * 1e6))  # PyDLL keeps the GIL


async def main(port: int, how: str) -> None:
    config = AutopilotConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=10.0)
    async with Px4Autopilot(config) as link:
        turn = 0
        while True:
            turn += 1
            now_s = time.monotonic()
            await link.send_setpoint(Setpoint(now_s, np.array([now_s % 1000.0, 0.0, 0.0]), np.zeros(3), 0.0))
            if turn == 60 and how != "none":
                hang(how)
            await asyncio.sleep(0.02)


configure_logging(verbose=True)
asyncio.run(main(int(sys.argv[1]), sys.argv[2]))
