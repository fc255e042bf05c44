"""Things in POV-Ray's scenes: what throws shadows on the print, what lies on it, what lies about; and the light.

See povray_world.py for the world's axes and units.
"""

from __future__ import annotations

import math

import numpy as np
from decoys import MARGIN
from povray_world import BOARD_CM, KEY, SIDE_CM, Mesh, Points, Rng, leaf, matter, vector, xyz


def sun_direction(elevation: float, azimuth: float) -> Points:
    """(3,) unit vector to the sun; azimuth from forward to the right, radians."""
    flat = math.cos(elevation)
    return np.array([flat * math.sin(azimuth), math.sin(elevation), flat * math.cos(azimuth)])


def mirrored_sun(eye: Points, at: Points) -> Points:
    """(3,) where the sun must stand for the level print to mirror it from `at` into a camera at `eye`."""
    way = (eye - at) / np.linalg.norm(eye - at)
    return np.array([-way[0], way[1], -way[2]])


def lights(sun: Points, share: float, soft_cm: float, haze: float) -> str:
    """Sun and sky: together they give KEY on a level board.

    Args:
        sun: Unit vector to it.
        share: Part of the light that comes from it.
        soft_cm: Radius of its disc, 100 m away: 50 is the real sun's.
        haze: Part of the sky's light that comes from one side.
    """
    text = ""
    if share > 0:
        at, strength = sun * 10000.0, KEY * share / max(float(sun[1]), 0.05)
        across = np.cross(sun, [0.0, 1.0, 0.0])
        across = (
            across / max(float(np.linalg.norm(across)), 1e-6)
            if np.linalg.norm(across) > 1e-6
            else np.array([1.0, 0, 0])
        )
        other = np.cross(sun, across)
        area = (
            f"area_light {vector(across * 2 * soft_cm)}, {vector(other * 2 * soft_cm)}, 3, 3 adaptive 0 circular orient"
        )
        text += f"light_source {{ {vector(at)} rgb {strength:.5f} {area} }}\n"
    sky = KEY * (1 - share)
    side = sun_direction(0.9, math.atan2(float(sun[0]), float(sun[2])) + 2.0) * 10000.0
    text += f"light_source {{ <0,10000,0> rgb {sky * (0.75 - haze):.5f} shadowless }}\n"
    text += f"light_source {{ {vector(side)} rgb {sky * haze / 0.78:.5f} shadowless }}\n"
    return text + f"global_settings {{ ambient_light rgb {sky * 0.25:.5f} }}\n"


def sky(grey: float, cloudy: bool, clear_side: float) -> str:
    """What the horizon and wet surfaces show."""
    low, high = KEY * grey, KEY * grey * clear_side
    pattern = "bozo turbulence 0.6 scale 0.5" if cloudy else "gradient x"
    return f"sky_sphere {{ pigment {{ {pattern} color_map {{ [0.2 rgb {low:.4f}] [0.8 rgb {high:.4f}] }} }} }}\n"


# --------------------------------------------------------------------------------------------------------- casters
CASTERS = ("pole", "person", "branch", "fence", "wall")


def caster(rng: Rng, kind: str, sun: Points, at: Points) -> str:
    """Something that stands toward the sun and throws its shadow over a place (x, z) of the ground."""
    elevation = math.asin(float(sun[1]))
    ahead = np.array([sun[0], sun[2]]) / max(math.hypot(float(sun[0]), float(sun[2])), 1e-6)
    side = np.array([-ahead[1], ahead[0]])
    far = float(rng.uniform(70, 220))
    x, z = at + ahead * far
    needed = far * math.tan(elevation)
    skin = matter(float(rng.uniform(0.05, 0.5)))
    if kind == "pole":
        top = needed + float(rng.uniform(5, 150))
        return f"cylinder {{ {xyz(x, -5, z)}, {xyz(x, top, z)}, {rng.uniform(1.0, 6.0):.3f} {skin} }}\n"
    if kind == "person":
        x, z = at + ahead * min(far, 140.0 / math.tan(elevation))
        arm = side * 32
        parts = (
            f"sphere {{ {xyz(x, 162, z)}, 11 }}",
            f"sphere {{ 0, 1 scale <21, 38, 16> translate {xyz(x, 112, z)} }}",
            f"cylinder {{ {xyz(x - 9, -4, z)}, {xyz(x - 8, 85, z)}, 8 }}",
            f"cylinder {{ {xyz(x + 11, -4, z + 6)}, {xyz(x + 8, 85, z)}, 8 }}",
            f"cylinder {{ {xyz(x, 138, z)}, {xyz(x + arm[0], 90, z + arm[1])}, 4.5 }}",
            f"cylinder {{ {xyz(x, 138, z)}, {xyz(x - arm[0], 88, z - arm[1])}, 4.5 }}",
        )
        return f"union {{ {' '.join(parts)} {skin} }}\n"
    if kind == "branch":
        height = float(rng.uniform(150, 420))
        middle = np.array([at[0], 0, at[1]]) + sun * (height / float(sun[1]))
        leaves = Mesh([float(rng.uniform(0.05, 0.3)) for _ in range(4)])
        spread = float(rng.uniform(40, 110))
        for _ in range(int(rng.integers(60, 260))):
            place = middle + rng.normal(0, 1, 3) * np.array([spread, 0.35 * spread, spread]) * 0.5
            leaf(rng, leaves, place, float(rng.uniform(6, 16)), 0.5)
        text = leaves.text("Leaves") + "object { Leaves }\n"
        for _ in range(7):
            end = middle + rng.normal(0, 1, 3) * np.array([spread, 0.3 * spread, spread])
            text += f"cylinder {{ {vector(middle)}, {vector(end)}, {rng.uniform(0.4, 2.0):.3f} {skin} }}\n"
        return text
    if kind == "fence":
        gap, top = float(rng.uniform(7, 16)), needed + float(rng.uniform(20, 60))
        bars = "".join(
            f"cylinder {{ {xyz(x + side[0] * k * gap, -5, z + side[1] * k * gap)}, "
            f"{xyz(x + side[0] * k * gap, top, z + side[1] * k * gap)}, 0.9 }}\n"
            for k in range(-14, 15)
        )
        return f"union {{ {bars} {skin} }}\n"
    turn = math.degrees(math.atan2(float(ahead[0]), float(ahead[1])))
    wide = (-400, 400) if rng.random() < 0.6 else (0, 400)
    # Its top edge's shadow, or its end's, falls on the place.
    body = f"box {{ <{wide[0]}, -5, 0> <{wide[1]}, {needed + (0 if wide[0] else 120):.3f}, 15> }}"
    return f"object {{ {body} {skin} rotate y*{turn:.3f} translate {xyz(x, 0, z)} }}\n"


# ---------------------------------------------------------------------------------------------------------- covers
COVERS = ("leaves", "stones", "stick", "rope", "shoe", "sand", "paper", "tuft")


def cover(rng: Rng, kind: str) -> str:
    """Something that lies on the print, of a size to hide some hundredths to a quarter of it."""
    half = SIDE_CM / 2
    x, z = (float(v) for v in rng.uniform(-half, half, 2))
    grey = float(rng.choice([rng.uniform(0.03, 0.15), rng.uniform(0.15, 0.5), rng.uniform(0.6, 0.9)]))
    skin, turn = matter(grey), float(rng.uniform(0, 360))
    if kind == "leaves":
        mesh = Mesh([float(rng.uniform(0.04, 0.5)) for _ in range(4)])
        for _ in range(int(rng.integers(1, 9))):
            at = np.array([*rng.uniform(-half, half, 2), 0.0])
            leaf(rng, mesh, np.array([at[0], rng.uniform(0.5, 1.5), at[1]]), float(rng.uniform(6, 16)), 0.1)
        return mesh.text("Fallen") + "object { Fallen }\n"
    if kind == "stones":
        text = ""
        for _ in range(int(rng.integers(1, 6))):
            a, b = (float(v) for v in rng.uniform(-half, half, 2))
            size = rng.uniform(1.5, 5.5, 3) * np.array([1, 0.6, 1])
            place = xyz(a, 0.5 * float(size[1]), b)
            text += f"sphere {{ 0, 1 scale {vector(size)} rotate y*{turn:.1f} translate {place} {skin} }}\n"
        return text
    if kind == "stick":
        reach, radius = float(rng.uniform(12, 40)), float(rng.uniform(0.5, 2.2))
        stick = f"cylinder {{ <{-reach}, {radius}, 0>, <{reach}, {radius * 1.6:.3f}, 0>, {radius:.3f} {skin} "
        return stick + f"rotate y*{turn:.1f} translate {xyz(x * 0.6, 0, z * 0.6)} }}\n"
    if kind == "rope":
        steps = np.cumsum(rng.normal(0, 9, (9, 2)), axis=0) + rng.uniform(-10, 10, 2) - 5
        radius = float(rng.uniform(0.4, 1.3))
        points = ", ".join(f"{xyz(a, radius, b)}, {radius:.3f}" for a, b in steps)
        return f"sphere_sweep {{ b_spline 9, {points} tolerance 0.01 {skin} }}\n"
    if kind == "shoe":
        sole = "sphere { 0, 1 scale <4.6, 4, 8> translate <0, 2, 7> }"
        sole += " sphere { 0, 1 scale <3.6, 5, 6> translate <0, 3, -6> }"
        leg = "cylinder { <0, 3, -7>, <0, 30, -9>, 4.2 }"
        return f"union {{ {sole} {leg} {skin} rotate y*{turn:.1f} translate {xyz(x, 0, z)} }}\n"
    if kind == "sand":
        text = ""
        for _ in range(int(rng.integers(60, 260))):
            a, b = rng.normal(0, rng.uniform(2, 6), 2) + np.array([x, z])
            text += f"sphere {{ 0, {rng.uniform(0.2, 1.0):.3f} scale <1, 0.5, 1> translate {xyz(a, 0.1, b)} }}\n"
        return f"union {{ {text} {skin} }}\n"
    if kind == "paper":
        wide, long = (float(v) for v in rng.uniform(6, 22, 2))
        sheet = f"box {{ <{-wide / 2}, 0.1, {-long / 2}> <{wide / 2}, 0.15, {long / 2}> {skin} "
        return sheet + f"rotate x*{rng.uniform(-3, 3):.2f} rotate y*{turn:.1f} translate {xyz(x, 0.4, z)} }}\n"
    mesh = Mesh([float(rng.uniform(0.04, 0.2)) for _ in range(4)])
    for _ in range(int(rng.integers(15, 70))):
        root = np.array([x, 0.0, z]) + np.array([rng.normal(0, 3), 0, rng.normal(0, 3)])
        a = rng.uniform(0, math.tau)
        out = np.array([math.cos(a), 0, math.sin(a)]) * rng.uniform(3, 14)
        side = np.array([-math.sin(a), 0, math.cos(a)]) * rng.uniform(0.15, 0.4)
        mesh.add(root - side, root + side, root + out + np.array([0, rng.uniform(2, 9), 0]), int(rng.integers(4)))
    return mesh.text("Tuft") + "object { Tuft }\n"


# --------------------------------------------------------------------------------------------------------- clutter
def clutter(rng: Rng, count: int, reach_cm: float) -> str:
    """Things that lie about the board and never on it."""
    text, clear = "", SIDE_CM * MARGIN * 0.75
    for _ in range(count):
        away, a = float(rng.uniform(clear + 8, max(reach_cm, clear + 40))), float(rng.uniform(0, math.tau))
        x, z, turn = away * math.cos(a), away * math.sin(a), float(rng.uniform(0, 360))
        size = float(min(np.exp(rng.uniform(math.log(3), math.log(35))), away - clear))
        skin = matter(float(rng.choice([rng.uniform(0.03, 0.12), rng.uniform(0.1, 0.5), rng.uniform(0.6, 0.9)])))
        where = f"rotate y*{turn:.1f} translate {xyz(x, -BOARD_CM, z)}"
        which = int(rng.integers(6))
        if which == 0:
            half, top = size / 2, float(rng.uniform(1, size))
            text += f"box {{ <{-half}, -2, {-half}> <{half}, {top:.3f}, {half}> {skin} {where} }}\n"
        elif which == 1:
            text += f"sphere {{ <0, {size * 0.3:.3f}, 0>, {size * 0.4:.3f} {skin} {where} }}\n"
        elif which == 2:
            text += f"box {{ <{-size}, -2, -3> <{size}, 2, 3> {skin} {where} }}\n"
        elif which == 3:  # a sheet with a black frame and something in it
            inner = size * float(rng.uniform(0.25, 0.4))
            text += (
                f"union {{ box {{ <{-size * 0.6}, 0, {-size * 0.6}> <{size * 0.6}, 0.5, {size * 0.6}> {matter(0.8)} }} "
            )
            text += f"box {{ <{-size / 2}, 0, {-size / 2}> <{size / 2}, 0.52, {size / 2}> {matter(0.05)} }} "
            text += f"box {{ <{-inner}, 0, {-inner}> <{inner}, 0.54, {inner}> {matter(0.8)} }} "
            text += f"cylinder {{ 0, <0, 0.56, 0>, {inner * 0.5:.3f} {matter(0.05)} }} {where} }}\n"
        elif which == 4:
            text += f"cylinder {{ 0, <0, {rng.uniform(0.5, size):.3f}, 0>, {size * 0.4:.3f} {skin} {where} }}\n"
        else:
            text += f"torus {{ {size * 0.5:.3f}, {size * 0.08:.3f} {skin} {where} }}\n"
    return text
