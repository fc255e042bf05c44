"""The paper's figures, redrawn from a flight: vertical velocity, height by vision against the barometer's, horizontal
distance to the pad; and an original beside its binary image.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from app.errors import RecorderError
from app.messages import Image
from app.review.flight import Flight

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # the backend is chosen first: there may be no screen

PHASE_COLOURS = {
    "takeoff": "#dfe7f2",
    "search": "#fdf0d5",
    "hover": "#e6f2e0",
    "track": "#d8ecf3",
    "land": "#f6dcdc",
    "landed": "#eeeeee",
    "hold": "#f2e6f5",
    "return": "#f2e6f5",
    "fallback_land": "#f2e6f5",
}
LINE, SECOND = "#1f4e79", "#c8553d"


def _figure(flight: Flight, title: str, y_label: str, path: Path, draw: Callable[[Any, float], None]) -> Path:
    """One figure over time, the mission's phases shaded behind it."""
    start, end = flight.window_s()
    end += 2.0
    figure, axes = plt.subplots(figsize=(8, 4), dpi=120, layout="constrained")
    named: set[str] = set()
    for begin, until, phase in flight.spans_s():
        if phase in PHASE_COLOURS and min(until, end) > begin:
            label = None if phase in named else phase
            named.add(phase)
            axes.axvspan(begin - start, min(until, end) - start, color=PHASE_COLOURS[phase], label=label, lw=0)
    draw(axes, start)
    axes.set_xlim(0.0, end - start)
    axes.set_title(title)
    axes.set_xlabel("time in s")
    axes.set_ylabel(y_label)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, ncols=2)
    return _save(figure, path)


def _save(figure: Any, path: Path) -> Path:
    try:
        figure.savefig(path)
    except OSError as fault:
        raise RecorderError(f"{path}: can't be written ({fault.strerror})", "free some space, or use --out") from None
    finally:
        plt.close(figure)
    return path


def draw_figures(flight: Flight, name: str, folder: Path) -> list[Path]:
    """Draw the three figures over time.

    Args:
        flight: What was recorded.
        name: Of the experiment, for titles and file names.
        folder: Where the PNG files go; it exists.

    Raises:
        RecorderError: A figure can't be written.
    """

    def vertical(axes: Any, start: float) -> None:
        axes.plot(flight.vehicle_t_s - start, flight.vehicle_vel_ned_m_s[:, 2], color=LINE, lw=1, label="down")

    def height(axes: Any, start: float) -> None:
        axes.plot(
            flight.vehicle_t_s - start,
            -flight.vehicle_pos_ned_m[:, 2],
            color=SECOND,
            lw=1,
            label="barometer (PX4, above home)",
        )
        axes.plot(flight.fix_t_s - start, flight.fix_height_m, ".", ms=2, color=LINE, label="vision (above the pad)")

    def distance(axes: Any, start: float) -> None:
        axes.plot(flight.fix_t_s - start, flight.fix_horizontal_m, ".", ms=2, color=LINE, label="vision")

    return [
        _figure(flight, f"{name}: vertical velocity", "m/s", folder / f"{name}-vertical-velocity.png", vertical),
        _figure(flight, f"{name}: height", "m", folder / f"{name}-height.png", height),
        _figure(flight, f"{name}: horizontal distance to the pad", "m", folder / f"{name}-distance.png", distance),
    ]


def draw_binary(original: Image, binary: Image, name: str, folder: Path) -> Path:
    """An original camera image and the binary image that the detector made of it, side by side."""
    figure, both = plt.subplots(1, 2, figsize=(10, 4), dpi=120, layout="constrained")
    for axes, image, title in zip(both, (original, binary), ("original", "binary"), strict=True):
        axes.imshow(np.asarray(image), cmap="gray", vmin=0, vmax=255)
        axes.set_title(f"{name}: {title}")
        axes.axis("off")
    return _save(figure, folder / f"{name}-original-and-binary.png")
