"""The files that a calibration leaves: a camera file or a height table, read back before it takes its place."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.calibration.board import Board
from app.calibration.heights import HeightCalibration
from app.calibration.judgement import Check, overall
from app.calibration.lens import LensCalibration
from app.calibration.parameters import NAMES
from app.config import Section, read_config
from app.errors import AlightError, CalibrationError


def check_free(path: Path, overwrite: bool) -> None:
    """See that a file may be written, before hours of work go into it.

    Raises:
        CalibrationError: It is no .toml file, or is there already and must not be replaced.
    """
    if path.suffix != ".toml":
        raise CalibrationError(f"--out {path}: not a .toml file", "give a name that ends in .toml")
    if path.exists() and not overwrite:
        raise CalibrationError(f"--out {path}: is there already", "give another name, or --overwrite")


def write_checked(path: Path, text: str, kind: type[Section]) -> None:
    """Write a file beside its place, read it as the application does, and only then put it there.

    Raises:
        ConfigError: The application would not read it.
        CalibrationError: It can't be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8")
        read_config(part, kind)
        part.replace(path)
    except OSError as fault:
        raise CalibrationError(
            f"{path}: can't be written ({fault.strerror})", "give --out a folder that can be written to"
        ) from None
    except AlightError:
        part.unlink(missing_ok=True)
        raise


def camera_text(calibration: LensCalibration, checks: Sequence[Check], board: Board, origin: str, when: str) -> str:
    """A camera file's content.

    Args:
        calibration: What was fitted.
        checks: Of the judgement.
        board: That was seen.
        origin: What the frames came from, in words.
        when: Date and time.
    """
    fitted = calibration.fitted
    parameters = fitted.parameters
    names = NAMES[fitted.model.name]
    sigmas = ", ".join(
        f"{name} {sigma:.2g}"
        for name, sigma in zip(names, calibration.deviation, strict=True)
        if name not in fitted.model.held
    )
    k = [float(v) for v in parameters[4:]]
    words = {"pinhole": "pinhole: k1 k2 p1 p2 k3", "equidistant": "equidistant (fisheye): k1 k2 k3 k4"}
    return "\n".join(
        [
            *_comment(f"Made by alight calibrate lens, {when}, from {origin}."),
            f"# {board}: {len(calibration.used)} views.",
            f"# Error {fitted.total_rms_px:.3f} px rms; {calibration.held_out_rms_px:.3f} px on views that the fit did "
            "not see.",
            f"# One sigma: {sigmas}.",
            *_judged(checks),
            f'model = "{fitted.model.name}"',
            f"width_px = {fitted.model.size_px[0]}",
            f"height_px = {fitted.model.size_px[1]}",
            f"fx_px = {parameters[0]:.4f}",
            f"fy_px = {parameters[1]:.4f}",
            f"cx_px = {parameters[2]:.4f}",
            f"cy_px = {parameters[3]:.4f}",
            f"# {words[fitted.model.name]}",
            f"distortion = [{', '.join(f'{v:.8f}' for v in k)}]",
            "",
        ]
    )


def height_table_text(
    calibration: HeightCalibration, checks: Sequence[Check], name: str, origin: str, when: str
) -> str:
    """A height table's content; see camera_text."""
    rows = calibration.rows

    def row(values: Sequence[float], digits: int) -> str:
        return f"[{', '.join(f'{v:.{digits}f}' for v in values)}]"

    group = (
        "# L2: not recorded; taken to be L1, as through a perfect lens."
        if calibration.centred_only
        else "# L2: the landmark offset_distance_px (the paper's D) from the middle."
    )
    frames = ", ".join(f"{r.frames[0]}+{r.frames[1]}" for r in rows)
    return "\n".join(
        [
            "# Longest side of the outer triangle (T3) against the camera's height above the landmark.",
            *_comment(f"Made by alight calibrate height, {when}, from {origin}."),
            f"# Frames of each row, centred + offset: {frames}.",
            f"# The lengths speak for a focal length of {calibration.law_focal_px:.1f} px and a zero of the heights "
            f"{100 * calibration.law_zero_m:+.1f} cm off.",
            *_judged(checks),
            f"name = {_quoted(name)}",
            f"heights_m = {row([r.height_m for r in rows], 4)}",
            "# L1: the landmark in the middle of the image.",
            f"centred_px = {row([r.centred_px for r in rows], 3)}",
            group,
            f"offset_px = {row([r.offset_px for r in rows], 3)}",
            f"offset_distance_px = {calibration.offset_distance_px:.2f}",
            "# Side of that triangle on the landmark that was recorded.",
            f"side_m = {calibration.side_m:.6f}",
            "# Focal length of the camera that recorded it.",
            f"focal_px = {calibration.focal_px:.4f}",
            "",
        ]
    )


def _quoted(text: str) -> str:
    """A TOML string."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _comment(text: str, width: int = 110) -> list[str]:
    """Words as comment lines; what a terminal would obey is left out."""
    lines, line = [], "#"
    for word in "".join(c if c.isprintable() else "?" for c in text).split():
        if len(line) + 1 + len(word) > width and line != "#":
            lines.append(line)
            line = "#"
        line += f" {word}"
    return [*lines, line]


def _judged(checks: Sequence[Check]) -> list[str]:
    """The judgement, and every check that is not good."""
    worse = [f"{c.name} {c.figure} ({c.limits})" for c in checks if c.verdict > 0]
    return _comment(f"Judgement: {overall(checks).words}{'; ' if worse else ''}{'; '.join(worse)}.")
