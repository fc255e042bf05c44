"""`alight calibrate` from end to end: pictures in, judged files out, and what is refused in words."""

import asyncio
import re
import signal
import subprocess
import sys
import tomllib

import cv2
import numpy as np
import pytest

from app.config import LensConfig, read_config
from app.estimation.height_table import read_height_table
from app.landmark import paper_landmark
from app.messages import Frame
from app.wiring import CONFIGS
from drivers.recorder.mcap import McapRecorder

FOCAL_PX, CENTRE_PX = 420.0, np.array([315.0, 244.0])
LENS = CONFIGS / "cameras" / "pi-camera3-640.toml"


def turn(x, y, z):
    return (
        cv2.Rodrigues(np.array([x, 0.0, 0.0]))[0]
        @ cv2.Rodrigues(np.array([0.0, y, 0.0]))[0]
        @ (cv2.Rodrigues(np.array([0.0, 0.0, z]))[0])
    )


def board_picture(rotation, middle, fine=4):
    """A chessboard of 8 x 6 squares of 30 mm as a pinhole camera sees it: a drawing, warped by the plane's map."""
    scale = 20  # drawing: pixels a square, and a square of white round it
    squares = np.kron((np.add.outer(np.arange(6), np.arange(8)) % 2 == 0) * 195, np.ones((scale, scale)))
    drawing = np.pad(220 - squares, scale, constant_values=220).astype(np.uint8)
    t = np.asarray(middle) - rotation @ [0.12, 0.09, 0.0]
    camera = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1.0]])
    metres = np.array([[0.03 / scale, 0, 0.015 / scale - 0.03], [0, 0.03 / scale, 0.015 / scale - 0.03], [0, 0, 1.0]])
    finer = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1.0]])
    warp = finer @ camera @ np.column_stack([rotation[:, 0], rotation[:, 1], t]) @ metres
    large = cv2.warpPerspective(drawing, warp, (640 * fine, 480 * fine), flags=cv2.INTER_LINEAR, borderValue=110)
    return cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA)


def held(count, *, u=(0.12, 0.88), v=(0.15, 0.85)):
    """Poses of a board whose middle is all over the image, near and far, tilted all ways; wholly in the image."""
    rng = np.random.default_rng(7)
    board = np.array([[0, 0, 0], [0.24, 0, 0], [0.24, 0.18, 0], [0, 0.18, 0]]) - [0.12, 0.09, 0]
    poses = []
    while len(poses) < count:
        rotation, z = turn(*rng.uniform(-0.6, 0.6, 3)), rng.uniform(0.45, 1.0)
        middle = np.array(
            [(rng.uniform(*u) * 640 - 320) / FOCAL_PX * z, (rng.uniform(*v) * 480 - 240) / FOCAL_PX * z, z]
        )
        x, y, depth = (board @ rotation.T + middle).T
        px = np.column_stack([x, y]) / depth[:, None] * FOCAL_PX + CENTRE_PX
        if (px > 4).all() and (px < [636, 476]).all():
            poses.append((rotation, middle))
    return poses


@pytest.fixture(scope="module")
def board_video(tmp_path_factory):
    """Forty frames of the board all over the image, and a blurred one."""
    path = tmp_path_factory.mktemp("board") / "board.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (640, 480))
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 95)
    for k, pose in enumerate(held(40)):
        image = board_picture(*pose)
        image = cv2.GaussianBlur(image, (0, 0), 3.0) if k == 5 else image
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


BOARD = ("--columns", 8, "--rows", 6, "--square-mm", 30)


def test_lens_from_a_video_is_written_with_the_true_values_and_detect_takes_it(
    alight, board_video, tmp_path, pad_image
):
    out, draw = tmp_path / "cameras" / "mine.toml", tmp_path / "drawn"
    done = alight("calibrate", "lens", board_video, "--model", "pinhole", *BOARD, "--out", out, "--draw", draw)
    assert (done.code, done.err) == (0, ""), done.out
    found = read_config(out, LensConfig)
    assert [found.fx_px, found.fy_px] == pytest.approx([FOCAL_PX, FOCAL_PX], rel=0.003)
    assert [found.cx_px, found.cy_px] == pytest.approx(CENTRE_PX, abs=2.0)
    assert np.abs(found.distortion).max() < 0.02
    assert "chessboard, 8 x 6 squares of 30 mm: found in" in done.out
    assert re.search(r"refused board\.avi:000005: blurred", done.out)
    assert re.search(r"judgement: (good|usable)\n", done.out)
    assert sorted(p.name for p in draw.iterdir()) == ["lens.png", "views.csv"]
    assert "# Made by alight calibrate lens" in out.read_text()
    assert alight("detect", "--camera", out, pad_image).out.startswith("pad.png: 44334")


def test_live_view_of_a_board_ends_with_ctrl_c_and_what_was_collected(board_video, tmp_path):
    out = tmp_path / "mine.toml"
    command = [sys.executable, "-m", "app", "calibrate", "lens", "--live", board_video, "--model", "pinhole"]
    process = subprocess.Popen(
        [*map(str, (*command, *BOARD, "--out", out, "--force"))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    before: list[str] = []
    for line in iter(process.stdout.readline, ""):
        before.append(line)
        if line.startswith("  view 9:"):
            process.send_signal(signal.SIGINT)
            break
    after, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, ""), after
    assert "from a live camera" in out.read_text()
    assert any("fill the" in line for line in before)


def test_lens_from_one_side_is_not_written_and_exit_code_is_1_unless_forced(alight, tmp_path):
    folder = tmp_path / "left"
    folder.mkdir()
    for k, pose in enumerate(held(14, u=(0.1, 0.4))):
        cv2.imwrite(str(folder / f"{k}.png"), board_picture(*pose, fine=2))
    out = tmp_path / "mine.toml"
    command = ("calibrate", "lens", folder, "--model", "pinhole", *BOARD, "--out", out)
    done = alight(*command)
    assert (done.code, out.exists()) == (1, False)
    assert "judgement: not good" in done.out
    assert "fill the right edge of the image" in done.out
    assert f"{out} is not written; --force writes it all the same" in done.out
    assert alight(*command, "--force").code == 0
    assert "Judgement: not good" in out.read_text()


def test_board_of_another_size_is_said(alight, tmp_path):
    images = []
    for k, pose in enumerate(held(8)):
        images.append(tmp_path / f"{k}.png")
        cv2.imwrite(str(images[-1]), board_picture(*pose, fine=2))
    out = tmp_path / "mine.toml"
    error = alight("calibrate", "lens", *images, "--model", "pinhole", "--columns", 7, "--rows", 5, "--out", out)
    assert error.code == 2
    assert "0 usable view(s) of the board in 8 frames, at least 6 are needed" in error.error
    assert "give --columns 8 --rows 6: squares are counted, not inner corners" in error.error
    assert not out.exists()


@pytest.fixture
def stations(tmp_path):
    """The paper's landmark from straight above, f = 495 px: at four heights, in the middle and 90 px to the right."""
    folder = tmp_path / "stations"
    folder.mkdir()
    fine = 8
    for height in (0.6, 0.9, 1.4, 2.0):
        for name, right_px in (("middle", 0.0), ("aside", 90.0)):
            image = np.full((480 * fine, 640 * fine), 110, np.uint8)
            landmark = paper_landmark()
            half = landmark.quiet_zone_m / 2
            zone = np.array([[half, -half], [half, half], [-half, half], [-half, -half]])
            for corners_m, grey in [(zone, 225), *((c.corners_m, 25 if c.black else 225) for c in landmark.contours)]:
                u = 319.5 + 495.0 / height * corners_m[:, 1] + right_px
                v = 239.5 - 495.0 / height * (corners_m[:, 0] + 0.0295)
                fixed = np.round((fine * (np.column_stack([u, v]) + 0.5) - 0.5) * 16).astype(np.int32)
                cv2.fillPoly(image, [fixed], grey, shift=4)
            small = cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(folder / f"{name}-{height * 100:.0f}cm.png"), small)
    return folder


def test_height_table_from_frames_at_known_heights_follows_similar_triangles(alight, stations, tmp_path):
    out = tmp_path / "table.toml"
    command = ("calibrate", "height", stations, "--heights", "{cm}cm", "--camera", LENS, "--out", out)
    done = alight(*command, "--draw", tmp_path)
    assert (done.code, done.err) == (0, ""), done.out
    table = read_height_table(out)
    assert table.heights_m.tolist() == [0.6, 0.9, 1.4, 2.0]
    expected = 495.0 * 0.204168 / table.heights_m
    np.testing.assert_allclose(table.centred_px, expected, rtol=0.01)
    np.testing.assert_allclose(table.offset_px, expected, rtol=0.01)
    assert table.offset_distance_px == pytest.approx(90.0, abs=1.5)
    assert (tmp_path / "heights.png").stat().st_size > 10_000


def test_height_measured_wrong_is_named_and_nothing_is_written(alight, stations, tmp_path):
    rows = "".join(
        f"{side}-{cm}cm.png,{height}\n"
        for cm, height in ((60, 0.6), (90, 0.9), (140, 1.6), (200, 2.0))
        for side in ("middle", "aside")
    )
    heights, out = tmp_path / "heights.csv", tmp_path / "table.toml"
    heights.write_text("file,height_m\n" + rows)
    done = alight("calibrate", "height", stations, "--heights", heights, "--camera", LENS, "--out", out)
    assert (done.code, out.exists()) == (1, False)
    assert "measure the height of 1.6 m again" in done.out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["lens", "--model", "pinhole", "--out", "{new}"], "nothing to calibrate from; give one of the two"),
        (
            ["lens", "--model", "pinhole", "--out", "{there}", "a.png"],
            "is there already; give another name, or --overw",
        ),
        (["lens", "--model", "pinhole", "--out", "{new}", "nowhere"], "nowhere: no such file or folder"),
        (["lens", "--model", "pinhole", "--out", "{new}", "{there}"], "not an image"),
        (["lens", "--model", "pinhole", "--out", "mine.yaml", "a.png"], "not a .toml file"),
        (["lens", "--model", "pinhole", "--out", "{new}", "--live", "nowhere.toml"], "nowhere.toml: no such file"),
        (["lens", "--model", "pinhole", "--out", "{new}", "--live", "nowhere.mp4"], "nowhere.mp4: no such file"),
        (["lens", "--model", "mirror", "--out", "{new}", "a.png"], "'mirror' is not one of 'pinhole', 'fisheye'"),
        (["lens", "--out", "{new}", "a.png"], "missing option '--model'"),
        (["lens", "--model", "pinhole", "--out", "{new}", "--columns", "3", "a.png"], "invalid value for '--columns'"),
        (["height", "--out", "{new}"], "nothing to make a table from"),
        (["height", "--out", "{new}", "a.png"], "no heights; give --heights"),
        (["height", "--out", "{new}", "--heights", "{{m}}m", "a.png"], "no lens; give --camera"),
        (["height", "--out", "{new}", "--heights", "no.csv", "--camera", str(LENS), "a.png"], "no.csv: can't be read"),
        (["board", "--out", "board.gif"], "name it .pdf, .svg or .png"),
        (["board", "--out", "b.pdf", "--board", "charuco", "--dictionary", "9x9"], "unknown dictionary '9x9'"),
        ([], "missing command"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_in_one_line(alight, tmp_path, arguments, says):
    there = tmp_path / "there.toml"
    there.write_text("precious")
    done = alight("calibrate", *(a.format(new=tmp_path / "new.toml", there=there) for a in arguments))
    assert says in done.error
    assert there.read_text() == "precious"
    assert not (tmp_path / "new.toml").exists()


def test_board_that_is_printed_is_the_board_that_is_looked_for_without_options(alight, tmp_path):
    out = tmp_path / "board.png"
    assert alight("calibrate", "board", "--out", out).out == f"{out}\n"
    image = cv2.imread(str(out), cv2.IMREAD_GRAYSCALE)
    assert cv2.findChessboardCornersSB(cv2.resize(image, None, fx=0.25, fy=0.25), (9, 6))[0]


def test_written_files_are_valid_toml(alight, stations, tmp_path):
    out = tmp_path / "my table.toml"
    done = alight("calibrate", "height", stations, "--heights", "{cm}cm", "--camera", LENS, "--out", out)
    assert done.code == 0, done.out
    assert tomllib.loads(out.read_text())["name"] == "my table"


def test_height_table_from_a_flight_record_takes_the_heights_of_its_parts(alight, stations, tmp_path):
    pictures = [(h, side) for h in (60, 90, 140) for side in ("middle", "aside")]
    images = [cv2.imread(str(stations / f"{side}-{h}cm.png"), cv2.IMREAD_GRAYSCALE) for h, side in pictures]

    async def fly():
        async with McapRecorder(tmp_path / "flight.mcap", frame_rate_hz=100.0) as recorder:
            for k, image in enumerate(images):
                recorder.write("frames", 500.0 + k, Frame(500.0 + k, k, image))

    asyncio.run(fly())
    heights, out = tmp_path / "heights.csv", tmp_path / "table.toml"
    spans = "".join(f"flight.mcap,{h / 100},{2 * k - 0.5},{2 * k + 1.5}\n" for k, h in enumerate((60, 90, 140)))
    heights.write_text("file,height_m,from_s,to_s\n" + spans)
    command = ("calibrate", "height", tmp_path / "flight.mcap", "--heights", heights, "--camera", LENS, "--out", out)
    done = alight(*command)
    assert done.code == 0, done.out
    table = read_height_table(out)
    np.testing.assert_allclose(table.centred_px, 495.0 * 0.204168 / np.array([0.6, 0.9, 1.4]), rtol=0.01)
