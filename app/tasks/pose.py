"""Pose: each detection becomes a fix at its capture time, and the fix goes into the target estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from app.channels import Latest, Topic, Window
from app.estimation.copy_check import CopyCheck
from app.estimation.fix import is_finite
from app.estimation.target import TargetEstimator
from app.estimation.vehicle_history import VehicleHistory
from app.log import get_logger
from app.messages import Detection, PadFix, PadTrack, TrackCheck, VehicleState
from app.tasks.compute import Compute

log = get_logger("pose")

FixMaker = Callable[[Detection, VehicleState], PadFix | None]
"""From a detection and the vehicle's state at its capture time to a fix; None if it yields none."""


async def run_pose(
    *,
    detections: Latest[Detection],
    vehicle: Window[VehicleState],
    fixes: Topic[PadFix],
    tracks: Topic[PadTrack],
    checks: Topic[TrackCheck],
    history: VehicleHistory,
    make_fix: FixMaker,
    estimator: TargetEstimator,
    copy_check: CopyCheck,
    compute: Compute,
) -> None:
    """Run until cancelled."""
    resets: int | None = None
    while True:
        detection = await detections.get()
        for state in vehicle.drain():
            history.add(state)
            if resets is not None and state.frame_resets != resets:
                log.warning("frame.reset", count=state.frame_resets)
                estimator.reset()
                copy_check.reset()
            resets = state.frame_resets
        if not detection.detected:
            continue
        # With the vehicle's pose of when it was exposed, as far as that is known: where the vehicle turns to and fro,
        # what a fix is off by is no matter of the turning of one instant.
        delay_s = estimator.delay_s
        exposed_s = detection.t_capture_s + delay_s
        at_capture = history.at(exposed_s)
        if at_capture is None:
            continue
        fix = await compute(partial(make_fix, detection, at_capture.state))
        if fix is None:
            continue
        turning = history.turning_rad_s(exposed_s)
        shift = (
            None if turning is None else at_capture.state.vel_ned_m_s + np.cross(turning, fix.pad_from_vehicle_ned_m)
        )
        fix = replace(
            fix,
            t_capture_s=exposed_s,
            delay_s=delay_s,
            travelled_ned_m=at_capture.travelled_ned_m,
            shift_ned_m_s=shift,
        )
        if not is_finite(fix):
            continue
        fixes.publish(fix)
        checks.publish(copy_check.update(fix, at_capture.state.q_ned_from_body_wxyz))
        tracks.publish(estimator.update(fix))
