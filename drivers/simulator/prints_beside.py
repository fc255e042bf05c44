"""Printed things beside the pad that are not the landmark: nested squares, triangles, a helipad's H, a coded marker,
the landmark's negative. Each is a board with convex polygons on it, painted as the landmark is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.config_world import DecoyConfig
from app.landmark import Landmark
from drivers.simulator.decals import BLACK, WHITE, rectangle
from drivers.simulator.print import Layer, print_layer
from drivers.simulator.view import Place

Polygon = NDArray[np.float64]
BOARD = 46.0 / 38.0
"""Side of the board over that of the outermost contour: the landmark's own."""
CODE = ((1, 0, 1, 1), (0, 1, 1, 0), (1, 1, 0, 1), (0, 0, 1, 0))
"""Of the marker: 1 is white."""


def _square(side: float) -> Polygon:
    return rectangle(side / 2.0, side / 2.0, -side / 2.0, -side / 2.0)


def _triangle(side: float, behind: float) -> Polygon:
    """Equilateral, apex forward, its base so far behind the centre; clockwise from above."""
    base = -behind
    return np.array([[base + side * math.sqrt(0.75), 0.0], [base, side / 2.0], [base, -side / 2.0]])


def _squares() -> list[tuple[Polygon, float]]:
    return [(_square(s), shade) for s, shade in ((1.0, BLACK), (0.7, WHITE), (0.5, BLACK), (0.36, WHITE), (0.2, BLACK))]


def _triangles() -> list[tuple[Polygon, float]]:
    sides = ((1.0, BLACK), (0.6, WHITE), (0.34, BLACK))
    return [(_triangle(s, s * math.sqrt(0.75) / 3.0), shade) for s, shade in sides]


def _helipad() -> list[tuple[Polygon, float]]:
    around = np.linspace(0.0, 2.0 * math.pi, 49)[:-1]
    circle = np.column_stack([np.cos(around), np.sin(around)])
    uprights = [rectangle(0.25, side + 0.05, -0.25, side - 0.05) for side in (-0.17, 0.17)]
    bars = [*uprights, rectangle(0.05, 0.17, -0.05, -0.17)]
    return [(0.5 * circle, BLACK), (0.43 * circle, WHITE), *((bar, BLACK) for bar in bars)]


def _marker() -> list[tuple[Polygon, float]]:
    cell = 1.0 / 6.0
    parts: list[tuple[Polygon, float]] = [(_square(1.0), BLACK)]
    for row, line in enumerate(CODE):
        for column, bit in enumerate(line):
            if bit:
                front, left = (2 - row) * cell, (column - 2) * cell
                parts.append((rectangle(front, left + cell, front - cell, left), WHITE))
    return parts


def decoy_layers(config: DecoyConfig, landmark: Landmark) -> tuple[Layer, ...]:
    """The board, then what is printed on it."""
    if config.kind == "negative":
        scale = 1.0 / landmark.size_m
        shapes = [(scale * c.corners_m, WHITE if c.black else BLACK) for c in landmark.contours]
        board = BLACK
    else:
        drawn = {"squares": _squares, "triangles": _triangles, "helipad": _helipad, "marker": _marker}
        shapes, board = drawn[config.kind](), WHITE
    printed = [(_square(BOARD), board), *shapes]
    return tuple(print_layer(config.size_m * corners, shade) for corners, shade in printed)


def decoy_place(config: DecoyConfig, pad: Place) -> Place:
    """Where it lies: on the ground, from where the pad starts."""
    north, east, _ = Place(pad.north_m, pad.east_m, pad.heading_rad, 0.0).world(
        np.array([[config.forward_m, config.right_m]])
    )[0]
    return Place(float(north), float(east), pad.heading_rad + math.radians(config.heading_deg), 0.0)
