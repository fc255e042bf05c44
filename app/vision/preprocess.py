"""The paper's first stage: resize, grey, Gaussian; and Otsu's threshold of a region.

Regions are (u0, v0, u1, v1), half open, in pixels of the whole frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from app.frames import Array
from app.messages import Image

Region = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class Prepared:
    """A region made ready for the threshold.

    Attributes:
        region: Of the frame.
        grey: (h, w) of the region at full resolution.
        smooth: (h / reduction, w / reduction) blurred, what is binarised.
        reduction: Whole factor that `smooth` is smaller by.
    """

    region: Region
    grey: Image
    smooth: Image
    reduction: int

    def to_frame(self, px: Array) -> Array:
        """Pixels (..., 2) of `smooth` to pixels of the frame (centres at whole numbers in both)."""
        result: Array = (px + 0.5) * self.reduction - 0.5 + np.array(self.region[:2], dtype=np.float64)
        return result


def whole(image: Image) -> Region:
    """The region that is the whole frame."""
    return 0, 0, image.shape[1], image.shape[0]


def to_grey(image: Image, region: Region) -> Image:
    """(h, w) uint8 grey of a region of a grey or BGR image."""
    u0, v0, u1, v1 = region
    part = image[v0:v1, u0:u1]
    return part if part.ndim == 2 else np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def prepare(image: Image, region: Region, *, reduction: int = 1, sigma_px: float = 0.8) -> Prepared:
    """Resize, grey, Gaussian of a region. Averaging over reduction x reduction pixels blurs enough by itself."""
    grey = to_grey(image, region)
    if reduction > 1:
        height, width = grey.shape[0] // reduction, grey.shape[1] // reduction
        cut = grey[: height * reduction, : width * reduction]
        smooth = cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA)
    elif sigma_px > 0:
        taps = 2 * max(1, round(2.5 * sigma_px)) + 1
        smooth = cv2.GaussianBlur(grey, (taps, taps), sigma_px)
    else:
        smooth = grey
    return Prepared(region, grey, np.asarray(smooth, dtype=np.uint8), reduction)


def otsu(grey: Image) -> int:
    """Otsu's threshold of a grey image ("A threshold selection method from gray-level histograms", 1979)."""
    level, _ = cv2.threshold(np.ascontiguousarray(grey), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return int(level)


def global_otsu(image: Image, step: int = 6) -> int:
    """Otsu's threshold of the whole frame, from every step-th pixel of every step-th row."""
    thin = np.ascontiguousarray(image[::step, ::step])
    return otsu(to_grey(thin, whole(thin)))


def binarise(smooth: Image, threshold: int) -> Image:
    """255 where the image is at most the threshold (black of the landmark), 0 elsewhere."""
    _, binary = cv2.threshold(smooth, threshold, 255, cv2.THRESH_BINARY_INV)
    return np.asarray(binary, dtype=np.uint8)


LOCAL_OFFSET_DN = 6.0
"""A pixel counts as black if it is darker than its surroundings' mean by so much: noise and faint texture don't."""


def local_binary(smooth: Image, window_px: int) -> Image:
    """255 where the image is darker than the mean of a window round it, 0 elsewhere: what is black in light and shade.

    Source: Bradley and Roth, "Adaptive thresholding using the integral image", 2007 (the idea).
    """
    side = max(3, window_px | 1)
    binary = cv2.adaptiveThreshold(
        smooth, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, side, LOCAL_OFFSET_DN
    )
    return np.asarray(binary, dtype=np.uint8)


def grow(region: Region, margin_px: float, size_px: tuple[int, int]) -> Region:
    """A region with a margin, kept inside an image of (width, height)."""
    width, height = size_px
    u0, v0 = max(0, int(region[0] - margin_px)), max(0, int(region[1] - margin_px))
    u1, v1 = min(width, int(region[2] + margin_px) + 1), min(height, int(region[3] + margin_px) + 1)
    return u0, v0, max(u1, u0), max(v1, v0)
