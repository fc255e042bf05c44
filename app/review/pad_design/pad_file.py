"""Writes a design as a pad file, with what it is for in its comments: configs/pads/*.toml are written like this."""

from __future__ import annotations

from pathlib import Path

from app.errors import LandmarkError
from app.review.pad_design.proposal import Design

CM_DIGITS = 5
"""Of a length in centimetres: a tenth of a micrometre."""


def check_writable(path: Path, *, overwrite: bool) -> None:
    """Refuse a path before anything is worked out.

    Raises:
        LandmarkError: It is no .toml, exists already, or its folder doesn't.
    """
    if path.suffix.lower() != ".toml":
        raise LandmarkError(f"{path}: a pad file is a .toml", f"give --out {path.with_suffix('.toml').name}")
    if path.exists() and not overwrite:
        raise LandmarkError(f"{path}: exists already", "give another name, or --overwrite to replace it")
    if not path.parent.is_dir():
        raise LandmarkError(f"{path}: no such folder ({path.parent})", "make it, or give a file in one that exists")


def write_pad_file(design: Design, path: Path, camera: str, *, overwrite: bool) -> None:
    """Write it.

    Args:
        design: What to write.
        path: Where to.
        camera: Name of the camera that it was designed for.
        overwrite: Replace a file that is there.

    Raises:
        LandmarkError: It exists and may not be replaced, or it can't be written.
    """
    try:
        with path.open("w" if overwrite else "x", encoding="utf-8") as file:
            file.write(pad_text(design, camera))
    except FileExistsError:
        raise LandmarkError(f"{path}: exists already", "give another name, or --overwrite to replace it") from None
    except OSError as error:
        raise LandmarkError(
            f"{path}: can't be written ({error.strerror})", "give a file in a folder that you can write to"
        ) from None


def pad_text(design: Design, camera: str) -> str:
    """The file's text."""
    landmark, (low, high) = design.landmark, design.spans[0]
    lines = [
        f"# {len(design.specs)} contours, seen from {low:.2f} m to {high:.1f} m through {camera}, designed for "
        f"{design.request.floor_m:g} m to {design.request.ceiling_m:g} m.",
        "# Contours from outside in; area_ratio is over the outermost's area.",
        f'name = "{landmark.name}"',
        f"size_cm = {_cm(landmark.size_m)}",
        f"quiet_zone_cm = {_cm(landmark.quiet_zone_m)}",
    ]
    for spec in design.specs:
        lines += ["", "[[contour]]", f'shape = "{spec.shape.value}"', f"area_ratio = {spec.area_ratio!r}"]
        if spec.offset_forward_m != 0.0:
            lines.append(f"offset_forward_cm = {_cm(spec.offset_forward_m)}")
        if spec.offset_right_m != 0.0:
            lines.append(f"offset_right_cm = {_cm(spec.offset_right_m)}")
    return "\n".join(lines) + "\n"


def _cm(length_m: float) -> str:
    return repr(round(length_m * 100.0, CM_DIGITS))
