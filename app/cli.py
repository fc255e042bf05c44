"""Typer commands: parse, call, print. No logic."""

from __future__ import annotations

import asyncio
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from app.cli_calibrate import calibrate_cli
from app.display import open_console
from app.errors import ConfigError
from app.log import configure_logging
from app.messages import CommandResult, OperatorAction

cli = typer.Typer(
    name="alight",
    help="Lands a PX4 multirotor on a printed landmark, at rest or on a moving vehicle, with one downward camera.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Verbose = Annotated[bool, typer.Option("--verbose", help="Log at debug level.")]


class Experiment(StrEnum):
    """The paper's experiments."""

    STATIC = "static"
    CAR = "car"


class PhoneAction(StrEnum):
    """What a phone can ask."""

    SEARCH = "search"
    TRACK = "track"
    LAND = "land"
    HOLD = "hold"
    ABORT = "abort"


@cli.command(short_help="Fly the paper's two experiments in the simulator.")
def demo(
    experiment: Annotated[Experiment | None, typer.Option(help="One of the two; both without it.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of wind, light and the pad's place.")] = 1,
    headless: Annotated[bool, typer.Option("--headless", help="No display that changes in place.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for results, figures and videos.")] = Path("flights/demo"),
    verbose: Verbose = False,
) -> None:
    """Fly the paper's two experiments in the built-in simulator: a static pad, and a car at 13.5 km/h."""
    from app.demo import EXPERIMENTS, run_demo
    from app.wiring import load_shipped_rig

    configure_logging(verbose=verbose, quiet=not verbose)
    console = open_console(sys.stdout, plain=headless)
    chosen = EXPERIMENTS if experiment is None else (experiment.value,)
    found = run_demo(load_shipped_rig("simulator.toml"), chosen, seed, out, console)
    if any(result["outcome"] != "landed" for result in found["experiments"]):
        raise typer.Exit(1)


@cli.command(short_help="Fly a rig: real hardware, or PX4 SITL.")
def run(
    context: typer.Context,
    config: Annotated[Path, typer.Option(help="Rig file, such as configs/sitl.toml.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for record and result; a new one in the rig's otherwise.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="End after the first mission.")] = False,
    scenario: Annotated[
        str | None, typer.Option(help="PX4 SITL: fly this one, by itself. A name of configs/scenarios, or a .toml.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="That draws the scenario's trial; 1 without it.")] = None,
    verbose: Verbose = False,
) -> None:
    """Fly a rig: real hardware, or PX4 SITL with a camera rendered from its ground truth.

    With --scenario it gives the orders by itself, judges the landing by PX4's truth, and ends with 1 if it failed.
    """
    from app.service import run_rig
    from app.wiring import load_rig

    if scenario is None and seed is not None:
        context.fail("Option '--seed' wants '--scenario'.")
    configure_logging(verbose=verbose)
    if scenario is None:
        run_rig(load_rig(config), out, once, open_console(sys.stderr))
        return
    from app.campaign.px4_flight import fly_scenario, words_of  # the Pi needs no simulator

    entry = fly_scenario(load_rig(config), scenario, 1 if seed is None else seed, out, open_console(sys.stderr))
    typer.echo(words_of(entry))
    if not entry["success"]:
        raise typer.Exit(1)


@cli.command(short_help="Command Alight as a phone does.")
def phone(
    context: typer.Context,
    action: Annotated[PhoneAction, typer.Argument(help="What to ask for.")],
    height: Annotated[float | None, typer.Option(min=0.5, max=50, help="Height over the pad to track at, m.")] = None,
    address: Annotated[str, typer.Option(help="The rig's operator address.")] = "udpin://127.0.0.1:14590",
    pad_speed: Annotated[
        float | None, typer.Option(min=0.1, max=90, help="The pad drives so fast, km/h: it is searched for on its way.")
    ] = None,
    pad_heading: Annotated[
        float | None, typer.Option(min=-360, max=360, help="Which way it drives, degrees clockwise from north.")
    ] = None,
    silence: Annotated[float, typer.Option(min=0.5, max=600, help="Longest silence to wait through, s.")] = 5.0,
) -> None:
    """Command Alight as a phone does: COMMAND_LONG 31010 from a ground station of its own."""
    from app.wiring import PhoneProgress, PhoneResult, PhoneText, Wanted, tell

    if (pad_speed is None) != (pad_heading is None):
        context.fail("Options '--pad-speed' and '--pad-heading' want each other.")
    speed_m_s = None if pad_speed is None else pad_speed / 3.6
    wanted = Wanted(OperatorAction[action.name], height, speed_m_s, pad_heading)
    result: CommandResult | None = None
    for event in tell(address, wanted, silence):
        match event:
            case PhoneProgress(percent):
                typer.echo(f"in progress: {percent}%")
            case PhoneText(text, _):
                typer.echo(text)
            case PhoneResult(final):
                result = final
                typer.echo(f"{action.value}: {final.name.lower()}")
    raise typer.Exit(0 if result is CommandResult.ACCEPTED else 1)


@cli.command(short_help="Look at a rig before a flight.")
def check(
    config: Annotated[Path, typer.Option(help="Rig file.")],
    seconds: Annotated[float, typer.Option(min=0.5, max=60, help="How long to look at each part.")] = 3.0,
) -> None:
    """Look at a rig before a flight: files, camera, autopilot, PX4's failsafe parameters, phone link. Tells all faults
    at once.
    """
    from app.service import Verdict, check_rig
    from app.wiring import load_rig

    configure_logging(quiet=True)
    faults = 0
    for part, verdict, detail in asyncio.run(check_rig(load_rig(config), seconds)):
        faults += verdict is Verdict.FAULT
        typer.echo(f"{verdict:5}  {part}: {detail}")
    if faults:
        raise ConfigError(f"{config}: {faults} fault(s)", "mend what is marked FAULT above")


@cli.command(short_help="Fly a scenario many times, faster than real time.")
def campaign(
    scenario: Annotated[str, typer.Option(help="A name of configs/scenarios, or a .toml; several with commas.")],
    trials: Annotated[int, typer.Option(min=1, max=100_000, help="Of each scenario.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of the first trial; the others count up from it.")] = 1,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Processes; the result is the same.")] = 1,
    json_file: Annotated[Path | None, typer.Option("--json", help="Figures to write.")] = None,
    html_file: Annotated[Path | None, typer.Option("--html", help="Page to write.")] = None,
) -> None:
    """Fly scenarios many times in the simulator, in virtual time, and tell what the landings came to.

    Ends with 1 if a trial failed. Ctrl-C keeps what is done.
    """
    from app.campaign.command import run_campaign

    configure_logging(quiet=True)
    landed = run_campaign(
        scenario,
        trials,
        seed,
        workers=workers,
        json_file=json_file,
        html_file=html_file,
        output=open_console(sys.stdout),
        progress=open_console(sys.stderr),
    )
    if not landed:
        raise typer.Exit(1)


landmark_cli = typer.Typer(invoke_without_command=True, rich_markup_mode=None)
cli.add_typer(landmark_cli, name="landmark", short_help="Draw a landmark at true size, or design one.")


@landmark_cli.callback()
def landmark(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option(help="File to write: .pdf, .svg or .png.")] = None,
    size_cm: Annotated[float | None, typer.Option(min=2, max=2000, help="Side of the outermost contour.")] = None,
    tile: Annotated[
        Literal["a4", "a3", "letter"] | None, typer.Option(help="Cut into pages with overlap and crop marks.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="Pad file, such as configs/pads/paper-38cm.toml.")] = None,
) -> None:
    """Draw a landmark at true size, to be printed."""
    from app.review.printing.draw import draw_landmark
    from app.wiring import read_landmark

    if context.invoked_subcommand is not None:
        if (out, size_cm, tile, config) != (None,) * 4:
            context.fail(f"Options of {context.invoked_subcommand!r} come after it.")
        return
    if out is None:
        context.fail("Missing option '--out'.")
    for path in draw_landmark(read_landmark(config, size_cm), out, tile=tile):
        typer.echo(path)


@landmark_cli.command(short_help="Propose a landmark for a camera and a range of heights.")
def design(
    camera: Annotated[Path, typer.Option(help="Camera file, such as configs/cameras/pi-fisheye-640.toml.")],
    ceiling: Annotated[float, typer.Option(min=0.1, max=1000, help="Height up to which it must be seen, m.")],
    floor: Annotated[float, typer.Option(min=0.01, max=100, help="Height down to which it must be seen, m.")],
    tilt: Annotated[float, typer.Option(min=0, max=60, help="Of the camera, to allow for, degrees.")] = 10.0,
    offset: Annotated[
        float, typer.Option(min=0, max=0.9, help="How far off the middle, as a part of the view that the tilt leaves.")
    ] = 0.2,
    min_side_px: Annotated[
        float | None, typer.Option(min=4, max=200, help="Smallest side that is found; 12 without it.")
    ] = None,
    max_size_cm: Annotated[float, typer.Option(min=2, max=2000, help="Largest side that you can print.")] = 200.0,
    detail_mm: Annotated[float, typer.Option(min=0.1, max=50, help="Finest line that you can print.")] = 1.0,
    out: Annotated[Path | None, typer.Option(help="Pad file to write: .toml.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a pad file that is there.")] = False,
    draw: Annotated[Path | None, typer.Option(help="Picture of the pad and its heights to write: .png.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON line, nothing else.")] = False,
) -> None:
    """Propose a landmark for a camera and a range of heights, and tell from where each part of it is seen.

    Heights are of the camera above the pad. Ends with 1, and writes no pad file, if no pad does all of it.
    """
    from app.review.pad_design.command import design_pad, request_of
    from app.wiring import read_lens

    request = request_of(ceiling, floor, max_size_cm=max_size_cm, min_side_px=min_side_px, detail_mm=detail_mm)
    answer = design_pad(
        read_lens(camera),
        camera.stem,
        request,
        tilt_deg=tilt,
        offset=offset,
        out=out,
        draw=draw,
        overwrite=overwrite,
    )
    typer.echo(answer.to_json() if as_json else answer.to_text())
    if not answer.design.is_met:
        raise typer.Exit(1)


cli.add_typer(calibrate_cli, name="calibrate", help="Calibrate a lens, or the paper's height table; draw a board.")


@cli.command(short_help="Find the landmark in images, folders and videos.")
def detect(
    paths: Annotated[list[Path], typer.Argument(help="Images, folders and videos.")],
    camera: Annotated[Path, typer.Option(help="Camera file, such as configs/cameras/pi-fisheye-640.toml.")],
    pad: Annotated[Path | None, typer.Option(help="Pad file; the paper's landmark of 38 cm without it.")] = None,
    method: Annotated[Literal["pnp", "paper"], typer.Option(help="How the pose is worked out.")] = "pnp",
    stills: Annotated[
        bool | None, typer.Option("--stills/--sequence", help="Each image alone, or one after the other in time.")
    ] = None,
    json_lines: Annotated[bool, typer.Option("--json", help="One JSON line an image, nothing else.")] = False,
    draw: Annotated[Path | None, typer.Option(help="Folder for the images with what was seen drawn on them.")] = None,
) -> None:
    """Find the landmark in images, folders and videos, and tell where it is."""
    from app.wiring import inspect_files

    configure_logging(quiet=True)
    sequence = None if stills is None else not stills
    for found in inspect_files(paths, camera=camera, pad=pad, method=method, sequence=sequence, draw=draw):
        sys.stdout.write((found.to_json() if json_lines else found.to_text()) + "\n")
        sys.stdout.flush()
