"""A process that flies the real driver at 50 Hz and logs 40 events each turn, for test_log_nobody_reads.

Usage: log_flooder.py PORT. SIGTERM ends it in order.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import time

import numpy as np

from app.config import AutopilotConfig
from app.log import configure_logging, get_logger, standard_error_in_background
from app.messages import Setpoint
from drivers.autopilot.px4_mavsdk import Px4Autopilot

LINES_A_TURN = 40


async def main(port: int) -> None:
    stopped = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stopped.set)
    config, log = AutopilotConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=10.0), get_logger("flooder")
    async with Px4Autopilot(config) as link:
        number = 0
        while not stopped.is_set():
            await link.send_setpoint(Setpoint(time.monotonic(), np.zeros(3), np.zeros(3), 0.0))
            for number in range(number, number + LINES_A_TURN):  # noqa: B020  # it goes on counting
                log.info("line.counted", number=number)
            number += 1
            await asyncio.sleep(0.02)


with standard_error_in_background():
    configure_logging()
    asyncio.run(main(int(sys.argv[1])))
