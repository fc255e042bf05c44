"""From a landmark to files: takes the format from the name, cuts into pages where asked, writes, says what failed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.errors import LandmarkError
from app.landmark import Landmark
from app.review.printing.page import Page
from app.review.printing.pdf import pdf_bytes
from app.review.printing.png import png_bytes
from app.review.printing.sheet import caption, lay_out
from app.review.printing.svg import svg_text
from app.review.printing.tiles import tile as cut

DPI = 300


def draw_landmark(landmark: Landmark, out: Path, *, tile: str | None = None, dpi: int = DPI) -> list[Path]:
    """Draw a landmark to a file at true size.

    Args:
        landmark: What to draw.
        out: A .pdf, .svg or .png file. A PDF holds all pages; of the others, more than one page makes numbered files
            beside it (pad-00.svg is the overview).
        tile: Paper to cut it for: "a4", "a3", "letter"; None for one sheet just big enough.
        dpi: Dots per inch of a PNG, 30 to 2400.

    Returns:
        The files that were written.

    Raises:
        LandmarkError: Unknown extension, paper or resolution, a sheet too large for the format, or a path that can't
            be written. Nothing is written unless all pages could be drawn.
    """
    return write_pages(_pages(landmark, tile), out, caption(landmark), dpi)


def write_pages(pages: Sequence[Page], out: Path, title: str, dpi: int = DPI) -> list[Path]:
    """Write pages to a .pdf, .svg or .png file, or numbered files; see draw_landmark.

    Raises:
        LandmarkError: Unknown extension or resolution, a page too large for the format, or a path that can't be
            written.
    """
    contents = _contents(pages, out, title, dpi)
    try:
        for path, content in contents.items():
            path.write_bytes(content)
    except OSError as error:
        raise LandmarkError(
            f"{error.filename or out}: can't be written ({error.strerror})",
            "give a file in a folder that you can write to",
        ) from None
    return list(contents)


def _pages(landmark: Landmark, tile: str | None) -> Sequence[Page]:
    sheet = lay_out(landmark)
    return (sheet,) if tile is None else cut(sheet, tile.lower(), landmark.name)


def _contents(pages: Sequence[Page], out: Path, title: str, dpi: int) -> dict[Path, bytes]:
    """What goes into which file."""
    if not 30 <= dpi <= 2400:
        raise LandmarkError(f"{dpi} dots per inch", "give 30 to 2400")
    digits = max(2, len(str(len(pages) - 1)))
    paths = [out] if len(pages) == 1 else [out.with_stem(f"{out.stem}-{k:0{digits}d}") for k in range(len(pages))]
    match out.suffix.lower():
        case ".pdf":
            return {out: pdf_bytes(pages, title)}
        case ".svg":
            return {path: svg_text(page, title).encode() for path, page in zip(paths, pages, strict=True)}
        case ".png":
            return {path: png_bytes(page, dpi) for path, page in zip(paths, pages, strict=True)}
        case other:
            raise LandmarkError(
                f"{out}: can't draw {f'a {other} file' if other else 'without an extension'}",
                "name it .pdf, .svg or .png",
            )
