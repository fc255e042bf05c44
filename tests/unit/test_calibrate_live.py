"""Calibration from a running camera, with a camera that is none and time that is virtual."""

from __future__ import annotations

import asyncio
import io

import numpy as np
import pytest
from rich.console import Console

import app.calibrate_height as calibrate
import app.calibrate_live as calibrate_live
from app.calibrate_live import gather_views, take_station
from app.calibration.board import Board, NoView, View
from app.calibration.collect import LIVE_VIEWS, Collector
from app.calibration.sample import Sample
from app.clock import run_virtual
from app.errors import CalibrationError, CameraError
from app.estimation.height_table import read_height_table
from app.messages import Frame
from app.wiring import load_shipped_rig

BOARD = Board("chessboard", 10, 7, 0.025)
CORNERS = BOARD.corners_m


class Camera:
    """Gives images that are nothing but their number, ten a second."""

    def __init__(self, images, error=None):
        self.images, self.error, self.opened, self.closed = images, error, 0, 0

    async def __aenter__(self):
        self.opened += 1
        return self

    async def __aexit__(self, *_):
        self.closed += 1

    async def frames(self):
        for k, image in enumerate(self.images):
            await asyncio.sleep(0.1)
            yield Frame(k / 10, k, image)
        if self.error is not None:
            raise self.error


class Finder:
    """Says of image k what is listed: the board at a place (u, v) with squares of a size, or nothing."""

    def __init__(self, places):
        self.places = places

    def find(self, image, name):
        place = self.places[int(image[0, 0])]
        if place is None:
            return NoView(name, "no board found")
        u, v, square, blur = place
        px = CORNERS[:, :2] / 0.025 * square
        px = px - px.mean(axis=0) + [u, v]
        return View(name, (640, 480), np.arange(54), CORNERS, px, blur, square)


def gather(places, error=None):
    collector = Collector(BOARD)
    collector._finder = Finder(places)
    images = [np.full((480, 640), k, np.uint8) for k in range(len(places))]
    images = [np.where(np.arange(640) < 1, image, 200).astype(np.uint8) for image in images]
    camera, told = Camera(images, error), io.StringIO()
    try:
        run_virtual(gather_views(camera, collector, Console(file=told, force_terminal=False)))
    finally:
        assert (camera.opened, camera.closed) == (1, 1)
    return collector, told.getvalue()


def everywhere():
    """A walk over the image: large squares in a grid of places, and near and far."""
    return [(u, v, s, 0.8) for s in (20.0, 32.0) for v in (90, 170, 240, 310, 390) for u in (100, 210, 320, 430, 540)]


def test_live_views_end_by_themselves_when_the_image_is_covered():
    collector, told = gather([*everywhere(), *everywhere(), *everywhere()])
    assert collector.missing() == []
    assert len(collector.views) >= LIVE_VIEWS
    assert collector.looked_at < 3 * len(everywhere())
    assert told.rstrip().endswith("enough")


def test_live_view_that_adds_nothing_is_not_taken():
    collector, _ = gather([(320, 240, 25.0, 0.8)] * 10)
    assert (len(collector.views), collector.looked_at) == (1, 10)


def test_live_view_that_is_blurred_is_not_taken():
    places = [(120 + 100 * k, 240, 25.0, 0.8) for k in range(5)]
    collector, _ = gather([*places, (320, 100, 25.0, 2.4)])
    assert len(collector.views) == 5


def test_live_session_says_what_is_missing():
    _, told = gather([None, (150, 240, 25.0, 0.8), None])
    assert "view 1: 54 corners" in told
    assert "fill the right edge of the image" in told


def test_camera_that_fails_is_an_error_and_closed():
    with pytest.raises(CameraError, match="unplugged"):
        gather([(320, 240, 25.0, 0.8)], error=CameraError("unplugged", "plug it in"))


def test_frames_that_end_leave_the_views_that_there_are():
    collector, _ = gather([(320, 240, 25.0, 0.8), (100, 100, 25.0, 0.8)])
    assert len(collector.views) == 2


# --------------------------------------------------------------------------------------------------- heights, a station
@pytest.fixture(scope="module")
def rig():
    return load_shipped_rig("simulator.toml")


@pytest.fixture
def in_virtual_time(monkeypatch):
    monkeypatch.setattr(calibrate_live.asyncio, "run", run_virtual)


def test_station_takes_as_many_frames_as_wanted_and_measures_them(scene, rig, in_virtual_time):
    lens = scene.fisheye
    image = scene.draw(scene.view(1.0), lens=lens)
    assert (rig.lens_config.fx_px, rig.lens_config.model) == (lens.f, lens.model)
    camera = Camera([image] * 6)
    taken = take_station(camera, rig, 1.0, 3)
    assert len(taken) == 3
    assert camera.closed == 1
    side_m = 0.38 * np.sqrt(4 / np.sqrt(3) / 8)
    for sample in taken:
        assert isinstance(sample, Sample)
        assert sample.height_m == 1.0
        assert sample.side_px == pytest.approx(lens.f * side_m, rel=0.01)


def test_station_without_the_landmark_gives_reasons_and_ends_in_time(rig, in_virtual_time):
    grey = np.full((480, 640), 120, np.uint8)
    taken = take_station(Camera([grey] * 300), rig, 1.0, 3)
    assert 150 <= len(taken) <= 200  # twenty seconds at ten a second
    assert all(isinstance(item, NoView) for item in taken)


def test_station_without_a_frame_is_an_error(rig, in_virtual_time):
    with pytest.raises(CameraError, match="gave no frame"):
        take_station(Camera([]), rig, 1.0, 3)


# ----------------------------------------------------------------------------------------------------- heights, a table
class Still(Camera):
    """The same image, without end."""

    def __init__(self, image):
        super().__init__([image] * 50)


def test_live_heights_are_asked_for_until_an_empty_answer_and_make_a_table(
    scene, rig, in_virtual_time, monkeypatch, tmp_path
):
    stations = [(h, aside) for h in (0.5, 0.8, 1.2) for aside in (0.0, 0.45)]
    cameras = iter([Still(scene.draw(scene.view(h, right_m=aside * h, forward_m=0.0295))) for h, aside in stations])
    monkeypatch.setattr(calibrate, "make_camera", lambda _: next(cameras))
    answers = iter(["tall", "-1", *(f"{h:g}".replace(".", ",") for h, _ in stations), ""])
    told, out = io.StringIO(), tmp_path / "table.toml"
    written = calibrate.run_height_live(
        rig.path, lambda _: next(answers), 2, False, calibrate.Target(out), Console(file=told, force_terminal=False)
    )
    assert written, told.getvalue()
    assert "'tall' is no height in metres" in told.getvalue()
    table = read_height_table(out)
    assert table.heights_m.tolist() == [0.5, 0.8, 1.2]
    side_m = 0.38 * np.sqrt(4 / np.sqrt(3) / 8)
    np.testing.assert_allclose(table.centred_px, 215.0 * side_m / table.heights_m, rtol=0.01)
    np.testing.assert_allclose(table.offset_px, 215.0 * side_m / table.heights_m, rtol=0.01)
    # The levelled camera's pixels: 0.45 of the height aside, whatever the lens does there.
    assert table.offset_distance_px == pytest.approx(0.45 * 215.0, abs=2.0)


def test_live_heights_end_with_the_input_too(rig, tmp_path):
    def nobody(_):
        raise EOFError

    console = Console(file=io.StringIO(), force_terminal=False)
    with pytest.raises(CalibrationError, match="no frame with a known height"):
        calibrate.run_height_live(rig.path, nobody, 2, False, calibrate.Target(tmp_path / "t.toml"), console)
