"""The loops that carry data: telemetry, pose, recorder."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.channels import Latest, Topic
from app.clock import run_virtual
from app.config import EstimationConfig
from app.errors import AutopilotError
from app.estimation.copy_check import CopyCheck
from app.estimation.target import TargetEstimator
from app.estimation.vehicle_history import VehicleHistory
from app.frames import quaternion_from_rotation, rotation_from_euler, rotation_from_quaternion
from app.messages import Detection, OperatorText, PadFix, PadTrack, SeenContour, TrackCheck, VehicleState
from app.tasks.compute import in_place
from app.tasks.pose import run_pose
from app.tasks.recorder import Recorded, run_recorder
from app.tasks.telemetry import run_telemetry

SEEN = (SeenContour(0, np.zeros((4, 2))),)


def test_telemetry_passes_states_on_and_an_end_of_them_is_an_error(fakes: Any):
    async def main() -> VehicleState | None:
        autopilot = fakes.Autopilot()
        autopilot.states_end_s = 1.0
        vehicle: Topic[VehicleState] = Topic("vehicle")
        newest = vehicle.subscribe()
        with pytest.raises(AutopilotError):
            await run_telemetry(autopilot=autopilot, vehicle=vehicle)
        return newest.newest

    state = run_virtual(main())
    assert state is not None and state.t_capture_s == pytest.approx(0.99)


class PoseBench:
    """The pose loop with a fix maker that takes the pad to be 3 m below the vehicle."""

    def __init__(self, fakes: Any) -> None:
        self.fakes = fakes
        self.detections: Topic[Detection] = Topic("detections")
        self.vehicle: Topic[VehicleState] = Topic("vehicle")
        self.fixes: Topic[PadFix] = Topic("fixes")
        self.tracks: Topic[PadTrack] = Topic("tracks")
        self.checks: Topic[TrackCheck] = Topic("track_checks")
        self.made = self.fixes.subscribe_all()
        self.tracked: Latest[PadTrack] = self.tracks.subscribe()
        self.spoil = 0.0
        self.loop = run_pose(
            detections=self.detections.subscribe(),
            vehicle=self.vehicle.subscribe_window(200),
            fixes=self.fixes,
            tracks=self.tracks,
            checks=self.checks,
            history=VehicleHistory(2.0),
            make_fix=self.fix,
            estimator=TargetEstimator(EstimationConfig()),
            copy_check=CopyCheck(),
            compute=in_place,
        )

    def fix(self, detection: Detection, state: VehicleState) -> PadFix:
        below = np.array([0.0, 0.0, 3.0])
        pad = state.pos_ned_m + below + self.spoil
        return PadFix(detection.t_capture_s, pad, below, np.eye(3) * 1e-4, 0.0, 0.01, "44")

    async def see(self, seconds: float, *, seen: bool = True, lag_s: float = 0.04, **changes: Any) -> None:
        """Vehicle states at 100 Hz; detections at 20 Hz of `lag_s` ago."""
        for turn in range(round(seconds / 0.01)):
            now_s = self.fakes.clock.now_s()
            pos = np.array([now_s, 0.0, -3.0]) + changes.pop("jump", 0.0)
            self.vehicle.publish(
                self.fakes.vehicle(t_capture_s=now_s, pos_ned_m=pos, vel_ned_m_s=np.array([1.0, 0.0, 0.0]), **changes)
            )
            if turn % 5 == 4:
                self.detections.publish(Detection(now_s - lag_s, turn, SEEN if seen else ()))
            await asyncio.sleep(0.01)


def look(fakes: Any, scenario: Any) -> PoseBench:
    async def main() -> PoseBench:
        bench = PoseBench(fakes)
        async with fakes.running(bench.loop):
            await scenario(bench)
        return bench

    return run_virtual(main(), start_s=10.0)


def test_pose_pairs_a_frame_with_the_vehicle_at_its_exposure(fakes: Any):
    """The vehicle goes north at 1 m/s, one metre a second from the origin: at t it is at t."""
    fixes = look(fakes, lambda b: b.see(1.0)).made.drain()
    assert len(fixes) >= 19
    assert max(abs(fix.pad_pos_ned_m[0] - fix.t_capture_s) for fix in fixes) < 1e-9
    assert all(fix.travelled_ned_m is not None for fix in fixes)


def test_pose_pairs_a_frame_with_the_vehicle_at_the_exposure_that_it_has_learnt(fakes: Any):
    """The vehicle rolls to and fro by 6 degrees three times a second, 3 m over a pad at rest, and frames are exposed
    35 ms later than they say: a fix would be off by up to 20 cm, of which a rate at one instant explains two thirds.
    """
    late_s, down = 0.035, np.array([0.0, 0.0, 3.0])

    def attitude(t_s: float) -> np.ndarray:
        return quaternion_from_rotation(rotation_from_euler(0.1 * math.sin(2.0 * math.pi * 3.0 * t_s), 0.0, 0.0))

    class Rolling(PoseBench):
        def fix(self, detection: Detection, state: VehicleState) -> PadFix:
            seen_body = rotation_from_quaternion(attitude(detection.t_capture_s + late_s)).T @ down
            way = rotation_from_quaternion(state.q_ned_from_body_wxyz) @ seen_body
            return PadFix(detection.t_capture_s, state.pos_ned_m + way, way, np.eye(3) * 0.04**2, 0.0, 0.01, "44")

        async def see(self, seconds: float, **_: Any) -> None:
            for turn in range(round(seconds / 0.01)):
                t_s = self.fakes.clock.now_s()
                state = self.fakes.vehicle(t_capture_s=t_s, pos_ned_m=-down, q_ned_from_body_wxyz=attitude(t_s))
                self.vehicle.publish(replace(state, vel_ned_m_s=np.zeros(3)))
                if turn % 3 == 2:
                    self.detections.publish(Detection(t_s - 0.1, turn, SEEN))
                await asyncio.sleep(0.01)

    async def main() -> list[PadFix]:
        bench = Rolling(fakes)
        made = []
        async with fakes.running(bench.loop):
            for _ in range(10):
                await bench.see(1.0)
                made += bench.made.drain()
        return made

    fixes = run_virtual(main(), start_s=10.0)
    off_m = [float(np.hypot(*fix.pad_pos_ned_m[:2])) for fix in fixes]
    assert max(off_m[:20]) > 0.15
    assert max(off_m[-60:]) < 0.03
    assert fixes[-1].delay_s == pytest.approx(late_s, abs=0.005)


def test_pose_makes_no_fix_of_a_frame_without_the_landmark(fakes: Any):
    assert look(fakes, lambda b: b.see(1.0, seen=False)).made.empty()


@pytest.mark.parametrize("lag_s", [-0.2, 5.0])
def test_pose_makes_no_fix_of_a_frame_that_no_telemetry_belongs_to(fakes: Any, lag_s):
    assert look(fakes, lambda b: b.see(1.0, lag_s=lag_s)).made.empty()


def test_pose_that_is_not_finite_is_left_out_and_the_next_one_is_taken(fakes: Any):
    async def scenario(bench: PoseBench) -> None:
        await bench.see(0.5)
        bench.spoil = math.nan
        await bench.see(0.5)
        before = bench.tracked.newest
        bench.spoil = 0.0
        await bench.see(0.5)
        assert before is not None and np.isfinite(before.pos_ned_m).all()

    bench = look(fakes, scenario)
    assert bench.tracked.newest is not None and bench.tracked.newest.t_last_fix_s > 11.3


def test_pose_after_a_jump_of_the_frame_starts_a_new_track(fakes: Any):
    async def scenario(bench: PoseBench) -> None:
        await bench.see(1.0)
        before = bench.tracked.newest
        assert before is not None and before.fixes_accepted >= 15
        await bench.see(0.2, frame_resets=1)

    track = look(fakes, scenario).tracked.newest
    assert track is not None and track.fixes_accepted <= 4


def test_recorder_writes_each_message_under_its_topic_at_its_own_time(fakes: Any):
    async def main() -> list[tuple[str, float]]:
        recorder = fakes.Recorder()
        vehicle: Topic[VehicleState] = Topic("vehicle")
        tracks: Topic[PadTrack] = Topic("tracks")
        recorded = tuple(Recorded(topic.name, topic.subscribe_window(8)) for topic in (vehicle, tracks))
        async with fakes.running(run_recorder(recorder=recorder, recorded=recorded, clock=fakes.clock)):
            vehicle.publish(fakes.vehicle(t_capture_s=1.5))
            tracks.publish(replace(fakes.track(2.5)))
            await asyncio.sleep(0.1)
        return recorder.written

    assert sorted(run_virtual(main())) == [("tracks", 2.5), ("vehicle", 1.5)]


def test_recorder_takes_every_kind_of_message_that_is_recorded(fakes: Any):
    """Texts carry no time of their own: the loop must know what to do with them."""

    async def main() -> list[tuple[str, float]]:
        recorder = fakes.Recorder()
        texts: Topic[OperatorText] = Topic("texts")
        recorded = (Recorded("texts", texts.subscribe_window(8)),)
        async with fakes.running(run_recorder(recorder=recorder, recorded=recorded, clock=fakes.clock)):
            texts.publish(OperatorText("landed"))
            await asyncio.sleep(0.1)
        return recorder.written

    assert [topic for topic, _ in run_virtual(main())] == ["texts"]
