"""A lens as the vector that a fit changes: fx, fy, cx, cy and the distortion, with derivatives by it.

pinhole: k1 k2 p1 p2 k3 (Brown, 1971); equidistant: k1 k2 k3 k4 (Kannala and Brandt, 2006); the mapping itself is
app.vision.camera_model's, so what is fitted is what flies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from app.config import LensConfig
from app.frames import Array
from app.vision.camera_model import Lens, lens_from_config

ModelName = Literal["pinhole", "equidistant"]

NAMES: dict[ModelName, tuple[str, ...]] = {
    "pinhole": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    "equidistant": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}
"""What stands where in a vector of parameters."""

STAGES: dict[ModelName, tuple[frozenset[str], ...]] = {
    "pinhole": (frozenset({"k3"}), frozenset()),
    "equidistant": (frozenset({"k3", "k4"}), frozenset()),
}
"""What is held at zero, from the simplest lens to the fullest: a coefficient that the data do not ask for bends the
lens where no corner was seen."""


@dataclass(frozen=True, slots=True)
class Model:
    """What is fitted.

    Attributes:
        name: Kind of lens.
        size_px: Width, height of the images.
        held: Names of the parameters that stay zero.
    """

    name: ModelName
    size_px: tuple[int, int]
    held: frozenset[str] = frozenset()

    @property
    def free(self) -> NDArray[np.int64]:
        """(f,) indices of the parameters that are fitted."""
        return np.array([i for i, name in enumerate(NAMES[self.name]) if name not in self.held], dtype=np.int64)

    def plain(self, focal_px: float) -> Array:
        """(p,) parameters without distortion, centred."""
        width, height = self.size_px
        result = np.zeros(len(NAMES[self.name]))
        result[:4] = focal_px, focal_px, (width - 1) / 2, (height - 1) / 2
        return result

    def config(self, parameters: Array) -> LensConfig:
        """The camera file's content; not checked against its limits, which a fit may leave on its way."""
        fx, fy, cx, cy, *k = (float(v) for v in parameters)
        width, height = self.size_px
        return LensConfig.model_construct(
            model=self.name,
            width_px=width,
            height_px=height,
            fx_px=fx,
            fy_px=fy,
            cx_px=cx,
            cy_px=cy,
            distortion=tuple(k) if any(k) else (),
        )

    def lens(self, parameters: Array) -> Lens:
        """The lens of these parameters (p,)."""
        return lens_from_config(self.config(parameters))


def parameter_jacobian(model: Model, parameters: Array, points_cam: Array, px: Array) -> Array:
    """(n, 2, p) d pixel / d parameter of points (n, 3) of the camera frame, whose pixels px (n, 2) are known."""
    focal, centre = parameters[:2], parameters[2:4]
    jac = np.zeros((len(px), 2, len(parameters)))
    jac[:, [0, 1], [0, 1]] = (px - centre) / focal
    jac[:, [0, 1], [2, 3]] = 1.0
    x, y, z = points_cam.T
    if model.name == "pinhole":
        x, y = x / z, y / z
        r2 = x * x + y * y
        jac[:, 0, 4:] = np.column_stack([x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3])
        jac[:, 1, 4:] = np.column_stack([y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3])
    else:
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        bent = theta[:, None] ** np.array([3, 5, 7, 9])
        unit = np.column_stack([x, y]) / np.maximum(rho, 1e-12)[:, None]
        jac[:, :, 4:] = unit[:, :, None] * bent[:, None, :]
    jac[:, :, 4:] *= focal[:, None]
    return jac
