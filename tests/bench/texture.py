"""Pictures on the ground plane that can be looked at from any distance: each with its halvings, all in one sheet.

A lookup blends two halvings, chosen by the size of the pixel's footprint on the plane, so that what a pixel shows is
the mean over its area (Williams, "Pyramidal parametrics", 1983).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from optics import Array

PAD = 2
"""Texels round each level, for the interpolation at its border."""


@dataclass(frozen=True)
class Address:
    """Points of the plane in a texture's sheet.

    Attributes:
        near: Maps for cv2.remap into the finer of two levels.
        far: The same into the coarser; None where the finest will do.
        part: (h, w) weight of the coarser.
    """

    near: tuple[Array, Array]
    far: tuple[Array, Array] | None
    part: Array | None


class Texture:
    """A square picture and its halvings.

    Args:
        picture: (n, n) or (n, n, channels), uint8 or float32, n a power of two; row 0 is the first in y.
        span: Side of it on the plane, in metres.
        wraps: It tiles the plane; else it is centred on the origin and 0 outside.
    """

    def __init__(self, picture: Array, span: float, wraps: bool) -> None:
        self.span, self.wraps = span, wraps
        self.size = picture.shape[0]
        self.levels = int(math.log2(self.size)) - 1
        border = cv2.BORDER_WRAP if wraps else cv2.BORDER_CONSTANT
        shape = (self.size + 2 * PAD * self.levels, self.size + self.size // 2 + 8 * PAD, *picture.shape[2:])
        self.sheet: Array = np.zeros(shape, picture.dtype)
        level, row, column = picture, 0, 0
        rows, columns = [], []
        for k in range(self.levels):
            framed = cv2.copyMakeBorder(level, PAD, PAD, PAD, PAD, border, value=0)
            self.sheet[row : row + framed.shape[0], column : column + framed.shape[1]] = framed
            rows.append(row + PAD)
            columns.append(column + PAD)
            if k == 0:
                column = framed.shape[1]
            else:
                row += framed.shape[0]
            level = cv2.resize(level, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        self._rows = np.array(rows, np.float32)
        self._columns = np.array(columns, np.float32)
        self._scales = np.exp2(-np.arange(self.levels)).astype(np.float32)

    def address(self, x: Array, y: Array, footprint: Array) -> Address:
        """Where points of the plane lie in the sheet; good for every texture of this span and size.

        Args:
            x: (h, w) metres along the picture's columns.
            y: (h, w) metres along its rows.
            footprint: (h, w) size of the pixel there, in metres.
        """
        per_m = np.float32(self.size / self.span)
        u, v = x * per_m, y * per_m
        if self.wraps:
            u -= np.floor(u * np.float32(1 / self.size)) * np.float32(self.size)
            v -= np.floor(v * np.float32(1 / self.size)) * np.float32(self.size)
        else:
            u += np.float32(self.size / 2)
            v += np.float32(self.size / 2)
        depth = np.log2(footprint * per_m)
        np.clip(depth, 0.0, np.float32(self.levels - 1.001), out=depth)
        low = depth.astype(np.intp)
        near = self._place(u, v, low)
        if float(depth.max()) <= 0.0:
            return Address(near, None, None)
        return Address(near, self._place(u, v, low + 1), depth - low)

    def _place(self, u: Array, v: Array, level: Array) -> tuple[Array, Array]:
        """Maps for cv2.remap; u, v in texels of level 0, its texels' edges at whole numbers."""
        scale = self._scales.take(level)
        x = u * scale - np.float32(0.5)
        y = v * scale - np.float32(0.5)
        if not self.wraps:
            top = np.float32(self.size) * scale
            np.minimum(np.maximum(x, np.float32(-1), out=x), top, out=x)
            np.minimum(np.maximum(y, np.float32(-1), out=y), top, out=y)
        x += self._columns.take(level)
        y += self._rows.take(level)
        return cv2.convertMaps(x, y, cv2.CV_16SC2)

    def at(self, address: Address) -> Array:
        """(h, w) or (h, w, channels) float32: what is seen there."""
        near = cv2.remap(self.sheet, *address.near, cv2.INTER_LINEAR).astype(np.float32, copy=False)
        if address.far is None or address.part is None:
            return near
        far = cv2.remap(self.sheet, *address.far, cv2.INTER_LINEAR).astype(np.float32, copy=False)
        far -= near
        far *= address.part[..., None] if far.ndim == 3 else address.part
        far += near
        return far

    def sample(self, x: Array, y: Array, footprint: Array) -> Array:
        """As address, then at."""
        return self.at(self.address(x, y, footprint))
