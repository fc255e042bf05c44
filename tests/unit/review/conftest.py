"""A flight by hand: the items of a record, whose every figure is worked out in the tests that read them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.messages import (
    ControlTurn,
    Detection,
    Frame,
    GoalKind,
    GuidanceStatus,
    MissionReport,
    PadFix,
    Phase,
    SeenContour,
    Setpoint,
    VehicleState,
)
from app.review.record_reader import Recorded, read_record
from drivers.recorder.mcap import McapRecorder


class Items:
    """Messages as tasks publish them."""

    @staticmethod
    def vehicle(t_s: float, height_m: float = 0.0, sink_m_s: float = 0.0) -> tuple[str, VehicleState]:
        return "vehicle", VehicleState(
            t_s, np.array([0.0, 0.0, -height_m]), np.array([0.0, 0.0, sink_m_s]), np.array([1.0, 0.0, 0.0, 0.0])
        )

    @staticmethod
    def report(t_s: float, phase: Phase, reason: str) -> tuple[str, MissionReport]:
        return "reports", MissionReport(t_s, phase, GoalKind.NONE, reason, 0, None)

    @staticmethod
    def detection(
        t_s: float, sequence: int, corners_px: Any = None, elapsed_s: float = 0.003, reason: str | None = None
    ) -> tuple[str, Detection]:
        seen = () if corners_px is None else (SeenContour(0, np.array(corners_px, dtype=np.float64)),)
        code = None if corners_px is None else "44334"
        return "detections", Detection(t_s, sequence, seen, code, reason, score=0.9, elapsed_s=elapsed_s)

    @staticmethod
    def fix(t_s: float, north_m: float, east_m: float, down_m: float) -> tuple[str, PadFix]:
        relative = np.array([north_m, east_m, down_m])
        return "fixes", PadFix(t_s, relative, relative, np.eye(3) * 1e-4, 0.0, 0.01, "44334")

    @staticmethod
    def turn(
        t_s: float,
        period_s: float = 0.02,
        *,
        sent: bool = True,
        latency_s: float | None = None,
        contact: bool = False,
    ) -> tuple[str, ControlTurn]:
        setpoint = Setpoint(t_s, np.zeros(3), np.zeros(3), 0.0) if sent else None
        return "turns", ControlTurn(t_s, period_s, setpoint, latency_s, GuidanceStatus(t_s, contact=contact))

    @staticmethod
    def frame(t_s: float, sequence: int, image: np.ndarray) -> tuple[str, Frame]:
        return "frames", Frame(t_s, sequence, image)

    def landing(self) -> list[tuple[str, Any]]:
        """Idle to 100 s, take-off to 104, search to 106, hover to 107, track to 111, land to 115, landed to 117."""
        phases = [
            (98.0, Phase.IDLE, "started"),
            (100.0, Phase.TAKEOFF, "takeoff: commanded"),
            (104.0, Phase.SEARCH, "search: height reached"),
            (106.0, Phase.HOVER, "hover: pad found"),
            (107.0, Phase.TRACK, "track: settled over the pad"),
            (111.0, Phase.LAND, "land: track steady"),
            (115.0, Phase.LANDED, "landed: on the pad, disarmed"),
        ]
        return [self.report(*phase) for phase in phases] + [self.vehicle(98.0), self.vehicle(117.0)]


@pytest.fixture(scope="session")
def items() -> Items:
    return Items()


@pytest.fixture
def record(tmp_path: Path) -> Callable[[Iterable[tuple[str, Any]]], Path]:
    """Writes items as the flight's recorder does; the path."""

    async def write(path: Path, items: Iterable[tuple[str, Any]]) -> None:
        async with McapRecorder(path, jpeg_quality=95) as recorder:
            for topic, message in items:
                recorder.write(topic, getattr(message, "t_capture_s", getattr(message, "t_s", 0.0)), message)

    def run(items: Iterable[tuple[str, Any]]) -> Path:
        path = tmp_path / "flight.mcap"
        asyncio.run(write(path, items))
        return path

    return run


@pytest.fixture
def recorded(
    record: Callable[[Iterable[tuple[str, Any]]], Path],
) -> Callable[[Iterable[tuple[str, Any]]], list[Recorded]]:
    """Items as they are read back from a record."""
    return lambda items: list(read_record(record(items), images=False))
