"""From POV-Ray's linear light to the camera's frame: lens blur, motion, stray light, exposure, response, noise, codec.

Blur and motion are applied in the frequency domain, where both are exact and symmetric: they move no edge.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from optics import lens
from povray_world import KEY
from scenes import Scene

Plane = NDArray[np.float32]
RIM = 32
"""Pixels mirrored round the image before the transform, so that its sides don't run into each other."""


def _blurred(light: Plane, scene: Scene) -> Plane:
    """A Gaussian for the lens, a box along the motion for the exposure time."""
    framed = cv2.copyMakeBorder(light, RIM, RIM, RIM, RIM, cv2.BORDER_REFLECT_101)
    rows, columns = framed.shape
    v = np.fft.fftfreq(rows)[:, None]
    u = np.fft.rfftfreq(columns)[None, :]
    gauss = np.exp(-2.0 * np.pi**2 * scene.blur_px**2 * (u**2 + v**2))
    box = np.sinc(u * scene.motion_px[0] + v * scene.motion_px[1])
    seen = np.fft.irfft2(np.fft.rfft2(framed) * gauss * box, s=framed.shape)
    return np.asarray(seen[RIM:-RIM, RIM:-RIM], np.float32)


def sense(light: Plane, scene: Scene, source: np.random.Generator) -> NDArray[np.uint8]:
    """The frame (480, 640) of linear light, in which a level board of reflectance r gives KEY r."""
    seen = np.maximum(_blurred(light, scene), 0.0)
    seen = seen * (1 - scene.veil) + scene.veil * float(seen.mean())
    seen = seen * lens(scene.lens).shading(scene.vignette)
    by_mean = 0.25 / max(float(seen.mean()), 1e-4)
    by_paper = 0.8 / (KEY * scene.paper)
    gain = min(by_mean**scene.meter * by_paper ** (1 - scene.meter), 1.6 * by_paper) * scene.exposure
    response = np.clip(seen * np.float32(gain), 0, 1) ** np.float32(1 / scene.gamma)
    level = scene.black_level + (255 - scene.black_level) * response
    grain = source.standard_normal(level.shape).astype(np.float32)
    if scene.noise_grain > 0:
        grain = np.asarray(cv2.GaussianBlur(grain, (0, 0), scene.noise_grain), np.float32)
    grain *= np.float32(scene.noise / float(grain.std())) * np.sqrt(np.float32(0.3) + np.float32(1.4) * response)
    image = np.clip(np.rint(level + grain), 0, 255).astype(np.uint8)
    if scene.jpeg is not None:
        _, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg])
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)
    return image
