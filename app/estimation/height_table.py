"""The paper's height table: how long the outer triangle's side is in the image at known heights.

Two groups were recorded (Table II): L1 with the landmark in the middle of the image, L2 with it a distance D from the
middle. A length between the groups and between the heights is interpolated (equations 11 to 13, app.estimation.paper).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from app.config import Section, read_config
from app.frames import Array
from app.landmark import Contour, Landmark, Shape

COMPUTED_HEIGHTS_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)


class HeightTableConfig(Section):
    """A height table's file: configs/height-tables/*.toml."""

    name: str
    heights_m: tuple[float, ...] = Field(min_length=2, max_length=200, description="rising")
    centred_px: tuple[float, ...] = Field(description="L1: falling")
    offset_px: tuple[float, ...] = Field(description="L2: falling")
    offset_distance_px: float = Field(gt=0, le=10000, description="D: how far from the middle L2 was recorded")
    side_m: float = Field(gt=0, le=20, description="side of the outer triangle of the landmark that was recorded")
    focal_px: float = Field(gt=0, le=50000, description="focal length of the camera that recorded it")

    @model_validator(mode="after")
    def _consistent(self) -> HeightTableConfig:
        rows = len(self.heights_m)
        for key in ("centred_px", "offset_px"):
            lengths = getattr(self, key)
            if len(lengths) != rows:
                raise ValueError(f"{key} has {len(lengths)} values, heights_m has {rows}: give one for each height")
            if min(lengths) <= 0 or any(b >= a for a, b in itertools.pairwise(lengths)):
                raise ValueError(f"{key} must be positive and fall from each height to the next")
        if self.heights_m[0] <= 0 or any(b <= a for a, b in itertools.pairwise(self.heights_m)):
            raise ValueError("heights_m must be positive and rise")
        return self


@dataclass(frozen=True, slots=True)
class HeightTable:
    """A table ready for use.

    Attributes:
        name: For people.
        heights_m: (n,) rising.
        centred_px: (n,) L1.
        offset_px: (n,) L2.
        offset_distance_px: D.
        side_m: Side of the triangle that was recorded.
        focal_px: Focal length of the camera that recorded it; the pixels of a levelled virtual camera with this focal
            length are the table's pixels.
    """

    name: str
    heights_m: Array
    centred_px: Array
    offset_px: Array
    offset_distance_px: float
    side_m: float
    focal_px: float


def outer_triangle(landmark: Landmark) -> tuple[int, Contour] | None:
    """The outermost triangle of a landmark (the paper's T3) with its index; None if it has none."""
    return next(((i, c) for i, c in enumerate(landmark.contours) if c.shape is Shape.TRIANGLE), None)


def read_height_table(path: Path) -> HeightTable:
    """A table from its file.

    Raises:
        ConfigError: The file is missing or wrong; it names the key and what to do.
    """
    config = read_config(path, HeightTableConfig)
    return HeightTable(
        config.name,
        np.array(config.heights_m),
        np.array(config.centred_px),
        np.array(config.offset_px),
        config.offset_distance_px,
        config.side_m,
        config.focal_px,
    )


def computed_height_table(landmark: Landmark, focal_px: float) -> HeightTable | None:
    """The table that a perfect camera would record: L = f s / H for both groups; None without a triangle."""
    triangle = outer_triangle(landmark)
    if triangle is None:
        return None
    side_m = triangle[1].side_m
    heights = np.array(COMPUTED_HEIGHTS_M)
    lengths = focal_px * side_m / heights
    return HeightTable("computed from the lens", heights, lengths, lengths, focal_px, side_m, focal_px)
