"""Pose: each detection becomes a fix at its capture time, and the fix goes into the target estimator."""

from __future__ import annotations

from collections.abc import Callable

from app.channels import Latest, Topic, Window
from app.estimation.target import TargetEstimator
from app.estimation.vehicle_history import VehicleHistory
from app.log import get_logger
from app.messages import Detection, PadFix, PadTrack, VehicleState
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
    history: VehicleHistory,
    make_fix: FixMaker,
    estimator: TargetEstimator,
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
            resets = state.frame_resets
        if not detection.detected:
            continue
        at_capture = history.at(detection.t_capture_s)
        if at_capture is None:
            continue
        fix = await compute(lambda seen=detection, state=at_capture: make_fix(seen, state))  # type: ignore[misc]
        if fix is None:
            continue
        fixes.publish(fix)
        tracks.publish(estimator.update(fix))
