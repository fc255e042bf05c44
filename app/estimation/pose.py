"""Where the landmark is in the camera's frame: method `pnp`, and what both methods share.

The detector's fit of the landmark's plane holds all that the image says; the pose is the rigid one that contradicts it
least. A flat pattern seen from afar has two such poses. The vehicle's attitude with the assumption of a nearly level
pad decides between them and steadies the tilt; where it is not known or contradicts the image, the image decides, and
in a sequence the pose before. The covariance is that of the fit and of the vertical, and admits the other pose where
it can't be ruled out. The mathematics are in app.estimation.planar.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from app.estimation.axes import Axes, dot, rotation_vector, vector
from app.estimation.planar import PlanarProblem, Solution
from app.frames import Array, Transform, quaternion_from_rotation, rotation_from_quaternion
from app.landmark import Landmark
from app.messages import CameraPose, Detection, PlaneFit
from app.vision.camera_model import Lens
from app.vision.plane import plane_fit_from_corners

CORNER_SIGMA_PX = 0.12
"""Standard deviation of a corner's coordinate, where a detection has corners and no plane. Chosen, not fitted: rendered
images show 0.02 to 0.1 px, and real ones will show more."""
COMMON_SIGMA_PX = 0.08
"""What all edges of a frame are off by together, outward: blur, exposure and print make every black contour a little
large or small. It acts on the scale, and so on the distance."""
PRIOR_TILT_SIGMA_RAD = math.radians(6.0)
"""How far the pad's normal may be from the vertical that the vehicle's attitude gives: slopes, the car's springs, the
attitude's own error."""
HUBER = 2.5
"""Corners that are off by more than this many sigma count linearly."""
SETTLED = 13.3
"""A pose found from the vertical is believed up to this cost, even where the other one costs less: the 99% point of chi
squared with 4 degrees of freedom (8 numbers of the plane and 2 of the vertical, less 6 of the pose)."""
CONSISTENT = 9.2
"""The plane's own part of that, 2 degrees of freedom; beyond, its information is taken for too high by this factor."""
HOPELESS = 100.0
"""A second pose is not refined where it starts with so many squared sigmas more than the first one."""
SAME_POSE = math.cos(math.radians(1.0))
"""Normals nearer to each other than this belong to one pose."""
STAY = 16.0
"""Squared sigmas by which the image must prefer the other pose to leave the one of the frame before: 4 sigma."""
RULED_OUT = 16.0
"""Squared sigmas at which the other pose leaves no trace in the covariance: its weight is 3e-4."""


def plane_of_corners(detection: Detection, landmark: Landmark, lens: Lens) -> PlaneFit | None:
    """The plane of a detection that has corners alone; its information is lowered where they contradict each other."""
    if not detection.contours:
        return None
    pad = np.concatenate([landmark.contours[c.index].corners_m for c in detection.contours])
    px = np.concatenate([c.corners_px for c in detection.contours])
    unit_m = 0.5 * landmark.size_m
    plane = plane_fit_from_corners(pad, px, lens, CORNER_SIGMA_PX, unit_m, huber_sigmas=HUBER)
    free = 2 * len(pad) - 8
    if plane is None or free <= 0:
        return plane
    excess = plane.residual_px**2 * len(pad) / (free * CORNER_SIGMA_PX**2)
    return plane if excess <= 1.0 else replace(plane, information=plane.information / excess)


def _poses(problem: PlanarProblem, expected_normal_cam: Array | None) -> list[Solution]:
    """The pose, or the two that a flat pattern has; the one to be believed first."""
    level = None if problem.down is None else problem.view.level_pose(problem.down)
    first = None if level is None else problem.refine(level)
    if first is not None and first.cost < SETTLED:
        # What is left is whether the other pose can be ruled out.
        normal = first.axes.normal
        other = min(problem.view.both_poses(), key=lambda axes: dot(axes.normal, normal))
        return _refined(problem, (other,), [first])
    found = sorted(_refined(problem, problem.view.both_poses(), [] if first is None else [first]), key=lambda s: s.cost)
    if expected_normal_cam is not None and len(found) > 1 and found[1].cost - found[0].cost < STAY:
        expected = vector(expected_normal_cam)
        found[:2] = sorted(found[:2], key=lambda s: -dot(s.axes.normal, expected))
    return found


def _refined(problem: PlanarProblem, starts: Iterable[Axes], found: list[Solution]) -> list[Solution]:
    """What was found, and what comes of the starts that are not hopeless beside it."""
    begun = [start for start in map(problem.begin, starts) if start is not None]
    for start in sorted(begun, key=lambda s: s.cost):
        if found and start.cost > min(s.cost for s in found) + HOPELESS:
            break
        solution = problem.refine(start.axes, start.scale)
        if solution is not None and all(dot(solution.axes.normal, s.axes.normal) < SAME_POSE for s in found):
            found = [*found, solution]
    return found


def estimate_camera_pose(
    detection: Detection,
    landmark: Landmark,
    lens: Lens,
    prior_rotation_cam_from_pad: Array | None = None,
    expected_normal_cam: Array | None = None,
) -> CameraPose | None:
    """Method `pnp`: the rigid pose that the plane of a detection says.

    Args:
        detection: With a plane, or at least four corners.
        landmark: Whose plane or corners they are.
        lens: Of the camera.
        prior_rotation_cam_from_pad: (3, 3) of a level pad at the vehicle's attitude, any heading; only its down axis is
            used. None: without, the pose that fits better is taken.
        expected_normal_cam: (3,) the pad's down axis in the camera frame as the frame before had it. It decides between
            two poses that the image can't tell apart, and moves neither.

    Returns:
        The pose; None where the detection determines none.
    """
    plane = detection.plane or plane_of_corners(detection, landmark, lens)
    if plane is None:
        return None
    down = None if prior_rotation_cam_from_pad is None else vector(prior_rotation_cam_from_pad[:, 2])
    try:
        problem = PlanarProblem(plane, down, PRIOR_TILT_SIGMA_RAD)
    except ValueError:
        return None
    found = _poses(problem, expected_normal_cam)
    if not found:
        return None
    return _camera_pose(problem, found[0], found[1] if len(found) > 1 else None, plane, lens.focal_px)


def _camera_pose(
    problem: PlanarProblem, best: Solution, other: Solution | None, plane: PlaneFit, focal_px: float
) -> CameraPose | None:
    """A solution with an honest covariance.

    That of the fit, widened where a rigid pose contradicts it; the second moment about this pose of both poses, weighed
    by their likelihoods; and an error that all edges share, which changes the pattern's size in the image and so moves
    the pad along the line of sight.
    """
    try:
        (x, y, z), information = problem.finish(best)
        covariance = np.linalg.inv(information)
        distance2 = x * x + y * y + z * z
        if not (math.isfinite(distance2) and dot(best.axes.normal, (x, y, z)) > 0.0):
            return None
        contradiction = best.cost - best.tilt_cost
        if contradiction > CONSISTENT:
            covariance *= contradiction / CONSISTENT
        if other is not None and other.cost - best.cost < RULED_OUT:
            (there_x, there_y, there_z), information = problem.finish(other)
            weight = 1.0 / (1.0 + math.exp(0.5 * (other.cost - best.cost)))
            turn = rotation_vector(other.axes.rotation @ best.axes.rotation.T)
            apart = np.array([there_x - x, there_y - y, there_z - z, *turn])
            covariance = (1.0 - weight) * covariance + weight * (np.linalg.inv(information) + np.outer(apart, apart))
    except np.linalg.LinAlgError:
        return None
    # The pattern is radius * focal / distance pixels large.
    common = COMMON_SIGMA_PX / max(problem.view.radius_m * focal_px, math.sqrt(distance2))
    covariance[:3, :3] += (common * common * distance2) * np.array(
        ((x * x, x * y, x * z), (x * y, y * y, y * z), (x * z, y * z, z * z))
    )
    return CameraPose(
        np.array((x, y, z)),
        quaternion_from_rotation(best.axes.rotation),
        0.5 * (covariance + covariance.T),
        plane.residual_px,
    )


def cam_from_pad(pose: CameraPose) -> Transform:
    """A camera pose as a transform."""
    return Transform(rotation_from_quaternion(pose.q_cam_from_pad_wxyz), pose.t_cam_from_pad_m)


def pad_normal_cam(pose: CameraPose) -> Array:
    """(3,) the pad's down axis in the camera frame."""
    w, x, y, z = pose.q_cam_from_pad_wxyz.tolist()
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])


def predicted_corners_px(pose: CameraPose, landmark: Landmark, lens: Lens, index: int = 0) -> Array:
    """(n, 2) corners of a contour where the pose puts them, seen or not; not a number outside the lens's view."""
    corners = landmark.contours[index].corners_m
    points = cam_from_pad(pose).apply(np.column_stack([corners, np.zeros(len(corners))]))
    return lens.project(points)[0]
