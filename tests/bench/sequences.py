"""The sequences: frames at 30 Hz of flights over the pad, each a couple of seconds with one thing that happens.

The camera shakes as on a multirotor; the blur follows from its motion and the exposure time. The exposure is set for
the paper once and stays, save where a sequence says otherwise.

A frame counts as visible if at least half of the marker's outer square is in the image and its sides have 12 px.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from optics import Array, lens
from scenes import Glare, Light, Scene, Shadow, Truth, attitude, shake_for, truth
from sets import Rng, _log_uniform, _scene, _uniform

RATE_HZ = 30.0
FRAMES = 60
VISIBLE_PART = 0.5
VISIBLE_SIDE_PX = 12.0


@dataclass(frozen=True)
class Plan:
    """One sequence.

    Attributes:
        lens: "A" or "B".
        heights: From, to, in metres; it goes down ever more slowly.
        light: Of sets.LIGHTS.
        ground: Of grounds.GROUNDS; empty for any.
        event: What happens: scene, part of the sequence in 0..1, its seed's numbers -> scene.
        shake_deg: Deviation of the camera's tilt.
        exposure_s: Exposure time.
    """

    lens: str
    heights: tuple[float, float]
    light: str
    ground: str
    event: Callable[[Scene, float, Array], Scene]
    shake_deg: float = 1.5
    exposure_s: float = 0.004


def _nothing(scene: Scene, _part: float, _luck: Array) -> Scene:
    return scene


def _drive(scene: Scene, part: float, luck: Array) -> Scene:
    """The pad drives over the ground at 3 to 5 m/s, through the shadow of a pole."""
    way = (3.0 + 2.0 * luck[0]) * part * FRAMES / RATE_HZ
    turn = 2 * math.pi * luck[1]
    shift = (scene.ground_shift[0] + way * math.cos(turn), scene.ground_shift[1] + way * math.sin(turn))
    shadow = Shadow("band", turn, 2.0 + 4.0 * luck[2] - way, 0.15 + 0.3 * luck[3], 0.02)
    light = replace(scene.light, sun=0.7, shadows=(shadow,))
    return replace(scene, ground_shift=shift, light=light, litter_count=0)


def _shadow_edge(scene: Scene, part: float, luck: Array) -> Scene:
    """A sharp shadow wanders over the marker."""
    shadow = Shadow("edge", 2 * math.pi * luck[0], (0.5 - part) * 0.9, penumbra=0.004 + 0.02 * luck[1])
    return replace(scene, light=replace(scene.light, sun=0.55 + 0.25 * luck[2], shadows=(shadow,)))


def _leaves(scene: Scene, part: float, luck: Array) -> Scene:
    """The shadows of leaves; they move as the pad turns under them."""
    shadow = Shadow("dapple", 0.0, -0.2 + 0.5 * luck[0], 0.6 + 0.8 * luck[1] + 0.1 * part, 0.02)
    return replace(scene, light=replace(scene.light, sun=0.5 + 0.25 * luck[2], shadows=(shadow,)))


def _adapted(factor: float, part: float) -> float:
    """Brightness after a step at a third of the sequence: the camera makes up for it over two thirds of a second."""
    if part < 1 / 3:
        return 1.0
    since_s = (part - 1 / 3) * FRAMES / RATE_HZ
    return float(factor ** max(0.0, 1.0 - since_s / 0.66))


def _brighter(scene: Scene, part: float, _luck: Array) -> Scene:
    """The light triples from one frame to the next."""
    return replace(scene, exposure=scene.exposure * _adapted(3.0, part))


def _darker(scene: Scene, part: float, _luck: Array) -> Scene:
    """A third of the light from one frame to the next."""
    return replace(scene, exposure=scene.exposure * _adapted(1 / 3, part))


def _passing_glare(scene: Scene, part: float, luck: Array) -> Scene:
    """A mirrored sun wanders over the marker."""
    turn, way = 2 * math.pi * luck[0], (part - 0.5) * 1.1
    aside = 0.1 * (luck[1] - 0.5)
    right = way * math.cos(turn) - aside * math.sin(turn)
    back = way * math.sin(turn) + aside * math.cos(turn)
    glare = Glare(right, back, 0.04 + 0.05 * luck[2], 0.03 + 0.03 * luck[3], math.pi * luck[4], 1.0 + 2.0 * luck[5])
    return replace(scene, light=replace(scene.light, glares=(glare,)), veil=0.04)


def _passing_cover(scene: Scene, part: float, luck: Array) -> Scene:
    """Something is drawn over the print."""
    turn, way = 2 * math.pi * luck[0], (part - 0.5) * 1.2
    seed = 2 * int(luck[1] * (1 << 30)) + (scene.ground_variant >= 4)
    return replace(
        scene,
        cover_seed=seed,
        cover_part=(0.08, 0.22),
        cover_shift=(way * math.cos(turn), way * math.sin(turn)),
    )


PLANS: dict[str, Plan] = {
    "approach-A": Plan("A", (5.0, 1.3), "noon", "lawn", _nothing),
    "approach-B": Plan("B", (9.0, 2.5), "low sun", "concrete", _nothing),
    "landing-A": Plan("A", (1.3, 0.12), "noon", "", _nothing),
    "landing-B": Plan("B", (1.5, 0.25), "overcast", "", _nothing),
    "car-A": Plan("A", (2.2, 1.0), "noon", "asphalt", _drive, 2.5),
    "car-B": Plan("B", (3.0, 1.0), "noon", "asphalt", _drive, 2.5),
    "shadow-A": Plan("A", (1.6, 1.2), "noon", "", _shadow_edge),
    "leaves-B": Plan("B", (3.5, 2.5), "noon", "lawn", _leaves),
    "brighter-A": Plan("A", (1.8, 1.4), "overcast", "", _brighter),
    "darker-B": Plan("B", (3.0, 2.0), "noon", "", _darker),
    "glare-A": Plan("A", (1.5, 1.0), "noon", "", _passing_glare),
    "cover-B": Plan("B", (2.5, 1.8), "overcast", "", _passing_cover),
    "dusk-A": Plan("A", (2.5, 0.5), "dusk", "", _nothing, 1.5, 0.015),
    "far-B": Plan("B", (10.0, 8.0), "overcast", "", _nothing, 2.0),
}
NAMES = tuple(PLANS)


@dataclass(frozen=True)
class DrawnFrame:
    """One frame of a sequence before it is rendered."""

    index: int
    t_s: float
    scene: Scene
    truth: Truth


class _Waves:
    """A smooth motion: three waves of 0.4 to 3 Hz, of deviation 1."""

    def __init__(self, rng: Rng) -> None:
        self._hz = np.array([_log_uniform(rng, 0.4, 1.0), _log_uniform(rng, 0.8, 2.0), _log_uniform(rng, 1.5, 3.0)])
        self._phase = rng.uniform(0, 2 * math.pi, 3)
        self._size = np.array([1.0, 0.6, 0.3])

    def at(self, t_s: float) -> float:
        return float(self._size @ np.sin(2 * math.pi * self._hz * t_s + self._phase)) / 0.85


class _Flight:
    """Where the camera is at any time of one sequence."""

    def __init__(self, rng: Rng, plan: Plan) -> None:
        self._plan = plan
        self._roll, self._pitch, self._sway, self._surge, self._turn = (_Waves(rng) for _ in range(5))
        self._heading = _uniform(rng, 0, 2 * math.pi)
        self._bearing = _uniform(rng, 0, 2 * math.pi)
        self._aside = _uniform(rng, 0.2, 0.55 if plan.lens == "A" else 0.28)

    def pose(self, t_s: float) -> tuple[Array, Array]:
        """cam_from_pad rotation and translation."""
        start, end = self._plan.heights
        part = t_s * RATE_HZ / FRAMES
        height = start * (end / start) ** part
        tilt = math.radians(self._plan.shake_deg)
        roll, pitch = tilt * self._roll.at(t_s), tilt * self._pitch.at(t_s)
        heading = self._heading + 0.08 * self._turn.at(t_s)
        rotation = attitude(math.hypot(roll, pitch), math.atan2(pitch, roll), heading)
        # It comes in from aside, and stays within a tenth of its height of where it wants to be.
        aside = self._aside * height * (1.0 - 0.7 * part)
        forward = aside * math.cos(self._bearing) + 0.04 * height * self._surge.at(t_s)
        right = aside * math.sin(self._bearing) + 0.04 * height * self._sway.at(t_s)
        return rotation, -rotation @ np.array([forward, right, -height])


def draw_sequence(name: str, unseen: bool = False) -> Iterator[DrawnFrame]:
    """Its frames in order, always the same ones.

    Args:
        name: Of NAMES.
        unseen: From the part that is not looked at while tuning.
    """
    plan = PLANS[name]
    rng = np.random.default_rng([zlib.crc32(b"sequence-" + name.encode()), int(unseen)])
    flight = _Flight(rng, plan)
    luck = rng.random(8)
    rotation, translation = flight.pose(0.0)
    base = _scene(rng, plan.lens, rotation, translation, unseen, plan.light)
    light = Light(base.light.name, base.light.sun, base.light.slope)
    dim = 0.4 if plan.light == "dusk" else 1.0
    base = replace(
        base,
        light=light,
        ground=plan.ground or base.ground,
        albedo={"lawn": 0.12, "asphalt": 0.12, "concrete": 0.35}.get(plan.ground, base.albedo),
        meter=0.0,
        exposure=dim * _uniform(rng, 0.7, 1.3),
        litter_span=5.0,
        jpeg=None,
    )
    optics = lens(plan.lens)
    for index in range(FRAMES):
        t_s = index / RATE_HZ
        rotation, translation = flight.pose(t_s)
        half = plan.exposure_s / 2
        ends = optics.project(np.array([flight.pose(t_s - half)[1], flight.pose(t_s + half)[1]]))
        motion = (float(ends[1, 0] - ends[0, 0]), float(ends[1, 1] - ends[0, 1]))
        shake = shake_for(plan.lens, translation, motion, 0.0)
        scene = replace(
            base,
            noise_seed=base.noise_seed + index,
            rotation=rotation,
            translation=translation,
            motion_px=motion,
            shake=(float(shake[0]), float(shake[1]), float(shake[2])),
        )
        scene = plan.event(scene, index / FRAMES, luck)
        yield DrawnFrame(index, t_s, scene, truth(plan.lens, rotation, translation))


def is_visible(true: Truth) -> bool:
    """Whether a frame counts (see the top)."""
    return true.visible >= VISIBLE_PART and true.side_px >= VISIBLE_SIDE_PX
