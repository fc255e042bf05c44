"""What a camera sees of a flat pad under it, at the worst tilt, heading and place that are allowed for.

Lengths on the pad are measured in heights of the camera above it, since both what is in view and how large it appears
depend on their quotient alone. The pad may lie anywhere off the middle up to a part of the view that is left once the
tilt is taken off it, so that the whole view scales with the height too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.errors import ConfigError
from app.frames import Array
from app.vision.camera_model import Lens

BORDER_PX = 3.0
"""Nearer to the image's border a contour's edge, blurred, counts as cut."""
LINES = 180
"""Directions round the axis in which the border is sought: as many degrees are between two of them as two pixels of a
640 pixel wide image at most."""
STEPS = 400
WIDEST_RAD = math.radians(70.0)
"""A print further off the vertical is seen so flat (a third of its size) that no lens is counted on to show it."""
NARROWEST_RAD = math.radians(1.0)
AZIMUTHS = 16
"""Directions of a tilt, and of the way to the pad, that are tried for the smallest appearance."""


@dataclass(frozen=True, slots=True)
class View:
    """A camera's view of a pad.

    Attributes:
        half_angle_rad: From the lens's axis to the nearest point of the image's border.
        tilt_rad: Angle of the axis off the vertical that is allowed for.
        offset: How far off the pad's middle may lie, as a part of what is left of the view: 0 to under 1.
        scale_px: Pixels of a length on the pad that is as long as the camera is high above it, at least.
    """

    half_angle_rad: float
    tilt_rad: float
    offset: float
    scale_px: float

    @property
    def usable_rad(self) -> float:
        """Angle off the vertical up to which all is in the image."""
        return min(self.half_angle_rad - self.tilt_rad, WIDEST_RAD)

    @property
    def reach(self) -> float:
        """What lies this far from the pad's middle, in heights, is in the image."""
        return (1.0 - self.offset) * math.tan(self.usable_rad)

    def lowest_m(self, radius_m: float) -> float:
        """Lowest height at which all within a distance of the pad's middle is in the image."""
        return radius_m / self.reach

    def highest_m(self, length_m: float, px: float) -> float:
        """Greatest height at which a length on the pad appears as so many pixels at least."""
        return length_m * self.scale_px / px


def view_of(lens: Lens, *, tilt_rad: float, offset: float) -> View:
    """A lens's view.

    Args:
        lens: The lens.
        tilt_rad: Angle of its axis off the vertical to allow for, any way round.
        offset: How far off the pad's middle may lie, as a part of the view that the tilt leaves; 0 to under 1.

    Raises:
        ConfigError: The tilt leaves nothing of the view, or the lens's axis lies at the image's border.
    """
    half_rad = half_angle_rad(lens)
    if half_rad - tilt_rad < NARROWEST_RAD:
        raise ConfigError(
            f"a tilt of {math.degrees(tilt_rad):g} deg leaves nothing of a view of {math.degrees(half_rad):.1f} deg to "
            "each side",
            "give a smaller --tilt, or a camera with a wider view",
        )
    bare = View(half_rad, tilt_rad, offset, 1.0)
    outermost = offset * math.tan(bare.usable_rad)
    return View(half_rad, tilt_rad, offset, min(_scale_px(lens, tilt_rad, off) for off in (0.0, outermost)))


def half_angle_rad(lens: Lens) -> float:
    """Angle from the lens's axis to the nearest point of the border of its image (or of the circle that it sees).

    Raises:
        ConfigError: The axis lies at the image's border.
    """
    middle, _ = lens.project(np.array([[0.0, 0.0, 1.0]]))
    width, height = lens.size_px
    low, high = np.full(2, BORDER_PX), np.array([width, height]) - 1.0 - BORDER_PX
    if not ((middle[0] > low) & (middle[0] < high)).all():
        raise ConfigError(
            f"the lens's axis at {middle[0, 0]:.1f}, {middle[0, 1]:.1f} px lies at the border of the image of "
            f"{width}x{height}",
            "mend cx_px and cy_px in the camera file",
        )
    turn = np.linspace(0.0, 2.0 * math.pi, LINES, endpoint=False)
    way = np.column_stack([np.cos(turn), np.sin(turn)])
    with np.errstate(divide="ignore"):
        room = np.where(way > 0, (high - middle[0]) / way, np.where(way < 0, (low - middle[0]) / way, np.inf))
    along = room.min(axis=1)[:, None] * np.linspace(0.0, 1.0, STEPS)
    px = middle[0] + way[:, None] * along[..., None]
    angle = np.arccos(np.clip(lens.rays(px.reshape(-1, 2))[:, 2], -1.0, 1.0)).reshape(LINES, STEPS)
    seen = np.isfinite(angle)
    # Up to the first pixel that no ray gives; a lens whose radius turns back sees nothing behind that either.
    last = np.where(seen.all(axis=1), STEPS, seen.argmin(axis=1)) - 1
    return float(angle[np.arange(LINES), last].min())


def _scale_px(lens: Lens, tilt_rad: float, off: float) -> float:
    """Pixels of a short length, in heights, on a pad that lies off heights beside the camera: the fewest of all ways.

    The least singular value of the derivative of pixels by places on the pad, over tilts and directions.
    """
    turns = np.linspace(0.0, 2.0 * math.pi, AZIMUTHS, endpoint=False)
    least = math.inf
    for angle in {0.0, tilt_rad}:
        for turn in turns:
            cam_from_level = _tilted(angle, float(turn))
            points = np.column_stack([off * np.cos(turns), off * np.sin(turns), np.ones(AZIMUTHS)])
            _, slopes, valid = lens.project_with_jacobian(points @ cam_from_level.T)
            across = slopes[valid] @ cam_from_level[:, :2]
            if not valid.all():
                return 0.0
            least = min(least, float(np.linalg.svd(across, compute_uv=False)[:, 1].min()))
    return least


def _tilted(angle_rad: float, turn_rad: float) -> Array:
    """(3, 3) rotation by an angle about a level axis (Rodrigues' formula)."""
    x, y = math.cos(turn_rad), math.sin(turn_rad)
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array(
        [
            [c + x * x * (1 - c), x * y * (1 - c), y * s],
            [x * y * (1 - c), c + y * y * (1 - c), -x * s],
            [-y * s, x * s, c],
        ]
    )
