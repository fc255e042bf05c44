"""Camera files and height tables as they are written: the application reads them, and a person too."""

import math
import tomllib

import cv2
import numpy as np
import pytest

from app.calibration.board import Board, NoView, View
from app.calibration.bundle import Fitted, Poses
from app.calibration.coverage import Grid
from app.calibration.heights import HeightCalibration, Row
from app.calibration.judgement import Check, Verdict
from app.calibration.lens import LensCalibration
from app.calibration.parameters import Model
from app.calibration.sample import Sample
from app.config import LensConfig, read_config
from app.errors import CalibrationError, ConfigError
from app.estimation.height_table import HeightTableConfig, read_height_table
from app.review.calibration.drawing import draw_heights, draw_lens, write_views
from app.review.calibration.files import camera_text, check_free, height_table_text, write_checked
from app.review.calibration.words import (
    coverage_lines,
    height_lines,
    judgement_lines,
    lens_lines,
    refused_lines,
    view_lines,
)

BOARD = Board("chessboard", 10, 7, 0.025)
CHECKS = [
    Check("views", "12", "good from 15, usable from 10", Verdict.USABLE, "record more views"),
    Check("coverage", "90%", "good from 85%, usable from 65%", Verdict.GOOD),
]


@pytest.fixture
def lens():
    """A calibration by hand: three views of ten corners."""
    rng = np.random.default_rng(0)
    views = tuple(
        View(f"{k}.png", (640, 480), np.arange(10), np.zeros((10, 3)), rng.uniform(0, 470, (10, 2)), 0.8, 20.0)
        for k in range(3)
    )
    model = Model("equidistant", (640, 480), frozenset({"k3", "k4"}))
    parameters = np.array([215.25, 215.5, 320.125, 239.75, 0.03, -0.01, 0.0, 0.0])
    residuals = np.tile([[0.3, 0.4]], (30, 1))
    fitted = Fitted(
        model, parameters, Poses(np.zeros((3, 3, 3)), np.zeros((3, 3))), residuals, np.full(3, 0.5), 0.35, np.eye(8)
    )
    sigma = np.full((6, 8), 0.25)
    sigma[0, 0] = math.inf
    deviation = np.array([0.1, 0.1, 0.2, 0.2, 0.001, 0.0005, 0.0, 0.0])
    return LensCalibration(fitted, views, (), np.full(3, 0.6), deviation, Grid.over((640, 480)), sigma)


@pytest.fixture
def table():
    rows = tuple(Row(h, 80.0 / h, 79.0 / h, (5, 6), (0.002, 0.003)) for h in (0.5, 1.0, 2.0))
    samples = tuple((Sample(f"{r.height_m}", r.height_m, 80.0 / r.height_m, 0.0), 0) for r in rows)
    return HeightCalibration(rows, 95.5, 0.2, 400.0, 398.0, 0.004, False, samples, (NoView("a", "b"),))


def test_camera_file_is_read_by_the_application_with_the_fitted_values(lens, tmp_path):
    text = camera_text(lens, CHECKS, BOARD, "board.mp4", "2026-03-04 05:06 UTC")
    path = tmp_path / "cameras" / "mine.toml"
    write_checked(path, text, LensConfig)
    found = read_config(path, LensConfig)
    assert found == LensConfig(
        model="equidistant",
        width_px=640,
        height_px=480,
        fx_px=215.25,
        fy_px=215.5,
        cx_px=320.125,
        cy_px=239.75,
        distortion=(0.03, -0.01, 0.0, 0.0),
    )


def test_camera_file_says_when_from_what_and_how_good(lens):
    text = camera_text(lens, CHECKS, BOARD, "board.mp4", "2026-03-04 05:06 UTC")
    comments = " ".join(line[1:].strip() for line in text.splitlines() if line.startswith("#"))
    for words in (
        "2026-03-04 05:06 UTC",
        "from board.mp4",
        "chessboard, 10 x 7 squares of 25 mm: 3 views",
        "Error 0.500 px rms; 0.600 px on views that the fit did not see",
        "fx 0.1",
        "Judgement: usable; views 12 (good from 15, usable from 10)",
    ):
        assert words in comments


def test_name_of_a_source_cannot_break_out_of_its_comment(lens):
    text = camera_text(lens, CHECKS, BOARD, 'a\nmodel = "pinhole"\x1b[31m.mp4', "now")
    assert tomllib.loads(text)["model"] == "equidistant"


def test_height_table_is_read_by_the_application_with_its_rows(table, tmp_path):
    path = tmp_path / "mine.toml"
    write_checked(path, height_table_text(table, CHECKS, 'my "table"', "frames", "now"), HeightTableConfig)
    found = read_height_table(path)
    assert found.name == 'my "table"'
    assert found.heights_m.tolist() == [0.5, 1.0, 2.0]
    assert found.centred_px.tolist() == [160.0, 80.0, 40.0]
    assert found.offset_px.tolist() == [158.0, 79.0, 39.5]
    assert (found.offset_distance_px, found.side_m, found.focal_px) == (95.5, 0.2, 400.0)


def test_file_that_the_application_would_not_read_is_not_left_behind(tmp_path):
    path = tmp_path / "mine.toml"
    with pytest.raises(ConfigError):
        write_checked(path, 'model = "mirror"\n', LensConfig)
    assert list(tmp_path.iterdir()) == []


def test_file_that_is_there_is_replaced_only_when_told(tmp_path):
    path = tmp_path / "mine.toml"
    check_free(path, False)
    path.write_text("precious")
    with pytest.raises(CalibrationError, match="is there already; give another name, or --overwrite"):
        check_free(path, False)
    check_free(path, True)


def test_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match=r"not a \.toml file"):
        check_free(tmp_path / "mine.yaml", True)


def test_folder_that_cannot_be_written_is_said(tmp_path, lens):
    (tmp_path / "file").write_text("")
    for call in (
        lambda: write_checked(tmp_path / "file" / "a.toml", "", LensConfig),
        lambda: write_views(lens, [], tmp_path / "file"),
        lambda: draw_lens(lens, np.ones((6, 8), dtype=bool), "", tmp_path / "file"),
    ):
        with pytest.raises(CalibrationError, match="can't be written"):
            call()


def test_pictures_are_drawn(lens, table, tmp_path):
    for path in (
        draw_lens(lens, np.ones((6, 8), dtype=bool), "mine", tmp_path / "new"),
        draw_heights(table, "mine", tmp_path / "new"),
    ):
        image = cv2.imread(str(path))
        assert image.shape[0] > 500
        assert image.std() > 5


def test_list_of_views_has_every_frame(lens, tmp_path):
    path = write_views(lens, [NoView("soft.png", "blurred: a, b")], tmp_path)
    lines = path.read_text().splitlines()
    assert len(lines) == 5
    assert lines[1].startswith("0.png,used,10,0.5000,0.6000,0.80")
    assert lines[-1] == 'soft.png,refused,,,,,"blurred: a, b"'


def test_words_tell_parameters_errors_and_views(lens):
    lines = "\n".join([*lens_lines(lens), *view_lines(lens)])
    assert "fx = 215.25 +- 0.10 px" in lines
    assert "k1 = +0.03000 +- 0.00100" in lines
    assert "k3 = 0 (the data do not ask for it)" in lines
    assert "rms 0.500 px; half of the corners under 0.500" in lines
    assert "used 0.png: 10 corners, error 0.500 px, held out 0.600 px" in lines


def test_coverage_in_words_shows_counts_gaps_and_dark_cells():
    lines = coverage_lines(np.array([[12, 0], [3, 0]]), np.array([[True, True], [True, False]]))
    assert lines == ["  +-------+", "  | 12  . |", "  |  3    |", "  +-------+"]


def test_refusals_are_counted_by_their_reason():
    many = [NoView(f"{k}.png", "no board found") for k in range(10)]
    lines = refused_lines([*many, NoView("x.png", "blurred: edges of 2.0 px")])
    assert lines == [
        "  refused 10: no board found ... (such as 0.png: no board found)",
        "  refused x.png: blurred: edges of 2.0 px",
    ]


def test_judgement_in_words_ends_with_what_to_do():
    lines = judgement_lines(CHECKS)
    assert lines[-2:] == ["judgement: usable", "  views usable: record more views"]
    assert "usable    views" in lines[0]


def test_table_in_words_has_a_row_for_each_height(table):
    lines = height_lines(table)
    assert "160.00 (   5)    158.00 (   6)" in lines[1]
    assert len(lines) == 6
    assert lines[-1] == "  D = 95.5 px"
