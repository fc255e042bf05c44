"""What looks like the landmark and isn't must not be reported: alone, or where the landmark was a moment ago.

Decoys and renderer are the benchmark's (tests/bench); ten thousand such frames are `make bench-negatives`.
"""

from __future__ import annotations

import math

import decoy_nests  # noqa: F401  (enters its kinds)
import decoy_things  # noqa: F401  # enters its kinds
import numpy as np
import pytest
from decoys import (
    KINDS,
    Drawing,
    Family,
    landmark_polygons,
    least_side_px,
    make_print,
    nest,
    render,
    the_landmark,
    turned,
)
from negative_scene import Light, expose, lay, place_at, pose, sense, texture
from optics import HEIGHT, WIDTH, lens

from app.config import LensConfig, VisionConfig, read_config
from app.landmark import paper_landmark
from app.messages import Frame
from app.vision.camera_model import lens_from_config
from app.vision.detector import Detector

NESTS = [name for name, (family, _) in KINDS.items() if family in (Family.NEAR, Family.INNERMOST)]
THINGS = [name for name, (family, _) in KINDS.items() if family is Family.THING]
FOUR_PLACES = [(150.0, 120.0), (490.0, 130.0), (160.0, 360.0), (480.0, 350.0)]
UPSIDE_DOWN = ["t3-upside-down", "t4-upside-down", "t3-t4-upside-down"]


class Stage:
    """A print on a lawn, under a plain light, through the benchmark's pinhole lens."""

    def __init__(self, seed: int) -> None:
        self.source = np.random.default_rng(seed)
        self.pose = pose("B", 0.12, 0.7)
        field = texture(self.pose, "lawn", 0, 1.2, self.source)
        self.ground = np.asarray(0.1 + 0.4 * field, np.float32)
        even = np.ones((HEIGHT, WIDTH), np.float32)
        self.light = Light(even, 0 * even, 190.0, 1.0, 0.6, 0.0, 0.0, 2.0, None)

    def show(self, *prints, side_px: float, places=((300.0, 250.0),)):
        """The frame with some prints at their places, at 25 degrees."""
        picture = self.ground.copy()
        for drawn, at in zip(prints, places, strict=False):
            place = place_at(self.pose, at, math.radians(25.0), side_px)
            assert place is not None
            lay(picture, self.pose, drawn, place)
        return sense(expose(picture, self.light), self.light, self.source)


def new_detector() -> Detector:
    camera = lens_from_config(read_config(lens("B").camera_file, LensConfig))
    return Detector(paper_landmark(), camera, VisionConfig())


@pytest.fixture(scope="module")
def detector() -> Detector:
    return new_detector()


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage(3)


def told_px(drawn) -> float:
    """A size at which the image tells the print from the landmark well."""
    return max(70.0, 1.4 * drawn.least_side_px)


@pytest.mark.parametrize("side_px", [24.0, 70.0, 110.0])
def test_landmark_drawn_as_the_decoys_are_is_detected(detector, stage, side_px):
    image = stage.show(the_landmark(), side_px=side_px)
    found = detector.detect(Frame(0.0, 0, image), still=True)
    assert found.detected, found.reason


@pytest.mark.parametrize("name", NESTS)
def test_nest_as_a_still_is_not_detected(detector, stage, name):
    drawn = make_print(name, 0)
    found = detector.detect(Frame(0.0, 0, stage.show(drawn, side_px=told_px(drawn))), still=True)
    assert not found.detected, f"{name} taken for the landmark: {found.code}, score {found.score:.2f}"


@pytest.mark.parametrize("names", [THINGS[k : k + 4] for k in range(0, len(THINGS), 4)], ids="+".join)
def test_four_printed_things_as_a_still_are_not_detected(detector, stage, names):
    image = stage.show(*(make_print(name, 0) for name in names), side_px=120.0, places=FOUR_PLACES)
    found = detector.detect(Frame(0.0, 0, image), still=True)
    where = found.contours[0].corners_px.mean(axis=0).round() if found.detected else None
    assert not found.detected, f"taken for the landmark at {where}: {found.code}, score {found.score:.2f}"


@pytest.mark.parametrize("name", [*UPSIDE_DOWN, "square-in-square", "triangle-in-square", "inverted", "helipad-square"])
def test_decoy_where_the_landmark_was_ends_the_track(stage, name):
    drawn = make_print(name, 0)
    detector = new_detector()
    side = told_px(drawn)
    led = [detector.detect(Frame(k / 30, k, stage.show(the_landmark(), side_px=side))).detected for k in range(2)]
    after = [detector.detect(Frame(k / 30, k, stage.show(drawn, side_px=side))).detected for k in range(2, 6)]
    assert led == [True, True]
    assert after == [False] * 4


def test_landmark_that_is_gone_ends_the_track(stage):
    detector = new_detector()
    led = [detector.detect(Frame(k / 30, k, stage.show(the_landmark(), side_px=90.0))).detected for k in range(2)]
    after = [detector.detect(Frame(k / 30, k, stage.show(side_px=90.0))).detected for k in range(2, 6)]
    assert led == [True, True]
    assert after == [False] * 4


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_landmark_with_its_inside_turned_by_quarters_is_told_from_itself_at_no_size(quarter):
    outer, white, *inner = landmark_polygons()
    drawing = Drawing(nest([outer, white, *(turned(poly, 90.0 * quarter) for poly in inner)]))
    assert math.isinf(least_side_px(*render(drawing)))
