"""Frames in which there is no landmark: decoys on every ground, real photographs, bare grounds; drawn from a seed.

Each frame is made from (seed, part, index) alone, so that any one can be made again. The unseen part has its own
random numbers, decoy variants, ground tiles and photographs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import decoy_nests  # noqa: F401  (enters its kinds)
import decoy_things  # noqa: F401  # enters its kinds
import negative_ground
import numpy as np
import photos
from decoys import KINDS, VARIANTS, Family, Print, make_print, the_landmark
from negative_ground import GROUNDS, Plane
from negative_scene import Grey, Light, Place, Pose, expose, lay, light, place_at, pose, sense, texture
from optics import HEIGHT, WIDTH

SMALLEST_PX, LARGEST_PX = 8.0, 400.0
SEEN_PRINTS = 6
"""Of each kind's variants; the rest are for the unseen part. The same for the grounds' tiles:"""
SEEN_TILES = 2
LEAD = 2
AFTER = 3
"""A sequence shows the landmark this often, then the frame without it this often."""
DECOY_SHARE, PHOTO_SHARE = 0.60, 0.17
FAMILY_SHARE = {Family.NEAR: 0.50, Family.INNERMOST: 0.10, Family.THING: 0.36, Family.ARGUABLE: 0.04}
OPTICS_PX = 0.75


@dataclass(frozen=True, slots=True)
class Negative:
    """One frame without a landmark, and the sequence that leads up to it.

    Attributes:
        index: In its part.
        lens: "A" or "B".
        kinds: What is in it: of decoys.KINDS, "ground: lawn", "photo: coffee".
        families: Of the decoys; empty without one.
        places: Of the decoys, in the order of kinds.
        still: The frame.
        lead: The same scene with the landmark in it; empty for a sequence that starts cold.
        after: The frame again, with new noise, moved by a pixel or so.
        landmark_px: (4, 2) the landmark's outer corners in `lead`.
    """

    index: int
    lens: str
    kinds: tuple[str, ...]
    families: tuple[Family, ...]
    places: tuple[Place, ...]
    still: Grey
    lead: tuple[Grey, ...]
    after: tuple[Grey, ...]
    landmark_px: np.ndarray | None

    def kind_at(self, px: tuple[float, float]) -> str:
        """What lies nearest to a pixel."""
        if not self.places:
            return self.kinds[0]
        distance = [math.dist(place.corners_px.mean(axis=0), px) for place in self.places]
        return self.kinds[int(np.argmin(distance))]


@lru_cache(maxsize=1)
def _kinds_of() -> dict[Family, list[str]]:
    return {family: [name for name, (f, _) in KINDS.items() if f is family] for family in Family}


def _draw_print(source: np.random.Generator, unseen: bool) -> Print:
    family = source.choice(list(FAMILY_SHARE), p=list(FAMILY_SHARE.values()))
    names = _kinds_of()[Family(family)]
    name = names[int(source.integers(len(names)))]
    low, high = (SEEN_PRINTS, VARIANTS) if unseen else (0, SEEN_PRINTS)
    return make_print(name, int(source.integers(low, high)))


def _smallest_px(drawn: Print) -> float:
    """From which size a frame with it is a negative: the image must tell it from the landmark."""
    least = 60.0 if math.isinf(drawn.least_side_px) else drawn.least_side_px
    return max(SMALLEST_PX, least)


def _whole(place: Place, span: float) -> bool:
    """The print lies in the image."""
    middle = place.corners_px.mean(axis=0)
    outer = middle + (place.corners_px - middle) * span
    return bool((outer > 1).all() and (outer < np.array([WIDTH - 2, HEIGHT - 2])).all())


def _place(source: np.random.Generator, seen: Pose, drawn: Print, taken: list[Place]) -> Place | None:
    """A free place for a print, near decoys as a whole, others cut by the border at times."""
    smallest = _smallest_px(drawn)
    for _ in range(12):
        side = math.exp(source.uniform(math.log(smallest), math.log(max(LARGEST_PX, smallest * 1.5))))
        rim = 0.0 if drawn.family is Family.THING else min(0.6 * side, 0.49 * HEIGHT)
        px = (float(source.uniform(rim, WIDTH - rim)), float(source.uniform(rim, HEIGHT - rim)))
        place = place_at(seen, px, float(source.uniform(0, math.tau)), side)
        if place is None or (drawn.family is not Family.THING and not _whole(place, 1.02)):
            continue
        middle = place.corners_px.mean(axis=0)
        if all(
            math.dist(middle, other.corners_px.mean(axis=0)) > _reach_px(place) + _reach_px(other) for other in taken
        ):
            return place
    return None


def _reach_px(place: Place) -> float:
    middle = place.corners_px.mean(axis=0)
    return 1.25 * float(np.max(np.linalg.norm(place.corners_px - middle, axis=1)))


def _background(
    source: np.random.Generator, seen: Pose, photo: bool, unseen: bool, folder: Path | None
) -> tuple[str, Plane]:
    """A name and (HEIGHT, WIDTH) of reflectance."""
    if photo and folder is not None:
        pictures = photos.photos(folder, unseen)
        name, picture = pictures[int(source.integers(len(pictures)))]
        return f"photo: {name}", photos.view(picture, source)
    name = list(GROUNDS)[int(source.integers(len(GROUNDS)))]
    low, high = (SEEN_TILES, negative_ground.VARIANTS) if unseen else (0, SEEN_TILES)
    zoom = math.exp(source.uniform(math.log(0.5), math.log(4.0)))
    field = texture(seen, name, int(source.integers(low, high)), zoom, source)
    dark, bright = float(source.uniform(0.03, 0.2)), float(source.uniform(0.35, 0.95))
    return f"ground: {name}", np.asarray(dark + (bright - dark) * field, np.float32)


def _sharp_enough(lit: Light, prints: list[Print], places: list[Place]) -> Light:
    """No more blur than leaves the image able to tell: `least_side_px` is for a sharp one."""
    room = min((p.side_px / _smallest_px(d) for d, p in zip(prints, places, strict=True)), default=math.inf)
    most = OPTICS_PX * max(1.0, room)
    blur = min(lit.blur_px, most)
    motion = min(lit.motion_px, math.sqrt(12.0 * max(0.0, most**2 - blur**2)))
    return replace(lit, blur_px=blur, motion_px=motion)


def frame(index: int, seed: int, unseen: bool, folder: Path | None) -> Negative:
    """One frame.

    Args:
        index: Which.
        seed: Of the whole set.
        unseen: Of the part that nobody tunes on.
        folder: Of the photographs; None: grounds in their place.

    Raises:
        NoPhotosError: The folder has none.
    """
    source = np.random.default_rng((seed, int(unseen), index))
    group = source.random()
    decoy = group < DECOY_SHARE
    photo = (not decoy and group < DECOY_SHARE + PHOTO_SHARE) or (decoy and source.random() < 0.15)
    lens_name = "A" if source.random() < 0.5 else "B"
    tilt = float(abs(source.normal(0, 0.12)) if source.random() < 0.8 else source.uniform(0.1, 0.6))
    seen = pose(lens_name, tilt, float(source.uniform(0, math.tau)))
    name, picture = _background(source, seen, photo, unseen, folder)

    prints: list[Print] = []
    places: list[Place] = []
    if decoy:
        count = 1 if source.random() < 0.65 else int(source.integers(2, 7))
        for _ in range(count):
            drawn = _draw_print(source, unseen)
            place = _place(source, seen, drawn, places)
            if place is not None:
                prints.append(drawn)
                places.append(place)
    keep_clear = [(*map(float, p.corners_px.mean(axis=0)), p.side_px) for p in places]
    lit = _sharp_enough(light(source, [(u, v, r) for u, v, r in keep_clear]), prints, places)

    lead, landmark_px = _lead(source, seen, picture, places, lit)
    for drawn, place in zip(prints, places, strict=True):
        lay(picture, seen, drawn, place)
    levels = expose(picture, lit)
    after = tuple(sense(levels, lit, source, tuple(source.normal(0, 1.2, 2))) for _ in range(AFTER))
    return Negative(
        index=index,
        lens=lens_name,
        kinds=tuple(p.kind for p in prints) or (name,),
        families=tuple(p.family for p in prints),
        places=tuple(places),
        still=sense(levels, lit, source),
        lead=lead,
        after=after,
        landmark_px=landmark_px,
    )


def _lead(
    source: np.random.Generator, seen: Pose, ground: Plane, places: list[Place], lit: Light
) -> tuple[tuple[Grey, ...], np.ndarray | None]:
    """The landmark where the first decoy will lie, or anywhere: what a track is running on before it is gone."""
    if source.random() > 0.6:
        return (), None
    if places:
        where: Place | None = places[0]
        if places[0].side_px < 16.0:
            middle = places[0].corners_px.mean(axis=0)
            where = place_at(seen, (float(middle[0]), float(middle[1])), places[0].yaw_rad, 16.0)
    else:
        side = math.exp(source.uniform(math.log(16.0), math.log(300.0)))
        px = (float(source.uniform(0.15, 0.85)) * WIDTH, float(source.uniform(0.15, 0.85)) * HEIGHT)
        where = place_at(seen, px, float(source.uniform(0, math.tau)), side)
    if where is None:
        return (), None
    picture = ground.copy()
    lay(picture, seen, _landmark(), where)
    levels = expose(picture, lit)
    return tuple(sense(levels, lit, source) for _ in range(LEAD)), where.corners_px


@lru_cache(maxsize=1)
def _landmark() -> Print:
    return the_landmark()


def frames(count: int, seed: int, unseen: bool, folder: Path | None = photos.DEFAULT) -> Iterator[Negative]:
    """The first `count` frames of a part."""
    return (frame(index, seed, unseen, folder) for index in range(count))
