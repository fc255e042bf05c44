"""The simulator's own process: `python -m drivers.simulator --config RIG --frames SOCKET ...`.

Real time. The vehicle and its MAVLink run in the main thread, the camera in others. One line of JSON on standard
output says that it is ready; SIGTERM, SIGINT or the end of standard input (with --watch-stdin) stops it.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import cv2

from app.config import CameraConfig, LensConfig, PadConfig, RigConfig, WorldConfig, read_config, resolve
from app.errors import AlightError, ConfigError
from app.log import configure_logging, get_logger, standard_error_in_background
from drivers.simulator.film import Film
from drivers.simulator.frame_server import FrameServer
from drivers.simulator.live import LiveWorld
from drivers.simulator.px4_truth import Px4Truth
from drivers.simulator.renderer import Renderer
from drivers.simulator.shutter import Shutter
from drivers.simulator.truth_log import TruthLog

SWITCH_INTERVAL_S = 0.0005
"""Python's turn between threads: the vehicle's thread waits no longer than this for the camera's."""
SLEEP_MAX_S = 0.004
_log = get_logger("simulator")


class Scene(Protocol):
    """The vehicle in real time, simulated here or elsewhere."""

    def sockets(self) -> list[Any]:
        """What to wait on."""
        ...

    def begin(self) -> None:
        """Time starts now."""
        ...

    def advance(self, film: Film) -> float:
        """Go on to the present; seconds until it wants to again."""
        ...

    def close(self) -> None:
        """Release the sockets."""
        ...


def _host_port(text: str) -> tuple[str, int]:
    match = re.fullmatch(r"(?:\w+:(?://)?)?([^:/]*):(\d{1,5})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no host:port")
    return match[1] if match[1] not in ("", "0.0.0.0") else "127.0.0.1", int(match[2])


def _arguments(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m drivers.simulator", description=__doc__)
    parser.add_argument("--config", type=Path, required=True, help="rig file")
    parser.add_argument("--world", help="[simulator] as JSON, in place of the rig's")
    parser.add_argument("--camera", help="[camera] as JSON, in place of the rig's")
    parser.add_argument("--seed", type=int, help="in place of the world's")
    parser.add_argument("--frames", type=Path, required=True, help="Unix socket to give frames on")
    parser.add_argument("--truth", type=Path, help="file for the truth, read after the flight")
    parser.add_argument("--companion", type=_host_port, help="host:port that MAVLink goes to; else the rig's")
    parser.add_argument("--local-port", type=int, default=0, help="where MAVLink listens; 0: any")
    parser.add_argument("--ground-station", type=_host_port, help="host:port of a second MAVLink link")
    parser.add_argument("--watch-stdin", action="store_true", help="stop when standard input ends")
    return parser.parse_args(argv)


def _world_of(rig: RigConfig, options: argparse.Namespace) -> WorldConfig:
    world = WorldConfig.model_validate_json(options.world) if options.world else rig.simulator
    if world is None:
        raise ConfigError(f"{options.config}: has no [simulator]", "add the table, or give --world")
    return world if options.seed is None else world.model_copy(update={"seed": options.seed})


def _scene(rig: RigConfig, world: WorldConfig, options: argparse.Namespace, log: TruthLog) -> Scene:
    if world.vehicle == "px4":
        return Px4Truth(world, rig.camera.frame_rate_hz, log)
    companion = options.companion or _host_port(rig.autopilot.address)
    return LiveWorld(world, companion, options.ground_station, options.local_port, rig.camera.frame_rate_hz, log)


def run(argv: list[str], say: Callable[[str], None], stop: threading.Event) -> None:
    """Simulate until told to stop.

    Args:
        argv: Options.
        say: Takes the line that says it is ready.
        stop: Ends it.

    Raises:
        AlightError: The configuration is wrong, or a port is taken.
    """
    options = _arguments(argv)
    rig = read_config(options.config, RigConfig)
    if options.camera:
        rig = rig.model_copy(update={"camera": CameraConfig.model_validate_json(options.camera)})
    lens = read_config(resolve(options.config, rig.camera.lens), LensConfig)
    landmark = read_config(resolve(options.config, rig.pad), PadConfig).landmark()
    world = _world_of(rig, options)
    renderer = Renderer(world, landmark, lens, rig.camera)
    log = TruthLog(options.truth)
    scene = _scene(rig, world, options, log)
    shutter = Shutter(world.exposure_delay_frames)
    server = FrameServer(options.frames, shutter.tell)
    film = Film(renderer, server, shutter, world.camera_latency_s, world.camera_clock_error_s)
    log.start(time.monotonic(), world.seed, world.vehicle)
    scene.begin()
    say(json.dumps({"ready": True, "frames": str(options.frames), "vehicle": world.vehicle}))
    try:
        while not stop.is_set():
            if film.failure is not None:
                raise film.failure
            wait_s = scene.advance(film)
            if wait_s > 0.0:
                select.select(scene.sockets(), [], [], min(wait_s, SLEEP_MAX_S))
    finally:
        film.close()
        server.close()
        scene.close()
        log.close(time.monotonic(), frames=film.drawn, frames_dropped=film.dropped, frame_late_max_s=film.late_s)


def _watch_stdin(stop: threading.Event) -> None:
    # Below Python's own buffer, whose lock a thread that waits would hold while the interpreter shuts down.
    while os.read(0, 4096):
        pass
    stop.set()


def main(argv: list[str] | None = None) -> int:
    """The process: its exit code. The vehicle does not wait for whoever reads its log."""
    with standard_error_in_background():
        return _main(argv)


def _main(argv: list[str] | None) -> int:
    arguments = sys.argv[1:] if argv is None else argv
    configure_logging()
    cv2.setNumThreads(1)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    if "--watch-stdin" in arguments:
        threading.Thread(target=_watch_stdin, args=(stop,), daemon=True).start()

    def say(line: str) -> None:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    try:
        run(arguments, say, stop)
    except (AlightError, OSError) as error:
        _log.error("simulator.failed", why=str(error))
        return 2
    return 0
