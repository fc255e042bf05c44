"""Scenes for POV-Ray: real blades, stones, objects and sunlight round the printed board, as text in its language.

It owns the geometry of the world; poses and the rules of the sets come from sets.py, the sensor is povray_sensor.py.
World: right, up, forward of the pad, in centimetres, the print at height 0. Greys are linear reflectances; a level
board in the full light of a scene gives KEY times its reflectance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from decoys import MARGIN, Shape, landmark_polygons, nest
from numpy.typing import NDArray
from optics import Optics
from scenes import Scene

Points = NDArray[np.float64]
Rng = np.random.Generator
KEY = 0.3
SIDE_CM = 38.0
BOARD_CM = 1.8
"""Thickness of the board."""
CELL_CM = 100.0
LAYER_CM = 0.004
"""Each layer of ink lies this much above the one below it."""


def xyz(x: float, y: float, z: float) -> str:
    """A vector of the language."""
    return f"<{x:.5f},{y:.5f},{z:.5f}>"


def vector(point: Points) -> str:
    """The same of an array (3,)."""
    return xyz(float(point[0]), float(point[1]), float(point[2]))


def _from_pad(vector: Points) -> Points:
    """Forward, right, down to right, up, forward."""
    return np.array([vector[1], -vector[2], vector[0]], np.float64)


def camera(optics: Optics, scene: Scene) -> str:
    """The lens at its place. A pixel's middle is half a pixel from its border, as in optics.py."""
    rotation, translation = np.asarray(scene.rotation), np.asarray(scene.translation)
    at = _from_pad(-rotation.T @ translation) * 100.0
    right, up, ahead = _from_pad(rotation[0]), _from_pad(-rotation[1]), _from_pad(rotation[2])
    if optics.fisheye:
        # POV-Ray's fisheye is equidistant within a unit circle; 400 px reach to the image's corners.
        angle = 2.0 * math.degrees(400.0 / optics.f)
        return (
            f"camera {{ fisheye location {vector(at)} right {vector(right * 0.8)} up {vector(up * 0.6)} "
            f"direction {vector(ahead)} angle {angle:.8f} }}\n"
        )
    return (
        f"camera {{ perspective location {vector(at)} right {vector(right * 640)} up {vector(up * 480)} "
        f"direction {vector(ahead * optics.f)} }}\n"
    )


def matter(grey: float, more: str = "", finish: str = "") -> str:
    """A texture of one grey."""
    return f"texture {{ pigment {{ rgb {max(grey, 0.0):.4f} }} {more} finish {{ {finish} }} }}"


# --------------------------------------------------------------------------------------------------------- meshes
@dataclass
class Mesh:
    """Triangles with a few greys."""

    greys: Sequence[float]
    triangles: list[str] = field(default_factory=list)

    def add(self, a: Points, b: Points, c: Points, which: int) -> None:
        """One triangle of the grey number `which`."""
        self.triangles.append(f"triangle {{ {vector(a)},{vector(b)},{vector(c)} texture {{ G{which} }} }}")

    def text(self, name: str, finish: str = "") -> str:
        """Declarations of the greys and of the mesh."""
        greys = "".join(
            f"#declare G{k} = texture {{ pigment {{ rgb {grey:.4f} }} finish {{ {finish} }} }}\n"
            for k, grey in enumerate(self.greys)
        )
        return f"{greys}#declare {name} = mesh {{\n" + "\n".join(self.triangles) + "\n}\n"


def _shades(rng: Rng, albedo: float, spread: float, count: int = 6) -> list[float]:
    return [float(np.clip(albedo * rng.lognormal(0, spread), 0.01, 0.9)) for _ in range(count)]


def _strewn(rng: Rng, count: int, hole_cm: float) -> Points:
    """(n, 2) places in the cell about the origin, none in the square hole in its middle."""
    at = rng.uniform(-CELL_CM / 2, CELL_CM / 2, (count, 2))
    return np.asarray(at[np.abs(at).max(axis=1) > hole_cm / 2])


def _blades(rng: Rng, mesh: Mesh, hole_cm: float, floor: float, count: int, tall: tuple[float, float]) -> None:
    for x, z in _strewn(rng, count, hole_cm):
        turn, height, wide = rng.uniform(0, math.tau), rng.uniform(*tall), rng.uniform(0.15, 0.4)
        lean = np.array([math.cos(turn), 0.0, math.sin(turn)]) * rng.uniform(0.1, 1.0) * height
        side = np.array([-math.sin(turn), 0.0, math.cos(turn)]) * wide
        foot = np.array([x, floor, z])
        middle = foot + 0.35 * lean + np.array([0, 0.65 * height, 0])
        tip = foot + lean + np.array([0, height, 0])
        which = int(rng.integers(len(mesh.greys)))
        mesh.add(foot - side, foot + side, middle + 0.7 * side, which)
        mesh.add(foot - side, middle + 0.7 * side, middle - 0.7 * side, which)
        mesh.add(middle - 0.7 * side, middle + 0.7 * side, tip, which)


_OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
_FACES = [(0, 2, 4), (4, 2, 1), (1, 2, 5), (5, 2, 0)]


def _stones(rng: Rng, mesh: Mesh, hole_cm: float, floor: float, count: int, sizes: tuple[float, float]) -> None:
    for x, z in _strewn(rng, count, hole_cm):
        turn = rng.uniform(0, math.tau)
        spin = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
        axes = rng.uniform(*sizes) * np.array([rng.uniform(0.7, 1.3), rng.uniform(0.4, 0.9), rng.uniform(0.7, 1.3)])
        corners = (_OCTAHEDRON * axes * rng.uniform(0.75, 1.2, (6, 1))) @ spin + np.array([x, floor, z])
        which = int(rng.integers(len(mesh.greys)))
        for a, b, c in _FACES:
            mesh.add(corners[a], corners[b], corners[c], which)


def leaf(rng: Rng, mesh: Mesh, at: Points, length: float, flat: float) -> None:
    """A bent leaf of six triangles."""
    turn, tilt = rng.uniform(0, math.tau), rng.normal(0, flat, 2)
    along = np.array([math.cos(turn), tilt[0], math.sin(turn)])
    side = np.array([-math.sin(turn), tilt[1], math.cos(turn)]) * rng.uniform(0.25, 0.45)
    spine = [
        at + length * s * along + np.array([0, 0.15 * length * (0.25 - s * s), 0]) for s in (-0.5, -0.15, 0.2, 0.5)
    ]
    half = [0.0, 0.85, 0.8, 0.0]
    which = int(rng.integers(len(mesh.greys)))
    for k in range(3):
        a, b = spine[k], spine[k + 1]
        left_a, left_b = a - side * length * half[k], b - side * length * half[k + 1]
        right_a, right_b = a + side * length * half[k], b + side * length * half[k + 1]
        mesh.add(left_a, right_b, right_a if k else left_b, which)
        mesh.add(left_a, left_b, right_b, which)


# -------------------------------------------------------------------------------------------------------- grounds
def _everywhere(near: Mesh, far: Mesh, reach_cm: float) -> str:
    """The near cell once, the far cell round it, turned by quarters."""
    n = max(1, math.ceil(reach_cm / CELL_CM - 0.5))
    text = near.text("Near") + far.text("Far") + "object { Near }\n"
    for i in range(-n, n + 1):
        for j in range(-n, n + 1):
            if (i, j) != (0, 0):
                turn, place = 90 * ((i * 3 + j * 5) % 4), xyz(i * CELL_CM, 0, j * CELL_CM)
                text += f"object {{ Far rotate y*{turn} translate {place} }}\n"
    return text


def _plane(floor: float, pigment: str, normal: str = "", finish: str = "") -> str:
    return f"plane {{ y, {floor:.3f} texture {{ pigment {{ {pigment} }} {normal} finish {{ {finish} }} }} }}\n"


def _speckled(grey: float, spread: float, scale: float, pattern: str = "granite") -> str:
    """A pigment with a fine grain, patches of metres, and stains between the two."""
    layers = (
        (pattern, scale, 2.0, spread),
        ("bozo turbulence 0.7", 9.0 * scale + 12.0, 1.0, 0.7),
        ("granite", 380.0, 1.0, 0.6),
    )
    text = "average pigment_map {\n"
    for name, size, weight, width in layers:
        low, high = grey * (1 - width), grey * (1 + width)
        text += f"[{weight} {name} color_map {{ [0 rgb {low:.4f}] [1 rgb {high:.4f}] }} scale {size:.4f}]\n"
    return text + "}"


def _lawn(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    floor = -BOARD_CM - 2.0
    shades = _shades(rng, albedo * 1.6, 0.4)
    near, far = Mesh(shades), Mesh(shades)
    tall = (2.0, float(rng.uniform(3.5, 6.0)))
    _blades(rng, near, hole, floor, 6500, tall)
    _blades(rng, far, 0.0, floor, 4500, tall)
    return _plane(floor, _speckled(albedo * 0.6, 0.5, 9.0)) + _everywhere(near, far, reach)


def _gravel(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    floor = -BOARD_CM - 0.6
    shades = _shades(rng, albedo, 0.35)
    near, far = Mesh(shades), Mesh(shades)
    sizes = (0.5, float(rng.uniform(1.2, 2.6)))
    _stones(rng, near, hole, floor, 5200, sizes)
    _stones(rng, far, 0.0, floor, 4000, sizes)
    return _plane(floor, _speckled(albedo * 0.5, 0.5, 5.0)) + _everywhere(near, far, reach)


def _leaf_litter(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    floor = -BOARD_CM - 0.5
    shades = _shades(rng, albedo * 1.3, 0.6)
    near, far = Mesh(shades), Mesh(shades)
    for mesh, gap in ((near, hole + 4.0), (far, 0.0)):
        for x, z in _strewn(rng, 700, gap):
            leaf(rng, mesh, np.array([x, floor + rng.uniform(0.3, 2.0), z]), float(rng.uniform(3.0, 9.0)), 0.25)
    return _plane(floor, _speckled(albedo * 0.5, 0.6, 7.0)) + _everywhere(near, far, reach)


def _asphalt(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    normal = f"normal {{ granite {rng.uniform(0.3, 0.9):.2f} scale {rng.uniform(1.5, 4):.2f} }}"
    return _plane(
        -BOARD_CM, _speckled(albedo, 0.7, float(rng.uniform(1.0, 3.0))), normal, "specular 0.1 roughness 0.05"
    )


def _concrete(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    normal = f"normal {{ bumps {rng.uniform(0.1, 0.5):.2f} scale {rng.uniform(0.5, 3):.2f} }}"
    text = _plane(-BOARD_CM, _speckled(albedo, 0.25, float(rng.uniform(15, 60)), "agate"), normal)
    step, turn = float(rng.choice([50.0, 120.0, 250.0])), float(rng.uniform(0, 90))
    shift = rng.uniform(-step / 2, step / 2)
    joints = ""
    for k in range(-8, 9):
        at = k * step + shift
        joints += f"box {{ {xyz(at - 0.5, -BOARD_CM, -2500)} {xyz(at + 0.5, -BOARD_CM + 0.02, 2500)} }}\n"
        joints += f"box {{ {xyz(-2500, -BOARD_CM, at - 0.5)} {xyz(2500, -BOARD_CM + 0.02, at + 0.5)} }}\n"
    return text + f"union {{ {joints} {matter(albedo * 0.35)} rotate y*{turn:.2f} }}\n"


def _paving(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    """Bricks or slabs with joints that cast shadows of their own."""
    wide, high = (20.0, 10.0) if rng.random() < 0.5 else (30.0, 30.0)
    near, turn = "", float(rng.uniform(0, 90))
    shades = _shades(rng, albedo, 0.3)
    rows = math.ceil(min(reach, 420.0) / high)
    columns = math.ceil(min(reach, 420.0) / wide)
    for j in range(-rows, rows + 1):
        for i in range(-columns, columns + 1):
            x, z = i * wide + (j % 2) * wide / 2, j * high
            top = -BOARD_CM - abs(float(rng.normal(0, 0.15)))
            corners = f"{xyz(x + 0.4, -5, z + 0.4)} {xyz(x + wide - 0.4, top, z + high - 0.4)}"
            near += f"box {{ {corners} pigment {{ rgb {shades[int(rng.integers(len(shades)))]:.4f} }} }}\n"
    ground = _plane(-BOARD_CM - 1.5, _speckled(albedo * 0.5, 0.5, 4.0))
    return ground + f"union {{ {near} rotate y*{turn:.2f} }}\n"


def _water(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    waves = f"normal {{ bumps {rng.uniform(0.05, 0.4):.3f} scale {rng.uniform(3, 15):.2f} turbulence 0.3 }}"
    finish = (
        f"specular 0.9 roughness 0.003 reflection {{ 0.03, {rng.uniform(0.3, 0.7):.2f} fresnel on }} conserve_energy"
    )
    skin = f"texture {{ pigment {{ rgb {albedo * 0.5:.4f} }} {waves} finish {{ {finish} }} }}"
    return f"plane {{ y, {-BOARD_CM + 0.5:.3f} {skin} interior {{ ior 1.33 }} }}\n"


def _sand(rng: Rng, albedo: float, reach: float, hole: float) -> str:
    normal = (
        f"normal {{ ripples {rng.uniform(0.2, 0.8):.2f} scale {rng.uniform(2, 8):.2f} turbulence 0.4 translate 300*z }}"
    )
    return _plane(-BOARD_CM, _speckled(albedo * 1.4, 0.3, 2.0), normal)


GROUNDS: dict[str, tuple[Callable[[Rng, float, float, float], str], ...]] = {
    "lawn": (_lawn, _lawn, _leaf_litter),
    "asphalt": (_asphalt,),
    "concrete": (_concrete, _paving),
    "gravel": (_gravel, _sand),
    "water": (_water,),
}
"""What stands for each ground of the benchmark."""


# ----------------------------------------------------------------------------------------------------------- board
def board(shapes: Sequence[Shape], scene: Scene, gloss: str) -> str:
    """The board with what is printed on it: black is the scene's ink, white its paper, greys lie between."""
    half = SIDE_CM * MARGIN / 2
    text = f"box {{ {xyz(-half, -BOARD_CM, -half)} {xyz(half, 0, half)} {matter(scene.paper, '', gloss)} }}\n"
    for k, (poly, shade) in enumerate(shapes):
        grey = scene.ink + (scene.paper - scene.ink) * min(max((shade - 0.06) / 0.84, 0.0), 1.0)
        ring = [
            xyz(float(x) * SIDE_CM, LAYER_CM * (k + 1), float(-y) * SIDE_CM) for x, y in np.vstack([poly, poly[:1]])
        ]
        text += f"polygon {{ {len(ring)}, {', '.join(ring)} {matter(grey, '', gloss)} no_shadow }}\n"
    return text


def landmark() -> tuple[Shape, ...]:
    """The paper's, from its own polygons."""
    return nest(landmark_polygons())


def mask_board() -> str:
    """The marker's square as the only thing that shines."""
    half = SIDE_CM / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
    ring = ", ".join(xyz(x, LAYER_CM, z) for x, z in corners)
    shine = "texture { pigment { rgb 1 } finish { ambient 0 diffuse 0 emission 1 } }"
    base = SIDE_CM * MARGIN / 2
    return (
        f"box {{ {xyz(-base, -BOARD_CM, -base)} {xyz(base, 0, base)} {matter(0.0)} }}\n"
        f"polygon {{ 5, {ring} {shine} no_shadow }}\n"
    )
