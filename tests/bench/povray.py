"""A second renderer for a set that nobody looks at while tuning: POV-Ray, with ground, objects and shadows in 3D.

    python tests/bench/povray.py FOLDER [--count 600] [--seed 1] [--check]

Poses, lenses and the rules of the sets are sets.py's own, from numbers that no other set uses; everything that is seen
is drawn by POV-Ray (`apt-get install povray`) and exposed by povray_sensor.py. The folder gets one PNG a frame and
truth.json; frames that are there already are kept. How much of the marker is hidden is measured, by a second picture
in which only the marker shines. `--check` renders points of known place instead and compares.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
import tempfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import decoy_nests  # noqa: F401  (enters its kinds)
import numpy as np
import povray_objects as things
import sets
from decoys import KINDS, MARGIN, OPTICS_PX, Family, Shape, make_print
from numpy.typing import NDArray
from optics import HEIGHT, WIDTH, Optics, lens
from povray_sensor import sense
from povray_world import GROUNDS, SIDE_CM, board, camera, landmark, mask_board
from prints import SIDE_M
from rich.console import Console
from rich.progress import Progress
from scenes import Scene, Truth

Plane = NDArray[np.float32]
FIRST = 100_000
"""Number of the first case in sets.py: no other set goes that far."""
SHARES = {
    "heights-A": 0.12,
    "heights-B": 0.12,
    "cone": 0.24,
    "hard-A": 0.21,
    "hard-B": 0.21,
    "none-A": 0.05,
    "none-B": 0.05,
}
HEADER = "#version 3.7;\nglobal_settings { assumed_gamma 1 max_trace_level 4 }\n"
COVERED = (0.03, 0.25)
STRAY_COVER = 0.03
"""A frame whose kind is not "covered" may have this part of the marker hidden, by a blade of grass or a twig."""
STREWN = ("lawn", "gravel", "leaf litter")
TRIES = 25
HIDING = ("glare", "cut", "motion", "closeup")
"""Kinds in which a decoy could lose what tells it from the landmark."""


class PovrayError(Exception):
    """POV-Ray is missing or refused a scene; its text says what to do."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """One case as text.

    Attributes:
        scene: Pose and sensor.
        truth: Where the marker is.
        kind: Height, band of the cone, hardship, "none".
        text: Camera, light, world and board in POV-Ray's language.
        mask: The same with the marker alone shining; "" where there is no marker.
        ground: What lies round it.
    """

    scene: Scene
    truth: Truth
    kind: str
    text: str
    mask: str
    ground: str


# ------------------------------------------------------------------------------------------------------- rendering
def trace(text: str, smooth: int, window: tuple[int, int, int, int] | None = None, threshold: float = 0.05) -> Plane:
    """(HEIGHT, WIDTH) linear light of a scene.

    Args:
        text: The scene.
        smooth: Samples per pixel and direction where neighbours differ; 0: one a pixel.
        threshold: How much neighbours must differ for that; a white board is 0.3.
        window: (left, top, right, bottom) pixels to render, half open; all by default. The rest is 0.

    Raises:
        PovrayError: It is not installed, or refuses the scene.
    """
    program = shutil.which("povray")
    if program is None:
        raise PovrayError("povray is not on this machine: apt-get install povray")
    with tempfile.TemporaryDirectory() as scratch:
        source, out = Path(scratch) / "scene.pov", Path(scratch) / "out.png"
        source.write_text(text)
        command = [program, f"+I{source}", f"+O{out}", f"+W{WIDTH}", f"+H{HEIGHT}", "+FN16", "+WT1", "-J"]
        command += ["Grayscale_Output=true", "File_Gamma=1", "Display=off", "Verbose=off"]
        command += [f"+A{threshold}", "+AM1", f"+R{smooth}"] if smooth else ["-A"]
        if window is not None:
            left, top, right, bottom = window
            command += [f"+SC{left + 1}", f"+EC{right}", f"+SR{top + 1}", f"+ER{bottom}"]
        done = subprocess.run(command, capture_output=True, text=True, cwd=scratch, check=False)
        picture = cv2.imread(str(out), cv2.IMREAD_UNCHANGED) if out.exists() else None
        if done.returncode or picture is None:
            lines = [line for line in done.stderr.splitlines() if line.strip()]
            raise PovrayError("povray refused a scene: " + " | ".join(lines[-6:]))
    if picture.ndim == 3:
        picture = picture[..., 0]
    light = np.zeros((HEIGHT, WIDTH), np.float32)
    if window is None or picture.shape == (HEIGHT, WIDTH):
        light[:] = picture.astype(np.float32) / 65535
        if window is not None:
            kept = np.zeros_like(light)
            kept[window[1] : window[3], window[0] : window[2]] = light[window[1] : window[3], window[0] : window[2]]
            return kept
    else:
        light[window[1] : window[3], window[0] : window[2]] = picture.astype(np.float32) / 65535
    return light


def _window(drawn: Drawn, side_m: float, rim: int) -> tuple[int, int, int, int] | None:
    """The part of the image that can show a square of this side about the pad's middle; None if none."""
    steps = np.linspace(-side_m / 2, side_m / 2, 41)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))]) @ drawn.truth.rotation.T + drawn.truth.translation
    px = lens(drawn.scene.lens).project(points)
    px = px[np.isfinite(px).all(axis=1)]
    if not len(px):
        return None
    low = np.maximum(np.floor(px.min(axis=0)).astype(int) - rim, 0)
    high = np.minimum(np.ceil(px.max(axis=0)).astype(int) + rim + 1, [WIDTH, HEIGHT])
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1])) if (high > low + 1).all() else None


def _marker_area(optics: Optics, seen: Truth) -> float:
    """Pixels of the image that show the marker if nothing hides it."""
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = optics.rays(np.stack([u, v], axis=-1).reshape(-1, 2)) @ seen.rotation
    eye = -seen.rotation.T @ seen.translation
    down = rays[:, 2]
    reach = np.where(down > 1e-6, -eye[2] / np.where(down > 1e-6, down, 1.0), np.inf)
    at = eye[:2] + rays[:, :2] * np.where(np.isfinite(reach), reach, 1e9)[:, None]
    return float(np.count_nonzero((np.abs(at) <= SIDE_M / 2).all(axis=1)))


def hidden_part(drawn: Drawn) -> float:
    """Part of the marker in the image that something lies over or stands before."""
    window = _window(drawn, SIDE_M, 1)
    if window is None:
        return 0.0
    whole = _marker_area(lens(drawn.scene.lens), drawn.truth)
    shining = float(np.count_nonzero(trace(drawn.mask, 0, window) > 0.5))
    return max(0.0, 1.0 - shining / max(whole, 1.0))


def light_of(drawn: Drawn) -> Plane:
    """The whole picture, and the board in it again with more samples: its edges are what is measured."""
    # Blades and stones are finer than a pixel: smoothing them costs four times as much and shows nothing.
    light = trace(drawn.text, 0 if drawn.ground in STREWN else 2, threshold=0.1)
    window = _window(drawn, SIDE_M * MARGIN, 3)
    if window is not None:
        left, top, right, bottom = window
        fine = trace(drawn.text, 4 if (right - left) * (bottom - top) < 60_000 else 3, window)
        light[top:bottom, left:right] = fine[top:bottom, left:right]
    return light


# --------------------------------------------------------------------------------------------------------- drawing
def _sun(rng: np.random.Generator, scene: Scene, kind: str) -> tuple[NDArray[np.float64], float, str]:
    """Direction to the sun, its part of the light, and the gloss of the print."""
    eye_pad = -np.asarray(scene.rotation).T @ np.asarray(scene.translation)
    eye = np.array([eye_pad[1], -eye_pad[2], eye_pad[0]]) * 100
    azimuth = float(rng.uniform(0, math.tau))
    name = scene.light.name
    if kind == "glare" or name == "glare":
        reach = 14.0 if kind == "glare" else 60.0
        at = np.array([rng.uniform(-reach, reach), 0.0, rng.uniform(-reach, reach)])
        sun = things.mirrored_sun(eye, at)
        gloss = f"specular {rng.uniform(0.3, 1.2):.3f} roughness {np.exp(rng.uniform(-6.0, -3.5)):.5f}"
        return sun, float(rng.uniform(0.4, 0.75)), gloss
    if kind == "wet" or name == "wet":
        gloss = f"reflection {{ {rng.uniform(0.15, 0.6):.3f} }}"
        return things.sun_direction(0.9, azimuth), float(rng.uniform(0.0, 0.2)), gloss
    low, high, least, most = {
        "noon": (0.8, 1.35, 0.6, 0.8),
        "shadow": (0.4, 1.1, 0.55, 0.85),
        "low sun": (0.2, 0.55, 0.5, 0.75),
        "overcast": (0.9, 1.2, 0.0, 0.12),
        "dusk": (0.2, 0.5, 0.0, 0.2),
    }[name]
    gloss = f"specular {rng.uniform(0, 0.1):.3f} roughness 0.05"
    return things.sun_direction(float(rng.uniform(low, high)), azimuth), float(rng.uniform(least, most)), gloss


def _printed(rng: np.random.Generator, scene: Scene, seen: Truth, kind: str) -> tuple[Shape, ...] | None:
    """What is on the board; None: no board. A decoy is shown only where the image can tell it from the landmark."""
    if kind != "none":
        return landmark()
    room = 1.3 * max(1.0, math.hypot(scene.blur_px, math.hypot(*scene.motion_px) / math.sqrt(12)) / OPTICS_PX)
    names = [name for name, (family, _) in KINDS.items() if family in (Family.NEAR, Family.INNERMOST)]
    for _ in range(20):
        name, variant = names[int(rng.integers(len(names)))], int(rng.integers(100, 10_000))
        if seen.side_px >= room * make_print(name, variant).least_side_px:
            source = np.random.default_rng((sum(map(ord, name)), len(name), variant))
            shapes = KINDS[name][1](source).shapes
            reach = max(float(np.abs(poly).max()) for poly, _ in shapes)
            return tuple((poly * min(1.0, 0.5 * MARGIN / reach), shade) for poly, shade in shapes)
    return None


def draw(set_name: str, index: int, seed: int) -> Drawn:
    """One case of the set, as text; the same for the same numbers.

    Raises:
        PovrayError: Nothing fits the kind's rule, or POV-Ray is missing.
    """
    none = set_name.startswith("none")
    for attempt in range(TRIES):
        rng = np.random.default_rng((zlib.crc32(set_name.encode()), index, seed, attempt))
        number = FIRST + seed * 10_000 + index + 1000 * attempt * len(sets.HARD_KINDS) * 24
        if none:  # any kind will do
            number = FIRST + seed * 10_000 + 5000 + TRIES * index + attempt
        case = sets.draw(f"hard-{set_name[-1]}" if none else set_name, number, unseen=True)
        if none and (case.kind in HIDING or case.truth.visible < 1.0):
            continue
        kind = "none" if none else case.kind
        scene, seen = case.scene, case.truth
        drawn = _compose(rng, scene, seen, kind)
        if none:
            return drawn
        hidden = hidden_part(drawn)
        low, high = COVERED if kind == "covered" else (0.0, STRAY_COVER)
        if low <= hidden <= high:
            return drawn
    raise PovrayError(f"{set_name} {index}: nothing drawn hides what its kind may hide, in {TRIES} tries")


def _compose(rng: np.random.Generator, scene: Scene, seen: Truth, kind: str) -> Drawn:
    sun, share, gloss = _sun(rng, scene, kind)
    if kind == "glare":
        scene = replace(scene, light=replace(scene.light, name="glare"))
    reach = float(np.clip(250.0 * seen.height, 100.0, 700.0))
    options = GROUNDS[scene.ground]
    maker = options[int(rng.integers(len(options)))]
    world = maker(rng, scene.albedo, reach, SIDE_CM * MARGIN + 1.0)
    if scene.litter_count:
        world += things.clutter(rng, min(scene.litter_count, 16), min(reach, 250.0))
    if kind == "shadow" or (share > 0.4 and kind not in ("glare", "covered") and rng.random() < 0.35):
        near = 14.0 if kind == "shadow" else 60.0
        at = rng.uniform(-near, near, 2)
        world += things.caster(rng, str(rng.choice(things.CASTERS)), sun, at)
    if kind == "covered":
        world += things.cover(rng, str(rng.choice(things.COVERS)))
    printed = _printed(rng, scene, seen, kind)
    eye = camera(lens(scene.lens), scene)
    soft = float(np.exp(rng.uniform(math.log(40), math.log(250))))
    light = things.lights(sun, share, soft, float(rng.uniform(0.0, 0.4)))
    light += things.sky(scene.sky, bool(rng.random() < 0.5), float(rng.uniform(1.0, 2.5)))
    plate = board(printed, scene, gloss) if printed is not None else ""
    mask = HEADER + eye + "global_settings { ambient_light 0 }\n" + world + mask_board()
    name = maker.__name__.strip("_").replace("_", " ")
    return Drawn(scene, seen, kind, HEADER + eye + light + world + plate, mask if kind != "none" else "", name)


# ---------------------------------------------------------------------------------------------------------- a set
def cases(count: int) -> list[tuple[str, int]]:
    """Set names and numbers in them, about `count` in the proportions of SHARES, the sets in turn."""
    sizes = {name: max(1, round(share * count)) for name, share in SHARES.items()}
    return sorted(((name, k) for name in sizes for k in range(sizes[name])), key=lambda case: case[1] / sizes[case[0]])


def _record(set_name: str, index: int, drawn: Drawn, hidden: float, file: str) -> dict[str, Any]:
    seen, scene = drawn.truth, drawn.scene
    none = drawn.kind == "none"
    return {
        "file": file,
        "set": set_name,
        "index": index,
        "kind": drawn.kind,
        "lens": scene.lens,
        "marker": not none,
        "rotation": np.asarray(seen.rotation).tolist(),
        "translation": np.asarray(seen.translation).tolist(),
        "corners_px": None if none else [[None if math.isnan(x) else x for x in c] for c in seen.corners_px.tolist()],
        "side_px": seen.side_px,
        "visible": seen.visible,
        "hidden": hidden,
        "height": seen.height,
        "light": scene.light.name,
        "ground": drawn.ground,
    }


def make(folder: Path, count: int, seed: int, console: Console) -> int:
    """Render what is missing of a set into a folder.

    Raises:
        PovrayError: POV-Ray is missing or refuses a scene.
    """
    folder.mkdir(parents=True, exist_ok=True)
    listing = folder / "truth.json"
    records: dict[str, dict[str, Any]] = {}
    if listing.exists():
        records = {record["file"]: record for record in json.loads(listing.read_text())["frames"]}
    todo = cases(count)
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("frames by POV-Ray", total=len(todo))
        for set_name, index in todo:
            file = f"{set_name}-{seed}-{index:04d}.png"
            if file not in records or not (folder / file).exists():
                drawn = draw(set_name, index, seed)
                hidden = hidden_part(drawn) if drawn.mask else 0.0
                source = np.random.default_rng((zlib.crc32(file.encode()), seed))
                image = sense(light_of(drawn), drawn.scene, source)
                if not cv2.imwrite(str(folder / file), image):
                    raise PovrayError(f"can't write {folder / file}")
                records[file] = _record(set_name, index, drawn, round(hidden, 4), file)
                part = listing.with_suffix(".part")
                part.write_text(json.dumps({"renderer": "POV-Ray", "frames": list(records.values())}, indent=1) + "\n")
                part.replace(listing)
            progress.advance(bar)
    return len(records)


def check() -> float:
    """Largest error in pixels of points of known place, through both lenses."""
    worst = 0.0
    for name in ("A", "B"):
        case = sets.draw(f"hard-{name}", 4)
        optics, scene = lens(name), case.scene
        grid = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)
        grid *= case.truth.height
        pad = np.column_stack([grid, np.zeros(len(grid))])
        px = optics.project(pad @ np.asarray(scene.rotation).T + np.asarray(scene.translation))
        radius = 100 * 2.5 * case.truth.height / optics.f
        text = HEADER + camera(optics, scene)
        for point in pad:
            shine = "pigment { rgb 1 } finish { ambient 0 diffuse 0 emission 1 }"
            text += f"sphere {{ <{100 * point[1]}, 0, {100 * point[0]}>, {radius} {shine} }}\n"
        light = trace(text, 6)
        for u, v in px:
            if not (8 < u < WIDTH - 9 and 8 < v < HEIGHT - 9):
                continue
            column, row = round(u), round(v)
            part = light[row - 6 : row + 7, column - 6 : column + 7]
            rows, columns = np.mgrid[row - 6 : row + 7, column - 6 : column + 7]
            at = (float((part * columns).sum() / part.sum()), float((part * rows).sum() / part.sum()))
            worst = max(worst, math.dist(at, (u, v)))
    return worst


def main() -> int:
    """Make a set, or check the geometry."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="where the frames go")
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--check", action="store_true", help="render points of known place and compare")
    arguments = parser.parse_args()
    console = Console()
    if arguments.folder is None and not arguments.check:
        parser.error("name a folder, or give --check")
    try:
        if arguments.check:
            console.print(f"points fall where they should to {check():.3f} px", markup=False)
        if arguments.folder is not None:
            made = make(arguments.folder, arguments.count, arguments.seed, console)
            console.print(f"{made} frames and truth.json in {arguments.folder}", markup=False)
    except PovrayError as fault:
        console.print(str(fault), markup=False)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
