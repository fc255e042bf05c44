"""What a person sees while it flies: state, height, distance, frame rate. Reads queues, decides nothing.

It is written by a thread of its own (app/output.py): a terminal that is paused must not stop a flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TextIO, cast

from rich.console import Console
from rich.live import Live
from rich.table import Table

from app.channels import Latest
from app.log import unfailing
from app.messages import Detection, GuidanceStatus, MissionReport, OperatorText, PadTrack, VehicleState
from app.output import BackgroundStream


def open_console(stream: TextIO, *, plain: bool = False) -> Console:
    """Where a person looks: a console whose failures end no flight; plain: nothing in it changes in place."""
    file = stream if isinstance(stream, BackgroundStream) else unfailing(stream)
    return Console(file=file, force_terminal=False if plain else None)


@dataclass(frozen=True, slots=True)
class Watched:
    """The newest of each."""

    vehicle: Latest[VehicleState]
    detections: Latest[Detection]
    tracks: Latest[PadTrack]
    statuses: Latest[GuidanceStatus]
    reports: Latest[MissionReport]
    texts: Latest[OperatorText]


class Display:
    """A line that changes in place on a terminal, and a line for each change of state.

    Args:
        title: What flies.
        watched: Where to look.
        console: Where to write; while the display is shown, by a thread.
        tells: Whether each change of state gets a line that stays; not where the log tells it.
    """

    def __init__(self, title: str, watched: Watched, console: Console, *, tells: bool = True) -> None:
        self._tells = tells
        self._title = title
        self._watched = watched
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._stream: BackgroundStream | None = None
        self._before: TextIO | None = None
        self._shown: tuple[str, str] | None = None
        self._frames: list[tuple[float, int]] = []

    def __enter__(self) -> Display:
        file = self._console.file
        if isinstance(file, BackgroundStream):
            self._stream = file  # the log's own: then both come in their order
        else:
            self._before, self._stream = cast(TextIO, file), BackgroundStream(cast(TextIO, file))
            self._console.file = cast(TextIO, self._stream)
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
        if self._before is not None and self._stream is not None:
            self._stream.close()
            self._console.file, self._before = self._before, None

    def refresh(self, now_s: float) -> None:
        """Show what is newest; call it a few times a second."""
        report = self._watched.reports.newest
        phase = "starting" if report is None else report.phase.value
        reason = "" if report is None else report.reason
        figures = self._figures(now_s)
        if self._live is None:
            if self._tells and (phase, reason) != self._shown:
                line = f"  {self._title}: {reason or phase}  ({figures})"
                self._console.print(line, highlight=False, soft_wrap=True)
        else:
            row = Table.grid(padding=(0, 2))
            row.add_row(f"[bold]{self._title}[/]", f"[bold cyan]{phase:<9}[/]", figures, f"[dim]{reason}[/]")
            # A terminal that is paused gets no figures of long ago when it goes on.
            self._live.update(row, refresh=self._stream is None or not self._stream.is_behind)
            if self._tells and report is not None and self._shown is not None and (phase, reason) != self._shown:
                self._console.print(f"  {self._title}: {reason}", highlight=False)
        self._shown = (phase, reason)

    def _figures(self, now_s: float) -> str:
        vehicle, status = self._watched.vehicle.newest, self._watched.statuses.newest
        fresh = status is not None and now_s - status.t_s < 1.0
        height = status.height_above_pad_m if fresh and status is not None else None
        distance = status.horizontal_error_m if fresh and status is not None else None
        above = (
            f"{height:5.2f} m over pad"
            if height is not None
            else (f"{-float(vehicle.pos_ned_m[2]):5.2f} m over home" if vehicle is not None else "    - m")
        )
        away = f"{distance:5.2f} m off" if distance is not None else "    - m off"
        return f"{above}  {away}  {self._rate_hz(now_s):4.1f} frames/s"

    def _rate_hz(self, now_s: float) -> float:
        detection = self._watched.detections.newest
        if detection is not None:
            self._frames.append((now_s, detection.sequence))
        self._frames = [item for item in self._frames if now_s - item[0] <= 2.0]
        if len(self._frames) < 2 or self._frames[-1][0] - self._frames[0][0] < 0.2:
            return 0.0
        return (self._frames[-1][1] - self._frames[0][1]) / (self._frames[-1][0] - self._frames[0][0])
