"""Laying flat things over the light of a view: decals, the printed landmark, filled hulls."""

from __future__ import annotations

import math

import cv2
import numpy as np

from drivers.simulator.decals import FULL, Decal, Texels, outline
from drivers.simulator.print import Layer, paint_layer
from drivers.simulator.textures import Plane
from drivers.simulator.view import Array, Camera, Place, View

SAMPLES_MAX = 40_000
"""Supersampling of a decal stays under this many samples; its smaller copies do the rest against aliasing."""
FACTOR_MAX = 4


def _linear(row: Array, north: Plane, east: Plane, factor: int = 1) -> Plane:
    """A linear form of the slopes, at factor times the samples, pixel areas kept in place."""
    found = cv2.addWeighted(north, float(row[0]), east, float(row[1]), float(row[2]))
    if factor > 1:
        found = cv2.resize(found, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR)
    return np.asarray(found, dtype=np.float32)


def lay(light: Plane, camera: Camera, view: View, picture: Decal, place: Place) -> None:
    """Lay a decal over the light."""
    box = camera.box(view, picture.rim_m, place)
    if box is None:
        return
    u0, v0, u1, v1 = box
    factor = max(1, min(FACTOR_MAX, math.isqrt(SAMPLES_MAX // ((u1 - u0) * (v1 - v0)))))
    wanted_m = view.distance_m(place) / camera.lens.focal_px / factor
    finest = math.floor(math.log2(max(wanted_m / picture.texel_m, 1e-6)) + 0.35)
    level = max(0, min(len(picture.clear) - 1, finest))
    texel_m = picture.texel_m * 2**level
    forward, right, depth = view.on_plane(place)
    north, east = view.north[v0:v1, u0:u1], view.east[v0:v1, u0:u1]
    # Columns run to the right from the left edge, rows backward from the front edge; texel centres at whole numbers.
    u = _linear((right - picture.left_m * depth) / texel_m - 0.5 * depth, north, east, factor)
    v = _linear((picture.front_m * depth - forward) / texel_m - 0.5 * depth, north, east, factor)
    if place.axes is not None:
        scale = _linear(depth, north, east, factor)
        cv2.divide(u, scale, dst=u)
        cv2.divide(v, scale, dst=v)

    def warp(plane: Texels, beside: float) -> Texels:
        drawn = cv2.remap(plane, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(beside,))
        if factor > 1:
            drawn = cv2.resize(drawn, (u1 - u0, v1 - v0), interpolation=cv2.INTER_AREA)
        return np.asarray(drawn, dtype=np.uint16)

    under = light[v0:v1, u0:u1]
    cv2.multiply(under, warp(picture.clear[level], FULL), dst=under, scale=1.0 / FULL, dtype=cv2.CV_32F)
    if picture.bright:
        bright = warp(picture.bright[level], 0.0)
        cv2.addWeighted(under, 1.0, bright, 1.0 / FULL, 0.0, dst=under, dtype=cv2.CV_32F)


def lay_print(light: Plane, camera: Camera, view: View, layers: tuple[Layer, ...], place: Place) -> None:
    """Lay a board, and what is printed on it, over the light."""
    boxes = camera.boxes(view, [layer.rim_m for layer in layers], place)
    board = boxes[0]
    if board is None:
        return
    scale = view.on_plane(place)
    u0, v0, u1, v1 = board
    part = (slice(v0, v1), slice(u0, u1))
    per_pixel = _per_pixel(view.north[part], view.east[part], camera.pixel_angle[part], view.distance_m(place), scale)
    for layer, box in zip(layers, boxes, strict=True):
        if box is None:
            continue
        a0, b0, a1, b1 = max(box[0], u0), max(box[1], v0), min(box[2], u1), min(box[3], v1)
        if a1 <= a0 or b1 <= b0:
            continue
        part = (slice(b0, b1), slice(a0, a1))
        piece = per_pixel[b0 - v0 : b1 - v0, a0 - u0 : a1 - u0]
        paint_layer(light[part], layer, (view.north[part], view.east[part]), scale, piece)


def _per_pixel(north: Plane, east: Plane, angle: Plane, above_m: float, scale: Array) -> Plane:
    """What takes a layer's linear form to pixels: one over what a pixel measures on the plane, and over the form's own
    depth where the plane is tilted.

    With r = (north, east, 1) and N the plane's normal the ray is |r| / (N r) times as long as the distance of the plane
    and meets it at a cosine of N r / |r|, so a pixel's angle grows by (|r| / (N r))^(3/2) there.
    """
    stretch = cv2.multiply(north, north)
    cv2.add(stretch, cv2.multiply(east, east), dst=stretch)
    np.add(stretch, np.float32(1.0), out=stretch)
    cv2.sqrt(stretch, dst=stretch)
    cv2.multiply(stretch, cv2.sqrt(stretch), dst=stretch)
    cv2.multiply(stretch, angle, dst=stretch)
    if scale[2][0] == 0.0 and scale[2][1] == 0.0:
        return np.asarray(cv2.divide(1.0 / above_m, stretch), dtype=np.float32)
    depth = np.clip(_linear(scale[2], north, east), 1e-3, None)
    return np.asarray(cv2.divide(cv2.sqrt(depth), stretch, scale=1.0 / above_m), dtype=np.float32)


def fill_hull(light: Plane, camera: Camera, view: View, points: Array, shade: float) -> None:
    """Fill the convex hull of points (n, 2), given as slopes north and east, with one shade.

    In the plane of slopes straight lines stay straight, so the hull is taken there and bent by the lens after.
    """
    hull = cv2.convexHull(points.astype(np.float32))[:, 0, :].astype(np.float64)
    edges = outline(hull)
    pixels = camera.lens.project(np.column_stack([edges, np.ones(len(edges))]) @ view.world_from_cam)
    if np.isnan(pixels).any():
        return
    height, width = light.shape
    u0, v0 = (max(0, math.floor(x) - 2) for x in pixels.min(axis=0))
    u1, v1 = min(width, math.ceil(pixels[:, 0].max()) + 3), min(height, math.ceil(pixels[:, 1].max()) + 3)
    if u1 <= u0 or v1 <= v0:
        return
    mask = np.zeros((v1 - v0, u1 - u0), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round((pixels - (u0, v0)) * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    under = light[v0:v1, u0:u1]
    under += mask.astype(np.float32) * np.float32(1.0 / 255.0) * (np.float32(shade) - under)
