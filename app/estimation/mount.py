"""How the camera sits on the vehicle."""

from __future__ import annotations

import math

import numpy as np

from app.config import CameraConfig
from app.frames import (
    BODY_FROM_CAM_DOWN,
    Array,
    Transform,
    rotation_from_euler,
    rotation_from_quaternion,
    rotation_from_yaw,
    yaw_from_rotation,
)


def body_from_cam(camera: CameraConfig) -> Transform:
    """The camera frame in the body frame: a camera that looks down, turned by yaw, then pitch, then roll."""
    turned = rotation_from_euler(
        math.radians(camera.mount_roll_deg), math.radians(camera.mount_pitch_deg), math.radians(camera.mount_yaw_deg)
    )
    return Transform(turned @ BODY_FROM_CAM_DOWN, np.array(camera.position_body_m, dtype=np.float64))


def level_from_cam(q_ned_from_body_wxyz: Array, body_from_cam_rotation: Array) -> Array:
    """(3, 3) rotation of the camera frame into a levelled one: same place, looking straight down, the top of its image
    towards the vehicle's heading. This is the camera that the paper's equations are written for.
    """
    ned_from_body = rotation_from_quaternion(q_ned_from_body_wxyz)
    heading_from_ned = rotation_from_yaw(yaw_from_rotation(ned_from_body)).T
    result: Array = BODY_FROM_CAM_DOWN.T @ heading_from_ned @ ned_from_body @ body_from_cam_rotation
    return result
