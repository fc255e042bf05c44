"""The sets of single frames: how each is drawn from its seed.

Every case has a seed of its own, made of the set's name, its part and its number, so a set of 100 begins with the same
frames as one of 200. The parts: "tuning", which may be looked at, and "unseen", which no one looks at while tuning;
they share no seed, no texture of the ground and no cover.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from grounds import GROUNDS
from optics import CENTRE, HEIGHT, WIDTH, Array
from prints import SIDE_M
from scenes import (
    Glare,
    Light,
    Scene,
    Shadow,
    Truth,
    attitude,
    shake_for,
    translation_at,
    truth,
)

Rng = np.random.Generator

HEIGHTS_M = tuple(float(h) for h in np.geomspace(0.1, 12.0, 24))
HARD_KINDS = ("shadow", "glare", "covered", "cut", "motion", "closeup", "small", "dusk", "exposure", "wet")
LIGHTS = ("noon", "low sun", "overcast", "dusk", "glare")
TEXTURES = 4
"""Variants of each ground in each part."""
HEIGHTS_INCIDENCE_RAD = math.radians(45.0)
"""A fisheye sees the ground up to 85 degrees from its axis, where a flat print is a line. Heights are drawn up to here,
which is the slope of the paper's cone."""
HARD_INCIDENCE_RAD = math.radians(60.0)


@dataclass(frozen=True)
class Drawn:
    """One case before it is rendered."""

    set_name: str
    index: int
    kind: str
    scene: Scene
    truth: Truth


class ImpossibleError(Exception):
    """A draw that breaks its set's rule; it is drawn anew."""


def _uniform(rng: Rng, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def _log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _light(rng: Rng, name: str, height: float) -> Light:
    """Ordinary light of a kind; shadows and glare may lie anywhere that is in view."""
    reach = 0.6 * height + 0.3
    slope = (_uniform(rng, -0.1, 0.1) / reach, _uniform(rng, -0.1, 0.1) / reach)
    if name == "overcast":
        return Light(name, 0.1, slope)
    if name == "dusk":
        return Light(name, 0.0, (slope[0] * 3, slope[1] * 3))
    shadows: list[Shadow] = []
    if rng.random() < (0.5 if name == "low sun" else 0.3):
        shadows.append(
            Shadow(
                str(rng.choice(["edge", "band"])),
                _uniform(rng, 0, 2 * math.pi),
                _uniform(rng, -reach, reach),
                _log_uniform(rng, 0.05, 0.6),
                _log_uniform(rng, 0.003, 0.08),
            )
        )
    glares: list[Glare] = []
    if name == "glare":
        for _ in range(int(rng.integers(1, 3))):
            size = _log_uniform(rng, 0.05, 0.3) * (0.5 + height)
            glares.append(
                Glare(
                    _uniform(rng, -reach, reach),
                    _uniform(rng, -reach, reach),
                    size,
                    size * _uniform(rng, 0.2, 1.0),
                    _uniform(rng, 0, math.pi),
                    _log_uniform(rng, 0.4, 4.0),
                )
            )
    sun = {"noon": _uniform(rng, 0.6, 0.8), "low sun": _uniform(rng, 0.5, 0.8), "glare": _uniform(rng, 0.3, 0.7)}[name]
    factor = 2.0 if name == "low sun" else 1.0
    return Light(name, sun, (slope[0] * factor, slope[1] * factor), tuple(shadows), tuple(glares))


def _scene(rng: Rng, lens_name: str, rotation: Array, translation: Array, unseen: bool, light: str = "") -> Scene:
    """Everything but the pose, as ordinary as a day outdoors."""
    height = float(rotation[:, 2] @ translation)
    name = light or str(rng.choice(LIGHTS))
    dusk = name == "dusk"
    kind = str(rng.choice(GROUNDS))
    albedo = {"lawn": (0.06, 0.2), "asphalt": (0.06, 0.2), "concrete": (0.25, 0.5), "gravel": (0.15, 0.4)}
    paper = _uniform(rng, 0.65, 0.9)
    clutter = rng.random() < 0.35
    motion = _uniform(rng, 0.0, 1.5) if rng.random() < 0.8 else _uniform(rng, 1.5, 4.0)
    angle = _uniform(rng, 0, 2 * math.pi)
    motion_px = (motion * math.cos(angle), motion * math.sin(angle))
    shake = shake_for(lens_name, translation, motion_px, _uniform(rng, -0.01, 0.01) * motion)
    return Scene(
        seed=int(rng.integers(1 << 40)),
        noise_seed=int(rng.integers(1 << 40)),
        lens=lens_name,
        rotation=rotation,
        translation=translation,
        light=_light(rng, name, height),
        ground=kind,
        ground_variant=int(rng.integers(TEXTURES)) + (TEXTURES if unseen else 0),
        ground_shift=(_uniform(rng, -20, 20), _uniform(rng, -20, 20)),
        ground_turn=_uniform(rng, 0, 2 * math.pi),
        albedo=_uniform(rng, *albedo.get(kind, (0.03, 0.12))),
        motion_px=motion_px,
        shake=(float(shake[0]), float(shake[1]), float(shake[2])),
        litter_count=int(rng.integers(8, 50)) if clutter else 0,
        litter_span=float(np.clip(2.2 * height, 1.8, 14.0)),
        paper=paper,
        ink=_uniform(rng, 0.03, 0.09),
        board_shadow=(_uniform(rng, -0.02, 0.02), _uniform(rng, -0.02, 0.02)),
        sky=_uniform(rng, 0.3, 0.9),
        blur_px=_uniform(rng, 0.4, 1.5),
        veil=_uniform(rng, 0.0, 0.06 if name == "glare" else 0.02),
        vignette=_uniform(rng, 0.05, 0.4),
        meter=_uniform(rng, 0.1, 0.9),
        exposure=_log_uniform(rng, 0.35, 0.8) if dusk else _log_uniform(rng, 0.5, 2.0),
        gamma=_uniform(rng, 1.6, 2.4),
        black_level=_uniform(rng, 0, 12),
        noise=_uniform(rng, 3.0, 6.0) if dusk else _log_uniform(rng, 1.0, 6.0),
        noise_grain=_uniform(rng, 0.2, 0.8),
        jpeg=int(rng.integers(60, 96)) if rng.random() < 0.2 else None,
    )


def _pose(rng: Rng, tilt_max_deg: float) -> Array:
    tilt = math.radians(_uniform(rng, 0.0, tilt_max_deg))
    return attitude(tilt, _uniform(rng, 0, 2 * math.pi), _uniform(rng, 0, 2 * math.pi))


def _incidence(rotation: Array, translation: Array) -> float:
    """Angle between the line of sight to the pad's middle and the plane's normal."""
    return math.acos(float(rotation[:, 2] @ translation) / float(np.linalg.norm(translation)))


def _pixel(rng: Rng) -> Array:
    return np.array([_uniform(rng, 0, WIDTH - 1), _uniform(rng, 0, HEIGHT - 1)])


def _at_pixel(rng: Rng, lens_name: str, rotation: Array, height: float, px: Array) -> Array:
    translation = translation_at(lens_name, rotation, px, height)
    if translation is None or _incidence(rotation, translation) > HEIGHTS_INCIDENCE_RAD:
        raise ImpossibleError
    return translation


def _heights(rng: Rng, lens_name: str, index: int, unseen: bool) -> tuple[Scene, str]:
    """Rule: the pad's middle is seen at any pixel of the image or, every other time round the heights, of its middle
    half in each direction; at most 45 degrees off the vertical; tilt up to 10 degrees."""
    height = HEIGHTS_M[index % len(HEIGHTS_M)]
    part = 0.5 if index // len(HEIGHTS_M) % 2 else 1.0
    rotation = _pose(rng, 10.0)
    px = CENTRE + part * (_pixel(rng) - CENTRE)
    translation = _at_pixel(rng, lens_name, rotation, height, px)
    return _scene(rng, lens_name, rotation, translation, unseen), f"{height:.2f} m"


def _cone(rng: Rng, lens_name: str, _index: int, unseen: bool) -> tuple[Scene, str]:
    """Rule: any place in the volume of the cone of 3 m height and 6 m diameter over the pad, evenly, from 0.3 m up;
    tilt up to 10 degrees; drawn anew where a part of the outer square is out of the image."""
    height = 3.0 * rng.random() ** (1 / 3)
    if height < 0.3:
        raise ImpossibleError
    rotation = _pose(rng, 10.0)
    radius, angle = height * math.sqrt(rng.random()), _uniform(rng, 0, 2 * math.pi)
    eye = np.array([radius * math.cos(angle), radius * math.sin(angle), -height])
    translation = -rotation @ eye
    if truth(lens_name, rotation, translation).visible < 1.0:
        raise ImpossibleError
    band = min(int(height), 2)
    return _scene(rng, lens_name, rotation, translation, unseen), f"{max(0.3, band):g}..{band + 1} m"


def _hard_pose(rng: Rng, lens_name: str, sides_px: tuple[float, float], inside: bool = True) -> tuple[Array, Array]:
    """Any place in the image, tilt up to 25 degrees; the side as it would be seen on the axis, face on."""
    focal = 215.0 if lens_name == "A" else 495.0
    rotation = _pose(rng, 25.0)
    away = focal * SIDE_M / _log_uniform(rng, *sides_px)
    px = _pixel(rng)
    probe = translation_at(lens_name, rotation, px, 1.0)
    if probe is None:
        raise ImpossibleError
    translation = np.asarray(probe * away / np.linalg.norm(probe))
    if _incidence(rotation, translation) > HARD_INCIDENCE_RAD:
        raise ImpossibleError
    if inside and truth(lens_name, rotation, translation).visible < 1.0:
        raise ImpossibleError
    return rotation, translation


def _ordinary(rng: Rng, lens_name: str, unseen: bool, light: str = "", sides: tuple[float, float] = (28, 150)) -> Scene:
    rotation, translation = _hard_pose(rng, lens_name, sides)
    return _scene(rng, lens_name, rotation, translation, unseen, light)


def _shadow(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen, "noon")
    sharp = rng.random() < 0.5
    shape = str(rng.choice(["edge", "edge", "band", "dapple"]))
    shadow = Shadow(
        shape,
        _uniform(rng, 0, 2 * math.pi),
        _uniform(rng, -0.4, 0.6) if shape == "dapple" else _uniform(rng, -0.14, 0.14),
        _log_uniform(rng, 0.4, 1.5) if shape == "dapple" else _log_uniform(rng, 0.04, 0.2),
        _log_uniform(rng, 0.002, 0.01) if sharp else _log_uniform(rng, 0.03, 0.15),
    )
    light = replace(scene.light, name="shadow", sun=1.0 - _uniform(rng, 0.2, 0.5), shadows=(shadow,))
    return replace(scene, light=light)


def _glare(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen, "noon")
    glare = Glare(
        _uniform(rng, -0.17, 0.17),
        _uniform(rng, -0.17, 0.17),
        _log_uniform(rng, 0.04, 0.16),
        _log_uniform(rng, 0.03, 0.12),
        _uniform(rng, 0, math.pi),
        _log_uniform(rng, 0.5, 4.0),
    )
    light = replace(scene.light, name="glare", glares=(glare,))
    return replace(scene, light=light, veil=_uniform(rng, 0.0, 0.12))


def _covered(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen)
    return replace(scene, cover_seed=2 * int(rng.integers(1 << 30)) + unseen)


def _cut(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    rotation, translation = _hard_pose(rng, lens_name, (50, 300), inside=False)
    if not 0.5 <= truth(lens_name, rotation, translation).visible <= 0.95:
        raise ImpossibleError
    return _scene(rng, lens_name, rotation, translation, unseen)


def _motion(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen)
    travel, angle = _uniform(rng, 2.5, 6.0), _uniform(rng, 0, 2 * math.pi)
    motion_px = (travel * math.cos(angle), travel * math.sin(angle))
    shake = shake_for(lens_name, scene.translation, motion_px, _uniform(rng, -0.01, 0.01))
    return replace(scene, motion_px=motion_px, shake=(float(shake[0]), float(shake[1]), float(shake[2])))


def _closeup(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    low = 0.1 if lens_name == "A" else 0.15
    height = _log_uniform(rng, low, 0.5)
    rotation = _pose(rng, 15.0)
    eye = np.array([*(rng.uniform(-0.4, 0.4, 2) * height), -height])
    translation = -rotation @ eye
    return _scene(rng, lens_name, rotation, translation, unseen)


def _small(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen, sides=(12, 32))
    if not 12 <= truth(lens_name, scene.rotation, scene.translation).side_px <= 25:
        raise ImpossibleError
    return scene


def _dusk(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen, "dusk")
    return replace(scene, exposure=_log_uniform(rng, 0.15, 0.45), noise=_uniform(rng, 4, 8))


def _exposure(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen, str(rng.choice(["noon", "low sun", "overcast"])))
    wrong = _log_uniform(rng, 1.8, 3.5) if rng.random() < 0.5 else _log_uniform(rng, 0.2, 0.5)
    return replace(scene, exposure=wrong, veil=_uniform(rng, 0.01, 0.05))


def _wet(rng: Rng, lens_name: str, unseen: bool) -> Scene:
    scene = _ordinary(rng, lens_name, unseen, "overcast")
    light = replace(
        scene.light,
        name="wet",
        gloss=_uniform(rng, 0.15, 0.7),
        gloss_turn=_uniform(rng, 0, 2 * math.pi),
        gloss_width=_log_uniform(rng, 0.15, 0.8),
    )
    return replace(scene, light=light)


_HARD: dict[str, Callable[[Rng, str, bool], Scene]] = {
    "shadow": _shadow,
    "glare": _glare,
    "covered": _covered,
    "cut": _cut,
    "motion": _motion,
    "closeup": _closeup,
    "small": _small,
    "dusk": _dusk,
    "exposure": _exposure,
    "wet": _wet,
}


def _hard(rng: Rng, lens_name: str, index: int, unseen: bool) -> tuple[Scene, str]:
    """Equal shares of HARD_KINDS."""
    kind = HARD_KINDS[index % len(HARD_KINDS)]
    return _HARD[kind](rng, lens_name, unseen), kind


_SETS: dict[str, tuple[Callable[[Rng, str, int, bool], tuple[Scene, str]], str]] = {
    "heights-A": (_heights, "A"),
    "heights-B": (_heights, "B"),
    "cone": (_cone, "A"),
    "hard-A": (_hard, "A"),
    "hard-B": (_hard, "B"),
}
STILL_SETS = tuple(_SETS)


def draw(set_name: str, index: int, unseen: bool = False) -> Drawn:
    """One case of a set: always the same for the same number and part."""
    maker, lens_name = _SETS[set_name]
    for attempt in range(2000):
        seed = [zlib.crc32(set_name.encode()), int(unseen), index, attempt]
        try:
            scene, kind = maker(np.random.default_rng(seed), lens_name, index, unseen)
        except ImpossibleError:
            continue
        return Drawn(set_name, index, kind, scene, truth(lens_name, scene.rotation, scene.translation))
    raise RuntimeError(f"{set_name} {index}: no draw obeys the set's rule")


assert CENTRE[0] == (WIDTH - 1) / 2 and CENTRE[1] == (HEIGHT - 1) / 2
