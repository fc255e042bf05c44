"""From a detection to a fix: the pose in the camera frame by either method, carried into PX4's local frame with the
vehicle's pose at the time of the exposure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from app.estimation.height_table import HeightTable, computed_height_table
from app.estimation.mount import level_from_cam
from app.estimation.paper import camera_pose_from_paper, paper_pose
from app.estimation.pose import estimate_camera_pose, pad_normal_cam
from app.frames import Array, Transform, clamp, rotation_from_quaternion, tilt_rad, yaw_from_rotation
from app.landmark import Landmark
from app.messages import CameraPose, Detection, PadFix, PaperPose, VehicleState
from app.vision.camera_model import Lens

Method = Literal["pnp", "paper"]

ATTITUDE_SIGMA_RAD = math.radians(1.0)
"""PX4's roll, pitch and heading in flight, and the camera's mount: they move the pad by this part of its distance.
Taken as new in each fix; in truth it lasts over many."""
MEMORY_S = 1.0
"""For so long the pad's slope in one fix tells the two poses of the next one apart."""


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """What one detection says of the pad's place.

    Attributes:
        camera: By the chosen method; None where it gives none.
        paper: The paper's own outputs, where its triangle was seen and they were asked for.
    """

    camera: CameraPose | None
    paper: PaperPose | None


@dataclass(frozen=True, slots=True)
class PoseEstimator:
    """Both methods with what they need.

    Attributes:
        landmark: The drawing.
        lens: Of the camera.
        method: Which gives the camera pose.
        table: The paper's height table; None where the landmark has no triangle.
    """

    landmark: Landmark
    lens: Lens
    method: Method
    table: HeightTable | None

    def estimate(
        self,
        detection: Detection,
        level: Array | None = None,
        *,
        expected_normal_cam: Array | None = None,
        paper_too: bool = True,
    ) -> PoseEstimate:
        """Pose of the pad in the camera frame.

        Args:
            detection: With or without the landmark.
            level: (3, 3) level_from_cam by the vehicle's attitude, where known (app.estimation.mount). For a pose by
                method pnp alone, any frame whose third axis is down will do for its target.
            expected_normal_cam: (3,) the pad's down axis in the camera frame by the frame before, where there is one:
                it tells the two poses of a flat pattern apart where the image can't (see estimate_camera_pose).
            paper_too: The paper's outputs are wanted beside a pose by method pnp.
        """
        if not detection.detected:
            return PoseEstimate(None, None)
        paper: PaperPose | None = None
        if self.table is not None and (paper_too or self.method == "paper"):
            paper = paper_pose(detection, self.landmark, self.lens, self.table, level)
        if self.method == "pnp":
            prior = None if level is None else level.T
            camera = estimate_camera_pose(detection, self.landmark, self.lens, prior, expected_normal_cam)
            return PoseEstimate(camera, paper)
        if paper is None or self.table is None:
            return PoseEstimate(None, paper)
        camera = camera_pose_from_paper(paper, detection, self.landmark, self.lens, self.table, level)
        return PoseEstimate(camera, paper)


def pose_estimator(landmark: Landmark, lens: Lens, method: Method, table: HeightTable | None = None) -> PoseEstimator:
    """A PoseEstimator; without a recorded table the paper's heights come from one worked out from the lens."""
    return PoseEstimator(landmark, lens, method, table or computed_height_table(landmark, lens.focal_px))


def pad_fix(
    detection: Detection,
    camera_pose: CameraPose,
    vehicle: VehicleState,
    body_from_cam: Transform,
    paper: PaperPose | None = None,
) -> PadFix:
    """The pad in PX4's local frame.

    Args:
        detection: The pose rests on it.
        camera_pose: Of the pad in the camera frame, by either method.
        vehicle: Its pose at the detection's capture time.
        body_from_cam: How the camera is mounted (app.estimation.mount).
        paper: The paper's own outputs, to be carried along.
    """
    ned_from_body = rotation_from_quaternion(vehicle.q_ned_from_body_wxyz)
    ned_from_cam = ned_from_body @ body_from_cam.rotation
    ned_from_pad = ned_from_cam @ rotation_from_quaternion(camera_pose.q_cam_from_pad_wxyz)
    from_vehicle = ned_from_cam @ camera_pose.t_cam_from_pad_m + ned_from_body @ body_from_cam.translation
    covariance = ned_from_cam @ camera_pose.covariance[:3, :3] @ ned_from_cam.T
    # A small rotation w of the vehicle moves the pad by w x r: covariance s^2 [r]x [r]x^T = s^2 (r.r I - r r^T).
    x, y, z = from_vehicle.tolist()
    covariance += ATTITUDE_SIGMA_RAD**2 * np.array(
        ((y * y + z * z, -x * y, -x * z), (-x * y, x * x + z * z, -y * z), (-x * z, -y * z, x * x + y * y))
    )
    down = ned_from_cam[2]
    turned = ned_from_cam @ camera_pose.covariance[3:, 3:] @ ned_from_cam.T
    normal_variance = 0.5 * clamp(float(turned[0, 0] + turned[1, 1]), 0.0, math.inf) + ATTITUDE_SIGMA_RAD**2
    yaw_variance = clamp(float(down @ camera_pose.covariance[3:, 3:] @ down), 0.0, math.inf) + ATTITUDE_SIGMA_RAD**2
    return PadFix(
        t_capture_s=detection.t_capture_s,
        pad_pos_ned_m=vehicle.pos_ned_m + from_vehicle,
        pad_from_vehicle_ned_m=from_vehicle,
        covariance_ned_m2=covariance,
        pad_yaw_ned_rad=yaw_from_rotation(ned_from_pad),
        yaw_sigma_rad=math.sqrt(yaw_variance),
        code=detection.code or "",
        pad_tilt_rad=tilt_rad(ned_from_pad),
        paper=paper,
        pad_normal_ned=ned_from_pad[:, 2] if paper is None else None,  # the paper's equations hold for a level pad
        normal_sigma_rad=math.sqrt(normal_variance),
    )


def is_finite(fix: PadFix) -> bool:
    """Whether every figure of a fix is a number: a single NaN would stay in the track for good."""
    figures = (
        (fix.t_capture_s, fix.pad_yaw_ned_rad, fix.yaw_sigma_rad, fix.pad_tilt_rad, fix.normal_sigma_rad, fix.delay_s),
        (fix.pad_pos_ned_m, fix.pad_from_vehicle_ned_m, fix.covariance_ned_m2),
        tuple(part for part in (fix.travelled_ned_m, fix.pad_normal_ned, fix.shift_ned_m_s) if part is not None),
    )
    return all(bool(np.isfinite(value).all()) for group in figures for value in group)


@dataclass(slots=True)
class FixMaker:
    """Detection and vehicle state to fix: what the pose task calls for each frame, in their order.

    Attributes:
        estimator: Method, landmark and lens.
        body_from_cam: How the camera is mounted.
    """

    estimator: PoseEstimator
    body_from_cam: Transform
    _slope: tuple[float, Array] | None = field(default=None, init=False)
    """When the last fix was, and the pad's down axis in ned by it: a pad's slope changes slowly, whatever the vehicle
    does."""

    def __call__(self, detection: Detection, vehicle: VehicleState) -> PadFix | None:
        """The fix; None if the detection yields none."""
        if not detection.detected:
            return None
        ned_from_cam = rotation_from_quaternion(vehicle.q_ned_from_body_wxyz) @ self.body_from_cam.rotation
        expected: Array | None = None
        if self._slope is not None and 0.0 <= detection.t_capture_s - self._slope[0] <= MEMORY_S:
            expected = self._slope[1] @ ned_from_cam
        # Method pnp only takes the vertical from it, and ned is as level as any frame.
        paper = self.estimator.method == "paper"
        level = level_from_cam(vehicle.q_ned_from_body_wxyz, self.body_from_cam.rotation) if paper else ned_from_cam
        found = self.estimator.estimate(detection, level, expected_normal_cam=expected, paper_too=False)
        if found.camera is None:
            return None
        self._slope = detection.t_capture_s, ned_from_cam @ pad_normal_cam(found.camera)
        return pad_fix(detection, found.camera, vehicle, self.body_from_cam, found.paper)
