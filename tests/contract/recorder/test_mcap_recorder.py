"""The flight record: written, read back, cut off, and opened by the mcap package's own reader."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from app.errors import RecorderError
from app.messages import Detection, FlightMode, Frame, LandedState, SeenContour, VehicleState
from app.ports import Recorder
from app.review.record_reader import Recorded, read_record
from drivers.recorder import mcap
from drivers.recorder.mcap import McapRecorder


def state(t_s: float = 12.5) -> VehicleState:
    return VehicleState(
        t_capture_s=t_s,
        pos_ned_m=np.array([1.0, 2.0, -3.5]),
        vel_ned_m_s=np.array([0.0, float("nan"), 0.25]),
        q_ned_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        armed=True,
        mode=FlightMode.OFFBOARD,
        landed=LandedState.IN_AIR,
    )


def frame(t_s: float = 12.5, sequence: int = 7) -> Frame:
    ramp = np.tile(np.arange(0, 240, 2, dtype=np.uint8), (64, 1))
    return Frame(t_s, sequence, ramp, exposure_s=0.002, name="a.png", gain=1.75)


async def written(path: Path, *items: tuple[str, float, Any], **settings: Any) -> McapRecorder:
    recorder = McapRecorder(path, **settings)
    port: Recorder
    async with recorder as port:
        for item in items:
            port.write(*item)
    return recorder


async def test_record_of_a_state_reads_back_with_its_fields(tmp_path: Path) -> None:
    await written(tmp_path / "a.mcap", ("vehicle", 12.5, state()))
    (recorded,) = read_record(tmp_path / "a.mcap")
    assert (recorded.topic, recorded.t_s, recorded.kind) == ("vehicle", 12.5, "VehicleState")
    assert isinstance(recorded.message, dict)
    assert recorded.message["pos_ned_m"] == [1.0, 2.0, -3.5]
    assert recorded.message["vel_ned_m_s"] == [0.0, None, 0.25]
    assert (recorded.message["mode"], recorded.message["landed"]) == ("offboard", "in_air")
    assert recorded.message["battery_fraction"] is None


async def test_record_of_nested_messages_reads_back_nested(tmp_path: Path) -> None:
    contour = SeenContour(0, np.array([[1.5, 2.0], [3.0, 4.0]]))
    await written(tmp_path / "a.mcap", ("detections", 1.0, Detection(1.0, 3, (contour,), "44", score=0.9)))
    (recorded,) = read_record(tmp_path / "a.mcap")
    assert isinstance(recorded.message, dict)
    assert recorded.message["contours"] == [{"index": 0, "corners_px": [[1.5, 2.0], [3.0, 4.0]]}]


async def test_record_of_a_frame_reads_back_as_that_frame(tmp_path: Path) -> None:
    await written(tmp_path / "a.mcap", ("frames", 12.5, frame()), jpeg_quality=95)
    (recorded,) = read_record(tmp_path / "a.mcap")
    assert isinstance(recorded.message, Frame)
    assert (recorded.message.sequence, recorded.message.exposure_s, recorded.message.name) == (7, 0.002, "a.png")
    assert recorded.message.gain == 1.75
    assert recorded.message.t_capture_s == 12.5
    difference = recorded.message.image.astype(int) - frame().image.astype(int)
    assert np.abs(difference).max() <= 4  # JPEG at 95


async def test_record_is_indexed_and_has_foxgloves_image_schema(tmp_path: Path) -> None:
    await written(tmp_path / "a.mcap", ("frames", 1.0, frame(1.0)), ("vehicle", 2.0, state(2.0)))
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        topics = [channel.topic for _, channel, _ in reader.iter_messages(topics=["vehicle"])]
    assert summary is not None
    assert topics == ["vehicle"]
    assert {s.name for s in summary.schemas.values()} == {"foxglove.CompressedImage", "alight.VehicleState"}
    assert summary.statistics is not None
    assert summary.statistics.message_count == 2
    schema = next(json.loads(s.data) for s in summary.schemas.values() if s.name == "alight.VehicleState")
    assert schema["properties"]["armed"] == {"type": "boolean"}
    assert schema["properties"]["pos_ned_m"]["type"] == "array"
    assert schema["properties"]["battery_fraction"] == {"anyOf": [{"type": "number"}, {"type": "null"}]}
    assert "offboard" in schema["properties"]["mode"]["enum"]


async def test_record_keeps_images_at_its_rate_and_all_else(tmp_path: Path) -> None:
    items = [("frames", k / 30.0, frame(k / 30.0, k)) for k in range(30)]
    await written(tmp_path / "a.mcap", *items, frame_rate_hz=10.0)
    kept = [r.message.sequence for r in read_record(tmp_path / "a.mcap") if isinstance(r.message, Frame)]
    assert kept[:3] == [0, 3, 6]
    assert len(kept) == 10


async def test_record_of_what_is_no_data_drops_that_message_alone(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Odd:
        t_s: float
        thing: object

    recorder = await written(tmp_path / "a.mcap", ("odd", 1.0, Odd(1.0, object())), ("vehicle", 2.0, state(2.0)))
    assert [r.topic for r in read_record(tmp_path / "a.mcap")] == ["vehicle"]
    assert (recorder.written, recorder.dropped) == (1, 1)


async def test_write_with_a_full_queue_drops_and_does_not_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = McapRecorder(tmp_path / "a.mcap")
    async with recorder:
        start_s = time.perf_counter()
        for k in range(500):
            recorder.write("frames", float(k), Frame(float(k), k, np.zeros((1200, 1600), np.uint8)))
        elapsed_s = time.perf_counter() - start_s
    assert elapsed_s < 0.5  # 500 images of 2 MP take the thread seconds
    assert recorder.dropped > 0
    assert recorder.written + recorder.dropped == 500


async def test_write_after_closing_is_dropped(tmp_path: Path) -> None:
    recorder = await written(tmp_path / "a.mcap")
    recorder.write("vehicle", 1.0, state())
    assert recorder.dropped == 1
    assert list(read_record(tmp_path / "a.mcap")) == []


KILLED = """
import asyncio, sys, time
import numpy as np
from pathlib import Path
from app.messages import OperatorText, Frame
from drivers.recorder import mcap
from drivers.recorder.mcap import McapRecorder

async def main():
    async with McapRecorder(Path(sys.argv[1])) as recorder:
        recorder.write("texts", 1.0, OperatorText("before the crash"))
        recorder.write("frames", 1.0, Frame(1.0, 1, np.zeros((48, 64), np.uint8)))
        while recorder.path.stat().st_size < 500:
            await asyncio.sleep(0.05)
        print("flushed", flush=True)
        await asyncio.sleep(60)

asyncio.run(main())
"""


def test_record_of_a_killed_process_reads_to_half_a_second_before_its_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"flushed\n"
        process.send_signal(signal.SIGKILL)
    assert [r.topic for r in read_record(path)] == ["texts", "frames"]


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> queue.Queue[tuple[str, int]]:
    """For each time that a file is put onto the disk: by which thread, and how long the file is."""
    times: queue.Queue[tuple[str, int]] = queue.Queue()
    sync = os.fdatasync

    def counting(file: int) -> None:
        sync(file)
        times.put((threading.current_thread().name, os.fstat(file).st_size))

    monkeypatch.setattr(os, "fdatasync", counting)
    monkeypatch.setattr(mcap, "FLUSH_S", 0.01)
    return times


async def test_record_is_put_onto_the_disk_while_it_is_written_by_a_thread_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, synced: queue.Queue[tuple[str, int]]
) -> None:
    monkeypatch.setattr(mcap, "SYNC_S", 0.02)
    async with McapRecorder(tmp_path / "a.mcap") as recorder:
        thread, empty = await asyncio.to_thread(synced.get, timeout=10.0)
        recorder.write("vehicle", 1.0, state())
        while (await asyncio.to_thread(synced.get, timeout=10.0))[1] == empty:
            pass
        (recorded,) = read_record(recorder.path)
    assert (recorded.topic, thread) == ("vehicle", "recorder")


async def test_record_is_put_onto_the_disk_when_it_is_closed_and_not_at_each_flush(
    tmp_path: Path, synced: queue.Queue[tuple[str, int]]
) -> None:
    async with McapRecorder(tmp_path / "a.mcap") as recorder:
        recorder.write("vehicle", 1.0, state())
        while recorder.path.stat().st_size < 500:
            await asyncio.sleep(0.01)
    assert list(synced.queue) == [("recorder", recorder.path.stat().st_size)]


@pytest.fixture
def sync_fails(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Putting a file onto the disk fails with an error number: each try."""
    tries: queue.Queue[int] = queue.Queue()

    def set_to(number: int) -> queue.Queue[int]:
        def failing(file: int) -> None:
            tries.put(file)
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr(os, "fdatasync", failing)
        monkeypatch.setattr(mcap, "FLUSH_S", 0.01)
        monkeypatch.setattr(mcap, "SYNC_S", 0.0)
        return tries

    return set_to


async def test_record_in_a_file_that_needs_no_disk_goes_on(tmp_path: Path, sync_fails: Any) -> None:
    tries = sync_fails(errno.EINVAL)
    async with McapRecorder(tmp_path / "a.mcap") as recorder:
        await asyncio.to_thread(tries.get, timeout=10.0)
        await asyncio.to_thread(tries.get, timeout=10.0)
        recorder.write("vehicle", 1.0, state())
    assert [r.topic for r in read_record(tmp_path / "a.mcap")] == ["vehicle"]


async def test_record_on_a_disk_that_fails_is_given_up_and_what_follows_is_dropped(
    tmp_path: Path, sync_fails: Any
) -> None:
    sync_fails(errno.EIO)
    async with McapRecorder(tmp_path / "a.mcap") as recorder:
        assert recorder._thread is not None
        await asyncio.to_thread(recorder._thread.join, 10.0)
        recorder.write("vehicle", 1.0, state())
    assert recorder.dropped == 1


@pytest.fixture
async def whole(tmp_path: Path) -> bytes:
    await written(tmp_path / "whole.mcap", *(("vehicle", float(k), state(float(k))) for k in range(50)))
    return (tmp_path / "whole.mcap").read_bytes()


@pytest.mark.parametrize("fraction", [0.03, 0.2, 0.5, 0.8, 0.99])
def test_record_cut_off_anywhere_reads_a_beginning_of_itself(whole: bytes, tmp_path: Path, fraction: float) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: int(len(whole) * fraction)])
    times = [r.t_s for r in read_record(path)]
    assert times == [float(k) for k in range(len(times))]


@pytest.mark.parametrize("content", [b"", b"\x89MC", b"\x89PNG\r\n\x1a\n" + bytes(100), b"hello, this is no record"])
def test_file_that_is_no_record_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(RecorderError, match=r"a\.mcap: not an MCAP file"):
        list(read_record(path))


def test_record_that_is_damaged_is_refused(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    middle = whole.index(b"zstd") + 60
    path.write_bytes(whole[:middle] + bytes(b ^ 0x55 for b in whole[middle : middle + 40]) + whole[middle + 40 :])
    with pytest.raises(RecorderError, match="damaged"):
        list(read_record(path))


def test_record_that_is_missing_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RecorderError, match=r"none\.mcap: can't be read"):
        list(read_record(tmp_path / "none.mcap"))


async def test_record_in_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RecorderError, match="can't be written"):
        async with McapRecorder(tmp_path / "file" / "a.mcap"):
            pass


async def test_record_on_a_full_disk_is_given_up_and_what_follows_is_dropped() -> None:
    frames = [("frames", float(k), frame(float(k), k)) for k in range(16)]
    recorder = await written(Path("/dev/full"), *frames, jpeg_quality=100)
    recorder.write("vehicle", 99.0, state())
    assert recorder.dropped > 0


def test_recorded_unpacks_as_topic_time_kind_message() -> None:
    topic, t_s, kind, message = Recorded("a", 1.0, "K", {})
    assert (topic, t_s, kind, message) == ("a", 1.0, "K", {})
