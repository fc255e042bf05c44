"""The paper's two experiments in the built-in simulator, one after the other, and what they came to."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from app.config import PadMotionConfig, WorldConfig
from app.debrief import RESULT, clear, failed, files_of, own_folder, review, write_result
from app.errors import AlightError
from app.flying import Ended, Plan, fly
from app.messages import OperatorAction
from app.orders import Order
from app.review.figures import draw_binary, draw_figures
from app.review.flight import Flight
from app.review.video import binary_of, middle_of_descent, write_video
from app.wiring import Rig

EXPERIMENTS = ("static", "car")
CAR_SPEED_M_S = 3.75
"""13.5 km/h, as in the paper."""
TIMEOUT_S = 150.0


def world_of(experiment: str, seed: int) -> WorldConfig:
    """The simulated world of an experiment; the seed draws the pad's place, the wind and the sun."""
    draw = random.Random(f"{experiment} {seed}")
    wind = {
        "seed": seed,
        "wind_m_s": round(draw.uniform(0.0, 2.0), 2),
        "gust_m_s": round(draw.uniform(0.2, 0.6), 2),
        "wind_from_deg": round(draw.uniform(0.0, 360.0), 1),
        "sun_elevation_deg": round(draw.uniform(30.0, 65.0), 1),
        "sun_azimuth_deg": round(draw.uniform(0.0, 360.0), 1),
    }
    if experiment == "static":
        motion = PadMotionConfig(
            north_m=round(draw.uniform(-4.0, 4.0), 2),
            east_m=round(draw.uniform(-4.0, 4.0), 2),
            heading_deg=round(draw.uniform(-180.0, 180.0), 1),
        )
        return WorldConfig(ground="lawn", motion=motion, **wind)  # type: ignore[arg-type]  # checked by pydantic
    motion = PadMotionConfig(
        north_m=round(draw.uniform(1.5, 3.0), 2),
        east_m=round(draw.uniform(-2.0, 2.0), 2),
        height_m=1.5,
        heading_deg=round(draw.uniform(-30.0, 30.0), 1),
        speed_m_s=CAR_SPEED_M_S,
        start_after_s=8.0,
        acceleration_m_s2=1.0,
        deck_m=1.6,
    )
    return WorldConfig(ground="asphalt", motion=motion, **wind)  # type: ignore[arg-type]  # checked by pydantic


def run_demo(rig: Rig, experiments: tuple[str, ...], seed: int, out: Path, console: Console) -> dict[str, Any]:
    """Fly the experiments, review them, print the table.

    Args:
        rig: The simulator's rig.
        experiments: Of EXPERIMENTS.
        seed: Of the worlds.
        out: Folder for everything that is written; what it holds of an earlier demo is replaced.
        console: Where to show it.

    Returns:
        What result.json holds.

    Raises:
        AlightError: The folder can't be written, or a flight could not be flown; result.json tells of those before it.
        KeyboardInterrupt: It was interrupted; result.json tells of what was flown.
    """
    with own_folder(out):
        clear(out / RESULT)
        results: list[dict[str, Any]] = []
        for name in experiments:
            world = rig.with_world(world_of(name, seed)).on_free_ports()
            with own_folder(out / name) as folder:
                plan = Plan(name, world, folder, (Order(OperatorAction.LAND),), True, TIMEOUT_S)
                _fly_one(plan, out, results, console)
        console.print(table_of(results))
        console.print(
            f"written to {out}: result.json, figures, videos, flight records", highlight=False, soft_wrap=True
        )
        return {"experiments": results}


def _fly_one(plan: Plan, out: Path, results: list[dict[str, Any]], console: Console) -> None:
    """Fly and review one experiment, and write what all came to so far, this one's error too."""
    clear(*files_of(plan), *drawings_of(plan))
    try:
        flown = asyncio.run(fly(plan, console))
    except AlightError as error:
        write_result(out, [*results, failed(plan, error)])
        raise
    flight, entry = review(plan, flown)
    results.append(entry)
    write_result(out, results)
    if flown.ended is Ended.INTERRUPTED:
        raise KeyboardInterrupt
    console.print(f"  {plan.title}: drawing figures and video", highlight=False)
    draw(plan, flight)


def drawings_of(plan: Plan) -> list[Path]:
    """What `draw` has written into the plan's folder."""
    return (
        [] if plan.folder is None else [p for p in plan.folder.glob(f"{plan.title}*") if p.suffix in (".png", ".mp4")]
    )


def draw(plan: Plan, flight: Flight) -> None:
    """Figures and video of a flight into its folder, if it has one.

    Raises:
        RecorderError: The record can't be read, or a picture can't be written.
    """
    if plan.folder is None or plan.record is None:
        return
    draw_figures(flight, plan.title, plan.folder)
    write_video(plan.record, plan.folder / f"{plan.title}.mp4", plan.rig.landmark, plan.rig.lens)
    original = middle_of_descent(plan.record, flight)
    if original is not None:
        binary = binary_of(original, plan.rig.landmark, plan.rig.lens, plan.rig.config.vision)
        draw_binary(original.image, binary, plan.title, plan.folder)


def table_of(results: list[dict[str, Any]]) -> Table:
    """The table at the end: a column for each experiment."""
    table = Table(title="Alight: what the flights came to")
    table.add_column("")
    for result in results:
        table.add_column(result["name"], justify="right")

    def row(label: str, *cells: str) -> None:
        table.add_row(label, *cells)

    def figure(value: float | None, form: str, scale: float = 1.0) -> str:
        return "-" if value is None else form.format(value * scale)

    row("outcome", *(r["outcome"] for r in results))
    row("touchdown error", *(figure(r["touchdown_error_m"], "{:.1f} cm", 100) for r in results))
    row("speed relative to the pad", *(figure(r["touchdown_speed_m_s"], "{:.2f} m/s") for r in results))
    row("sink at touchdown", *(figure(r["touchdown_sink_m_s"], "{:.2f} m/s") for r in results))
    for phase in ("takeoff", "search", "hover", "track", "land"):
        row(f"time in {phase}", *(figure(r["time_in_state_s"].get(phase), "{:.1f} s") for r in results))
    row("frames with the landmark found", *(figure(r["detection_rate"], "{:.1f} %", 100) for r in results))
    row("detection, p50", *(figure(r["detection_ms"]["p50"], "{:.1f} ms") for r in results))
    row("exposure to setpoint, p50", *(figure(r["latency_s"]["p50"], "{:.0f} ms", 1e3) for r in results))
    row("exposure to setpoint, p99", *(figure(r["latency_s"]["p99"], "{:.0f} ms", 1e3) for r in results))
    row("setpoint period, p99", *(figure(r["setpoint_period_s"]["p99"], "{:.1f} ms", 1e3) for r in results))
    row("processor: application", *(figure(r["cpu_percent"].get("application"), "{:.0f} %") for r in results))
    row("processor: simulator", *(figure(r["cpu_percent"].get("simulator"), "{:.0f} %") for r in results))
    return table
