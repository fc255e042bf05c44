"""`alight calibrate`: parse, call, print. No logic."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from app.display import open_console
from app.log import configure_logging

calibrate_cli = typer.Typer(rich_markup_mode=None)

Kind = Annotated[Literal["chessboard", "charuco"], typer.Option("--board", help="What is printed.")]
Columns = Annotated[int, typer.Option(min=4, max=60, help="Squares across, black and white; not inner corners.")]
Rows = Annotated[int, typer.Option(min=4, max=60, help="Squares down, black and white.")]
SquareMm = Annotated[float, typer.Option(min=1, max=1000, help="Side of a square.")]
MarkerMm = Annotated[float | None, typer.Option(min=1, max=1000, help="charuco: marker's side; 0.72 squares without.")]
Dictionary = Annotated[str, typer.Option(help="charuco: OpenCV's name of the markers.")]
Paths = Annotated[list[Path] | None, typer.Argument(help="Images, folders, videos and flight records.")]
Draw = Annotated[Path | None, typer.Option(help="Folder for pictures of what was found.")]
MaxFrames = Annotated[int, typer.Option(min=10, max=100000, help="Frames to look at, of each video.")]
Force = Annotated[bool, typer.Option("--force", help="Write the file even if it is judged not good.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the file if it is there.")]
Centred = Annotated[
    bool, typer.Option("--centred-only", help="No frames off the middle: the second group is worked out.")
]


@calibrate_cli.command(short_help="Draw a calibration board at true size.")
def board(
    out: Annotated[Path, typer.Option(help="File to write: .pdf, .svg or .png.")],
    kind: Kind = "chessboard",
    columns: Columns = 10,
    rows: Rows = 7,
    square_mm: SquareMm = 25.0,
    marker_mm: MarkerMm = None,
    dictionary: Dictionary = "DICT_5X5_100",
    paper: Annotated[Literal["a4", "a3", "letter"] | None, typer.Option(help="Paper to draw it on.")] = None,
) -> None:
    """Draw a calibration board at true size, to be printed and glued to something flat and stiff."""
    from app.calibration.board import board_of
    from app.review.printing.board import draw_board

    for path in draw_board(board_of(kind, columns, rows, square_mm, marker_mm, dictionary), out, paper):
        typer.echo(path)


@calibrate_cli.command(short_help="Make a camera file from images of a board.")
def lens(
    out: Annotated[Path, typer.Option(help="Camera file to write, such as configs/cameras/mine.toml.")],
    model: Annotated[Literal["pinhole", "fisheye"], typer.Option(help="Kind of lens.")],
    paths: Paths = None,
    live: Annotated[str | None, typer.Option(help="Instead: a rig file, device number or URL.")] = None,
    kind: Kind = "chessboard",
    columns: Columns = 10,
    rows: Rows = 7,
    square_mm: SquareMm = 25.0,
    marker_mm: MarkerMm = None,
    dictionary: Dictionary = "DICT_5X5_100",
    draw: Draw = None,
    max_frames: MaxFrames = 300,
    force: Force = False,
    overwrite: Overwrite = False,
) -> None:
    """Make a camera file from images, videos or a live view of a chessboard or ChArUco board, and judge it."""
    from app.calibrate import Target
    from app.calibrate_lens import run_lens
    from app.calibration.board import board_of

    configure_logging(quiet=True)
    seen = board_of(kind, columns, rows, square_mm, marker_mm, dictionary)
    written = run_lens(
        paths or [],
        live,
        seen,
        "pinhole" if model == "pinhole" else "equidistant",
        max_frames,
        Target(out, draw, force, overwrite),
        open_console(sys.stdout),
    )
    raise typer.Exit(0 if written else 1)


@calibrate_cli.command(short_help="Make the paper's height table from frames at known heights.")
def height(
    out: Annotated[Path, typer.Option(help="Height table to write, such as configs/height-tables/mine.toml.")],
    paths: Paths = None,
    heights: Annotated[
        str, typer.Option(help="CSV file (file,height_m[,from_s,to_s]), or the names' pattern, such as pad-{cm}cm.")
    ] = "",
    camera: Annotated[Path | None, typer.Option(help="Camera file.")] = None,
    pad: Annotated[Path | None, typer.Option(help="Pad file; the paper's landmark of 38 cm without it.")] = None,
    live: Annotated[Path | None, typer.Option(help="Instead: a rig file; the heights are asked for.")] = None,
    frames: Annotated[int, typer.Option(min=1, max=1000, help="live: frames to take at each station.")] = 20,
    centred_only: Centred = False,
    draw: Draw = None,
    max_frames: MaxFrames = 300,
    force: Force = False,
    overwrite: Overwrite = False,
) -> None:
    """Make the paper's height table (its Table II) from frames of the landmark at known heights, and judge it."""
    from app.calibrate import Target
    from app.calibrate_height import run_height, run_height_live

    configure_logging(quiet=True)
    target, console = Target(out, draw, force, overwrite), open_console(sys.stdout)
    if live is not None:
        written = run_height_live(live, input, frames, centred_only, target, console)
    else:
        written = run_height(paths or [], heights, camera, pad, max_frames, centred_only, target, console)
    raise typer.Exit(0 if written else 1)
