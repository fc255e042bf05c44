"""Method `paper`: equations (3) to (13) of Wu et al., in this project's frames.

The paper's camera looks straight down. Here the vehicle's tilt is taken out first: the corners' rays are turned into a
levelled virtual camera (app.estimation.mount.level_from_cam) that has no distortion and the height table's own focal
length, with the middle of its image at (0, 0). Its pixels are the table's pixels.
Only the outer triangle (the paper's T3) is needed. The paper was at hand in outline; where it leaves something open the
equation's docstring says how it is closed.
"""

from __future__ import annotations

import math

import numpy as np

from app.estimation.height_table import HeightTable, outer_triangle
from app.frames import BODY_FROM_CAM_DOWN, Array, quaternion_from_rotation, rotation_from_yaw
from app.landmark import Landmark
from app.messages import CameraPose, Detection, PaperPose
from app.vision.camera_model import Lens

LENGTH_SIGMA_PX = 0.4
"""Of a side's length, in pixels of the virtual camera."""
TABLE_SIGMA = 0.01
"""Relative error of the table's lengths."""
TILT_SIGMA_RAD = math.radians(4.0)
"""The paper takes the landmark for level and the camera for levelled."""


def equation_3(vertices_px: Array) -> float:
    """(3) u of the landmark's centre: mean of the triangle's three vertices (3, 2)."""
    return float(vertices_px[0, 0] + vertices_px[1, 0] + vertices_px[2, 0]) / 3.0


def equation_4(vertices_px: Array) -> float:
    """(4) v of the landmark's centre, likewise."""
    return float(vertices_px[0, 1] + vertices_px[1, 1] + vertices_px[2, 1]) / 3.0


def equation_5(centre_u_px: float, middle_u_px: float, side_m: float, side_px: float) -> float:
    """(5) x_c: metres from the camera's axis to the landmark's centre, along image right.

    A pixel at the landmark's distance is as many metres as the triangle's known side over its length in the image.
    """
    return (centre_u_px - middle_u_px) * side_m / side_px


def equation_6(centre_v_px: float, middle_v_px: float, side_m: float, side_px: float) -> float:
    """(6) y_c: the same along image down."""
    return (centre_v_px - middle_v_px) * side_m / side_px


def equation_7(x_c_m: float, y_c_m: float, yaw_rad: float) -> tuple[float, float]:
    """(7) x_w, y_w: the vehicle's place relative to the landmark, along east and south.

    The landmark's offset in the image, turned by the vehicle's heading (clockwise of north); the vehicle lies the other
    way from the landmark, hence the sign.
    """
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return -(c * x_c_m - s * y_c_m), -(s * x_c_m + c * y_c_m)


def equation_8(vertices_px: Array) -> Array:
    """(8) (2,) middle of the triangle's base; vertices (3, 2) are apex, back right, back left."""
    result: Array = 0.5 * (vertices_px[1] + vertices_px[2])
    return result


def equation_9(vertices_px: Array, base_px: Array) -> Array:
    """(9) (2,) the landmark's axis in the image: from the base's middle to the apex."""
    result: Array = vertices_px[0] - base_px
    return result


def equation_10(axis_px: Array) -> float:
    """(10) theta: heading of the landmark relative to the vehicle, positive clockwise, right in all four quadrants.

    Image up is the vehicle's forward, image right its right.
    """
    return math.atan2(float(axis_px[0]), -float(axis_px[1]))


def equation_11(centre_px: Array, middle_px: Array, offset_distance_px: float) -> float:
    """(11) Weight of the table's second group: the centre's distance from the image's middle over D, at most 1."""
    return min(1.0, float(np.hypot(*(centre_px - middle_px))) / offset_distance_px)


def equation_12(table: HeightTable, weight: float) -> Array:
    """(12) (n,) lengths that the table would hold at this offset: (1 - w) L1 + w L2."""
    result: Array = (1.0 - weight) * table.centred_px + weight * table.offset_px
    return result


def equation_13(length_px: float, lengths_px: Array, heights_m: Array) -> float:
    """(13) Height from a length, between the two rows that enclose it.

    A length is inversely proportional to the height, so the height is linear in 1 / L between rows; beyond the ends it
    follows H L = constant of the last row.
    """
    if length_px >= lengths_px[0]:
        return float(heights_m[0] * lengths_px[0] / length_px)
    if length_px <= lengths_px[-1]:
        return float(heights_m[-1] * lengths_px[-1] / length_px)
    return float(np.interp(1.0 / length_px, 1.0 / lengths_px, heights_m))


def longest_side_px(vertices_px: Array) -> float:
    """Longest side of a polygon (n, 2)."""
    return float(np.linalg.norm(vertices_px - np.roll(vertices_px, 1, axis=0), axis=1).max())


def _levelled(px: Array, lens: Lens, level: Array, focal_px: float) -> Array | None:
    """Pixels (n, 2) in the levelled virtual camera, its middle at (0, 0); None if a ray doesn't point down."""
    rays = lens.rays(px) @ level.T
    if not (rays[:, 2] > 0.05).all():
        return None
    result: Array = rays[:, :2] / rays[:, 2:] * focal_px
    return result


def paper_pose(
    detection: Detection, landmark: Landmark, lens: Lens, table: HeightTable, level_from_cam: Array | None = None
) -> PaperPose | None:
    """All equations on one detection.

    Args:
        detection: Of the landmark.
        landmark: Its drawing.
        lens: Of the camera.
        table: Heights and lengths.
        level_from_cam: (3, 3) takes the vehicle's tilt out; None for a camera that looks straight down.

    Returns:
        The outputs; None where the outer triangle was not found.
    """
    triangle = outer_triangle(landmark)
    if triangle is None:
        return None
    index, contour = triangle
    seen = next((c for c in detection.contours if c.index == index), None)
    if seen is None:
        return None
    level = np.eye(3) if level_from_cam is None else level_from_cam
    vertices = _levelled(seen.corners_px, lens, level, table.focal_px)
    if vertices is None:
        return None
    centre = np.array([equation_3(vertices), equation_4(vertices)])
    side_px = longest_side_px(vertices)
    if side_px < 1e-6:
        return None
    weight = equation_11(centre, np.zeros(2), table.offset_distance_px)
    # The table knows a triangle of its own size: a larger one looks as long from further away.
    as_recorded_px = side_px * table.side_m / contour.side_m
    return PaperPose(
        x_c_m=equation_5(centre[0], 0.0, contour.side_m, side_px),
        y_c_m=equation_6(centre[1], 0.0, contour.side_m, side_px),
        h_m=equation_13(as_recorded_px, equation_12(table, weight), table.heights_m),
        theta_rad=equation_10(equation_9(vertices, equation_8(vertices))),
    )


def camera_pose_from_paper(
    paper: PaperPose,
    detection: Detection,
    landmark: Landmark,
    lens: Lens,
    table: HeightTable,
    level_from_cam: Array | None = None,
) -> CameraPose:
    """The paper's outputs as a pose of the pad in the camera frame: a level pad, its origin instead of its triangle's
    centroid, the tilt put back in. The covariance is that of the lengths in the image and of the table.
    """
    level = np.eye(3) if level_from_cam is None else level_from_cam
    triangle = outer_triangle(landmark)
    centroid = np.zeros(2) if triangle is None else triangle[1].centroid_m
    side_m = table.side_m if triangle is None else triangle[1].side_m
    level_from_pad = BODY_FROM_CAM_DOWN.T @ rotation_from_yaw(paper.theta_rad)
    centre = np.array([paper.x_c_m, paper.y_c_m, paper.h_m])
    t_level = centre - level_from_pad @ np.array([centroid[0], centroid[1], 0.0])
    side_px = table.focal_px * side_m / paper.h_m
    relative = math.hypot(LENGTH_SIGMA_PX / side_px, TABLE_SIGMA)
    across_m = LENGTH_SIGMA_PX * paper.h_m / table.focal_px
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.outer(t_level, t_level) * relative**2 + np.eye(3) * across_m**2
    turn = LENGTH_SIGMA_PX / (0.5 * side_px)
    covariance[3:, 3:] = np.diag([TILT_SIGMA_RAD**2, TILT_SIGMA_RAD**2, turn**2])
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = level.T
    rotation = level.T @ level_from_pad
    translation = level.T @ t_level
    error: list[Array] = []
    for contour in detection.contours:
        corners = landmark.contours[contour.index].corners_m
        points = np.column_stack([corners, np.zeros(len(corners))]) @ rotation.T + translation
        error.append(np.nan_to_num(lens.project(points)[0] - contour.corners_px, nan=1e3))
    off = np.concatenate(error)
    return CameraPose(
        translation,
        quaternion_from_rotation(rotation),
        both @ covariance @ both.T,
        math.sqrt(float(np.mean(np.sum(off * off, axis=1)))),
    )
